"""The updating chain on an analytic stand-in of a gear stage, whose truth is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

# Processes that the tests start must find the stand-in too, by the same name.
from gear_stand_in import RANGES, START, TEETH, load, measured, stand_in

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.recordings import Recording
from gearbox.signals.signal import Processing, SignalError, resample
from gearbox.updating.chain import UpdatingChain
from gearbox.updating.errors import UpdatingError
from gearbox.updating.identifiability import identifiability
from gearbox.updating.objectives import AmplitudeObjective, DifferenceObjective, MeasuredLines, SimilarityObjective
from gearbox.updating.runs import ModelSource, Runs
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.view import updating_view
from gearbox.updating.virtual import Run, Settings, run_model
from surrogate import DesignSpace

SPACE = DesignSpace.from_mapping(RANGES)
TRUTH = {**START, "K": 6.44e5, "C_D": 303.0, "e_F": 2.27}  # the paper's Table 4, updated
#: Table 5, at speeds a little beside those that the rig reports.
TRUE_SPEEDS = [(1000.3, 150.0), (1006.2, 50.0), (1004.8, 75.0), (1003.1, 100.0)]
NAMES = ["base", "condition 1", "condition 2", "condition 3"]


def recordings(noise: float = 0.1, sidebands: float = 0.3, truth=TRUTH) -> list[Recording]:
    found = []
    for i, (name, (speed, torque)) in enumerate(zip(NAMES, TRUE_SPEEDS, strict=True)):
        _, signals = measured(truth, OperatingCondition(speed, torque), noise=noise, sidebands=sidebands, seed=i)
        found.append(Recording(OperatingCondition(round(speed), torque, name), signals))
    return found


def settings(**changes) -> UpdatingSettings:
    swarm = {"population": 20, "iterations": 40}
    usual = {"sensors": ("seat", "base"), "points": (25, 45), "levels": 5, "options": swarm}
    return UpdatingSettings(space=SPACE, start=START, sensor="seat", driving_teeth=TEETH, **{**usual, **changes})


def chain(identify=1, truth=TRUTH, noise=0.1, sidebands=0.3, **changes) -> UpdatingChain:
    made = recordings(noise, sidebands, truth)
    return UpdatingChain(
        settings(**changes), Runs(stand_in, Settings(driving_teeth=TEETH)), made[:identify], made[identify:]
    )


@pytest.fixture(scope="module")
def result():
    return chain().run()


# -------------------------------------------------------------------- runs


def test_a_short_run_stands_for_a_long_one():
    condition = OperatingCondition(1000.0, 150.0)
    run = run_model(stand_in, START, condition, Settings(driving_teeth=TEETH))
    long = stand_in(START, condition, 0.5)["seat"]
    assert run.signal("seat", long.rate, 0.5).values == pytest.approx(long.values, rel=1e-9, abs=1e-9 * long.rms)
    assert run.off_mesh < 1e-9
    assert Run.from_dict(json.loads(json.dumps(run.to_dict()))).amplitudes["seat"] == pytest.approx(
        run.amplitudes["seat"]
    )
    with pytest.raises(SignalError, match="no sensor 'seet'; it has seat, base"):
        run.signal("seet", 1e4, 0.5)


def test_runs_are_stored_and_not_done_twice(tmp_path):
    condition = OperatingCondition(1000.0, 150.0)
    wanted = [({**START, "K": k}, condition) for k in (5e5, 6e5, 7e5, 5e5)]
    with Runs(stand_in, Settings(driving_teeth=TEETH), store=tmp_path / "runs.jsonl") as first:
        made = first.many(wanted)
    assert (first.done, first.reused) == (3, 0)
    with Runs(stand_in, Settings(driving_teeth=TEETH), store=tmp_path / "runs.jsonl") as second:
        again = second.many(wanted)
    assert (second.done, second.reused) == (0, 3)
    for a, b in zip(made, again, strict=True):
        assert a.amplitudes["seat"] == pytest.approx(b.amplitudes["seat"], rel=1e-15)
    with Runs(stand_in, replace(Settings(driving_teeth=TEETH), periods=30), store=tmp_path / "runs.jsonl") as other:
        other.many(wanted)
    assert other.done == 3  # other settings are another run


class Interrupted(BaseException):
    """As a keyboard interrupt: not an error that a run may have."""


def test_interrupted_design_is_resumed_without_loss(tmp_path):
    """Interrupted at the eighth of twenty runs and in the middle of a line: seven are kept, thirteen are made."""
    condition = OperatingCondition(1000.0, 150.0)
    wanted = [({**START, "K": k}, condition) for k in np.linspace(5e5, 9e5, 20)]
    store = tmp_path / "runs.jsonl"
    calls = 0

    def failing(values, at, duration):
        nonlocal calls
        calls += 1
        if calls == 8:
            raise Interrupted
        return stand_in(values, at, duration)

    def stage(values, at, duration):
        return stand_in(values, at, duration)

    runs = Runs(failing, Settings(driving_teeth=TEETH), store=store)
    runs._identity = "one model"
    with pytest.raises(Interrupted):
        runs.many(wanted)
    assert len(store.read_text(encoding="utf-8").splitlines()) == 7
    with store.open("a", encoding="utf-8") as file:
        file.write('{"key": "torn, the power went')
    again = Runs(ModelSource(lambda _: stage, "", "one model"), Settings(driving_teeth=TEETH), store=store)
    assert (len(again), again.lost) == (7, 1)
    again.many(wanted)
    assert (again.done, again.reused) == (13, 7)
    last = Runs(ModelSource(lambda _: stage, "", "one model"), Settings(driving_teeth=TEETH), store=store)
    assert len(last) == 20


def test_a_stored_run_with_numbers_that_are_not_finite_is_done_again(tmp_path):
    condition = OperatingCondition(1000.0, 150.0)
    store = tmp_path / "runs.jsonl"
    with Runs(stand_in, Settings(driving_teeth=TEETH), store=store) as first:
        (made,) = first.many([(START, condition)])
    amplitude = json.dumps(float(made.amplitudes["seat"][0].real))
    text = store.read_text(encoding="utf-8")
    assert amplitude in text
    store.write_text(text.replace(amplitude, "NaN", 1), encoding="utf-8")
    with Runs(stand_in, Settings(driving_teeth=TEETH), store=store) as second:
        (again,) = second.many([(START, condition)])
    assert (second.lost, second.done) == (1, 1)
    assert again.amplitudes["seat"] == pytest.approx(made.amplitudes["seat"], rel=1e-15)


def test_processes_give_the_same_runs(tmp_path):
    condition = OperatingCondition(1000.0, 150.0)
    wanted = [({**START, "K": k}, condition) for k in np.linspace(5e5, 9e5, 6)]
    source = ModelSource(load, "stand-in", "1")
    with Runs(source, Settings(driving_teeth=TEETH), processes=2, store=tmp_path / "two.jsonl") as two:
        parallel = two.many(wanted)
    with Runs(source, Settings(driving_teeth=TEETH)) as one:
        serial = one.many(wanted)
    for a, b in zip(parallel, serial, strict=True):
        assert a.values == b.values
        assert a.amplitudes["base"] == pytest.approx(b.amplitudes["base"], rel=1e-12)


def test_model_that_does_not_repeat_keeps_its_signals(tmp_path):
    def humming(values, condition, duration):
        found = stand_in(values, condition, duration)
        seat = found["seat"]
        hum = 0.08 * seat.rms * np.cos(2 * np.pi * 1627.0 * np.arange(len(seat)) / seat.rate)
        return {**found, "seat": seat.with_values(seat.values + hum)}

    condition = OperatingCondition(1000.0, 150.0)
    whole = Settings(driving_teeth=TEETH, periodic=False, duration=0.6)
    store = tmp_path / "runs.jsonl"
    kept = Runs(humming, whole, store=store).one(START, condition)
    assert kept.off_mesh == pytest.approx(0.08 / np.sqrt(2.0), rel=0.02)
    again = Runs(humming, whole, store=store)
    read = again.one(START, condition).signal("seat", 25_600.0, 0.5)
    assert again.reused == 1
    # Signals are kept in single precision.
    assert read.values == pytest.approx(kept.signal("seat", 25_600.0, 0.5).values, rel=1e-6, abs=1e-6 * read.rms)
    short = UpdatingChain(settings(), Runs(humming, Settings(driving_teeth=TEETH)), recordings()[:1])
    with pytest.raises(UpdatingError, match=r"off the mesh lines.*set periodic = false"):
        short.check_frequencies()
    full = UpdatingChain(settings(), Runs(humming, whole), recordings()[:1])
    assert full.check_frequencies().accepted


def test_failed_run_costs_one_point_and_not_the_design():
    def fragile(values, condition, duration):
        if values["K"] > 1.2e6:
            raise ValueError("no equilibrium")
        return stand_in(values, condition, duration)

    made = recordings()
    runs = Runs(fragile, Settings(driving_teeth=TEETH))
    found = UpdatingChain(settings(keep=("K", "C_D", "e_F")), runs, made[:1], made[1:2]).run()
    assert found.failed > 0
    assert found.choice.failed > 0
    assert found.improved
    far = replace(settings(), start={**START, "K": 1.25e6})
    with pytest.raises(UpdatingError, match="cannot be run at base: ValueError: no equilibrium"):
        UpdatingChain(far, Runs(fragile, Settings(driving_teeth=TEETH)), made[:1]).run()


# -------------------------------------------------------------------- the chain


def test_speed_is_taken_from_the_mesh_lines(result):
    assert result.frequencies.reported_rpm == 1000.0
    assert result.frequencies.condition.speed_rpm == pytest.approx(1000.3, abs=0.01)
    assert [c.condition.speed_rpm for c in result.checks] == pytest.approx([1006.2, 1004.8, 1003.1], abs=0.02)
    assert [c.reported_rpm for c in result.checks] == [1006.0, 1005.0, 1003.0]


def test_sensitivity_finds_the_parameters_that_act(result):
    assert set(result.selected) == {"K", "C_D", "e_F"}
    ranges = dict(zip(SPACE.names, result.sensitivity.ranges, strict=True))
    assert max(ranges[n] for n in ("E", "rho", "D_P")) < 0.1 * min(ranges[n] for n in result.selected)


def test_optimum_is_simulated_again_and_the_better_model_taken(result):
    objective = SimilarityObjective(
        recording=recordings()[0].matched(TEETH), sensor="seat", processing=Processing(), driving_teeth=TEETH
    )
    run = run_model(stand_in, result.optimum.values, result.frequencies.condition, Settings(driving_teeth=TEETH))
    assert objective.value([run]) == pytest.approx(result.optimum.simulated, abs=1e-6)
    assert result.optimum.predicted == pytest.approx(result.search.value)
    assert result.updated.simulated == max(c.simulated for c in result.tried)
    assert result.improved


def test_similarity_rises_towards_its_bound_under_all_conditions(result):
    table = result.to_frame()
    assert table["used for updating"].tolist() == [True, False, False, False]
    assert (table["after"] > table["before"]).all()
    assert (table["after"] <= table["upper bound"] + 2e-3).all()
    # Sidebands of 0.3 and noise of 0.1 leave the mesh 1/(1 + 0.09/2 + the noise in the band) of the energy.
    assert table["upper bound"].between(0.96, 0.985).all()


def test_what_one_condition_cannot_tell_and_two_loads_can():
    """The working stiffness of the stand-in follows from K and e_F at each load: one load gives one number."""
    one = chain(1).run()
    two = chain(2, objective="amplitudes").run()
    similar, lines = one.directions
    assert similar.lost == (2,)
    assert lines.lost == (2,)  # one condition, two sensors
    assert similar.std[2] > 10.0
    # Along the lost direction the working stiffness stays: e K d^(e-1), d = (F/K)^(1/e), so K^(1/e) e F^((e-1)/e).
    vector = similar.directions[2] * np.array(SPACE.subset(one.selected).span)
    K, _, e = (one.updated.values[n] for n in ("K", "C_D", "e_F"))
    force = 150.0 / 0.078
    slope_K, slope_e = 1.0 / (e * K), 1.0 / e - np.log(K) / e**2 + np.log(force) / e**2
    moved = slope_K * vector[0] + slope_e * vector[2]
    assert abs(moved) < 0.02 * (abs(slope_K * vector[0]) + abs(slope_e * vector[2]))
    assert two.directions[1].lost == ()
    assert "not identifiable" in similar.describe()
    assert "every direction" in two.directions[1].describe()


def test_objective_of_amplitudes_reaches_the_truth():
    made = [each.matched(TEETH) for each in recordings(noise=0.0, sidebands=0.0)]
    lines = [MeasuredLines.of(each, ("seat", "base"), (1, 2, 3), TEETH) for each in made[:2]]
    objective = AmplitudeObjective(measured=lines, orders=(1, 2, 3), driving_teeth=TEETH)
    runs = [run_model(stand_in, TRUTH, c, Settings(driving_teeth=TEETH)) for c in objective.conditions]
    assert objective.value(runs) == pytest.approx(1.0, abs=1e-4)
    off = [run_model(stand_in, START, c, Settings(driving_teeth=TEETH)) for c in objective.conditions]
    assert objective.value(off) < 0.95
    louder = [replace(r, amplitudes={s: 3.0 * a for s, a in r.amplitudes.items()}) for r in runs]
    assert objective.value(louder) < 0.0
    assert replace(objective, free_gain=True).value(louder) == pytest.approx(1.0, abs=1e-4)


def test_difference_of_signals_sees_their_size_and_the_cosine_does_not():
    """Eq. 7 in the signals' own unit: of k times the signal it leaves (1 - k)^2, whose cosine is one."""
    made = recordings(noise=0.0, sidebands=0.0)[0].matched(TEETH)
    of = {"recording": made, "sensor": "seat", "processing": Processing(), "driving_teeth": TEETH}
    eq_7, eq_8 = DifferenceObjective(**of), SimilarityObjective(**of)
    run = run_model(stand_in, TRUTH, made.condition, Settings(driving_teeth=TEETH))
    assert eq_7.value([run]) == pytest.approx(1.0, abs=1e-3)
    for k in (0.5, 1.5):
        other = replace(run, amplitudes={s: k * a for s, a in run.amplitudes.items()})
        assert eq_8.value([other]) == pytest.approx(eq_8.value([run]), abs=1e-9)
        assert eq_7.value([other]) == pytest.approx(1.0 - (1.0 - k) ** 2, abs=2e-3)
    failed = replace(run, amplitudes={}, error="no rest")
    assert np.isnan(eq_7.value([failed]))


