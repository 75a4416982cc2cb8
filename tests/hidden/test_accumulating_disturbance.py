"""A shaft between two rotors that nothing holds: what disturbs it adds up along the record. From plain equations."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import RECORDS, diagnosed, low_passed, written

from discrepancy.study.study import Study

MODELS = """
from multibody import Model
from multibody import library as lib


def drive():
    m = Model("torsional_drive")
    air = m.add("air_gap", lib.TorqueSource())
    motor = m.add("motor", lib.Inertia(J=0.03))
    shaft = m.add("shaft", lib.TorsionSpring(stiffness=400.0))
    damping = m.add("damping", lib.TorsionDamper(damping=0.3))
    load = m.add("load", lib.Inertia(J=0.12))
    front = m.add("motor_bearing", lib.RotaryViscousFriction(viscous=0.012))
    rear = m.add("load_bearing", lib.RotaryViscousFriction(viscous=0.03))
    m.connect(air.flange, motor.flange, shaft.a, damping.a, front.b)
    m.connect(shaft.b, damping.b, load.flange, rear.b)
    m.connect(front.a, rear.a, m.ground)
    m.input("inverter.torque", air.torque)
    return m
"""

STUDY = """
[model]
build = "models.py:drive"
[uncertain]
"motor.J" = { std = 0.003 }
"load.J" = { std = 0.01 }
"shaft.stiffness" = { std = 40.0 }
"damping.damping" = { std = 0.1, min = 0.0 }
"motor_bearing.viscous" = { std = 0.005, min = 0.0 }
"load_bearing.viscous" = { std = 0.01, min = 0.0 }
[inputs]
"inverter.torque" = "torque_Nm"
[outputs]
"motor.speed" = "speed_rad_per_s"
"load.angle" = "angle_rad"
"""

STEP = 2e-4
PUSH = 0.08  # N·m, standard deviation of the torque that disturbs the load


def low_passed_mean(x: np.ndarray) -> np.ndarray:
    """Return what is slower than a second or so, to be taken out of a torque."""
    width = int(1.5 / STEP)
    return np.convolve(np.pad(x, width, mode="edge"), np.ones(2 * width + 1) / (2 * width + 1), mode="valid")


def drive(rng: np.random.Generator, unbalance: float = 0.0) -> dict[str, np.ndarray]:
    """Two rotors driven by a torque that wanders, the second shaken below 10 Hz and out of balance."""
    t = np.arange(0.0, 12.0, STEP)
    torque = low_passed(rng, t, 4.0)
    torque = 4.0 * (torque - low_passed_mean(torque)) * np.minimum(1.0, t / 0.4)
    push = PUSH * low_passed(rng, t, 10.0)
    J1, J2, k, c, b1, b2 = 0.031, 0.118, 410.0, 0.35, 0.012, 0.035
    p1 = w1 = p2 = w2 = 0.0
    found = np.zeros((t.size, 2))
    for n in range(t.size):  # leap-frog: speeds stand between two angles
        found[n] = w1, p2
        twist = k * (p1 - p2) + c * (w1 - w2)
        w1 += STEP * (torque[n] - b1 * w1 - twist) / J1
        w2 += STEP * (twist - b2 * w2 + push[n] - unbalance * np.sin(p2 + 0.3)) / J2
        found[n, 0] = 0.5 * (found[n, 0] + w1)
        p1 += STEP * w1
        p2 += STEP * w2
    every = slice(None, None, 10)
    speed, angle = found[every].T
    count = 2.0 * np.pi / 20000
    return {
        "time_s": t[every],
        "torque_Nm": torque[every],
        "speed_rad_per_s": speed + 0.02 * rng.standard_normal(speed.size),
        "angle_rad": np.round(angle / count) * count,
    }


OFTEN = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 13) if seed != 1]


def searched(by):
    """Return the study with a search of its own."""
    return f'{STUDY}[study]\nsearch = "{by}"\n{RECORDS}'


@pytest.mark.parametrize("by", ["significance", "evidence"])
@pytest.mark.parametrize("seed", [1, *OFTEN])
def test_an_accumulating_disturbance_is_no_missing_effect(tmp_path, seed, by):
    """Before the disturbance was estimated, the search named an effect in six of these twelve, 1 and 5 among them."""
    diagnosis = diagnosed(tmp_path, MODELS, drive, searched(by), seed=seed)
    assert diagnosis["verdict"] == "nothing missing"
    assert any("random torque" in w for w in diagnosis["warnings"])


@pytest.mark.slow
def test_an_unbalance_is_found_in_spite_of_it(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, partial(drive, unbalance=0.5), searched("significance"), seed=1)
    (effect,) = diagnosis["effects"]
    assert effect["kind"] == "angle_harmonic"
    assert effect["where"] in ("load_bearing", "motor_bearing")  # below the first torsional mode they are one
    assert diagnosis["explained"] > 0.9


def test_the_disturbance_is_estimated_from_the_residual(tmp_path):
    """Its size and place, and the noise of the speed."""
    study = Study.from_file(written(tmp_path, MODELS, drive, STUDY + RECORDS, seed=1))
    weighted = study.stage.weighted_problem()
    disturbance = study.stage.disturbance
    assert disturbance is not None
    assert disturbance.where == "load_bearing"
    assert disturbance.size == pytest.approx(PUSH, rel=0.5)  # an exponential memory is not the spectrum that shook it
    np.testing.assert_allclose(weighted.weighting[0].noise[0], 0.02, rtol=0.1)
    left = study.stage.identify.fits[0].residual[:: weighted.preparation.decimate]
    block = left[: weighted.residual().blocks[0].shape[0]]
    weights = weighted.weighting[0]
    np.testing.assert_allclose(weights.inverse(weights(block)), block, atol=1e-6 * np.max(np.abs(block)))
    assert np.std(weighted.residual().blocks[0][:, 1]) < 0.05 * np.std(block[:, 1])
