"""A run that is killed, meets a full disk, or meets another run loses and mixes nothing (`benchmarks/faults.py`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from multibody.base.out_of_memory import memory_used_up
from multibody.base.result_folder import written_together
from vtsdt.cli import command_line

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the faults are tried on a forked process")
def test_a_run_that_is_killed_loses_nothing() -> None:
    """In a process of its own, because one that has threads may not fork."""
    command = [sys.executable, str(ROOT / "benchmarks" / "faults.py"), "--only", "killed", "--count", "1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| killed | 1 | 1 |" in done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="no lock on folders there")
def test_two_runs_on_one_folder_write_one_after_the_other(tmp_path: Path) -> None:
    """The draft of a run that is still at work is not taken for one that a killed run has left."""
    begun, go, order = threading.Event(), threading.Event(), []

    def write(run: str) -> None:
        with written_together(tmp_path, "diagnosis", "axis", run) as draft:
            order.append(f"{run} begins")
            begun.set()
            go.wait(60.0)
            (draft / "a.json").write_text(f'{{"of": "{run}"}}')
            order.append(f"{run} ends")

    first, second = (threading.Thread(target=write, args=(run,)) for run in ("1", "2"))
    first.start()
    begun.wait(60.0)
    second.start()
    second.join(0.2)  # long enough to begin, if it did not wait
    go.set()
    for thread in (first, second):
        thread.join(60.0)
    assert order == ["1 begins", "1 ends", "2 begins", "2 ends"]
    assert json.loads((tmp_path / "a.json").read_text()) == {"run": "2", "of": "2"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "run.json"]


def caused(error: Exception, cause: Exception) -> Exception:
    try:
        raise error from cause
    except type(error) as raised:
        return raised


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (MemoryError(), True),
        (OSError(12, "Cannot allocate memory"), True),
        (ImportError("x.so: failed to map segment from shared object"), True),
        (caused(ValueError("unknown unit 'N'"), MemoryError()), True),
        (caused(ValueError("unknown unit 'N'"), KeyError()), False),
        (ImportError("no module named 'x'"), False),
        (KeyError("a"), False),
    ],
)
def test_what_a_lack_of_memory_looks_like(error: Exception, expected: bool) -> None:
    assert memory_used_up(error) is expected


def out_of_memory(*_: object, **__: object) -> None:
    raise MemoryError


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of the address space there")
def test_no_memory_to_ask_for_memory_is_a_lack_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("multibody.base.out_of_memory.address_space_limit", lambda: 1 << 40)
    assert not memory_used_up(KeyError("a"))
    monkeypatch.setattr(Path, "read_text", out_of_memory)
    assert memory_used_up(KeyError("a"))


def test_a_lack_of_memory_is_told_with_the_limit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command_line, "_dispatch", out_of_memory)
    monkeypatch.setattr(command_line, "address_space_limit", lambda: 328 << 20)
    assert command_line.main(["diagnose"]) == 2
    assert "limited to 0.32 GiB (ulimit -v), and the smallest diagnosis takes about 2.1 GiB" in capsys.readouterr().err
    monkeypatch.setattr(command_line, "_message", out_of_memory)
    assert command_line.main(["diagnose"]) == 2
    assert "memory that this process may have is used up" in capsys.readouterr().err
