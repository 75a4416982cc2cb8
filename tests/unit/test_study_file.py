"""The study file: every key is read, and one error lists all faults with table and key."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.model import check_names, load_model
from discrepancy.problem.study_file import StudyError, StudyFile, read_study
from estimation import Preparation, ReadRules, RecordError

SOUND = """
[model]
build = "axis.py:build"
arguments = { travel = 0.25 }

[uncertain]
"mass.m" = { value = 95.0, std = 5 }
"friction.viscous" = { std = 50.0, min = 0.0 }

[inputs]
"reference.position" = "position_ref_m"

[outputs]
"motor.force" = { column = "motor_force_N" }
"carriage.position" = { column = "position_mm", noise = 1e-6 }

[records]
time = "time_s"
identify = ["a*.csv"]
validate = ["held_out/b.csv"]
"""
BUILDER = """
import helper_of_this_axis

def build(travel, mass=95.0, *, stroke=1.0):
    return {"travel": travel, "gain": helper_of_this_axis.GAIN}

NOT_A_FUNCTION = 3

def fails(travel):
    return travel / 0.0

def forgets(travel):
    pass
"""


def recording(seed: int) -> str:
    t = np.arange(50) * 0.01
    x = np.sin((5.0 + seed) * t)
    rows = zip(t, x, 1e3 * x + 0.5, 30.0 * np.cos(7.0 * t), strict=True)
    return "time_s,position_ref_m,position_mm,motor_force_N\n" + "".join(
        ",".join(f"{each:.8g}" for each in row) + "\n" for row in rows
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "axis.py").write_text(BUILDER)
    (tmp_path / "helper_of_this_axis.py").write_text("GAIN = 7.0\n")
    (tmp_path / "held_out").mkdir()
    for seed, name in enumerate(["a2.csv", "a1.csv", "held_out/b.csv"]):
        (tmp_path / name).write_text(recording(seed))
    yield tmp_path
    sys.modules.pop("helper_of_this_axis", None)


def study(folder: Path, text: str = SOUND) -> StudyFile:
    (folder / "study.toml").write_text(text)
    return read_study(folder / "study.toml")


def faults(folder: Path, text: str) -> tuple[str, ...]:
    with pytest.raises(StudyError) as refused:
        study(folder, text)
    for each in refused.value.faults:
        assert each in str(refused.value)
    return refused.value.faults


def test_every_table_of_the_format_is_read(folder):
    read = study(folder)
    assert read.model.arguments == {"travel": 0.25}
    assert (read.uncertain["mass.m"].value, read.uncertain["mass.m"].std) == (95.0, 5.0)
    assert read.uncertain["friction.viscous"].min == 0.0
    assert read.inputs["reference.position"].column == "position_ref_m"
    assert read.outputs["carriage.position"].noise == 1e-6
    assert [each.name for each in read.identify] == ["a1.csv", "a2.csv"]
    assert [each.name for each in read.validate] == ["b.csv"]
    assert (read.candidates.include, read.candidates.exclude) == (["*"], [])
    assert (read.study.residual, read.study.seed, read.study.level) == ("auto", 0, 0.02)
    assert read.preparation == Preparation()
    assert read.rules == ReadRules()
    assert read.warnings == ()


def test_every_optional_key_is_read(folder):
    text = (
        SOUND
        + """
