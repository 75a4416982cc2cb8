"""The next measurement: which trip would distinguish two explanations that these records do not.

Both explanations are fitted models.  A candidate trip is simulated with both.  Its separation is the part of their
difference that a recalibration of the alternative on that trip could not remove,

    D = ‖(I − P_[F, Z_h]) d‖²,   d = ŷ_g − ŷ_h,

with F the sensitivities of the uncertain parameters, priors included, Z_h those of the alternative's strengths and
shapes, and each output in units of its residual times the square root of the residual's correlation time in samples.
For small effects d is Z_g times the expected amplitude.  If the first is true, the difference of twice the
log-likelihood is normal with mean D and variance 4D; the chance that the trip decides follows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.effects.kinds import kind_named
from discrepancy.questions.trip_plan import TripPlan
from discrepancy.questions.trip_proposals import NextMeasurement, Proposal, chance, repeats_needed
from discrepancy.search.state import SearchState
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment

__all__ = ["TRIPS", "compare_trips", "next_measurements"]

#: Trips that are tried.
TRIPS = tuple(
    TripPlan.parse(text)
    for text in (
        "",
        "speed=0.5",
        "speed=0.25",
        "speed=1.5",
        "amplitude=0.5",
        "amplitude=1.5",
        "mirror",
        "stops=3",
        "speed=0.5,stops=3",
        "amplitude=1.5,mirror",
        "load=1.5",
    )
)
#: Units of quantities for which there are sensors.
SENSED = ("N", "N*m", "m", "rad", "m/s", "rad/s", "m/s**2", "rad/s**2", "V", "A")
#: Rivals of one effect, and added sensors, that are examined.
MOST_RIVALS, MOST_SENSORS = 2, 2


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two fitted models, and the record from which trips are made."""

    a: Stage
    b: Stage
    index: int
    outputs: tuple[str, ...]

    @property
    def measured(self) -> tuple[str, ...]:
        return self.a.outputs

    def _experiment(self, stage: Stage, trip: TripPlan) -> Experiment:
        from estimation.files.record import Record, RecordedSignal

        fit = stage.identify.fits[self.index]
        given = fit.experiment
        inputs = {n: np.asarray(given.record.signals[n].values) for n in given.inputs}
        time, changed = trip.apply(np.asarray(given.record.time), inputs)
        signals = {
            n: RecordedSignal(values=u, unit=given.record.signals[n].unit, column=n, measured_unit="")
            for n, u in changed.items()
        }
        record = Record(name=f"{given.record.name} {trip.words}", path=given.record.path, time=time, signals=signals)
        start = {n: float(x) for n, x in zip(stage.system.state_names, self._start(stage), strict=True)}
        return replace(given, record=record, outputs=self.outputs, offsets=(), start=start, input_noise={})

    def _start(self, stage: Stage) -> np.ndarray:
        fit = stage.identify.fits[self.index]
        x = fit.experiment.start_vector(stage.system)
        for name in fit.experiment.free:
            x[stage.system.index("state", name)] = fit.own[name]
        return x

    def _loaded(self, stage: Stage, trip: TripPlan) -> np.ndarray | None:
        if trip.load == 1.0:
            return stage.p
        name = load_of(stage)
        if not name:
            return None
        p = stage.p.copy()
        p[stage.system.index("parameter", name)] *= trip.load
        return p

    def run(self, trip: TripPlan) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
        """Return difference (n, c), derivatives of the alternative (n, c, m), prior deviations (m,), and duration."""
        p_a, p_b = self._loaded(self.a, trip), self._loaded(self.b, trip)
        if p_a is None or p_b is None:
            return None
        one, two = self._experiment(self.a, trip), self._experiment(self.b, trip)
        y = one.respond(self.a.system, p_a, self._start(self.a), sensors=self.a.sensors).outputs
        moved = [q for q in self.b.identify.parameters if q.name not in self.b.identify.not_excited]
        free = [n for n in two.free if n in self.b.system.state_names]
        other = two.respond(
            self.b.system,
            p_b,
            self._start(self.b),
            parameters=[q.name for q in moved],
            states=free,
            sensors=self.b.sensors,
        )
        std = np.array([*(q.std for q in moved), *([np.inf] * len(free))])
        time = two.record.time
        return y - other.outputs, other.derivatives, std, float(time[-1] - time[0])

    def separation(self, d: np.ndarray, F: np.ndarray, std: np.ndarray, scale: np.ndarray) -> float:
        """Return ‖(I − P) d‖² with priors, outputs in units of ``scale``; infinite scale leaves an output out."""
        use = np.isfinite(scale)
        e = (d[:, use] / scale[use]).reshape(-1)
        X = (F[:, use] / scale[use, None]).reshape(e.size, -1)
        given = np.isfinite(std)
        prior = np.diag(np.where(given, 1.0 / np.where(given, std, 1.0), 0.0))[given]
        X = np.concatenate([X, prior])
        size = np.linalg.norm(X, axis=0)
        X = X[:, size > 0] / size[size > 0]
        y = np.concatenate([e, np.zeros(len(prior))])
        u, s, _ = np.linalg.svd(X, full_matrices=False)
        u = u[:, s > 1e-9 * s[0]] if s.size else u
        left = y - u @ (u.T @ y)
        return float(left @ left)


