"""Faults from outside while ``vtsdt diagnose`` runs, and the rule by which what it leaves behind is judged.

Each fault meets a diagnosis of a small study, in a process of its own, on a folder that holds the results of an earlier
run.  A fault is **survived** if

- the files that ``run.json`` lists are whole: all of the earlier run, or all of the new one, never some of each;
- the program itself ends with exit code 0, or with 2 and a message that names the fault and what to do.  A killed
  process says nothing, and neither does one that a library in C ends in the midst of its work because it got no
  memory;
- the same command, given again without the fault (with ``--resume`` where the run had got so far), ends with exit
  code 0 and leaves the very files that it leaves when nothing happens, to the last byte, and no draft.  In
  ``history.json`` the steps, and what was before each, are not compared: a search that is continued is one step more.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))

from broken_inputs import MODEL, STUDY, csv, rows, toml

from multibody.base.units import same_dimension

KINDS = ("killed", "disk full", "memory limit", "two at once", "clock jump")
EARLIER = 2  # seed of the results that the folder holds
MOST_SECONDS = 600.0  # of waiting for one process, which takes a few on a machine with nothing else to do

#: What a run imports on its way: a third of its processor time.
LOADED = (
    "discrepancy.study.command", "discrepancy.problem.model", "discrepancy.evidence.search", "discrepancy.report.write",
    "discrepancy.residual.residual_mode", "estimation.files.read_csv", "estimation.files.read_records",
    "estimation.signals.preparation", "gearbox.stage.effects", "multibody.compile",
    "numba", "pint", "jinja2", "pandas", "numexpr", "pyarrow.csv", "scipy.signal", "scipy.optimize", "scipy.stats",
    "scipy.ndimage", "matplotlib.figure", "matplotlib.backends.backend_agg", "matplotlib.layout_engine",
    "matplotlib.colors", "PIL.PngImagePlugin",
)  # fmt: skip

Prepare = Callable[[], None]


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What every fault is tried on.

    Parameters
    ----------
    study : Path
    earlier, expected : Path
        Folders of results: of the earlier run, and of the run when nothing happens.
    seconds : float
        That the run took, s.
    """

    study: Path
    earlier: Path
    expected: Path
    seconds: float


def prepare(folder: Path) -> Bench:
    """Write the study, and run it twice."""
    for module in LOADED:
        importlib.import_module(module)  # once, and not again in every process
    same_dimension("m", "mm")  # which reads the table of units
    importlib.import_module("numba").njit(lambda: 0)()  # which loads what numba itself is made of
    folder.mkdir(parents=True, exist_ok=True)
    tables = {name: dict(table) for name, table in STUDY.items() if name not in ("initial", "offsets")}
    tables["outputs"] = {'"speed"': '"speed_m_per_s"'}
    tables["candidates"] = {"include": '["coulomb_friction@*"]'}
    for key in ("validate", "stop"):
        del tables["records"][key]
    (folder / "study.toml").write_text(toml(tables))
    (folder / "cart.py").write_text(MODEL)
    (folder / "a.csv").write_text(csv(rows(1)))
    study, earlier, expected = folder / "study.toml", folder / "earlier", folder / "expected"
    for out, words in ((earlier, ["--seed", str(EARLIER)]), (expected, [])):
        begun = time.monotonic()
        code, message = ended(started(study, out, words))
        if code:
            raise RuntimeError(f"the study without a fault ends with {code}: {message}")
    return Bench(study=study, earlier=earlier, expected=expected, seconds=time.monotonic() - begun)


@dataclass(frozen=True)
class Started:
    """A process, and the file of what it says."""

    process: int
    told: Path


def started(study: Path, out: Path, words: list[str] | None = None, prepare: Prepare | None = None) -> Started:
    """Start a diagnosis in a process of its own."""
    from vtsdt.cli.command_line import main

    handle, name = tempfile.mkstemp(dir=study.parent, suffix=".txt")
    os.close(handle)
    process = os.fork()
    if process:
        return Started(process, Path(name))
    code = 1
    try:
        with open(name, "w") as stream, contextlib.redirect_stderr(stream), contextlib.redirect_stdout(io.StringIO()):
            if prepare is not None:
                prepare()
            code = main(["diagnose", str(study), "--out", str(out), "--quiet", *(words or [])])
    finally:
        os._exit(code)


