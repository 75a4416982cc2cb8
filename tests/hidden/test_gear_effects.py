"""Effects hidden in a gear stage are candidates of the missing-effect loop, and an eccentric gear is named.

The stage is the torsional one in a clamped housing, watched by encoders and a torque sensor at low speed.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from discrepancy.catalogue import catalogue
from discrepancy.setup import Setup, experiments_of
from discrepancy.study import Study
from estimation.calibrate import UncertainParameter
from estimation.record import Record, Signal
from gearbox.effects import GEAR_KINDS
from gearbox.stage import Stage

OUTPUTS = {"transmission_error": ("m", 2e-7), "drive_torque": ("N*m", 0.05)}
SPEED = 150.0


@cache
def stage() -> Stage:
    return Stage.torsional(housing="clamped", imperfect=True)


def record(name: str, torque: float, hidden: dict[str, float], seed: int) -> Record:
    """What the sensors would show of one run."""
    run = stage().simulate(SPEED, torque, 0.6, rate=2000.0, parameters=hidden, rtol=1e-6, atol=1e-10, settle=0.0)
    rng = np.random.default_rng(seed)
    n = run.times.size
    signals = {
        "speed": Signal(np.full(n, SPEED * np.pi / 30), "rad/s", "speed", "rad/s"),
        "torque": Signal(np.full(n, torque), "N*m", "torque", "N*m"),
    }
    for output, (unit, noise) in OUTPUTS.items():
        signals[output] = Signal(run[output] + noise * rng.standard_normal(n), unit, output, unit)
    return Record(name, Path(f"{name}.csv"), run.times, signals)


def study(hidden: dict[str, float]) -> Study:
    model = stage().moving(SPEED, 100.0)
    free = ["output_shaft.spin_angle", "input_shaft.spin_angle"]
    groups = [
        experiments_of(model, [record(name, torque, hidden, seed)], ["speed", "torque"], list(OUTPUTS), free=free)
        for name, torque, seed in (("a", 100.0, 1), ("b", 140.0, 2), ("c", 120.0, 3))
    ]
    return Study(Setup(
        "gears", model, (UncertainParameter("mesh.K", 8.6e5, 8.6e4, 1e5, 5e6, "N"),), groups[0] + groups[1], groups[2],
        {n: noise for n, (_, noise) in OUTPUTS.items()},
        include=("eccentricity@*", "pitch_error@*", "mesh_stiffness_variation@*", "wear@*", "angle_harmonic@*",
                 "coulomb_friction@*", "viscous_friction@*", "sensor_*"),
        max_effects=1, residual="simulation"))  # fmt: skip


def test_a_gear_stage_offers_its_effects() -> None:
    rich = Stage.paper(imperfect=True, bearing_defects=True)
    system = rich.build(outputs=["a_base_y"], compiled=False)
    found = {e.name for e in catalogue(system, ["a_base_y"], ["torque"])}
    assert {k.name for k in GEAR_KINDS} <= {name.partition("@")[0] for name in found}
    assert {"eccentricity@mesh.gear_2", "unbalance@input_shaft", "bearing_defect@output_high", "wear@mesh"} <= found
    plain = Stage.paper().build(outputs=["a_base_y"], compiled=False)
    names = {e.kind.name for e in catalogue(plain, ["a_base_y"], ["torque"])}
    assert "eccentricity" not in names  # a stage built without imperfections has none to offer
    assert "unbalance" in names


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "other"), [(1, 2), (2, 1)])
def test_an_eccentric_gear_is_named(gear: int, other: int) -> None:
    hidden = {f"mesh.runout_x_{gear}": 9e-6, f"mesh.runout_y_{gear}": -12e-6}
    looked = study(hidden)
    conclusion = looked.diagnose()
    assert [str(e) for e in looked.stage.effects] == [f"eccentricity@mesh.gear_{gear}"], conclusion.verdict
    effect = looked.stage.effects[0]
    assert effect.strengths["runout_x"] == pytest.approx(9e-6, rel=0.1)
    assert effect.strengths["runout_y"] == pytest.approx(-12e-6, rel=0.1)
