"""The pendulum with a motor of little torque: viscous friction is not what its bearing has."""

from __future__ import annotations

from pathlib import Path

from discrepancy.study.study import Study

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "torque_limited_pendulum"


def test_dry_friction_takes_the_place_of_viscous_friction(measured_data, monkeypatch):
    monkeypatch.setenv("VTSDT_DATA", str(measured_data))
    study = Study.from_file(EXAMPLE / "study.toml")
    before = study.stage.rmse("validate")["rod.angle"]
    step = study.explain()
    assert step.accepted is not None
    assert step.accepted.effect.kind == "coulomb_friction"
    stage = study.add(step.accepted.effect, step.accepted)
    assert stage.rmse("validate")["rod.angle"] < 0.6 * before
    # Fits by others of the same records: 0.21 to 0.24 N*m, and no viscous friction beside it.
    assert 0.18 < stage.effects[0].strengths["coulomb"] < 0.27
    assert stage.identify.to_dict()["bearing.viscous"] < 0.02
