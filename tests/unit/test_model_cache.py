"""Compiled models across processes: found again, never stale, safe side by side, and where they are kept."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

MACHINE = """
from multibody import Component, Model, Output, Parameter, Translation
from multibody.library import Mass

FACTOR = 1.0


def law(x, k):
    return FACTOR * k * x


class Cushion(Component):
    k = Parameter(3.0, "N/m", "stiffness")
    flange = Translation("end")
    y = Output("N", "force")

    def equations(self):
        self.y = law(self.flange.position, self.k)
        self.flange.force = -self.y


def machine(m=1.0, k=3.0, name="m"):
    model = Model(name)
    body, part = model.add("body", Mass(m=m, position=1.0)), model.add("part", Cushion(k=k))
    model.connect(part.flange, body.flange)
    return model
"""

REPORT = """
import sys
from multibody.compile import native
seen = []
native.on_compile(lambda name, seconds: seconds is not None and seen.append(name))
from machine import machine
"""


def run(code: str, folder: Path, cache: Path, check: bool = True, **environment: str) -> str:
    env = {
        **os.environ,
        "VTSDT_CACHE": str(cache),
        "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]),
    }
    env |= environment
    text = REPORT + textwrap.dedent(code) + "\nprint('compiled', *seen)"
    done = subprocess.run([sys.executable, "-c", text], env=env, capture_output=True, text=True, cwd=folder)
    if check:
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()
    return done.stdout + done.stderr


def compiled(answer: str) -> list[str]:
    return answer.splitlines()[-1].split()[1:]


ONCE = "s = machine().build(); print(s.rhs(0.0, s.start)[1])"
ALL = "s = machine().build(); s.rhs(0.0, s.start); s.outputs_at(0.0, s.start)"


@pytest.fixture(scope="module")
def warm(tmp_path_factory) -> Path:
    """A folder with the machine and a cache in which one process has compiled it."""
    folder = tmp_path_factory.mktemp("warm")
    (folder / "machine.py").write_text(MACHINE)
    # rates and outputs, each in a file of its own with the function that both call;
    assert compiled(run(ALL, folder, folder / "cache")) == ["rhs", "outputs"]
    return folder


def test_second_process_compiles_nothing_whatever_values_and_name(warm):
    code = """
        for k in range(3):
            s = machine(m=2.0 + k, k=5.0 * k, name=f"other {k}").build()
            s.rhs(0.0, s.start), s.outputs_at(0.0, s.start)
    """
    assert compiled(run(code, warm, warm / "cache")) == []


def test_lines_moved_in_a_component_file_compile_nothing(warm, tmp_path):
    (tmp_path / "machine.py").write_text("# a comment that moves every line\n\n" + MACHINE)
    assert compiled(run(ALL, tmp_path, warm / "cache")) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return FACTOR * k * x", "return x * k * 2.0  #"),
        ("FACTOR = 1.0", "FACTOR = 2.0"),
        ("self.flange.force = -self.y", "self.flange.force = -2.0 * self.y"),
    ],
)
def test_an_edited_function_constant_or_equation_is_never_served_stale(warm, tmp_path, old, new):
    """Also where size and time stamp are the same, which is all that numba alone would look at."""
    text = MACHINE.replace(old, new)
    assert text != MACHINE
    (tmp_path / "machine.py").write_text(text)
    stamp = (warm / "machine.py").stat().st_mtime_ns
    os.utime(tmp_path / "machine.py", ns=(stamp, stamp))
    answer = run(ONCE, tmp_path, warm / "cache")
    assert float(answer.splitlines()[0]) == -6.0
    assert compiled(answer)[-1] == "rhs"


def test_processes_at_once_are_safe_and_compile_what_they_need(tmp_path):
    """A fresh cache, two processes: the same result in both, and nothing left to compile; outputs stay
    uncompiled.
    """
    (tmp_path / "machine.py").write_text(MACHINE)
    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(lambda _: run(ONCE, tmp_path, tmp_path / "cache"), range(2)))
    assert [a.splitlines()[0] for a in answers] == ["-3.0", "-3.0"]
    assert not any("outputs" in compiled(a) for a in answers)
    assert compiled(run(ONCE, tmp_path, tmp_path / "cache")) == []
    assert [p.name.partition("_")[0] for p in (tmp_path / "cache").glob("*.py")] == ["rhs"]


def test_unusable_cache_folder_names_the_remedy(warm, tmp_path):
    (tmp_path / "file").write_text("")
    told = run(ONCE, warm, tmp_path / "file" / "cache", check=False)
    assert "set VTSDT_CACHE to a writable folder" in told.splitlines()[-1]


def test_folder_without_permission_names_the_remedy(tmp_path, monkeypatch):
    """Root may write anywhere, so the system's answer is stood in for."""
    from multibody.compile import native

    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda path, mode: not (str(path) == str(tmp_path) and mode == os.W_OK))
    with pytest.raises(OSError, match="cannot be written to: set VTSDT_CACHE to a writable folder"):
        native.cache_dir()


DERIVED = """
from multibody.equations.differentiate import Differentiator
written = []
plain = Differentiator.statements
Differentiator.statements = lambda self, nodes: written.append(1) or plain(self, nodes)
s = machine().build()
print(s.jacobian("x", 0.0, s.start).min(), "written" if written else "found")
"""


def test_derivatives_are_written_once_and_follow_an_edit(tmp_path: Path) -> None:
    folder, cache = tmp_path / "own", tmp_path / "cache"
    folder.mkdir()
    cache.mkdir()

    def answer() -> str:
        return run(DERIVED, folder, cache).splitlines()[0]

    (folder / "machine.py").write_text(MACHINE)
    assert answer() == "-3.0 written"
    assert answer() == "-3.0 found"
    (folder / "machine.py").write_text(MACHINE.replace("FACTOR = 1.0", "FACTOR = 2.0"))
    assert answer() == "-6.0 written"
    for kept in cache.glob("rhs_columns_*.txt"):
        kept.write_bytes(kept.read_bytes()[:-20])  # damaged: seen, and written anew
    assert answer() == "-6.0 written"
    assert answer() == "-6.0 found"
