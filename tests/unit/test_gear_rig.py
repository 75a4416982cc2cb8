"""The virtual gear rig and the two commands: what is written, what is refused, one whole update on recordings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from gear_stand_in import measured

from discrepancy.problem.study_file import StudyError, read_study
from discrepancy.rigs.case import write_csv
from discrepancy.rigs.recording import BenchError
from gearbox.files.operating_condition import OperatingCondition
from gearbox.rig import accelerometers
from gearbox.rig.accelerometers import PARAMETERS
from gearbox.rig.command import listing
from gearbox.rig.hidden import KINDS, choose, manufacturing
from gearbox.rig.rig import CONDITIONS, GearRig, record, true_stage
from gearbox.updating.study import read_updating_study
from vtsdt.cli.command_line import main

BASE = CONDITIONS[:1]


@pytest.fixture(scope="module")
def clean():
    """The base condition of a rig whose truth lies inside the model."""
    return record(GearRig(seed=4, conditions=BASE, duration=0.6))


# -------------------------------------------------------------------- what is hidden


def test_truth_lies_within_the_study_and_beside_its_start():
    bounds = {name: (low, high, start) for name, start, low, high, _ in PARAMETERS}
    for seed in range(20):
        for name, value in GearRig(seed=seed).true_values().items():
            low, high, start = bounds[name]
            assert low < value < high
            assert value != start


def test_every_kind_moves_something_in_the_stage():
    """Strength zero is absence; every listed kind at every place changes values or tables of the stage."""
    plain, before = true_stage(GearRig(), [])
    assert not plain.structure.imperfect
    for name, where, *_ in listing():
        (fault,) = choose([f"{name}@{where}"], np.random.default_rng(0))
        stage, values = true_stage(GearRig(), [fault])
        known = {f"{n}.{p}" for n, c in stage.components.items() for p in c.values}
        assert set(fault.values()) <= known, name
        assert {k: v for k, v in values.items() if before.get(k, 0.0) != v}, name


def test_pitch_errors_have_unit_size_and_close_over_the_gear():
    (fault,) = choose(["pitch_error@output_gear"], np.random.default_rng(1))
    teeth, pattern = fault.patterns((32, 44))["pattern_2"]
    assert teeth.tolist() == list(range(44))
    assert pattern.mean() == pytest.approx(0.0, abs=1e-12)
    assert pattern.std() == pytest.approx(1.0)


def test_sizes_follow_strength_and_seed():
    usual = KINDS["eccentricity"].usual * KINDS["eccentricity"].size
    (one,) = choose(["eccentricity"], np.random.default_rng(5), strength=3.0)
    assert 0.8 * 3 * usual <= one.size <= 1.2 * 3 * usual
    assert one.where == "output_gear"
    assert manufacturing(np.random.default_rng(0), 0.0) == []
    assert len(manufacturing(np.random.default_rng(0), 1.0)) == 12
    hidden = GearRig(manufacturing=1.0).faults_of(["eccentricity@output_gear"])
    assert [f.name for f in hidden].count("eccentricity@output_gear") == 1


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["excentricity"], "there is no effect 'excentricity'.*eccentricity"),
        (["eccentricity@housing"], "eccentricity fits output_gear, input_gear"),
        (["wear", "wear@mesh"], "asked for twice"),
    ],
)
def test_what_cannot_be_hidden_is_refused(asked, told):
    with pytest.raises(BenchError, match=told):
        GearRig().faults_of(asked)


def test_settings_of_the_rig_are_refused_at_once():
    with pytest.raises(BenchError) as told:
        GearRig(seed=-1, noise=-1.0, duration=0.1, housing="soft", strength=0.0)
    assert len(told.value.faults) == 5


# -------------------------------------------------------------------- what is recorded


def test_recordings_are_the_same_for_the_same_seed(clean):
    (first,), _ = clean
    (again,), _ = record(GearRig(seed=4, conditions=BASE, duration=0.6))
    assert all(np.array_equal(first.columns[c], again.columns[c]) for c in first.columns)
    assert first.reported == OperatingCondition(1000.0, 150.0, "base")
    assert abs(first.true.speed_rpm / 1000.0 - 1.0) <= 3e-4


def test_recording_has_its_mesh_at_the_true_speed(clean):
    (made,), _ = clean
    found = made.recording(["a_output_seat_z", "a_base_y"]).matched(32)
    assert found.condition.speed_rpm == pytest.approx(made.true.speed_rpm, rel=3e-5)
    assert found.nominal.speed_rpm == 1000.0


def test_rig_without_faults_has_nothing_but_mesh_lines_and_noise(clean):
    from gearbox.signals.mesh_lines import energy_share, harmonics_in

    (made,), faults = clean
    assert faults == []
    signal = made.recording(["a_base_y"]).matched(32)
    mesh = signal.condition.mesh_frequency(32)
    each = signal.signal("a_base_y").cut(0.0, 0.5)
    share = energy_share(each, harmonics_in(mesh, 0.0, 12_500.0))
    # Noise of 0.3 m/s² and a speed that wanders by 2e-5: at the tenth order that is 0.05 turns in 0.5 s.
    assert share > 1.0 - 0.3**2 / each.rms**2 - 0.01


# -------------------------------------------------------------------- study, commands


def test_study_does_not_give_the_truth_away():
    quiet = GearRig(seed=1, manufacturing=0.0)
    loud = GearRig(seed=2, manufacturing=2.0, strength=3.0)
    assert accelerometers.study(quiet) == accelerometers.study(loud)
    assert "synthetic" in accelerometers.study(quiet)
    assert "**These data are synthetic.**" in accelerometers.readme(quiet)


def study_on_stand_in(folder: Path, **changes: str) -> Path:
    """A study of recordings of the stand-in, with a model file beside it."""
    truth = {"K": 6.44e5, "C_D": 303.0, "e_F": 2.27, "D_P": 0.1, "E": 210.0, "rho": 7800.0}
    for name, speed, torque in (("base", 1000.3, 150.0), ("light", 1006.2, 50.0)):
        _, signals = measured(truth, OperatingCondition(speed, torque), noise=0.05, duration=0.6)
        seat = signals["seat"]
        columns = {
            "speed_rpm": np.full(len(seat), round(speed)) + 0.01 * np.arange(len(seat)) / len(seat),
            "torque_Nm": torque + 0.01 * np.sin(np.arange(len(seat))),
            **{f"{n} [m/s2]": s.values for n, s in signals.items()},
        }
        write_csv(folder / f"{name}.csv.gz", seat.time, columns)
    code = Path(__file__).with_name("gear_stand_in.py").read_text(encoding="utf-8")
    (folder / "stage.py").write_text(code + "\n\ndef build():\n    return stand_in\n", encoding="utf-8")
    text = """
