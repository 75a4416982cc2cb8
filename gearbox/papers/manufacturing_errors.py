"""What would mend an update of a stage with errors of manufacturing: more lines, loads and sensors, or the errors.

Each way of updating fits parameters by least squares to what the recordings hold at the mesh orders, and is judged at
the conditions that it has not seen, beside the highest similarity that a model with mesh lines alone can have there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.published import PaperChapter, unchecked
from gearbox.papers.printed import PAPER
from gearbox.papers.updating_success import GOOD, LOADS, RIG_SEED, SENSORS, chain_on_rig
from multibody.base.progress import Progress

if TYPE_CHECKING:
    from gearbox.rig.rig import GearRig, RigRecording
    from gearbox.signals.recordings import Recording
    from gearbox.updating.chain import UpdatingChain
    from gearbox.updating.virtual import Run

__all__ = ["WAYS", "RigWithErrors", "Way", "mending_chapter"]

Array = NDArray[np.float64]

#: Name, range and whether of the contact (Table 3) or an error of manufacturing; SI, K in N at 1 mm.
CONTACT = {"K": (4.3e5, 12.9e5), "C_D": (86e3, 860e3), "e_F": (1.5, 2.5)}
_BEARINGS = ("input_low", "input_high", "output_low", "output_high")
#: Errors of manufacturing that every tooth repeats, so that they show at the mesh orders; ranges are twice the usual.
ERRORS = {
    "mesh.misalignment": (-6e-4, 6e-4),
    "mesh.profile_form": (-8e-6, 8e-6),
    **{f"{bearing}.clearance": (0.0, 16e-6) for bearing in _BEARINGS},
}
#: From here the search begins, as shares of the ranges; a clearance of nothing has a derivative of one side only.
BEGIN = {**dict.fromkeys(ERRORS, 0.5), **{f"{bearing}.clearance": 0.25 for bearing in _BEARINGS}}
#: Conditions of the rig beyond its six, for updating: the mesh moves across the housing's resonances.
MORE = (("identify_4_slow", 700.0, 150.0, True), ("identify_5_fast", 1300.0, 150.0, True))
#: Names of the encoders' signal, and of that for all channels of vibration.
ENCODERS = "transmission_error"
#: Step of the derivatives, as a share of the ranges.
STEP = 0.01
#: What stands for a compared number where the stage cannot be run: numbers that are met not at all are about one.
FAR = 10.0


@dataclass(frozen=True, kw_only=True)
class Way:
    """A way of updating.

    Parameters
    ----------
    what : str
    parameters : mapping of str to (float, float)
        Names and ranges.
    loads : int
        Recordings fitted to: the base speed at so many loads.
    more : bool
        Two other speeds as well.
    orders : tuple of int
        Mesh orders compared.
    encoders : bool
        The transmission error as well: its lines, and how its mean rises with the load.
    """

    what: str
    parameters: Mapping[str, tuple[float, float]]
    loads: int = 3
    more: bool = False
    orders: tuple[int, ...] = (1, 2, 3)
    encoders: bool = False


_WIDE: dict[str, Any] = {"more": True, "orders": (1, 2, 3, 4, 5, 6)}
WAYS = (
    Way(what="K, C_D, e_F by amplitudes and phases, orders 1 to 3, one load", parameters=CONTACT, loads=1),
    Way(what="K, C_D, e_F, three loads", parameters=CONTACT),
    Way(what="K, C_D, e_F, three loads, orders 1 to 6", parameters=CONTACT, orders=(1, 2, 3, 4, 5, 6)),
    Way(what="K, C_D, e_F, three loads and two more speeds", parameters=CONTACT, more=True),
    Way(what="K, C_D, e_F, three loads and encoders", parameters=CONTACT, encoders=True),
    Way(what="K, C_D, e_F, all of these", parameters=CONTACT, encoders=True, **_WIDE),
    Way(what="errors of manufacturing too, three loads", parameters={**CONTACT, **ERRORS}),
    Way(what="errors of manufacturing too, all of these", parameters={**CONTACT, **ERRORS}, encoders=True, **_WIDE),
)


def errors_vibration(housing: str) -> Any:
    """Return the stage with errors of manufacturing, all zero at first, as `gearbox.updating.runs.Runs` asks for it."""
    from gearbox.signals.signal import Signal
    from gearbox.stage.stage import VIBRATION_RATE, build

    stage = build(housing=housing, imperfect=True)

    def vibration(values: Mapping[str, float], condition: Any, duration: float) -> dict[str, Signal]:
        return stage.vibration(values, condition, duration, VIBRATION_RATE, more=(ENCODERS,))

    return vibration


@dataclass(frozen=True, eq=False, kw_only=True)
class Update:
    """What a way of updating came to.

    Parameters
    ----------
    values : mapping of str to float
    left : float
        Share of the compared numbers that is left.
    similarity : tuple of float
        At the base condition and at conditions 1 to 3.
    runs : int
        Simulations asked for.
    """

    values: Mapping[str, float]
    left: float
    similarity: tuple[float, ...]
    runs: int

    @property
    def others(self) -> tuple[float, ...]:
        """Of the conditions held out."""
        return self.similarity[1:]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fit:
    """Least squares of one way."""

    way: Way
    chain: UpdatingChain
    means: Sequence[float]

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(self.way.parameters)

    def values(self, x: Array) -> dict[str, float]:
        ranges = zip(self.names, x, self.way.parameters.values(), strict=True)
        return {**self.chain.settings.start, **{n: float(a + u * (b - a)) for n, u, (a, b) in ranges}}

    def numbers(self, points: Sequence[Array]) -> list[Array | None]:
        """Measured less simulated at points, all at once; None where the stage cannot be run."""
        objective = self.chain.amplitudes
        target, conditions = objective.target(), objective.conditions
        runs = self.chain.runs.many([(self.values(x), c) for x in points for c in conditions], self.way.what)
        rows: list[Array | None] = []
        for k in range(len(points)):
            made = runs[k * len(conditions) : (k + 1) * len(conditions)]
            if any(run.failed for run in made):
                rows.append(None)
                continue
            apart = (target - objective.align(objective.of_runs(made))[0]).ravel()
            rows.append(np.concatenate([apart.real, apart.imag, self._rise(made)]))
        return rows

    def _rise(self, made: Sequence[Run]) -> Array:
        """How the mean of the transmission error rises from the first recording: the zeros of encoders are unknown."""
        if not self.way.encoders:
            return np.zeros(0)
        measured = np.array(self.means) - self.means[0]
        model = np.array([run.means[ENCODERS] for run in made])
        return np.asarray((measured - (model - model[0])) / np.sqrt(np.mean(measured**2)))

    def run(self) -> tuple[Array, float, int]:
        """Return the parameters as shares of their ranges, the share left, and the simulations asked for."""
        from scipy.optimize import least_squares

        start, space = self.chain.settings.start, self.way.parameters
        begin = [BEGIN[n] if n in BEGIN else (start[n] - low) / (high - low) for n, (low, high) in space.items()]
        asked = 0

        count = 0

        def residual(x: Array) -> Array:
            nonlocal asked, count
            asked += len(self.chain.identify)
            numbers = self.numbers([x])[0]
            if numbers is None:  # the search takes a shorter step
                return np.full(count, FAR)
            count = numbers.size
            return numbers

        def jacobian(x: Array) -> Array:
            nonlocal asked
            steps = np.where(x + STEP > 1.0, -STEP, STEP)
            here, *moved = self.numbers([x, *(x + s * e for s, e in zip(steps, np.eye(x.size), strict=True))])
            asked += x.size * len(self.chain.identify)
            assert here is not None  # the search has been there
            # Where the stage cannot be run a step further, nothing is known of the derivative.
            rows = [np.zeros(count) if m is None else (m - here) / s for m, s in zip(moved, steps, strict=True)]
            return np.array(rows).T

        fit = least_squares(
            residual, np.clip(begin, 0.02, 0.98), jac=jacobian, bounds=(0.0, 1.0), xtol=1e-3, ftol=1e-4, max_nfev=25
        )
        lines = float((np.abs(self.chain.amplitudes.target()) ** 2).sum())
        rises = len(self.means) if self.way.encoders else 0  # scaled to a mean square of one
        return fit.x, 2.0 * float(fit.cost) / (lines + rises), asked


@dataclass(frozen=True, eq=False, kw_only=True)
class RigWithErrors:
    """Recordings of a rig with errors of manufacturing and encoders, and ways of updating the model by them.

    Parameters
    ----------
    rig : GearRig
    used, held_out : tuple of Recording
        Those that may be fitted to, the paper's load first, and conditions 1 to 3.
    progress : callable
    store : Path, optional
        Keeps the simulations.
    """

    rig: GearRig
    used: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    progress: Progress
    store: Path | None

    @property
    def paper_conditions(self) -> list[Recording]:
        """Base condition, two more loads at its speed, and conditions 1 to 3, in this order."""
        return [*self.used[:LOADS], *self.held_out]

    @classmethod
    def of(cls, housing: str, progress: Progress, store: Path | None = None) -> RigWithErrors:
        """Record the rig with a housing."""
        from gearbox.rig.rig import CONDITIONS, GearRig, record

        rig = GearRig(seed=RIG_SEED, manufacturing=1.0, housing=housing, conditions=(*CONDITIONS, *MORE), encoders=True)
        runs, _ = record(rig, progress=lambda text: progress(f"rig with {housing} housing and encoders: {text}"))
        used, held_out = (tuple(_with_encoders(r) for r in runs if r.identify is wanted) for wanted in (True, False))
        return cls(rig=rig, used=used, held_out=held_out, progress=progress, store=store)

    def chain(self, way: Way) -> tuple[UpdatingChain, list[float]]:
        """Return the updating chain for a way of updating, and the mean transmission error of each recording used."""
        used = [*self.used[: way.loads], *(self.used[LOADS:] if way.more else ())]
        chain = chain_on_rig(
            self.rig.housing,
            [*used, *self.held_out],
            self.progress,
            self.store,
            used=len(used),
            model=errors_vibration,
            orders=way.orders,
            sensors=(*SENSORS, ENCODERS) if way.encoders else SENSORS,
        )
        return chain, [float(r.signals[ENCODERS].values.mean()) for r in used]

    def update(self, way: Way) -> Update:
        """Update the model in a way."""
        chain, means = self.chain(way)
        with chain.runs:
            fit = _Fit(way=way, chain=chain, means=means)
            x, left, runs = fit.run()
            values = fit.values(x)
            return Update(values=values, left=left, similarity=similarities(chain, values), runs=runs)


def similarities(chain: UpdatingChain, values: Mapping[str, float]) -> tuple[float, ...]:
    """Cosine similarity at the base condition and at those held out."""
    recordings = (chain.identify[0], *chain.validate)
    runs = chain.runs.many([(values, r.condition) for r in recordings])
    return tuple(chain.similarity.at(r).similarity(run).value for r, run in zip(recordings, runs, strict=True))


def mending_chapter(made: RigWithErrors) -> PaperChapter:
    """Return the chapter of what mends an update of a rig with errors of manufacturing."""
    rig, housing, progress = made.rig, made.rig.housing, made.progress
    repeating: dict[str, float] = {}
    for fault in rig.faults_of(()):
        for name, value in fault.values().items():
            if name in ERRORS:
                repeating[name] = repeating.get(name, 0.0) + value
    chain, _ = made.chain(WAYS[0])
    own = {**chain.settings.start, **rig.true_values()}
    with chain.runs:
        given = {
            "not updated": similarities(chain, chain.settings.start),
            "the rig's own K, C_D and e_F, not updated": similarities(chain, own),
            "the rig's own K, C_D, e_F and all of its errors that every tooth repeats, not updated": similarities(
                chain, {**own, **repeating}
            ),
        }
        bounds = _bounds(chain)
    rows = [
        unchecked("bound of mesh lines", "not given", _listing(bounds), "no model that repeats with the mesh is above"),
        *(unchecked(what, "not done", _listing(values), _WHY_GIVEN) for what, values in given.items()),
    ]
    updates: dict[str, Update] = {}
    for way in WAYS:
        progress(f"{housing} housing, {way.what}")
        updates[way.what] = update = made.update(way)
        apart = ", ".join(
            f"{n} {100 * (update.values[n] - rig.true_values()[n]) / (high - low):+.0f} %"
            for n, (low, high) in CONTACT.items()
        )
        rows.append(
            unchecked(
                way.what,
                "not done",
                f"{_listing(update.similarity)}; left {100 * update.left:.1f} %; {apart}",
                f"{len(way.parameters)} parameters, {update.runs} simulations",
            )
        )
    text = (
        f"The rig with {housing} housing, seed {RIG_SEED}, has the usual errors of manufacturing (synthetic). Each row "
        "has the cosine similarity at the base condition, and at conditions 1, 2 and 3, which are held out; what is "
        "left of the numbers compared; and how far K, C_D and e_F end from the rig's own, as shares of their ranges in "
        "Table 3. Parameters are fitted by least squares to amplitudes and phases of four sensors at the mesh orders "
        f"1 to 3, lags free, from Table 2's start.\n\n{_verdict(updates, given, bounds)}"
    )
    return PaperChapter(
        paper=PAPER,
        place=f"Section 4.5, {housing} housing",
        title="errors of manufacturing, and what would mend the update",
        rows=tuple(rows),
        text=text,
    )


_WHY_GIVEN = "the paper's stage has its own errors, which nobody knows"


def _with_encoders(run: RigRecording) -> Recording:
    from gearbox.signals.recordings import Recording

    plain = run.recording()
    return Recording(plain.condition, {**plain.signals, ENCODERS: run.transmission_error()})


def _bounds(chain: UpdatingChain) -> tuple[float, ...]:
    start = chain.settings.start
    recordings = (chain.identify[0], *chain.validate)
    runs = chain.runs.many([(start, r.condition) for r in recordings])
    return tuple(chain.similarity.at(r).similarity(run).bound for r, run in zip(recordings, runs, strict=True))


def _listing(values: Sequence[float]) -> str:
    first, *others = (f"{v:.3f}" for v in values)
    return f"{first}; {', '.join(others)}"


def _verdict(updates: Mapping[str, Update], given: Mapping[str, Sequence[float]], bounds: Sequence[float]) -> str:
    """What the rows say, in sentences worked out from them."""

    def short(values: Sequence[float]) -> float:
        return max(b - v for v, b in zip(values[1:], bounds[1:], strict=True))

    contact = {n: u for n, u in updates.items() if n.startswith("K,")}
    best = min(contact, key=lambda n: short(contact[n].similarity))
    others = {n: u for n, u in updates.items() if n not in contact}
    top = min(others, key=lambda n: short(others[n].similarity))
    own = list(given.values())
    reach = (
        f"The bound of mesh lines is below {GOOD:g} at {sum(b < GOOD for b in bounds[1:])} of the three conditions "
        "held out, where no model that repeats with the mesh can have the paper's similarity."
    )
    return (
        f"{reach} The furthest below its bound is {short(own[0]):.3f} before updating; {short(own[1]):.3f} with the "
        f"rig's own K, C_D and e_F; "
        f"{short(contact[best].similarity):.3f} at the best of {len(contact)} updates of these three (“{best}”); and "
        f"{short(others[top].similarity):.3f} where the errors are parameters as well (“{top}”). With all errors that "
        f"every tooth repeats, as they are in the rig, it is {short(own[2]):.3f}."
    )
