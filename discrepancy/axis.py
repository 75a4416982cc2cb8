"""The virtual axis: a rig of the linear axis in `discrepancy.axis_model`, richer than that model.

`make_axis` writes recordings, a study file and the truth into a folder; `axis_case` returns the same in
memory.  Data from here are synthetic and are always called that.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy import axis_model, axis_texts
from discrepancy.axis_model import build
from discrepancy.axis_trips import CYCLE, trip
from discrepancy.bench import (
    BenchError,
    Case,
    Channel,
    Disturbance,
    Logger,
    check_folder,
    perturb,
    record_of,
    write_csv,
    write_json,
)
from discrepancy.catalogue import Entry, catalogue
from discrepancy.hidden import UNKNOWN, Hidden, Scale, SignalScale, choose, draw_effect, unknown_effect
from discrepancy.kinds import MotionRange
from discrepancy.unknown_laws import OVER
from estimation.calibrate import UncertainParameter
from multibody.model import Model

__all__ = ["AxisRig", "axis_case", "build", "entries_of", "hidden_in", "list_axis", "make_axis"]

#: Length of a record and of the time under control before it, s.
DURATION, BEFORE = 6.0, 1.5
#: Force at the guide, N, that shows clearly beside a disturbance of 3 N.
FORCE = 12.0
#: Dry friction of the guide, N, where the axis has it.
DRY = 15.0
#: Errors of the signals that show clearly, SI.
VISIBLE = {"motor.torque": 0.03, "carriage.position": 2e-4, "motor.speed": 0.5, "reference.position": 3e-4}
INPUTS, OUTPUTS = ("reference.position",), ("motor.torque", "carriage.position", "motor.speed")
CHANNELS = (
    Channel("reference.position", "position_ref_mm", "m", "mm", resolution=1e-4, exact=True),
    Channel("motor.torque", "motor_torque_Nm", "N*m", "N*m", noise=4e-3, resolution=1e-3, analogue=True),
    Channel("carriage.position", "position_mm", "m", "mm", noise=5e-7, resolution=1e-3),
    Channel("motor.speed", "motor_speed_rpm", "rad/s", "rpm", noise=0.03, resolution=0.05),
)
#: States that start at an unknown value, because the control has settled before a record begins; and at rest.
FREE = ("controller.integral", "motor.angle", "carriage.position")
REST = ("motor.speed", "carriage.velocity")

Progress = Callable[[str], None]


def _silent(text: str) -> None:
    """Swallow progress."""


@dataclass(frozen=True)
class AxisRig:
    """How the rig of the axis is run.

    Parameters
    ----------
    seed : int
        Of everything that is drawn: trips, true parameters, disturbance, sensors, sizes of what is hidden.
    trips : int
        Records; a quarter of them, at least one, are for validation.
    strength : float
        Factor on the usual size of what is hidden.
    disturbance : Disturbance
        Force on the carriage.
    logger : Logger
    dry : bool
        The guide has dry friction, which the model knows, instead of viscous friction alone.
    regularisation : float
        Speed at which dry friction fades in the rig, as a share of that in the model.
    over : {"position", "speed", "time"}
        What an unknown force depends on.
    duration : float, s
        Of a record.
    method, rtol
        Integrator of the rig; the model under test is run with another.
    """

    seed: int = 0
    trips: int = 8
    strength: float = 1.0
    disturbance: Disturbance = field(default_factory=Disturbance)
    logger: Logger = field(default_factory=Logger)
    dry: bool = False
    regularisation: float = 0.8
    over: str = "position"
    duration: float = DURATION
    method: str = "Rodas5P"
    rtol: float = 1e-8

    def __post_init__(self) -> None:
        faults = []
        if isinstance(self.seed, bool) or not isinstance(self.seed, int | np.integer) or self.seed < 0:
            faults.append(f"seed is {self.seed!r}: give a whole number, zero or more")
        if not 2 <= self.trips <= 99:
            faults.append(f"trips is {self.trips}: give 2 to 99, because one at least is for validation")
        if not (np.isfinite(self.strength) and self.strength > 0.0):
            faults.append(f"strength is {self.strength}: give a factor above zero")
        if not (np.isfinite(self.duration) and self.duration >= 3.0):
            faults.append(f"duration is {self.duration} s: give 3 s or more, so that moves fit in")
        if not self.regularisation > 0.0:
            faults.append(f"regularisation is {self.regularisation}: give a factor above zero")
        if self.over not in OVER:
            faults.append(f"an unknown force can depend on {', '.join(OVER)}, not on '{self.over}'")
        if faults:
            raise BenchError(faults)

    def stream(self, number: int) -> np.random.Generator:
        """Return random numbers for one purpose: a change of one thing leaves all others as they are."""
        return np.random.default_rng([int(self.seed), number])

    @property
    def model(self) -> Model:
        """The model under test."""
        return build(coulomb=DRY) if self.dry else build()


def uncertain_of(rig: AxisRig) -> tuple[UncertainParameter, ...]:
    """Return what calibration may move, with the priors from which the true values are drawn."""
    rows = [
        ("carriage.m", 40.0, 1.2, 1.0, "kg"), ("motor.J", 5e-4, 1.5e-5, 1e-6, "kg*m**2"),
        ("guide.viscous", 60.0, 12.0, 0.0, "N*s/m"), ("coupling.stiffness", 30.0, 2.4, 1.0, "N*m/rad"),
        ("damper.damping", 0.006, 0.0015, 0.0, "N*m*s/rad"),
    ]
    if rig.dry:
        rows.append(("dry_friction.coulomb", DRY, 3.0, 0.0, "N"))
    return tuple(UncertainParameter(n, v, s, low, np.inf, u) for n, v, s, low, u in rows)


# -------------------------------------------------------------------- places and sizes


def entries_of(rig: AxisRig) -> list[Entry]:
    """Return every effect that fits the axis."""
    entries = catalogue(rig.model.build(probes=True), OUTPUTS, INPUTS)
    # What passes a spring by, such as a damper beside it, is no load of the spring.
    return [e for e in entries if not (e.kind.needs == "load" and e.stiffness)]


def _scales(rig: AxisRig, entries: Sequence[Entry]) -> dict[str, Scale | SignalScale]:
    """Return what is large at each place and signal of the nominal model, whatever the seed."""
    model = rig.model
    places = {e.where: e.place for e in entries if e.place is not None}
    loads = {e.where: e.load for e in entries if e.load}
    motion = {w: [f"place.{w}.{n}" for n, _ in p.motion_names()] for w, p in places.items()}
    wanted = [*OUTPUTS, *loads.values(), *(name for names in motion.values() for name in names)]
    system = model.build(probes=True, outputs=wanted)
    stamps = rig.logger.stamps(DURATION)
    trips = [trip(np.random.default_rng(k), DURATION) for k in range(3)]
    runs = [system.simulate(DURATION, inputs={INPUTS[0]: each}, times=stamps) for each in trips]

    def all_of(name: str) -> np.ndarray:
        return np.concatenate([r[name] for r in runs])

    def rate_of(name: str) -> float:
        return float(np.quantile(np.abs(np.concatenate([np.gradient(r[name], stamps) for r in runs])), 0.95))

    found: dict[str, Scale | SignalScale] = {
        n: SignalScale(VISIBLE[n], float(np.ptp(all_of(n))), rate_of(n), rig.duration)
        for n in (*OUTPUTS, *INPUTS)}
    for where, place in places.items():
        x, v, a = (all_of(n) for n in motion[where])
        fast, hard = (float(np.quantile(np.abs(each), 0.95)) for each in (v, a))
        key = next((e.stiffness for e in entries if e.where == where and e.stiffness), "")
        stiffness = float(system.p[system.index("parameter", key)]) if key else 0.0
        span = MotionRange(float(x.min()), float(x.max()), fast, place.domain == "rotation", stiffness)
        # The same power shows equally well wherever it is taken; in a spring, a share of its load does.
        force = 0.25 * stiffness * span.half if key else FORCE * _guide_speed(runs) / fast
        load = float(np.quantile(np.abs(all_of(loads[where])), 0.95)) if where in loads else 0.0
        found[where] = Scale(span, hard, force, load, rig.duration)
    return found


def _guide_speed(runs: Sequence[Any]) -> float:
    return float(np.quantile(np.abs(np.concatenate([r["place.guide.velocity"] for r in runs])), 0.95))


def hidden_in(rig: AxisRig, hide: Sequence[str], spread: float = 0.2) -> list[Hidden]:
    """Return the effects that a rig gets, with sizes drawn within a share ``spread`` of the usual ones."""
    entries = entries_of(rig)
    chosen = choose(hide, entries, "axis", prefer=("guide", "coupling", "carriage.position"))
    if not chosen:
        return []
    scales = _scales(rig, entries)
    found = []
    for each in chosen:
        where = each if isinstance(each, str) else each.where
        scale: Any = scales[where]
        named = f"{UNKNOWN}@{where}" if isinstance(each, str) else each.name
        rng = np.random.default_rng([int(rig.seed), 5, *named.encode()])
        if isinstance(each, str):
            entry = next(e for e in entries if e.where == where)
            found.append(unknown_effect(entry, rig.over, scale, rng, strength=rig.strength, spread=spread))
        else:
            effect = draw_effect(
                each, scale, rng, strength=rig.strength, regularisation=rig.regularisation, spread=spread)
            found.append(Hidden(effect, where))
    return found


def list_axis(*, strength: float = 1.0, dry: bool = False) -> list[dict[str, Any]]:
    """Return everything that can be hidden, as ``truth.json`` would hold it, at its usual size."""
    rig = AxisRig(strength=strength, dry=dry)
    entries = entries_of(rig)
    units = {c.signal: c.unit for c in CHANNELS}
    names = [e.name for e in entries]
    names += [f"{UNKNOWN}@{w}" for w in dict.fromkeys(e.where for e in entries if e.kind.at == "connection")]
    return [h.truth(units) for h in hidden_in(rig, names, spread=0.0)]


# -------------------------------------------------------------------- runs


def axis_case(
    seed: int = 0, hide: Sequence[str] = (), *, rig: AxisRig | None = None, progress: Progress = _silent,
    **settings: Any,
) -> Case:
    """Return the axis under test, recordings of its rig, and the truth.

    Parameters
    ----------
    seed : int
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``.
    rig : AxisRig, optional
        All settings at once; otherwise ``settings`` go to `AxisRig`.
    progress : callable
        Gets a line of text for each trip.

    Raises
    ------
    BenchError
        With every setting that is not possible and every effect that does not fit.

    Examples
    --------
    >>> case = axis_case(seed=1, hide=["coulomb_friction@guide"], trips=2)
    >>> case.truth["effects"][0]["kind"], len(case.identify), len(case.validate)
    ('coulomb_friction', 1, 1)
    """
    rig = AxisRig(seed=seed, **settings) if rig is None else rig
    hidden = hidden_in(rig, hide)
    uncertain = uncertain_of(rig)
    perturbed = perturb(uncertain, rig.stream(1))
    true_model = rig.model.with_values(perturbed)
    for each in hidden:
        true_model = each.added_to(true_model)
    held = max(1, rig.trips // 4)
    split = rig.trips - held
    names = [f"identify_{k + 1:02d}" for k in range(split)] + [f"validate_{k + 1:02d}" for k in range(held)]
    errors = [e for h in hidden if h.effect is not None and (e := h.effect.sensor_error()) is not None]
    runs = _run(rig, true_model, errors, names, progress)
    records = [record_of(n, Path(f"{n}.csv.gz"), stamps, columns, CHANNELS) for n, stamps, columns in runs]
    units = {c.signal: c.unit for c in CHANNELS}
    truth = {
        "synthetic": True, "machine": "axis", "seed": int(rig.seed),
        "effects": [h.truth(units) for h in hidden],
        "perturbed": {
            u.name: {"value": perturbed[u.name], "nominal": u.value, "unit": u.unit} for u in uncertain},
        "disturbance": {"where": "guide", "rms": {"value": rig.disturbance.size, "unit": "N"}},
        "strength": rig.strength, "dry_friction": rig.dry, "regularisation": rig.regularisation,
    }
    return Case(
        rig.model, uncertain, INPUTS, OUTPUTS, tuple(records[:split]), tuple(records[split:]), FREE, REST,
        truth, true_model, CHANNELS)


def _run(
    rig: AxisRig, model: Model, errors: Sequence[Any], names: Sequence[str], progress: Progress
) -> list[tuple[str, np.ndarray, dict[str, np.ndarray]]]:
    """Run the rig once for each trip; return name, time stamps and columns as they are written."""
    from multibody.library import ForceSource

    model = model.copy()
    source = model.add("disturbance", ForceSource())
    model.connect(source.flange, "carriage.flange")
    model.input("disturbance.force", source.force)
    if rig.dry:
        fades = model.components["dry_friction"].values["v_s"]
        model = model.with_values({"dry_friction.v_s": fades * rig.regularisation})
    system = model.build(outputs=OUTPUTS)
    stamps, fine = rig.logger.stamps(rig.duration), rig.logger.fine_grid(rig.duration, BEFORE)
    found = []
    for k, name in enumerate(names):
        progress(f"trip {k + 1} of {len(names)}")
        time, place = trip(rig.stream(100 + k), rig.duration)
        pushed = np.arange(-round(BEFORE / CYCLE), time.size) * CYCLE
        force = rig.disturbance.draw(pushed.size, CYCLE, rig.stream(200 + k))
        run = system.simulate(
            (float(fine[0]), float(fine[-1])),
            inputs={INPUTS[0]: (time, place), "disturbance.force": (pushed, force)}, times=fine,
            method=rig.method, rtol=rig.rtol, atol=rig.rtol * 1e-3)
        rng = rig.stream(300 + k)
        columns = {}
        for channel in CHANNELS:
            values = np.interp(fine, time, place) if channel.signal in INPUTS else run[channel.signal]
            columns[channel.column] = rig.logger.read(channel, fine, values, stamps, rng, errors)
        found.append((name, stamps, columns))
    return found


def make_axis(
    out: str | os.PathLike[str], hide: Sequence[str] = (), seed: int = 0, trips: int = 8,
    strength: float = 1.0, disturbance: float = 3.0, *, dry: bool = False, over: str = "position",
    progress: Progress = _silent,
) -> Path:
    """Write recordings of the virtual axis into a folder, with the study file, the model and the truth.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``.
    seed, trips, strength, dry, over
        See `AxisRig`.
    disturbance : float, N
        Root mean square of the force that disturbs the carriage.

    Returns
    -------
    Path
        The study file.

    Raises
    ------
    BenchError
        With everything that is not possible.
    """
    rig = AxisRig(
        seed=seed, trips=trips, strength=strength, disturbance=Disturbance(disturbance), dry=dry, over=over)
    if Path(out).is_file():
        check_folder(out)
    case = axis_case(hide=hide, rig=rig, progress=progress)
    folder = check_folder(out)
    for record in (*case.identify, *case.validate):
        columns = {c.column: _as_read(record.signals[c.signal].values, c) for c in CHANNELS}
        write_csv(folder / record.path.name, np.asarray(record.time), columns)
    source = Path(axis_model.__file__).read_text(encoding="utf-8")
    (folder / "axis.py").write_text(source, encoding="utf-8")
    study = folder / "study.toml"
    study.write_text(axis_texts.study(case, DRY if dry else None), encoding="utf-8")
    (folder / "README.md").write_text(axis_texts.readme(rig, case), encoding="utf-8")
    write_json(folder / "truth.json", case.truth)
    return study


def _as_read(values: np.ndarray, channel: Channel) -> np.ndarray:
    from multibody.units import convert

    return np.asarray(convert(values, channel.unit, channel.measured_unit))
