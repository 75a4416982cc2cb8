"""The virtual lift with the reference model under test: both have 37 states and the same rails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from discrepancy.rigs.case import Case
from vtsdt.rig import suite_lift
from vtsdt.rig.suite_lift import UNKNOWN

__all__ = ["TRIALS", "UNKNOWN", "case", "names", "sizes"]

#: Default number of seeds of a suite: a trial takes some minutes of processor time.
TRIALS = 10


def case(seed: int, hidden: Sequence[str] = (), **settings: Any) -> Case:
    """Return recordings of the lift with something hidden, and the reference model."""
    return suite_lift.case(seed, hidden, under_test="reference", **settings)


def sizes(seed: int, hidden: Sequence[str]) -> list[dict[str, Any]]:
    """Return the hidden effects at their usual size, without a simulation."""
    return suite_lift.sizes(seed, hidden, "reference")


def names() -> list[str]:
    """Return everything that can be hidden, as ``kind@where``."""
    return suite_lift.names("reference")
