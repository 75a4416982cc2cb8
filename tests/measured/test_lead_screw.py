"""The lead screw: recorded speed in, motor torque out, from viscous friction only."""

from __future__ import annotations

from pathlib import Path

import pytest

from discrepancy.study.study import Study

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "lead_screw"


def test_dry_friction_with_the_weight_of_the_payload(measured_data, monkeypatch):
    monkeypatch.setenv("VTSDT_DATA", str(measured_data))
    study = Study.from_file(EXAMPLE / "study.toml")
    assert len(study.problem.identify) == 32
    before = study.stage.rmse("validate")["motor.torque"]
    step = study.explain()
    assert step.accepted is not None
    assert step.accepted.effect.kind == "coulomb_friction"
    stage = study.add(step.accepted.effect, step.accepted)
    # Torque at constant speed scatters by 0.3 mN*m; starts and stops cannot be known better. Measured: 0.428.
    assert stage.rmse("validate")["motor.torque"] < 0.45e-3 < 0.4 * before
    # Steady map, |torque| extrapolated to standstill: 2.5 to 2.7 mN*m one way, 3.2 to 3.4 the other.
    assert stage.effects[0].strengths["coulomb"] == pytest.approx(2.95e-3, rel=0.05)
    # What is left does not change its sign with the direction: the payload's weight, which these records cannot tell
    # from an offset of the torque sensor.
    second = study.explain().accepted
    assert second is not None
    alike = {second.effect.kind, *(r.kind for r in second.rivals if r.indistinguishable)}
    assert {"constant_force", "sensor_offset"} <= alike
    # The payload's gravity is 0.300 mN*m at the motor (its provenance): that, and a fifth more, which the friction of
    # the loaded nut can explain.
    (size,) = second.effect.strengths.values()
    assert abs(size) == pytest.approx(0.300e-3, rel=0.35)