def load_of(stage: Stage) -> str:
    """Return the parameter that a load changes: the largest mass that is uncertain, else the largest of all."""
    unit = {q.name: q.unit for q in stage.system.parameters}
    known = [n for n in unit if unit[n] == "kg"]
    uncertain = [q.name for q in stage.identify.parameters if unit.get(q.name) == "kg"]
    of = uncertain or known
    return max(of, key=lambda n: abs(stage.p[stage.system.index("parameter", n)])) if of else ""


def _scales(stage: Stage, outputs: Sequence[str], runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the scale of each output as it is measured (infinite: not measured), and as it would be.

    A measured output counts with the RMS of its residual, times the square root of its correlation time in samples.
    One that is not measured is taken to be as good, relative to how much it changes, as the worst of those measured.
    """
    now = np.full(len(outputs), np.inf)
    relative = []
    for c, name in enumerate(stage.outputs):
        parts = [f.residual[:, c] for f in stage.identify.fits]
        rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        correlation = float(np.mean([correlation_time(p) for p in parts]))
        k = list(outputs).index(name)
        now[k] = max(rms, stage.noise.get(name, 0.0), 1e-300) * np.sqrt(correlation)
        relative.append(now[k] / max(float(np.std(runs[:, k])), 1e-300))
    added = np.maximum(max(relative) * np.std(runs, axis=0), 1e-300)
    return now, np.where(np.isfinite(now), now, added)


def compare_trips(
    a: Stage, b: Stage, trips: Sequence[TripPlan] = TRIPS, *, progress: Callable[[str], None] = lambda text: None
) -> tuple[str, tuple[Proposal, ...]]:
    """Simulate trips with two fitted models; return the record that they are made from, and the trips by separation.

    Parameters
    ----------
    a, b : Stage
        The explanation taken as true, and its alternative.
    trips : sequence of TripPlan
        The recorded trip is also tried with added sensors.
    progress : callable
    """
    shared = [n for n in a.system.output_names if n in set(b.system.output_names)]
    own = {e.component_name for s in (a, b) for e in s.effects}
    hidden = ("place.", *(f"{o}." for o in own))  # not outputs of the model as its author built it
    shared = [n for n in shared if n in a.outputs or not n.startswith(hidden)]
    spans = [float(np.ptp(f.experiment.record.signals[n].values)) for f in a.identify.fits for n in f.experiment.inputs]
    per = len(a.identify.fits[0].experiment.inputs)
    index = int(np.argmax([sum(spans[i : i + per]) for i in range(0, len(spans), per)])) if per else 0
    pair = _Pair(a, b, index, tuple(shared))
    proposals: list[Proposal] = []
    for trip in dict.fromkeys([TripPlan(), *trips]):
        progress(f"simulate a trip {trip.words} with both explanations")
        try:
            run = pair.run(trip)
        except RuntimeError as error:  # a trip that cannot be simulated is not proposed
            progress(f"a trip {trip.words} could not be simulated: {error}")
            continue
        if run is None:
            continue
        d, F, std, duration = run
        if trip == TripPlan():
            level = pair._experiment(a, trip).simulate(a.system, a.p, pair._start(a), a.sensors)
            now, added = _scales(a, shared, level)
            proposals += _with_sensors(pair, run, now, added)
        proposals.append(_proposal(trip, pair.separation(d, F, std, now), duration))
    proposals.sort(key=lambda p: -p.separation)
    return a.identify.fits[index].experiment.name, tuple(proposals)


def _proposal(trip: TripPlan, separation: float, duration: float) -> Proposal:
    return Proposal(
        trip=trip,
        separation=separation,
        power=chance(separation),
        repeats=repeats_needed(separation),
        duration=duration,
    )


def _with_sensors(
    pair: _Pair, run: tuple[np.ndarray, np.ndarray, np.ndarray, float], now: np.ndarray, added: np.ndarray
) -> list[Proposal]:
    """Return the recorded trip with one more output measured, for the outputs with the largest separation."""
    d, F, std, duration = run
    proposals = []
    for k, name in enumerate(pair.outputs):
        if np.isfinite(now[k]) or pair.a.system.unit(name) not in SENSED or not np.any(d[:, k]):
            continue
        scale = now.copy()
        scale[k] = added[k]
        proposals.append(_proposal(TripPlan(sensor=name), pair.separation(d, F, std, scale), duration))
    proposals.sort(key=lambda p: -p.separation)
    return proposals[:MOST_SENSORS]


# -------------------------------------------------------------------- of a search


def next_measurements(state: SearchState) -> tuple[NextMeasurement, ...]:
    """Return what to measure, for each explanation that the records do not distinguish from its rivals.

    The alternative is fitted in full in place of the accepted effect.  Trips are proposed where the machine is
    simulated over whole records.
    """
    measurements = []
    for accepted in (s.accepted for s in state.stages if s.accepted is not None):
        tied = [r for r in accepted.rivals if r.indistinguishable and " " not in r.kind]
        measurements += [_against(state, accepted, other) for other in tied[:MOST_RIVALS]]
    return tuple(measurements)


def _against(state: SearchState, accepted: AcceptedEffect, rival: RivalExplanation) -> NextMeasurement:
    best = accepted.effect
    measurement = NextMeasurement(
        best=str(best),
        rival=f"{rival.kind}@{rival.where}",
        titles=(
            f"{best.definition.text.title} at {best.where}",
            f"{kind_named(rival.kind).text.title} at {rival.where}",
        ),
    )
    if state.mode != "simulation":
        confirm = best.definition.text.confirm.rstrip(".")
        return replace(measurement, why_not=f"{confirm} (trips are compared by simulation only)")
    last = state.stages[-1]
    kept = tuple(e for e in last.effects if e.component_name != best.component_name or e.kind != best.kind)
    if len(kept) == len(last.effects):
        return replace(measurement, why_not="the first is not in the model any more")
    effect = _effect_of(state, accepted, rival)
    if effect is None:
        return replace(measurement, why_not=kind_named(rival.kind).text.confirm.rstrip("."))
    state.progress(f"which trip would distinguish {best} from {effect}")
    try:
        other = state.fitted(last.name, (*kept, effect), last, last.noise, trial=True)
        record, proposals = compare_trips(last, other, progress=state.progress)
    except RuntimeError as error:
        return replace(measurement, why_not=f"the second could not be simulated: {error}")
    return replace(measurement, record=record, proposals=proposals)


def _effect_of(state: SearchState, accepted: AcceptedEffect, rival: RivalExplanation) -> Effect | None:
    """Return a rival as an effect with the strength that the scan expects of it."""
    name = f"{rival.kind}@{rival.where}"
    stage = state.stages[-1]
    experiment = stage.identify.fits[0].experiment
    entry = next((e for e in catalogue(stage.system, experiment.outputs, experiment.inputs) if e.name == name), None)
    decision = next(
        (
            d
            for d in state.decisions
            if str(accepted.effect) in [str(a.effect) for a in d.added] and any(r.name == name for r in d.scan.rows)
        ),
        None,
    )
    if entry is None or decision is None:
        return None
    return effect_of(entry, decision.scan[name], stage.effects)
