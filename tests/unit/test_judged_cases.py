"""Cases on machines of plain equations: their grading, their files, the score of an answer, probabilities that hold."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discrepancy.problem.study_file import read_study
from discrepancy.validation.machines.case import FINAL, Case, CaseError, _Graded, draw, write
from discrepancy.validation.machines.command import main
from discrepancy.validation.machines.disturbances import SPECTRA, Disturbance, drawn_disturbance, modes
from discrepancy.validation.machines.evidence_of_truth import evidence_of_truth, study_with_truth_alone
from discrepancy.validation.machines.fleet import NAMES, machine_named
from discrepancy.validation.machines.grading import Information, information, stacked
from discrepancy.validation.machines.judge import judged
from discrepancy.validation.machines.machine import Effect
from discrepancy.validation.machines.page import counts, page
from discrepancy.validation.machines.reliability import (
    brier_score,
    calibration_error,
    fitted_temperature,
    reliability,
    reliability_figure,
    tempered,
)
from discrepancy.validation.machines.simulate import _with_errors, simulate
from discrepancy.validation.machines.suite import COLUMNS, cases
from discrepancy.validation.machines.temperature import temperature_lines, tried_models

SHORT = replace(machine_named("flywheel"), rows=400)
LATE = slice(0, SHORT.identify)


def test_nats_of_a_slope_beside_a_free_level_are_those_of_the_closed_form() -> None:
    """A slope in white noise beside a free level: the sum of squares, in part about the mean."""
    t = np.linspace(0.0, 1.0, 200)
    noise, prior, slope = 0.3, 0.7, 0.4
    found = Information(np.full(200, noise), np.full((200, 1), prior)).nats(slope * t)
    dense = noise**2 * np.eye(200) + prior**2 * np.ones((200, 200))
    shrunk = prior**2 / (prior**2 + noise**2 / 200)
    closed = 0.5 * slope**2 / noise**2 * ((t**2).sum() - shrunk * 200 * t.mean() ** 2)
    assert found == pytest.approx(0.5 * slope**2 * t @ np.linalg.solve(dense, t), rel=1e-9)
    assert found == pytest.approx(closed, rel=1e-9)


def test_the_weight_of_a_machine_is_that_of_its_closed_form() -> None:
    """A wheel without friction: speed = ∫ torque / J.  Its only uncertain parameter and its start are linear."""
    bare = replace(
        SHORT,
        parameters=(replace(SHORT.parameters[0], std=0.05),),
        identify=1,
        constants={**SHORT.constants, "b": 0.0, "T_c": 0.0},
        channels=(replace(SHORT.channels[0], noise=0.05),),
    )
    t = bare.times
    torque = np.ones((t.size, 1))
    weight = information(bare, {"J": 0.85}, {"torque": torque}, Disturbance(), np.random.default_rng(0))
    pull = simulate(bare, {"J": 0.85, "pull": 0.1}, {"torque": torque})["speed"]
    d = stacked(bare, {"speed": pull - simulate(bare, {"J": 0.85}, {"torque": torque})["speed"]}).ravel()
    noise = weight.deviation[0]
    assert noise == pytest.approx(0.05, rel=0.1)
    start, inertia = np.full(t.size, bare.starts[0].std), -0.05 * t / 0.85**2
    dense = noise**2 * np.eye(t.size) + np.outer(start, start) + np.outer(inertia, inertia)
    ramp = 0.1 * t / 0.85
    np.testing.assert_allclose(d, ramp, atol=1e-9)
    assert weight.nats(d) == pytest.approx(0.5 * ramp @ np.linalg.solve(dense, ramp), rel=0.01)


def test_a_late_sensor_is_late_and_does_not_smooth() -> None:
    """A sine of a tenth of the sampling rate, 0.3 and 0.5 of a sample late; a polygon would take 5 % of its size."""
    t = np.tile(np.arange(200.0)[:, None], (1, 2))
    p = SimpleNamespace(speed_gain=0.0, speed_offset=0.0, speed_drift=0.0, speed_delay=np.array([0.3, 0.5]))
    seen = _with_errors(np.sin(0.2 * np.pi * t), SHORT.channels[0], p, t)
    np.testing.assert_allclose(seen[5:-5], np.sin(0.2 * np.pi * (t - p.speed_delay))[5:-5], atol=2e-3)


@pytest.mark.parametrize("spectrum", SPECTRA)
def test_modes_of_a_disturbance_have_its_covariance(spectrum: str) -> None:
    t = np.linspace(0.0, 10.0, 120)
    process = drawn_disturbance(np.random.default_rng(3), {"cart": 2.0}, 10.0, spectrum=spectrum)
    every = modes(process, t, every=True)
    np.testing.assert_allclose(every.T @ every, process.covariance(t[:, None] - t[None, :]), atol=1e-6 * process.rms**2)


def test_the_likelihood_of_a_case_rises_by_its_nats() -> None:
    """½ r₀ᵀS⁻¹r₀ − ½ r₁ᵀS⁻¹r₁ has the mean of the nats, and a standard deviation of √(2 nats)."""
    gains = []
    for seed in range(4):
        drawn = draw(Case(machine="flywheel", what="windage", nats=100.0, seed=seed), SHORT)
        values = {k: v[LATE] if np.ndim(v) else v for k, v in drawn.values.items()}
        drives = {k: v[:, LATE] for k, v in drawn.drives.items()}
        weight = information(SHORT, {**values, "drag": 0.0}, drives, drawn.disturbance, np.random.default_rng(0))
        record = drawn.recorded["speed"][:, LATE]
        r = [
            (record - simulate(SHORT, {**values, "drag": c}, drives)["speed"]).ravel()
            for c in (0.0, drawn.hidden["windage"])
        ]
        gains.append(0.5 * float(weight.inner(r[0], r[0]) - weight.inner(r[1], r[1])))
        assert drawn.nats["windage"] == pytest.approx(100.0, rel=0.1)
    assert np.mean(gains) == pytest.approx(100.0, abs=3.0 * np.sqrt(200.0 / len(gains)))


def test_nothing_that_matters_is_hidden_in_a_null() -> None:
    drawn = draw(Case(machine="flywheel", what="nothing", nats=0.0, seed=1), SHORT)
    assert drawn.category == "none"
    assert not drawn.hidden
    assert len(drawn.small) == 1
    off = [abs(drawn.values[p.name] - p.stated) / p.std for p in SHORT.parameters]
    assert 1.5 <= max(off) <= 2.5


def test_masking_pairs_oppose_each_other() -> None:
    drawn = draw(Case(machine="flywheel", what="masking", nats=100.0, seed=1), SHORT)
    assert len(drawn.hidden) == 2
    assert -1.0 < drawn.correlation < -0.3


def test_what_cannot_be_graded_is_refused() -> None:
    deaf = replace(SHORT, channels=(replace(SHORT.channels[0], noise=1e6),))
    with pytest.raises(CaseError, match="does not reach 1000 nats"):
        draw(Case(machine="flywheel", what="heating", nats=1000.0, seed=0), deaf)


def test_final_seeds_are_other_streams() -> None:
    case = Case(machine="flywheel", what="nothing", nats=0.0, seed=1)
    final = replace(case, final=True)
    assert case.generator(0).random() == replace(case).generator(0).random()
    assert case.generator(0).random() != final.generator(0).random()
    assert case.name != final.name
    assert case.seed != FINAL


def test_a_case_is_written_as_a_study(tmp_path: Path) -> None:
    machine = replace(machine_named("heated_tank"), rows=60)
    study = read_study(
        write(draw(Case(machine="heated_tank", what="water_drift", nats=100.0, seed=0), machine), tmp_path)
    )
    records = study.read_records({"heater.power": "W", "tank.heater": "K", "tank.water": "K"})
    assert len(records.identify) == machine.identify
    assert len(records.validate) == machine.validate
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["effects"][0]["accept"] == ["sensor_drift@tank.water"]
    told = (tmp_path / "study.toml").read_text() + (tmp_path / "machine.md").read_text()
    assert "drift" not in told + (tmp_path / "model.py").read_text()


def test_every_machine_has_effects_of_each_kind_and_different_physics() -> None:
    assert len(NAMES) >= 12
    machines = [machine_named(name) for name in NAMES]
    assert all(any(e.outside for e in m.effects) for m in machines)
    assert all(sum(not e.outside for e in m.effects) >= 5 for m in machines)
    assert len({e.name for m in machines for e in m.effects if e.outside}) >= 12


def answer(*names: str, verdict: str = "effect found", ties: dict[str, list[str]] | None = None) -> dict[str, Any]:
    def entry(name: str) -> dict[str, Any]:
        kind, _, where = name.partition("@")
        return {"kind": kind, "where": where}

    effects = [{**entry(n), "indistinguishable_from": [entry(t) for t in (ties or {}).get(n, [])]} for n in names]
    stages = [{"validate": {"y": {"rmse": r}}} for r in (3.0, 2.0, 1.0)]
    return {"verdict": verdict, "effects": effects, "stages": stages}


def truth(category: str, *accept: str) -> dict[str, Any]:
    return {"category": category, "effects": [{"accept": [a] if a else []} for a in accept], "achievable": {"y": 0.5}}


def test_score_of_a_right_name() -> None:
    score = judged(truth("single", "drag@a*"), answer("drag@axle"))
    assert (score.right, score.first, score.in_set, score.invented) == (True, True, True, 0)
    assert (score.held_out, score.worse) == (2.0, False)
    assert [(s.said, s.probability, s.true) for s in score.statements] == [
        ("drag@axle", 1.0, True),
        ("nothing", 0.0, False),
        ("unknown", 0.0, False),
    ]


def test_score_of_a_name_in_the_set_beside_an_invented_one() -> None:
    score = judged(truth("single", "drag@axle"), answer("slip@belt", "play@nut", ties={"slip@belt": ["drag@axle"]}))
    assert (score.right, score.first, score.in_set, score.invented) == (False, False, True, 1)
    assert score.set_size == 1.5
    assert score.confident_wrong


def test_score_of_nothing_and_of_something_outside() -> None:
    nothing = answer(verdict="nothing missing")
    assert judged(truth("none"), nothing).right
    assert not judged(truth("none"), answer("drag@axle")).right
    assert not judged(truth("outside", ""), nothing).right
    unknown = judged(truth("outside", ""), answer("unknown_force@axle", verdict="unknown effect"))
    assert unknown.right
    assert unknown.invented == 0
    assert judged(truth("outside", ""), answer("drag@axle", verdict="partly explained")).invented == 1


def test_score_of_a_pair_wants_both() -> None:
    pair = truth("pair", "drag@axle", "slip@belt")
    assert judged(pair, answer("slip@belt", "drag@axle")).right
    assert not judged(pair, answer("slip@belt")).in_set


def test_score_takes_the_probabilities_that_are_shown() -> None:
    shown = answer("drag@axle")
    tied = [{"kind": "slip", "where": "belt", "probability": 0.3}]
    effect = {"kind": "drag", "where": "axle", "probability": 0.6, "set": tied}
    shown["probabilities"] = {"nothing": 0.05, "unknown": 0.05, "effects": [effect]}
    score = judged(truth("single", "slip@belt"), shown)
    assert (score.first, score.in_set, score.confident_wrong, score.set_size) == (False, True, False, 2.0)
    assert [(s.probability, s.true) for s in score.statements] == [
        (0.6, False),
        (0.3, True),
        (0.05, False),
        (0.05, False),
    ]


def test_an_output_that_is_predicted_worse_counts() -> None:
    worse = answer("drag@axle")
    worse["stages"][-1]["validate"]["y"]["rmse"] = 2.1
    assert judged(truth("single", "drag@axle"), worse).worse


def test_a_temperature_makes_overconfident_evidences_hold() -> None:
    rng = np.random.default_rng(0)
    honest = rng.normal(0.0, 1.5, (4000, 5))
    true = np.array([rng.choice(5, p=p) for p in tempered(honest, 1.0)])
    first, second = slice(0, 2000), slice(2000, None)
    boasted = 6.0 * honest
    correct = np.eye(5)[true]
    assert fitted_temperature(boasted[first], correct[first]) == pytest.approx(6.0, rel=0.1)
    raw = tempered(boasted[second], 1.0)
    cool = tempered(boasted[second], fitted_temperature(boasted[first], correct[first]))
    correct = correct[second]
    assert (
        calibration_error(cool.ravel(), correct.ravel()) < 0.02 < 0.1 < calibration_error(raw.ravel(), correct.ravel())
    )
    assert brier_score(cool, correct) < brier_score(raw, correct)
    assert all(b.low <= b.shown <= b.high for b in reliability(cool.ravel(), correct.ravel()) if b.count > 50)
    assert len(reliability_figure([("raw", raw.ravel(), correct.ravel())]).axes) == 1


def test_a_temperature_needs_a_true_model() -> None:
    with pytest.raises(ValueError, match="temperature cannot be fitted"):
        fitted_temperature([[-np.inf, 0.0]], [[True, False]])


def test_a_temperature_leaves_the_prior_as_it_is() -> None:
    rng = np.random.default_rng(1)
    honest, prior = rng.normal(0.0, 1.5, (4000, 3)), np.log([0.8, 0.15, 0.05])
    true = np.eye(3)[[rng.choice(3, p=p) for p in tempered(honest, 1.0, prior)]]
    assert fitted_temperature(4.0 * honest, true, prior) == pytest.approx(4.0, rel=0.1)


def judged_folder(path: Path, category: str, accept: list[list[str]], models: dict[str, float]) -> None:
    (path / "out").mkdir(parents=True)
    effects = [{"accept": each} for each in accept]
    (path / "truth.json").write_text(json.dumps({"category": category, "effects": effects}))
    entries = [
        {"effects": name.split(), "log_evidence": {"total": total, "log_prior_odds": -1.0}}
        for name, total in models.items()
    ]
    entries.append({"effects": ["lost@there"], "log_evidence": None})
    entries.append({"effects": ["pulls@there"], "log_evidence": {"total": None, "log_prior_odds": -1.0}})
    (path / "out" / "decisions.json").write_text(json.dumps({"models": entries}))


def test_the_temperature_takes_the_models_that_were_tried(tmp_path: Path) -> None:
    models = {"": 0.0, "drag@axle": 3.0, "play@belt drag@axle": 2.0}
    judged_folder(tmp_path / "a", "single", [["drag@*"]], models)
    judged_folder(tmp_path / "b", "pair", [["drag@*"], ["play@belt"]], models)
    judged_folder(tmp_path / "c", "none", [], models)
    judged_folder(tmp_path / "d", "outside", [], models)
    judged_folder(tmp_path / "e", "single", [["slip@belt"]], models)
    folders = [tried_models(tmp_path / name) for name in "abcdef"]
    assert [None if f is None else f.true.tolist() for f in folders] == [
        [False, True, False],
        [False, False, True],
        [True, False, False],
        None,
        None,
        None,
    ]
    assert folders[0] is not None
    np.testing.assert_allclose(folders[0].log_evidence, [1.0, 4.0, 3.0])
    lines = temperature_lines(tmp_path, [{"case": name} for name in "abcdef"])
    assert lines[2].startswith("In 3 of 6 cases the true model is among those that were tried.")
    assert len(lines) == 9
    assert temperature_lines(tmp_path, [{"case": "a"}, {"case": "d"}]) == []


def test_the_evidence_of_the_truth_is_over_the_model_without_effects(tmp_path: Path) -> None:
    """Of the search; where that did not try the truth, of the diagnosis with it alone."""
    models = {"": 2.0, "drag@axle": 14.0, "drag@belt": 9.0, "play@belt drag@axle": 30.0}
    judged_folder(tmp_path / "a", "single", [["drag@*"]], models)
    judged_folder(tmp_path / "b", "single", [["slip@belt"]], models)
    judged_folder(tmp_path / "c", "outside", [[]], models)
    assert evidence_of_truth(tmp_path / "a") == pytest.approx(12.0)
    assert evidence_of_truth(tmp_path / "b") is None
    assert evidence_of_truth(tmp_path / "c") is None
    judged_folder(tmp_path / "b" / "again", "single", [["slip@belt"]], {"": 2.0, "slip@belt": 5.0})
    (tmp_path / "b" / "again" / "out").rename(tmp_path / "b" / "truth_alone")
    assert evidence_of_truth(tmp_path / "b") == pytest.approx(3.0)


def test_the_truth_alone_is_what_of_the_catalogue_is_hidden(tmp_path: Path) -> None:
    judged_folder(tmp_path, "single", [["drag@*", "lag@*"]], {"": 0.0})
    (tmp_path / "study.toml").write_text('[model]\nbuild = "model.py:build"\n')
    study = study_with_truth_alone(tmp_path, ["drag@axle", "play@belt", "drag@belt"])
    assert study is not None
    assert 'include = ["drag@axle", "drag@belt"]' in study.read_text()
    assert study_with_truth_alone(tmp_path, ["play@belt"]) is None


def test_what_is_overstated_has_no_share_in_the_temperature(tmp_path: Path) -> None:
    judged_folder(tmp_path, "single", [["drag@*"]], {"": 0.0, "drag@axle": 30.0})
    decisions = json.loads((tmp_path / "out" / "decisions.json").read_text())
    decisions["models"][1]["log_evidence"]["overstated"] = 20.0
    (tmp_path / "out" / "decisions.json").write_text(json.dumps(decisions))
    found = tried_models(tmp_path)
    assert found is not None
    np.testing.assert_allclose(found.log_evidence, [1.0, 11.0])


def row(**columns: Any) -> dict[str, str]:
    return {key: str(columns.get(key, "")) for key in COLUMNS}


def test_the_page_counts_by_category_and_nats() -> None:
    common = {"invented": 0, "answer": "effect found", "code": "abc", "machine": "web", "statements": "[]", "worse": 0}
    rows = [
        row(case="a", category="single", nats=100, evidence=33.0, right=1, first=1, in_set=1, **common),
        row(case="b", category="single", nats=10, evidence=-2.0, first=0, in_set=1, confident_wrong=1, **common),
        row(case="c", category="none", nats=0, right=1, **common),
        row(case="d", category="outside", nats=100, unknown=1, right=1, **common),
    ]
    found = {name: (hits, trials) for name, hits, trials in counts(rows)}
    assert found["right"] == (3, 4)
    assert found["truth first, 100 nats or more"] == (1, 1)
    assert found["a confident wrong name, below 100 nats"] == (1, 1)
    assert found["truth first, evidence for the truth 30 to 100 nats"] == (1, 1)
    assert found["truth in the set, evidence for the truth below 10 nats"] == (1, 1)
    assert found["truth first, evidence for the truth 100 nats or more"] == (0, 0)
    assert found["outside the catalogue, reported as unknown"] == (1, 1)
    text = page(rows, date="2026-01-01", final=True)
    assert "2026-01-01, code abc, final seeds, run once" in text
    assert "| nothing missing, and the answer says so | 1 | 1 | 100.0% | " in text


def test_a_plan_has_every_combination_once() -> None:
    plan = cases(["web", "valve"], ["nothing", "single"], [10, 100], 3)
    assert len({case.name for case in plan}) == len(plan) == 2 * (6 + 6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "final"], "give --seeds final and --final together"),
        (["--final"], "give --seeds final and --final together"),
        (["--what", "rust", "--machine", "web"], "the machine 'web' has"),
        (["--trials", "0"], "--trials must be at least 1"),
    ],
)
def test_the_command_refuses(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*arguments, "--out", str(tmp_path)])
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "gain",
    [
        lambda size: 1e12 * size**2,  # far beyond at the least strength that is tried
        lambda size: 1e-3 * size**12,
        lambda size: np.where(size > 7.0, 30.0 * (size - 7.0) ** 2, 1e-3),
    ],
)
def test_the_strength_of_a_gain_is_found_however_it_grows(gain) -> None:
    graded: Any = object.__new__(_Graded)
    graded.machine = SimpleNamespace(name="stand-in")
    graded._gains = lambda effect, strengths, shape: gain(np.abs(strengths))
    strength, reached = graded.strength(Effect(name="rub", strength="rub", size=1.0, what="rub"), -1.0, {}, 100.0)
    assert strength < 0.0
    assert reached == pytest.approx(float(gain(-strength)))
    assert reached == pytest.approx(100.0, rel=0.1)
