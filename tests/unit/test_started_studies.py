"""``vtsdt init``: a study from recordings and a kind of machine, with the columns' meaning and the sizes found out."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError, read_study
from discrepancy.questions.plausibility import check_problem
from discrepancy.starters.columns import DataColumn, match_places
from discrepancy.starters.kinds import KINDS, Drive, MachineKind, Place
from discrepancy.starters.start import StartedStudy, start_study
from estimation import RecordError
from multibody import Model
from multibody.library import ForceSource, Mass, SpringDamper
from vtsdt.cli import main

WAYS = [(kind, drive) for kind in KINDS.values() for drive in kind.drives]


def model_of(path: Path) -> Model:
    spec = importlib.util.spec_from_file_location(f"started_{path.parent.name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.build()


@pytest.mark.parametrize(("kind", "drive"), WAYS, ids=lambda each: getattr(each, "name", None) or each.what)
def test_every_kind_is_a_model_of_the_library_with_the_places_it_promises(kind: MachineKind, drive: Drive, tmp_path):
    path = tmp_path / "model.py"
    parameters = dict.fromkeys(u.name for u in (*drive.unknown, *kind.unknown))
    path.write_text(kind.model_text(drive, dict.fromkeys(parameters, 0.125)), encoding="utf-8")
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40
    system = model_of(path).build(compiled=False)
    units = {q.name: q.unit for q in (*system.inputs, *system.outputs)}
    for place in (*drive.inputs, *drive.outputs, *kind.outputs):
        assert units[place.name] == place.unit
    assert {q.name for q in system.inputs} == {p.name for p in drive.inputs}
    # each unknown stands in the text as a number that can be replaced
    assert {q.name: q.value for q in system.parameters if q.name in parameters} == dict.fromkeys(parameters, 0.125)


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (["w_motor_rad_s", "w_load_rad_s"], {"rotor.speed": "w_motor_rad_s", "load.speed": "w_load_rad_s"}),
        (
            ["speed load [rpm]", "speed rotor [rpm]"],
            {"rotor.speed": "speed rotor [rpm]", "load.speed": "speed load [rpm]"},
        ),
        (["n [rpm]"], {"rotor.speed": "n [rpm]"}),
        (["speed_ref_rpm"], {}),
        (["motor speed"], {"rotor.speed": "motor speed"}),
        (["force_N"], {}),
        (["channel 3"], {}),
    ],
)
def test_columns_are_matched_by_unit_and_name(columns, expected):
    kind = KINDS["elastic-load"]
    places = [p for p in kind.outputs if p.unit == "rad/s"]
    read = [DataColumn(name, unit_of(name)) for name in columns]
    found = match_places(places, read, {}, commands=False)
    assert {name: m.column.name for name, m in found.items()} == expected


def unit_of(name: str) -> str | None:
    from estimation.files.column_names import read_column_name

    return read_column_name(name).unit


def test_a_named_column_of_another_quantity_is_refused():
    with pytest.raises(StudyError, match=r"is in 'N', and 'rotor.speed' is in 'rad/s'"):
        match_places([Place("rotor.speed", "rad/s")], [DataColumn("F_N", "N")], {"rotor.speed": "F_N"}, commands=False)


def shaken(n: int, seed: int) -> np.ndarray:
    """Time, force, position of 3 kg on 800 N/m with 6 N*s/m, by the exact steps of the linear equation."""
    from scipy.linalg import expm

    t = np.arange(n) * 0.01
    force = 20.0 * np.sin(2.0 * t + 0.15 * t**2 + seed)
    a = np.array([[0.0, 1.0, 0.0], [-800.0 / 3.0, -2.0, 1.0 / 3.0], [0.0, 0.0, 0.0]])
    step = expm(a * 0.01)
    x = np.zeros((n, 2))
    for k in range(n - 1):
        # the force is linear between samples: its middle stands for it to second order
        x[k + 1] = (step @ [*x[k], 0.5 * (force[k] + force[k + 1])])[:2]
    return np.column_stack([t, force, x[:, 0] + 1e-5 * np.random.default_rng(seed).standard_normal(n)])


def written(path: Path, table: np.ndarray, header: str) -> Path:
    np.savetxt(path, table, "%.9g", ",", header=header, comments="")
    return path


HEADER = "Time [s],Shaker force [N],Body travel [mm]"


def in_millimetres(table: np.ndarray) -> np.ndarray:
    return table * [1.0, 1.0, 1e3]


@pytest.fixture(scope="module")
def started(tmp_path_factory) -> StartedStudy:
    folder = tmp_path_factory.mktemp("started")
    data = written(folder / "shaker.csv", in_millimetres(shaken(1500, 0)), HEADER)
    return start_study([data], folder / "study", machine="mass-spring")


def test_sizes_are_found_from_the_record(started):
    """From 1 kg, 1000 N/m and 2 N*s/m, which are typical values, to what the record was made with."""
    model = model_of(started.path.parent / "model.py").build(compiled=False)
    values = {q.name: q.value for q in model.parameters}
    # noise of 1e-5 m beside 0.1 m over 1000 samples: parts in 10 000; four digits are written
    assert values["mass.m"] == pytest.approx(3.0, rel=2e-3)
    assert values["spring.stiffness"] == pytest.approx(800.0, rel=2e-3)
    assert values["spring.damping"] == pytest.approx(6.0, rel=1e-2)


def test_a_torque_shows_the_weight_of_a_pendulum(tmp_path):
    """A typical mass would be taken for a wrong gain of the torque."""
    from scipy.integrate import solve_ivp

    t = np.arange(0.0, 8.0, 0.01)
    torque = 1.2 * np.sin(1.3 * t + 0.2 * t**2)

    def rates(now, x):
        return [x[1], (np.interp(now, t, torque) - 1.2 * 9.81 * 0.25 * np.sin(x[0]) - 0.05 * x[1]) / 0.1]

    angle, speed = solve_ivp(rates, (0.0, t[-1]), [0.1, 0.0], t_eval=t, rtol=1e-8, atol=1e-10).y
    noisy = angle + 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    table = np.column_stack([t, torque, noisy, speed])
    data = written(tmp_path / "swing.csv", table, "t [s],M [Nm],phi [rad],w [rad/s]")
    study = start_study([data], tmp_path / "study", machine="pendulum")
    model = model_of(study.path.parent / "model.py").build(compiled=False)
    values = {q.name: q.value for q in model.parameters}
    # four digits are written; the noise allows parts in 10 000
    assert values["rod.m"] * values["rod.arm"] == pytest.approx(1.2 * 0.25, rel=2e-3)
    assert values["rod.J"] == pytest.approx(0.1, rel=2e-3)


def test_a_started_study_runs_at_once_and_holds_a_third_out(started):
    problem = read_problem(started.path)
    assert [len(e.record.time) for e in (*problem.identify, *problem.validate)] == [1000, 500]
    found = check_problem(problem)
    assert found.faults == ()
    assert any("'mass.position' follows the model: correlation 1.000" in text for text in found.facts)


def test_a_started_study_says_what_was_assumed(started):
    text = started.path.read_text(encoding="utf-8")
    for sentence in started.assumed:
        assert f"# - {sentence}" in text
    assert "column 'Body travel [mm]' is 'mass.position' (by unit and name)" in started.assumed
    assert any("first 1000 rows are fitted, the other 500 held out" in sentence for sentence in started.assumed)


def test_of_several_recordings_every_third_is_held_out(tmp_path):
    for k in range(4):
        written(tmp_path / f"run{k}.csv", shaken(300, k), "t_s,force_N,x_m")
    path = start_study([tmp_path], tmp_path / "out", machine="mass-spring").path
    study = read_study(path)
    assert [p.name for p in study.identify] == ["run0.csv", "run1.csv", "run3.csv"]
    assert [p.name for p in study.validate] == ["run2.csv"]


def test_what_the_records_cannot_show_is_told_and_left_out(tmp_path):
    """Speed alone, under a voltage, shows two numbers; the motor has four unknown ones."""
    t = np.arange(0.0, 4.0, 0.005)
    volts = 6.0 * np.sign(np.sin(3.0 * t))
    speed = np.zeros(t.size)
    for k in range(t.size - 1):  # a lag of 0.15 s, exactly
        speed[k + 1] = 10.0 * volts[k] + (speed[k] - 10.0 * volts[k]) * np.exp(-0.005 / 0.15)
    noise = 0.01 * np.random.default_rng(0).standard_normal(t.size)
    data = written(tmp_path / "motor.csv", np.column_stack([t, volts, speed + noise]), "t_s,u_V,speed_rad_s")
    begun = start_study([data], tmp_path / "study", machine="dc-motor")
    text = begun.path.read_text(encoding="utf-8")
    assert len(re.findall("^# .*: not shown by these records", text, re.MULTILINE)) >= 1
    assert any("these records cannot show it beside the other parameters" in each for each in begun.assumed)
    assert 'column = "u_V", interpolation = "hold"' in text
    assert not any("cannot show" in w for w in check_problem(read_problem(begun.path)).warnings)


def test_columns_whose_names_say_nothing_are_named_by_the_user(tmp_path):
    data = written(tmp_path / "daq.csv", shaken(300, 1), "ch0,ch1,ch2")
    with pytest.raises(RecordError, match=r"no column looks like a time .* say --time COLUMN"):
        start_study([data], tmp_path / "study", machine="mass-spring")
    with pytest.raises(
        StudyError, match=r"lacks a column that drives a mass-spring.*'push\.force' \(N\).*--column NAME="
    ):
        start_study([data], tmp_path / "study", machine="mass-spring", time="ch0")
    begun = start_study(
        [data],
        tmp_path / "study",
        machine="mass-spring",
        time="ch0",
        columns={"push.force": "ch1", "mass.position": "ch2"},
    )
    study = read_study(begun.path)
    assert (study.inputs["push.force"].column, study.outputs["mass.position"].column) == ("ch1", "ch2")


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(words) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["init"], "DATA is missing"),
        (["init", "{data}"], "--machine KIND or --fmu FILE"),
        (["init", "{data}", "--machine", "pendullum"], "there is no such kind; nearest: 'pendulum'"),
        (["init", "{data}", "--machine", "tanks", "--column", "pump.flow"], "write it as --column NAME=COLUMN"),
        (["init", "{data}", "--machine", "tanks", "--column", "pump.flw=x"], "nearest: 'pump.flow'"),
        (["init", "{data}", "--machine", "tanks"], "lacks a column that drives a tanks"),
        (["init", "nowhere.csv", "--machine", "tanks"], "there is no such file"),
        (["init", "{data}", "--fmu", "{data}"], "--fmu"),
    ],
)
def test_what_is_missing_is_told_with_the_remedy(words, told, tmp_path, capsys):
    data = str(written(tmp_path / "shaker.csv", shaken(30, 0), "t_s,force_N,x_m"))
    out = ["--out", str(tmp_path / "study")]
    message = refused([word.format(data=data) for word in words] + (out if len(words) > 1 else []), capsys)
    assert told in message
    assert not (tmp_path / "study" / "study.toml").exists()


def test_a_folder_with_a_study_is_left_alone(started, capsys):
    before = started.path.read_bytes()
    data = started.path.parent / "records" / "fit.csv"
    assert "there is a study in it already" in refused(
        ["init", str(data), "--machine", "mass-spring", "--out", str(started.path.parent)], capsys
    )
    assert started.path.read_bytes() == before


def test_the_kinds_are_listed(capsys):
    assert main(["init", "--list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in KINDS)


def shaker() -> Model:
    model = Model("shaker")
    mass = model.add("mass", Mass(m=3.0))
    spring = model.add("spring", SpringDamper(stiffness=800.0, damping=6.0))
    push = model.add("push", ForceSource())
    model.connect(mass.flange, spring.b, push.flange)
    model.connect(spring.a, model.ground)
    model.input("push.force", push.force)
    return model


def test_an_fmu_takes_the_place_of_a_kind(tmp_path):
    pytest.importorskip("fmpy")
    fmu = shaker().build().to_fmu(tmp_path / "shaker.fmu")
    data = written(tmp_path / "shaker.csv", in_millimetres(shaken(300, 0)), HEADER)
    begun = start_study([data], tmp_path / "study", fmu=fmu)
    problem = read_problem(begun.path)
    assert problem.identify[0].inputs == ("push.force",)
    assert {q.name: (q.value, q.std) for q in problem.uncertain}["plant.mass_m"] == (3.0, pytest.approx(0.3))
    assert any("known to 10 %" in each for each in begun.assumed)