def test_difference_updates_as_well():
    result = chain(objective="difference", points=(25,), identify=True).run()
    assert result.updated.simulated > result.start.simulated
    assert result.sentence().startswith("The surface predicted a share of the signal explained")


def test_directions_scale_with_the_noise():
    made = recordings(noise=0.02, sidebands=0.0)[:2]
    matched = [each.matched(TEETH) for each in made]
    space = SPACE.subset(("K", "C_D", "e_F"))
    objective = AmplitudeObjective(
        measured=[MeasuredLines.of(each, ("seat", "base"), (1, 2), TEETH) for each in matched],
        orders=(1, 2),
        driving_teeth=TEETH,
    )
    runs = Runs(stand_in, Settings(driving_teeth=TEETH))
    point = {n: TRUTH[n] for n in space.names}
    told = identifiability(objective, runs, space, point, noise=0.01, fixed=TRUTH)
    assert told.numbers == 2 * 2 * 2 * 2 - 2  # recordings, sensors, orders, real and imaginary; a lag each
    assert told.std.tolist() == sorted(told.std.tolist())
    tight = identifiability(objective, runs, space, point, noise=0.001, fixed=TRUTH)
    assert tight.std == pytest.approx(told.std / 10.0)
    assert tight.directions @ tight.directions.T == pytest.approx(np.eye(3), abs=1e-9)


