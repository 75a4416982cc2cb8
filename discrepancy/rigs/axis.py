"""The virtual axis: a rig of the linear axis in `discrepancy.rigs.axis_model`, richer than that model.

`make_axis` writes recordings, a study file and the truth into a folder; `axis_case` returns the same in
memory.  Its data are synthetic and are always called that.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.questions.trip_plan import TripPlan
from discrepancy.rigs import axis_model, axis_texts
from discrepancy.rigs.axis_model import build
from discrepancy.rigs.axis_trips import CYCLE, trip
from discrepancy.rigs.case import Case, check_folder, write_case
from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.recording import Channel, RigDisturbance
from discrepancy.rigs.rig import Rig, Run
from estimation.fit.calibrate import UncertainParameter
from multibody.base.progress import Progress, Step, silent
from multibody.base.spelling import nearest
from multibody.machine.model import Model, System

if TYPE_CHECKING:
    from multibody.system.trajectory import Trajectory

__all__ = ["AxisRig", "axis_case", "build", "entries_of", "hidden_in", "list_axis", "make_axis"]

#: Time under control before a record, s.
BEFORE = 1.5
#: Dry friction of the guide, N, where the axis has it.
DRY = 15.0
#: Mass of the carriage, kg, and white noise of a sensor that is added, by its unit, SI.
MASS = 40.0
ADDED = {"N": 0.1, "N*m": 4e-3, "m": 5e-7, "rad": 1e-5, "m/s": 1e-4, "rad/s": 0.03}
INPUTS, OUTPUTS = ("reference.position",), ("motor.torque", "carriage.position", "motor.speed")
CHANNELS = (
    Channel(
        signal="reference.position", column="position_ref_mm", unit="m", measured_unit="mm", resolution=1e-4, exact=True
    ),
    Channel(
        signal="motor.torque",
        column="motor_torque_Nm",
        unit="N*m",
        measured_unit="N*m",
        noise=4e-3,
        resolution=1e-3,
        analogue=True,
    ),
    Channel(
        signal="carriage.position", column="position_mm", unit="m", measured_unit="mm", noise=5e-7, resolution=1e-3
    ),
    Channel(
        signal="motor.speed", column="motor_speed_rpm", unit="rad/s", measured_unit="rpm", noise=0.03, resolution=0.05
    ),
)


@dataclass(frozen=True)
class AxisRig(Rig):
    """How the rig of the axis is run; see `discrepancy.rigs.rig.Rig` for the other settings.

    Parameters
    ----------
    dry : bool
        The guide has dry friction, which the model knows, instead of viscous friction alone.
    plan : TripPlan
        How the trips differ from the usual ones; other than the usual plan gives new trips of the same machine.
    """

    dry: bool = False
    plan: TripPlan = field(default_factory=TripPlan)

    machine: ClassVar[str] = "axis"
    prefer: ClassVar[tuple[str, ...]] = ("guide", "coupling", "carriage.position")
    at: ClassVar[str] = "guide"
    #: Shows clearly in spite of a disturbance of 3 N.
    force: ClassVar[float] = 12.0
    visible: ClassVar[Mapping[str, float]] = {
        "motor.torque": 0.03,
        "carriage.position": 2e-4,
        "motor.speed": 0.5,
        "reference.position": 3e-4,
    }
    #: The control has settled before a record begins.
    free: ClassVar[tuple[str, ...]] = ("controller.integral", "motor.angle", "carriage.position")
    still: ClassVar[tuple[str, ...]] = ("motor.speed", "carriage.velocity")

    @property
    def model(self) -> Model:
        """The model under test."""
        return build(coulomb=DRY) if self.dry else build()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is recorded."""
        name = self.plan.sensor
        if not name or name in OUTPUTS:
            return CHANNELS
        unit = self.model.build().unit(name)
        return (
            *CHANNELS,
            Channel(
                signal=name,
                column=name.replace(".", "_"),
                unit=unit,
                measured_unit=unit,
                noise=ADDED.get(unit, 0.0),
                analogue=True,
            ),
        )

    @property
    def inputs(self) -> tuple[str, ...]:
        """The position reference."""
        return INPUTS

    @property
    def outputs(self) -> tuple[str, ...]:
        """Measured outputs."""
        return tuple(c.signal for c in self.channels if c.signal not in INPUTS)

    def faults(self) -> list[str]:
        """Return the faults of the settings."""
        faults = super().faults()
        known = self.model.build().output_names if self.plan.sensor else ()
        if self.plan.sensor and self.plan.sensor not in known:
            faults.append(f"the axis has no output '{self.plan.sensor}' to measure{nearest(self.plan.sensor, known)}")
        return faults

    @property
    def uncertain(self) -> tuple[UncertainParameter, ...]:
        """What calibration may move, with the priors from which the true values are drawn."""
        rows = [
            ("carriage.m", MASS, 1.2, 1.0, "kg"),
            ("motor.J", 5e-4, 1.5e-5, 1e-6, "kg*m**2"),
            ("guide.viscous", 60.0, 12.0, 0.0, "N*s/m"),
            ("coupling.stiffness", 30.0, 2.4, 1.0, "N*m/rad"),
            ("damper.damping", 0.006, 0.0015, 0.0, "N*m*s/rad"),
        ]
        if self.dry:
            rows.append(("dry_friction.coulomb", DRY, 3.0, 0.0, "N"))
        return tuple(
            UncertainParameter(name=n, value=v, std=s, min=low, max=np.inf, unit=u) for n, v, s, low, u in rows
        )

    def nominal_runs(self, system: System, stamps: np.ndarray) -> list[Trajectory]:
        """Return three trips of the nominal axis, whatever the seed."""
        trips = [trip(np.random.default_rng(k), float(stamps[-1])) for k in range(3)]
        return [system.simulate(float(stamps[-1]), inputs={INPUTS[0]: t}, times=stamps) for t in trips]

    def more_truth(self) -> dict[str, Any]:
        """Return whether the guide has dry friction."""
        return {"dry_friction": self.dry}

    def record(
        self,
        perturbed: Mapping[str, float],
        hidden: Sequence[Hidden],
        errors: Sequence[Any],
        names: Sequence[str],
        progress: Progress,
    ) -> tuple[Model, list[Run]]:
        """Return the true axis, and a run of it for each name."""
        from multibody.library import ForceSource

        values = dict(perturbed)
        values["carriage.m"] += MASS * (self.plan.load - 1.0)
        true_model = self.model.with_values(values)
        for effect in hidden:
            true_model = effect.added_to(true_model)
        model = true_model.copy()
        source = model.add("disturbance", ForceSource())
        model.connect(source.flange, "carriage.flange")
        model.input("disturbance.force", source.force)
        if self.dry:
            fades = model.components["dry_friction"].values["v_s"]
            model = model.with_values({"dry_friction.v_s": fades * self.regularisation})
        system = model.build(outputs=self.outputs)
        runs: list[Run] = []
        new = 0 if self.plan == TripPlan(sensor=self.plan.sensor) else 1000
        for k, name in enumerate(names):
            progress(Step(f"trip {k + 1} of {len(names)}", k, len(names)))
            time, changed = self.plan.apply(*_named(trip(self.stream(new + 100 + k), self.duration)))
            place = changed[INPUTS[0]]
            duration = float(np.round(time[-1] - 1.0 / self.plan.speed, 3))
            stamps, fine = self.logger.stamps(duration), self.logger.fine_grid(duration, BEFORE)
            pushed = np.arange(-round(BEFORE / CYCLE), time.size) * CYCLE
            force = self.disturbance.draw(pushed.size, CYCLE, self.stream(new + 200 + k))
            run = system.simulate(
                (float(fine[0]), float(fine[-1])),
                inputs={INPUTS[0]: (time, place), "disturbance.force": (pushed, force)},
                times=fine,
                method=self.method,
                rtol=self.rtol,
                atol=self.rtol * 1e-3,
            )
            rng = self.stream(new + 300 + k)
            columns: dict[str, np.ndarray] = {}
            for channel in self.channels:
                signal = np.interp(fine, time, place) if channel.signal in INPUTS else run[channel.signal]
                columns[channel.column] = self.logger.read(channel, fine, signal, stamps, rng, errors)
            runs.append((name, stamps, columns))
        return true_model, runs

    def hidden(self, hide: Sequence[str], spread: float = 0.2) -> list[Hidden]:
        """Return the effects that the rig gets: those of its usual trips, whatever the plan."""
        usual = self if self.plan == TripPlan() else replace(self, plan=TripPlan())
        return Rig.hidden(usual, hide, spread)

    def case(self, hide: Sequence[str] = (), progress: Progress = silent) -> Case:
        """Return the model under test, recordings, and the truth; a load is known to the model."""
        case = super().case(hide, progress)
        if self.plan.load == 1.0:
            return case
        more = MASS * (self.plan.load - 1.0)
        model = case.model.with_values({"carriage.m": MASS + more})
        loaded = [replace(u, value=u.value + more) if u.name == "carriage.m" else u for u in case.uncertain]
        case.truth["load"] = {"value": more, "unit": "kg"}
        return replace(case, model=model, uncertain=tuple(loaded))


