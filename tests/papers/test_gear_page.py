"""The page of the gear paper in the docs: what it says is what comes out."""

from __future__ import annotations

import re

import pytest
from paper_pages import DOCS, differences, page_rows, page_text

from gearbox.papers import gearbox as papers
from gearbox.papers.energy_balance import balances_chapter
from gearbox.papers.equations import equations_chapter
from vtsdt.papers.validation import is_as_written


def silent(text: str) -> None:
    """Swallow progress."""


def test_the_page_is_as_it_was_written() -> None:
    page = page_text("gearbox")
    assert is_as_written(page)
    assert not is_as_written(page.replace("0.689", "0.690", 1))


PLACES = [
    "Figs. 1 to 4",
    "Tables 1 and 2, Eqs. 15 to 17",
    "Table 5",
    "Figs. 5, 6 and 11, Table 6",
    "Section 4.1",
    "Eqs. 1 to 20",
    "Eq. 18 and Table 4",
    "Section 4.4.2",
    "Fig. 8",
    "Figs. 9 and 10, flexible housing",
    "Table 4, Figs. 7, 12 and 13, flexible housing",
    "Figs. 9 and 10, rigid housing",
    "Table 4, Figs. 7, 12 and 13, rigid housing",
    "Section 4.5, flexible housing",
    "Section 4.5, rigid housing",
    "Sections 3.4 and 4.4, flexible housing",
    "Sections 3.4 and 4.4, rigid housing",
]


def test_every_table_and_figure_has_its_place() -> None:
    page = page_text("gearbox")
    assert [line[4:].partition(": ")[0] for line in page.splitlines() if line.startswith("### ")] == PLACES
    assert numbered("Fig") == set(range(1, 14))
    assert numbered("Table") >= {1, 2, 4, 5, 6}  # Table 3, the ranges, is Eq. 19 and Fig. 8
    rows = {what: cells for (_, what), cells in page_rows("gearbox").items()}
    for k in range(1, 5):
        assert any(what.startswith(f"Fig. {k}, ") for what in rows)
    for housing in ("flexible", "rigid"):
        assert rows[next(w for w in rows if w.startswith(f"time of one second of signal, {housing}"))][1].startswith(
            "about 5 min"
        )
    pictures = set(re.findall(r"!\[.*?, ours\]\(.*/(.*?)\.png\)", page))
    for housing in ("flexible", "rigid"):
        wanted = {f"gear-fig-11-condition-{k}-{housing}" for k in (1, 2, 3)}
        wanted |= {f"gear-fig{n}-{housing}" for n in ("s-5-6", "s-7-13", "-8", "s-9-10", "-12")}
        assert wanted <= pictures
    for name in pictures:
        assert (DOCS.parent / "images" / "papers" / f"{name}.png").is_file()


def numbered(what: str) -> set[int]:
    """Return the numbers of tables or figures that the places name; "1 to 4" is all four."""
    found: set[int] = set()
    for part in re.findall(rf"{what}\w*\. ([\d, and to]+)|{what}s? ([\d, and to]+)", "; ".join(PLACES)):
        text = next(filter(None, part))
        for first, last in re.findall(r"(\d+) to (\d+)", text):
            found |= set(range(int(first), int(last) + 1))
        found |= {int(n) for n in re.findall(r"\d+", text)}
    return found


def test_quick_rows_come_out_as_on_the_page() -> None:
    page_text("gearbox")
    quick = (
        papers._drawings(),
        papers._geometry(),
        papers._table_5(),
        papers._table_6(silent),
        balances_chapter(),
        equations_chapter(),
    )
    assert differences("gearbox", quick) == []


def test_joint_speeds_are_not_told_as_agreeing_where_they_are_more_than_rounding_off() -> None:
    assert [r.verdict for r in papers._table_5().rows] == ["differs", "differs", "differs", "agrees"]


def test_no_bar_of_our_own_is_told_as_the_paper_agreeing() -> None:
    """Counts over designs and seeds are ours alone: the paper has one design and one run."""
    rows = page_rows("gearbox")
    counts = [cells for cells in rows.values() if re.match(r"\d+ of \d+ ", cells[2])]
    assert len(counts) > 10
    assert {cells[3] for cells in counts} == {"**cannot be checked**"}


def test_the_chain_succeeds_where_the_truth_lies_inside_the_model() -> None:
    """At least 9 of 10 designs rise and stay above 0.7: a bar of this project."""
    rows = {w: cells for (place, w), cells in page_rows("gearbox").items() if place == PLACES[-2]}
    for what in ("optimum of the surface, simulated, above the start", "above 0.7 at conditions 1, 2 and 3"):
        found = re.match(r"(\d+) of (\d+)", rows[f"truth inside the model, Eq. 8: {what}"][2])
        assert found is not None
        assert int(found[2]) == 10
        assert int(found[1]) >= 9


def test_the_page_has_the_ranking_of_two_housings_and_surfaces_of_six_sizes() -> None:
    rows = {what: cells for (_, what), cells in page_rows("gearbox").items()}
    assert ("Figs. 9 and 10, flexible housing", "25 points: R² fitted, left out, test") in page_rows("gearbox")
    for housing in ("flexible", "rigid"):
        ranking = rows[f"ranges of the similarity over Table 3, {housing} housing"][2]
        assert {part.split()[0] for part in ranking.split(", ")} == {"K", "C_D", "e_F", "D_P", "E", "rho"}
    for n in (25, 30, 35, 40, 45, 50):
        assert "order 3" in rows[f"{n} points: R² fitted, left out, test"][2]


def test_errors_of_manufacturing_as_parameters_mend_what_contact_parameters_cannot() -> None:
    """The furthest below the bound of mesh lines, at conditions held out: of the rows, not of the text."""
    rows = page_rows("gearbox")
    for housing in ("flexible", "rigid"):
        place = f"Section 4.5, {housing} housing"
        of = {what: cells[2] for (where, what), cells in rows.items() if where == place}

        def held_out(what: str, of: dict[str, str] = of) -> list[float]:
            return [float(v) for v in of[what].split(";")[1].split(",")]

        bound = held_out("bound of mesh lines")
        short = {w: max(b - v for b, v in zip(bound, held_out(w), strict=True)) for w in of}
        contact = min(v for w, v in short.items() if w.startswith("K, C_D, e_F"))
        assert min(v for w, v in short.items() if w.startswith("errors of manufacturing too")) < 0.5 * contact


@pytest.mark.slow
def test_every_row_comes_out_as_on_the_page(gear_runs) -> None:
    """An hour and a half on one processor."""
    page_text("gearbox")
    assert differences("gearbox", papers.chapters(silent, gear_runs)) == []
