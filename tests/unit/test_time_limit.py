"""A search notes what it leaves out once it has reached its time limit."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.search.loop import Search
from discrepancy.search.state import SearchState


def state_with(limit: float) -> SearchState:
    problem: Any = SimpleNamespace(time_limit=limit, max_effects=6)
    return SearchState(problem)


@pytest.mark.parametrize(("limit", "left_out"), [(0.0, ["free curves"]), (math.inf, [])])
def test_what_is_left_out_is_noted(limit: float, left_out: list[str]) -> None:
    state = state_with(limit)
    state.start_clock()
    assert state.out_of_time_for("free curves") is bool(left_out)
    assert state.not_tried == left_out
    state.start_clock()
    assert state.not_tried == [], "a new search has left out nothing yet"


def test_before_a_search_begins_there_is_no_limit() -> None:
    assert not state_with(0.0).out_of_time_for("free curves")


def test_a_search_by_steps_looks_once_whatever_the_limit() -> None:
    state = state_with(0.0)
    state.start_clock()
    search = Search(state)
    assert not search._out_of_time_for("a further effect")
    decision: Any = SimpleNamespace()
    state.decisions.append(decision)
    assert search._out_of_time_for("a further effect")
