"""``vtsdt open``: a study in the browser."""

from __future__ import annotations

from collections.abc import Sequence

from vtsdt.cli.arguments import Parser, check_out, whole

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt open``."""
    parser = Parser(
        prog="vtsdt open",
        description="Open a study in the browser, on this computer only: pick an effect, watch the error fall.",
    )
    add = parser.add_argument
    add("target", metavar="STUDY.toml|DIR|history.json", help="a study, the folder of a diagnosis, or a history")
    add("--out", metavar="DIR", help="folder for history.json and what is exported; default: beside the study")
    add("--port", metavar="N", type=whole(0, "port"), default=0, help="of the page; default: any that is free")
    add("--no-browser", dest="browser", action="store_false", help="only print the address")
    add("--debug", action="store_true", help="show the traceback of an error")
    args = parser.parse_args(list(arguments))
    if args.out is not None:
        check_out(args.out)
    from discrepancy.workbench.command import serve

    return serve(args)
