"""``vtsdt validate papers``: each table and figure of the papers, ours beside it, and a verdict on every row.

A row agrees within a stated tolerance, differs for a stated reason, or cannot be checked, and says why.  Rows of the
gearbox paper come from ``gearbox.papers.gearbox:rows`` where that module is there.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AGREES", "DIFFERS", "UNCHECKED", "Chapter", "Row", "compared", "main", "to_markdown", "validate"]

AGREES, DIFFERS, UNCHECKED = "agrees", "differs", "cannot be checked"
#: Where other packages' chapters come from: each has a function ``chapters(progress)``.
#: Those that simulate for long take a folder as well, in which simulations are kept.
CHAPTERS = {"lift": "vtsdt.papers.lift", "gearbox": "gearbox.papers.gearbox"}
KEEPING = ("gearbox",)


@dataclass(frozen=True)
class Row:
    """One figure of a paper beside ours.

    Parameters
    ----------
    what : str
    paper, ours : str
        As they are printed.
    verdict : {"agrees", "differs", "cannot be checked"}
    why : str
        The tolerance, the known reason, or why it cannot be checked; never empty for the last two.
    """

    what: str
    paper: str
    ours: str
    verdict: str
    why: str = ""

    def __post_init__(self) -> None:
        if self.verdict not in (AGREES, DIFFERS, UNCHECKED):
            raise ValueError(f"'{self.what}': there is no verdict '{self.verdict}'")
        if self.verdict != AGREES and not self.why:
            raise ValueError(f"'{self.what}': a row that {self.verdict} needs its reason")


@dataclass(frozen=True, eq=False)
class Chapter:
    """A table or figure of a paper.

    Parameters
    ----------
    paper : str
        Short name of the paper.
    place : str
        Such as ``"Table 4"``.
    title : str
    rows : tuple of Row
    figures : dict
        Ours, by file name without its ending.
    text : str
        What has to be known to read the rows.
    """

    paper: str
    place: str
    title: str
    rows: tuple[Row, ...]
    figures: dict[str, Figure] = field(default_factory=dict)
    text: str = ""


def compared(
    what: str,
    paper: float,
    ours: float,
    tolerance: float,
    unit: str = "",
    *,
    digits: int = 2,
    basis: str = "",
    why: str = "",
) -> Row:
    """Return a row of two numbers: it agrees within the tolerance, else it differs for the reason given.

    Parameters
    ----------
    what : str
    paper, ours, tolerance : float
    unit : str
    digits : int
        Printed after the point.
    basis : str
        Where the tolerance comes from.
    why : str
        Known reason of a difference; a row beyond its tolerance without one is an error of the validation.

    Examples
    --------
    >>> compared("E_c, original", 13.87, 13.867, 0.07, "J").verdict
    'agrees'
    """
    unit = f" {unit}" if unit else ""
    shown = (f"{paper:.{digits}f}{unit}", f"{ours:.{digits}f}{unit}")
    if abs(ours - paper) <= tolerance:
        told = f"within {tolerance:.{max(digits, 1)}g}{unit}" + (f": {basis}" if basis else "")
        return Row(what, *shown, AGREES, told)
    return Row(what, *shown, DIFFERS, why or "the reason is not known")


def validate(
    progress: Callable[[str], None] | None = None, only: str | None = None, folder: Path | None = None
) -> dict[str, list[Chapter]]:
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
    told = progress or (lambda text: None)
    found: dict[str, list[Chapter]] = {}
    for machine, name in CHAPTERS.items():
        package = name.partition(".")[0]
        there = importlib.util.find_spec(package) is not None and importlib.util.find_spec(name) is not None
        if there and only in (None, machine):
            kept = (folder,) if machine in KEEPING else ()
            found[machine] = list(importlib.import_module(name).chapters(told, *kept))
    return found


def count(chapters: Iterable[Chapter]) -> dict[str, int]:
    """Return how many rows have each verdict."""
    rows = [r for c in chapters for r in c.rows]
    return {v: sum(r.verdict == v for r in rows) for v in (AGREES, DIFFERS, UNCHECKED)}


def to_markdown(chapters: Sequence[Chapter], images: str = "") -> str:
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


def to_json(chapters: Sequence[Chapter]) -> dict[str, Any]:
    """Return the validation as JSON."""
    return {
        "schema": 1,
        "count": count(chapters),
        "chapters": [
            {"paper": c.paper, "place": c.place, "title": c.title, "text": c.text, "rows": [vars(r) for r in c.rows]}
            for c in chapters
        ],
    }


def write(out: Path, chapters: Sequence[Chapter]) -> Path:
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


def _into_docs(docs: Path, machine: str, chapters: Sequence[Chapter]) -> None:
    folder = docs / "images" / "papers"
    folder.mkdir(parents=True, exist_ok=True)
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(folder / f"{name}.png", dpi=90, metadata={"Software": None})
    text = to_markdown(chapters, "../images/papers/")
    (docs / "method" / f"papers-{machine}.md").write_text(text, encoding="utf-8")
