"""The virtual axis as the suites run it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from discrepancy.rigs.axis import axis_case, list_axis
from discrepancy.rigs.case import Case

__all__ = ["UNKNOWN", "case", "names", "sizes"]

UNKNOWN = "unknown_force@guide"


def case(seed: int, hidden: Sequence[str] = (), **settings: Any) -> Case:
    """Return recordings of the axis with effects hidden in it, and the model under test."""
    return axis_case(seed, list(hidden), **settings)


def sizes(seed: int, hidden: Sequence[str]) -> list[dict[str, Any]]:
    """Return the effects as they are hidden at their usual size."""
    effects: list[dict[str, Any]] = case(seed, hidden).truth["effects"]
    return effects


def names() -> list[str]:
    """Return everything that can be hidden, as ``kind@where``."""
    return [f"{e['kind']}@{e['where']}" for e in list_axis()]
