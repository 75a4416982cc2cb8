"""The study of the alignment sensor: scores, what is kept of an interrupted run, and the page."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from vtsdt.alignment import study as alignment_study
from vtsdt.alignment.filter import TUNINGS
from vtsdt.alignment.result import Alignment
from vtsdt.alignment.score import Score, score
from vtsdt.alignment.study import run_study
from vtsdt.alignment.study_lines import TEN_TRIPS, UNDISTURBED, LiftScores, lines
from vtsdt.alignment.study_page import page, rate

HEIGHT = np.round(np.arange(0.0, 1.901, 0.01), 2)


def estimated(curve: np.ndarray, spread: float = 0.05e-3) -> Alignment:
    """An estimate from ten trips that are off a curve to both sides."""
    off = spread * np.linspace(-1.5, 1.5, 10)[:, None]
    return Alignment(
        height=HEIGHT,
        trips=tuple(f"{k}" for k in range(10)),
        directions=np.ones(10),
        curves=curve + off,
        threshold=2.3e-3,
        tuning=TUNINGS["bounded"],
        tension_error=0.0,
        shoes=(0.03, 0.55),
        loose=1.2e-3,
        slope=3.8e3,
    )


def bumps(*places: tuple[float, float, float]) -> np.ndarray:
    """A deviation of 2 mm with more between heights."""
    curve = np.full(HEIGHT.size, 2.0e-3) + 1e-5 * np.sin(9.0 * HEIGHT)
    for low, high, size in places:
        curve += np.where(np.abs(HEIGHT - 0.5 * (low + high)) < 0.5 * (high - low) + 1e-9, size, 0.0)
    return curve


def scored(correlation: float, median: float, rms: float, false: int, missed: int) -> Score:
    return Score(correlation=correlation, median_correlation=median, rms=rms, false=false, missed=missed, coverage=0.9)


def test_every_wrong_section_is_reported_with_its_numbers():
    truth = bumps((0.3, 0.4, 0.5e-3), (0.8, 0.9, 0.32e-3))
    result = score(estimated(bumps((0.3, 0.4, 0.5e-3), (0.8, 0.9, 0.28e-3), (1.2, 1.4, 0.4e-3))), HEIGHT, truth)
    assert (result.false, result.missed) == (1, 1)
    false, missed = result.wrong
    assert (false.low, false.high) == pytest.approx((1.2, 1.4))
    assert false.true < 2.02e-3
    assert "missed, 0.80 to 0.90 m: the largest true deviation is 0.03 mm above the threshold" in missed.sentence()
    assert missed.sentence().endswith("; listed as undecided")
    assert Score.of(json.loads(json.dumps(dataclasses.asdict(result)))) == result


def test_a_score_lists_what_it_does_not_reach():
    assert scored(0.95, 0.9, 0.2e-3, 1, 1).passed
    assert not scored(0.85, 0.9, 0.2e-3, 1, 1).passed
    assert scored(0.85, 0.9, 0.4e-3, 2, 0).shortfalls() == ["correlation 0.850", "error 0.40 mm", "2 false"]
    assert not scored(float("nan"), 0.9, 0.2e-3, 0, 0).passed


def test_rates_have_the_interval_of_clopper_and_pearson():
    """Tables of exact binomial limits: 8 of 10 has 44.4 to 97.5 %."""
    assert rate(8, 10) == "8 of 10 (44 to 97 %)"
    assert rate(0, 10) == "0 of 10 (0 to 31 %)"


@pytest.fixture
def stubs(monkeypatch):
    """Lifts that cost nothing; every line that is run is listed."""
    ran: list[str] = []

    class Case:
        def __init__(self, seed):
            self.seed, self.height, self.pressing = seed, HEIGHT, bumps()
            self.evaluated = type(
                "Visit", (), {"truth": dict.fromkeys(("cabin_guide.mu", "cabin_guide.stiffness", "cabin.mass"), 1.0)}
            )

        def scaled(self):
            return None, 1.0

    def line_score(case, line):
        ran.append(f"{case.seed} {line.what}")
        return scored(0.95, 0.93, 0.1e-3, 0, 0) if line.group != "tuning" else "trip 1: the filter diverges"

    monkeypatch.setattr(alignment_study, "make_case", lambda seed, progress: Case(seed))
    monkeypatch.setattr(alignment_study, "_line_score", line_score)
    monkeypatch.setattr(alignment_study, "_draw", lambda case, folder: None)
    return ran


def test_an_interrupted_study_continues(tmp_path, stubs, monkeypatch):
    lifts = run_study([101, 102], tmp_path, groups=["as recorded"])
    assert [t.seed for t in lifts] == [101, 102]
    assert stubs == [f"101 {TEN_TRIPS}", f"102 {TEN_TRIPS}"]
    run_study([101, 102], tmp_path, groups=["as recorded", "disturbing force"])
    assert stubs[2:] == [f"101 {UNDISTURBED}", f"102 {UNDISTURBED}"]
    again = run_study([101, 102], tmp_path, groups=["as recorded", "disturbing force"])
    assert len(stubs) == 4
    assert again[0].score(UNDISTURBED).correlation == 0.95
    monkeypatch.setattr(alignment_study, "_code", lambda: "another")
    run_study([101], tmp_path, groups=["as recorded"])
    assert stubs[4:] == [f"101 {TEN_TRIPS}"]


def test_the_page_gives_rates_reasons_and_refusals(tmp_path, stubs):
    lifts = run_study([31, 101], tmp_path, groups=["as recorded", "tuning", "disturbing force"])
    short = scored(0.7, 0.6, 0.35e-3, 0, 0)
    lifts[1] = dataclasses.replace(lifts[1], scores={**lifts[1].scores, f"as recorded: {TEN_TRIPS}": short})
    text = page(lifts, "python -m vtsdt.alignment.study")
    assert "The lifts 31 were used while the method was developed." in text
    assert "| RMS error at most 0.3 mm | 1 of 2 (1 to 99 %) |" in text
    assert "- Lift 101: falls short with correlation 0.700, error 0.35 mm" in text
    assert "without the disturbing force reach it: correlation 0.950" in text
    assert "two trips of another lift: the filter diverges (lifts 31, 101)" in text
    rows = [row for row in text.splitlines() if row.startswith("|")]
    widths = {row.replace("\\|", "").count("|") for row in rows}
    assert widths == {18, 3, 14}


def test_lines_have_names_of_their_own():
    names = [line.name for line in lines()]
    assert len(set(names)) == len(names)
    assert len({line.what for line in lines() if line.what in (TEN_TRIPS, UNDISTURBED)}) == 2
    assert LiftScores(seed=1, friction=1.0, mass=1.0, factor=1.0, spread=1e-4, scores={}).score(TEN_TRIPS) is None
