"""Start values by record: numbers, expressions, rest; a start that the machine cannot carry is told."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError, read_study
from discrepancy.questions.plausibility import check_problem
from multibody import Model, SimulationError
from multibody.library import ForceSource, InclinedMass, RopeSegment
from vtsdt.cli import main

EA, LENGTH, LOWER, UPPER = 2e4, 4.0, 20.0, 10.0
G = 9.80665


def build() -> Model:
    """Two masses that hang on ropes, one below the other, in a shaft of 10 m; a force acts on the upper one."""
    model = Model("hanging")
    upper = model.add("upper", InclinedMass(m=10.0))
    lower = model.add("lower", InclinedMass(m=20.0))
    high = model.add("high", RopeSegment(EA=2e4, length=4.0, damping=60.0))
    low = model.add("low", RopeSegment(EA=2e4, length=4.0, damping=60.0))
    push = model.add("push", ForceSource())
    model.connect(high.b, model.ground)
    model.connect(high.a, upper.flange, push.flange, low.b)
    model.connect(low.a, lower.flange)
    model.input("push", push.force)
    return model


def rest(force: float) -> tuple[float, float]:
    """Positions of upper and lower mass at rest: each rope carries what hangs on it."""
    upper = -LENGTH * (1.0 + ((UPPER + LOWER) * G - force) / EA)
    return upper, upper - LENGTH * (1.0 + LOWER * G / EA)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    """Two recordings from rest, under a force of 0 and of 60 N at their starts; the lower mass was not measured."""
    folder = tmp_path_factory.mktemp("hanging")
    system = build().build()
    for name, before in (("calm", 0.0), ("held", 60.0)):
        t = np.arange(800) * 0.005
        push = before + 30.0 * np.sin(4.0 * t) * (t > 0.2)
        start = dict(zip(("upper.position", "lower.position"), rest(before), strict=True))
        run = system.simulate((0.0, float(t[-1])), inputs={"push": (t, push)}, initial=start, times=t, rtol=1e-9)
        rng = np.random.default_rng(len(name) + int(before))
        table = [t, push, run["upper.position"] + 1e-5 * rng.standard_normal(t.size)]
        table.append(run["high.tension"] + 0.2 * rng.standard_normal(t.size))
        np.savetxt(
            folder / f"{name}.csv", np.column_stack(table), "%.9g", ",", header="t_s,push_N,x_m,F_N", comments=""
        )
    head = "from multibody import Model\nfrom multibody.library import ForceSource, InclinedMass, RopeSegment\n\n\n"
    (folder / "model.py").write_text(head + inspect.getsource(build), encoding="utf-8")
    return folder


def study(folder: Path, initial: str, name: str = "study") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(
        '[model]\nbuild = "model.py:build"\n[uncertain]\n"lower.m" = { std = 1.0 }\n[inputs]\n"push" = "push_N"\n'
        '[outputs]\n"upper.position" = "x_m"\n"high.tension" = { column = "F_N", noise = 0.2 }\n'
        '[records]\ntime = "t_s"\nidentify = ["calm.csv", "held.csv"]\n[initial]\n' + initial,
        encoding="utf-8",
    )
    return path


def starts(folder: Path, initial: str) -> list[dict[str, float]]:
    experiments = read_problem(study(folder, initial)).identify
    system = build().build(outputs=experiments[0].outputs)
    return [dict(zip(system.state_names, e.start_vector(system), strict=True)) for e in experiments]


def test_a_number_for_each_record(recordings):
    found = starts(recordings, '"lower.position" = { record = { "calm*" = -8.01, "*" = -8.0 } }\n')
    assert [each["lower.position"] for each in found] == [-8.01, -8.0]


def test_an_expression_takes_the_first_samples_of_each_record(recordings):
    found = starts(recordings, '"lower.position" = "upper.position - 2 * (2.0 + high.tension / 4e4) + push / 100"\n')
    table = [np.loadtxt(recordings / f"{n}.csv", delimiter=",", skiprows=1, max_rows=1) for n in ("calm", "held")]
    for each, (_, push, x, force) in zip(found, table, strict=True):
        assert each["lower.position"] == pytest.approx(x - 2.0 * (2.0 + force / 4e4) + push / 100.0, rel=1e-12)


def test_at_rest_means_below_the_measured_position_with_the_force_of_the_record(recordings):
    """From 0 m, where the rope is slack and feels nothing, to the place where it carries the lower mass."""
    found = starts(recordings, '"upper.velocity" = 0.0\n"lower.velocity" = 0.0\n"lower.position" = "equilibrium"\n')
    assert len(found) == 2
    for each in found:
        hangs = each["upper.position"] - LENGTH * (1.0 + LOWER * G / EA)
        assert each["lower.position"] == pytest.approx(hangs, abs=1e-9)


def test_several_states_at_rest_at_once(recordings):
    """Both positions: rest of the whole machine, from the model's own start, where both ropes are slack."""
    found = starts(recordings, '"upper.position" = "equilibrium"\n"lower.position" = "equilibrium"\n')
    for each, force in zip(found, (0.0, 60.0), strict=True):
        assert (each["upper.position"], each["lower.position"]) == pytest.approx(rest(force), abs=1e-8)


