"""Two effects of an axis that do nearly opposite things: one by one neither shows, and a third looks like the rest."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discrepancy.report.diagnosis_json import to_diagnosis
from discrepancy.rigs.axis import AxisRig
from discrepancy.study.study import Study

#: A position sensor that is late, and a loop stiffer than stated, which makes up for it.
HIDDEN = {
    "sensor_delay@carriage.position": {"delay": 1.24e-3},
    "position_loop_gain@controller": {"k_position": 20.48},
}


@pytest.fixture(scope="module")
def problem():
    """As the search by significance takes it: its look-ahead is what most of these tests are about."""
    return replace(AxisRig(seed=1, strengths=HIDDEN).case(list(HIDDEN)).problem(seed=1), search="significance")


@pytest.fixture(scope="module")
def study(problem):
    study = Study(problem)
    study.diagnose()
    return study


@pytest.fixture(scope="module")
def by_evidence(problem):
    study = Study(replace(problem, search="evidence"))
    study.diagnose()
    return study


@pytest.mark.parametrize("searched", ["study", pytest.param("by_evidence", marks=pytest.mark.slow)])
def test_both_are_found_with_their_strengths(searched, request):
    study = request.getfixturevalue(searched)
    effects = {str(e): e for e in study.stage.effects}
    assert set(effects) == set(HIDDEN)
    stated = {"delay": 0.0, "k_position": 20.0}
    for name, (strength,) in ((n, tuple(s)) for n, s in HIDDEN.items()):
        true = HIDDEN[name][strength] - stated[strength]
        assert effects[name].strengths[strength] - stated[strength] == pytest.approx(true, rel=0.1)


def test_the_conclusion_says_that_they_mask_each_other(study):
    first, second = (s.accepted for s in study.stages[2:])
    assert (first.masked_by, second.masked_by) == (str(second.effect), str(first.effect))
    alone, both = study.stages[2].rmse("validate"), study.stages[3].rmse("validate")
    before = study.stages[1].rmse("validate")
    assert all(alone[n] > 0.95 * before[n] for n in before)  # the error does not fall at the first step
    assert all(both[n] < 0.95 * before[n] for n in before)
    diagnosis = to_diagnosis(study.diagnose())
    assert "mask each other" in diagnosis["sentence"]
    assert [e["hidden_by"] for e in diagnosis["effects"]] == [str(second.effect), str(first.effect)]
    assert not any("do not trust it" in w for w in diagnosis["warnings"])


@pytest.mark.slow
def test_one_step_at_a_time_names_something_else(problem, monkeypatch):
    """What the look-ahead is for: without it the search of this case ends with effects that are not there."""
    from discrepancy.search import loop

    monkeypatch.setattr(loop, "propose_pair", lambda decision, *args, **settings: decision)
    alone = Study(problem)
    alone.diagnose()
    assert not {str(e) for e in alone.stage.effects} & set(HIDDEN)


@pytest.mark.slow
def test_a_search_broken_off_between_the_two_goes_on_to_the_same_answer(problem, interrupter, tmp_path):
    from discrepancy.study.history import restore, save_history

    few = replace(
        problem, include=("sensor_delay@*", "position_loop_gain@*", "speed_loop_gain@*", "viscous_friction@*")
    )
    whole, broken, again = Study(few), Study(few, progress=interrupter("add position_loop")), Study(few)
    whole.diagnose()
    broken.checkpoint = lambda s: save_history(s, tmp_path / "history.json")
    broken.diagnose()
    assert len(broken.stages) == len(whole.stages) - 1
    restore(again, tmp_path / "history.json")
    again.diagnose()
    assert [s.name for s in again.stages] == [s.name for s in whole.stages]
    assert [s.accepted and s.accepted.masked_by for s in again.stages] == [
        s.accepted and s.accepted.masked_by for s in whole.stages
    ]
    for mine, theirs in zip(again.stages, whole.stages, strict=True):
        assert mine.rmse("validate") == pytest.approx(theirs.rmse("validate"), rel=1e-9)


def test_the_remaining_effect_of_a_pair_is_masked_by_nothing(study, monkeypatch):
    """A stage that awaits its partner is removed when a search continues; one whose partner was removed is not."""
    from discrepancy.search import loop

    first, second = study.stage.effects
    left = replace(study, stages=list(study.stages))
    without = left.on_trial(left.stage.name, (second,), left.stage)
    answers = iter([(without, first)])
    monkeypatch.setattr(loop, "find_redundant_effect", lambda *args: next(answers, None))
    loop.Search(left).eliminate()
    assert [str(e) for e in left.stage.effects] == [str(second)]
    assert left.stage.accepted.masked_by == ""
    assert not left.stage.half_of_masking_pair
    assert study.stages[2].half_of_masking_pair
    assert not study.stages[3].half_of_masking_pair


def test_without_room_for_two_no_pair_is_proposed(problem):
    one = Study(replace(problem, max_effects=1))
    assert one.explain().first is None


@pytest.mark.slow
def test_pairs_of_the_suite_cancel_as_far_as_they_can():
    from discrepancy.effects.kinds import kind_named
    from discrepancy.validation.masking_cases import masking_pair

    pair = masking_pair(1)
    assert len(pair) == 2
    for name, strengths in pair.items():
        assert set(strengths) == set(kind_named(name.partition("@")[0]).strengths)
    none = Study(AxisRig(seed=1).case([]).problem(seed=1)).explain().scan
    both = Study(AxisRig(seed=1, strengths=pair).case(list(pair)).problem(seed=1)).explain().scan
    from discrepancy.statistics.masking_pairs import PairScores

    seen = next(p for p in PairScores(both).masking() if set(p.names) == set(pair))
    assert seen.gain > 4.0 * none[seen.names[0]].critical_ratio ** 2  # hidden at three times what shows, in amplitude
