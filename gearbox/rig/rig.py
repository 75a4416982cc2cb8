"""The virtual gear rig: a gear stage richer than the model under test, measured as a real one would be.

`vtsdt bench gear` writes recordings, a study file and the truth into a folder.  Data from here are synthetic and are
always called that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.rigs.recording import BenchError, Channel, Logger
from gearbox.files.operating_condition import OperatingCondition
from gearbox.rig.hidden import HiddenFault, choose, manufacturing
from gearbox.signals.recordings import Recording
from gearbox.signals.signal import Signal
from multibody.base.progress import Progress, silent

if TYPE_CHECKING:
    from gearbox.stage.stage import GearStage

__all__ = ["CONDITIONS", "GearRig", "record", "true_stage", "truth"]

Array = NDArray[np.float64]

TEETH = (32, 44)
#: Name, reported speed (r/min), load (N m) and whether the model may be updated from it.  The paper's Table 5, and two
#: more loads at the base speed for the objective that compares several.
CONDITIONS: tuple[tuple[str, float, float, bool], ...] = (
    ("identify_1_base", 1000.0, 150.0, True),
    ("identify_2_light", 1000.0, 75.0, True),
    ("identify_3_heavy", 1000.0, 220.0, True),
    ("validate_condition_1", 1006.0, 50.0, False),
    ("validate_condition_2", 1005.0, 75.0, False),
    ("validate_condition_3", 1003.0, 100.0, False),
)
SENSORS = ("input_seat", "output_seat", "base")
AXES = ("x", "y", "z")
ACCELEROMETERS = tuple(f"a_{sensor}_{axis}" for sensor in SENSORS for axis in AXES)
#: What gear 1 has turned ahead of gear 2, along the line of action, from an encoder on each shaft.
TRANSMISSION_ERROR = Channel(
    signal="transmission_error",
    column="transmission_error [um]",
    unit="m",
    measured_unit="um",
    noise=3e-7,
    resolution=0.01,
)
#: What is drawn for each rig, within Table 3: name, lowest, highest, unit.
TRUE_RANGES = (
    ("K", 5.2e5, 11.0e5, "N at 1 mm"),
    ("C_D", 150e3, 600e3, "N*s/m"),
    ("e_F", 1.8, 2.3, ""),
)


@dataclass(frozen=True, kw_only=True)
class GearRig:
    """How the rig is run.

    Parameters
    ----------
    seed : int
        Of everything that is drawn.
    manufacturing : float
        Factor on the usual errors of manufacturing and assembly; 0 for a stage without any.
    strength : float
        Factor on the usual size of what is hidden.
    noise : float
        Standard deviation of each accelerometer's noise, m/s².
    path : float
        Factor on what the measuring chain does that the model's accelerometers do not: a mounting resonance, a gain
        error, a delay; 0 for none.
    wander : float
        Share by which the speed wanders slowly.
    duration : float, s
        Of a record.
    housing : str
        As in the model under test: "flexible", "rigid" or "clamped".
    conditions : tuple
        As :data:`CONDITIONS`.
    encoders : bool
        Whether an encoder on each shaft records the transmission error as well.
    """

    seed: int = 0
    manufacturing: float = 0.0
    strength: float = 1.0
    noise: float = 0.3
    path: float = 1.0
    wander: float = 2e-5
    duration: float = 1.0
    housing: str = "flexible"
    conditions: tuple[tuple[str, float, float, bool], ...] = CONDITIONS
    encoders: bool = False
    logger: Logger = field(default_factory=lambda: Logger(rate=25_600.0, fine=2, jitter=0.0, cutoff=0.8))

    def __post_init__(self) -> None:
        faults = []
        if isinstance(self.seed, bool) or not isinstance(self.seed, int | np.integer) or self.seed < 0:
            faults.append(f"seed is {self.seed!r}: give a whole number, zero or more")
        for name, value in (
            ("manufacturing", self.manufacturing),
            ("noise", self.noise),
            ("path", self.path),
            ("wander", self.wander),
        ):
            if not (np.isfinite(value) and value >= 0.0):
                faults.append(f"{name} is {value}: give a number of zero or more")
        if not (np.isfinite(self.strength) and self.strength > 0.0):
            faults.append(f"strength is {self.strength}: give a factor above zero")
        if not (np.isfinite(self.duration) and self.duration >= 0.6):
            faults.append(f"duration is {self.duration} s: give 0.6 s or more, so that a window of 0.5 s fits in")
        if self.housing not in ("flexible", "rigid", "clamped"):
            faults.append(f"housing is '{self.housing}': take flexible, rigid or clamped")
        if faults:
            raise BenchError(faults)

    def stream(self, number: int) -> np.random.Generator:
        """Random numbers for one purpose: a change of one thing leaves all others as they are."""
        return np.random.default_rng([int(self.seed), number])

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is recorded."""
        slow = (
            Channel(signal="speed", column="speed_rpm", unit="rad/s", measured_unit="rpm", noise=0.02, resolution=0.01),
            Channel(
                signal="torque", column="load_torque_Nm", unit="N*m", measured_unit="N*m", noise=0.2, resolution=0.05
            ),
        )
        fast = tuple(
            Channel(
                signal=name,
                column=f"{name} [m/s2]",
                unit="m/s**2",
                measured_unit="m/s**2",
                noise=self.noise,
                resolution=2e-3,
                analogue=True,
            )
            for name in ACCELEROMETERS
        )
        return slow + fast + ((TRANSMISSION_ERROR,) if self.encoders else ())

    def true_values(self) -> dict[str, float]:
        """Contact parameters of the rig, drawn within the ranges that the study allows."""
        rng = self.stream(1)
        return {name: float(rng.uniform(low, high)) for name, low, high, _ in TRUE_RANGES}

    def faults_of(self, hide: Sequence[str]) -> list[HiddenFault]:
        """Everything that the stage has and the model lacks: what is hidden first, then manufacturing errors.

        Raises
        ------
        BenchError
            With every kind or place that does not exist.
        """
        hidden = choose(hide, self.stream(2), self.strength)
        places = {(fault.kind.kind, fault.where) for fault in hidden}
        usual = [f for f in manufacturing(self.stream(3), self.manufacturing) if (f.kind.kind, f.where) not in places]
        return hidden + usual


