"""``vtsdt history``: what the records of followed machines have shown."""

from __future__ import annotations

from collections.abc import Sequence

from vtsdt.cli.arguments import Parser

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt history``."""
    parser = Parser(
        prog="vtsdt history",
        description="Show the state of every machine that `vtsdt follow` keeps in a folder, what has changed and since "
        "when; or export it, or note what was done to a machine.",
    )
    add = parser.add_argument
    add("folder", metavar="FOLDER", help="as given to follow's --out")
    add("--machine", metavar="NAME", help="only this one")
    add("--csv", metavar="FILE", help="write every quantity of every record as a table")
    add("--page", metavar="FILE.html", help="write the page for those who maintain the machines")
    add("--json", action="store_true", help="print states, quantities and events as JSON")
    add("--now", action="store_true", help="tell also which machines have been silent for too long")
    add("--note", metavar="TEXT", help="keep what was done, for instance 'rails realigned'")
    add("--at", metavar="TIME", help="when it was done, as 2026-03-01T08:00 (UTC); default: now")
    add(
        "--new-reference",
        action="store_true",
        help="the machine is another one since: later records are compared with each other only",
    )
    add("--debug", action="store_true", help="show the traceback of an error")
    args = parser.parse_args(list(arguments))
    from operation.page.command import history

    return history(args)
