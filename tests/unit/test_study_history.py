"""A search that is broken off loses nothing, its history builds every stage again, and every stage is a model."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.problem.study_file import StudyError
from discrepancy.report.write import write_report
from discrepancy.study.history import restore, save_history
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from multibody import Model
from multibody.base.errors import SimulationError
from multibody.library import ForceSource, Mass, Spring, ViscousFriction

DT = 0.01


def slide() -> Model:
    model = Model("slide")
    carriage, drive = model.add("carriage", Mass(m=20.0)), model.add("drive", ForceSource())
    guide, spring = model.add("guide", ViscousFriction(viscous=30.0)), model.add("spring", Spring(stiffness=400.0))
    model.connect(carriage.flange, drive.flange, guide.a, spring.a)
    model.connect(guide.b, spring.b, model.ground)
    model.input("drive.force", drive.force)
    model.output("spring.force", spring.tension)
    return model


def problem_of(dry: float = 6.0, offset: float = 0.0) -> Problem:
    """Return a study of a slide with dry friction that the model lacks, and a sensor that is off by ``offset`` m."""
    model, rng = slide(), np.random.default_rng(5)
    truth = Effect.at_place(
        "coulomb_friction", guide_of(model), strengths={"coulomb": dry}, shape={"v_s": 2e-3}
    ).added_to(model)
    time = np.arange(0.0, 12.0, DT)
    records = []
    for k, rate in enumerate((0.4, 0.55, 0.3)):
        force = 60.0 * np.sin(2 * np.pi * rate * time) + 20.0 * np.sin(2 * np.pi * 2.3 * rate * time)
        run = truth.build().simulate((0.0, time[-1]), inputs={"drive.force": (time, force)}, times=time, rtol=1e-8)
        position = run["carriage.position"] + offset + 2e-4 * rng.standard_normal(time.size)
        signals = {
            "drive.force": RecordedSignal(values=force, unit="N", column="f", measured_unit="N"),
            "carriage.position": RecordedSignal(values=position, unit="m", column="x", measured_unit="m"),
        }
        records.append(Record(name=f"run{k}", path=Path(f"run{k}.csv"), time=time, signals=signals))
    experiments = make_experiments(
        model, records, ("drive.force",), ("carriage.position",), start={"carriage.position": 0.0}, free=()
    )
    uncertain = (UncertainParameter(name="guide.viscous", value=30.0, std=5.0, min=0.0),)
    return Problem(
        name="slide",
        model=model,
        uncertain=uncertain,
        identify=experiments[:2],
        validate=experiments[2:],
        noise={"carriage.position": 2e-4},
        include=("coulomb_friction@*", "viscous_friction@*", "constant_force@*", "sensor_*"),
        residual="simulation",
    )


def guide_of(model: Model):
    return next(p for p in model.places() if p.name == "guide")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A diagnosis without interruption, and what it wrote."""
    folder = tmp_path_factory.mktemp("whole")
    study = Study(problem_of())
    study.checkpoint = lambda s: save_history(s, folder / "history.json")
    conclusion = study.diagnose()
    write_report(conclusion, folder)
    return study, conclusion, folder


def errors_of(study: Study) -> list[dict[str, float]]:
    return [s.rmse(part) for s in study.stages for part in ("identify", "validate")]


def test_dry_friction_is_found_here(whole):
    _, conclusion, _ = whole
    assert [str(a.effect) for a in conclusion.accepted] == ["coulomb_friction@guide"]


@pytest.mark.parametrize("word", ["sensitivities of", "add coulomb", "scores of"])
def test_a_search_that_is_broken_off_goes_on_to_the_same_answer(whole, interrupter, tmp_path, word):
    study, _, _ = whole
    broken = Study(problem_of(), progress=interrupter(word))
    broken.checkpoint = lambda s: save_history(s, tmp_path / "history.json")
    told = broken.diagnose()
    assert broken.interrupted
    assert any("interrupted" in w for w in told.warnings)
    again = Study(problem_of())
    restore(again, tmp_path / "history.json")
    assert len(again.stages) == len(broken.stages)
    again.diagnose()
    assert [s.name for s in again.stages] == [s.name for s in study.stages]
    for mine, theirs in zip(errors_of(again), errors_of(study), strict=True):
        assert mine == pytest.approx(theirs, rel=1e-9)


def test_an_interruption_before_anything_was_found_passes_on(interrupter):
    study = Study(problem_of(), progress=interrupter("recalibrate"))
    with pytest.raises(KeyboardInterrupt):
        study.diagnose()


def test_a_history_builds_the_stages_again_to_the_last_digit(whole):
    study, _, folder = whole
    again = Study(problem_of())
    restore(again, folder / "history.json")
    assert errors_of(again) == errors_of(study)
    for mine, theirs in zip(again.stages, study.stages, strict=True):
        assert mine.identify.to_dict() == theirs.identify.to_dict()
        assert np.array_equal(mine.identify.std, theirs.identify.std)
        assert mine.accepted == theirs.accepted


