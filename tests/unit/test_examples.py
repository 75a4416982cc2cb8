"""The examples build without their recordings, and the first tutorial does what its page says."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from discrepancy import Study
from discrepancy.problem.model import check_names, load_model
from discrepancy.problem.problem import make_experiments
from discrepancy.problem.study_file import StudyError, read_study
from estimation import Record
from estimation.files.record import RecordedSignal
from multibody import Model

ROOT = Path(__file__).resolve().parents[2]
STUDIES = sorted((ROOT / "examples").glob("*/*.toml"))
PAGE = ROOT / "docs" / "tutorial" / "first-diagnosis.md"


@pytest.mark.parametrize("path", STUDIES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_study_of_an_example_is_sound(path, tmp_path, monkeypatch):
    """With empty files in place of the recordings, study and model fit each other in every name and unit."""
    if (path.parent / "record.py").is_file():
        path = recorded(path.parent, tmp_path) / path.name
    monkeypatch.setenv("VTSDT_DATA", str(tmp_path))
    for k, name in enumerate(re.findall(r"VTSDT_DATA:-[^}]*\}/([^\"]+)", path.read_text(encoding="utf-8"))):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(str(k))  # copies of one file would be refused
    study = read_study(path)
    assert study.identify
    assert study.validate
    system = load_model(study, Model).build(compiled=False)
    names = {
        kind: {q.name: q.unit for q in getattr(system, kind)} for kind in ("parameters", "inputs", "outputs", "states")
    }
    assert check_names(study, **names) == ()


def recorded(example: Path, folder: Path) -> Path:
    """Return a copy of an example that makes its own recordings, with the recordings made."""
    copy = folder / example.name
    shutil.copytree(example, copy, ignore=shutil.ignore_patterns("__pycache__", "*.csv"))
    run(copy, "record.py")
    return copy


@pytest.mark.parametrize(
    ("name", "effect", "strength", "true"),
    [
        # a leak of 2.5e-13 moves the jaw by millimetres, seen to micrometres
        ("clamp", "laminar_leakage@cylinder", "cylinder.leak", 2.5e-13),
        # 0.8 W/K move the winding by kelvins, seen to a tenth over 1440 samples
        ("motor_heat", "heat_loss@winding", "winding.loss_conductance", 0.8),
    ],
)
def test_the_hidden_effect_of_an_example_takes_the_error_to_the_noise(name, effect, strength, true, tmp_path):
    study = Study.from_file(recorded(ROOT / "examples" / name, tmp_path) / "study.toml")
    noise = {"oil.pressure": 1e4, "jaw.position": 5e-6, "winding.temperature": 0.1, "housing.temperature": 0.1}
    before = study.stage.rmse("validate")
    stage = study.add(effect)
    assert stage.effects[0].parameters()[strength] == pytest.approx(true, rel=0.01)
    for output, error in stage.rmse("validate").items():
        # some 1400 samples or more know the size of the noise to 2 %; rounding adds 4 % to 0.1 K read to 0.1 K
        assert error == pytest.approx(noise[output], rel=0.1)
        assert before[output] > 4.0 * error


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("clamp", "laminar_leakage"), ("motor_heat", "heat_loss")])
def test_the_hidden_effect_of_an_example_is_found(name, kind, tmp_path):
    conclusion = Study.from_file(recorded(ROOT / "examples" / name, tmp_path) / "study.toml").diagnose()
    assert [effect.kind for effect in conclusion.stages[-1].effects] == [kind]
    assert conclusion.verdict == "effect found"


def test_study_of_an_example_says_which_recording_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("VTSDT_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(StudyError, match=r"emps_estimation\.csv\.gz.*there is no such file"):
        read_study(ROOT / "examples" / "emps" / "study.toml")


def test_emps_control_holds_the_carriage_on_its_reference():
    """At rest the only force is none: the model settles on a constant reference."""
    system = load_model_of("emps/emps.py").build()
    run = system.simulate(0.5, inputs={"reference.position": 1e-3, "added.pulse": 0.0}, rtol=1e-9)
    # The slowest pole of the loop is near 60 1/s: after 0.5 s e^-30 is left, but for dry friction, which
    # below v_s is viscous with coulomb/v_s = 2e4 N s/m against 1.37e6 N/m of the loop: e^-34.
    assert run["carriage.position"][-1] == pytest.approx(1e-3, abs=1e-8)


def test_pulse_reaches_the_recorded_force_at_once():
    system = load_model_of("emps/emps.py").build()
    x = system.start
    pulse = np.zeros(len(system.inputs))
    pulse[system.index("input", "added.pulse")] = 0.1
    rise = system.outputs_at(0.0, x, pulse) - system.outputs_at(0.0, x, np.zeros_like(pulse))
    assert rise[system.index("output", "motor.force")] == pytest.approx(0.1 * 35.15065, rel=1e-12)


def test_pendulum_hangs_at_pi():
    """The encoder's zero: at pi nothing acts, and beside it gravity pulls back with m·g·arm."""
    system = load_model_of("pendulum/pendulum.py").build()
    x = system.start
    x[system.index("state", "rod.angle")] = np.pi + 1e-4
    rate = system.rhs(0.0, x)[system.index("state", "rod.speed")]
    inertia = 1.091e-4 + 0.1476 * 0.1478**2
    assert rate == pytest.approx(-0.1476 * 9.81 * 0.1478 * 1e-4 / inertia, rel=1e-6)