@dataclass(frozen=True, eq=False, kw_only=True)
class RigRecording:
    """One recording of the rig.

    Parameters
    ----------
    name : str
    stamps : ndarray, shape (n,), s
    columns : dict of str to ndarray, shape (n,)
        As they are written.
    reported, true : OperatingCondition
        What the rig's display says, and what it was.
    identify : bool
    """

    name: str
    stamps: Array
    columns: dict[str, Array]
    reported: OperatingCondition
    true: OperatingCondition
    identify: bool

    def recording(self, sensors: Sequence[str] = ACCELEROMETERS) -> Recording:
        """The same as the updating chain takes it, without a file."""
        rate = 1.0 / float(self.stamps[1] - self.stamps[0])
        signals = {s: Signal(self.columns[f"{s} [m/s2]"], rate, name=s, unit="m/s**2") for s in sensors}
        return Recording(self.reported, signals)

    def transmission_error(self) -> Signal:
        """What the encoders saw, m; only of a rig that has them."""
        rate = 1.0 / float(self.stamps[1] - self.stamps[0])
        values = 1e-6 * self.columns[TRANSMISSION_ERROR.column]
        return Signal(values, rate, name=TRANSMISSION_ERROR.signal, unit="m")


def true_stage(rig: GearRig, faults: Sequence[HiddenFault]) -> tuple[GearStage, dict[str, float]]:
    """The stage on the rig and the values of its parameters by full name."""
    from gearbox.stage.model import Structure
    from gearbox.stage.stage import GearStage

    pits = any(f.kind.kind == "bearing_defect" for f in faults)
    structure = Structure(housing=rig.housing, imperfect=bool(faults), bearing_defects=pits)
    stage = GearStage(None, structure, name="rig of a gear stage")
    mesh = stage.components["mesh"]
    for fault in faults:
        mesh.tables.update(fault.patterns(TEETH))
    values = stage.values(**rig.true_values())
    for fault in faults:
        for name, value in fault.values().items():
            values[name] = values.get(name, 0.0) + value if name.endswith(("clearance", "unbalance")) else value
    return stage, values


