"""Free rotations: angles that only count turns are distinguished from those on which the machine depends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.residual.free_rotations import free_rotations
from discrepancy.residual.initial_state import estimate_states
from discrepancy.residual.residual_mode import prepared_problem
from estimation.files.record import Record, RecordedSignal
from multibody import Model
from multibody import library as lib

TIME = np.arange(0.0, 6.0, 0.005)


def fan() -> Model:
    """A motor that drives a rotor by its voltage."""
    model = Model("fan")
    drive = model.add("motor", lib.DCMotorDrive(R=1.2, k_t=0.08, inductive=False))
    rotor = model.add("rotor", lib.Inertia(J=4e-4))
    bearing = model.add("bearing", lib.RotaryViscousFriction(viscous=2e-4))
    model.connect(drive.flange, rotor.flange, bearing.b)
    model.connect(bearing.a, model.ground)
    model.input("drive.signal", drive.voltage)
    return model


def two_rotors() -> Model:
    """Two rotors with a spring between them."""
    model = Model("two rotors")
    drive = model.add("drive", lib.TorqueSource())
    rotor, other = model.add("rotor", lib.Inertia(J=2e-3)), model.add("other", lib.Inertia(J=8e-3))
    shaft = model.add("shaft", lib.TorsionSpring(stiffness=120.0))
    bearing = model.add("bearing", lib.RotaryViscousFriction(viscous=0.01))
    model.connect(drive.flange, rotor.flange, shaft.a)
    model.connect(shaft.b, other.flange, bearing.b)
    model.connect(bearing.a, model.ground)
    model.input("drive.signal", drive.torque)
    return model


def pendulum() -> Model:
    """A pendulum that is pushed."""
    model = Model("pendulum")
    drive = model.add("drive", lib.TorqueSource())
    rotor = model.add("rotor", lib.Pendulum(J=0.05, m=0.5, arm=0.3))
    bearing = model.add("bearing", lib.RotaryViscousFriction(viscous=0.02))
    model.connect(drive.flange, rotor.flange, bearing.b)
    model.connect(bearing.a, model.ground)
    model.input("drive.signal", drive.torque)
    return model


def recorded(model: Model, signal: np.ndarray, unit: str):
    """Return a record of the angle and the speed of a rotor."""
    outputs = ("rotor.angle", "rotor.speed")
    run = model.build(outputs=outputs).simulate(TIME[-1], inputs={"drive.signal": (TIME, signal)}, times=TIME)
    rng = np.random.default_rng(3)
    signals = {"drive.signal": RecordedSignal(values=signal, unit=unit, column="u", measured_unit=unit)}
    for name, unit_of, noise in zip(outputs, ("rad", "rad/s"), (1e-3, 0.1), strict=True):
        signals[name] = RecordedSignal(
            values=run[name] + noise * rng.standard_normal(TIME.size), unit=unit_of, column=name, measured_unit=unit_of
        )
    record = Record(name="run", path=Path("run.csv"), time=TIME, signals=signals)
    return make_experiments(model, [record], ("drive.signal",), outputs)


@pytest.mark.parametrize(
    ("build", "size", "unit", "turns"),
    [
        (fan, 12.0, "V", ["rotor.angle"]),
        (two_rotors, 0.5, "N*m", ["rotor.angle", "other.angle"]),
        (pendulum, 0.4, "N*m", []),
    ],
)
def test_angles_that_nothing_depends_on_rotate_freely(build, size, unit, turns):
    model = build()
    (experiment,) = recorded(model, size * np.sin(1.3 * TIME) + 0.3 * size * np.sin(0.4 * TIME), unit)
    system = model.build(outputs=experiment.outputs)
    states, outputs = free_rotations([estimate_states(experiment, system, system.p)])
    assert sorted(n for n, free in zip(system.state_names, states, strict=True) if free) == sorted(turns)
    assert dict(zip(experiment.outputs, outputs, strict=True)) == {
        "rotor.angle": "rotor.angle" in turns,
        "rotor.speed": False,
    }


def test_a_rotor_whose_angle_is_recorded_is_simulated():
    """A thousandth of the voltage turns it by more than a radian, and changes nothing else."""
    model = fan()
    experiments = recorded(model, 12.0 * np.sin(1.3 * TIME) + 4.0, "V")
    assert np.ptp(experiments[0].record.signals["rotor.angle"].values) > 200.0
    assert prepared_problem(Problem(name="fan", model=model, uncertain=(), identify=experiments)).mode == "simulation"
