"""``vtsdt diagnose``, ``compare``, ``check`` and ``catalogue``: a study file from the command line."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import Parser, check_out, common, json_option, whole
from vtsdt.cli.least_memory import check_memory

__all__ = ["catalogue", "check", "compare", "diagnose"]


def diagnose(arguments: Sequence[str]) -> int:
    """Run ``vtsdt diagnose``."""
    parser = _parser(
        "diagnose",
        "Compare a model with recordings, find the effects it lacks, add them one by one, and write "
        "diagnosis.json, report.html, figures and model.json.",
    )
    parser.add_argument(
        "--max-effects",
        metavar="N",
        type=whole(0, "number of effects"),
        help="effects added at most; default: the study's",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue from history.json in DIR: after an interruption, or to rebuild the stages of another history",
    )
    common(parser)
    args = parser.parse_args(list(arguments))
    check_out(args.out)
    check_memory()
    with ProgressLine(args.quiet) as args.progress:
        from discrepancy.study.command import diagnose as run

        return run(args)


def compare(arguments: Sequence[str]) -> int:
    """Run ``vtsdt compare``."""
    parser = _parser(
        "compare", "Compare a model with recordings and say where the model fails. Nothing is added to it."
    )
    common(parser)
    args = parser.parse_args(list(arguments))
    check_out(args.out)
    check_memory()
    with ProgressLine(args.quiet) as args.progress:
        from discrepancy.study.command import compare as run

        return run(args)


def check(arguments: Sequence[str]) -> int:
    """Run ``vtsdt check``."""
    parser = Parser(
        prog="vtsdt check",
        description="Say in seconds whether a study's model and recordings fit each other: units, signs, swapped "
        "columns, rates, and which parameters these recordings cannot show. Nothing is fitted.",
    )
    parser.add_argument("study", metavar="STUDY.toml", help="the study file")
    parser.add_argument("--json", action="store_true", help="print faults, warnings and facts as JSON")
    common(parser, out=False)
    args = parser.parse_args(list(arguments))
    if args.out is not None:
        check_out(args.out)
    with ProgressLine(args.quiet) as args.progress:
        from discrepancy.study.command import check as run

        return run(args)


def catalogue(arguments: Sequence[str]) -> int:
    """Run ``vtsdt catalogue``."""
    parser = Parser(
        prog="vtsdt catalogue",
        description="List every effect that fits a study's model, by kind and place, and what [candidates] keeps.",
    )
    parser.add_argument("study", metavar="STUDY.toml", help="the study file")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--names", action="store_true", help="print the candidates as kind@where, one a line")
    form.add_argument("--json", action="store_true", help="print every effect, and whether it is a candidate, as JSON")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    args = parser.parse_args(list(arguments))
    from discrepancy.study.command import list_catalogue

    return list_catalogue(args)


def _parser(name: str, description: str) -> Parser:
    parser = Parser(prog=f"vtsdt {name}", description=description)
    parser.add_argument("study", metavar="STUDY.toml", help="the study file")
    parser.add_argument(
        "--seed", metavar="N", type=whole(0, "seed"), help="of all random numbers; default: the study's"
    )
    json_option(parser)
    return parser
