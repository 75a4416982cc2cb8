"""A run that is killed, meets a full disk, or meets another run loses and mixes nothing (`benchmarks/faults.py`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from multibody.base import units
from multibody.base.memory_of_process import container_limit
from multibody.base.out_of_memory import memory_used_up
from multibody.base.result_folder import written_together
from vtsdt.cli import command_line, least_memory

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
    assert "limited to 0.32 GiB (ulimit -v), and the smallest diagnosis takes about 1.25 GiB" in capsys.readouterr().err
    monkeypatch.setattr(command_line, "_message", out_of_memory)
    assert command_line.main(["diagnose"]) == 2
    assert "memory that this process may have is used up" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit the address space, or do not say")
@pytest.mark.parametrize("command", ["diagnose", "compare"])
def test_too_little_address_space_is_told_before_work_begins(tmp_path: Path, command: str) -> None:
    """In a process of its own: with less, libraries in C end it without a word."""
    script = (
        "import resource, sys; from vtsdt.cli.command_line import main; "
        "resource.setrlimit(resource.RLIMIT_AS, (600 << 20, 600 << 20)); "
        "code = main(sys.argv[1:]); print(sum(n in sys.modules for n in ('numpy', 'numba'))); sys.exit(code)"
    )
    words = [command, str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert done.stdout == "0\n"  # nothing heavy was loaded
    assert "limited to 0.586 GiB, and the smallest diagnosis takes about 1.25 GiB of it: raise it" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_container_that_is_too_small_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(least_memory, "container_limit", lambda: 128 << 20)
    assert command_line.main(["diagnose", "study.toml", "--out", str(tmp_path / "out")]) == 2
    assert "the memory of this container is limited to 0.125 GiB" in capsys.readouterr().err
    monkeypatch.setattr(least_memory, "container_limit", lambda: 512 << 20)
    assert command_line.main(["diagnose", "study.toml", "--out", str(tmp_path / "out")]) == 2
    assert "study.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("group", "limits", "expected"),
    [
        ("0::/", {"memory.max": "1000"}, 1000),
        ("0::/a/b", {"a/memory.max": "1000", "a/b/memory.max": "max"}, 1000),
        ("0::/a/b", {"a/memory.max": "1000", "a/b/memory.max": "400"}, 400),
        ("4:memory:/of/the/host", {"memory/memory.limit_in_bytes": "1000"}, 1000),
        ("4:cpu,memory:/a", {"memory/memory.limit_in_bytes": "9223372036854771712"}, None),
        ("4:cpu:/a", {"memory/memory.limit_in_bytes": "1000"}, None),
        ("0::/", {"memory.max": "max"}, None),
        ("", {}, None),
    ],
)
def test_the_limit_of_a_container(tmp_path: Path, group: str, limits: dict[str, str], expected: int | None) -> None:
    """As version 2 and 1 of control groups tell it; a group is limited by those that it is in."""
    (tmp_path / "proc/self").mkdir(parents=True)
    (tmp_path / "proc/self/cgroup").write_text(f"{group}\n")
    for name, text in limits.items():
        path = tmp_path / "sys/fs/cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")
    assert container_limit(tmp_path) == expected


def test_units_that_cannot_be_loaded_are_no_fault_of_the_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pint says of a lack of memory that its definitions are wrong."""
    import pint

    def without_memory(*_: object, **__: object) -> None:
        raise pint.DefinitionSyntaxError("default_en.txt")  # a ValueError

    units._registry.cache_clear()
    units._unit.cache_clear()
    monkeypatch.setattr(pint, "UnitRegistry", without_memory)
    with pytest.raises(RuntimeError, match="definitions of units cannot be read") as raised:
        units.convert(1.0, "furlong", "m")
    assert not memory_used_up(raised.value)
    monkeypatch.setattr("multibody.base.out_of_memory.address_space_limit", lambda: 1)
    assert memory_used_up(raised.value)
