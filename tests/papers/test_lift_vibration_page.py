"""The page on the lift paper's vibration: its failure comes out again, and an edited number is found."""

from __future__ import annotations

import re

import pytest
from paper_pages import differences, page_rows, page_text

from discrepancy.validation.published import DIFFERS
from vtsdt.papers.validation import is_as_written
from vtsdt.papers.vibration import CAUSES, PRINTED, REACHED, as_the_paper, chapters, figures_of

FAILURE, FOUND = "Table 3, vibration", "Section IV-D, vibration"


def silent(text: str) -> None:
    """Swallow progress."""


def test_the_page_is_as_it_was_written() -> None:
    page = page_text("lift-vibration")
    assert is_as_written(page)
    assert not is_as_written(page.replace("0.59", "0.60", 1))
    assert [line[4:].partition(": ")[0] for line in page.splitlines() if line.startswith("### ")] == [FAILURE, FOUND]


def test_each_cause_is_brought_to_the_failure_or_told_not_to_be_able_to() -> None:
    rows = page_rows("lift-vibration")
    for cause in CAUSES:
        row = rows[FAILURE, f"ρ(z̈) with {cause.what}, {cause.size}"]
        reached = abs(float(row[2]) - PRINTED["a_c"][2]) <= REACHED
        assert (row[4] == "fitted") is reached is cause.fitted
        assert ((FOUND, f"{cause.what}: named") in rows) is cause.searched


def test_the_error_falls_with_what_is_named() -> None:
    """On the trip held out; what is left is the noise, the disturbance and the shape that no effect has."""
    rows = page_rows("lift-vibration")
    for cause in (c for c in CAUSES if c.searched):
        ours = rows[FOUND, f"{cause.what}: RMSE(z̈) and ρ(z̈) held out"][2]
        errors = [float(v) for v in re.findall(r"([\d.]+) m/s²", ours)]
        assert len(errors) == 3
        assert errors[2] < errors[0]


def test_a_noisy_reference_makes_the_model_vibrate_as_the_paper_says() -> None:
    """The paper's ρ and RMSE of the vertical acceleration, from noise of ω_ref alone."""
    noise = next(c for c in CAUSES if "reference" in c.what)
    error, rho = figures_of(as_the_paper(noise.settings).stages[0])["a_c"]
    assert rho == pytest.approx(PRINTED["a_c"][2], abs=REACHED)
    assert error == pytest.approx(PRINTED["a_c"][1], rel=0.05)  # not fitted: the bench's own acceleration gives it


@pytest.mark.slow
def test_every_row_comes_out_as_on_the_page() -> None:
    """Half an hour on one processor."""
    made = list(chapters(silent))
    assert differences("lift-vibration", made) == []
    gains = made[0].rows[-1]
    assert gains.verdict == DIFFERS
