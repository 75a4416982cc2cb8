"""A study step by step: candidates, predictions, effects by name, undo and redo, records left out, history, script."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_study_history import problem_of

from discrepancy.stages.errors_view import errors_view
from discrepancy.study.history import restore, save_history
from discrepancy.study.left_out import Stretch, without_stretches
from discrepancy.study.script import replay, script_of
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal

NAME = "coulomb_friction@guide"


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    """A study in which the second-best candidate was added, removed, and the best added; what was seen on the way."""
    path = tmp_path_factory.mktemp("steps") / "history.json"
    study = Study(problem_of())
    study.checkpoint = lambda s: save_history(s, path)
    rows = [r for r in study.candidates().scan.rows if np.isfinite(r.p_value)]
    prediction = study.predict(NAME)
    second = next(r.name for r in rows if r.name != NAME)
    study.add(second)
    other = study.stage.rmse("validate")
    study.undo()
    study.add(NAME)
    return study, path, rows, prediction, second, other


def test_the_hidden_effect_is_the_best_candidate(stepped):
    assert stepped[2][0].name == NAME


def test_the_linear_prediction_of_a_small_effect_is_that_of_a_fit():
    """What is small enough changes the outputs in proportion; the law's own curve and the shape's grid remain."""
    study = Study(problem_of(dry=0.6))
    before, after = study.predict(NAME).rmse()["carriage.position"]
    assert before == pytest.approx(study.stage.rmse("identify")["carriage.position"], rel=1e-3)
    fitted = study.add(NAME).rmse("identify")["carriage.position"]
    assert before > 2.0 * fitted
    assert before - after == pytest.approx(before - fitted, rel=0.05)


def test_the_prediction_of_a_large_effect_has_the_right_order(stepped):
    study, _, _, prediction, _, _ = stepped
    before, after = prediction.rmse()["carriage.position"]
    assert after < 0.3 * before
    assert study.stage.rmse("identify")["carriage.position"] < after


def test_an_effect_added_by_name_lowers_the_error_on_held_out_records(stepped):
    study, _, _, _, _, other = stepped
    output = "carriage.position"
    assert [s.name for s in study.stages] == ["as given", "recalibrated", f"+ {NAME}"]
    assert study.stage.rmse("validate")[output] < 0.2 * study.stages[1].rmse("validate")[output]
    assert study.stage.rmse("validate")[output] < other[output]


def test_undo_and_redo_compute_nothing_and_end_where_they_began(stepped):
    study = stepped[0]
    last = study.stage
    assert study.undo() is study.stages[1]
    assert study.can_redo
    assert study.redo() is last
    assert not study.can_redo
    assert study.redo() is last
    del study.steps[-2:]
    study.save()


def test_history_holds_every_step_and_builds_the_stages_again(stepped):
    study, path, _, _, second, _ = stepped
    steps = json.loads(path.read_text(encoding="utf-8"))["steps"]
    assert [s["action"] for s in steps] == ["add", "undo", "add"]
    assert [s.get("effect") for s in steps] == [second, None, NAME]
    again = Study(problem_of())
    restore(again, path)
    assert again.steps == steps
    for part in ("identify", "validate"):
        assert again.stage.rmse(part) == study.stage.rmse(part)


def test_steps_taken_again_give_the_same_numbers(stepped):
    study = stepped[0]
    again = Study(problem_of())
    replay(again, study.steps)
    assert again.stage.rmse("validate") == study.stage.rmse("validate")
    assert again.steps == study.steps


def test_a_script_says_the_same_steps(stepped):
    text = script_of(stepped[0].steps, "study.toml")
    compile(text, "script.py", "exec")
    assert text.splitlines()[2:6] == [
        "study = Study.from_file('study.toml')",
        f"study.add({stepped[4]!r})",
        "study.undo()",
        f"study.add({NAME!r})",
    ]


def test_strengths_and_shapes_are_checked(stepped):
    study = Study(problem_of())
    with pytest.raises(KeyError, match="give kind@where"):
        study.add("coulomb_friction")
    with pytest.raises(KeyError, match="did you mean 'coulomb_friction@guide'"):
        study.add("coulomb_frition@guide")
    with pytest.raises(ValueError, match=r"no strength 'coulom'.*no parameter 'x'"):
        study.add(NAME, strength={"coulom": 1.0}, shape={"x": 1.0})
    for strength in ("3 N", float("nan")):
        with pytest.raises(ValueError, match="give a finite number, in SI"):
            study.add(NAME, strength=strength)
    with pytest.raises(TypeError, match=r"Study\.from_file\('axis/study\.toml'\)"):
        Study("axis/study.toml")
    assert study.steps == []


def test_a_stretch_is_left_out_and_everything_is_fitted_again(stepped, tmp_path):
    study = Study(problem_of())
    study.add(NAME)
    before = study.stage
    study.leave_out("run0", 4.0, 6.0)
    assert [e.name for e in study.problem.identify] == ["run0 [0..3.99 s]", "run0 [6.01..11.99 s]", "run1"]
    assert [s.name for s in study.stages] == ["as given", "recalibrated", f"+ {NAME}"]
    times = np.concatenate([e.record.time for e in study.problem.identify[:2]])
    assert not np.any((times >= 4.0) & (times <= 6.0))
    assert study.stage.rmse("validate") != before.rmse("validate")
    for part in ("identify", "validate"):  # the second part begins where the machine was then
        assert study.stage.rmse(part)["carriage.position"] == pytest.approx(2e-4, rel=0.05)  # the sensor's noise
    path = save_history(study, tmp_path / "history.json")
    again = Study(problem_of())
    restore(again, path)
    assert again.left_out == [Stretch("run0", 4.0, 6.0)]
    assert again.stage.rmse("identify") == study.stage.rmse("identify")


def _shown(study: Study) -> tuple[object, ...]:
    """What a person sees of a study."""
    errors = [{part: stage.rmse(part) for part in ("identify", "validate")} for stage in study.stages]
    records = [e.name for e in (*study.problem.identify, *study.problem.validate)]
    return [s.name for s in study.stages], errors, records, list(study.left_out), list(study.priors), study.answer


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """A study after one step of every kind, what was seen before each, and its history."""
    study, path = Study(problem_of()), tmp_path_factory.mktemp("walked") / "history.json"
    study.checkpoint = lambda s: save_history(s, path)
    _ = study.stage
    seen = [_shown(study)]
    for take in (
        lambda: study.leave_out("run0", 4.0, 6.0),
        lambda: study.leave_out("run0 [6.01..11.99 s]", 9.0),
        lambda: study.set_prior("guide.viscous", 20.0, 2.0),
        lambda: study.diagnose(),
        lambda: study.use_again("run0", 4.0, 6.0),
        lambda: study.add_curve("guide", "speed"),
        lambda: study.leave_out("run1"),
    ):
        take()
        seen.append(_shown(study))
    return study, seen, path


def test_steps_of_every_kind_are_undone_and_redone(walked):
    study, seen, _ = walked
    assert len({json.dumps(s, default=str) for s in seen}) == len(seen)  # every step has changed something
    simulated: list[str] = []
    study.progress = simulated.append
    steps = len(study.steps)
    for before in reversed(seen[:-1]):
        study.undo()
        assert _shown(study) == before
    assert not study.can_undo
    for after in seen[1:]:
        study.redo()
        assert _shown(study) == after
    assert not study.can_redo
    assert not simulated
    assert [s["action"] for s in study.steps[steps:]] == ["undo"] * (len(seen) - 1) + ["redo"] * (len(seen) - 1)
    del study.steps[steps:]
    study.save()


def test_steps_of_a_history_are_undone_as_those_just_taken(walked):
    study, seen, path = walked
    again = Study(problem_of())
    restore(again, path)
    assert _shown(again) == seen[-1]
    assert again.can_undo
    for before in reversed(seen[:-1]):
        again.undo()
        assert _shown(again) == before
    save_history(again, path)
    later = Study(problem_of())
    restore(later, path)
    assert _shown(later) == seen[0]
    for after in seen[1:]:
        later.redo()
        assert _shown(later) == after
    assert later.steps[len(study.steps) :] == again.steps[len(study.steps) :] + [{"action": "redo"}] * (len(seen) - 1)
    study.save()


def test_a_part_of_a_record_that_is_left_out_is_one_of_the_record(walked):
    study, seen, _ = walked
    assert [s["record"] for s in study.steps if s["action"] == "leave_out"] == ["run0", "run0", "run1"]
    assert seen[2][3] == [Stretch("run0", 4.0, 6.0), Stretch("run0", 9.0, 11.99)]
    assert seen[2][2] == ["run0 [0..3.99 s]", "run0 [6.01..8.99 s]", "run1", "run2"]


def test_a_stretch_is_used_again_and_the_fit_is_as_before():
    study = Study(problem_of())
    study.add(NAME)
    before = study.stage
    study.leave_out("run0", 4.0, 6.0)
    study.leave_out("run1")
    with pytest.raises(KeyError, match="no stretch of run2 is left out: run0 from 4 s to 6 s; run1 is"):
        study.use_again("run2")
    study.use_again("run1")
    assert study.left_out == [Stretch("run0", 4.0, 6.0)]
    study.use_again("run0", 4.0, 6.0)
    assert study.left_out == []
    output = "carriage.position"
    assert study.stage.rmse("validate")[output] == pytest.approx(before.rmse("validate")[output], rel=1e-3)


def test_branches_are_kept_and_one_can_be_gone_on_from(tmp_path: Path):
    study = Study(problem_of())
    study.add(NAME)
    best = study.stage
    study.undo()
    study.add("sensor_offset@carriage.position")
    other = study.stage
    (branch,) = study.branches()
    assert branch.stages[-1] is best
    study.set_prior("guide.viscous", 20.0, 2.0)
    assert [b.stages[-1] for b in study.branches()] == [best, other]
    path = save_history(study, tmp_path / "history.json")
    again = Study(problem_of())
    restore(again, path)
    assert [b.names for b in again.branches()] == [b.names for b in study.branches()]
    assert again.branches()[0].stages[-1].rmse("validate") == best.rmse("validate")
    for one in (study, again):
        one.switch(0)
        assert one.stage.rmse("validate") == best.rmse("validate")
        assert one.priors == []
    with pytest.raises(KeyError, match="there is no branch 9: take one of 0 to 1"):
        study.switch(9)
    study.undo()
    assert study.priors
    taken = Study(problem_of())
    replay(taken, study.steps)
    assert taken.stage.rmse("validate") == pytest.approx(study.stage.rmse("validate"), rel=1e-9)
    assert "study.switch(0)" in script_of(study.steps, "study.toml")


def test_a_step_that_is_stopped_changes_nothing(interrupter):
    study = Study(problem_of())
    study.add(NAME)
    before, steps = _shown(study), list(study.steps)
    study.progress = interrupter("simulate the model as given")
    with pytest.raises(KeyboardInterrupt):
        study.leave_out("run0", 4.0, 6.0)
    assert _shown(study) == before
    assert study.steps == steps


def test_a_name_that_is_wrong_costs_no_stage():
    study = Study(problem_of())
    with pytest.raises(KeyError, match="did you mean"):
        study.add("coulomb_friction@guid")
    assert [s.name for s in study.stages] == ["as given", "recalibrated"]
    assert study.steps == []
    assert not study.can_undo


def test_scores_of_stages_that_are_two_steps_back_are_freed():
    study = Study(problem_of())
    first = study.stage
    study.candidates()
    study.add(NAME)
    study.leave_out("run1")
    assert first.once(("candidates", study.problem.include), lambda: None) is not None
    study.use_again("run1")
    assert first.once(("candidates", study.problem.include), lambda: None) is None


def test_a_notebook_shows_progress_below_the_cell(monkeypatch):
    shown: list[str] = []

    class Below:
        def show(self, text: str, step: object, notes: str) -> None:
            shown.append(text)

        def close(self) -> None:
            shown.append("")

    monkeypatch.setattr("multibody.base.progress._in_notebook", lambda: True)
    monkeypatch.setattr("multibody.base.progress._Notebook", Below)
    study = Study(problem_of())
    study.compare()
    assert shown[0] == "simulate the model as given"
    assert shown[-1] == ""  # the line is removed again
    own: list[str] = []
    Study(problem_of(), progress=own.append).compare()
    assert own
    assert shown[-1] == ""


def test_the_answer_stays_while_the_stages_are_those_of_it(tmp_path: Path):
    study = Study(problem_of())
    sentence = study.diagnose().sentence
    path = save_history(study, tmp_path / "history.json")
    again = Study(problem_of())
    restore(again, path)
    assert again.answer["sentence"] == sentence
    assert again.answer["verdict"] == "effect found"
    again.undo()
    assert not again.answer
    again.redo()
    assert again.answer["sentence"] == sentence


def test_a_whole_record_may_be_left_out_but_not_all():
    problem = problem_of()
    assert [e.name for e in without_stretches(problem, [Stretch("run0")]).identify] == ["run1"]
    with pytest.raises(ValueError, match="nothing would be left to fit"):
        without_stretches(problem, [Stretch("run0"), Stretch("run1")])
    with pytest.raises(KeyError, match="there is no record 'run9'"):
        without_stretches(problem, [Stretch("run9")])
    with pytest.raises(ValueError, match="is empty"):
        without_stretches(problem, [Stretch("run0", 3.0, 3.0)])


def _check(html: str, *texts: str) -> None:
    assert "data:image/png;base64," in html
    assert len(html) < 120_000
    for text in texts:
        assert text in html


def test_notebooks_show_short_tables_with_a_small_figure(stepped, tmp_path: Path):
    study = stepped[0]
    _check(study._repr_html_(), "Study &#x27;slide&#x27;", NAME, "carriage.position [m]")
    _check(study.stage._repr_html_(), NAME, "root mean square error")
    _check(study.compare()._repr_html_(), "RMS error, held out", "The worst")
    conclusion = study.conclude()
    _check(conclusion._repr_html_(), "recalibrated")
    experiment = study.problem.identify[0]
    _check(experiment.record._repr_html_(), "drive.force", "run0.csv")
    system = study.stage.slim
    run = system.simulate(1.0, inputs={"drive.force": 10.0})
    _check(run._repr_html_(), "samples", "states, inputs, outputs")
    page = study.report(tmp_path / "x.html")
    assert "<html" in page.read_text(encoding="utf-8")
    assert [p.name for p in tmp_path.iterdir()] == ["x.html"]
    assert len(study.plot().axes) == 1


def test_a_notebook_says_which_outputs_are_not_drawn():
    """Eight outputs: all are in the table, with units, and four are drawn."""
    outputs = [f"mass{k}.position" for k in range(8)]

    def stage(name: str, share: float) -> SimpleNamespace:
        errors = {n: share ** (k + 1) for k, n in enumerate(outputs)}
        system = SimpleNamespace(unit=lambda n: "m**2")
        return SimpleNamespace(
            name=name, outputs=outputs, system=system, fits=lambda part: (), rmse=lambda part: errors
        )

    html = errors_view("Study", [stage("as given", 1.0), stage("recalibrated", 0.9)])
    assert "Drawn are the 4 of 8 outputs whose error changed most." in html
    assert all(f"{n} [m²]</td>" in html for n in outputs)


@pytest.mark.parametrize(("count", "last"), [(13, "s12</td>"), (14, "and 2 more</td>")])
def test_a_line_never_stands_for_a_single_signal(count, last):
    t = np.linspace(0.0, 1.0, 11)
    signals = {
        f"s{k}": RecordedSignal(values=t + k, unit="kg*m**2", column=f"column{k}", measured_unit="")
        for k in range(count)
    }
    html = Record(name="run", path=Path("run.csv"), time=t, signals=signals)._repr_html_()
    assert last in html
    assert "and 1 more" not in html
    assert f"Drawn are the first 3 of {count} signals." in html
    assert "s0" in html
    assert "kg·m²</td>" in html


def test_an_effect_that_leaves_an_output_far_off_explains_in_part():
    """A sensor that is 0.3 m off is named; a strong dry friction stays, because the search may name one effect."""
    problem = replace(problem_of(dry=15.0, offset=0.3), search="significance")
    one = Study(replace(problem, max_effects=1)).diagnose()
    assert [str(e) for e in one.stages[-1].effects] == ["sensor_offset@carriage.position"]
    assert "The model does not follow these records" in one.sentence
    assert one.verdict == "partly explained"
    both = Study(problem).diagnose()
    assert sorted(str(e) for e in both.stages[-1].effects) == [NAME, "sensor_offset@carriage.position"]
    assert both.verdict == "effect found"


def test_a_study_without_stages_says_so():
    assert "Nothing is fitted yet" in Study(problem_of())._repr_html_()