def ended(run: Started) -> tuple[int, str]:
    """Wait for a process, and return its exit code, that of a signal below zero, and its message."""
    until = time.monotonic() + MOST_SECONDS
    while True:
        done, status = os.waitpid(run.process, os.WNOHANG)
        if done:
            break
        if time.monotonic() > until:
            os.kill(run.process, signal.SIGKILL)
            os.waitpid(run.process, 0)
            run.told.unlink()
            return -signal.SIGALRM, f"no end within {MOST_SECONDS:g} s"
        time.sleep(0.01)
    message = run.told.read_text()
    run.told.unlink()
    return os.waitstatus_to_exitcode(status), message


# ------------------------------------------------------------------------------ the rule


def mixed(out: Path) -> str:
    """Return what is wrong with a folder of results, or nothing: every listed file is there with its hash."""
    try:
        listed = json.loads((out / "run.json").read_text())["files"]
    except (OSError, ValueError) as error:
        return f"run.json cannot be read: {error}"
    for name, digest in listed.items():
        path = out / name
        if not path.is_file():
            return f"{name} is lost"
        if hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            return f"{name} is not of the run that run.json tells of"
    return ""


def different(out: Path, expected: Path) -> str:
    """Return in which file a folder of results differs from another, or nothing."""
    one, other = (sorted(str(p.relative_to(f)) for p in f.rglob("*") if p.is_file()) for f in (out, expected))
    if one != other:
        return f"{sorted(set(one) ^ set(other))} are in one folder only"
    return next((f"{n} differs" for n in one if _content(out / n) != _content(expected / n)), "")


def _content(path: Path) -> bytes:
    if path.name != "history.json":
        return path.read_bytes()
    history = json.loads(path.read_text())
    return json.dumps({name: value for name, value in history.items() if name not in ("steps", "past")}).encode()


def repaired(bench: Bench, out: Path) -> str:
    """Give the command again, resumed where the run had got so far, and return what is wrong then, or nothing."""
    history = out / "history.json"
    words: list[str] = []
    if history.exists():
        try:
            run = json.loads(history.read_text())["fingerprint"]
        except (ValueError, KeyError) as error:
            return f"history.json is damaged: {error}"
        if run != json.loads((bench.earlier / "history.json").read_text())["fingerprint"]:
            words = ["--resume"]
    code, message = ended(started(bench.study, out, words))
    if code:
        return f"the next run {' '.join(words)} ends with {code}: {message.strip()[:300]}"
    return different(out, bench.expected)


def _between(out: Path) -> str:
    """As `mixed`, but results that were being moved into place when the process ended are not judged yet."""
    return "" if list(out.glob(".ready-*")) else mixed(out)


def _answered(code: int, message: str, *words: str) -> str:
    if code == 0 or (code == 2 and any(word in message for word in words)):
        return ""
    return f"ends with {code}: {message.strip()[:300]}"


# ------------------------------------------------------------------------------ the faults


@dataclass(frozen=True)
class Outcome:
    """What became of a run that a fault met.

    Parameters
    ----------
    wrong : str
        Why the fault was not survived, or nothing.
    code : int
        Exit code of the run, that of a signal below zero.
    """

    wrong: str
    code: int


def try_fault(kind: str, bench: Bench, rng: np.random.Generator, folder: Path) -> Outcome:
    """Let one fault meet a run, and judge by the rule.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    bench : Bench
    rng : Generator
        Decides when, or how little there is.
    folder : Path
        Made, and removed again.
    """
    out = folder / "out"
    folder.mkdir(parents=True)
    try:
        return _FAULTS[kind](bench, rng, out)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _killed(bench: Bench, rng: np.random.Generator, out: Path) -> Outcome:
    """SIGKILL at a moment that is as likely as any other of the run."""
    shutil.copytree(bench.earlier, out)
    run = started(bench.study, out)
    time.sleep(float(rng.uniform(0.0, 1.1 * bench.seconds)))
    os.kill(run.process, signal.SIGKILL)  # one that has ended is still there until it is waited for
    code, _ = ended(run)
    return Outcome(_between(out) or repaired(bench, out), code)


