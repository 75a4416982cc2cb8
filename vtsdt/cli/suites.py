"""``vtsdt validate discrepancy``: the machines on which the search for missing effects is tried."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["MACHINES", "main"]

#: Machines beside the axis, and the modules where they are; each is imported when it is asked for.
MACHINES = {
    "lift": "vtsdt.rig.suite_lift",
    "lift-1d": "vtsdt.rig.suite_one_dimensional",
    "reference": "vtsdt.rig.suite_reference",
    "gear": "gearbox.rig.suite",
}


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate discrepancy`` with all machines that ship."""
    from discrepancy.validation.suite import main as run

    return run(arguments, MACHINES)
