"""``vtsdt validate discrepancy``: the machines on which the search for missing effects is tried."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["MACHINES", "main"]

#: Machines beside the axis, and the modules where they are; each is imported when it is asked for.
MACHINES = {
    "lift": "vtsdt.suite_lift",
    "lift-1d": "vtsdt.suite_plain",
    "reference": "vtsdt.suite_reference",
    "gear": "gearbox.suite_gear",
}


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate discrepancy`` with all machines that ship."""
    from discrepancy.suite import main as run

    return run(arguments, MACHINES)
