"""Run benchmark entries in turns; print medians, spread and ratios; write the docs page on request.

See README.md beside this file, and ``python benchmarks/run.py --help``.
"""

from __future__ import annotations

import argparse
import fnmatch
import importlib.util
import json
import math
import os
import platform
import random
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "benchmarks" / "computing-times.md"
FEWEST_ROUNDS = 3
LINEAR_ALGEBRA = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
TURN_SECONDS, MOST_CALLS = 0.02, 100  # what is shorter is called several times in a turn


@dataclass
class Entry:
    """One thing that is timed, and its times in seconds, one for each round."""

    name: str
    work: Callable[[], float | None]
    times: list[float] = field(default_factory=list)
    calls: int = 1

    def once(self, clock: Callable[[], float] = time.perf_counter) -> float:
        """Seconds that a call took, as the mean of a turn's calls, or that it says it took."""
        start = clock()
        for _ in range(self.calls):
            said = self.work()
        took = (clock() - start) / self.calls
        return float(said) if isinstance(said, float) else took

    def prepare(self) -> None:
        """Call once, which does not count, and set the number of calls in a turn."""
        start = time.perf_counter()
        said = self.work()
        if isinstance(said, float) or time.perf_counter() - start > 100.0 * TURN_SECONDS:
            return
        took = self.once()  # the first call may have compiled
        self.calls = max(1, min(MOST_CALLS, int(TURN_SECONDS / max(took, 1e-9))))


@dataclass
class Group:
    """The entries of one file, compared with the first of them."""

    subject: str
    title: str
    entries: list[Entry]
    unit: str = "s"
    text: str = ""


def load(path: Path) -> Group:
    """Prepare the entries of a benchmark file.

    Raises
    ------
    ValueError
        If the file has no ``bench_*`` function, or one of them has no docstring or returns no callable.
    """
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))  # entries of several files share what is beside them
    spec.loader.exec_module(module)
    entries = []
    for name, function in vars(module).items():
        if not name.startswith("bench_") or not callable(function):
            continue
        if not function.__doc__:
            raise ValueError(f"{path.name}: {name} needs a docstring, whose first line names it in the table")
        work = function()
        if not callable(work):
            raise ValueError(f"{path.name}: {name} must return the callable to be timed, not {work!r}")
        name = function.__doc__.strip().splitlines()[0]
        entries.append(Entry(f"{name} ({work.note})" if hasattr(work, "note") else name, work))
    if not entries:
        raise ValueError(f"{path.name}: no function named bench_*")
    title, _, text = (module.__doc__ or path.stem).strip().partition("\n")
    return Group(path.stem.removeprefix("bench_"), title, entries, getattr(module, "UNIT", "s"), text.strip())


def processor_time() -> float:
    """Seconds of processor time that this process and its ended children have used, in all threads."""
    return sum(os.times()[2:4]) + time.process_time()  # children by the clock tick, this process finely


CLOCKS = {"wall": time.perf_counter, "cpu": processor_time}


def measure(
    group: Group, rounds: int, seconds: float, rng: random.Random, clock: Callable[[], float] = time.perf_counter
) -> None:
    """Time the entries in turns, in a new order each round, after one call each that does not count.

    Stops after ``rounds`` rounds, or earlier once ``seconds`` are spent, but not before three rounds.
    """
    for entry in group.entries:
        entry.prepare()
    start = time.perf_counter()
    for done in range(rounds):
        if done >= FEWEST_ROUNDS and time.perf_counter() - start > seconds:
            break
        for entry in rng.sample(group.entries, len(group.entries)):
            entry.times.append(entry.once(clock))


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile.

    Examples
    --------
    >>> quartiles([4.0, 1.0, 2.0, 3.0, 5.0])
    (2.0, 3.0, 4.0)
    """
    low, mid, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, mid, high


def duration(seconds: float) -> str:
    """Write a duration with three digits in the unit that suits it.

    Examples
    --------
    >>> duration(0.01234), duration(2.5), duration(4.2e-7)
    ('12.3 ms', '2.50 s', '420 ns')
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:#.3g} {unit}".replace(". ", " ")
    return f"{seconds / 1e-9:.0f} ns"


def amount(value: float, unit: str) -> str:
    """Write a measured value: a duration, or a size in bytes.

    Examples
    --------
    >>> amount(0.25, "s"), amount(3.2e7, "B")
    ('250 ms', '32.0 MB')
    """
    return duration(value) if unit == "s" else f"{value / 1e6:.1f} MB"


def rows(group: Group) -> list[tuple[str, ...]]:
    """Cells of a group's table: name, median, quartiles, ratio with its quartiles, rounds."""
    base = group.entries[0].times
    cells: list[tuple[str, ...]] = []
    for entry in group.entries:
        if any(math.isnan(t) for t in entry.times):
            cells.append((entry.name, "not installed", "", "", "0"))
            continue
        low, mid, high = quartiles(entry.times)
        if entry is group.entries[0]:
            ratio = "1"
        else:
            a, b, c = quartiles([t / t0 for t, t0 in zip(entry.times, base, strict=True)])
            ratio = f"{b:.3g} ({a:.3g} to {c:.3g})"
        unit = group.unit
        spread = f"{amount(low, unit)} to {amount(high, unit)}"
        cells.append((entry.name, amount(mid, unit), spread, ratio, str(len(entry.times))))
    return cells


