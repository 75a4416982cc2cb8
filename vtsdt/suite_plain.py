"""The one-dimensional virtual lift as the suites run it: the 1D model under test lacks nothing but what is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from discrepancy.bench import Case
from vtsdt import suite_lift
from vtsdt.bench_plain import PlainLiftRig
from vtsdt.suite_lift import UNKNOWN, names, sizes

__all__ = ["UNKNOWN", "case", "names", "sizes"]


def case(seed: int, hidden: Sequence[str] = (), **settings: Any) -> Case:
    """Return recordings of the 1D lift with something hidden, and the model under test."""
    return suite_lift.case(seed, hidden, PlainLiftRig, **settings)
