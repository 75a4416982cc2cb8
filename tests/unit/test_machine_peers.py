"""Other methods on cases with a truth: how a truth is read, an answer is scored, and the page counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from discrepancy.validation.machines.peers import CaseAnswers, Truth, main, our_answer, peers_page, score


def written(path: Path, data: dict[str, Any]) -> Path:
    path.write_text(json.dumps(data))
    return path


def test_a_kind_without_a_place_is_right_everywhere_and_a_tie_by_any_name(tmp_path: Path) -> None:
    effects = [{"accept": ["backlash", "slip@belt"]}]
    single = Truth.read(written(tmp_path / "a.json", {"category": "single", "effects": effects}))
    assert single.accept == (("backlash@*", "slip@belt"),)
    tie = {"category": "ambiguous", "effects": effects, "tie_set": ["drag", "backlash"]}
    assert Truth.read(written(tmp_path / "b.json", tie)).accept == (("drag@*", "backlash@*"),)
    outside = {"category": "outside", "effects": effects, "tie_set": None}
    assert Truth.read(written(tmp_path / "c.json", outside)).accept == ()


PAIR = Truth(category="double", accept=(("drag@*",), ("slip@belt",)))


@pytest.mark.parametrize(
    ("sets", "right", "first", "among", "invented"),
    [
        ([["drag@axle"], ["slip@belt"]], True, True, True, 0),
        ([["drag@axle"]], False, True, False, 0),
        ([["bump@axle", "drag@axle"], ["slip@belt"]], True, False, True, 0),
        ([["drag@axle"], ["slip@belt"], ["bump@axle"]], False, True, True, 1),
        ([], False, False, False, 0),
    ],
)
def test_all_hidden_and_nothing_else_is_right(
    sets: list[list[str]], right: bool, first: bool, among: bool, invented: int
) -> None:
    names = score(PAIR, sets, alarm=bool(sets), unknown=False)
    assert (names["right"], names["first"], names["all_found"], names["invented"]) == (right, first, among, invented)


def test_nothing_and_unknown_are_right_where_they_are_true() -> None:
    nothing, outside = Truth(category="none", accept=()), Truth(category="outside", accept=())
    silent: dict[str, Any] = {"alarm": False, "unknown": False}
    aware: dict[str, Any] = {"alarm": True, "unknown": True}
    assert score(nothing, [], **silent)["right"]
    assert not score(nothing, [], **aware)["right"]
    assert score(outside, [], **aware)["right"]
    assert not score(outside, [], **silent)["right"]
    assert score(outside, [["drag@axle"]], **aware)["invented"] == 1


def diagnosis(named: list[str], verdict: str, last: float) -> dict[str, Any]:
    effects = [dict(zip(("kind", "where"), name.split("@"), strict=True)) for name in named]
    stages = [{"validate": {"y": {"rmse": rmse}}} for rmse in (3.0, 2.0, last)]
    return {"effects": effects, "verdict": verdict, "stages": stages}


def test_our_own_answer_is_scored_by_the_same_rule() -> None:
    found = our_answer(PAIR, diagnosis(["drag@axle", "slip@belt"], "effect found", 1.0))
    assert (found["right"], found["worse"], found["ratio"]) == (True, False, 0.5)
    worse = our_answer(PAIR, diagnosis(["drag@axle", "unknown_force@belt"], "partly explained", 2.1))
    assert (worse["named"], worse["worse"], worse["alarm"]) == (["drag@axle"], True, True)


def test_the_page_counts_and_lists(tmp_path: Path) -> None:
    right = score(PAIR, [["drag@a"], ["slip@belt"]], alarm=True, unknown=False)
    right |= {"ratio": 0.5, "worse": False}
    cases = [
        CaseAnswers(case="one", category="double", answers={"this program": right, "lasso": {"failed": "singular"}}),
        CaseAnswers(case="two", category="none", note="failed: no record"),
    ]
    page = peers_page(cases, title="Others", source="today")
    assert "| this program | 1/1 (15 to 100 %) | – | 1/1 (15 to 100 %) |" in page
    assert "| one | double | right: drag@a, slip@belt | failed |" in page
    assert "- two: failed: no record" in page


def test_a_folder_without_cases_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path), "--out", str(tmp_path / "out")])
    assert f"no folder with study.toml and truth.json in {tmp_path}" in capsys.readouterr().err