def test_a_history_of_another_study_is_refused(whole):
    _, _, folder = whole
    other = Study(replace(problem_of(), seed=9))
    with pytest.raises(StudyError, match="belongs to another"):
        restore(other, folder / "history.json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not the history"),
        ('{"schema": 1, "stages": [NaN]}', "not the history of a study: NaN is no finite number"),
        ('{"schema": 1, "stages": [-Infinity]}', "-Infinity is no finite number"),
        ('{"schema": 7}', "schema 1"),
        ('{"schema": 1}', "'fingerprint' is missing"),
    ],
)
def test_a_damaged_history_says_what_is_wrong(tmp_path, text, message):
    path = tmp_path / "history.json"
    path.write_text(text)
    with pytest.raises(StudyError, match=message):
        restore(Study(problem_of()), path)


def test_a_history_with_a_damaged_stage_names_the_stage(whole, tmp_path):
    _, _, folder = whole
    content = json.loads((folder / "history.json").read_text())
    del content["stages"][1]["scale"]
    (tmp_path / "history.json").write_text(json.dumps(content))
    with pytest.raises(StudyError, match="stage 1 is damaged"):
        restore(Study(problem_of()), tmp_path / "history.json")


def test_every_stage_is_a_model_that_runs_on_its_own(whole):
    study, _, folder = whole
    record = study.problem.validate[0].record
    force = record.signals["drive.force"].values
    for k, stage in enumerate(study.stages):
        model = Model.load(folder / "stages" / f"{k}.json")
        run = model.build().simulate(
            (0.0, float(record.time[-1])),
            inputs={"drive.force": (record.time, force)},
            times=record.time,
            initial=stage.validate.fits[0].own,
        )
        error = record.signals["carriage.position"].values - run["carriage.position"]
        assert np.sqrt(np.mean(error**2)) == pytest.approx(stage.rmse("validate")["carriage.position"], rel=1e-3)


def test_an_error_of_a_sensor_is_in_the_saved_model(tmp_path):
    study = Study(replace(problem_of(offset=0.01), include=("sensor_offset@*",)))
    _ = study.stage
    study.add(Effect(kind="sensor_offset", where="carriage.position", strengths={"offset": 0.0}))
    found = study.stage.effects[-1].strengths["offset"]
    assert found == pytest.approx(0.01, rel=0.1)
    path = study.stage.machine.save(tmp_path / "model.json")
    run = Model.load(path).build().simulate(1.0, inputs={"drive.force": 0.0})
    assert run["reading.carriage.position"][0] == pytest.approx(found, abs=1e-12)


def test_the_inverse_residual_saves_the_machine_and_not_the_copy_that_is_moved():
    study = Study(replace(problem_of(), residual="inverse"))
    assert any(n.startswith("needed.") for n in study.stage.model.components)
    machine = study.stage.machine
    assert set(machine.components) == set(slide().components)
    assert set(machine.inputs) == {"drive.force"}
    fitted = study.stage.identify["guide.viscous"]
    system = machine.build()
    assert system.p[system.index("parameter", "guide.viscous")] == pytest.approx(fitted)


def test_an_effect_without_strengths_begins_at_absence_and_is_fitted():
    study = Study(problem_of())
    place = next(p for p in study.stage.system.places if p.name == "guide")
    effect = Effect.at_place("coulomb_friction", place)
    assert effect.strengths == {"coulomb": 0.0}
    assert effect.shape == {"v_s": 1e-3}
    stage = study.add(effect)
    assert stage.effects[-1].strengths["coulomb"] == pytest.approx(6.0, rel=0.1)


def test_an_effect_with_unknown_names_says_so():
    place = guide_of(slide())
    with pytest.raises(ValueError, match=r"no strength 'height'.*no parameter 'v_z'"):
        Effect.at_place("coulomb_friction", place, strengths={"height": 1.0}, shape={"v_z": 1.0})
    with pytest.raises(ValueError, match="acts on a sensor"):
        Effect.at_place("sensor_gain", place)
    with pytest.raises(ValueError, match="shape needs 'low'"):
        Effect.at_place("unknown_force", place, over="position")


def test_an_effect_too_strong_to_simulate_is_begun_at_a_smaller_strength(monkeypatch):
    study = Study(problem_of())
    place = next(p for p in study.stage.system.places if p.name == "guide")
    fit = Study.fitted

    def fragile(self, name, effects, *rest, **options):
        if effects and effects[-1].strengths["coulomb"] > 5.0:
            raise SimulationError("the step became too small")
        return fit(self, name, effects, *rest, **options)

    monkeypatch.setattr(Study, "fitted", fragile)
    stage = study.add(Effect.at_place("coulomb_friction", place, strengths={"coulomb": 40.0}))
    assert stage.effects[-1].strengths["coulomb"] == pytest.approx(6.0, rel=0.1)
    with pytest.raises(SimulationError, match="cannot be added"):
        study.add(Effect.at_place("coulomb_friction", place, strengths={"coulomb": 4000.0}))
