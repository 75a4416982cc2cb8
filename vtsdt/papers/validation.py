"""The validation pages: each table and figure of the papers compared with this project, verdict and kind of every row.

A page carries the date on which it was written, a hash of the code that wrote it, and a digest of its own text, so that
a number that is edited by hand is found.
"""

from __future__ import annotations

import datetime
import hashlib
import importlib
import importlib.util
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from discrepancy.drawing.page import picture_address, rendered
from discrepancy.validation.published import AGREES, DIFFERS, KINDS, UNCHECKED, PaperChapter
from discrepancy.validation.source_hash import source_hash
from multibody.base.progress import Progress, silent

__all__ = ["CHAPTERS", "Stamp", "count", "is_as_written", "summary", "to_json", "validate", "write", "write_docs_page"]

#: Modules with the chapters of each machine, imported when needed: ``chapters(progress)`` yields them.
CHAPTERS = {
    "lift": "vtsdt.papers.lift",
    "lift-vibration": "vtsdt.papers.vibration",
    "gearbox": "gearbox.papers.gearbox",
}
#: Title of the page of each.
TITLES = {
    "lift": "The lift paper: published results, and the results of this project",
    "lift-vibration": "The lift paper's vibration: reproduced, searched for and explained",
    "gearbox": "The gearbox paper: published results, and the results of this project",
}
#: Machines whose chapters take a folder as well, in which they keep their simulations.
KEEPING = ("gearbox", "lift-vibration")
_SEAL = "Digest of this page: "
#: A link of the docs, of which the words stay elsewhere.
_LINK = re.compile(r"\[([^]]+)\]\([^)]+\)")


@dataclass(frozen=True)
class Stamp:
    """When a page was written, and by which code.

    Parameters
    ----------
    date : str
        ISO date.
    code : str
        Hash of the sources behind the chapters, of each machine.
    """

    date: str
    code: str

    @staticmethod
    def now(machines: Iterable[str] = tuple(CHAPTERS)) -> Stamp:
        """Return the stamp of today and of the code behind the chapters of some machines."""
        return Stamp(datetime.date.today().isoformat(), " and ".join(code_of(m) for m in machines))


def code_of(machine: str) -> str:
    """Return the hash of the sources that the chapters of a machine depend on; others may change as they like."""
    name = CHAPTERS[machine]
    return source_hash(name, data=(f"{name.partition('.')[0]}/files/data",))


