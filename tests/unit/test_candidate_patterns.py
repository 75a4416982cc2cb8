"""Patterns of ``[candidates]``: a misspelt one is refused with the nearest name, never silently without effect."""

from __future__ import annotations

import importlib.util
import tomllib
from pathlib import Path

import pytest
from conftest import machine

from discrepancy.problem.candidate_patterns import check_patterns

ROOT = Path(__file__).resolve().parents[2]


def checked(include=("*",), exclude=()):
    return check_patterns(machine().build(probes=True), ["drive.force"], ["reference.speed"], include, exclude)


@pytest.mark.parametrize(
    "patterns",
    [["*"], ["coulomb_friction"], ["*friction@guide"], ["*@carriage"], ["sensor_*@drive.force", "input_*"]],
    ids=str,
)
def test_patterns_that_fit_are_accepted(patterns) -> None:
    assert (checked(patterns).faults, checked(patterns).warnings) == ((), ())


@pytest.mark.parametrize("key", ["include", "exclude"])
@pytest.mark.parametrize(
    ("pattern", "says"),
    [
        ("coulomb", "there is no kind of effect 'coulomb'; nearest: 'coulomb_friction'"),
        ("Coulomb_friction", "nearest: 'coulomb_friction'"),
        ("coulomb_friction@giude", "no connection, part or signal 'giude'; nearest: 'guide'"),
        ("sensor_gain@drive.forc", "nearest: 'drive.force'"),
        ("@guide", "there is no kind of effect ''"),
    ],
)
def test_a_misspelt_pattern_is_refused(key: str, pattern: str, says: str) -> None:
    (fault,) = checked(**{key: ["viscous_friction", pattern]}).faults
    assert f"[candidates] {key}: '{pattern}'" in fault
    assert says in fault


def test_a_kind_that_the_model_cannot_have_is_a_warning_beside_others_and_a_fault_alone() -> None:
    beside = checked(["coulomb_friction", "brush_voltage_drop"])
    assert beside.faults == ()
    assert "'brush_voltage_drop' fits nothing of this model" in beside.warnings[0]
    (fault,) = checked(["backlash@guide"]).faults
    assert "no effect is left to look for" in fault
    assert "it can be at drive" in fault
    assert checked(exclude=["brush_voltage_drop"]) == checked()


def test_patterns_that_leave_nothing_are_refused() -> None:
    (fault,) = checked(["coulomb_friction"], ["*friction@*"]).faults
    assert "no effect is left to look for: include more, or exclude less" in fault


def test_an_effect_of_a_part_that_the_model_lacks_names_the_part() -> None:
    import gearbox.stage.effects  # noqa: F401 - adds the gear stage's kinds; an installed package does so by itself

    (fault,) = checked(["tooth_defect"]).faults
    assert "an effect of gearbox.parts.mesh.HelicalMesh, and the model has none: build one into the model" in fault


def test_an_effect_that_a_part_has_only_with_an_option_names_the_option() -> None:
    import gearbox.stage.effects  # noqa: F401
    from gearbox import GearStage

    stage = GearStage.torsional(housing="clamped").build(probes=True)
    (fault,) = check_patterns(stage, [stage.output_names[0]], [], ["tooth_defect"], []).faults
    assert "has it only with imperfect=True" in fault


def test_the_kinds_of_the_shipped_machines_are_offered_by_entry_points() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    offered = project["entry-points"]["vtsdt.effects"].values()
    assert set(offered) == {"vtsdt.lift.stated_values", "gearbox.stage.effects"}
    assert all(importlib.util.find_spec(name) for name in offered)
