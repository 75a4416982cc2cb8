"""Each kind of the wider catalogue is hidden in a small machine, and the scan ranks it first or in the tie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from discrepancy.effects.built_in_kinds import BUILT_IN_KINDS
from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.sensitivities.candidates import candidate_sensitivities
from discrepancy.statistics.scan import scan
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from estimation.response.sensors import SensorError, apply_sensors
from multibody import Model
from multibody import library as lib


def model_of(parts: dict[str, Any], *connections: Sequence[str], inputs: dict[str, str]) -> Model:
    """Return a model; ``"ground"`` stands for the ground."""
    model = Model("machine")
    for name, part in parts.items():
        model.add(name, part)
    for ends in connections:
        model.connect(*ends)
    for name, target in inputs.items():
        model.input(name, target)
    return model


@cache
def slide() -> Model:
    """A carriage on a guide with friction, pushed; the temperature of the guide is recorded."""
    return model_of(
        {
            "body": lib.Mass(m=5.0),
            "guide": lib.CoulombFriction(coulomb=3.0, v_s=2e-3),
            "oil": lib.ViscousFriction(viscous=20.0),
            "push": lib.ForceSource(),
            "gauge": lib.RecordedTemperature(),
        },
        ("body.flange", "guide.b", "oil.b", "push.flange"),
        ("guide.a", "oil.a", "ground"),
        inputs={"force": "push.force", "warmth": "gauge.recorded"},
    )


@cache
def mount() -> Model:
    """A mass on a spring, shaken."""
    return model_of(
        {
            "body": lib.Mass(m=2.0),
            "mount": lib.SpringDamper(stiffness=800.0, damping=8.0),
            "push": lib.ForceSource(),
            "gauge": lib.RecordedTemperature(),
        },
        ("body.flange", "mount.b", "push.flange"),
        ("mount.a", "ground"),
        inputs={"force": "push.force", "warmth": "gauge.recorded"},
    )


@cache
def hoist() -> Model:
    """A carriage that is pulled by a rope under a load that varies."""
    return model_of(
        {
            "motor": lib.VelocitySource(time_constant=5e-3),
            "rope": lib.SpringDamper(stiffness=2e4, damping=60.0),
            "body": lib.Mass(m=8.0),
            "guide": lib.ViscousFriction(viscous=10.0),
            "payload": lib.ForceSource(),
        },
        ("motor.flange", "rope.b"),
        ("rope.a", "body.flange", "guide.b", "payload.flange"),
        ("guide.a", "ground"),
        inputs={"speed": "motor.reference", "load": "payload.force"},
    )


@cache
def dc_motor() -> Model:
    return model_of(
        {
            "motor": lib.DCMotorDrive(R=1.2, L=2e-3, k_t=0.08),
            "rotor": lib.Inertia(J=4e-4),
            "bearing": lib.RotaryViscousFriction(viscous=2e-4),
        },
        ("motor.flange", "rotor.flange", "bearing.b"),
        ("bearing.a", "ground"),
        inputs={"voltage": "motor.voltage"},
    )


@cache
def synchronous_motor() -> Model:
    return model_of(
        {
            "motor": lib.PMSM(R=0.8, L_d=3e-3, L_q=3e-3, psi=0.05, pole_pairs=4.0),
            "rotor": lib.Inertia(J=2e-3),
            "bearing": lib.RotaryViscousFriction(viscous=5e-3),
        },
        ("motor.flange", "rotor.flange", "bearing.b"),
        ("bearing.a", "ground"),
        inputs={"V_d": "motor.V_d", "V_q": "motor.V_q"},
    )


@cache
def tanks() -> Model:
    """A pump fills a tank that empties through a pipe into another one with a drain."""
    return model_of(
        {
            "pump": lib.FlowSource(),
            "upper": lib.Tank(area=0.02, level=0.6),
            "pipe": lib.Pipe(resistance=2e7),
            "lower": lib.Tank(area=0.03, level=0.2),
            "drain": lib.Orifice(area=6e-5),
        },
        ("pump.a", "drain.b", "ground"),
        ("pump.b", "upper.port", "pipe.a"),
        ("pipe.b", "lower.port", "drain.a"),
        inputs={"flow": "pump.flow"},
    )


@cache
def oven() -> Model:
    """A heated plate beside a body."""
    return model_of(
        {
            "heater": lib.HeatSource(),
            "plate": lib.HeatCapacity(capacity=400.0),
            "gap": lib.ThermalConductance(conductance=2.0),
            "body": lib.HeatCapacity(capacity=900.0),
            "hall": lib.FixedTemperature(),
            "wall": lib.ThermalConductance(conductance=0.8),
        },
        ("heater.port", "plate.port", "gap.a"),
        ("gap.b", "body.port", "wall.a"),
        ("wall.b", "hall.port"),
        inputs={"heat": "heater.heat"},
    )


@cache
def speed_loop() -> Model:
    """A rotor whose speed is controlled by a torque."""
    return model_of(
        {
            "control": lib.PI(k_p=0.05, k_i=0.3, input_unit="rad/s", output_unit="N*m"),
            "motor": lib.TorqueSource(),
            "rotor": lib.Inertia(J=2e-3),
            "bearing": lib.RotaryViscousFriction(viscous=2e-3),
            "gauge": lib.SpeedSensor(),
        },
        ("motor.flange", "rotor.flange", "bearing.b", "gauge.flange"),
        ("bearing.a", "ground"),
        ("gauge.speed", "control.measured"),
        ("control.output", "motor.torque"),
        inputs={"reference": "control.reference"},
    )


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine, what drives it, what is measured with which noise, and what calibration may move."""

    model: Callable[[], Model]
    drive: dict[str, tuple[str, Callable[[np.random.Generator, np.ndarray], np.ndarray]]]
    noise: dict[str, float]
    uncertain: tuple[tuple[str, float], ...]
    step: float = 5e-3
    rows: int = 900