def _named(run: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    return run[0], {INPUTS[0]: run[1]}


def entries_of(rig: AxisRig) -> list[Entry]:
    """Return every effect that fits the axis."""
    return rig.entries()


def hidden_in(rig: AxisRig, hide: Sequence[str], spread: float = 0.2) -> list[Hidden]:
    """Return the effects that a rig gets, with sizes drawn within a share ``spread`` of the usual ones."""
    return rig.hidden(hide, spread)


def list_axis(*, strength: float = 1.0, dry: bool = False) -> list[dict[str, Any]]:
    """Return everything that can be hidden, as ``truth.json`` would hold it, at its usual size."""
    return AxisRig(strength=strength, dry=dry).list()


def axis_case(
    seed: int = 0,
    hide: Sequence[str] = (),
    *,
    rig: AxisRig | None = None,
    progress: Progress = silent,
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
    return rig.case(hide, progress)


def make_axis(
    out: str | os.PathLike[str],
    hide: Sequence[str] = (),
    seed: int = 0,
    trips: int = 8,
    strength: float = 1.0,
    disturbance: float = 3.0,
    *,
    dry: bool = False,
    over: str = "position",
    plan: TripPlan | None = None,
    progress: Progress = silent,
) -> Path:
    """Write recordings of the virtual axis into a folder, with the study file, the model and the truth.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``.
    seed, trips, strength, dry, over, plan
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
        seed=seed,
        trips=trips,
        strength=strength,
        disturbance=RigDisturbance(disturbance),
        dry=dry,
        over=over,
        plan=plan or TripPlan(),
    )
    if Path(out).is_file():
        check_folder(out)
    case = rig.case(hide, progress)
    texts = {
        "axis.py": Path(axis_model.__file__).read_text(encoding="utf-8"),
        "study.toml": axis_texts.study(
            case, DRY if dry else None, MASS * rig.plan.load if rig.plan.load != 1.0 else None
        ),
        "README.md": axis_texts.readme(rig, rig.plan, case),
    }
    return write_case(out, case, texts)
