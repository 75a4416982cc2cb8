"""Reads the papers' pages in the docs, and holds rows that come out now against those of the page."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from discrepancy.validation.published import PaperChapter
from vtsdt.papers.validation import cell

DOCS = Path(__file__).resolve().parents[2] / "docs" / "method"
#: Rows that begin so are not compared number by number: computing times, and estimates that follow rounding.
NOT_COMPARED = ("time of", "Fig. 9's trips and", "correlation on Fig. 9's trips")
#: A number, with its sign.
_NUMBER = re.compile(r"[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def page_text(machine: str) -> str:
    """Return the page of a machine; skips where the page in the docs has not been written by today's command yet."""
    text = (DOCS / f"papers-{machine}.md").read_text(encoding="utf-8")
    if "Digest of this page: " not in text and "| predicted |" not in text:
        pytest.skip(f"an older page without kinds: vtsdt validate papers --only {machine} --out out --docs docs")
    return text


def page_rows(machine: str) -> dict[tuple[str, str], list[str]]:
    """Return the cells of every row of a page by place and first cell."""
    rows, place = {}, ""
    for line in page_text(machine).splitlines():
        if line.startswith("### "):
            place = line[4:].partition(": ")[0]
        cells = [c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 6 and cells[0] and not cells[0].startswith("---"):
            rows[place, cells[0]] = cells
    return rows


def differences(machine: str, chapters: Iterable[PaperChapter], *, kinds: bool = True) -> list[str]:
    """Return how rows that come out now differ from those of the page.

    Verdict and kind must be the same, and every number of ours to 2 % or two units of its last digit: simulations of
    another processor differ by rounding only, which contact and a filter make larger.  Differences of rounding (1e-16)
    and rows of `NOT_COMPARED` are not compared.  Without ``kinds`` the kind of a verdict is not: it takes the
    admissible alternatives, which cost minutes.
    """
    page, found = page_rows(machine), []
    for chapter in chapters:
        for row in chapter.rows:
            key = (chapter.place, cell(row.what))
            if key not in page:
                found.append(f"{key}: not on the page")
                continue
            _, paper, ours, verdict, kind, _ = page[key]
            same_kind = kind == row.kind or not kinds
            if (paper, verdict) != (cell(row.paper), f"**{row.verdict}**") or not same_kind:
                found.append(
                    f"{key}: {paper}, {verdict}, {kind} on the page; {row.paper}, {row.verdict}, {row.kind} now"
                )
            if not row.what.startswith(NOT_COMPARED) and not _same(ours, cell(row.ours)):
                found.append(f"{key}: {ours} on the page, {row.ours} now")
    return found


def _same(one: str, other: str) -> bool:
    if _NUMBER.sub("#", one) != _NUMBER.sub("#", other):
        return False
    return all(_near(a, b) for a, b in zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True))


def _near(a: str, b: str) -> bool:
    x, y = (float(n.replace("−", "-")) for n in (a, b))
    if max(abs(x), abs(y)) < 1e-8:
        return True
    decimals = len(a.partition("e")[0].partition(".")[2])
    exponent = int(a.partition("e")[2] or 0)
    return abs(x - y) <= max(0.02 * abs(x), 2.0 * 10.0 ** (exponent - decimals))
