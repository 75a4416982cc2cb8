"""Effects hidden in the virtual lift are found by its 1D model, and nothing is found where nothing is hidden.

The rig has all 37 states, misaligned guides, another integrator and another fading of friction, noisy, quantised and
jittered records, true parameters that differ from the model's, and a force that disturbs it.
"""

from __future__ import annotations

import math

import pytest

from discrepancy.rigs.recording import RigDisturbance
from discrepancy.study.study import Study
from discrepancy.validation.suite import run_suite
from discrepancy.validation.trials import Trial, file_name, page, with_section
from vtsdt.rig import suite_reference
from vtsdt.rig.one_dimensional import PlainLiftRig
from vtsdt.rig.rig import LiftRig
from vtsdt.rig.suite_lift import case, names, sizes


def diagnosed(seed, hide):
    made = case(seed, hide)
    study = Study(made.problem(seed=seed))
    return made, study, study.diagnose()


def test_the_suite_knows_what_a_lift_can_hide():
    hidden = sizes(3, ["coulomb_friction@cabin.z"])[0]
    assert (hidden["kind"], hidden["where"]) == ("coulomb_friction", "cabin.z")
    assert hidden["parameters"]["coulomb"]["unit"] == "N"


def test_results_of_two_machines_stand_on_one_page(tmp_path):
    import json
    from dataclasses import asdict

    trial = Trial(suite="null", seed=7, hidden=(), verdict="nothing missing", found=())
    (tmp_path / file_name("lift", "null")).write_text(json.dumps(asdict(trial)) + "\n")
    results = page(tmp_path, "2026-01-01", "lift")
    assert "| false alarms | 0 | 1 | 0.0% |" in results
    once = with_section("# Rates\n\nOf the axis.\n", "lift", results)
    assert with_section(once, "lift", results) == once
    assert once.startswith("# Rates\n\nOf the axis.\n")
    assert once.count("### null") == 1


@pytest.mark.slow
def test_lift_with_nothing_hidden_nothing_named():
    _, _, conclusion = diagnosed(11, [])
    assert conclusion.verdict == "nothing missing"


@pytest.mark.slow
def test_lift_friction_of_the_cabin_is_found():
    made, study, _ = diagnosed(12, ["coulomb_friction@cabin.z"])
    accepted = [s.accepted for s in study.stages if s.accepted is not None]
    assert str(accepted[0].effect) == "coulomb_friction@cabin.z"
    true = made.truth["effects"][0]["parameters"]["coulomb"]["value"]
    effect = next(e for e in study.stages[-1].effects if str(e) == "coulomb_friction@cabin.z")
    assert effect.strengths["coulomb"] == pytest.approx(true, rel=0.2)  # within 20 % after the refit
    before, after = study.stages[1].rmse("validate"), study.stages[-1].rmse("validate")
    assert after["F_c"] < 0.5 * before["F_c"]  # on a trip that took no part


@pytest.mark.slow
def test_lift_suite_goes_on_where_it_stopped(tmp_path):
    import vtsdt.rig.suite_lift as machine

    first = run_suite("null", 1, tmp_path, first=11, workers=1, machine="lift", module=machine.__name__)
    again = run_suite("null", 1, tmp_path, first=11, workers=1, machine="lift", module=machine.__name__)
    assert len(first) == len(again) == 1
    assert math.isnan(first[0].ratio)
    assert "coulomb_friction@cabin.z" in names()


def test_reference_model_has_the_rails_and_free_initial_states():
    hidden = suite_reference.sizes(3, ["coulomb_friction@cabin.z"])[0]
    assert (hidden["kind"], hidden["where"]) == ("coulomb_friction", "cabin.z")
    rig = LiftRig(seed=3, trips=4, under_test="reference")
    assert set(rig.starts) < set(rig.model.build().state_names)
    assert not any(".roll" in n for n in rig.starts)  # across the rails both rest where the model rests
    assert "cabin_guide.v_s" in [q.name for q in rig.uncertain]


def test_one_dimensional_lift_moves_as_the_one_with_guides_does():
    import numpy as np

    settings = {"seed": 5, "trips": 2, "disturbance": RigDisturbance(0.0)}
    with_guides, plain = LiftRig(**settings).case([]), PlainLiftRig(**settings).case([])
    for name in ("friction_c", "tau_L", "payload"):  # what rubs is recorded of the one with guides in both cases
        rubs = [c.identify[0].signals[name].values for c in (plain, with_guides)]
        np.testing.assert_array_equal(*rubs)
    # Ten deviations of each sensor's noise: guides add no more to this motion.
    for name, close in (("cabin.z", 2e-4), ("F_c", 3.0), ("i_q", 0.05)):
        values = [np.array(c.identify[0].signals[name].values) for c in (plain, with_guides)]
        assert np.max(np.abs(values[0] - values[1])) < close
        assert np.std(values[0] - values[1]) > 0.0  # it is another lift


def test_an_effect_hidden_in_the_one_dimensional_lift_is_in_it():
    hidden = PlainLiftRig(seed=5, trips=2).case(["constant_force@cabin.z"])
    plain = PlainLiftRig(seed=5, trips=2).case([])
    change = hidden.identify[0].signals["F_c"].values.mean() - plain.identify[0].signals["F_c"].values.mean()
    push = hidden.truth["effects"][0]["parameters"]["push"]["value"]
    assert abs(change) == pytest.approx(abs(push), rel=0.1)  # the rope carries it
