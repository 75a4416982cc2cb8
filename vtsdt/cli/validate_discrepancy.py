"""``vtsdt validate discrepancy``: error rates of the search, on the virtual machines that ship."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["MACHINES", "main"]

#: Machines besides the axis, and their modules, imported when needed.
MACHINES = {
    "lift": "vtsdt.rig.suite_lift",
    "lift-1d": "vtsdt.rig.suite_one_dimensional",
    "reference": "vtsdt.rig.suite_reference",
    "gear": "gearbox.rig.suite",
}


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate discrepancy`` with all machines that ship."""
    if arguments and arguments[0] == "machines":
        from discrepancy.validation.machines.command import main as judge

        return judge(arguments[1:])
    if arguments and arguments[0] == "machine-peers":
        from discrepancy.validation.machines.peers import main as compare

        return compare(arguments[1:])
    from discrepancy.validation.suite import main as run

    return run(arguments, MACHINES)
