"""What the page of the lift paper says: its rows come out again, and an edited number is found."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from paper_pages import differences, page_text

from discrepancy.validation.published import AGREES, DIFFERS, FITTED, IDENTITY, PREDICTED, UNCHECKED, PaperChapter
from vtsdt.papers import validation as papers
from vtsdt.papers.equations import equations_chapter
from vtsdt.papers.lift import chapters
from vtsdt.papers.reduced_models import drawings_chapter, figure_5_chapter, table_1_chapter
from vtsdt.papers.table_4 import FITTED as FITTED_FIGURES
from vtsdt.papers.table_4 import NAMES, ROUNDING, TABLE_4, figures_of, refitted
from vtsdt.papers.table_4 import _columns as columns

PLACES = [
    "Figs. 1 to 4 and 7",
    "Table 1",
    "Fig. 5",
    "Fig. 6",
    "Eqs. 1 to 31",
    "Table 2",
    "Fig. 8",
    "Fig. 9",
    "Fig. 10",
    "Table 3 and Fig. 11",
    "Table 4 and Fig. 12",
    "Fig. 13",
]


def silent(text: str) -> None:
    """Swallow progress."""


# -------------------------------------------------------------------- quick


def test_the_page_is_as_it_was_written() -> None:
    page = page_text("lift")
    assert papers.is_as_written(page)
    assert not papers.is_as_written(page.replace("12.68 J", "12.69 J", 1))
    assert [line[4:].partition(": ")[0] for line in page.splitlines() if line.startswith("### ")] == PLACES


@pytest.fixture(scope="module")
def quick() -> dict[str, PaperChapter]:
    """The chapters that take seconds."""
    made = (drawings_chapter(), table_1_chapter(), figure_5_chapter(()), equations_chapter())
    return {c.place: c for c in made}


def test_quick_rows_come_out_as_on_the_page(quick: dict[str, PaperChapter]) -> None:
    without_other_benches = quick["Fig. 5"]
    assert differences("lift", [c for c in quick.values() if c is not without_other_benches]) == []
    assert differences("lift", [without_other_benches], kinds=False) == []


def test_every_equation_is_exact_and_only_slips_of_the_print_differ(quick: dict[str, PaperChapter]) -> None:
    rows = quick["Eqs. 1 to 31"].rows
    assert {r.what for r in rows if r.verdict == DIFFERS} == {
        f"{e} as printed" for e in ("Eq. 3", "Eq. 11", "Eqs. 26, 29", "Eq. 30")
    }
    numbers = " ".join(r.what.replace("Eqs.", "").replace("Eq.", "") for r in rows).replace(",", "").split()
    assert {int(n) for n in numbers if n.isdigit()} == set(range(1, 32))


def test_the_bench_meets_the_figures_that_it_was_fitted_to_and_no_others_are_told_as_fitted() -> None:
    """Four numbers, four figures: E_c of the column "straightened" is one of them."""
    from vtsdt.files.parameters import LiftParameters

    ours = columns(LiftParameters.bench())
    for name, column in FITTED_FIGURES:
        assert figures_of(ours[column])[name] == pytest.approx(TABLE_4[column][NAMES.index(name)], abs=ROUNDING)
    assert ("E_c", "straightened") in FITTED_FIGURES


def test_the_original_column_allows_other_centres_of_mass() -> None:
    """An independent program has 12.17 J for 10 mm and 12.93 J for 25 mm, guides fitted again."""
    import dataclasses

    from vtsdt.files.parameters import LiftParameters

    bench = LiftParameters.bench()
    original = tuple(f for f in FITTED_FIGURES if f[1] == "original")
    for y, straight in ((10e-3, 12.17), (25e-3, 12.93)):
        com = (bench.cabin.com[0], y, bench.cabin.com[2])
        made = refitted(dataclasses.replace(bench, cabin=dataclasses.replace(bench.cabin, com=com)), original)
        assert made is not None
        energies = columns(made)
        assert energies["original"].E_m == pytest.approx(20.23, abs=0.01)
        assert 100 * energies["original"].eta_t == pytest.approx(48.42, abs=0.02)
        assert energies["straightened"].E_c == pytest.approx(straight, abs=0.01)


# -------------------------------------------------------------------- slow


@pytest.fixture(scope="module")
def lift() -> dict[str, PaperChapter]:
    return {c.place: c for c in chapters(silent)}


@pytest.mark.slow
def test_every_row_comes_out_as_on_the_page(lift: dict[str, PaperChapter]) -> None:
    page_text("lift")
    assert list(lift) == PLACES
    assert differences("lift", lift.values()) == []


@pytest.mark.slow
def test_what_is_evidence_and_what_is_not(lift: dict[str, PaperChapter]) -> None:
    rows = {(c.place, r.what): r for c in lift.values() for r in c.rows}
    table = {what: r for (place, what), r in rows.items() if place.startswith("Table 4")}
    for name, column in FITTED_FIGURES:
        assert table[f"{name}, {column}"].kind == FITTED
    for column in TABLE_4:
        assert table[f"η_t, {column}"].kind == IDENTITY
        assert table[f"|E_m|, {column}"].kind == IDENTITY
    whole = table["E_c, straightened, from the original column alone"]
    assert (whole.verdict, whole.kind) == (AGREES, PREDICTED)
    tuned = [r for (place, what), r in rows.items() if place == "Table 2" and what.startswith("Fig. 9's trips and")]
    assert [r.verdict for r in tuned] == [DIFFERS, DIFFERS]
    estimate = rows["Fig. 9", "“good correlation with deviations of the guide”"]
    assert (estimate.verdict, estimate.kind) == (AGREES, PREDICTED)
    assert rows["Fig. 10", "configurations not above the threshold"].kind == IDENTITY
    assert not [r.what for r in rows.values() if "not known" in r.why]


@pytest.mark.slow
def test_corrected_guides_are_below_the_threshold(lift: dict[str, PaperChapter]) -> None:
    corrected = [r for r in lift["Fig. 13"].rows if r.what.startswith("mean deviation")]
    assert corrected
    for row in corrected:
        before, after = (float(part.split()[0]) for part in row.ours.split(", "))
        assert after < before
        assert after < 2.3 + 0.15


@pytest.mark.slow
def test_pages_are_written(lift: dict[str, PaperChapter], tmp_path: Path) -> None:
    made = list(lift.values())
    page = papers.write(tmp_path, made)
    text = page.read_text(encoding="utf-8")
    assert text.count("<h2>") == len(made)
    assert "http" not in text
    content = json.loads((tmp_path / "validation.json").read_text())
    assert content["count"] == papers.count(made)
    assert content["count"][UNCHECKED][""] > 0
    assert papers.is_as_written((tmp_path / "validation.md").read_text(encoding="utf-8"))
    assert {p.stem for p in tmp_path.glob("*.png")} == {f"papers_fig{k}" for k in (5, 6, 8, 9, 10, 11, 12, 13)}
