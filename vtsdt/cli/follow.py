"""``vtsdt follow``: new recordings of a machine are judged as they come."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import Parser, check_out, common, number

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt follow``."""
    parser = Parser(
        prog="vtsdt follow",
        description="Judge every new recording of a machine with a study's model, keep what it says, find what has "
        "changed since, and raise the alarms of the study's [alarms]. Runs until interrupted.",
    )
    add = parser.add_argument
    add("study", metavar="STUDY.toml", help="the study file; [follow] and [alarms] say how")
    add(
        "--source",
        metavar="FOLDER|mqtt://…",
        required=True,
        help="a folder of recordings to come, or a broker and topic",
    )
    add("--machine", metavar="NAME", help="name of the machine in the history; default: the study's")
    add("--pattern", metavar="PATTERN", action="append", help="of the file names; default: every format but .txt")
    add("--poll", metavar="S", type=number(True, "time"), default=1.0, help="between two looks (default 1 s)")
    add(
        "--settle",
        metavar="S",
        type=number(False, "time"),
        default=2.0,
        help="for how long a file must not grow before it is read (default 2 s)",
    )
    add("--once", action="store_true", help="end when every file has been judged")
    common(parser)
    args = parser.parse_args(list(arguments))
    check_out(args.out)
    with ProgressLine(args.quiet) as args.progress:
        from operation.fleet.machine_states import priors_of_others
        from operation.follow.command import follow

        return follow(args, priors_of_others)
