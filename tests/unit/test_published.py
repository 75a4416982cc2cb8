"""Verdict and kind of a row follow from its numbers; a page knows whether it was edited."""

from __future__ import annotations

import dataclasses
import re

import pytest

from discrepancy.validation.published import (
    AGREES,
    DIFFERS,
    FITTED,
    IDENTITY,
    PREDICTED,
    UNCHECKED,
    Check,
    PaperChapter,
    PaperRow,
    claimed,
    compared,
    unchecked,
)
from vtsdt.papers.validation import Stamp, count, is_as_written, summary, to_json, to_markdown


def test_neither_verdict_nor_kind_can_be_given() -> None:
    fields = {f.name for f in dataclasses.fields(PaperRow)}
    assert fields == {"what", "paper", "ours", "check", "why"}
    with pytest.raises(TypeError):
        PaperRow(what="x", paper="1", ours="1", verdict=AGREES)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("value", "otherwise", "fitted", "verdict", "kind"),
    [
        (1.0, (), False, AGREES, IDENTITY),  # nothing shows that it could have been otherwise
        (1.0, (1.05, 0.95), False, AGREES, IDENTITY),
        (1.0, (1.05, 1.5), False, AGREES, PREDICTED),
        (1.0, (1.5,), True, AGREES, FITTED),
        (1.5, (), False, DIFFERS, IDENTITY),
        (1.5, (1.5,), False, DIFFERS, IDENTITY),
        (1.5, (1.4,), False, DIFFERS, PREDICTED),
        (1.5, (1.0,), False, DIFFERS, PREDICTED),
    ],
)
def test_verdict_and_kind(value: float, otherwise: tuple[float, ...], fitted: bool, verdict: str, kind: str) -> None:
    row = compared("x", 1.0, value, 0.1, otherwise=otherwise, fitted=fitted, why="known")
    assert (row.verdict, row.kind) == (verdict, kind)


def test_a_difference_of_exactly_the_tolerance_agrees() -> None:
    assert compared("x", 0.3, 0.2, 0.1).verdict == AGREES
    assert compared("x", 1.0, 1.2, 0.1).why == "the reason is not known"
    assert compared("x", 1.0, 1.05, 0.1, "J", basis="b").why == "within 0.1 J: b"


def test_a_claim_has_bounds_and_shows_both_reasons_where_it_differs() -> None:
    row = claimed("R²", "≥ 0.97", "0.95", 0.95, low=0.97, otherwise=(0.98,), bar="the paper's", why="another response")
    assert (row.verdict, row.kind, row.why) == (DIFFERS, PREDICTED, "another response; the paper's")
    assert claimed("R²", "≥ 0.97", "0.98", 0.98, low=0.97, bar="the paper's").why == "the paper's"


def test_rows_need_their_reason() -> None:
    with pytest.raises(ValueError, match="needs its reason"):
        unchecked("x", "1", "2", "")
    with pytest.raises(ValueError, match="needs its reason"):
        PaperRow(what="x", paper="1", ours="2", check=Check(value=2.0, low=0.0, high=1.0))
    with pytest.raises(ValueError, match="not in order"):
        Check(value=1.0, low=2.0, high=1.0)


@pytest.fixture
def chapters() -> list[PaperChapter]:
    rows = (
        compared("a", 1.0, 1.0, 0.1, otherwise=(2.0,)),
        compared("b", 1.0, 1.0, 0.1, fitted=True),
        compared("c", 12.68, 12.43, 0.06, "J", why="known"),
        unchecked("d | e", "drawn", "—", "no number"),
    )
    return [PaperChapter(paper="p", place="Table 4", title="t", rows=rows)]


def test_rows_are_counted_by_kind_and_verdict(chapters: list[PaperChapter]) -> None:
    total = count(chapters)
    assert total[PREDICTED] == {AGREES: 1, DIFFERS: 0}
    assert total[FITTED] == {AGREES: 1, DIFFERS: 0}
    assert total[IDENTITY] == {AGREES: 0, DIFFERS: 1}
    assert total[UNCHECKED] == {"": 1}
    assert summary(total).startswith("4 rows: predicted 1 agree, 0 differ; fitted 1 agree")
    assert [r["kind"] for r in to_json(chapters)["chapters"][0]["rows"]] == [PREDICTED, FITTED, IDENTITY, ""]


def test_a_page_carries_date_and_code_and_finds_an_edited_number(chapters: list[PaperChapter]) -> None:
    page = to_markdown(chapters, stamp=Stamp("2026-11-24", "0123456789ab"))
    assert "Written on 2026-11-24 by `vtsdt validate papers`, code 0123456789ab" in page
    assert is_as_written(page)
    assert not is_as_written(page.replace("12.43 J", "12.68 J"))
    assert not is_as_written(page.replace("**differs**", "**agrees**"))
    assert not is_as_written(page.rpartition("\n\n")[0])
    assert re.fullmatch(r"[0-9a-f]{12}", Stamp.now(("lift",)).code)
    assert Stamp.now(("lift",)).code != Stamp.now(("gearbox",)).code