def _disk_full(bench: Bench, rng: np.random.Generator, out: Path) -> Outcome:
    """A disk with room for part of what a run writes: of its results, or in every second case of compiled code."""
    page = resource.getpagesize()
    earlier = page * (2 + sum(1 + p.stat().st_size // page for p in bench.earlier.rglob("*")))  # whole pages are used
    whole = sum(p.stat().st_size for p in bench.expected.rglob("*"))
    cache = bool(rng.integers(2))
    room = int(rng.uniform(0.0, 2e5)) if cache else earlier + int(rng.uniform(0.0, 1.1 * whole))
    disk = out.parent / "disk"
    disk.mkdir()
    with _small_disk(disk, room):
        where = out if cache else disk / "out"
        shutil.copytree(bench.earlier, where)
        environment = {"VTSDT_CACHE": str(disk / "cache")} if cache else {}
        code, message = ended(started(bench.study, where, prepare=lambda: os.environ.update(environment)))
        wrong = mixed(where) or _answered(code, message, "the disk is full")
        if wrong or cache:
            return Outcome(wrong or repaired(bench, where), code)
        shutil.copytree(where, out)
    return Outcome(repaired(bench, out), code)


@contextlib.contextmanager
def _small_disk(folder: Path, room: int) -> Iterator[None]:
    page = resource.getpagesize()
    size = max(2, -(-room // page)) * page
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size},mode=0700", "tmpfs", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def can_mount() -> bool:
    """Tell whether a small disk can be made here: that takes the rights of the system's administrator."""
    if sys.platform != "linux" or os.getuid() != 0 or shutil.which("mount") is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        try:
            with _small_disk(Path(folder), 1 << 16):
                return True
        except subprocess.CalledProcessError:
            return False


def _memory_limit(bench: Bench, rng: np.random.Generator, out: Path) -> Outcome:
    """Little address space from the start, or in every second case at the end of what the work needs.

    From the start: a new process, with up to twice what a run takes; it must speak for itself.  Else: a process that
    has its libraries already and does not ask beforehand, with up to 400 MiB more, so that the end comes anywhere.
    """
    shutil.copytree(bench.earlier, out)
    if rng.integers(2):
        most = int(rng.uniform(64 << 20, 2 << 30))
        code, message = ended(_started_anew(bench.study, out, most))
        wrong = _between(out) or _answered(code, message, "memory", "address space")
        return Outcome(f"{most >> 20} MiB in all: {wrong}" if wrong else repaired(bench, out), code)
    more = int(rng.uniform(1 << 20, 400 << 20))

    def limit() -> None:
        from vtsdt.cli import least_memory

        least_memory.LEAST_ADDRESS_SPACE = 0
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + more, used + more))

    code, message = ended(started(bench.study, out, prepare=limit))
    wrong = _between(out) or ("" if code < 0 and code != -signal.SIGALRM else _answered(code, message, "memory"))
    return Outcome(f"{more >> 20} MiB more: {wrong}" if wrong else repaired(bench, out), code)


def _started_anew(study: Path, out: Path, most: int) -> Started:
    """Start a diagnosis as a shell would, with so many bytes of address space."""
    handle, name = tempfile.mkstemp(dir=study.parent, suffix=".txt")
    process = os.fork()
    if process:
        os.close(handle)
        return Started(process, Path(name))
    try:
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        root = str(Path(__file__).parents[1])
        path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        words = ["diagnose", str(study), "--out", str(out), "--quiet"]
        os.execve(sys.executable, [sys.executable, "-m", "vtsdt", *words], {**os.environ, "PYTHONPATH": path})
    finally:
        os._exit(1)


def _two_at_once(bench: Bench, rng: np.random.Generator, out: Path) -> Outcome:
    """Two processes on one folder, in every second case on one empty cache; the second some time after the first."""
    shutil.copytree(bench.earlier, out)
    environment = {"VTSDT_CACHE": str(out.parent / "cache")} if rng.integers(2) else {}

    def empty_cache() -> None:
        os.environ.update(environment)

    first = started(bench.study, out, prepare=empty_cache)
    time.sleep(float(rng.uniform(0.0, bench.seconds)))
    second = started(bench.study, out, prepare=empty_cache)
    answers = [ended(run) for run in (first, second)]
    if all(code for code, _ in answers):
        return Outcome(f"neither came to its end: {answers}", answers[0][0])
    for code, message in answers:
        if wrong := _answered(code, message):
            return Outcome(wrong, code)
    return Outcome(mixed(out) or repaired(bench, out), 0)


def _clock_jump(bench: Bench, rng: np.random.Generator, out: Path) -> Outcome:
    """The time of day jumps by up to ten years, forwards or back, while the run lasts."""
    shutil.copytree(bench.earlier, out)
    at, jump = float(rng.uniform(0.0, bench.seconds)), float(rng.uniform(-1.0, 1.0)) * 10.0 * 365.0 * 86400.0

    def patch() -> None:
        real, begun = time.time, time.monotonic()
        time.time = lambda: real() + (jump if time.monotonic() - begun > at else 0.0)

    code, message = ended(started(bench.study, out, prepare=patch))
    return Outcome(_answered(code, message) or mixed(out) or repaired(bench, out), code)


_FAULTS = dict(zip(KINDS, (_killed, _disk_full, _memory_limit, _two_at_once, _clock_jump), strict=True))
