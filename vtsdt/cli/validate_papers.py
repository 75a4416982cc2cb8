"""``vtsdt validate papers``: the papers' tables and figures, reproduced and compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import Parser, check_out, common
from vtsdt.papers.validation import CHAPTERS, count, summary, validate, write, write_docs_page

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate papers``."""
    parser = Parser(
        prog="vtsdt validate papers",
        description="Reproduce the papers' tables and figures and compare them with the printed ones.",
    )
    parser.add_argument("--only", choices=tuple(CHAPTERS), help="one page alone")
    parser.add_argument(
        "--docs", metavar="DIR", help="also write a page for each paper and its figures into a docs folder"
    )
    common(parser)
    args = parser.parse_args(list(arguments))
    check_out(args.out)
    out = Path(args.out)
    with ProgressLine(args.quiet) as progress:
        chapters_by_paper = validate(progress, args.only, out / "simulations")
        chapters = [chapter for part in chapters_by_paper.values() for chapter in part]
        page = write(out, chapters)
        for machine, part in chapters_by_paper.items():
            if args.docs:
                write_docs_page(Path(args.docs), machine, part)
    if not args.quiet:
        for machine, part in chapters_by_paper.items():
            print(f"{machine}: {summary(count(part))}")
        print(f"the page is {page}")
    return 0
