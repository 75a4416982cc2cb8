"""The one-dimensional virtual lift of the suites: the 1D model under test lacks only what is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from discrepancy.rigs.case import Case
from vtsdt.rig import suite_lift
from vtsdt.rig.one_dimensional import PlainLiftRig
from vtsdt.rig.suite_lift import UNKNOWN, names, sizes

__all__ = ["UNKNOWN", "case", "names", "sizes"]


def case(seed: int, hidden: Sequence[str] = (), **settings: Any) -> Case:
    """Return recordings of the 1D lift with something hidden, and the model under test."""
    return suite_lift.case(seed, hidden, PlainLiftRig, **settings)
