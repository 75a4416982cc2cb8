"""The free pendulum: viscous friction as published is not enough, and what is missing acts at low speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from discrepancy.study.study import Study

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "pendulum"


def test_dry_friction_is_found_on_large_swings_and_helps_on_small_ones(measured_data, monkeypatch):
    monkeypatch.setenv("VTSDT_DATA", str(measured_data))
    study = Study.from_file(EXAMPLE / "study.toml")
    before = study.stage.rmse("validate")["rod.angle"]
    # Calibration holds the published inertia: 3.333e-3 kg*m2 within half a per cent.
    assert study.stage.identify.to_dict()["rod.J"] == pytest.approx(3.333e-3, rel=5e-3)
    step = study.explain()
    assert step.accepted is not None
    # Friction that fades with speed: dry friction and its relatives. The recordings give no single law of them.
    assert step.accepted.effect.kind in ("coulomb_friction", "stribeck_friction", "hysteresis")
    stage = study.add(step.accepted.effect, step.accepted)
    # On another recording, with another start and a twentieth of the amplitude. Measured: 11.4 to 7.3 mrad.
    assert stage.rmse("validate")["rod.angle"] < 0.75 * before
    # On its own recording: 27.5 to 12.6 mrad.
    assert stage.rmse("identify")["rod.angle"] < 0.6 * study.stages[1].rmse("identify")["rod.angle"]


def test_dry_friction_is_named_on_small_swings_where_the_machine_stops_and_the_model_does_not(
    measured_data, monkeypatch
):
    monkeypatch.setenv("VTSDT_DATA", str(measured_data))
    study = Study.from_file(EXAMPLE / "study.toml")
    study = Study(replace(study.problem, identify=study.problem.validate, validate=(), residual="simulation"))
    before = study.stage.rmse("identify")["rod.angle"]
    step = study.explain()
    assert step.accepted is not None
    assert step.accepted.effect.kind in ("coulomb_friction", "hysteresis")
    # 8.4 to 0.9 mrad; with columns at strength zero a square drag was named, which leaves 4.8 mrad.
    assert step.stage.rmse("identify")["rod.angle"] < 0.2 * before


def test_the_inverse_residual_of_small_swings_names_dry_friction_too(measured_data, monkeypatch):
    monkeypatch.setenv("VTSDT_DATA", str(measured_data))
    study = Study.from_file(EXAMPLE / "study.toml")
    study = Study(replace(study.problem, identify=study.problem.validate, validate=(), residual="inverse"))
    step = study.explain()
    # The torque that a standing pendulum needs has no noise to estimate: what is left then says what would matter.
    assert all(row.strength_that_matters < float("inf") for row in step.scan.rows)
    assert step.accepted is not None
    assert step.accepted.effect.kind in ("coulomb_friction", "hysteresis")
