"""``vtsdt validate papers``: each table and figure of the papers, ours beside it, and a verdict on every row.

A row agrees within a stated tolerance, differs for a stated reason, or cannot be checked, and says why.  Rows of the
gearbox paper come from ``gearbox.papers.gearbox:rows`` where that module is there.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from discrepancy.validation.published import AGREES, DIFFERS, UNCHECKED, PaperChapter
from multibody.base.progress import Progress, silent

__all__ = ["main", "to_markdown", "validate"]

#: Where other packages' chapters come from: each has a function ``chapters(progress)``.
#: Those that simulate for long take a folder as well, in which simulations are kept.
CHAPTERS = {"lift": "vtsdt.papers.lift", "gearbox": "gearbox.papers.gearbox"}
KEEPING = ("gearbox",)


def validate(
    progress: Progress = silent, only: str | None = None, folder: Path | None = None
) -> dict[str, list[PaperChapter]]:
    """Make every table and figure again and return the chapters by machine.

    Parameters
    ----------
    progress : callable, optional
        Gets a line of text for each step.
    only : {"lift", "gearbox"}, optional
        One paper alone.
    folder : Path, optional
        Keeps the simulations, so that what was broken off goes on where it stopped.
    """
    made: dict[str, list[PaperChapter]] = {}
    for machine, name in CHAPTERS.items():
        package = name.partition(".")[0]
        there = importlib.util.find_spec(package) is not None and importlib.util.find_spec(name) is not None
        if there and only in (None, machine):
            kept = (folder,) if machine in KEEPING else ()
            made[machine] = list(importlib.import_module(name).chapters(progress, *kept))
    return made


def count(chapters: Iterable[PaperChapter]) -> dict[str, int]:
    """Return how many rows have each verdict."""
    rows = [r for c in chapters for r in c.rows]
    return {v: sum(r.verdict == v for r in rows) for v in (AGREES, DIFFERS, UNCHECKED)}


def to_markdown(chapters: Sequence[PaperChapter], images: str = "") -> str:
    """Return the validation as a page; ``images`` is the folder of the figures as the page sees it."""
    total = count(chapters)
    lines = [
        "# What the papers print, and what comes out here",
        "",
        "Written by `vtsdt validate papers`; do not edit. `pytest tests/papers` asserts what stands here.",
        "",
        f"{sum(total.values())} rows: {total[AGREES]} agree, {total[DIFFERS]} differ for a reason that is given, "
        f"{total[UNCHECKED]} cannot be checked.",
    ]
    paper = ""
    for chapter in chapters:
        if chapter.paper != paper:
            paper = chapter.paper
            lines += ["", f"## {paper}"]
        lines += ["", f"### {chapter.place}: {chapter.title}", ""]
        if chapter.text:
            lines += [chapter.text, ""]
        lines += ["| | paper | ours | | |", "| --- | --- | --- | --- | --- |"]
        lines += [
            f"| {_cell(r.what)} | {_cell(r.paper)} | {_cell(r.ours)} | **{r.verdict}** | {_cell(r.why)} |"
            for r in chapter.rows
        ]
        lines += [line for name in chapter.figures for line in ("", f"![{chapter.place}, ours]({images}{name}.png)")]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def to_json(chapters: Sequence[PaperChapter]) -> dict[str, Any]:
    """Return the validation as JSON."""
    return {
        "schema": 1,
        "count": count(chapters),
        "chapters": [
            {"paper": c.paper, "place": c.place, "title": c.title, "text": c.text, "rows": [vars(r) for r in c.rows]}
            for c in chapters
        ],
    }


def write(out: Path, chapters: Sequence[PaperChapter]) -> Path:
    """Write page (HTML and Markdown), JSON and figures into a folder; return the HTML page."""
    import base64
    from importlib import resources

    import jinja2
    from markupsafe import Markup

    out.mkdir(parents=True, exist_ok=True)
    images: dict[str, str] = {}
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(out / f"{name}.png", dpi=110, metadata={"Software": None})
            images[name] = base64.b64encode((out / f"{name}.png").read_bytes()).decode("ascii")
    (out / "validation.md").write_text(to_markdown(chapters), encoding="utf-8")
    text = json.dumps(to_json(chapters), indent=1, ensure_ascii=False) + "\n"
    (out / "validation.json").write_text(text, encoding="utf-8")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("vtsdt", "templates"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    css = resources.files("discrepancy").joinpath("templates/report.css").read_text(encoding="utf-8")
    page = out / "validation.html"
    page.write_text(
        environment.get_template("validation.html").render(
            css=Markup(css), chapters=chapters, images=images, count=count(chapters)
        ),
        encoding="utf-8",
    )
    return page


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate papers``."""
    from multibody.base.progress import ProgressLine
    from vtsdt.cli.arguments import CommandError, Parser, common

    parser = Parser(
        prog="vtsdt validate papers",
        description="Make the papers' tables and figures again and write them beside what is printed.",
    )
    parser.add_argument("--only", choices=tuple(CHAPTERS), help="one paper alone")
    parser.add_argument(
        "--docs", metavar="DIR", help="also write a page for each paper and its figures into a docs folder"
    )
    common(parser)
    args = parser.parse_args(list(arguments))
    out = Path(args.out)
    if out.is_file():
        raise CommandError(f"--out {args.out}: is a file: name a folder to write into")
    with ProgressLine(args.quiet) as progress:
        found = validate(progress, args.only, out / "simulations")
        chapters = [c for part in found.values() for c in part]
        page = write(out, chapters)
        for machine, part in found.items():
            if args.docs:
                _into_docs(Path(args.docs), machine, part)
    if not args.quiet:
        total = count(chapters)
        print(
            f"{total[AGREES]} agree, {total[DIFFERS]} differ for a known reason, {total[UNCHECKED]} cannot be checked"
        )
        print(f"the page is {page}")
    return 0


def _into_docs(docs: Path, machine: str, chapters: Sequence[PaperChapter]) -> None:
    folder = docs / "images" / "papers"
    folder.mkdir(parents=True, exist_ok=True)
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(folder / f"{name}.png", dpi=90, metadata={"Software": None})
    text = to_markdown(chapters, "../images/papers/")
    (docs / "method" / f"papers-{machine}.md").write_text(text, encoding="utf-8")
