"""The virtual lift: a rig of the scaled lift bench with 37 states, richer than any model under test.

Its guides are misaligned, its gear has losses, its load changes from trip to trip, its parameters differ from the
nominal ones, a force disturbs it, and the recordings pass through sensors and a logger.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.recording import Channel, Logger, RigDisturbance
from discrepancy.rigs.rig import Rig, Run
from estimation.fit.calibrate import UncertainParameter
from estimation.response.sensors import SensorError
from multibody.base.progress import Progress, Step
from multibody.machine.model import Model, System
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift
from vtsdt.rig.models import MODELS, build, with_rails
from vtsdt.rig.parts import with_gear_loss
from vtsdt.rig.rails import RailSpectrum, draw_rails, rail_tables
from vtsdt.rig.trips import CYCLE, ReferenceTrip, draw_trip, express

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from multibody.system.trajectory import Trajectory

__all__ = ["BEFORE", "SENSED", "LiftRig", "seen_by", "sources"]

#: Time under control before a record, s.
BEFORE = 1.0
#: Standard deviation of the accelerometer's offset, m/s²; every study estimates it.
ACCELEROMETER_OFFSET = 0.03

#: Streams of random numbers.
_PARAMETERS, _RAILS, _SENSORS = 1, 2, 3
_CHANNELS = {
    "omega_ref": Channel(
        signal="omega_ref",
        column="pulley_speed_ref_rad_per_s",
        unit="rad/s",
        measured_unit="rad/s",
        resolution=1e-6,
        exact=True,
    ),
    "tau_L": Channel(
        signal="tau_L",
        column="gear_loss_torque_Nm",
        unit="N*m",
        measured_unit="N*m",
        noise=2e-3,
        resolution=1e-3,
        analogue=True,
    ),
    "friction_c": Channel(
        signal="friction_c",
        column="guide_force_c_N",
        unit="N",
        measured_unit="N",
        noise=0.02,
        resolution=5e-3,
        analogue=True,
    ),
    "friction_cw": Channel(
        signal="friction_cw",
        column="guide_force_cw_N",
        unit="N",
        measured_unit="N",
        noise=0.02,
        resolution=5e-3,
        analogue=True,
    ),
    "payload": Channel(
        signal="payload", column="payload_kg", unit="kg", measured_unit="kg", resolution=1e-3, exact=True
    ),
    "omega": Channel(
        signal="omega",
        column="pulley_speed_rad_per_s",
        unit="rad/s",
        measured_unit="rad/s",
        noise=2e-3,
        resolution=1e-3,
    ),
    "pulley.angle": Channel(
        signal="pulley.angle", column="pulley_angle_rad", unit="rad", measured_unit="rad", noise=5e-5, resolution=1e-4
    ),
    "i_q": Channel(
        signal="i_q", column="current_q_A", unit="A", measured_unit="A", noise=5e-3, resolution=1e-3, analogue=True
    ),
    "F_c": Channel(
        signal="F_c", column="tension_c_N", unit="N", measured_unit="N", noise=0.3, resolution=0.05, analogue=True
    ),
    "F_cw": Channel(
        signal="F_cw", column="tension_cw_N", unit="N", measured_unit="N", noise=0.3, resolution=0.05, analogue=True
    ),
    "a_c": Channel(
        signal="a_c",
        column="cabin_acceleration_m_per_s2",
        unit="m/s**2",
        measured_unit="m/s**2",
        noise=0.01,
        resolution=1e-3,
        analogue=True,
    ),
    "cabin.z": Channel(
        signal="cabin.z", column="cabin_height_mm", unit="m", measured_unit="mm", noise=2e-5, resolution=0.01
    ),
    "counterweight.z": Channel(
        signal="counterweight.z",
        column="counterweight_height_mm",
        unit="m",
        measured_unit="mm",
        noise=2e-5,
        resolution=0.01,
    ),
}
_MEASURED = ("omega", "pulley.angle", "i_q", "F_c", "F_cw", "a_c", "cabin.z", "counterweight.z")
_INPUTS = {
    "one_dimensional": ("omega_ref", "tau_L", "friction_c", "friction_cw", "payload"),
    "reference": ("omega_ref", "tau_L"),
    "cabin": ("F_c",),
}
#: Quantities of the rig that are recorded under another name.
_SOURCES = {"tau_L": "gear_loss.torque", "friction_c": "fric_c", "friction_cw": "fric_cw"}
#: Channels that record an output of the rig.
SENSED = tuple(n for n in _CHANNELS if n not in ("omega_ref", "payload"))
_BODY = ("x", "y", "roll", "pitch", "yaw")
_FREE = {
    "one_dimensional": (
        "pulley.angle",
        "cabin.z",
        "counterweight.z",
        "support.plate_position",
        "support.tilt_B_angle",
        "machine.i_q",
        "control.x_q",
        "control.x_omega",
    ),
    "cabin": ("cabin.z", *(f"cabin.{n}" for n in _BODY)),
}
# Laterally, cabin and counterweight start at rest.  As free initial states these ten are hidden by sticking friction:
# fits then took three times as long and ended with a larger misfit.
_FREE["reference"] = _FREE["one_dimensional"]
#: Parameter, its standard deviation as a share of its nominal value, smallest value, unit.
_ONE = (
    ("cabin.mass", 0.0125, 1.0, "kg"),
    ("counterweight.mass", 0.0125, 1.0, "kg"),
    ("pulley.J_p", 0.04, 1e-3, "kg*m**2"),
    ("ropes.EA", 0.04, 1e4, "N"),
    ("ropes.damping", 0.17, 0.0, "N*s"),
    ("support.stiffness", 0.06, 1e4, "N/m"),
    ("machine.K_T", 0.013, 0.1, "N*m/A"),
)
_GUIDES = (("cabin_guide.mu", 0.07, 0.0, ""), ("cabin_guide.stiffness", 0.04, 1e3, "N/m"))
# The speed at which friction fades is unknown: the rig's is `regularisation` times the model's.
_FADES = (("cabin_guide.v_s", 0.25, 1e-3, "m/s"), ("counterweight_guide.v_s", 0.25, 1e-3, "m/s"))
_UNCERTAIN = {
    "one_dimensional": _ONE,
    "reference": (*_ONE, *_GUIDES, ("counterweight_guide.mu", 0.07, 0.0, ""), *_FADES),
    "cabin": (_ONE[0], *_GUIDES),
}


@dataclass(frozen=True, kw_only=True)
class LiftRig(Rig):
    """Settings of the lift's rig; see `discrepancy.rigs.rig.Rig` for the other settings.

    Parameters
    ----------
    under_test : {"one_dimensional", "reference", "cabin"}
        Model of the study; the rig itself always has 37 states.
    parameters : LiftParameters
        Nominal; their rail profiles are used where ``rails`` is None.
    rails : RailSpectrum or None
        Spectrum from which the rails are drawn; None: the rails of ``parameters``.
    loads : tuple of float, kg
        Payloads, used in turn; only the 1D model has the load as a signal.
    only_express : bool
        All trips from end to end, up and down alternately, as on the paper's bench.
    sensor_noise : mapping of str to float
        Standard deviation instead of the usual one, SI, by signal (`SENSED`).
    configuration : int
        Of the guides; another number is the same lift with other guides, trips and disturbances.
    """

    trips: int = 10
    disturbance: RigDisturbance = field(default_factory=lambda: RigDisturbance(1.0))
    logger: Logger = field(default_factory=lambda: Logger(rate=250.0, fine=16))
    duration: float = 6.0
    under_test: str = "one_dimensional"
    parameters: LiftParameters = field(default_factory=LiftParameters.bench, repr=False)
    rails: RailSpectrum | None = field(default_factory=RailSpectrum)
    loads: tuple[float, ...] = ()
    only_express: bool = False
    configuration: int = 0
    sensor_noise: Mapping[str, float] = field(default_factory=dict)

    machine: ClassVar[str] = "lift"
    prefer: ClassVar[tuple[str, ...]] = ("cabin.z", "F_c", "omega_ref")
    at: ClassVar[str] = "cabin.z"
    #: Clearly visible with a disturbance of 1 N.
    force: ClassVar[float] = 6.0
    visible: ClassVar[Mapping[str, float]] = {
        "omega_ref": 0.02,
        "tau_L": 0.1,
        "friction_c": 2.0,
        "friction_cw": 2.0,
        "payload": 0.2,
        "omega": 0.02,
        "pulley.angle": 0.01,
        "i_q": 0.05,
        "F_c": 3.0,
        "F_cw": 3.0,
        "a_c": 0.1,
        "cabin.z": 1e-3,
        "counterweight.z": 1e-3,
    }

    def faults(self) -> list[str]:
        """Return the faults of the settings."""
        faults = super().faults()
        if self.under_test not in MODELS:
            faults.append(f"--model {self.under_test}: give one of {', '.join(MODELS)}")
        if any(not (np.isfinite(m) and 0.0 <= m <= 20.0) for m in self.loads):
            faults.append(f"loads are {', '.join(f'{m:g}' for m in self.loads)} kg: give 0 to 20 kg")
        if self.under_test != "one_dimensional" and any(self.loads):
            faults.append(
                f"loads of {', '.join(f'{m:g}' for m in self.loads)} kg: only the 1D model takes a load as a signal; "
                "leave --loads out"
            )
        if unknown := [n for n in self.sensor_noise if n not in _CHANNELS]:
            faults.append(f"sensor_noise names {', '.join(unknown)}: there are {', '.join(_CHANNELS)}")
        if self.duration < self.parameters.trip.duration - 0.5:
            faults.append(
                f"duration is {self.duration:g} s: a trip from end to end takes {self.parameters.trip.duration:g} s"
            )
        return faults

    def stream(self, number: int) -> np.random.Generator:
        """Return random numbers for one purpose; true parameters and sensors are the same in all configurations."""
        if self.configuration and number not in (_PARAMETERS, _SENSORS):
            return np.random.default_rng([int(self.seed), number, int(self.configuration)])
        return super().stream(number)

    # ---------------------------------------------------------------- the model under test and what is recorded

    @property
    def model(self) -> Model:
        """The model under test; reference and cabin model have the true rails."""
        return build(self.under_test, **self.model_arguments)

    @property
    def model_arguments(self) -> dict[str, Any]:
        """Arguments of `vtsdt.rig.models.build` besides the model's name."""
        return {} if self.under_test == "one_dimensional" else {"rails": rail_tables(self.profiles)}

    @cached_property
    def profiles(self) -> dict[str, Any]:
        """Profiles of the rig's rails by name."""
        if self.rails is None:
            p = self.parameters
            sides = {"cabin": p.cabin_guide, "counterweight": p.counterweight_guide}
            return {f"{s}.{n}": q for s, g in sides.items() for n, q in g.profiles().items()}
        return draw_rails(self.parameters, self.rails, self.stream(_RAILS))

    @property
    def payloads(self) -> tuple[float, ...]:
        """Payloads, used in turn, kg."""
        return self.loads or ((0.0, 2.0, 4.0) if self.under_test == "one_dimensional" else (0.0,))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Recorded inputs of the model under test."""
        return _INPUTS[self.under_test]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Measured outputs that the model under test has."""
        if self.under_test == "cabin":
            return ("a_c", "cabin.z")
        return _MEASURED

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All recorded channels, independent of the model under test."""
        return tuple(dataclasses.replace(c, noise=self.sensor_noise.get(n, c.noise)) for n, c in _CHANNELS.items())

    @property
    def uncertain(self) -> tuple[UncertainParameter, ...]:
        """Parameters that calibration may change, with the priors from which the true values are drawn."""
        parameters = []
        for name, share, low, unit in _UNCERTAIN[self.under_test]:
            section, key = _section(name)
            value = float(getattr(getattr(self.parameters, section), key))
            parameters.append(
                UncertainParameter(name=name, value=value, std=share * value, min=low, max=np.inf, unit=unit)
            )
        return tuple(parameters)

    @property
    def starts(self) -> tuple[str, ...]:
        """States of the model under test with an unknown initial value."""
        return _FREE[self.under_test]

    def entries(self) -> list[Entry]:
        """Return every effect that fits the machine and that its records can hold.

        The rig records forces that the model takes as inputs: of a lag of such an input, the record had to be the
        inverse, which no sensor gives.
        """
        return [e for e in super().entries() if e.kind.name != "input_lag" or e.where == "omega_ref"]

    # ---------------------------------------------------------------- trips

    def trip(self, number: int) -> ReferenceTrip:
        """Return the trip of a number, from 0."""
        if self.only_express:
            loads = self.payloads
            return express(self.parameters, number % 2 == 0, self.duration, loads[(number // 2) % len(loads)])
        return draw_trip(self.parameters, number, self.stream(100 + number), self.duration, self.payloads)

    def nominal_runs(self, system: System, stamps: np.ndarray) -> list[Trajectory]:
        """Return a trip up of the nominal model under test, with the usual friction where it is an input."""
        trip = express(self.parameters, True, float(stamps[-1]))
        inputs: dict[str, Any] = {"omega_ref": (trip.time, trip.omega), "payload": 2.0}
        moving = np.tanh(trip.omega / 0.1)
        inputs |= {
            "tau_L": (trip.time, -0.6 * moving),
            "friction_c": (trip.time, 7.0 * moving),
            "friction_cw": (trip.time, -4.0 * moving),
        }
        if self.under_test == "cabin":
            full = Lift.reference(with_rails(self.parameters, rail_tables(self.profiles))).trip(
                "up", until=self.duration
            )
            inputs["F_c"] = (full.times, full["F_c"])
        return [
            system.simulate(
                float(stamps[-1]), inputs={n: inputs[n] for n in self.inputs}, times=stamps, rtol=1e-6, atol=1e-9
            )
        ]

    # ---------------------------------------------------------------- the rig itself

    def true_parameters(self, perturbed: Mapping[str, float]) -> LiftParameters:
        """Return the true parameters and rails of the rig's lift."""
        given = with_rails(self.parameters, rail_tables(self.profiles))
        parts: dict[str, dict[str, float]] = {}
        for name, value in perturbed.items():
            section, key = _section(name)
            parts.setdefault(section, {})[key] = value
        changed = {k: dataclasses.replace(getattr(given, k), **v) for k, v in parts.items()}
        return dataclasses.replace(given, **changed)

    def record(
        self,
        perturbed: Mapping[str, float],
        hidden: Sequence[Hidden],
        errors: Sequence[SensorError],
        names: Sequence[str],
        progress: Progress,
    ) -> tuple[Model, list[Run]]:
        """Return the true lift and one run for each name."""
        lift = Lift.reference(self.true_parameters(perturbed), payload=(0.0, 0.0, 0.0, 0.0))
        true_model, recorded = self._hiding(lift.copy(), hidden, errors)
        rig = with_gear_loss(true_model, self.regularisation)
        system = rig.build(outputs=sources())
        stamps, fine = self.logger.stamps(self.duration), self.logger.fine_grid(self.duration, BEFORE)
        runs: list[Run] = []
        for k, name in enumerate(names):
            progress(Step(f"trip {k + 1} of {len(names)}", k, len(names)))
            run = self._run(lift, system, k, fine, hidden)
            runs.append((name, stamps, self._logged(k, stamps, fine, seen_by(run), recorded)))
        return true_model, runs

    def _hiding(
        self, model: Model, hidden: Sequence[Hidden], errors: Sequence[SensorError]
    ) -> tuple[Model, list[SensorError]]:
        """Return the true machine with the hidden effects, and the errors of all sensors."""
        recorded = list(errors)
        for one in hidden:
            effect = one.effect
            if effect is not None and effect.definition.at == "input" and effect.where != "omega_ref":
                recorded += _as_sensor(effect)
            else:
                model = one.added_to(model)
        recorded.append(
            SensorError("a_c", "offset", ACCELEROMETER_OFFSET * float(self.stream(_SENSORS).standard_normal()))
        )
        return model, recorded

    def _disturbance_of(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of the disturbing force of a trip."""
        times = np.arange(-round(BEFORE / CYCLE), self.trip(number).time.size) * CYCLE
        return times, self.disturbance.draw(times.size, CYCLE, self.stream(200 + number))

    def _run(
        self, lift: Lift, system: System, number: int, fine: np.ndarray, hidden: Sequence[Hidden] = (), **inputs: Any
    ) -> Trajectory:
        """Simulate a lift from rest; further inputs are (times, values)."""
        trip = self.trip(number)
        p = {} if "payload" in inputs else {"payload.mass": trip.load}
        lift.payload = (trip.load, 0.0, 0.0, 0.0)
        resting = {"omega_ref": _standstill(hidden), "disturbance.force": 0.0}
        resting |= {n: float(v[1][0]) for n, v in inputs.items()}
        held = [n for h in hidden for n in h.memory]
        start = lift.equilibrium(trip.height, system=system, inputs=resting, parameters=p, hold=held)
        return system.simulate(
            (float(fine[0]), float(fine[-1])),
            inputs={"omega_ref": (trip.time, trip.omega), "disturbance.force": self._disturbance_of(number), **inputs},
            initial=start.state,
            parameters=p,
            times=fine,
            method=self.method,
            rtol=self.rtol,
            atol=self.rtol * 1e-3,
        )

    def _logged(
        self,
        number: int,
        stamps: np.ndarray,
        fine: np.ndarray,
        seen: Mapping[str, np.ndarray],
        errors: Sequence[SensorError],
    ) -> dict[str, np.ndarray]:
        """Return the columns of a trip's recording."""
        trip, rng = self.trip(number), self.stream(300 + number)
        columns = {}
        given = {"omega_ref": np.interp(fine, trip.time, trip.omega), "payload": np.full_like(fine, trip.load)}
        for channel in self.channels:
            values = given[channel.signal] if channel.signal in given else seen[channel.signal]
            columns[channel.column] = self.logger.read(channel, fine, values, stamps, rng, errors)
        return columns

    def more_truth(self) -> dict[str, Any]:
        """Return rails and loads."""
        return {
            "model_under_test": self.under_test,
            "rails": rail_tables(self.profiles),
            "configuration": self.configuration,
            "payload": {"values": list(self.payloads), "unit": "kg"},
        }


def _section(name: str) -> tuple[str, str]:
    """Return section and key of a model parameter in the parameter file."""
    owner, _, key = name.partition(".")
    return ("motor" if owner == "machine" else owner), key


def _standstill(hidden: Sequence[Hidden]) -> float:
    """Return the speed reference, rad/s, at which the drive stands still: a hidden effect may offset it."""
    effects = [h.effect for h in hidden if h.effect is not None and h.effect.where == "omega_ref"]
    strengths = {n: v for e in effects if e.definition.at == "input" for n, v in e.strengths.items()}
    return -float(strengths.get("offset", 0.0)) / (1.0 + float(strengths.get("gain", 0.0)))


def seen_by(run: Trajectory, names: Sequence[str] = SENSED) -> dict[str, np.ndarray]:
    """Return the signals of a run that the sensors of some channels measure."""
    return {n: run[_SOURCES.get(n, n)] for n in names}


def sources(names: Sequence[str] = SENSED) -> list[str]:
    """Return the outputs of the rig for some channels."""
    return [_SOURCES.get(n, n) for n in names]


def _as_sensor(effect: Any) -> list[SensorError]:
    """Return the error of an input's sensor that the effect compensates.

    With the effect the model has the input (1 + gain)·u(t − delay) + offset, so the recording has to be
    u(t + delay)/(1 + gain) − …
    """
    name = effect.definition.strengths[0]
    size = float(effect.strengths[name])
    return [SensorError(effect.where, name, -size / (1.0 + size) if name == "gain" else -size)]