def load_model_of(name: str) -> Model:
    """Build the model of an example from its file."""
    path = ROOT / "examples" / name
    spec = importlib.util.spec_from_file_location(f"example_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.build()


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory):
    """Folder with the files of the tutorial, its recordings made."""
    folder = tmp_path_factory.mktemp("tutorial")
    blocks = re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert [name for name, _ in blocks] == ["slide.py", "record.py", "study.toml", "steps.py"]
    for name, text in blocks:
        (folder / name).write_text(text, encoding="utf-8")
    run(folder, "record.py")
    return folder


def run(folder: Path, *command: str) -> str:
    """Run a script or module with this Python in a folder."""
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_tutorial_machine_is_as_short_as_promised(tutorial):
    assert len((tutorial / "slide.py").read_text(encoding="utf-8").splitlines()) <= 36


def test_tutorial_finds_the_friction(tutorial):
    told = run(tutorial, "steps.py")
    found = re.search(r"coulomb_friction@guide \{'coulomb': ([\d.]+)\}", told)
    assert found, told
    # 2000 samples with 0.5 N of noise determine the friction to a few hundredths of a newton; 3 % leaves room
    # for the 0.5 mm/s by which the smoothing of its sign is fitted.
    assert float(found[1]) == pytest.approx(12.0, rel=0.03)
    for row in ("as given", "recalibrated", "+ coulomb_friction@guide"):
        assert row in told


def test_a_held_input_keeps_its_value_until_the_next_sample():
    """Half-way between two samples a held pulse is the earlier one, and the reference lies between."""
    time = np.arange(5) * 1e-3
    steps = np.array([0.0, 0.0, 5.0, 5.0, 0.0])
    signals = {
        "reference.position": RecordedSignal(values=steps, unit="m", column="r", measured_unit="m"),
        "added.pulse": RecordedSignal(values=steps, unit="V", column="p", measured_unit="V"),
        "motor.force": RecordedSignal(values=np.arange(5.0), unit="N", column="F", measured_unit="N"),
    }
    model = load_model_of("emps/emps.py")
    (experiment,) = make_experiments(
        model,
        [Record(name="made", path=Path("made.csv"), time=time, signals=signals)],
        ["reference.position", "added.pulse"],
        ["motor.force"],
        held=["added.pulse"],
    )
    system = model.build()
    between = experiment.table(system)(np.array([1.5e-3, 3.5e-3]), system.p)
    assert between[:, system.index("input", "added.pulse")].tolist() == [0.0, 5.0]
    assert between[:, system.index("input", "reference.position")].tolist() == pytest.approx([2.5, 2.5])


def from_a_csv():
    spec = importlib.util.spec_from_file_location("from_a_csv", ROOT / "examples" / "from_a_csv.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_a_study_started_from_a_csv_fits_its_recording(tmp_path):
    """The quickest part of one machine; the rest is among the slow tests."""
    example = from_a_csv()
    study = example.start(example.MACHINES[-1], tmp_path)
    example.run("check", str(study))


def test_how_a_machine_ended_is_said_as_it_is():
    example = from_a_csv()
    machine = example.MACHINES[1]
    stages = [{"validate": {"carriage.position": {"rmse": rmse}}} for rmse in (0.0147, 0.0146, 2.1e-6)]
    effect = {"kind": "viscous_friction", "where": "guide", "indistinguishable_from": []}
    found = {"verdict": "effect found", "effects": [effect], "stages": stages, "units": {"carriage.position": "m"}}
    assert "coulomb_friction@guide is missing: NOT FOUND" in example.outcome(machine, found)
    assert "carriage.position 0.0147 -> 2.1e-06 m" in example.outcome(machine, found)
    effect["indistinguishable_from"] = [{"kind": "coulomb_friction", "where": "guide"}]
    assert "coulomb_friction@guide is missing: found" in example.outcome(machine, found)
    assert "named: nothing" in example.outcome(machine, {**found, "effects": []})


@pytest.mark.slow
@pytest.mark.parametrize("place", range(4))
def test_from_a_csv_to_the_missing_effect(place, tmp_path):
    example = from_a_csv()
    machine = example.MACHINES[place]
    (found,) = example.diagnose(example.start(machine, tmp_path))["effects"]
    alike = [found, *found["indistinguishable_from"]]
    assert machine.missing in [f"{each['kind']}@{each['where']}" for each in alike]