def validate(
    progress: Progress = silent, only: str | None = None, folder: Path | None = None
) -> dict[str, list[PaperChapter]]:
    """Reproduce every table and figure and return the chapters by machine.

    Parameters
    ----------
    progress : callable, optional
        Called with a line of text for each step.
    only : {"lift", "lift-vibration", "gearbox"}, optional
        One page alone.
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


def count(chapters: Iterable[PaperChapter]) -> dict[str, dict[str, int]]:
    """Return how many rows agree and differ by kind, and how many cannot be checked.

    Returns
    -------
    dict
        ``{"predicted": {"agrees": n, "differs": n}, …, "cannot be checked": {"": n}}``.
    """
    rows = [r for c in chapters for r in c.rows]
    table = {
        kind: {v: sum(r.kind == kind and r.verdict == v for r in rows) for v in (AGREES, DIFFERS)} for kind in KINDS
    }
    return {**table, UNCHECKED: {"": sum(r.verdict == UNCHECKED for r in rows)}}


def summary(total: dict[str, dict[str, int]]) -> str:
    """Return the counts in one sentence."""
    parts = [f"{kind} {total[kind][AGREES]} agree, {total[kind][DIFFERS]} differ" for kind in KINDS]
    rows = sum(n for part in total.values() for n in part.values())
    return f"{rows} rows: " + "; ".join(parts) + f"; {total[UNCHECKED]['']} cannot be checked."


_KINDS_EXPLAINED = (
    "*Predicted*: with other admissible inputs the row would have come out otherwise, so that it is evidence. "
    "*Fitted*: numbers were chosen to meet the figure. *Identity or arithmetic*: it had to be, or nothing shows "
    "that it could have been otherwise. Verdicts and kinds are worked out from the numbers of a row."
)


def to_markdown(
    chapters: Sequence[PaperChapter],
    images: str = "",
    stamp: Stamp | None = None,
    title: str = "Published results, and the results of this project",
) -> str:
    """Return the validation as a page; ``images`` is the folder of the figures as the page sees it."""
    stamp = stamp or Stamp.now()
    total = count(chapters)
    lines = [
        f"# {title}",
        "",
        f"Written on {stamp.date} by `vtsdt validate papers`, code {stamp.code}; do not edit: `pytest tests/papers` "
        "finds it, and asserts these verdicts.",
        "",
        summary(total),
        "",
        "| | agree | differ |",
        "| --- | ---: | ---: |",
        *(f"| {kind} | {total[kind][AGREES]} | {total[kind][DIFFERS]} |" for kind in KINDS),
        "",
        _KINDS_EXPLAINED,
    ]
    paper = ""
    for chapter in chapters:
        if chapter.paper != paper:
            paper = chapter.paper
            lines += ["", f"## {paper}"]
        lines += ["", f"### {chapter.place}: {chapter.title}", ""]
        if chapter.text:
            lines += [chapter.text, ""]
        lines += ["| | paper | ours | | | |", "| --- | --- | --- | --- | --- | --- |"]
        lines += [
            f"| {cell(r.what)} | {cell(r.paper)} | {cell(r.ours)} | **{r.verdict}** | {r.kind} | {cell(r.why)} |"
            for r in chapter.rows
        ]
        lines += [line for name in chapter.figures for line in ("", f"![{chapter.place}, ours]({images}{name}.png)")]
    body = "\n".join(lines) + "\n"
    return f"{body}\n{_SEAL}{_digest(body)}\n"


def is_as_written(page: str) -> bool:
    """Whether a page is still as it was written, by the digest in its last line."""
    body, seal, digest = page.rstrip("\n").rpartition(f"\n{_SEAL}")
    return bool(seal) and _digest(body) == digest


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]


def cell(text: str) -> str:
    """Return a text as a cell of a Markdown table."""
    return text.replace("|", "\\|")


def to_json(chapters: Sequence[PaperChapter], stamp: Stamp | None = None) -> dict[str, Any]:
    """Return the validation as JSON."""
    stamp = stamp or Stamp.now()
    return {
        "schema": 2,
        "date": stamp.date,
        "code": stamp.code,
        "count": count(chapters),
        "chapters": [
            {
                "paper": c.paper,
                "place": c.place,
                "title": c.title,
                "text": c.text,
                "rows": [
                    {n: getattr(r, n) for n in ("what", "paper", "ours", "verdict", "kind", "why")} for r in c.rows
                ],
            }
            for c in chapters
        ],
    }


def write(out: Path, chapters: Sequence[PaperChapter]) -> Path:
    """Write page (HTML and Markdown), JSON and figures into a folder; return the HTML page."""
    out.mkdir(parents=True, exist_ok=True)
    images: dict[str, str] = {}
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(out / f"{name}.png", dpi=110, metadata={"Software": None})
            images[name] = picture_address((out / f"{name}.png").read_bytes())
    stamp = Stamp.now()
    (out / "validation.md").write_text(to_markdown(chapters, stamp=stamp), encoding="utf-8")
    text = json.dumps(to_json(chapters, stamp), indent=1, ensure_ascii=False) + "\n"
    (out / "validation.json").write_text(text, encoding="utf-8")
    page = out / "validation.html"
    total = count(chapters)
    page.write_text(
        rendered(
            "vtsdt",
            "validation.html",
            chapters=[(c, _paragraphs(c.text)) for c in chapters],
            images=images,
            summary=summary(total),
            kinds=_KINDS_EXPLAINED.replace("*", ""),
            stamp=stamp,
        ),
        encoding="utf-8",
    )
    return page


def _paragraphs(text: str) -> list[dict[str, Any]]:
    """Return the paragraphs and tables of a chapter's text."""
    parts: list[dict[str, Any]] = []
    for block in text.strip().split("\n\n"):
        lines = block.splitlines()
        if lines and lines[0].startswith("|"):
            cells = [[c.strip() for c in line.strip().strip("|").split(" | ")] for line in lines]
            parts.append({"head": cells[0], "rows": cells[2:]})
        elif block:
            parts.append({"text": _LINK.sub(r"\1", block)})
    return parts


def write_docs_page(docs: Path, machine: str, chapters: Sequence[PaperChapter]) -> None:
    """Write the page of a paper, and its figures, into a docs folder."""
    folder = docs / "images" / "papers"
    folder.mkdir(parents=True, exist_ok=True)
    for chapter in chapters:
        for name, figure in chapter.figures.items():
            figure.savefig(folder / f"{name}.png", dpi=90, metadata={"Software": None})
    text = to_markdown(chapters, "../images/papers/", Stamp.now((machine,)), TITLES[machine])
    (docs / "method" / f"papers-{machine}.md").write_text(text, encoding="utf-8")
