"""The command line: help everywhere, exit codes, one message for bad input, and a light start."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from multibody.base.compile_events import tell
from multibody.base.progress import ProgressLine, Step
from vtsdt.cli import command_line as cli
from vtsdt.cli.commands import COMMANDS, Command

STUDY = """
[model]
build = "axis.py:build"
[inputs]
"reference.position" = "ref_m"
[outputs]
"motor.torque" = "torque_Nm"
[records]
time = "time_s"
identify = ["a.csv"]
"""
MODEL = "from multibody import Model\ndef build():\n    return Model('empty')\n"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command in an empty folder; return exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def go(*words: str) -> tuple[int, str, str]:
        code = cli.main(words)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return go


@pytest.mark.parametrize(
    "words",
    [[], ["bench"], ["validate"], *map(list, COMMANDS)],
    ids=" ".join,
)
def test_every_command_has_help(run: Run, words: list[str]) -> None:
    code, out, err = run(*words, "--help")
    assert (code, err) == (0, "")
    assert out.startswith("usage: vtsdt")


def test_help_names_every_command(run: Run) -> None:
    _, out, _ = run("--help")
    for words in COMMANDS:
        assert words[0] in out


def test_help_is_light() -> None:
    code = (
        "import sys, vtsdt.cli.command_line; code = vtsdt.cli.command_line.main(['--help']); "
        "names = 'numpy numba scipy pandas pint rich matplotlib'.split(); "
        "heavy = [m for m in names if m in sys.modules]; "
        "print(code, heavy)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"


def test_module_is_the_same_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "vtsdt", "bench", "axis", "--list"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["KIND", "WHERE", "USUAL", "SIZE"]
    assert any(line.split()[:2] == ["stribeck_friction", "guide"] for line in lines)
    assert any(line.split()[:2] == ["unknown_force", "coupling"] for line in lines)


def test_no_command_is_bad_input_and_shows_help(run: Run) -> None:
    code, out, _ = run()
    assert code == 2
    assert "diagnose" in out


def test_bench_axis_writes_a_study(run: Run, tmp_path: Path) -> None:
    code, out, err = run("bench", "axis", "--out", "new/axis", "--trips", "2", "--seed", "3")
    assert code == 0
    assert [line for line in err.splitlines() if " s  " not in line] == []  # a slow machine reports its progress
    assert "next: vtsdt diagnose" in out
    assert "synthetic" in out
    written = {p.name for p in (tmp_path / "new" / "axis").iterdir()}
    assert written == {
        "README.md",
        "axis.py",
        "identify_01.csv.gz",
        "study.toml",
        "truth.json",
        "validate_01.csv.gz",
    }


def test_the_catalogue_of_a_study_is_listed(run: Run, tmp_path: Path) -> None:
    run("bench", "axis", "--out", "o", "--trips", "2", "--quiet")
    study = tmp_path / "o/study.toml"
    study.write_text(study.read_text().replace("[records]", '[candidates]\ninclude = ["*friction@guide"]\n[records]'))
    code, out, err = run("catalogue", "o/study.toml")
    assert (code, err) == (0, "")
    assert "coulomb_friction" in out
    assert "left out at" in out
    code, out, err = run("catalogue", "o/study.toml", "--names")
    assert "coulomb_friction@guide" in out.splitlines()
    assert all(name.endswith("friction@guide") for name in out.splitlines())
    study.write_text(study.read_text().replace("*friction@guide", "coulomb"))
    code, out, err = run("catalogue", "o/study.toml")
    assert (code, out) == (2, "")
    assert "nearest: 'coulomb_friction'" in err


def test_what_a_study_lacks_is_bad_input(run: Run, tmp_path: Path) -> None:
    import gzip

    run("bench", "axis", "--out", "o", "--trips", "2", "--quiet")
    study = tmp_path / "o/study.toml"
    sound = study.read_text()
    rows = gzip.decompress((tmp_path / "o/identify_01.csv.gz").read_bytes()).decode().splitlines()
    (tmp_path / "o/four.csv").write_text("\n".join(rows[:5]) + "\n")
    study.write_text(sound.replace("identify_01.csv.gz", "four.csv"))
    code, _, err = run("diagnose", "o/study.toml", "--out", "d")
    assert code == 2
    assert "'four.csv' (four): has 4 rows, at least 8 are needed" in err
    study.write_text(sound.replace('"reference.position" = "position_ref_mm"', ""))
    code, _, err = run("diagnose", "o/study.toml", "--out", "d")
    assert code == 2
    assert 'add "reference.position" = "column" to [inputs]' in err


def test_quiet_prints_nothing(run: Run) -> None:
    assert run("bench", "axis", "--out", "o", "--trips", "2", "--quiet") == (0, "", "")


BAD = {
    "unknown command": (["diagnos"], "did you mean 'diagnose'?"),
    "unknown machine": (["bench", "axle"], "did you mean 'axis'?"),
    "misspelt option": (["diagnose", "study.toml", "--oot", "o"], "there is no option '--oot'; nearest: '--out'"),
    "misspelt option of a bench": (
        ["bench", "axis", "--out", "o", "--hyde=x"],
        "no option '--hyde'; nearest: '--hide'",
    ),
    "unknown option": (["bench", "axis", "--out", "o", "--hid", "x", "--sede", "1"], "--sede"),
    "missing study": (
        ["diagnose", "nothing.toml", "--out", "o"],
        "nothing.toml: there is no such study file",
    ),
    "study without out": (["diagnose", "study.toml"], "--out"),
    "out is a file": (["diagnose", "study.toml", "--out", "taken"], "--out taken: is a file: name a folder"),
    "out below a file": (["compare", "study.toml", "--out", "taken/below"], "nothing can be written into"),
    "broken toml": (["compare", "broken.toml", "--out", "o"], "broken.toml: is not valid TOML"),
    "missing record": (["diagnose", "study.toml", "--out", "o"], "a.csv"),
    "bad seed": (
        ["bench", "axis", "--out", "o", "--seed", "-1"],
        "'-1' is no seed: give a whole number, 0 or more",
    ),
    "seed in words": (["diagnose", "study.toml", "--out", "o", "--seed", "seven"], "'seven' is no seed"),
    "bad max-effects": (
        ["diagnose", "study.toml", "--out", "o", "--max-effects", "1.5"],
        "'1.5' is no number of effects",
    ),
    "one trip": (["bench", "axis", "--out", "o", "--trips", "1"], "'1' is no number of trips"),
    "many trips": (["bench", "axis", "--out", "o", "--trips", "100"], "trips is 100: give 2 to 99"),
    "no strength": (
        ["bench", "axis", "--out", "o", "--strength", "0"],
        "'0' is no factor: give a number above zero",
    ),
    "infinite force": (["bench", "axis", "--out", "o", "--disturbance", "inf"], "'inf' is no force"),
    "bench without out": (["bench", "axis"], "--out DIR is missing"),
    "bench into a file": (["bench", "axis", "--out", "taken"], "--out taken: is a file"),
    "unknown kind": (
        ["bench", "axis", "--out", "o", "--hide", "coulom_friction"],
        "did you mean 'coulomb_friction'?",
    ),
    "kind at the wrong place": (
        ["bench", "axis", "--out", "o", "--hide", "backlash@guide"],
        "backlash fits coupling",
    ),
    "unknown place": (["bench", "axis", "--out", "o", "--hide", "slip@coupler"], "there is no such place"),
    "unknown over": (
        ["bench", "axis", "--out", "o", "--hide", "unknown_force", "--unknown-over", "load"],
        "position, speed, time",
    ),
}


@pytest.mark.parametrize(("words", "says"), BAD.values(), ids=BAD)
def test_bad_input_gives_one_message_and_no_traceback(run: Run, tmp_path: Path, words: list[str], says: str) -> None:
    (tmp_path / "taken").write_text("x")
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "axis.py").write_text(MODEL)
    (tmp_path / "broken.toml").write_text("[model\n")
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert says in err
    assert err.startswith("vtsdt: ")
    assert "Traceback" not in err
    assert not (tmp_path / "o").exists()


def test_debug_shows_the_traceback(run: Run) -> None:
    code, _, err = run("diagnose", "nothing.toml", "--out", "o", "--debug")
    assert code == 2
    assert "Traceback" in err
    assert "StudyError" in err


def test_debug_may_stand_first(run: Run) -> None:
    assert "Traceback" in run("--debug", "diagnose", "nothing.toml", "--out", "o")[2]


def test_a_folder_that_cannot_be_written(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "locked").mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    code, _, err = run("bench", "axis", "--out", "locked/new")
    assert code == 2
    assert "nothing can be written into" in err


def _raising(error: BaseException) -> Callable[..., int]:
    def work(args: object) -> int:
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (
            ZeroDivisionError("division by zero"),
            1,
            "a fault in the program: ZeroDivisionError: division by zero",
        ),
        (KeyError("x"), 1, "run the same command with --debug"),
        (
            FileNotFoundError(2, "No such file or directory", "gone.csv"),
            2,
            "gone.csv: No such file or directory",
        ),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
    ids=lambda each: type(each).__name__ if isinstance(each, BaseException) else None,
)
def test_exit_codes_of_what_is_raised(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, says: str
) -> None:
    monkeypatch.setattr(Command, "function", lambda command, name: _raising(error))
    got, _, err = run("diagnose", "study.toml", "--out", "o")
    assert got == code
    assert says in err
    assert "Traceback" not in err


def test_classes_of_bad_input_exist() -> None:
    import importlib

    for module, names in cli.BAD_INPUT.items():
        for name in names.split():
            assert issubclass(getattr(importlib.import_module(module), name), Exception)


def test_study_commands_hand_their_arguments_over(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    import discrepancy.study.command as commands

    seen: dict[str, dict[str, object]] = {}
    for name in ("diagnose", "compare"):
        monkeypatch.setattr(commands, name, lambda args, name=name: seen.update({name: vars(args)}) or 0)
    assert run("diagnose", "s.toml", "--out", "o", "--seed", "4", "--max-effects", "2", "--quiet")[0] == 0
    assert isinstance(seen["diagnose"].pop("progress"), ProgressLine)
    assert seen["diagnose"] == {
        "study": "s.toml",
        "out": "o",
        "seed": 4,
        "max_effects": 2,
        "resume": False,
        "json": False,
        "quiet": True,
        "debug": False,
    }
    assert run("compare", "s.toml", "--out", "o")[0] == 0
    assert (seen["compare"]["study"], seen["compare"]["seed"], seen["compare"]["quiet"]) == ("s.toml", None, False)


def test_a_command_gets_the_words_after_its_own(run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "rig_of_test.py").write_text("def main(arguments):\n    print(arguments)\n    return 7\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(COMMANDS, ("bench", "lift"), Command("rig_of_test:main", "a rig"))
    code, out, _ = run("bench", "lift", "--hide", "x", "--out", "o")
    assert (code, out.strip()) == (7, "['--hide', 'x', '--out', 'o']")


@pytest.mark.parametrize("target", ["vtsdt.no_such_module:main", "vtsdt.files.parameters:main"])
def test_a_command_that_is_not_installed_says_so(run: Run, monkeypatch: pytest.MonkeyPatch, target: str) -> None:
    monkeypatch.setitem(COMMANDS, ("align",), Command(target, "alignment"))
    code, _, err = run("align", "--out", "o")
    assert code == 2
    assert "vtsdt align is not available" in err
    assert run("align", "--help")[0] == 0


def test_version(run: Run) -> None:
    code, out, _ = run("--version")
    assert code == 0
    assert out.startswith("vtsdt 0.")


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["diagnose", "--help"]])
def test_output_into_a_closed_pipe_is_no_error(words: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "vtsdt", *words]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    try:
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False, env=buffered)
    finally:
        os.close(writing)
    assert done.returncode == 0
    assert done.stderr == ""


def test_progress_waits_before_it_writes_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressLine() as progress:
        progress("at once")
        progress._start -= 10.0
        progress("later")
    assert [line.split("s  ")[1] for line in capsys.readouterr().err.splitlines()] == ["later"]


def test_progress_folds_compilations_and_estimates_what_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressLine() as progress:
        progress._start -= 10.0
        for name in ("rhs", "outputs", "rhs_tangent"):
            tell(name, None)
            tell(name, 0.5)
        progress(Step("trip 1 of 4", 0, 4))
        progress._counted = (4, progress._counted[1] - 3.0, 0)  # as if the first had taken three seconds
        progress._printed = (float("-inf"), "")
        progress(Step("trip 2 of 4", 1, 4))
    lines = [line.split("s  ", 1)[1] for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        "compile the model's equations (once on this machine)",
        "trip 1 of 4",
        "trip 2 of 4 (about 9 s left)",
    ]


def _completed(line: str) -> list[str]:
    """What the shell is offered at the end of a line."""
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_SHELL": "fish",
        "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
    }
    with tempfile.TemporaryFile("w+") as answer:
        code = (
            f"import os, sys; os.dup2({answer.fileno()}, 8); import vtsdt.cli.command_line as c; sys.exit(c.main([]))"
        )
        subprocess.run(
            [sys.executable, "-c", code], env=environment, pass_fds=[answer.fileno()], capture_output=True, check=True
        )
        answer.seek(0)
        return [word.split("\t")[0].strip() for word in answer.read().split("\n") if word.strip()]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("vtsdt dia", ["diagnose"]),
        ("vtsdt bench a", ["axis"]),
        ("vtsdt diagnose --max", ["--max-effects"]),
        ("vtsdt bench gear --fau", ["--faults"]),
        ("vtsdt what-if --direction d", ["down"]),
    ],
)
def test_shells_complete_commands_options_and_choices(line: str, offered: list[str]) -> None:
    assert _completed(line) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_call_vtsdt(run: Run, shell: str) -> None:
    code, out, _ = run("completion", shell)
    assert code == 0
    assert "vtsdt" in out
    assert "_ARGCOMPLETE" in out


def _on_a_terminal(body: str, width: int = 80) -> str:
    """Return what a terminal is sent while a `ProgressLine` called ``p`` is used."""
    import pty

    main, other = pty.openpty()
    lines = "\n".join(f"    {line}" for line in body.splitlines())
    subprocess.run(
        [
            sys.executable,
            "-c",
            f"from multibody.base.progress import *\nwith ProgressLine() as p:\n{lines}\nprint('done')\n",
        ],
        stdout=other,
        stderr=other,
        check=True,
        env={**os.environ, "TERM": "xterm", "COLUMNS": str(width)},
    )
    os.close(other)
    shown = os.read(main, 10_000).decode()
    os.close(main)
    return shown


def test_progress_on_a_terminal_is_taken_away_again() -> None:
    shown = _on_a_terminal("p('working')")
    assert "working" in shown
    assert shown.rindex("\x1b[2K") > shown.rindex("working")
    assert shown.rstrip().endswith("done")


@pytest.mark.parametrize("text", ["p('long ' * 40)", "p(Step('long ' * 40, 1, 4))"])
def test_progress_on_a_terminal_is_one_line_with_its_time(text: str) -> None:
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", _on_a_terminal(text))
    lines = [part.strip() for part in re.split(r"[\r\n]+", shown) if "so far" in part or "long" in part]
    assert lines
    for line in lines:
        assert re.search(r"long …  \d+ s so far$", line), line
        assert len(line) <= 80