def test_model_with_wrong_tooth_number_is_refused_before_anything_is_fitted():
    def other(values, condition, duration):
        return stand_in(values, replace(condition, speed_rpm=condition.speed_rpm * 36 / 32), duration)

    whole = Settings(driving_teeth=TEETH, periodic=False, duration=0.6)
    with pytest.raises(UpdatingError, match=r"off theory by up to 1[23]\.\d % \(limit 5 %\): check tooth numbers"):
        UpdatingChain(settings(), Runs(other, whole), recordings()[:1]).run()


def test_nothing_better_than_the_start_leaves_the_model_as_it_was():
    """Truth at the start, no noise: whatever the surface promises, nothing simulated can be better."""
    found = chain(truth=START, noise=0.0, sidebands=0.0, points=(25,), surface_orders=(2,)).run()
    assert not found.accepted
    assert found.updated.values == START
    assert "refused" in found.sentence()
    assert "stays as it was" in found.sentence()


def test_everything_is_told_at_once():
    with pytest.raises(UpdatingError) as told:
        UpdatingSettings(
            space=SPACE,
            start={**START, "K": 1.0},
            sensor="seat",
            driving_teeth=1,
            rule="guess",
            points=(2,),
            levels=1,
            method="luck",
        )
    assert len(told.value.faults) == 6
    with pytest.raises(UpdatingError, match="has no sensor roof; it has seat, base"):
        UpdatingChain(settings(sensors=("roof",)), Runs(stand_in, Settings(driving_teeth=TEETH)), recordings()[:1])
    with pytest.raises(UpdatingError, match="no recording"):
        UpdatingChain(settings(), Runs(stand_in, Settings(driving_teeth=TEETH)), [])