def _sensor_path(rig: GearRig, number: int, values: Array, step: float) -> Array:
    """What mounting and cable do to an accelerometer's signal: a resonance, a gain error, a delay."""
    from scipy.signal import bilinear, lfilter

    if rig.path == 0.0:
        return values
    rng = rig.stream(500 + number)
    frequency = 2.0 * np.pi * rng.uniform(5.0e3, 8.0e3)
    damping = rng.uniform(0.04, 0.08)
    gain = 1.0 + rig.path * rng.uniform(-0.06, 0.06)
    delay = rig.path * rng.uniform(10e-6, 40e-6)
    b, a = bilinear([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2], 1.0 / step)
    seen = lfilter(b, a, values - values[0]) + values[0]
    mixed = values + min(rig.path, 1.0) * (seen - values)
    t = np.arange(values.size) * step
    return np.asarray(gain * np.interp(t - delay, t, mixed))


def record(
    rig: GearRig, hide: Sequence[str] = (), progress: Progress = silent
) -> tuple[list[RigRecording], list[HiddenFault]]:
    """Run the rig at every condition; returns the recordings and what the stage has that the model lacks."""
    from multibody.base.units import convert

    faults = rig.faults_of(hide)
    stage, values = true_stage(rig, faults)
    stamps = rig.logger.stamps(rig.duration)[:-1]
    before = 0.05
    fine = rig.logger.fine_grid(rig.duration, before)
    step = float(fine[1] - fine[0])
    recordings = []
    for k, (name, rpm, torque, identify) in enumerate(rig.conditions):
        progress(f"recording {k + 1} of {len(rig.conditions)}: {name}")
        draws = rig.stream(100 + k)
        # A drive holds its set speed to a few hundredths of a per cent, and the load to a few tenths.
        true = OperatingCondition(
            rpm * (1.0 + 3e-4 * draws.uniform(-1, 1)), torque * (1.0 + 3e-3 * draws.uniform(-1, 1))
        )
        angle, phase = draws.uniform(0.0, 2.0 * np.pi, 2)
        omega = true.speed_rpm * np.pi / 30.0
        span = float(fine[-1] - fine[0])
        beginning = float(fine[0])
        grid = np.linspace(beginning - 0.2, float(fine[-1]), 200)
        slow = omega * (1.0 + rig.wander * np.sin(2.0 * np.pi * 0.9 * grid + phase))
        run = stage.simulate(
            true.speed_rpm,
            true.load_Nm,
            span + step,
            rate=1.0 / step,
            parameters=values,
            angle=float(angle),
            inputs={"speed": (grid - beginning, slow)},
            method="DormandPrince54",
            rtol=1e-7,
            atol=1e-10,
        )
        rng = rig.stream(300 + k)
        columns: dict[str, Array] = {}
        for number, channel in enumerate(rig.channels):
            if channel.signal == "torque":
                seen = np.full(fine.size, true.load_Nm)
            elif channel.signal == "speed":
                seen = np.full(fine.size, convert(rpm, "rpm", "rad/s"))
            else:
                seen = np.asarray(run[channel.signal])[: fine.size]
                if channel is not TRANSMISSION_ERROR:
                    seen = _sensor_path(rig, number, seen, step)
            columns[channel.column] = rig.logger.read(channel, fine[: seen.size], seen, stamps, rng)
        plain = name.partition("_")[2].lstrip("0123456789_").replace("_", " ")
        reported = OperatingCondition(rpm, torque, plain)
        recordings.append(
            RigRecording(name=name, stamps=stamps, columns=columns, reported=reported, true=true, identify=identify)
        )
    return recordings, faults


def truth(
    rig: GearRig, recordings: Sequence[RigRecording], faults: Sequence[HiddenFault], hidden: int
) -> dict[str, Any]:
    """What ``truth.json`` holds; the first ``hidden`` faults were asked for."""
    units = {name: unit for name, _, _, unit in TRUE_RANGES}
    return {
        "synthetic": True,
        "machine": "gear",
        "seed": int(rig.seed),
        "effects": [f.truth() for f in faults[:hidden]],
        "manufacturing": [f.truth() for f in faults[hidden:]],
        "perturbed": {n: {"value": v, "unit": units[n]} for n, v in rig.true_values().items()},
        "conditions": {
            r.name: {"reported_rpm": r.reported.speed_rpm, "true_rpm": r.true.speed_rpm, "true_load_Nm": r.true.load_Nm}
            for r in recordings
        },
        "noise": {"value": rig.noise, "unit": "m/s**2"},
        "sensor_path": rig.path,
        "strength": rig.strength,
    }
