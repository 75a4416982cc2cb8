"""The likelihood of a fitted model in innovation form: its noise, its whitening, its linear unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from discrepancy.evidence.fitted_noise import FittedNoise, fitted_noise, log_price
from discrepancy.evidence.likeliest_forces import Forces, along_forces, linearisation_error, settled
from discrepancy.evidence.linearised_records import linear_records, record_columns
from discrepancy.evidence.standstill import samples_at_standstill
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import likeliest_change, likeliest_rise
from discrepancy.innovations.noise_model import NoiseModel
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.stages.stage import Stage

__all__ = ["StageLikelihood"]

#: Samples × outputs of all records that a likelihood is computed of.  Where there are more, means over several samples
#: are taken: white noise stays white, and what changes slowly is known as well as from all of them.
ROWS = 6000
#: Shapes of laws by which dry friction fades or gives way.
HOW_FRICTION_FADES = ("v_s", "v_stribeck", "x_s")
#: How often the noise is fitted anew along other forces, at most: the forces hardly change with it.
LINEARISED_AGAIN = 2
#: Samples that remain of the shortest record, at least.
SHORTEST = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class StageLikelihood:
    """A fitted stage with its likelihood; everything is computed on first use.

    Parameters
    ----------
    stage : Stage
    start : NoiseModel or None
        Of a neighbouring model, from which the fit of the noise begins.
    grow : bool
        Whether latent processes may be added to those of ``start``.
    given_left_out : tuple of ndarray or None
        Samples of every record that are left out, of the first model of a search: all its models are compared on the
        same samples.  None: those at a standstill of this model.
    given_noise : FittedNoise or None
        The noise where it is known already.
    as_it_stands : bool
        Whether the evidence is that of the parameters where the stage stands.  Else they are integrated out about those
        of largest likelihood, which the linearised problem says.
    along_motion : bool
        Whether the machine is linearised along its likeliest motion, under the forces that nobody recorded, or along a
        simulation without these.
    given_forces : tuple of mapping
        Of each record the forces that nobody recorded along which the machine is first linearised: those that were
        found elsewhere; empty: none.
    """

    stage: Stage
    start: NoiseModel | None = None
    grow: bool = True
    given_left_out: tuple[np.ndarray, ...] | None = None
    given_noise: FittedNoise | None = None
    as_it_stands: bool = False
    along_motion: bool = False
    given_forces: tuple[Forces, ...] = ()
    _kept: dict[str, Any] = field(default_factory=dict, repr=False)
    _fitted: list[FittedNoise] = field(default_factory=list, init=False, repr=False)

    def with_richer_noise(self) -> StageLikelihood:
        """Return the same stage with a noise model that may have further latent processes."""
        kept = {**self._kept, "at first": self.linearised}
        return replace(self, start=self.noise.model, grow=True, given_noise=None, _kept=kept)

    def linearised_along_motion(self) -> StageLikelihood:
        """Return the same stage linearised along its likeliest motion; its noise begins with this one's."""
        kept = {"at first": self.linearised_at_first, "left_out": self.left_out}
        return replace(self, start=self.noise.model, grow=True, given_noise=None, along_motion=True, _kept=kept)

    @property
    def linearisation_error(self) -> float:
        """Nats by which the linearised machine is off along the likeliest forces."""
        return linearisation_error(self.linearised, self.noise.records, self.noise.model)

    def with_likelier_noise(self, start: NoiseModel, forces: tuple[Forces, ...] = ()) -> StageLikelihood | None:
        """Return the same stage with its noise fitted from that of another model; None where that is no likelier.

        Parameters
        ----------
        start : NoiseModel
        forces : tuple of mapping
            Of each record: where the other is linearised.  The likeliest motion has several maxima as well, so it is
            also tried from there; empty: it is not.
        """
        records = self.noise.records
        columns, std, offset = record_columns(self.linearised, records, self.held)
        fitted = fitted_noise(self.linearised, records, columns, std, offset, start, grow=False)
        likelier = [replace(self, given_noise=fitted)]
        if any(forces):
            likelier.append(
                replace(
                    self,
                    start=start,
                    grow=False,
                    given_noise=None,
                    given_forces=forces,
                    _kept={"left_out": self.left_out},
                )
            )
        best = max(likelier, key=lambda likelihood: likelihood._value)
        return best if best._value > self._value else None

    @property
    def forces(self) -> tuple[Forces, ...]:
        """Of each record the forces along which the machine is linearised."""
        return tuple(e.forces for e in self.linearised.experiments)

    @property
    def _value(self) -> float:
        return self.noise.log_likelihood + log_price(self.linearised, self.noise.model)

    def neighbour(self, stage: Stage, noise: NoiseModel | None = None) -> StageLikelihood:
        """Return the likelihood of another fit on the same samples; its noise begins with this one's, or as given."""
        start = noise or self.noise.model
        same = [str(e) for e in stage.effects] == [str(e) for e in self.stage.effects]
        forces = self.forces if same else ()
        return StageLikelihood(
            stage=stage,
            start=start,
            grow=False,
            given_left_out=self.left_out,
            along_motion=self.along_motion,
            given_forces=forces,
        )

    @property
    def linearised_at_first(self) -> LinearisedProblem:
        """The stage linearised where the fit of its noise begins."""
        if "at first" not in self._kept:
            stage = self.stage
            fits = stage.identify.fits
            given = fits[0].experiment.preparation
            rows = sum(f.residual.size for f in fits)
            shortest = min(f.residual.shape[0] for f in fits)
            factor = max(1, min(int(np.ceil(rows / ROWS)), shortest // SHORTEST))
            problem = stage.linearised_problem(replace(given, average=given.average * factor))
            # the noise of recorded inputs is a latent process here
            quiet = tuple(replace(f, experiment=f.experiment.without_input_noise()) for f in fits)
            problem = problem.with_calibration(replace(stage.identify, fits=quiet))
            self._kept["at first"] = along_forces(problem, self.given_forces)
        linearised: LinearisedProblem = self._kept["at first"]
        return linearised

    @property
    def linearised(self) -> LinearisedProblem:
        """The stage linearised along its identification records under the likeliest forces, not weighted."""
        _ = self.noise
        linearised: LinearisedProblem = self._kept.get("linearised", self.linearised_at_first)
        return linearised

    @property
    def undisturbed(self) -> LinearisedProblem:
        """The same along the motion without forces that nobody recorded: a simulation."""
        if "undisturbed" not in self._kept:
            forces = [e.forces for e in self.linearised_at_first.experiments]
            self._kept["undisturbed"] = (
                along_forces(self.linearised_at_first, [{} for _ in forces])
                if any(forces)
                else self.linearised_at_first
            )
        undisturbed: LinearisedProblem = self._kept["undisturbed"]
        return undisturbed

    def free_memory(self) -> None:
        """Drop what is as long as the records and seldom asked for again; it is computed again where it is."""
        for problem in ("at first", "linearised", "undisturbed"):
            if problem in self._kept:
                self._kept[problem].drop_runs()

    @property
    def left_out(self) -> tuple[np.ndarray, ...]:
        """Which prepared samples of every record are no part of the likelihood, (n,) of bool each."""
        if self.given_left_out is not None:
            return self.given_left_out
        if "left_out" not in self._kept:
            self._kept["left_out"] = samples_at_standstill(self.linearised_at_first)
        return self._kept["left_out"]

    @property
    def count(self) -> int:
        """Samples of all outputs that are part of the likelihood."""
        outputs = len(self.stage.outputs)
        return outputs * sum(int(np.sum(~mask)) for mask in self.left_out)

    @property
    def recorded(self) -> int:
        """Recorded samples that these are the means of."""
        given = self.linearised_at_first.preparation
        return self.count * given.average * given.decimate

    @property
    def duration(self) -> float:
        """Of the longest record, s."""
        return max(float(r.time[-1] - r.time[0]) for r in self.noise.records)

    @property
    def held(self) -> tuple[str, ...]:
        """Parameters that the likelihood keeps at their values: at a bound, or the shape of a law.

        Each point of a shape grid is a law of its own with its share of the prior, so a shape is not integrated out.
        """
        effects = self.stage.effects
        shapes = [e.parameter_name(k) for e in effects for k in e.definition.free_shapes]
        return (*self.stage.identify.at_bound, *shapes)

    @property
    def held_if_shapes_move(self) -> tuple[str, ...]:
        """Parameters that keep their values where the shapes of laws move: at a bound, or how friction fades.

        How friction sticks elsewhere does not follow from a linearisation.
        """
        effects = self.stage.effects
        fading = [e.parameter_name(k) for e in effects for k in e.definition.free_shapes if k in HOW_FRICTION_FADES]
        return (*self.stage.identify.at_bound, *fading)

    @property
    def noise(self) -> FittedNoise:
        """The noise model that explains the residual best beside the calibration."""
        if self.given_noise is not None:
            return self.given_noise
        if not self._fitted:  # no cached_property: on Python 3.11 that is one lock for all models
            self._fitted.append(self._fitted_noise())
        return self._fitted[0]

    def _fitted_noise(self) -> FittedNoise:
        """Fit the noise; then once more where the machine is linearised along the likeliest forces, if that differs."""
        linearised, records = self.linearised_at_first, linear_records(self.linearised_at_first, self.left_out)
        if self.along_motion and self.start is not None:
            linearised, records = settled(linearised, records, self.start, self.left_out) or (linearised, records)
        fitted = self._noise_of(linearised, records, self.start, self.grow or self.start is None)
        for _ in range(LINEARISED_AGAIN if self.along_motion else 0):
            there = settled(linearised, records, fitted.model, self.left_out)
            if there is None:
                break
            linearised, records = there
            fitted = self._noise_of(linearised, records, fitted.model, False)
        self._kept["linearised"] = linearised
        return fitted

    def _noise_of(
        self, linearised: LinearisedProblem, records: tuple[LinearRecord, ...], start: NoiseModel | None, grow: bool
    ) -> FittedNoise:
        columns, std, offset = record_columns(linearised, records, self.held)
        return fitted_noise(linearised, records, columns, std, offset, start, grow=grow)

    def likeliest_values(self, *, shapes: bool = False) -> dict[str, float]:
        """Return the parameters, the strengths among them, of largest likelihood, within their bounds, SI.

        The stage was fitted by least squares, to which what a random force does counts as an error like any other.

        Parameters
        ----------
        shapes : bool
            Whether the shapes of laws move as well, but for those by which friction fades.
        """
        identify, held, change = self.stage.identify, self.held, self.noise.change
        if shapes:
            held = self.held_if_shapes_move
            columns, std, offset = record_columns(self.linearised, self.noise.records, held)
            change = likeliest_change(columns, self.noise.model, std, offset)
        values, bounds = identify.to_dict(), {q.name: (q.min, q.max) for q in identify.parameters}
        moved = [n for n in self.linearised.sensitivities().names if n not in held]
        for name, step in zip(moved, change, strict=True):
            values[name] = float(np.clip(values[name] + step, *bounds[name]))
        return values

    def promise_of_shapes(self) -> float:
        """Return the nats by which the linearised likelihood rises further where shapes of laws may move as well."""
        return self._rise(self.held_if_shapes_move) - self.rise_to_likeliest

    @cached_property
    def rise_to_likeliest(self) -> float:
        """By how many nats the linearised likelihood is larger at its likeliest parameters than where it stands."""
        return self._rise(self.held)

    def _rise(self, held: Sequence[str]) -> float:
        columns, std, offset = record_columns(self.linearised, self.noise.records, held)
        return likeliest_rise(columns, self.noise.model, std, offset)

    @cached_property
    def weighted(self) -> LinearisedProblem:
        """The linearised problem as innovations: white where the model and its noise explain the records."""
        return self.linearised.weighted_by(self.noise.weighting())
