"""A force or an error that is some function of the machine's state, by no law of the catalogue.

It is a rival of every effect that has a name, by the same criterion: a model with it has a marginal likelihood as any
other.  The function is a Gaussian process over the signals that a force may depend on: position and speed at every
connection, the states, the measured outputs.  It acts at a connection, on a recorded input, or on the reading of a
sensor.  A disturbance from outside does not know where the machine is, and gains nothing by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from discrepancy.evidence.likelihood import (
    StageLikelihood,
    acting_inputs,
    fitted_noise,
    log_price,
    noise_floor,
    record_columns,
    steady_reach,
    with_columns,
)
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.predictive import PredictiveGain, gain_of_scores, scores_of_blocks
from discrepancy.innovations.noise_fit import PROCESS_PRICE, RecordColumns, likeliest_change, restricted_log_likelihood
from discrepancy.innovations.noise_model import NoiseModel
from multibody.solvers.kernels.perturbations import propagate

__all__ = ["UNKNOWN", "UnknownLaw", "unknown_law"]

UNKNOWN = "unknown_force"  # the kind of what is found without a law
#: Directions that the Gaussian process is approximated by; where the signals move in few, fewer are needed.
DIRECTIONS = 50
#: Variance that these leave of it, as a share, below which no further one is needed.
LEFT_OVER = 1e-6
#: Sizes of the function that are tried first, in what moves an output by its noise; and factors for the best of them.
SIZES, SIZE_FACTORS = (1.0, 10.0, 100.0), (1.0, 3.0, 1.0 / 3.0)
#: Correlation from which two signals count as one.
SAME_SIGNAL = 0.995
#: Sources that are fitted together with the noise: those that promise most.
REFITS = 2
#: Nats that a further signal must add before the function is said to depend on it as well: as much as a model with one
#: effect more must be better.
FURTHER_SIGNAL = 3.0


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownLaw:
    """What is known of a force or error that follows the machine's state by an unknown law.

    Parameters
    ----------
    where : str
        Connection, input or output.
    acts_on : {"connection", "input", "output"}
    depends_on : tuple of str
        The signals that it follows, the first of them most.
    gain : float, nats
        By which the log evidence rises: the size of the function, which is maximised over, has paid as a latent process
        does, and the prior odds are those of one effect more, all sources being equally probable.
    log_odds : float
        What of that is prior odds.
    share : mapping of str to float
        Of the mean square error of every output, what the function changes.
    samples : int
        Of all outputs, in the likelihood.
    predictive : PredictiveGain
        By how much blocks of the records that were left out are predicted better with it.
    """

    where: str
    acts_on: Literal["connection", "input", "output"]
    depends_on: tuple[str, ...]
    gain: float
    log_odds: float
    share: dict[str, float]
    samples: int
    predictive: PredictiveGain

    @property
    def name(self) -> str:
        """``unknown_force@where``, as other effects are named."""
        return f"{UNKNOWN}@{self.where}"

    @property
    def matters(self) -> bool:
        """Whether it changes some output, or the prediction of all, by a share of the error that one could see."""
        of_prediction = 2.0 * (self.gain - self.log_odds) / max(self.samples, 1)
        return max(*self.share.values(), of_prediction) >= POLICY.unnamed_relevance

    @property
    def predicts(self) -> bool:
        """Whether it matters, and records that were left out are predicted better with it."""
        return self.matters and self.predictive.exceeds(POLICY.predictive_errors)

    @property
    def announced(self) -> bool:
        """Whether it passes what every effect that is announced must pass."""
        odds = (self.gain - self.log_odds) / POLICY.temperature + self.log_odds
        return self.predicts and odds > 0.0

    @property
    def sentence(self) -> str:
        """What it says."""
        what = {
            "connection": f"a force at {self.where}",
            "input": f"an addition to the recorded input {self.where}",
            "output": f"an error of the measured output {self.where}",
        }[self.acts_on]
        signals = [_in_words(name) for name in self.depends_on]
        follows = " and ".join([", ".join(signals[:-1]), signals[-1]] if len(signals) > 1 else signals)
        output, share = max(self.share.items(), key=lambda t: t[1])
        accounts = f"{100.0 * min(share, 1.0):.0f} % of the mean square error of {output}"
        gain = f"{self.predictive.gain:.0f} ± {self.predictive.standard_error:.0f} nats"
        return (
            "Something follows the machine's state by no law of the catalogue. It is best described as "
            f"{what} that is a function of {follows}, and accounts for {accounts} (log evidence {self.gain:+.0f}; "
            f"blocks of the records that were left out are predicted better by {gain})."
        )

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {
            "where": self.where,
            "acts_on": self.acts_on,
            "depends_on": list(self.depends_on),
            "log_evidence": self.gain,
            "share": dict(self.share),
            "predictive_gain": self.predictive.to_dict(),
            "announced": self.announced,
        }


def _in_words(signal: str) -> str:
    """Return a signal in words.

    Examples
    --------
    >>> _in_words("place.bearing.speed")
    'the speed of bearing'
    >>> _in_words("tank.water")
    'tank.water'
    """
    parts = signal.split(".")
    return f"the {parts[-1]} of {'.'.join(parts[1:-1])}" if parts[0] == "place" and len(parts) > 2 else signal


@dataclass(frozen=True, eq=False, kw_only=True)
class _Source:
    """Where the function may act, and what a unit of it changes: a function of its value at every sample, (N, m)."""

    where: str
    acts_on: Literal["connection", "input", "output"]
    index: int
    unit: float


def unknown_law(likelihood: StageLikelihood) -> UnknownLaw | None:
    """Return the most probable unknown law beside a fitted model; None where the machine has no signal that moves.

    Parameters
    ----------
    likelihood : StageLikelihood
    """
    asked = _Question(likelihood)
    if not asked.signals or not asked.sources:
        return None
    basis = asked.basis(range(len(asked.signals)))
    screened = sorted(((*asked.screened(s, basis), s) for s in asked.sources), key=lambda t: -t[0])
    best = max((asked.refitted(source, size, basis) for _, size, source in screened[:REFITS]), key=lambda t: t.gain)
    share, predictive = asked.consequences(best)
    log_odds = -math.log(2.0 * len(asked.sources))
    return UnknownLaw(
        where=best.source.where,
        acts_on=best.source.acts_on,
        depends_on=asked.dependence(best.source),
        gain=best.gain - PROCESS_PRICE + log_odds,
        log_odds=log_odds,
        share=share,
        samples=likelihood.count,
        predictive=predictive,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Refit:
    source: _Source
    size: float
    gain: float
    columns: list[RecordColumns]
    with_law: NoiseModel
    without: NoiseModel


@dataclass(frozen=True, eq=False)
class _Question:
    """A fitted model, its signals, and the sources at which something may act."""

    likelihood: StageLikelihood

    @cached_property
    def columns(self) -> list[RecordColumns]:
        return self._of_records[0]

    @cached_property
    def _of_records(self) -> tuple[list[RecordColumns], np.ndarray, np.ndarray]:
        return record_columns(self.likelihood.linearised, self.likelihood.noise.records, self.likelihood.held)

    @cached_property
    def sources(self) -> list[_Source]:
        linearised, records = self.likelihood.linearised, self.likelihood.noise.records
        noise = noise_floor(linearised)
        names, inputs = acting_inputs(linearised)
        reach = steady_reach(records, noise)
        sources = [
            _Source(where=name, acts_on="connection" if j < len(names) else "input", index=j, unit=1.0 / reach[j])
            for j, name in enumerate((*names, *inputs))
            if reach[j] > 0.0
        ]
        outputs = linearised.residual().channels
        return [
            *sources,
            *(_Source(where=n, acts_on="output", index=c, unit=noise[c]) for c, n in enumerate(outputs)),
        ]

    @cached_property
    def signals(self) -> dict[str, list[np.ndarray]]:
        """What a force may depend on: each signal by name, standardised over all records, (N,) for each record."""
        linearised, records = self.likelihood.linearised, self.likelihood.noise.records
        runs = [linearised.nominal_outputs(i) for i in range(len(records))]
        names = [n for n in runs[0] if self._is_cause(n)]
        signals: dict[str, list[np.ndarray]] = {}
        seen: list[np.ndarray] = []
        ends = np.cumsum([r.time.size for r in records])[:-1]
        for name in names:
            whole = np.concatenate(
                [
                    np.interp(r.time, np.asarray(linearised.experiments[i].record.time), runs[i][name])
                    for i, r in enumerate(records)
                ]
            )
            spread = float(np.std(whole))
            if not spread > 1e-9 * float(np.max(np.abs(whole))):
                continue
            whole = (whole - np.mean(whole)) / spread
            if any(abs(float(whole @ other)) > SAME_SIGNAL * whole.size for other in seen):
                continue
            seen.append(whole)
            signals[name] = np.split(whole, ends)
        return signals

    def _is_cause(self, name: str) -> bool:
        """Tell whether a force may depend on a signal: a state, a motion of a connection, or a measured output."""
        linearised = self.likelihood.linearised
        motion = name.startswith("place.") and name.rsplit(".", 1)[-1] != "acceleration"
        return motion or name in linearised.system.states or name in linearised.experiments[0].outputs

    def basis(self, chosen: Sequence[int]) -> list[np.ndarray]:
        """Return the directions of a Gaussian process over some signals, (N, m) for each record."""
        every = list(self.signals.values())
        points = np.column_stack([np.concatenate(every[k]) for k in chosen])
        ends = np.cumsum([r.time.size for r in self.likelihood.noise.records])[:-1]
        return np.split(_incomplete_cholesky(points), ends)

    def with_function(self, source: _Source, basis: Sequence[np.ndarray]) -> list[RecordColumns]:
        """Return the records with what each direction of the function changes as further shared columns."""
        more = []
        for column, values in zip(self.columns, basis, strict=True):
            record, m = column.record, values.shape[1]
            changed = np.zeros((record.time.size, record.c.shape[1], m))
            if source.acts_on == "output":
                changed[:, source.index] = values
            else:
                room = np.zeros((2, record.phi.shape[1], m))
                where = np.full(m, source.index)
                matrices = (record.phi, record.gamma0, record.gamma1, record.c, record.d)
                propagate(*matrices, where, np.ascontiguousarray(values), room, changed)
            more.append(source.unit * changed[record.observed])
        return with_columns(self.columns, more)

    def priors(self, size: float, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the priors of the shared parameters and of a function of some size."""
        _, std, offset = self._of_records
        return np.concatenate([std, np.full(count, size)]), np.concatenate([offset, np.zeros(count)])

    def screened(self, source: _Source, basis: Sequence[np.ndarray]) -> tuple[float, float]:
        """Return the gain in log likelihood at the noise of the model as it is, and the size that gains most."""
        fitted, columns = self.likelihood.noise, self.with_function(source, basis)
        count = basis[0].shape[1]
        trials = ((restricted_log_likelihood(columns, fitted.model, *self.priors(z, count)), z) for z in SIZES)
        best, size = max(trials)
        return best - fitted.log_likelihood, size

    def refitted(self, source: _Source, size: float, basis: Sequence[np.ndarray]) -> _Refit:
        """Return the gain where the noise is fitted again, with the function and without, from the same start."""
        linearised, fitted = self.likelihood.linearised, self.likelihood.noise
        columns, count = self.with_function(source, basis), basis[0].shape[1]
        trials = []
        for z in (size * factor for factor in SIZE_FACTORS):
            own = fitted_noise(linearised, fitted.records, columns, *self.priors(z, count), fitted.model, grow=False)
            trials.append((own.log_likelihood + log_price(linearised, own.model), z, own.model))
        value, z, model = max(trials, key=lambda t: t[0])
        plain = fitted_noise(linearised, fitted.records, *self._of_records, model, grow=False)
        starts = [(q.log_likelihood + log_price(linearised, q.model), q.model) for q in (plain, fitted)]
        without, model_without = max(starts, key=lambda t: t[0])
        return _Refit(
            source=source, size=z, gain=value - without, columns=columns, with_law=model, without=model_without
        )

    def consequences(self, best: _Refit) -> tuple[dict[str, float], PredictiveGain]:
        """Return the share of every output's error that the function changes, and the gain on blocks left out."""
        _, std, offset = self._of_records
        count = best.columns[0].shared.shape[2] - std.size
        priors = self.priors(best.size, count)
        change = likeliest_change(best.columns, best.with_law, *priors)
        plain = likeliest_change(self.columns, best.without, std, offset)
        change[: std.size] -= plain
        errors, moved = [], []
        for column in best.columns:
            used, outputs = column.record.used, column.residual.shape[1]
            left = column.residual - column.shared[:, :, : std.size] @ plain
            both = np.stack([left, column.shared @ change], axis=2)[used].reshape(-1, 2)
            if column.own.shape[2]:  # each record's own unknowns are fitted to it in either model
                own, _ = np.linalg.qr((column.own[used] / column.spread[:, None]).reshape(len(both), -1))
                weight = np.tile(1.0 / column.spread, len(both) // outputs)[:, None]
                both = (both * weight - own @ (own.T @ (both * weight))) / weight
            errors.append(both[:, 0].reshape(-1, outputs))
            moved.append(both[:, 1].reshape(-1, outputs))
        shares = np.mean(np.concatenate(moved) ** 2, axis=0)
        shares = shares / np.maximum(np.mean(np.concatenate(errors) ** 2, axis=0), 1e-300)
        outputs = self.likelihood.linearised.residual().channels
        with_law = scores_of_blocks(best.columns, best.with_law, *priors)
        without = scores_of_blocks(self.columns, best.without, std, offset)
        return dict(zip(outputs, shares.tolist(), strict=True)), gain_of_scores(with_law, without)

    def dependence(self, source: _Source) -> tuple[str, ...]:
        """Return the signals that the function follows, each the one that adds most to those before it."""
        names = list(self.signals)
        chosen: list[int] = []
        reached = 0.0
        while len(chosen) < len(names):
            rest = [k for k in range(len(names)) if k not in chosen]
            gain, best = max((self.screened(source, self.basis([*chosen, k]))[0], k) for k in rest)
            if chosen and gain < reached + FURTHER_SIGNAL:
                break
            chosen.append(best)
            reached = gain
        return tuple(names[k] for k in chosen)


def _incomplete_cholesky(points: np.ndarray) -> np.ndarray:
    """Return a root, (n, m), of the covariance exp(−|x − y|²/2d) of a Gaussian process at some points, (n, d).

    Pivoted: each direction is the process's value at the point that the others know least of.  The memory of the
    process in each direction of space is one standard deviation of the signals, √d of them together.
    """
    n, d = points.shape
    left = np.ones(n)
    root = np.zeros((n, DIRECTIONS))
    for k in range(DIRECTIONS):
        pivot = int(np.argmax(left))
        if left[pivot] < LEFT_OVER:
            return root[:, :k]
        covariance = np.exp(-0.5 * np.sum((points - points[pivot]) ** 2, axis=1) / d)
        root[:, k] = (covariance - root[:, :k] @ root[pivot, :k]) / np.sqrt(left[pivot])
        left = np.maximum(left - root[:, k] ** 2, 0.0)
    return root