def steps(size: float, hold: int, around: float = 0.0) -> Callable[[np.random.Generator, np.ndarray], np.ndarray]:
    """Return levels that are held, with slopes of a tenth of that between them."""

    def drawn(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
        levels = around + size * rng.uniform(-1.0, 1.0, time.size // hold + 2)
        k = np.arange(time.size) / hold
        return (
            np.interp(k % 1.0, [0.0, 0.9, 1.0], [0.0, 0.0, 1.0]) * (levels[k.astype(int) + 1] - levels[k.astype(int)])
            + levels[k.astype(int)]
        )

    return drawn


def waves(size: float, *hertz: float) -> Callable[[np.random.Generator, np.ndarray], np.ndarray]:
    def drawn(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
        return size * sum(np.sin(2.0 * np.pi * f * time + rng.uniform(0.0, 6.0)) for f in hertz)

    return drawn


def warming(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """Return a temperature that rises by some 20 K, not in proportion to time."""
    return 293.15 + rng.uniform(15.0, 25.0) * np.sin(0.5 * np.pi * time / time[-1]) ** 2 * rng.choice((1.0, -0.5))


PUSHED = {"force": ("N", waves(9.0, 0.5, 1.1, 1.9)), "warmth": ("K", warming)}
SLIDE = Machine(model=slide, drive=PUSHED, noise={"body.velocity": 4e-3}, uncertain=(("body.m", 0.2),))
MOUNT = Machine(
    model=mount,
    drive={"force": ("N", waves(9.0, 0.7, 2.3, 3.4, 5.1)), "warmth": ("K", warming)},
    noise={"body.position": 1e-4},
    uncertain=(("mount.stiffness", 20.0), ("mount.damping", 1.0)),
)
HOIST = Machine(
    model=hoist,
    drive={"speed": ("m/s", steps(0.3, 60)), "load": ("N", steps(60.0, 110, -70.0))},
    noise={"rope.tension": 0.2, "body.position": 2e-5},
    uncertain=(("body.m", 0.3), ("guide.viscous", 3.0)),
)
DC = Machine(
    model=dc_motor,
    drive={"voltage": ("V", steps(8.0, 60))},
    noise={"rotor.speed": 0.1, "motor.i": 0.02},
    uncertain=(("rotor.J", 2e-5), ("bearing.viscous", 5e-5)),
    rows=700,
)
PM = Machine(
    model=synchronous_motor,
    drive={"V_d": ("V", steps(1.5, 50)), "V_q": ("V", steps(8.0, 70))},
    noise={"rotor.speed": 0.02, "motor.i_q": 0.02, "motor.i_d": 0.02},
    uncertain=(("rotor.J", 1e-4), ("bearing.viscous", 5e-4)),
    rows=700,
)
TANKS = Machine(
    model=tanks,
    drive={"flow": ("m**3/s", steps(1.2e-4, 60, 1.6e-4))},
    noise={"upper.level": 1e-3, "lower.level": 1e-3},
    uncertain=(("drain.area", 3e-6),),
    step=1.0,
    rows=800,
)
OVEN = Machine(
    model=oven,
    drive={"heat": ("W", steps(150.0, 60, 180.0))},
    noise={"plate.temperature": 0.1, "body.temperature": 0.1},
    uncertain=(("gap.conductance", 0.1),),
    step=5.0,
    rows=600,
)
LOOP = Machine(
    model=speed_loop,
    drive={"reference": ("rad/s", steps(30.0, 60))},
    noise={"rotor.speed": 0.02, "control.output": 2e-3},
    uncertain=(("rotor.J", 1e-4), ("bearing.viscous", 2e-4)),
)


def record(machine: Machine, hidden: Effect, name: str, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    time = np.arange(machine.rows) * machine.step
    given = {n: (unit, drawn(rng, time)) for n, (unit, drawn) in machine.drive.items()}
    true = hidden.added_to(machine.model()).build(outputs=tuple(machine.noise))
    inputs = {n: (time, values) for n, (_, values) in given.items()}
    run = true.simulate(float(time[-1]), inputs=inputs, times=time, rtol=1e-7, atol=1e-10)
    y = np.column_stack([run[n] for n in machine.noise])
    sensor = hidden.sensor_error()
    errors: list[SensorError] = [sensor] if sensor is not None else []
    y = apply_sensors(tuple(machine.noise), time, y, np.zeros((*y.shape, 0)), errors, ())[0]
    signals = {
        n: RecordedSignal(values=values, unit=unit, column=n, measured_unit=unit) for n, (unit, values) in given.items()
    }
    for c, (output, size) in enumerate(machine.noise.items()):
        unit = true.unit(output)
        signals[output] = RecordedSignal(
            values=y[:, c] + size * rng.standard_normal(time.size), unit=unit, column=output, measured_unit=unit
        )
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


def scanned(machine: Machine, hidden: Effect) -> Any:
    model = machine.model()
    records = [record(machine, hidden, f"run{k}", k) for k in range(3)]
    experiments = make_experiments(model, records, list(machine.drive), list(machine.noise))
    declared = {q.name: q for q in model.build().parameters}
    uncertain = tuple(
        UncertainParameter(name=n, value=declared[n].value, std=std, min=0.0, max=np.inf, unit=declared[n].unit)
        for n, std in machine.uncertain
    )
    problem = Problem(name="machine", model=model, uncertain=uncertain, identify=experiments, residual="simulation")
    stage = Study(problem).stage
    linearised = stage.linearised_problem(stage.scan_preparation)
    entries = catalogue(stage.system, list(machine.noise), list(machine.drive))
    candidates, _ = candidate_sensitivities(linearised, entries)
    return scan(linearised.residual(), linearised.sensitivities(), candidates, draws=60, seed=1)


def at_place(machine: Machine, kind: str, where: str, strengths: dict[str, float], **shape: float) -> Effect:
    entries = catalogue(machine.model().build(probes=True), list(machine.noise), list(machine.drive))
    entry = next(e for e in entries if e.name == f"{kind}@{where}")
    if entry.place is None:
        return Effect(kind=kind, where=where, strengths=strengths, shape=shape)
    return Effect.at_place(kind, entry.place, strengths=strengths, shape=shape, load=entry.load)


def test_what_an_effect_has_put_in_is_no_place_for_another():
    """It goes with that effect, and the model without it would have an effect at nothing."""
    effect = at_place(MOUNT, "input_lag", "force", {"lag": 8e-3}, filter=8e-3)
    model = effect.added_to(MOUNT.model())
    entries = catalogue(model.build(probes=True), list(MOUNT.noise), list(MOUNT.drive))
    assert effect.component_name in model.components
    assert [e.name for e in entries if effect.component_name in e.where] == []


CASES = [
    (SLIDE, "friction_drift", "guide", {"rate": 0.2}, {"v_s": 2e-3}),
    (SLIDE, "viscous_drift", "guide", {"rate": -0.8}, {}),
    (SLIDE, "friction_with_temperature", "guide", {"slope": 0.03}, {"v_s": 2e-3}),
    (SLIDE, "viscous_with_temperature", "guide", {"slope": -0.15}, {}),
    (SLIDE, "attached_mass", "guide", {"mass": 0.6}, {"natural_frequency": 8.3, "damping_ratio": 0.04}),
    (MOUNT, "stiffness_drift", "mount", {"rate": -30.0}, {}),
    (MOUNT, "stiffness_with_temperature", "mount", {"slope": -5.0}, {}),
    (MOUNT, "attached_mass", "mount", {"mass": 0.15}, {"natural_frequency": 27.0, "damping_ratio": 0.05}),
    (MOUNT, "sensor_lag", "body.position", {"lag": 2e-3}, {}),
    (MOUNT, "input_lag", "force", {"lag": 8e-3}, {"filter": 8e-3}),
    (HOIST, "stribeck_load_friction", "guide", {"share": 0.15}, {"v_stribeck": 0.03, "v_s": 2e-3}),
    (HOIST, "directional_load_friction", "guide", {"driving": 0.15, "resisting": 0.03}, {"v_s": 2e-3}),
    (HOIST, "quadratic_load_friction", "guide", {"curve": 1e-3}, {"v_s": 2e-3}),
    (DC, "brush_voltage_drop", "motor", {"brush_drop": 0.8}, {"i_brush": 0.05}),
    (PM, "inverter_dead_time", "motor", {"dead_time_drop": 0.5}, {"i_dead": 0.05}),
    (TANKS, "laminar_leakage", "upper", {"leak": 6e-9}, {}),
    (TANKS, "turbulent_leakage", "upper", {"leak_turbulent": 6e-7}, {}),
    (TANKS, "flow_loss", "pipe", {"quadratic_loss": 3e10}, {}),
    (OVEN, "heat_loss", "plate", {"loss_conductance": 0.4}, {}),
    (OVEN, "radiation_loss", "plate", {"radiation": 3e-9}, {}),
    (LOOP, "input_delay", "control.output", {"lag": 8e-3}, {"filter": 4e-3}),
]


@pytest.mark.parametrize(("machine", "kind", "where", "strengths", "shape"), CASES, ids=[c[1] for c in CASES])
def test_the_kind_that_is_hidden_is_first_or_in_the_tie(machine, kind, where, strengths, shape):
    found = scanned(machine, at_place(machine, kind, where, strengths, **shape))
    assert found.best is not None
    assert f"{kind}@{where}" in found.ties.names


@pytest.mark.parametrize(("machine", "kind", "where", "strengths", "shape"), CASES, ids=[c[1] for c in CASES])
def test_strength_zero_is_absence_to_the_last_bit(machine, kind, where, strengths, shape):
    absent = at_place(machine, kind, where, dict.fromkeys(strengths, 0.0), **shape)
    without = machine.model().build(outputs=tuple(machine.noise))
    with_it = absent.added_to(machine.model()).build(outputs=tuple(machine.noise))
    own = [with_it.index("state", n) for n in without.state_names]
    rng = np.random.default_rng(3)
    for _ in range(20):
        x = rng.standard_normal(len(with_it.states)) + 2.0  # a level or a temperature above zero
        u = rng.standard_normal(len(without.inputs))
        assert np.array_equal(with_it.rhs(1.5, x, u)[own], without.rhs(1.5, x[own], u))
        assert np.array_equal(with_it.outputs_at(1.5, x, u), without.outputs_at(1.5, x[own], u))


def test_every_built_in_kind_is_hidden_here():
    assert {kind.name for kind in BUILT_IN_KINDS} <= {case[1] for case in CASES}
