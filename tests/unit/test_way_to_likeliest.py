"""A model is moved to its likeliest parameters until a further step would change nothing, or its steps are used up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.tried_models import TriedModels, Way

FAR, NEAR = 10.0 * POLICY.improvement, 0.5 * POLICY.improvement


def place(total: float, rise: float) -> Any:
    """Return a model with a log evidence whose likelihood is larger by so much at the likeliest parameters."""
    return SimpleNamespace(rise_to_likeliest=rise), SimpleNamespace(total=total)


def way(first: Any, *steps: Any, moved: bool = True) -> tuple[TriedModels, Way]:
    state: Any = SimpleNamespace()
    tried = TriedModels(state)
    tried.moved = moved
    tried._steps_to_likeliest = lambda likelihood: iter(steps)  # type: ignore[method-assign]
    return tried, tried.way_to_likeliest(*first)


def test_a_model_at_its_likeliest_parameters_stays() -> None:
    first = place(100.0, NEAR)
    _, there = way(first, place(200.0, NEAR))
    assert there.end == first
    assert there.settled
    assert there.changes == []


def test_the_likeliest_parameters_count_also_where_the_extrapolation_to_them_said_more() -> None:
    _, there = way(place(107.0, FAR), place(100.0, NEAR), place(500.0, NEAR))
    assert there.settled
    assert there.end[1].total == 100.0
    assert there.wander == 0.0


def test_where_the_evidence_does_not_settle_the_most_probable_place_counts() -> None:
    steps = place(100.0, FAR), place(150.0, FAR), place(120.0, FAR), place(160.0, FAR)
    tried, there = way(*steps)
    assert not there.settled
    assert there.changes == [50.0, 30.0]  # it has become less probable, and goes no further
    assert there.end[1].total == 150.0
    there = tried.whole_way(*steps[0])
    assert not there.settled
    assert there.changes == [50.0, 30.0, 40.0]
    assert there.end[1].total == 160.0
    assert there.wander == 40.0  # of the steps after the first


@pytest.mark.parametrize(
    ("totals", "settles", "end", "wander"),
    [
        ((130.0, 131.0), True, 131.0, 0.0),
        ((130.0, 115.0, 117.0), False, 130.0, 15.0),  # there may be others
        ((100.5, 300.0), True, 100.5, 0.0),
    ],
)
def test_a_model_settles_if_only_the_first_step_changes_its_evidence(totals, settles, end, wander) -> None:
    tried, _ = way(place(100.0, FAR), *(place(t, NEAR) for t in totals))
    there = tried.whole_way(*place(100.0, FAR))
    assert there.settled is settles
    assert there.end[1].total == end
    assert there.wander == wander


@pytest.mark.parametrize(
    ("second", "third", "wander"),
    [
        (148.0, 149.0, 0.0),  # less than the likelihood promised where the step began: it is on the way
        (171.0, 172.0, 41.0),
        (125.0, 124.0, 5.0),
    ],
)
def test_only_what_was_not_foreseen_is_wander(second: float, third: float, wander: float) -> None:
    first = place(100.0, 400.0)
    tried, _ = way(first, place(130.0, 20.0), place(second, NEAR), place(third, NEAR))
    there = tried.whole_way(*first)
    assert there.settled is (wander == 0.0)
    assert there.wander == wander


@pytest.mark.parametrize(("moved", "expected"), [(True, 90.0), (False, None)])
def test_models_are_moved_only_where_the_first_was(moved: bool, expected: float | None) -> None:
    first = place(100.0, FAR)
    tried, _ = way(first, place(90.0, NEAR), moved=moved)
    there = tried.at_likelier_parameters(*first)
    assert (there and there[1].total) == expected


def test_a_model_that_wanders_is_moved_only_to_what_is_clearly_more_probable() -> None:
    first = place(100.0, FAR)
    tried, _ = way(first, place(100.0 + NEAR, FAR))
    assert tried.at_likelier_parameters(*first) is None