[model]
build = "stage.py:build"
[inputs]
"speed" = "speed_rpm"
"load" = "torque_Nm"
[outputs]
"seat" = "seat [m/s2]"
"base" = "base [m/s2]"
[records]
time = "time_s"
identify = ["base.csv.gz"]
validate = ["light.csv.gz"]
[updating]
sensor = "seat"
sensors = ["seat", "base"]
driving_teeth = 32
speed = "speed"
load = "load"
points = [25]
surface_orders = [2]
levels = 3
test = 8
population = 10
iterations = 20
[updating.parameters]
K = { start = 8.6e5, min = 4.3e5, max = 12.9e5 }
C_D = { start = 86.0, min = 86.0, max = 860.0, unit = "N s/mm" }
e_F = { start = 2.0, min = 1.5, max = 2.5 }
D_P = { start = 0.1, min = 0.05, max = 0.15 }
E = { start = 210.0, min = 179.0, max = 242.0 }
rho = { start = 7800.0, min = 6600.0, max = 9000.0 }
"""
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    study = folder / "study.toml"
    study.write_text(text, encoding="utf-8")
    return study


def test_command_updates_a_model_and_goes_on_where_it_stopped(tmp_path, capsys):
    study = study_on_stand_in(tmp_path)
    out = tmp_path / "updating"
    words = ["update-gearbox", str(study), "--out", str(out), "--processes", "1"]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "Cosine similarity, before and after" in told
    assert "[r/min]" in told
    assert "[ms]" in told
    assert "rule 'best'" in told
    assert "upper bound" in told
    content = json.loads((out / "updating.json").read_text(encoding="utf-8"))
    assert content["improved"]
    assert content["speed"]["matched_rpm"] == pytest.approx(1000.3, abs=0.02)
    assert content["conditions"][0]["after"]["value"] > content["conditions"][0]["before"]["value"]
    made = content["simulations"]["made"]
    # Interrupted after half of the simulations: the other half is made again, with the same outcome.
    store = out / "simulations.jsonl"
    lines = store.read_text(encoding="utf-8").splitlines(keepends=True)
    assert len(lines) == made
    store.write_text("".join(lines[: made // 2]) + lines[made // 2][:40], encoding="utf-8")
    assert main([*words, "--quiet"]) == 0
    again = json.loads((out / "updating.json").read_text(encoding="utf-8"))
    assert again["simulations"]["made"] == made - made // 2
    assert again["updated"] == content["updated"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({'sensor = "seat"': 'sensor = "roof"'}, r"\[updating\] sensor: 'roof' is not in \[outputs\]"),
        ({'speed = "speed"\nload': 'speed = "pace"\nload'}, r"\[updating\] speed: 'pace' is not in \[inputs\]"),
        (
            {"levels = 3": "levels = 3\nband = [300.0, 6000.0]"},
            "6000.* Hz must rise and lie between 0 and half of rate",
        ),
        ({"start = 2.0": "start = 3.0"}, 'parameters. "e_F": start = 3 lies outside 1.5 to 2.5'),
        ({"driving_teeth = 32": "driving_teet = 32"}, "no key 'driving_teet'.*driving_teeth"),
        ({"[updating.parameters]": "[updating.parametres]"}, "updating.parameters"),
        ({"points = [25]": "points = [2]"}, "designs of at least 4 points"),
        ({"levels = 3": 'levels = 3\nlag = "guess"'}, 'one of "best", "mesh", "held", "none"'),
    ],
)
def test_study_that_cannot_be_is_refused_with_table_and_key(tmp_path, capsys, changes, told):
    study = study_on_stand_in(tmp_path, **changes)
    with pytest.raises(StudyError, match=told):
        read_updating_study(study)
    assert main(["update-gearbox", str(study), "--out", str(tmp_path / "out")]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_model_that_cannot_be_built_is_told_with_its_line(tmp_path, capsys):
    study = study_on_stand_in(tmp_path)
    with (tmp_path / "stage.py").open("a", encoding="utf-8") as file:
        file.write("\n\ndef build():\n    return 1 / 0\n")
    assert main(["update-gearbox", str(study), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "stage.py, line" in told
    assert "ZeroDivisionError" in told
    with (tmp_path / "stage.py").open("a", encoding="utf-8") as file:
        file.write("\n\ndef build():\n    return [1]\n")
    assert main(["update-gearbox", str(study), "--out", str(tmp_path / "out")]) == 2
    assert "vibration(values, condition, duration)" in capsys.readouterr().err


def test_study_of_the_rig_is_one_for_diagnose_too(tmp_path):
    for name, *_ in CONDITIONS:
        (tmp_path / f"{name}.csv.gz").write_text(name)
    (tmp_path / "study.toml").write_text(accelerometers.study(GearRig()), encoding="utf-8")
    study = read_study(tmp_path / "study.toml")
    assert len(study.identify) == 3
    assert read_updating_study(tmp_path / "study.toml").settings().start["e_F"] == 2.0
    from discrepancy.problem.model import check_names, load_model
    from multibody import Model

    system = load_model(study, Model).build(compiled=False)
    names = {k: {q.name: q.unit for q in getattr(system, k)} for k in ("parameters", "inputs", "outputs", "states")}
    assert check_names(study, **names) == ()


def test_commands_explain_themselves(capsys, tmp_path):
    assert main(["bench", "gear", "--list"]) == 0
    told = capsys.readouterr().out
    assert all(kind in told for kind in KINDS)
    assert main(["bench", "gear"]) == 2
    assert "--out DIR is missing" in capsys.readouterr().err
    assert main(["bench", "gear", "--hide", "magic", "--out", str(tmp_path / "x")]) == 2
    assert "there is no effect 'magic'" in capsys.readouterr().err
    assert main(["update-gearbox", str(tmp_path / "none.toml"), "--out", str(tmp_path)]) == 2
    assert main(["update-gearbox", "--help"]) == 0


def test_what_lies_beside_a_study_and_changes_makes_the_runs_again(tmp_path):
    """A stage or modes that the user's own file reads: stored simulations of the older ones must not be used."""
    study = study_on_stand_in(tmp_path)
    first = read_updating_study(study).identity()
    (tmp_path / "stage.toml").write_text('extends = "paper"\n', encoding="utf-8")
    second = read_updating_study(study).identity()
    (tmp_path / "stage.toml").write_text('extends = "paper"\n[contact]\nmu_d = 0.05\n', encoding="utf-8")
    assert len({first, second, read_updating_study(study).identity()}) == 3
    last = read_updating_study(study).identity()
    study.write_text(study.read_text(encoding="utf-8").replace("test = 8", "test = 9"), encoding="utf-8")
    assert read_updating_study(study).identity() == last  # what is asked of the runs does not change them
