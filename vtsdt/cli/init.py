"""``vtsdt init``: a study from recordings and a kind of machine."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import CommandError, Parser, check_out, common

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt init``."""
    parser = Parser(
        prog="vtsdt init",
        description="Write a study from recordings: a model of a kind of machine or an FMU, columns matched by unit "
        "and name, some records held out, unknown parameters fitted. It tells what it assumed.",
    )
    add = parser.add_argument
    add("data", metavar="DATA", nargs="*", help="recordings: files, patterns, or a folder of them")
    add("--machine", metavar="KIND", help="what the machine is; --list names the kinds")
    add("--fmu", metavar="FILE", help="in place of it: an FMU from another tool")
    add(
        "--column",
        metavar="NAME=COLUMN",
        action="append",
        default=[],
        help="the column of a model input or output, where its unit and name do not tell; can be repeated",
    )
    add("--time", metavar="COLUMN", help="the time column, where its name does not tell")
    add("--list", action="store_true", help="print the kinds of machines")
    common(parser, out=False)
    args = parser.parse_args(list(arguments))
    from discrepancy.starters.command import default_folder, init, list_kinds

    if args.list:
        return list_kinds()
    if not args.data:
        raise CommandError(f"DATA is missing: name a recording\n{parser.format_usage().strip()}")
    args.out = args.out or default_folder(args.machine, args.fmu)
    check_out(args.out)
    with ProgressLine(args.quiet) as args.progress:
        return init(args)
