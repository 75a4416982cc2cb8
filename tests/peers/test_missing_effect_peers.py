"""Other ways to find what is missing, asked about one case."""

from __future__ import annotations

import pytest

pytest.importorskip("pysindy")
pytest.importorskip("sklearn")

from discrepancy.rigs.axis import axis_case
from discrepancy.study.study import Study
from discrepancy.validation.peer_case import peer_case
from discrepancy.validation.peer_comparison import PeerTrial, peer_page
from discrepancy.validation.peer_methods import METHODS, methods_on


@pytest.fixture(scope="module")
def given():
    case = axis_case(7, ["coulomb_friction@guide"], trips=4)
    return peer_case(Study(case.problem(seed=7)).stage)


def test_the_true_effect_lowers_the_held_out_error(given):
    true = [i for i, c in enumerate(given.candidates) if c.name == "coulomb_friction@guide"]
    assert given.held_out(true) < 0.8
    assert given.held_out([]) == pytest.approx(1.0)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_sees_dry_friction(given, name):
    answer = METHODS[name](given)
    assert answer.alarm
    if name != "Gaussian process":
        assert any(n.startswith(("coulomb", "stribeck", "hysteresis", "asymmetric")) for n in answer.named[:3])


def test_page_has_a_row_for_each(given):
    answer = {"named": ["a@b"], "ties": [], "ratio": 0.9, "alarm": True, "seconds": 1.0}
    trials = [
        PeerTrial(
            seed=1,
            hidden=("a@b",),
            answers={**{n: answer for n in METHODS}, "this program": answer},
            columns_seconds=2.0,
        )
    ]
    text = peer_page(trials, "today")
    assert all(f"| {n} |" in text for n in METHODS)


def test_other_machines_get_what_does_not_know_the_axis(given):
    from types import SimpleNamespace

    lift = SimpleNamespace(residual=SimpleNamespace(channels=("omega", "cabin.z")))
    assert methods_on(given) == METHODS
    assert set(METHODS) - set(methods_on(lift)) == {"PySINDy on states"}
