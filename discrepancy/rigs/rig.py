"""What all virtual rigs have in common: settings, places and sizes of hidden effects, a whole set of recordings.

The rig of a machine is a subclass of `Rig` that states which model is under test, what is recorded, and how a trip
runs; see `discrepancy.rigs.axis` and `vtsdt.rig.recordings`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.shape_grids import MotionRange
from discrepancy.effects.uncatalogued_laws import OVER
from discrepancy.rigs.case import Case
from discrepancy.rigs.hidden_effects import (
    UNKNOWN,
    Hidden,
    Scale,
    SignalScale,
    choose,
    draw_effect,
    misstated,
    unknown_effect,
)
from discrepancy.rigs.recording import BenchError, Channel, Logger, RigDisturbance, perturb, record_of
from multibody.base.progress import Progress, silent

if TYPE_CHECKING:
    from estimation.fit.calibrate import UncertainParameter
    from estimation.response.sensors import SensorError
    from multibody.assembly.places import Place
    from multibody.machine.model import Model, System
    from multibody.system.trajectory import Trajectory

__all__ = ["Rig", "Run"]

#: Name of a recording, its time stamps, and its columns as they are written.
Run = tuple[str, np.ndarray, dict[str, np.ndarray]]


#: Share of the widest motion of its kind below which a place counts as standing still.
_STANDSTILL = 1e-3

#: Factor on the usual size of what is hidden, above which no machine would still move as it should.
MOST_STRENGTH = 1000.0

#: Share of the span of what a controller gives, as which an error of it shows and the loop stays stable.
_CONTROLLED = 0.01


@dataclass(frozen=True, kw_only=True)
class Rig:
    """How a virtual rig is run; a subclass states of which machine.

    Parameters
    ----------
    seed : int
        Of everything that is drawn: trips, true parameters, disturbance, sensors, sizes of hidden effects.
    trips : int
        Records; a quarter of them, at least one, are for validation.
    strength : float
        Factor on the usual size of hidden effects.
    disturbance : RigDisturbance
        Force that no model describes.
    logger : Logger
    regularisation : float
        Speed at which dry friction fades in the rig, as a share of that in the model.
    over : {"position", "speed", "time"}
        What an unknown force depends on.
    duration : float, s
        Of a record.
    method, rtol
        Integrator of the rig; the model under test is run with another.
    strengths : mapping of str to mapping of str to float
        Of hidden effects, by ``kind@where`` and name, SI, instead of those that are drawn.
    """

    seed: int = 0
    trips: int = 8
    strength: float = 1.0
    disturbance: RigDisturbance = field(default_factory=RigDisturbance)
    logger: Logger = field(default_factory=Logger)
    regularisation: float = 0.8
    over: str = "position"
    duration: float = 6.0
    method: str = "Rodas5P"
    rtol: float = 1e-8
    strengths: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    #: Name of the machine, for messages and the truth.
    machine: ClassVar[str]
    #: Preferred places where none is named.
    prefer: ClassVar[tuple[str, ...]] = ()
    #: Where a disturbance acts, and the force, N or N m, that shows clearly there in spite of it.
    at: ClassVar[str]
    force: ClassVar[float]
    #: Errors of the signals that show clearly, SI.
    visible: ClassVar[Mapping[str, float]]
    #: States that start at an unknown value, and at zero.
    free: ClassVar[tuple[str, ...]] = ()
    still: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        if faults := self.faults():
            raise BenchError(faults)

    def faults(self) -> list[str]:
        """Return the faults of the settings."""
        faults = []
        if isinstance(self.seed, bool) or not isinstance(self.seed, int | np.integer) or self.seed < 0:
            faults.append(f"seed is {self.seed!r}: give a whole number, zero or more")
        if not 2 <= self.trips <= 99:
            faults.append(f"trips is {self.trips}: give 2 to 99, because one at least is for validation")
        if not 0.0 < self.strength <= MOST_STRENGTH:
            faults.append(f"strength is {self.strength:g}: give a factor above zero and up to {MOST_STRENGTH:g}")
        if not (np.isfinite(self.duration) and self.duration >= 3.0):
            faults.append(f"duration is {self.duration} s: give 3 s or more, so that moves fit in")
        if not self.regularisation > 0.0:
            faults.append(f"regularisation is {self.regularisation}: give a factor above zero")
        if self.over not in OVER:
            faults.append(f"an unknown force can depend on {', '.join(OVER)}, not on '{self.over}'")
        return faults

    def stream(self, number: int) -> np.random.Generator:
        """Return random numbers for one purpose: a change of one thing leaves all others as they are."""
        return np.random.default_rng([int(self.seed), number])

    # ---------------------------------------------------------------- what a machine says of itself

    @property
    def model(self) -> Model:
        """The model under test."""
        raise NotImplementedError

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is recorded, inputs and outputs."""
        raise NotImplementedError

    @property
    def inputs(self) -> tuple[str, ...]:
        """Recorded inputs of the model under test."""
        raise NotImplementedError

    @property
    def outputs(self) -> tuple[str, ...]:
        """Measured outputs."""
        raise NotImplementedError

    @property
    def uncertain(self) -> tuple[UncertainParameter, ...]:
        """What calibration may move, with the priors from which the true values are drawn."""
        raise NotImplementedError

    @property
    def starts(self) -> tuple[str, ...]:
        """States of the model under test that start at an unknown value."""
        return self.free

    def nominal_runs(self, system: System, stamps: np.ndarray) -> list[Trajectory]:
        """Return a few trips of the nominal model, whatever the seed, from which sizes follow."""
        raise NotImplementedError

    def record(
        self,
        perturbed: Mapping[str, float],
        hidden: Sequence[Hidden],
        errors: Sequence[SensorError],
        names: Sequence[str],
        progress: Progress,
    ) -> tuple[Model, list[Run]]:
        """Return the true model, and a run of the rig for each name."""
        raise NotImplementedError

    def more_truth(self) -> dict[str, Any]:
        """Return further entries of ``truth.json``."""
        return {}

    # ---------------------------------------------------------------- places and sizes

    @property
    def units(self) -> dict[str, str]:
        """SI units of the recorded signals."""
        return {c.signal: c.unit for c in self.channels}

    def entries(self) -> list[Entry]:
        """Return every effect that fits the machine."""
        entries = catalogue(self.model.build(probes=True), self.outputs, self.inputs)
        # The force of a damper parallel to a spring is no load of the spring.
        return [e for e in entries if not (e.kind.needs == "load" and e.stiffness)]

    def scales(self, entries: Sequence[Entry]) -> tuple[dict[str, Scale], dict[str, SignalScale]]:
        """Return the scales of motion and force at each place, and of each signal, of the nominal model for any seed.

        A place that hardly moves compared with the others, such as a machine's support, is left out: a force there that
        could be seen would be too large to be a plausible effect.
        """
        places: dict[str, Place] = {e.where: e.place for e in entries if e.place is not None}
        loads = {e.where: e.load for e in entries if e.load}
        motion = {w: [f"place.{w}.{n}" for n, _ in p.motion_names()] for w, p in places.items()}
        recorded = [n for n in self.outputs if n not in self.inputs]
        controlled = list(dict.fromkeys(e.where for e in entries if e.kind.at == "signal"))
        wanted = [*recorded, *controlled, *loads.values(), *(name for names in motion.values() for name in names)]
        system = self.model.build(probes=True, outputs=wanted)
        stamps = self.logger.stamps(self.duration)
        runs = self.nominal_runs(system, stamps)

        def all_of(name: str) -> np.ndarray:
            return np.concatenate([r[name] for r in runs])

        def rate_of(name: str) -> float:
            return float(np.quantile(np.abs(np.concatenate([np.gradient(r[name], stamps) for r in runs])), 0.95))

        scales: dict[str, Scale] = {}
        signals: dict[str, SignalScale] = {}
        for n in (*self.outputs, *self.inputs):
            floor = self.visible[n]  # a signal that stands still in these trips gets errors of its own size
            span, rate = max(float(np.ptp(all_of(n))), floor), max(rate_of(n), floor)
            signals[n] = SignalScale(floor, span, rate, self.duration)
        for n in controlled:
            span = float(np.ptp(all_of(n)))
            signals[n] = SignalScale(_CONTROLLED * span, span, rate_of(n), self.duration)
        usual = _fast(all_of(motion[self.at][1]))
        reach = {w: float(np.ptp(all_of(motion[w][0]))) for w in places}
        widest: dict[str, float] = {}
        for where, place in places.items():
            widest[place.domain] = max(widest.get(place.domain, 0.0), reach[where])
        for where, place in places.items():
            x, v, a = (all_of(n) for n in motion[where])
            fast, hard = _fast(v), _fast(a)
            key = next((e.stiffness for e in entries if e.where == where and e.stiffness), "")
            if not key and reach[where] < _STANDSTILL * widest[place.domain]:
                continue
            stiffness = float(system.p[system.index("parameter", key)]) if key else 0.0
            span_ = MotionRange(
                low=float(x.min()),
                high=float(x.max()),
                speed=fast,
                turns=place.domain == "rotation",
                scale=stiffness,
                duration=self.duration,
            )
            # The same power shows equally well wherever it is taken; in a spring, a share of its load does.
            force = 0.25 * stiffness * span_.half if key else self.force * usual / fast
            load = _fast(all_of(loads[where])) if where in loads else 0.0
            scales[where] = Scale(motion=span_, acceleration=hard, force=force, load=load, duration=self.duration)
        return scales, signals

    def shown(self) -> tuple[list[Entry], dict[str, Scale], dict[str, SignalScale]]:
        """Return every effect that can be hidden, and the scales at its place or in its signal."""
        entries = self.entries()
        places, signals = self.scales(entries)
        possible = [e for e in entries if e.kind.stated or e.where in (places if e.place is not None else signals)]
        return possible, places, signals

    def hidden(self, hide: Sequence[str], spread: float = 0.2) -> list[Hidden]:
        """Return the effects that the rig gets, with sizes drawn within a share ``spread`` of the usual ones."""
        if not hide:
            return []
        entries, places, signals = self.shown()
        chosen = choose(hide, entries, self.machine, prefer=self.prefer)
        hidden = []
        for choice in chosen:
            where = choice if isinstance(choice, str) else choice.where
            named = f"{UNKNOWN}@{where}" if isinstance(choice, str) else choice.name
            rng = np.random.default_rng([int(self.seed), 5, *named.encode()])
            if isinstance(choice, Entry) and choice.kind.stated:
                effect = misstated(choice, rng, strength=self.strength, spread=spread)
                hidden.append(Hidden(effect=effect, where=where, stated=choice.stated))
                continue
            at_place = isinstance(choice, str) or choice.place is not None
            scale: Any = places[where] if at_place else signals[where]
            if isinstance(choice, str):
                entry = next(e for e in entries if e.where == where and e.place is not None)
                hidden.append(unknown_effect(entry, self.over, scale, rng, strength=self.strength, spread=spread))
            else:
                effect = draw_effect(
                    choice,
                    scale,
                    rng,
                    strength=self.strength,
                    regularisation=self.regularisation,
                    spread=spread,
                )
                hidden.append(Hidden(effect=effect, where=where))
        return [self._as_given(h) for h in hidden]

    def _as_given(self, hidden: Hidden) -> Hidden:
        """Return an effect with the strengths that were given for it, if any."""
        effect = hidden.effect
        if effect is None or str(effect) not in self.strengths:
            return hidden
        given = self.strengths[str(effect)]
        if unknown := set(given) - set(effect.strengths):
            raise BenchError([f"strengths of {effect}: there is no '{n}'" for n in sorted(unknown)])
        return replace(hidden, effect=replace(effect, strengths={**effect.strengths, **given}))

    def list(self) -> list[dict[str, Any]]:
        """Return everything that can be hidden, as ``truth.json`` would hold it, at its usual size."""
        entries = self.shown()[0]
        names = [e.name for e in entries]
        names += [f"{UNKNOWN}@{w}" for w in dict.fromkeys(e.where for e in entries if e.kind.at == "connection")]
        return [h.truth(self.units) for h in self.hidden(names, spread=0.0)]

    # ---------------------------------------------------------------- recordings

    def case(self, hide: Sequence[str] = (), progress: Progress = silent) -> Case:
        """Return the model under test, recordings of the rig, and the truth.

        Parameters
        ----------
        hide : sequence of str
            ``KIND`` or ``KIND@WHERE``.
        progress : callable
            Gets a line of text for each trip.

        Raises
        ------
        BenchError
            With every effect that does not fit.
        """
        hidden, uncertain = self.hidden(hide), self.uncertain
        perturbed = perturb(uncertain, self.stream(1))
        held = max(1, self.trips // 4)
        split = self.trips - held
        names = [f"identify_{k + 1:02d}" for k in range(split)]
        names += [f"validate_{k + 1:02d}" for k in range(held)]
        errors = [e for h in hidden if h.effect is not None and (e := h.effect.sensor_error()) is not None]
        true_model, runs = self.record(perturbed, hidden, errors, names, progress)
        records = [record_of(n, Path(f"{n}.csv.gz"), stamps, columns, self.channels) for n, stamps, columns in runs]
        truth = {
            "synthetic": True,
            "machine": self.machine,
            "seed": int(self.seed),
            "effects": [h.truth(self.units) for h in hidden],
            "perturbed": {u.name: {"value": perturbed[u.name], "nominal": u.value, "unit": u.unit} for u in uncertain},
            "disturbance": {"where": self.at, "rms": {"value": self.disturbance.size, "unit": "N"}},
            "strength": self.strength,
            "regularisation": self.regularisation,
            **self.more_truth(),
        }
        return Case(
            model=self.model,
            uncertain=uncertain,
            inputs=self.inputs,
            outputs=self.outputs,
            identify=tuple(records[:split]),
            validate=tuple(records[split:]),
            free=self.starts,
            rest=self.still,
            truth=truth,
            true_model=true_model,
            channels=self.channels,
        )


def _fast(values: np.ndarray) -> float:
    return float(np.quantile(np.abs(values), 0.95))