HEAD = ("entry", "median", "quartiles", "ratio", "rounds")


def plain_table(group: Group) -> str:
    """The table of a group for a terminal."""
    lines = [HEAD, *rows(group)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    cells = [[c.ljust(w) for c, w in zip(line, widths, strict=True)] for line in lines]
    return "\n".join([group.title, *("  " + "  ".join(line).rstrip() for line in cells)])


def machine() -> str:
    """Processor, cores and versions, in one line."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        found = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE)
        model = found.group(1) if found else model
    parts = [f"{model}, {os.cpu_count()} cores", f"Python {platform.python_version()}"]
    for package in ("numpy", "scipy", "numba", "vtsdt"):
        try:
            parts.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(parts)


HEADER = """# Computing times

`python benchmarks/run.py --write-docs` measures everything again and writes this page; with names of subjects it
writes their sections only. The entries of a table take turns; the ratio is to the first of them, as the median (and
the quartiles) of the ratios within each round. A ratio whose quartiles span 1 is no difference. What takes less than
20 ms is called several times in a turn.
"""


def commit() -> str:
    """Return the program's commit, abbreviated; ``"unknown"`` outside a checkout."""
    words = ["git", "-C", str(Path(__file__).resolve().parents[1]), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def section(group: Group, clock: str) -> str:
    """Text of a group on the docs page."""
    what = {"wall": "wall-clock time", "cpu": "processor time of all threads; other programs ran meanwhile"}[clock]
    lines = [f"<!-- {group.subject} -->", f"## {group.title.rstrip('.')}", ""]
    lines += [group.text, ""] if group.text else []
    lines += ["| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    lines += ["| " + " | ".join(row) + " |" for row in rows(group)]
    threads = os.environ.get(LINEAR_ALGEBRA[0])
    measured = f"Measured {date.today().isoformat()} on {machine()}"
    measured += f", linear algebra on {threads} thread{'s' * (threads != '1')}" if threads else ""
    lines += ["", f"{measured}: {'memory' if group.unit == 'B' else what}."]
    return "\n".join(lines) + "\n"


def page(groups: Sequence[Group], clock: str = "wall", before: str = "") -> str:
    """Text of the docs page: the sections of groups in place of those that it had before."""
    known = dict(re.findall(r"^<!-- (\w+) -->\n(.*?)(?=^<!-- |\Z)", before, re.MULTILINE | re.DOTALL))
    sections = {name: f"<!-- {name} -->\n{text.strip()}\n" for name, text in known.items()}
    sections |= {group.subject: section(group, clock) for group in groups}
    return "\n".join([HEADER, *(sections[name] for name in sorted(sections))])


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(prog="benchmarks/run.py", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("subjects", nargs="*", default=["*"], help="names of bench_NAME.py, patterns allowed")
    parser.add_argument("--rounds", type=int, default=11, help="rounds at most (%(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="per file; then no new round starts")
    parser.add_argument("--seed", type=int, default=0, help="for the order of the entries")
    parser.add_argument(
        "--clock", choices=CLOCKS, default="wall", help="cpu: processor time, where other programs run meanwhile"
    )
    parser.add_argument("--json", type=Path, help="write all single times into this file")
    parser.add_argument(
        "--write-docs", action="store_true", help=f"write the sections into docs/benchmarks/{PAGE.name}"
    )
    options = parser.parse_args(arguments)
    for name in LINEAR_ALGEBRA:  # as the vtsdt command does
        os.environ.setdefault(name, "1")
    if options.rounds < FEWEST_ROUNDS:
        parser.error(f"--rounds must be at least {FEWEST_ROUNDS}: fewer have no quartiles")
    files = sorted(HERE.glob("bench_*.py"))
    names = {path: path.stem.removeprefix("bench_") for path in files}
    chosen = [f for f in files if any(fnmatch.fnmatch(names[f], name) for name in options.subjects)]
    if not chosen:
        wanted = " or ".join(options.subjects)
        parser.error(f"no benchmark is called {wanted}; there are: {', '.join(names.values())}")
    rng = random.Random(options.seed)
    print(machine())
    groups = []
    for path in chosen:
        group = load(path)
        measure(group, options.rounds, options.seconds, rng, CLOCKS[options.clock])
        print(f"\n{plain_table(group)}", flush=True)
        groups.append(group)
        if options.write_docs:
            before = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
            PAGE.write_text(page([group], options.clock, before), encoding="utf-8")
    if options.json:
        times = {group.subject: {entry.name: entry.times for entry in group.entries} for group in groups}
        text = json.dumps({"machine": machine(), "seconds": times}, indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")
    if options.write_docs:
        print(f"\nwrote {PAGE.relative_to(HERE.parent)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