def test_words_and_expressions_are_where_the_fit_begins_and_numbers_are_kept(recordings):
    text = '"lower.position" = "equilibrium"\n"upper.velocity" = 0.0\n"lower.velocity" = { record = { "*" = 0.0 } }\n'
    for e in read_problem(study(recordings, text)).identify:
        assert e.free == ("upper.position", "lower.position")


def test_a_slack_rope_at_the_start_is_told(recordings, capsys):
    path = study(recordings, '"lower.position" = -7.9\n"upper.position" = "measured"\n', "slack")
    told = [w for w in check_problem(read_problem(path)).warnings if "seems to start at rest" in w]
    assert len(told) == 2
    for text, record in zip(told, ("calm", "held"), strict=True):
        assert f"record '{record}'" in text
        assert "in place of -7.9" in text
        assert 'say "lower.position" = "equilibrium"' in text
    assert main(["compare", str(path), "--out", str(path.parent / "out")]) == 0
    assert "'lower.position' at -8.09" in capsys.readouterr().err


def test_starts_at_rest_are_not_told(recordings):
    path = study(recordings, '"lower.position" = "equilibrium"\n', "rest")
    assert not [w for w in check_problem(read_problem(path)).warnings if "at rest" in w]


@pytest.mark.parametrize(
    ("initial", "told"),
    [
        ('"lower.position" = "upper.positon - 4"\n', "'upper.positon' is no input or output of the study"),
        ('"lower.position" = "upper.position ** 2"\n', "only numbers, names of inputs and outputs"),
        ('"lower.position" = "__import__(1)"\n', "only numbers, names of inputs and outputs"),
        ('"lower.position" = "equlibrium"\n', "'equlibrium' is no input or output of the study"),
        ('"lower.position" = "2 +"\n', "or an expression, and is '2 \\+'"),
        ('"lower.position" = { record = { "calm*" = true } }\n', "calm\\*: must be a number in SI"),
    ],
)
def test_what_cannot_be_a_start_is_refused(recordings, initial, told):
    with pytest.raises(StudyError, match=told):
        read_study(study(recordings, initial, "wrong"))


def test_a_record_that_no_pattern_fits_is_told(recordings):
    with pytest.raises(StudyError, match="no pattern fits the record 'held'"):
        read_problem(study(recordings, '"lower.position" = { record = { "calm*" = -8.0 } }\n', "wrong"))


def test_no_rest_is_told(recordings):
    """No speed of the lower mass, on a slack rope, keeps it from falling."""
    with pytest.raises(SimulationError, match=r"no lower\.velocity was found at which the machine is at rest"):
        read_problem(study(recordings, '"lower.velocity" = "equilibrium"\n"lower.position" = 0.0\n', "wrong"))
