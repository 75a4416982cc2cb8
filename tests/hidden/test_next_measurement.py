"""Two explanations that a recording does not tell apart: the trip that is proposed is carried out, and tells."""

from __future__ import annotations

import json

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.questions.next_measurement import compare_trips
from discrepancy.questions.trip_plan import TripPlan
from discrepancy.questions.trip_proposals import NextMeasurement, Proposal, chance, repeats_needed
from discrepancy.rigs.axis import axis_case, make_axis
from discrepancy.search.model_comparison import bic_difference
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.study.study import Study
from estimation.signals.preparation import smooth_derivative


def explained_by(case, *kinds):
    """Return a fitted stage for each kind at the guide in turn."""
    study = Study(case.problem(seed=1))
    stage = study.stage
    place = next(p for p in stage.system.places if p.name == "guide")
    return [
        study.fitted(
            kind,
            (Effect.at_place(kind, place, strengths={"stiffness": 1e-3}, shape={"centre": 0.3}),),
            stage,
            stage.noise,
        )
        for kind in kinds
    ]


def test_the_trip_that_is_proposed_breaks_the_tie():
    hidden, rival = "cubic_stiffness", "linear_stiffness"
    hide = [f"{hidden}@guide"]
    first, second = explained_by(axis_case(5, hide, trips=2, strength=0.5), hidden, rival)
    now = bic_difference(second, first)
    assert abs(now) < DECISIVE_BIC, "one recording of six seconds does not tell the two springs apart"
    record, proposals = compare_trips(first, second)
    best = next(p for p in proposals if not p.trip.sensor)
    usual = next(p for p in proposals if p.trip == TripPlan())
    assert record == "identify_01"
    assert best.trip.mirror, "a spring that hardens and one that does not part most on the other side of its middle"
    assert best.separation > 10.0 * usual.separation
    assert best.repeats == 1
    # the same machine, another disturbance, the trip that was asked for
    followed = axis_case(5, hide, trips=2, strength=0.5, plan=best.trip)
    truth, other = explained_by(followed, hidden, rival)
    assert bic_difference(other, truth) > DECISIVE_BIC


def test_chance_follows_from_the_separation():
    rng = np.random.default_rng(0)
    for separation in (4.0, 12.0):
        draws = separation + 2.0 * np.sqrt(separation) * rng.standard_normal(20000)
        # 20000 draws: a standard error of 0.35 %
        assert chance(separation) == pytest.approx(np.mean(draws > DECISIVE_BIC), abs=0.012)
    assert repeats_needed(0.0) is None
    assert chance(repeats_needed(1.0)) >= 0.8 > chance(repeats_needed(1.0) - 1)


def test_nothing_separates_is_said_so():
    hopeless = Proposal(trip=TripPlan(), separation=0.0, power=0.0, repeats=None, duration=6.0)
    told = NextMeasurement(
        best="a@x",
        rival="b@x",
        titles=("one", "the other"),
        record="trip",
        proposals=(hopeless,),
    ).sentence
    assert "none of 1 trip with" in told


@pytest.mark.parametrize("plan", ["speed=0.5", "stops=2", "speed=1.5,stops=1", "amplitude=0.5,mirror"])
def test_a_changed_trip_is_as_smooth_as_the_recorded_one(plan):
    time = np.arange(0.0, 6.0, 0.002)
    place = 0.3 * (1.0 - np.cos(np.pi * time / 3.0))
    changed = TripPlan.parse(plan)
    t, new = changed.apply(time, {"r": place})
    assert new["r"][0] == place[0]
    sign = -1.0 if changed.mirror else 1.0
    np.testing.assert_allclose(new["r"].max() if sign > 0 else -new["r"].min(), 0.6 * changed.amplitude, rtol=1e-3)
    speed, inside = smooth_derivative(t, new["r"], 20.0)
    fastest = 0.3 * np.pi / 3.0 * changed.speed * changed.amplitude
    assert np.max(np.abs(speed[inside])) == pytest.approx(fastest, rel=0.05)
    # slowing down within 0.2 s is the hardest that a plan asks for
    assert np.max(np.abs(np.diff(new["r"], 2))) / 0.002**2 < fastest * np.pi / 2 / 0.2 * 1.6 + 0.4 * changed.speed**2
    if changed.stops:
        assert t[-1] > time[-1] / changed.speed + 0.6 * changed.stops


def test_words_that_say_nothing_are_all_named():
    with pytest.raises(ValueError, match=r"'quick' .*; 'stops=many'"):
        TripPlan.parse("quick, stops=many, speed=0.5")


def test_bench_carries_out_a_plan(tmp_path):
    study = make_axis(
        tmp_path / "rig",
        ["coulomb_friction@guide"],
        trips=2,
        plan=TripPlan.parse("speed=1.5,load=1.5,sensor=coupling.twist_torque"),
    )
    text = study.read_text()
    assert "mass = 60" in text
    assert '"coupling.twist_torque"' in text
    assert json.loads((study.parent / "truth.json").read_text())["load"]["value"] == pytest.approx(20.0)
    assert "1.5 times the speed" in (study.parent / "README.md").read_text()
    from discrepancy.problem.problem import read_problem

    problem = read_problem(study)
    assert problem.identify[0].record.time[-1] == pytest.approx(4.0, abs=0.05)
    mass = next(u for u in problem.uncertain if u.name == "carriage.m")
    assert mass.value == 60.0
