"""The validation page: each table and figure of the papers, compared with this project, and a verdict on every row.

A row agrees within a stated tolerance, differs for a stated reason, or cannot be checked for a stated reason.
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

__all__ = ["CHAPTERS", "count", "to_json", "validate", "write", "write_docs_page"]

#: Modules with the chapters of each machine, imported when needed: ``chapters(progress)`` yields them.
CHAPTERS = {"lift": "vtsdt.papers.lift", "gearbox": "gearbox.papers.gearbox"}
#: Machines whose chapters take a folder as well, in which they keep their simulations.
KEEPING = ("gearbox",)


def validate(
    progress: Progress = silent, only: str | None = None, folder: Path | None = None
) -> dict[str, list[PaperChapter]]:
    """Reproduce every table and figure and return the chapters by machine.

    Parameters
    ----------
    progress : callable, optional
        Called with a line of text for each step.
    only : {"lift", "gearbox"}, optional
        One paper alone.
    folder : Path, optional
        Keeps the simulations, so that an interrupted run continues.
    """
    chapters: dict[str, list[PaperChapter]] = {}
    for machine, name in CHAPTERS.items():
        package = name.partition(".")[0]
        installed = importlib.util.find_spec(package) is not None and importlib.util.find_spec(name) is not None
        if installed and only in (None, machine):
            kept = (folder,) if machine in KEEPING else ()
            chapters[machine] = list(importlib.import_module(name).chapters(progress, *kept))
    return chapters


def count(chapters: Iterable[PaperChapter]) -> dict[str, int]:
    """Return how many rows have each verdict."""
    rows = [r for c in chapters for r in c.rows]
    return {v: sum(r.verdict == v for r in rows) for v in (AGREES, DIFFERS, UNCHECKED)}


def to_markdown(chapters: Sequence[PaperChapter], images: str = "") -> str:
    """Return the validation as a page; ``images`` is the folder of the figures as the page sees it."""
    total = count(chapters)
    lines = [
        "# Published results, and the results of this project",
        "",
        "Written by `vtsdt validate papers`; do not edit. `pytest tests/papers` asserts these verdicts.",
        "",
        f"{sum(total.values())} rows: {total[AGREES]} agree, {total[DIFFERS]} differ for a stated reason, "
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


def write_docs_page(docs: Path, machine: str, chapters: Sequence[PaperChapter]) -> None:
    """Write the page of a paper, and its figures, into a docs folder."""
    folder = docs / "images" / "papers"
    folder.mkdir(parents=True, exist_ok=True)
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(folder / f"{name}.png", dpi=90, metadata={"Software": None})
    text = to_markdown(chapters, "../images/papers/")
    (docs / "method" / f"papers-{machine}.md").write_text(text, encoding="utf-8")