start = 0.1
stop = 0.4
low_pass_hz = 10.0
decimate = 2
resample = 100
trip = "trip"
drop_nan = true
drop_duplicates = true
gaps = "split"
longest_gap = 0.2
time_unit = "ms"
[candidates]
exclude = ["cubic_stiffness@*"]
[study]
residual = "inverse"
seed = 4
max_effects = 2
level = 0.05
[initial]
free = ["carriage.position"]
"carriage.speed" = 0.5
"motor.angle" = "free"
"carriage.x" = "measured"
[offsets]
outputs = ["motor.force"]
"""
    )
    read = study(folder, text)
    assert read.preparation == Preparation(start=0.1, stop=0.4, low_pass_hz=10.0, decimate=2)
    assert read.rules == ReadRules(
        trip="trip",
        drop_nan=True,
        drop_duplicates=True,
        resample=100.0,
        gaps="split",
        longest_gap=0.2,
        time_unit="ms",
        start=0.1,
        stop=0.4,
    )
    assert (read.study.residual, read.study.seed, read.study.max_effects, read.study.level) == (
        "inverse",
        4,
        2,
        0.05,
    )
    assert read.initial.free == ("carriage.position", "motor.angle")
    assert read.initial.values == {"carriage.speed": 0.5, "carriage.x": "measured"}
    assert read.offsets.outputs == ["motor.force"]
    assert read.candidates.exclude == ["cubic_stiffness@*"]


def test_names_without_quotes_mean_the_same(folder):
    plain = SOUND.replace('"mass.m"', "mass.m").replace('"motor.force"', "motor.force")
    plain = plain.replace('"reference.position"', "reference.position")
    read, quoted = study(folder, plain), study(folder)
    assert (read.uncertain, read.inputs, read.outputs) == (quoted.uncertain, quoted.inputs, quoted.outputs)


def test_records_come_in_si_and_held_out_ones_stay_apart(folder):
    read = study(folder)
    found = read.read_records({"motor.force": "N", "carriage.position": "m", "reference.position": "m"})
    assert [each.name for each in found.identify] == ["a1", "a2"]
    assert [each.name for each in found.validate] == ["b"]
    signal = found.identify[0].signals["carriage.position"]
    assert (signal.unit, signal.measured_unit) == ("m", "mm")
    assert np.max(np.abs(signal.values)) < 1.01
    with pytest.raises(RecordError) as refused:
        read.read_records({"motor.force": "V"})
    assert len(refused.value.faults) == 3  # one for each file


# Change of the sound study, and what the error must contain.
BROKEN = {
    "unknown table": ("[uncertain]", "[uncertian]", ["[uncertian]: there is no such table; nearest"]),
    "unknown key": ("arguments =", "argument =", ["no key 'argument'; nearest: 'arguments'"]),
    "unknown option": ("std = 5 }", "sdt = 5 }", ["\"mass.m\": there is no key 'sdt'; nearest"]),
    "no model": ("[model]\n", "[study]\n", ["[model]: the table is missing: say where"]),
    "no time": ('time = "time_s"\n', "", ["[records]: the key 'time' is missing"]),
    "no identify": ('identify = ["a*.csv"]\n', "", ["[records]: the key 'identify' is missing"]),
    "identify empty": ('["a*.csv"]', "[]", ["[records] identify: is empty"]),
    "wrong kind": ("std = 5 }", 'std = "five" }', ["\"mass.m\", std: must be a number, and is 'five'"]),
    "truth for number": ("std = 5 }", "std = true }", ["std: must be a number, and is True"]),
    "number for entry": ("{ std = 50.0, min = 0.0 }", "50.0", ['"friction.viscous": must be a table']),
    "not finite": ("std = 5 }", "std = nan }", ["std: must be finite"]),
    "no spread": ("std = 5 }", "std = 0.0 }", ["std: must be above zero: leave an exact parameter out"]),
    "crossed bounds": ("min = 0.0 }", "min = 2.0, max = 1.0 }", ["min = 2 must be below max = 1"]),
    "outside bounds": ("std = 5 }", "max = 90.0 }", ["value = 95 lies outside min and max"]),
    "negative noise": ("noise = 1e-6", "noise = -1.0", ['"carriage.position", noise: must be above zero']),
    "time as output": ('"motor_force_N"', '"time_s"', ["column 'time_s' is the time column"]),
    "input is output": ('"position_ref_m"', '"position_mm"', ["which would be compared with itself"]),
    "default of an output": ('"motor_force_N" }', '"motor_force_N", default = 0.0 }', ["default: is for inputs"]),
    "held output": ('"motor_force_N" }', '"motor_force_N", interpolation = "hold" }', ["interpolation: is for inputs"]),
    "column twice": ('"motor_force_N"', '"position_mm"', ["is used for 'motor.force' already"]),
    "name twice": ('"reference.position" =', '"motor.force" =', ["is an output as well"]),
    "no such recording": ('"a*.csv"', '"a3.csv"', ["'a3.csv': there is no such file; nearest: 'a"]),
    "empty pattern": ('"a*.csv"', '"c*.csv"', ["no file matches the pattern 'c*.csv'"]),
    "folder": ('"held_out/b.csv"', '"held_out"', ["a pattern such as 'held_out/*.csv'"]),
    "unset variable": ('"a*.csv"', '"$NO_SUCH_PLACE/a.csv"', ["variable NO_SUCH_PLACE is not set"]),
    "shared file": ('"held_out/b.csv"', '"held_out/../a1.csv"', ["'a1.csv' is in identify as well"]),
    "no builder file": ("axis.py:build", "axes.py:build", ["no file 'axes.py' beside", "nearest: 'axis.py'"]),
    "no builder name": ("axis.py:build", "axis.py", ['must be "file.py:name" or "package.module:name"']),
    "backward window": ("time =", "start = 3.0\nstop = 1.0\ntime =", ["start = 3 s must come before stop"]),
    "no decimation": ("time =", "decimate = 0\ntime =", ["decimate = 0 must be a whole number, 1 or more"]),
    "half decimation": ("time =", "decimate = 2.5\ntime =", ["decimate: must be a whole number, and is 2.5"]),
    "misspelt choice": ("time =", 'gaps = "splt"\ntime =', ['must be one of "refuse"', "nearest: 'split'"]),
    "rate of zero": ("time =", "resample = 0.0\ntime =", ["[records] resample: must be above zero"]),
    "residual": ("[uncertain]", '[study]\nresidual = "simulate"\n[uncertain]', ["nearest: 'simulation'"]),
    "level": ("[uncertain]", "[study]\nlevel = 2.0\n[uncertain]", ["level: 2 must lie between 0 and 0.5"]),
    "seed": ("[uncertain]", "[study]\nseed = -1\n[uncertain]", ["seed: must not be negative"]),
    "offset": ("[uncertain]", '[offsets]\noutputs = ["motor.forc"]\n[uncertain]', ["nearest: 'motor.force'"]),
    "initial": (
        "[uncertain]",
        '[initial]\nx = "measure"\n[uncertain]',
        ["'measure' is no input or output of the study", "nearest: 'measured'"],
    ),
    "nothing to find": ("[uncertain]", "[candidates]\ninclude = []\n[uncertain]", ["nothing could be found"]),
    "not TOML": ('"time_s"', "time_s", ["is not valid TOML", "line 18"]),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_study_is_refused_and_named(folder, kind):
    old, new, words = BROKEN[kind]
    assert old in SOUND
    message = "\n".join(faults(folder, SOUND.replace(old, new, 1)))
    assert message.startswith("study.toml")
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("after", "added", "fault"),
    [
        ("[records]", 'time_zone = "Europe/Berlim"', "time_zone: there is no time zone 'Europe/Berlim'"),
        ("[records]", 'time_format = "dd/mm/yyyy"', "time_format: 'dd/mm/yyyy' must name the parts of a date"),
        ("[records]", 'time_format = "%Q"', "time_format: '%Q' must name the parts of a date"),
        ("[records]", 'time_unit = "kg"', "time_unit: 'kg' is no unit of time; name one such as"),
        ("[records]", "skip_rows = -1", "skip_rows: is -1, and must not be negative"),
        ("", '[clocks]\n"c*.csv" = { offset = 0.5 }', '"c*.csv": fits the name of no recording; nearest: '),
        ("", '[initial]\nfree = ["a", "b", "a"]', "free: 'a' is named more than once"),
        ("", '[offsets]\noutputs = ["motor.force", "motor.force"]', "outputs: 'motor.force' is named more than once"),
    ],
)
def test_what_would_change_nothing_is_refused(folder, after, added, fault):
    text = SOUND.replace(after, f"{after}\n{added}") if after else f"{SOUND}\n{added}\n"
    (found,) = faults(folder, text)
    assert fault in found


def test_one_error_lists_all_faults(folder):
    text = SOUND.replace("std = 5 }", "std = -5, valu = 3 }").replace("axis.py", "axes.py").replace("a*", "c*")
    found = faults(folder, text.replace("noise = 1e-6", "noise = 0.0"))
    assert len(found) == 5
    keys = [
        '"mass.m": there is no key',
        '"mass.m", std',
        "[model] build",
        "[records] identify",
        "noise: must",
    ]
    for key in keys:
        assert any(key in fault for fault in found), key


def test_missing_study_names_the_nearest(folder):
    study(folder)
    with pytest.raises(StudyError, match=r"no such study file; nearest: 'study.toml'"):
        read_study(folder / "studi.toml")


def test_nothing_held_out_is_a_warning(folder):
    read = study(folder, SOUND.replace('validate = ["held_out/b.csv"]', ""))
    assert "nothing is held out" in read.warnings[0]
    twice = study(folder, SOUND.replace('["a*.csv"]', '["a*.csv", "a1.csv"]'))
    assert "'a1.csv' is named twice and read once" in twice.warnings[0]
    assert len(twice.identify) == 2


def test_places_may_come_from_the_environment(folder, monkeypatch):
    monkeypatch.setenv("RIG_DATA", str(folder / "held_out"))
    read = study(folder, SOUND.replace("held_out/b.csv", "${RIG_DATA}/b.csv"))
    assert read.validate == (folder / "held_out/b.csv",)


def test_places_may_have_a_default(folder, monkeypatch):
    text = SOUND.replace("held_out/b.csv", "${RIG_DATA:-held_out}/b.csv")
    monkeypatch.delenv("RIG_DATA", raising=False)
    assert study(folder, text).validate == (folder / "held_out/b.csv",)
    monkeypatch.setenv("RIG_DATA", "")
    assert study(folder, text).validate == (folder / "held_out/b.csv",)
    monkeypatch.setenv("RIG_DATA", str(folder / "elsewhere"))
    assert "b.csv': there is no such file; its folder is missing or empty" in "\n".join(faults(folder, text))


PULSE = SOUND.replace(
    "[outputs]", '"added.pulse" = { column = "pulse_V", default = 0.5, interpolation = "hold" }\n[outputs]'
)


def test_an_input_may_be_missing_in_some_recordings(folder):
    rows = recording(3).splitlines()
    with_pulse = [f"{row},{k % 2}" if k else f"{row},pulse_V" for k, row in enumerate(rows)]
    (folder / "held_out/b.csv").write_text("\n".join(with_pulse) + "\n")
    read = study(folder, PULSE)
    assert read.inputs["added.pulse"].interpolation == "hold"
    records = read.read_records({"added.pulse": "V"})
    for record in records.identify:
        assert set(record.signals["added.pulse"].values) == {0.5}
        assert "pulse_V: not in the file, taken as 0.5 throughout" in record.log
    (held,) = records.validate
    assert set(held.signals["added.pulse"].values) == {0.0, 1.0}


def test_an_input_that_is_in_no_recording_is_refused(folder):
    with pytest.raises(RecordError, match="no recording has the column 'pulse_V'"):
        study(folder, PULSE).read_records()


def test_builder_is_called_with_its_arguments(folder):
    path = list(sys.path)
    assert load_model(study(folder), dict) == {"travel": 0.25, "gain": 7.0}
    assert sys.path == path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("travel = 0.25", "travle = 0.25", "takes no argument 'travle'; nearest: 'travel'"),
        ("travel = 0.25", "stroke = 0.25", "needs the argument 'travel'"),
        ("py:build", "py:buidl", "'axis.py' has no 'buidl'; nearest: 'build'"),
        ("py:build", "py:NOT_A_FUNCTION", "is int and not callable"),
        ("py:build", "py:fails", "axis.py, line 10, in fails: ZeroDivisionError: "),
        ("py:build", "py:forgets", "got None: does it end with 'return model'"),
        ("axis.py:build", "no_such_package.rig:build", "there is no module 'no_such_package.rig'"),
    ],
)
def test_builder_faults_name_the_users_file(folder, old, new, message):
    with pytest.raises(StudyError) as refused:
        load_model(study(folder, SOUND.replace(old, new)))
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def build(travel:\n    pass\n", "axis.py, line 1: SyntaxError"),
        ("import no_such_thing\n", "axis.py, line 1, in <module>: ModuleNotFoundError"),
        ("x = 1\ny = [][x]\n", "axis.py, line 2, in <module>: IndexError"),
        (
            "def build(travel):\n    return inner()\ndef inner():\n    raise KeyError('k')\n",
            "line 4, in inner: KeyError",
        ),
    ],
)
def test_errors_inside_the_users_file_are_named_with_their_line(folder, source, message):
    (folder / "axis.py").write_text(source)
    with pytest.raises(StudyError) as refused:
        load_model(study(folder))
    assert message in str(refused.value)


def test_two_studies_may_both_have_an_axis(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    (other / "axis.py").write_text("def build(travel):\n    return 'other'\n")
    for name in ("a1.csv", "b.csv"):
        (other / name).write_text(recording(len(name)) if name == "a1.csv" else recording(9))
    text = SOUND.replace("held_out/b.csv", "b.csv")
    assert load_model(study(folder))["gain"] == 7.0
    assert load_model(study(other, text)) == "other"
    assert load_model(study(folder))["gain"] == 7.0


def test_names_and_units_are_checked_against_the_model(folder):
    text = SOUND.replace('column = "motor_force_N"', 'column = "motor_force_N", unit = "V"')
    text += '[initial]\nfree = ["carriage.sped"]\n"carriage.speed" = "measured"\n'
    found = check_names(
        study(folder, text),
        parameters={"mass.m": "kg", "friction.viscos": "N*s/m"},
        inputs=["reference.speed"],
        outputs={"motor.force": "N", "carriage.speed": "m/s"},
        states={"carriage.position": "m", "carriage.speed": "m/s"},
    )
    assert len(found) == 6
    message = "\n".join(found)
    assert "[uncertain]: the model has no parameter 'friction.viscous'; nearest: 'friction.viscos'" in message
    assert "[inputs]: the model has no input 'reference.position'; nearest: 'reference.speed'" in message
    assert "[outputs]: the model has no output 'carriage.position'; it is a state of the model" in message
    assert "no state 'carriage.sped'; nearest: 'carriage.speed'" in message
    assert '"carriage.speed": "measured" needs an output of this name' in message
    assert "[outputs] \"motor.force\", unit: 'V' cannot be converted to 'N'" in message


def test_names_that_fit_have_no_faults(folder):
    names = ({"mass.m": "kg", "friction.viscous": "N*s/m"}, ["reference.position"])
    assert check_names(study(folder), *names, {"motor.force": "N", "carriage.position": "m"}, []) == ()
