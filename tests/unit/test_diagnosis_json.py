"""diagnosis.json: the form that the outside relies on, and the figures in it."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.questions.explained_share import explained_by_output, explained_share
from discrepancy.questions.unknown_force import UnknownCurve
from discrepancy.report.diagnosis_json import plain, save_diagnosis, to_diagnosis
from discrepancy.report.schema import check_diagnosis
from discrepancy.stages.stage import RivalExplanation


@pytest.fixture(scope="module")
def diagnosis(conclusion, evidence):
    return to_diagnosis(conclusion, evidence)


def test_it_is_as_the_contract_has_it(diagnosis) -> None:
    assert check_diagnosis(diagnosis) == []


def test_numbers_come_back_as_they_were(conclusion, evidence, diagnosis, tmp_path) -> None:
    path = save_diagnosis(conclusion, tmp_path / "diagnosis.json", evidence)
    text = path.read_text(encoding="utf-8")
    assert "NaN" not in text
    assert "Infinity" not in text
    back = json.loads(text)
    assert back == diagnosis
    stage = conclusion.stages[1]
    assert back["stages"][1]["validate"]["drive.force"]["rmse"] == pytest.approx(
        stage.rmse("validate")["drive.force"], rel=1e-12
    )
    assert back["effects"][0]["parameters"]["coulomb"]["value"] == stage_value(
        conclusion, "coulomb_friction.guide.coulomb"
    )


def stage_value(conclusion, name: str) -> float:
    return conclusion.final.identify[name]


def test_the_effect_is_told_with_interval_unit_and_rivals(diagnosis, small_study) -> None:
    (effect,) = diagnosis["effects"]
    assert (effect["kind"], effect["where"]) == ("coulomb_friction", "guide")
    found = effect["parameters"]["coulomb"]
    assert found["unit"] == "N"
    # Four standard deviations hold for all but one in 16 000 fits.
    assert abs(found["value"] - small_study.hidden.strengths["coulomb"]) < 4.0 * found["std"]
    assert effect["indistinguishable_from"] == []
    assert [r["kind"] for r in effect["runners_up"]] == ["stribeck_friction", "local_bump"]
    # The speed below which the sign is smoothed belongs to the law, fitted or not.
    assert set(effect["fixed"]) | set(effect["parameters"]) == {"coulomb", "v_s"}


def with_errors(force: float, position: float):
    """Return as much of a stage as the explained share needs: errors of two outputs with noise floors of 2 and 0.1."""
    return SimpleNamespace(
        rmse=lambda part: {"force": force, "position": position},
        noise={"force": 2.0, "position": 0.1},
        fits=lambda part: [SimpleNamespace(experiment=SimpleNamespace(measured=np.zeros((3, 2))))],
    )


def test_explained_is_the_share_of_the_excess_over_the_noise_that_is_gone() -> None:
    # excess before: 10²/2² − 1 = 24 and 0.3²/0.1² − 1 = 8; after: 4²/2² − 1 = 3, and none below the floor
    before, after = with_errors(10.0, 0.3), with_errors(4.0, 0.05)
    energy, rms = explained_share(before, after, "identify")
    assert energy == pytest.approx(29.0 / 32.0, rel=1e-12)
    assert rms == pytest.approx(0.6938, abs=1e-4)  # 1 − √(3/32)
    shares = explained_by_output(before, after, "identify")
    assert shares == {"force": pytest.approx(7.0 / 8.0, rel=1e-12), "position": 1.0}
    assert explained_share(before, before, "identify") == (0.0, 0.0)
    assert explained_share(with_errors(1.0, 0.1), after, "identify") == (0.0, 0.0)  # nothing to explain
    assert explained_by_output(with_errors(1.0, 0.3), after, "identify")["force"] is None


def test_explained_is_that_of_the_records_held_out(conclusion, diagnosis) -> None:
    assert diagnosis["explained"] == explained_share(*conclusion.stages[1:], "validate")[0]
    assert diagnosis["explained"] > 0.99
    assert diagnosis["explained_on"] == "validate"


def test_without_held_out_records_it_says_so(conclusion) -> None:
    alone = replace(conclusion, stages=tuple(replace(s, validate=None) for s in conclusion.stages))
    found = to_diagnosis(alone)
    assert check_diagnosis(found) == []
    assert found["explained_on"] == "identify"
    assert found["stages"][0]["validate"] == {}
    assert found["explained"] > 0.99


def test_a_tie_is_listed_apart(conclusion, evidence) -> None:
    stage = conclusion.final
    tie = RivalExplanation(
        kind="stribeck_friction", where="guide", delta_bic=1.2, refitted=True, indistinguishable=True
    )
    rivals = (tie, *stage.accepted.rivals[1:])
    tied = replace(stage, accepted=replace(stage.accepted, rivals=rivals))
    found = to_diagnosis(replace(conclusion, verdict="ambiguous", stages=(*conclusion.stages[:-1], tied)), evidence)
    assert check_diagnosis(found) == []
    assert [r["delta_bic"] for r in found["effects"][0]["indistinguishable_from"]] == [1.2]
    assert [r["kind"] for r in found["effects"][0]["runners_up"]] == ["local_bump"]


def test_an_unknown_effect_has_its_curve(conclusion) -> None:
    x = np.linspace(0.0, 1.0, 5)
    curve = UnknownCurve(
        where="guide",
        regressor="position",
        regressor_unit="m",
        unit="N",
        x=x,
        force=np.sin(x),
        std=np.full(5, math.nan),
        statement="something",
        p_value=1e-4,
        delta_bic=-40.0,
    )
    found = to_diagnosis(replace(conclusion, verdict="unknown effect", stages=conclusion.stages[:2], unknown=curve))
    assert check_diagnosis(found) == []
    effect = found["effects"][0]
    assert effect["kind"] == "unknown_force"
    assert effect["parameters"]["function_of"]["value"] == "position"
    assert effect["parameters"]["curve"]["value"] == np.sin(x).tolist()
    # A deviation that is not known is null: JSON has no NaN.
    assert effect["parameters"]["curve"]["std"] == [None] * 5


def test_what_is_not_finite_becomes_null() -> None:
    assert plain({"a": np.float64(np.inf), "b": (np.int64(2), np.bool_(True)), "c": np.array([1.0, np.nan])}) == {
        "a": None,
        "b": [2, True],
        "c": [1.0, None],
    }


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.update(schema=2), "schema must be"),
        (lambda d: d.update(verdict="perhaps"), "verdict must be one of"),
        (lambda d: d.pop("explained"), "explained is missing"),
        (lambda d: d.update(explained=math.nan), "explained must be a number"),
        (lambda d: d["effects"][0].update(p_value=2.0), "effects[0].p_value"),
        (
            lambda d: d["effects"][0]["parameters"]["coulomb"].pop("unit"),
            "parameters.coulomb.unit is missing",
        ),
        (lambda d: d["effects"][0]["runners_up"][0].pop("where"), "runners_up[0].where"),
        (
            lambda d: d["stages"][1]["identify"]["drive.force"].update(rmse="9"),
            "stages[1].identify.drive.force.rmse",
        ),
        (lambda d: d["where_it_fails"].pop("regimes"), "where_it_fails.regimes"),
        (lambda d: d.update(effects=[]), "needs an effect"),
        (lambda d: d.update(verdict="nothing missing"), "contradicts the effects"),
        (lambda d: d.update(refused=[{"kind": "slip"}]), "refused[0].where"),
    ],
)
def test_the_check_sees_faults(diagnosis, change, expected) -> None:
    broken = copy.deepcopy(diagnosis)
    change(broken)
    faults = check_diagnosis(broken)
    assert any(expected in f for f in faults), faults
