"""``vtsdt open``: a study, an alignment or an updated gear stage in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vtsdt.cli.arguments import CommandError, Parser, check_out, whole
from vtsdt.cli.least_memory import check_memory

if TYPE_CHECKING:
    from discrepancy.workbench.command import View

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt open``."""
    parser = Parser(
        prog="vtsdt open",
        description="Open a study in the browser, on this computer only: pick an effect, watch the error fall.",
    )
    add = parser.add_argument
    shown = parser.add_mutually_exclusive_group(required=True)
    shown.add_argument(
        "target",
        nargs="?",
        metavar="STUDY.toml|DIR|history.json",
        help="a study, the folder of a diagnosis, or a history",
    )
    shown.add_argument(
        "--lift", metavar="DIR", help="folder that vtsdt align wrote, with vtsdt what-if in it or beside"
    )
    shown.add_argument("--gear", metavar="DIR", help="folder that vtsdt update-gearbox wrote")
    add("--out", metavar="DIR", help="folder for history.json and what is exported; default: beside the study")
    add("--port", metavar="N", type=whole(0, "port"), default=0, help="of the page; default: any that is free")
    add("--no-browser", dest="browser", action="store_false", help="only print the address")
    add("--debug", action="store_true", help="show the traceback of an error")
    args = parser.parse_args(list(arguments))
    if args.out is not None:
        check_out(args.out)
    check_memory()
    from discrepancy.workbench.command import serve, serve_result

    if args.lift is None and args.gear is None:
        return serve(args)
    try:
        view = _lift(args.lift) if args.lift is not None else _gear(args.gear)
    except ValueError as error:
        raise CommandError(str(error)) from None
    return serve_result(view, args)


def _lift(folder: str) -> View:
    from vtsdt.alignment.view import alignment_view

    return alignment_view(folder)


def _gear(folder: str) -> View:
    from gearbox.updating.view import updating_view

    return updating_view(folder)
