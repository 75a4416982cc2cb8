"""The likelihood of a fitted model in innovation form: its noise, its whitening, its linear unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from discrepancy.evidence.standstill import places_that_stick, samples_at_standstill, standstill_at
from discrepancy.innovations.fewer_states import with_fewer_states
from discrepancy.innovations.linear_record import LinearRecord, linear_record
from discrepancy.innovations.noise_fit import PROCESS_PRICE, RecordColumns, fit_noise, likeliest_change, likeliest_rise
from discrepancy.innovations.noise_model import InnovationWeighting, NoiseModel, Process, innovation_weighting
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.stages.stage import Stage
from multibody.base.parallel import parallel_map

__all__ = [
    "REGAINED",
    "StageLikelihood",
    "log_price",
    "lost_to_means",
    "noise_floor",
    "record_columns",
    "steady_reach",
    "what_may_act",
    "with_columns",
]

#: Samples × outputs of all records that a likelihood is computed of.  Where there are more, means over several samples
#: are taken: white noise stays white, and what changes slowly is known as well as from all of them.
ROWS = 6000
#: States of a linearised record from which it is asked whether fewer would do: below, the filter's time is not theirs.
MOST_STATES = 10
#: Shapes of laws by which dry friction fades or gives way.
HOW_FRICTION_FADES = ("v_s", "v_stribeck", "x_s")
#: Samples that remain of the shortest record, at least.
SHORTEST = 200
#: Memories of latent processes: so many, from two samples to a third of a record, evenly in their logarithm.
MEMORIES = 4
#: Frequencies of processes that swing: from so many cycles in a record, each twice the last, to so many samples in a
#: cycle, the fewest there are: a speed made of differences of a quantised position, and what a sampled controller does
#: with noisy measurements, change most from sample to sample.  Their memory begins with one cycle: so wide a band that
#: the next frequency overlaps it.
CYCLES, SAMPLES_OF_A_CYCLE = 3.0, 2.0
#: Least white noise of an output, over its stated noise: a stated noise may be on the safe side.
LEAST_NOISE = 0.3
#: Share of the log evidence lost without the latent processes that what stands in their place must regain: more than
#: half, else it leaves most of what they do, and the noise beside it is much as before.
REGAINED = 0.5
SHOWN = 3  # records from which it is worked out how far a force moves the outputs: an order of magnitude is enough


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedNoise:
    """The noise model that explains a residual best beside the calibration.

    Parameters
    ----------
    model : NoiseModel
    log_likelihood : float
        Restricted: every linear unknown is integrated out.
    records : tuple of LinearRecord
    change : ndarray, shape (k,)
        By which the shared parameters differ from the linearisation's at the largest likelihood.
    """

    model: NoiseModel
    log_likelihood: float
    records: tuple[LinearRecord, ...]
    change: np.ndarray

    def weighting(self) -> tuple[InnovationWeighting, ...]:
        """Return the whitening of each record."""
        return tuple(parallel_map(lambda r: innovation_weighting(r, self.model), self.records))


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
    """

    stage: Stage
    start: NoiseModel | None = None
    grow: bool = True
    given_left_out: tuple[np.ndarray, ...] | None = None
    given_noise: FittedNoise | None = None
    as_it_stands: bool = False
    _kept: dict[str, Any] = field(default_factory=dict, repr=False)
    _fitted: list[FittedNoise] = field(default_factory=list, init=False, repr=False)

    def with_richer_noise(self) -> StageLikelihood:
        """Return the same stage with a noise model that may have further latent processes."""
        return replace(self, start=self.noise.model, grow=True, given_noise=None)

    def with_likelier_noise(self, start: NoiseModel) -> StageLikelihood | None:
        """Return the same stage with its noise fitted from that of another model; None where that is no likelier."""
        records = self.noise.records
        columns, std, offset = record_columns(self.linearised, records, self.held)
        fitted = fitted_noise(self.linearised, records, columns, std, offset, start, grow=False)
        return replace(self, given_noise=fitted) if self._value(fitted) > self._value(self.noise) else None

    def _value(self, fitted: FittedNoise) -> float:
        return fitted.log_likelihood + log_price(self.linearised, fitted.model)

    def neighbour(self, stage: Stage, noise: NoiseModel | None = None) -> StageLikelihood:
        """Return the likelihood of another fit on the same samples; its noise begins with this one's, or as given."""
        start = noise or self.noise.model
        return StageLikelihood(stage=stage, start=start, grow=False, given_left_out=self.left_out)

    @property
    def linearised(self) -> LinearisedProblem:
        """The stage linearised along its identification records, not weighted."""
        if "linearised" not in self._kept:
            stage = self.stage
            fits = stage.identify.fits
            given = fits[0].experiment.preparation
            rows = sum(f.residual.size for f in fits)
            shortest = min(f.residual.shape[0] for f in fits)
            factor = max(1, min(int(np.ceil(rows / ROWS)), shortest // SHORTEST))
            problem = stage.linearised_problem(replace(given, average=given.average * factor))
            # the noise of recorded inputs is a latent process here
            quiet = tuple(replace(f, experiment=f.experiment.without_input_noise()) for f in fits)
            self._kept["linearised"] = problem.with_calibration(replace(stage.identify, fits=quiet))
        linearised: LinearisedProblem = self._kept["linearised"]
        return linearised

    def free_memory(self) -> None:
        """Drop what is as long as the records and seldom asked for again; it is computed again where it is."""
        if "linearised" in self._kept:
            self._kept["linearised"].drop_runs()

    @property
    def left_out(self) -> tuple[np.ndarray, ...]:
        """Which prepared samples of every record are no part of the likelihood, (n,) of bool each."""
        if self.given_left_out is not None:
            return self.given_left_out
        if "left_out" not in self._kept:
            self._kept["left_out"] = samples_at_standstill(self.linearised)
        return self._kept["left_out"]

    @property
    def count(self) -> int:
        """Samples of all outputs that are part of the likelihood."""
        outputs = len(self.linearised.residual().channels)
        return outputs * sum(int(np.sum(~mask)) for mask in self.left_out)

    @property
    def recorded(self) -> int:
        """Recorded samples that these are the means of."""
        given = self.linearised.preparation
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
        records = linear_records(self.linearised, self.left_out)
        columns, std, offset = record_columns(self.linearised, records, self.held)
        grow = self.grow or self.start is None
        return fitted_noise(self.linearised, records, columns, std, offset, self.start, grow=grow)

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


class Acting(NamedTuple):
    """What latent processes may be added to, in the order of a record's columns."""

    connections: list[str]
    inputs: list[str]
    states: list[str]


def what_may_act(linearised: LinearisedProblem) -> Acting:
    """Return the connections, the recorded inputs that the machine has, and the states whose rates may be disturbed.

    A machine without connections, such as one of heat and water written as equations, has no other place for what
    nobody recorded: a sensor whose reading is off does not remember, and a tank does.
    """
    recorded = [n for n in linearised.experiments[0].inputs if n in linearised.slim.input_names]
    connections = [place.name for place in linearised.system.places]
    return Acting(connections, recorded, [] if connections else _with_equations_of_their_own(linearised))


def _with_equations_of_their_own(linearised: LinearisedProblem) -> list[str]:
    """Return the states but those that are the integral of another, as a position is of a speed."""
    system, p = linearised.slim, linearised.p
    starts = [linearised.initial_state(i) for i in range(len(linearised.experiments))]
    jacobians = [system.jacobian("x", 0.0, x, None, p) for x in starts]
    names = [q.name for q in system.states]

    def is_integral(i: int) -> bool:
        j = int(np.argmax(jacobians[0][i]))
        row = np.eye(len(names))[j]
        return j != i and all(
            np.array_equal(jacobian[i], row) and system.rhs(0.0, x, None, p)[i] == x[j]
            for jacobian, x in zip(jacobians, starts, strict=True)
        )

    return [name for i, name in enumerate(names) if not is_integral(i)]


def linear_records(linearised: LinearisedProblem, left_out: Sequence[np.ndarray]) -> tuple[LinearRecord, ...]:
    """Return the machine linearised along every record, with the random forces that dry friction makes at a standstill.

    Parameters
    ----------
    linearised : LinearisedProblem
    left_out : sequence of ndarray of bool, shape (n,)
        Samples of every record that do not count.
    """
    acting = what_may_act(linearised)
    channels = [*(f"probe.{name}" for name in acting.connections), *acting.inputs]

    def of(i: int) -> LinearRecord:
        start = linearised.initial_state(i)
        return linear_record(linearised.experiments[i], linearised.slim, linearised.p, start, channels, acting.states)

    records = [r.without(mask) for r, mask in zip(parallel_map(of, range(len(left_out))), left_out, strict=True)]
    sticking = places_that_stick(linearised)
    times = [r.time for r in records]
    still = {place: standstill_at(linearised, place, times) for place in sticking}
    # one further input for every place, so that models with different frictions count their inputs alike
    places = range(len(linearised.system.places))

    def weights(i: int) -> list[np.ndarray]:
        return [still[p][i] if p in still else np.zeros(times[i].size) for p in places]

    whole = [r.with_modulated(places, weights(i)) for i, r in enumerate(records)]
    if whole[0].phi.shape[1] <= MOST_STATES:
        return tuple(whole)
    noise = noise_floor(linearised)
    return tuple(parallel_map(lambda r: with_fewer_states(r, noise), whole))


def record_columns(
    linearised: LinearisedProblem,
    records: Sequence[LinearRecord],
    without: Sequence[str] = (),
) -> tuple[list[RecordColumns], np.ndarray, np.ndarray]:
    """Return residual and sensitivities of every record, and the priors of the shared parameters.

    Parameters
    ----------
    linearised : LinearisedProblem
        Unweighted.
    records : sequence of LinearRecord
    without : sequence of str
        Parameters that stay at their values.

    Returns
    -------
    columns : list of RecordColumns
    prior_std, prior_offset : ndarray
    """
    residual, sens = linearised.residual(), linearised.sensitivities()
    moved = [k for k, n in enumerate(sens.names) if n not in without]
    spread = _spread(linearised)
    columns = []
    for i, record in enumerate(records):
        own = sens.nuisance[i]
        columns.append(
            RecordColumns(
                record=record,
                residual=residual.blocks[i],
                shared=sens.blocks[i][:, :, moved],
                own=np.zeros((*residual.blocks[i].shape, 0)) if own is None else own,
                spread=spread,
            )
        )
    return columns, sens.prior_std[moved], sens.prior_offset[moved]


def noise_floor(linearised: LinearisedProblem) -> np.ndarray:
    """Return the standard deviation of the noise of each prepared output, SI."""
    given = linearised.preparation
    count = given.average * given.decimate
    channels = linearised.residual().channels
    noise = np.array([linearised.noise.get(c, 0.0) for c in channels])
    return np.maximum(noise / np.sqrt(count), 1e-9 * _spread(linearised))


def lost_to_means(linearised: LinearisedProblem) -> np.ndarray:
    """Return the variance of white sensor noise that the means of several samples have lost, of each output, SI."""
    given = linearised.preparation
    lost: np.ndarray = noise_floor(linearised) ** 2 * (given.average * given.decimate - 1)
    return lost


def log_price(linearised: LinearisedProblem, model: NoiseModel) -> float:
    """Return what the latent processes of a noise model cost in the log evidence: zero, or negative.

    Each pays what it had to earn: for its size and memory, which are maximised over and not integrated out, and for its
    name, which is one among all that are offered, as an effect does.  The size of an error of an output has a prior
    besides, a Cauchy density whose scale is the stated noise of that output: an error that is many times as large,
    however slowly it changes, is no noise that the owner of the sensor knows of.
    """
    price = _price_of_a_process(linearised) * len(model.processes)
    for process in model.processes:
        if process.channel >= 0:
            stated = max(linearised.noise.get(process.where, 0.0), 1e-300)
            price += float(np.log1p((process.std / stated) ** 2))
    return -price


def _price_of_a_process(linearised: LinearisedProblem) -> float:
    """Return the nats by which a latent process must raise the likelihood; those at a standstill are not counted."""
    acting = what_may_act(linearised)
    octaves = _frequencies(linearised).size
    forces, outputs = len(acting.connections) + len(acting.states), len(linearised.residual().channels)
    offered = forces * (2 * MEMORIES + octaves) + outputs * (MEMORIES + octaves) + len(acting.inputs)
    return PROCESS_PRICE + float(np.log(offered))


def _spread(linearised: LinearisedProblem) -> np.ndarray:
    """Return the standard deviation of each prepared output over all records, SI."""
    return np.maximum(np.std(np.concatenate([e.measured for e in linearised.experiments]), axis=0), 1e-300)


def fitted_noise(
    linearised: LinearisedProblem,
    records: Sequence[LinearRecord],
    columns: Sequence[RecordColumns],
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    start: NoiseModel | None,
    *,
    grow: bool = True,
    reduce: bool = True,
) -> FittedNoise:
    """Return the noise model of a residual; ``start`` is that of a neighbouring model.

    ``grow`` and ``reduce`` tell whether processes may be added to it and taken out.
    """
    noise = noise_floor(linearised)
    candidates = _candidates(linearised, records, noise) if grow else []
    floor = LEAST_NOISE * noise
    price = _price_of_a_process(linearised)
    model, value = fit_noise(
        columns, prior_std, prior_offset, floor, candidates, start=start, price=price, grow=grow, reduce=reduce
    )
    change = likeliest_change(columns, model, prior_std, prior_offset)
    return FittedNoise(model=model, log_likelihood=value, records=tuple(records), change=change)


def _candidates(linearised: LinearisedProblem, records: Sequence[LinearRecord], noise: np.ndarray) -> list[Process]:
    """Return the latent processes that may be part of the noise model, each of a size that shows."""
    longest, step = _length_and_step(linearised)
    memories = np.geomspace(2.0 * step, max(longest / 3.0, 4.0 * step), MEMORIES)
    places, inputs, states = what_may_act(linearised)
    sources = [*places, *inputs, *states]
    sticking = places_that_stick(linearised)
    shows = steady_reach(records, noise)
    frequencies = _frequencies(linearised)
    candidates: list[Process] = []
    # the noise of a recorded input is white
    acting = [(j, where, memories[:1] if where in inputs else memories) for j, where in enumerate(sources)]
    acting += [(len(sources) + j, places[j], memories) for j in sticking]
    for j, where, own in acting:
        if shows[j] > 0.0:
            still = j >= len(sources)
            slow = Process(
                where=where,
                source=j,
                channel=-1,
                memory=1.0,
                std=float(1.0 / shows[j]),
                at_standstill=still,
                in_rate=where in states,
            )
            candidates += _with_spectra(slow, own, () if still else frequencies)
            if not still and where not in inputs:
                candidates += [replace(slow, memory=float(m), smooth=True) for m in own]
    for c, name in enumerate(linearised.residual().channels):
        slow = Process(where=name, source=-1, channel=c, memory=1.0, std=float(noise[c]))
        candidates += _with_spectra(slow, memories[1:], frequencies)
    return candidates


def _length_and_step(linearised: LinearisedProblem) -> tuple[float, float]:
    """Return the duration of a usual record, and the time between two of its samples, s."""
    times = [e.time for e in linearised.experiments]
    step = np.median(np.concatenate([np.diff(t) for t in times]))
    return float(np.median([t[-1] - t[0] for t in times])), float(step)


def _frequencies(linearised: LinearisedProblem) -> np.ndarray:
    """Return the frequencies of the processes that swing, Hz."""
    longest, step = _length_and_step(linearised)
    octaves = max(int(np.log2(max(longest / (SAMPLES_OF_A_CYCLE * step * CYCLES), 0.5))) + 1, 0)
    frequencies: np.ndarray = CYCLES / longest * 2.0 ** np.arange(octaves)
    return frequencies


def _with_spectra(process: Process, memories: Iterable[float], frequencies: Iterable[float]) -> list[Process]:
    """Return a process with each memory, and swinging with each frequency."""
    return [
        *(replace(process, memory=float(m)) for m in memories),
        *(replace(process, memory=float(1.0 / f), frequency=float(f)) for f in frequencies),
    ]


def steady_reach(records: Sequence[LinearRecord], noise: np.ndarray) -> np.ndarray:
    """Return how far a steady unit of each source moves the output that it moves most, in noise.

    The median over the samples that it moves at all: where dry friction lets go, a small force moves the machine
    without bound in the linearised problem, for a moment.
    """
    moves = []
    for record in records[:SHOWN]:
        moved = record.response(np.ones((record.time.size, record.gamma0.shape[2])))
        moves.append(np.abs(moved[record.counts]) / noise[:, None])
    every = np.concatenate(moves)
    every[~np.isfinite(every) | (every == 0.0)] = np.nan
    reach = np.zeros(every.shape[1:])
    shown = ~np.all(np.isnan(every), axis=0)
    reach[shown] = np.nanmedian(every[:, shown], axis=0)
    largest: np.ndarray = np.max(reach, axis=0)
    return largest


def with_columns(columns: Sequence[RecordColumns], more: Sequence[np.ndarray]) -> list[RecordColumns]:
    """Return records with further shared columns."""
    return [replace(c, shared=np.concatenate([c.shared, m], axis=2)) for c, m in zip(columns, more, strict=True)]
