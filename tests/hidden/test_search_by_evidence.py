"""The search by evidence: what is hidden is named with its probability, nothing is named where nothing is hidden."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from discrepancy.conclusion.conclusion import evidence_of
from discrepancy.evidence.search import EvidenceSearch
from discrepancy.report.content import content
from discrepancy.report.decisions_json import save_decisions
from discrepancy.report.diagnosis_json import to_diagnosis
from discrepancy.rigs.axis import axis_case
from discrepancy.study.study import Study

FEW = ("coulomb_friction@*", "viscous_friction@*", "stribeck_friction@guide", "sensor_offset@*", "constant_force@guide")


@pytest.fixture(scope="module")
def diagnosed():
    """Return a function that diagnoses an axis with something hidden, among few candidates."""
    kept = {}

    def diagnose(seed, hidden=()):
        key = seed, tuple(hidden)
        if key not in kept:
            problem = axis_case(seed, list(hidden), trips=4).problem(seed=seed)
            study = Study(replace(problem, include=FEW, search="evidence"))
            kept[key] = study, study.diagnose()
        return kept[key]

    return diagnose


def test_a_hidden_friction_is_named_with_its_probability(diagnosed):
    study, conclusion = diagnosed(1, ["coulomb_friction@guide"])
    assert [str(e) for e in study.stage.effects] == ["coulomb_friction@guide"]
    assert conclusion.probabilities is not None
    (effect,) = conclusion.probabilities.effects
    assert effect.probability > 0.5, "more probable than everything else together"
    assert conclusion.probabilities.nothing < 1e-3
    before, after = (s.rmse("validate") for s in (study.stages[1], study.stages[-1]))
    assert after["motor.torque"] < 0.8 * before["motor.torque"]


def test_nothing_hidden_nothing_named(diagnosed):
    study, conclusion = diagnosed(41)
    assert study.stage.effects == ()
    assert conclusion.verdict == "nothing missing"
    assert conclusion.probabilities is not None
    # effects that could hide in these records are as probable as before, each by itself hardly
    assert conclusion.probabilities.nothing > 0.5
    assert max(p for k, p in conclusion.probabilities.models.items() if k) < 0.1


def test_a_search_that_reaches_its_time_limit_answers_and_says_what_it_left_out():
    problem = axis_case(1, ["coulomb_friction@guide"], trips=4).problem(seed=1)
    conclusion = Study(replace(problem, include=FEW, search="evidence", time_limit=1e-3)).diagnose()
    assert [str(a.effect) for a in conclusion.accepted] == ["coulomb_friction@guide"], "what was fitted is tested"
    assert "reached its time limit of 0.001 s" in conclusion.sentence
    (warning,) = [w for w in conclusion.warnings if "[study] time_limit" in w]
    left_out = [m.name for m in conclusion.models if "time limit" in m.outcome]
    assert all(name in warning for name in left_out)
    assert "what is missing beside coulomb_friction@guide" in warning


def test_every_model_that_was_tried_is_in_the_decisions(diagnosed, tmp_path):
    _, conclusion = diagnosed(1, ["coulomb_friction@guide"])
    content = json.loads(save_decisions(conclusion, tmp_path / "decisions.json").read_text())
    names = [tuple(m["effects"]) for m in content["models"]]
    assert () in names
    assert ("coulomb_friction@guide",) in names
    assert len(names) == len(set(names)), "a model is tried once"
    assert content["taken"] == ["coulomb_friction@guide"]
    (taken,) = [m for m in content["models"] if m["taken"]]
    parts = taken["log_evidence"]
    assert parts["total"] == pytest.approx(sum(v for k, v in parts.items() if k != "total"))
    assert all(m["outcome"] for m in content["models"])


def test_evidence_rises_along_the_path_that_was_taken(diagnosed):
    _, conclusion = diagnosed(1, ["coulomb_friction@guide"])
    by_name = {m.key: m for m in conclusion.models}
    model = next(m for m in conclusion.models if m.taken)
    while model.parent is not None:
        parent = by_name[model.parent]
        assert model.total > parent.total
        model = parent
    assert model.key == ()


def test_the_diagnosis_tells_probabilities_checks_and_random_forces(diagnosed):
    _, conclusion = diagnosed(1, ["coulomb_friction@guide"])
    diagnosis = to_diagnosis(conclusion)
    assert diagnosis["probabilities"]["effects"][0]["kind"] == "coulomb_friction"
    assert {c["output"] for c in diagnosis["predictive_checks"]} == set(conclusion.final.outputs)
    assert "white_noise" in diagnosis["disturbance"]
    shown = diagnosis["predictive_gain"]["coulomb_friction@guide"]
    assert shown["gain"] > shown["standard_error"]
    assert "Probabilities: dry (Coulomb) friction at guide" in diagnosis["sentence"]
    assert diagnosis["effects"][0]["probability"] == diagnosis["probabilities"]["effects"][0]["probability"]
    assert set(diagnosis["checks"]) == set(conclusion.final.outputs)
    for checked in diagnosis["checks"].values():
        assert checked["innovation_white"]
        assert 0.7 < checked["size"] < 1.4
        assert checked["fit_percent"] > 50.0


def test_the_report_lists_what_was_tried_and_says_what_held_out_records_were_used_for(diagnosed):
    _, conclusion = diagnosed(1, ["coulomb_friction@guide"])
    entries = content(conclusion, evidence_of(conclusion))
    assert [m["effects"] for m in entries["tried"] if m["taken"]] == ["coulomb_friction@guide"]
    assert "Its probability is" in entries["effects"][0]["evidence"]
    assert "nor to choose effects" not in str(entries["compared"])


def test_the_search_by_significance_has_none_of_it():
    problem = axis_case(41, [], trips=3).problem(seed=41)
    study = Study(replace(problem, include=("viscous_friction@guide",), search="significance"))
    conclusion = study.diagnose()
    assert conclusion.probabilities is None
    assert conclusion.models == ()


def test_whole_records_of_a_small_machine_are_searched_by_evidence_unless_said_otherwise():
    problem = axis_case(41, [], trips=3).problem(seed=41)
    assert problem.search == "auto"
    assert Study(problem).searches_by_evidence()
    assert not Study(replace(problem, search="significance")).searches_by_evidence()
    assert not Study(replace(problem, residual="inverse")).searches_by_evidence()


def test_a_search_that_is_interrupted_at_once_concludes_without_an_answer(monkeypatch):
    problem = axis_case(41, [], trips=3).problem(seed=41)
    study = Study(replace(problem, include=FEW, search="evidence"))
    study.compare()

    def broken(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(EvidenceSearch, "run", broken)
    conclusion = study.diagnose()
    assert study.interrupted
    assert conclusion.accepted == ()
    assert conclusion.verdict == ""


def test_a_search_that_is_interrupted_tells_the_best_model_that_was_fitted_until_then():
    problem = axis_case(1, ["coulomb_friction@guide"], trips=3).problem(seed=1)
    fitted = []

    def interrupting(text):
        fitted.extend([text] if text.startswith("fit with") else [])
        if len(fitted) > 3:  # two side by side, and one of them with two laws: the first is done by then
            raise KeyboardInterrupt

    study = Study(replace(problem, include=FEW, search="evidence"), interrupting)
    conclusion = study.diagnose()
    assert study.interrupted
    assert conclusion.accepted == ()
    assert re.match(r"Of \d models? with effects fitted until then, the most probable is ", study.untested)
    assert study.untested in conclusion.warnings
    assert len(conclusion.models) > 1


def test_a_search_without_room_for_effects_names_nothing():
    problem = axis_case(1, ["coulomb_friction@guide"], trips=3).problem(seed=1)
    study = Study(replace(problem, include=FEW, max_effects=0, search="evidence"))
    study.prepare()
    EvidenceSearch(study).run()
    assert study.stage.effects == ()
