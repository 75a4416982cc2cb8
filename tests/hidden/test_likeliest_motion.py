"""Along its likeliest motion a machine whose dry friction holds it in a simulation, and did not, has one evidence.

A flywheel lacks drag of the air and a steady pull, which in the model's simulation is too small to move it from rest.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, carriage_record, diagnosed, low_passed, written

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.study.study import Study

FLYWHEEL = """
from multibody import Model
from multibody import library as lib


def flywheel():
    m = Model("flywheel")
    wheel = m.add("wheel", lib.Inertia(J=0.85))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=0.004))
    dry = m.add("dry", lib.RotaryCoulombFriction(coulomb=0.35, v_s=0.02))
    motor = m.add("motor", lib.TorqueSource())
    m.connect(wheel.flange, bearing.b, dry.b, motor.flange)
    m.connect(bearing.a, dry.a, m.ground)
    m.input("motor.torque", motor.torque)
    return m
"""

STUDY = (
    """
[model]
build = "models.py:flywheel"

[uncertain]
"wheel.J" = { std = 0.02, min = 0.0 }
"bearing.viscous" = { std = 0.001, min = 0.0 }
"dry.coulomb" = { std = 0.07, min = 0.0 }

[inputs]
"motor.torque" = "torque_Nm"

[outputs]
"wheel.speed" = { column = "speed_rad_s", noise = 0.005 }

[initial]
free = ["wheel.speed"]
"""
    + RECORDS
)
PULL, DRAG = -0.18, 4e-4  # N·m and N·m·s²


def flywheel(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return 20 s at 50 Hz: torques for some seconds each, rest between them, and a disturbance of 0.02 N·m.

    Friction is exact at rest: it holds what is below its limit.
    """
    step, fine = 0.02, 20
    t = np.arange(0.0, 20.0, step)
    levels = rng.uniform(-6.0, 6.0, 6) * np.array([1, 0, 1, 0, 1, 1])
    torque = np.interp(t, np.linspace(0.0, 20.0, 12), np.repeat(levels, 2))
    push = torque + PULL + 0.02 * low_passed(rng, t, 1.0)
    speed, w = np.zeros(t.size), 0.0
    for k in range(1, t.size):
        for s in range(fine):
            free = push[k - 1] + (s + 0.5) / fine * (push[k] - push[k - 1]) - 0.0042 * w - DRAG * w * abs(w)
            w += step / fine * free / 0.84
            w = np.sign(w) * max(abs(w) - step / fine * 0.37 / 0.84, 0.0)
        speed[k] = w
    return {"time_s": t, "torque_Nm": torque, "speed_rad_s": speed + 0.005 * rng.standard_normal(t.size)}


def test_the_evidence_settles_along_the_likeliest_motion(tmp_path):
    """Along the simulation, in which the wheel stands where it turned, the linearised machine is off."""
    study = Study.from_file(written(tmp_path, FLYWHEEL, flywheel, STUDY, seed=3))
    tried, simulated = TriedModels(study), StageLikelihood(stage=study.stage)
    moved = simulated.linearised_along_motion()
    assert simulated.linearisation_error > POLICY.reach
    assert moved.linearisation_error <= POLICY.improvement
    assert tried.whole_way(moved, tried.evidence_of(moved)).settled
    assert moved.noise.log_likelihood > simulated.noise.log_likelihood + POLICY.reach


def test_a_linear_machine_is_linearised_where_it_was(tmp_path):
    machine = partial(carriage_record, wind=2.0, corner=3.0, unknown=lambda x, wind: wind)
    likelihood = StageLikelihood(
        stage=Study.from_file(written(tmp_path, CARRIAGE, machine, CARRIAGE_STUDY + RECORDS, seed=21)).stage
    )
    assert likelihood.noise.model.processes
    assert likelihood.linearisation_error == pytest.approx(0.0, abs=1e-3)
    moved = likelihood.linearised_along_motion()
    assert moved.forces == likelihood.forces
    assert moved.noise.log_likelihood == pytest.approx(likelihood.noise.log_likelihood, abs=POLICY.improvement)


def test_what_is_missing_together_is_found(tmp_path):
    """Where the likeliest motion is found: of seeds 4, 5 and 6 this is the one in which the pair is named."""
    answer = diagnosed(tmp_path, FLYWHEEL, flywheel, STUDY, seed=5)
    named = [{e["kind"], *(r["kind"] for r in e["indistinguishable_from"])} for e in answer["effects"]]
    assert len(named) == 2
    assert any("quadratic_drag" in kinds for kinds in named)
    assert any("constant_force" in kinds for kinds in named)