def test_faults_of_recordings_are_told_before_anything_runs():
    """Sensor and recording are named, all faults in one message."""

    def never(values, condition, duration):
        raise AssertionError("the model was run")

    dead, brief, slow = (recordings()[0] for _ in range(3))
    dead.signals["base"] = dead.signals["base"].with_values(np.full(len(dead.signals["base"]), 0.5))
    brief.signals["seat"] = brief.signals["seat"].cut(0.0, 0.3)
    slow.signals["seat"] = resample(slow.signals["seat"], 2000.0)
    with pytest.raises(UpdatingError) as told:
        UpdatingChain(settings(), Runs(never, Settings(driving_teeth=TEETH)), [dead, brief], [slow])
    assert len(told.value.faults) == 3
    parts = ("sensor 'base': the signal does not vary (zero variance)", "it lasts 0.3 s", "above 1000 Hz, its Nyquist")
    assert all(part in fault for fault, part in zip(told.value.faults, parts, strict=True))


def test_result_is_written_and_can_be_read(result, tmp_path):
    files = {p.name for p in result.write(tmp_path)}
    assert {"updating.json", "report.html", "sensitivity.png", "surface_study.png", "directions.png"} <= files
    content = json.loads((tmp_path / "updating.json").read_text(encoding="utf-8"))
    assert content["accepted"] == result.accepted
    assert content["updated"]["similarity"]["rule"] == "best"
    assert 0.9 < content["updated"]["similarity"]["bound"] < 1.0
    shown = updating_view(tmp_path)({})
    (figure,) = shown["figures"]
    mesh = [m["at"] for m in figure["marks"] if m["name"]]
    assert mesh[0] % content["frequencies"]["mesh_Hz"] == pytest.approx(0.0, abs=1e-6)
    assert [line["name"] for line in figure["lines"]] == ["measured", "model before", "model after"]
    similar = shown["tables"][0]["rows"][0]
    assert similar[-1] == f"{content['conditions'][0]['after']['value']:.3f}"
    with pytest.raises(ValueError, match=r"there is no updating\.json in this folder"):
        updating_view(tmp_path / "nothing")
    assert [c["name"] for c in content["conditions"]] == NAMES[1:]
    assert len(content["surface"]["study"]) == 4
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == len(files) - 2
    assert 'src="http' not in page
    for text in ("lag is part of the score", "upper bound", "not identifiable", "1000.30"):
        assert text in page


def test_held_lag_is_the_one_before_updating():
    found = chain(rule="held", points=(25,), surface_orders=(2,), identify=1)
    before = replace(found.similarity, rule="best", lag=None)
    runs = found.start_runs(found.similarity.conditions)
    assert found.similarity.lag == pytest.approx(before.similarity(runs[0]).lag)
    assert found.similarity.at(found.identify[0]).rule == "best"
