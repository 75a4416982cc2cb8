"""The search for a force or an error that is some function of the machine's state, by no law of the catalogue.

It is a rival of every effect that has a name, by the same criterion: a model with it has a marginal likelihood as any
other.  The function is a Gaussian process over the signals that a force may depend on: position and speed at every
connection, the states, the measured outputs.  It acts at a connection, on a recorded input, on the rate of a state, or
on the reading of a sensor.  A disturbance from outside does not know where the machine is, and gains nothing by it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discrepancy.evidence.fitted_noise import REGAINED, fitted_noise, log_price
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import (
    lost_to_means,
    noise_floor,
    record_columns,
    steady_reach,
    what_may_act,
    with_columns,
)
from discrepancy.evidence.predictive import PredictiveGain, gain_of_scores, scores_of_blocks
from discrepancy.evidence.unknown_law import Source, StateFunction, Target, UnknownLaw
from discrepancy.innovations.noise_fit import (
    PROCESS_PRICE,
    FilteredRecord,
    RecordColumns,
    likeliest_change,
    restricted_log_likelihood,
    restricted_log_likelihoods,
)
from discrepancy.innovations.noise_model import NoiseModel

__all__ = ["at_a_second_place", "unknown_law"]

#: Directions that the Gaussian process is approximated by; where the signals move in few, fewer are needed.
DIRECTIONS = 50
#: Variance that these leave of it, as a share, below which no further one is needed.
LEFT_OVER = 1e-6
#: Sizes of the function that are tried first, in what moves an output by its noise if it lasts, and factors for the
#: best of them.  What changes faster than the machine moves may be ten thousand times as large and show no more.
SIZES, SIZE_FACTORS = (1.0, 10.0, 1e2, 1e3, 1e4), (1.0, 3.0, 1.0 / 3.0)
#: Correlation from which two signals count as one.
SAME_SIGNAL = 0.995
#: Sources that are fitted together with the noise: those that promise most.
REFITS = 2
#: Nats that a further signal must add, beside what its choice costs, before the function is said to depend on it as
#: well: as much as a model with one effect more must be better.
FURTHER_SIGNAL = 3.0
#: Functions of two signals that are screened, at most: seconds of an ordinary machine.
MOST_SCREENED = 500
#: Signals that a function may depend on: fifty directions fill no space of more dimensions.
MOST_SIGNALS = 3
#: Travel from which an angle is also a place within a turn, rad.
TURN = 2.0 * math.pi


def unknown_law(likelihood: StageLikelihood) -> UnknownLaw | None:
    """Return the most probable unknown law beside a fitted model; None where the machine has no signal that moves.

    Parameters
    ----------
    likelihood : StageLikelihood
    """
    asked = _Question(likelihood)
    if not asked.signals or not asked.sources:
        return None
    refits = asked.likeliest()
    if (hidden := asked.taken_for_slow_forces()) is not None:
        refits.append(asked.refitted(hidden, from_white=True))
    return asked.law(max(refits, key=lambda t: t.gain + t.log_odds))


def at_a_second_place(likelihood: StageLikelihood, law: UnknownLaw) -> UnknownLaw:
    """Return an unknown law that acts at a second place as well, if that is more probable; else the law as it is.

    A force constant that falls with the place changes the force, and the voltage that the motion induces.  What may be
    announced is not given up for what may not, because it changes too little.

    Parameters
    ----------
    likelihood : StageLikelihood
    law : UnknownLaw
        At one place, beside the same model.
    """
    asked = _Question(likelihood, known=law.functions, noise=law.noise)
    refits = asked.likeliest()
    if not refits:
        return law
    further = asked.law(max(refits, key=lambda t: t.gain + t.log_odds))
    return further if further.gain > law.gain and (further.announced or not law.announced) else law


@dataclass(frozen=True, eq=False, kw_only=True)
class _Screened:
    """A function at the size that gains most, and its gain in log likelihood at the noise as it is."""

    function: StateFunction
    gain: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Refit:
    """Functions with the noise fitted again, their gain over the model without any, and what they change."""

    functions: tuple[StateFunction, ...]
    gain: float
    log_odds: float
    columns: list[RecordColumns]
    priors: tuple[np.ndarray, np.ndarray]
    with_law: NoiseModel
    without: NoiseModel


@dataclass(frozen=True, eq=False)
class _Question:
    """A fitted model, its signals, and the sources at which something may act.

    Functions that are known stand beside it already, with the noise that was fitted with them.
    """

    likelihood: StageLikelihood
    known: tuple[StateFunction, ...] = ()
    noise: NoiseModel | None = None

    @property
    def columns(self) -> list[RecordColumns]:
        return self._of_records[0]

    @cached_property
    def _of_records(self) -> tuple[list[RecordColumns], np.ndarray, np.ndarray]:
        """Residual and sensitivities of the records with the functions that are known, and the priors."""
        columns, std, offset = self._without_functions
        for function in self.known:
            changed = self.changed(function.source, self.basis(function.signals))
            columns = with_columns(columns, changed)
            std, offset = _with_function(std, offset, function.size, changed[0].shape[2])
        return columns, std, offset

    @cached_property
    def _without_functions(self) -> tuple[list[RecordColumns], np.ndarray, np.ndarray]:
        return record_columns(self.likelihood.linearised, self.likelihood.noise.records, self.likelihood.held)

    @cached_property
    def noise_model(self) -> NoiseModel:
        """The noise as it is."""
        return self.noise if self.noise is not None else self.likelihood.noise.model

    @cached_property
    def log_likelihood(self) -> float:
        """Under the noise as it is."""
        if not self.known:
            return self.likelihood.noise.log_likelihood
        columns, std, offset = self._of_records
        return restricted_log_likelihood(columns, self.noise_model, std, offset)

    @cached_property
    def sources(self) -> list[Source]:
        linearised, records = self.likelihood.linearised, self.likelihood.noise.records
        noise = noise_floor(linearised)
        acting = what_may_act(linearised)
        places: list[tuple[Target, str]] = [
            *(("connection", name) for name in acting.connections),
            *(("input", name) for name in acting.inputs),
            *(("state", name) for name in acting.states),
        ]
        reach = steady_reach(records, noise)
        sources = [
            Source(where=where, acts_on=target, index=j, unit=1.0 / float(reach[j]))
            for j, (target, where) in enumerate(places)
            if reach[j] > 0.0
        ]
        outputs = linearised.residual().channels
        return [
            *sources,
            *(Source(where=n, acts_on="output", index=c, unit=float(noise[c])) for c, n in enumerate(outputs)),
        ]

    @cached_property
    def signals(self) -> dict[str, np.ndarray]:
        """What a force may depend on: each signal by name, standardised over all records, (N, 1).

        An angle that makes a turn is there a second time as the place within a turn, (N, 2): its cosine and sine.
        """
        signals: dict[str, np.ndarray] = {}
        for name, whole in self._recorded().items():
            spread = float(np.std(whole))
            if not spread > 1e-9 * float(np.max(np.abs(whole))):
                continue
            forms = {name: ((whole - np.mean(whole)) / spread)[:, None]}
            if name in self._angles and np.ptp(whole) >= TURN:
                forms[f"{name} within a turn"] = np.sqrt(2.0) * np.column_stack([np.cos(whole), np.sin(whole)])
            known = list(signals.values())
            signals |= {n: v for n, v in forms.items() if not any(_is_same(v, other) for other in known)}
        return signals

    @cached_property
    def _angles(self) -> set[str]:
        """Names of the signals that are angles."""
        system = self.likelihood.linearised.system
        states = {q.name for q in system.states if q.unit == "rad"}
        return states | {f"place.{p.name}.angle" for p in system.places}

    def _recorded(self) -> dict[str, np.ndarray]:
        """Return the motions of connections, states, measured outputs and recorded inputs at all samples, (N,)."""
        linearised, records = self.likelihood.linearised, self.likelihood.noise.records
        runs = []
        for i, experiment in enumerate(linearised.experiments[: len(records)]):
            recorded = {n: np.asarray(experiment.record.signals[n].values) for n in experiment.inputs}
            runs.append({**linearised.nominal_outputs(i), **recorded})
        states = {q.name for q in linearised.system.states}
        outputs, inputs = linearised.experiments[0].outputs, linearised.experiments[0].inputs

        def is_cause(name: str) -> bool:
            motion = name.startswith("place.") and name.rsplit(".", 1)[-1] != "acceleration"
            return motion or name in states or name in outputs or name in inputs

        return {
            name: np.concatenate(
                [
                    np.interp(r.time, np.asarray(linearised.experiments[i].record.time), runs[i][name])
                    for i, r in enumerate(records)
                ]
            )
            for name in runs[0]
            if is_cause(name)
        }

    def basis(self, chosen: Sequence[str]) -> list[np.ndarray]:
        """Return the directions of a Gaussian process over some signals, (N, m) for each record."""
        ends = np.cumsum([r.time.size for r in self.likelihood.noise.records])[:-1]
        return np.split(_incomplete_cholesky(np.column_stack([self.signals[n] for n in chosen])), ends)

    def changed(self, source: Source, basis: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return what each direction of the function changes in the records, (n, n_c, m) each."""
        more = []
        for column, values in zip(self._without_functions[0], basis, strict=True):
            record, m = column.record, values.shape[1]
            if source.acts_on == "output":
                changed = np.zeros((record.time.size, record.c.shape[1], m))
                changed[:, source.index] = values
            else:
                changed = record.response(values, np.full(m, source.index))
            more.append(source.unit * changed[record.observed])
        return more

    def priors(self, size: float, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the priors of all shared unknowns and of a further function of some size."""
        _, std, offset = self._of_records
        return _with_function(std, offset, size, count)

    @cached_property
    def filtered(self) -> list[FilteredRecord]:
        """The records under the noise as it is."""
        return [c.filtered(self.noise_model) for c in self.columns]

    def screened(
        self, sources: Sequence[Source], chosen: tuple[str, ...], filtered: Sequence[FilteredRecord] | None = None
    ) -> list[_Screened]:
        """Return at each source the gain of a function of some signals at the size that gains most.

        Under the noise as it is, or as the records were filtered.
        """
        reference, basis = self.log_likelihood, self.basis(chosen)
        priors = [self.priors(z, basis[0].shape[1]) for z in SIZES]
        found = []
        for source in sources:
            pairs = zip(filtered or self.filtered, self.changed(source, basis), strict=True)
            values = restricted_log_likelihoods([record.with_columns(more) for record, more in pairs], priors)
            best, size = max(zip(values, SIZES, strict=True))
            function = StateFunction(source=source, signals=chosen, size=size)
            found.append(_Screened(function=function, gain=best - reference))
        return found

    def taken_for_slow_forces(self) -> _Screened | None:
        """Return the function of one signal that does best what random forces slower than the records do, if it does.

        What is missing is first taken for noise, and the noise then hides it.
        """
        noise = self.likelihood.noise
        faster = tuple(q for q in noise.model.processes if not q.outlasts(self.likelihood.duration))
        if len(faster) == len(noise.model.processes):
            return None
        without = replace(noise.model, processes=faster)
        _, std, offset = self._of_records
        lost = noise.log_likelihood - restricted_log_likelihood(self.columns, without, std, offset)
        if not math.isfinite(lost):
            return None
        filtered = [c.filtered(without) for c in self.columns]
        best = max((t for n in self.signals for t in self.screened(self.sources, (n,), filtered)), key=lambda t: t.gain)
        return best if best.gain > -(1.0 - REGAINED) * lost else None

    def likeliest(self) -> list[_Refit]:
        """Return the functions at the sources that promise most, with the noise fitted again."""
        screened = sorted(self.likeliest_of_sources(), key=lambda t: -t.gain - self.log_odds(t.function))[:REFITS]
        return [self.refitted(self.extended(each)) for each in screened]

    def likeliest_of_sources(self) -> list[_Screened]:
        """Return the best function of one or two signals at each source, the choice counted.

        A force that is the product of two signals, such as a stiffness that varies over a turn, does not show in a
        function of either.  Two are asked for at the sources that promise most by one, as far as `MOST_SCREENED` goes.
        """
        free = [s for s in self.sources if s not in {f.source for f in self.known}]
        asked: dict[Source, list[_Screened]] = {s: [] for s in free}
        for name in self.signals:
            for found in self.screened(free, (name,)):
                asked[found.function.source].append(found)
        order = sorted(free, key=lambda s: -max(t.gain for t in asked[s]))
        pairs = list(itertools.combinations(self.signals, 2))
        room = MOST_SCREENED // max(len(pairs), 1)
        for pair in pairs if room else []:
            for found in self.screened(order[:room], pair):
                asked[found.function.source].append(found)
        return [max(asked[s], key=lambda t: t.gain + self.log_odds(t.function)) for s in order]

    def extended(self, best: _Screened) -> _Screened:
        """Let a function depend on further signals, each the one that adds most, while it adds what it costs."""
        while len(signals := best.function.signals) < min(MOST_SIGNALS, len(self.signals)):
            rest = [n for n in self.signals if n not in signals]
            every = (t for n in rest for t in self.screened([best.function.source], (*signals, n)))
            further = max(every, key=lambda t: t.gain)
            if further.gain < best.gain + FURTHER_SIGNAL + math.log(len(rest)):
                break
            best = further
        return best

    def log_odds(self, function: StateFunction) -> float:
        """Return the prior odds of a function: those of one effect more, spread over sources and choices of signals."""
        choices = math.comb(len(self.signals), len(function.signals))
        return -math.log(2.0 * len(self.sources) * choices)

    def refitted(self, chosen: _Screened, *, from_white: bool = False) -> _Refit:
        """Return a function with the noise fitted again; without any that is fitted from the same start.

        With the function it can be fitted from white noise instead.
        """
        linearised, fitted, function = self.likelihood.linearised, self.likelihood.noise, chosen.function
        basis = self.basis(function.signals)
        columns, count = with_columns(self.columns, self.changed(function.source, basis)), basis[0].shape[1]
        trials = []
        for z in (function.size * factor for factor in SIZE_FACTORS):
            start = None if from_white else self.noise_model
            own = fitted_noise(linearised, fitted.records, columns, *self.priors(z, count), start, grow=from_white)
            trials.append((own.log_likelihood + log_price(linearised, own.model), z, own.model))
        value, z, model = max(trials, key=lambda t: t[0])
        plain = fitted_noise(linearised, fitted.records, *self._without_functions, model, grow=False)
        starts = [(q.log_likelihood + log_price(linearised, q.model), q.model) for q in (plain, fitted)]
        without, model_without = max(starts, key=lambda t: t[0])
        functions = (*self.known, replace(function, size=z))
        return _Refit(
            functions=functions,
            gain=value - without,
            log_odds=sum(self.log_odds(f) for f in functions),
            columns=columns,
            priors=self.priors(z, count),
            with_law=model,
            without=model_without,
        )

    def law(self, best: _Refit) -> UnknownLaw:
        """Return what is said of functions that were fitted: of their size each pays for the process that it is."""
        share, predictive = self.consequences(best)
        return UnknownLaw(
            functions=best.functions,
            gain=best.gain - PROCESS_PRICE * len(best.functions) + best.log_odds,
            log_odds=best.log_odds,
            share=share,
            samples=self.likelihood.recorded,
            predictive=predictive,
            noise=best.with_law,
        )

    def consequences(self, best: _Refit) -> tuple[dict[str, float], PredictiveGain]:
        """Return the share of every output's error that the functions change, and the gain on blocks left out."""
        plain_columns, std, offset = self._without_functions
        change = likeliest_change(best.columns, best.with_law, *best.priors)
        plain = likeliest_change(plain_columns, best.without, std, offset)
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
        linearised = self.likelihood.linearised
        error = np.mean(np.concatenate(errors) ** 2, axis=0) + lost_to_means(linearised)
        shares = np.mean(np.concatenate(moved) ** 2, axis=0) / np.maximum(error, 1e-300)
        outputs = linearised.residual().channels
        with_law = scores_of_blocks(best.columns, best.with_law, *best.priors)
        without = scores_of_blocks(plain_columns, best.without, std, offset)
        return dict(zip(outputs, shares.tolist(), strict=True)), gain_of_scores(with_law, without)


def _with_function(std: np.ndarray, offset: np.ndarray, size: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return priors with those of the directions of a further function."""
    return np.concatenate([std, np.full(count, size)]), np.concatenate([offset, np.zeros(count)])


def _is_same(a: np.ndarray, b: np.ndarray) -> bool:
    """Tell whether two signals, (N, 1) or (N, 2), are one, whatever its sign."""
    return a.shape == b.shape and all(
        abs(float(x @ y)) > SAME_SIGNAL * math.sqrt(float(x @ x) * float(y @ y)) for x, y in zip(a.T, b.T, strict=True)
    )


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
