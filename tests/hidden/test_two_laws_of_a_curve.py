"""Two laws over the speed that hide each other behind what is random are both named."""

from __future__ import annotations

import numpy as np
from plain_machines import RECORDS, diagnosed, low_passed

MODELS = """
from multibody import Model
from multibody import library as lib


def flywheel():
    m = Model("flywheel")
    motor, wheel = m.add("motor", lib.TorqueSource()), m.add("wheel", lib.Inertia(J=0.8))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=5e-3))
    dry = m.add("dry", lib.RotaryCoulombFriction(coulomb=0.3, v_s=0.2))
    m.connect(motor.flange, wheel.flange, bearing.b, dry.b)
    m.connect(bearing.a, dry.a, m.ground)
    m.input("motor.torque", motor.torque)
    return m
"""

STUDY = """
[model]
build = "models.py:flywheel"
[uncertain]
"wheel.J" = { std = 0.03 }
"bearing.viscous" = { std = 2e-3, min = 0.0 }
"dry.coulomb" = { std = 0.05, min = 0.0 }
[inputs]
"motor.torque" = "torque_Nm"
[outputs]
"wheel.speed" = "speed_rad_per_s"
"""


def flywheel(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A wheel with more friction at low speed, windage, and a torque that nobody recorded."""
    dt, n, inner = 0.02, 1500, 20
    t = dt * np.arange(n)
    torque = 2.2 * low_passed(rng, t, 0.25)
    unknown = 0.02 * low_passed(rng, t, 2.0)
    speed, w = np.empty(n), 0.0
    for k in range(n):
        speed[k] = w
        now, after = torque[k], torque[min(k + 1, n - 1)]
        for j in range(inner):
            rub = (0.28 + 0.65 * np.exp(-((w / 2.0) ** 2))) * np.tanh(w / 0.2)
            w += (
                dt
                / inner
                * (now + (after - now) * (j + 0.5) / inner + unknown[k] - 0.006 * w - rub - 9e-4 * w * abs(w))
                / 0.82
            )
    return {"time_s": t, "torque_Nm": torque, "speed_rad_per_s": speed + 0.05 * rng.standard_normal(n)}


def test_both_are_named(tmp_path):
    answer = diagnosed(tmp_path, MODELS, flywheel, STUDY + RECORDS, seed=1)
    named = {e["kind"] for e in answer["effects"]}
    ties = {o["kind"] for e in answer["effects"] for o in e["indistinguishable_from"]}
    assert len(named) == 2, answer["sentence"]
    assert "quadratic_drag" in named
    assert "stribeck_friction" in named | ties
