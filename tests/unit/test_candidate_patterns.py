"""Patterns of ``[candidates]``: a misspelt one is refused with the nearest name, never silently without effect."""

from __future__ import annotations

import pytest
from conftest import machine

from discrepancy.problem.candidate_patterns import check_patterns


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
