"""A calibration finds an oscillator whose phase is several turns off with the stated stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain_machines import RECORDS, written

from discrepancy.study.study import Study
from estimation.fit import calibrate

MASS, STIFFNESS, DAMPING, NOISE = 1.0, 115.0, 0.02, 1e-3  # kg, N/m, N·s/m, m

MODEL = """
from multibody import Model
from multibody import library as lib


def oscillator():
    m = Model("oscillator")
    mass = m.add("mass", lib.Mass(m=1.0))
    spring = m.add("spring", lib.SpringDamper(stiffness=100.0, damping=0.02))
    push = m.add("push", lib.ForceSource())
    m.connect(mass.flange, spring.b, push.flange)
    m.connect(spring.a, m.ground)
    m.input("push.force", push.force)
    return m
"""

STUDY = """
[model]
build = "models.py:oscillator"

[uncertain]
"spring.stiffness" = { value = 100.0, std = 10.0, min = 0.0 }

[inputs]
"push.force" = { column = "force_N", interpolation = "hold" }

[outputs]
"mass.position" = { column = "position_m", noise = 1e-3 }
"""


def oscillation(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return 30 s after an impact of 10 N for 0.1 s, in closed form: 49 cycles, and 46 with the stated stiffness."""
    t = np.arange(0.0, 30.0, 0.02)
    decay = 0.5 * DAMPING / MASS
    rate = np.sqrt(STIFFNESS / MASS - decay**2)

    def step(after: np.ndarray) -> np.ndarray:
        at = np.maximum(after, 0.0)
        return (1.0 - np.exp(-decay * at) * (np.cos(rate * at) + decay / rate * np.sin(rate * at))) / STIFFNESS

    force = np.where((t >= 1.0) & (t < 1.1), 10.0, 0.0)
    moved = 10.0 * (step(t - 1.0) - step(t - 1.1))
    return {"time_s": t, "force_N": force, "position_m": moved + NOISE * rng.standard_normal(t.size)}


@pytest.mark.parametrize("again", [0, 3])
def test_the_phase_is_found_by_looking_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: int) -> None:
    monkeypatch.setattr(calibrate, "BEGUN_AGAIN", again)
    study = Study.from_file(written(tmp_path, MODEL, oscillation, STUDY + RECORDS, seed=3))
    found = study.stage.identify
    near = abs(found["spring.stiffness"] - STIFFNESS) < 5.0 * found.std_of("spring.stiffness") + 0.05
    assert near is bool(again)
    assert (study.stage.rmse("validate")["mass.position"] < 1.1 * NOISE) is bool(again)
