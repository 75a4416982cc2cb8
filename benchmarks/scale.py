"""How time and memory of a diagnosis grow with rows, records, states, outputs and candidates; the page.

``python benchmarks/scale.py [--only rows,records] [--most 30000] [--limit 12] [--keep FILE]``, with
``--page docs/benchmarks/scale.md`` to write the page
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from run import commit, machine
from scale_case import Case, write

ROOT = Path(__file__).resolve().parents[1]


def _linked(*include: str) -> Case:
    """Return a case of the sweep of candidates: the same machine, and those effects that the patterns allow."""
    return Case(masses=22, outputs=4, links=190, include=include)


#: Cases of each sweep: what grows, and everything else as in `Case`.
SWEEPS: dict[str, dict[int, Case]] = {
    "rows": {n: Case(rows=n) for n in (1_000, 4_000, 10_000, 30_000, 100_000, 300_000, 1_000_000, 10_000_000)},
    "records": {n: Case(records=n) for n in (1, 3, 10, 30, 100, 300, 1000)},
    "states": {2 * n: Case(masses=n) for n in (1, 2, 5, 10, 20, 50, 250)},
    "outputs": {n: Case(masses=20, outputs=n) for n in (1, 5, 20, 40)},
    "outputs with --memory 3": {40: Case(masses=20, outputs=40)},
    "candidates": {
        27: _linked("*@guide_0", "*@x_0"),
        108: _linked("*@guide_[0-3]", "*@x_*"),
        262: _linked("*@guide_1*", "*@x_*"),
        946: _linked("*@guide_*", "*@spring_*"),
        5150: _linked("*"),
    },
}
#: What is asked for in sweeps beside the study.
OPTIONS = {"outputs with --memory 3": ("--memory", "3")}


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a run took.

    Parameters
    ----------
    processor, wall : float, s
    peak : float, bytes
        Largest resident memory.
    code : int
        Exit code, that of a signal below zero; SIGXCPU's where the limit of processor time was reached.
    candidates : int
        Effects that the study could name.
    limit : float, s, optional
        Processor time after which the run was ended.
    commit : str
        Of the program.
    reached : str
        The last line of progress of a run that did not end by itself.
    """

    processor: float
    wall: float
    peak: float
    code: int
    candidates: int
    limit: float | None = None
    commit: str = "unknown"
    reached: str = ""

    @property
    def ended(self) -> bool:
        """Whether the run ended by itself."""
        return self.code != -signal.SIGXCPU

    @property
    def end(self) -> str:
        """How the run ended, in words."""
        if self.ended:
            return str(self.code)
        words = f"not ended in {self.limit / 60.0:g} min"  # type: ignore[operator]
        return f"{words}; it came to: {self.reached}" if self.reached else words


def measured(case: Case, options: Sequence[str] = (), limit: float | None = None) -> Cost:
    """Diagnose a case in a process of its own that adds one effect at most, with compiled code from earlier runs.

    After ``limit`` seconds of processor time, the run is ended.
    """
    with tempfile.TemporaryDirectory() as temporary:
        study = write(case, Path(temporary))
        words = ["diagnose", str(study), "--out", str(Path(temporary) / "out"), "--max-effects", "1"]
        words += options
        path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        program, environment = [sys.executable, "-m", "vtsdt"], {**os.environ, "PYTHONPATH": path}
        names = [*program, "catalogue", str(study), "--names"]
        listed = subprocess.run(names, env=environment, capture_output=True, text=True, check=True)
        said = Path(temporary) / "said.txt"
        begun = time.monotonic()
        with said.open("w", encoding="utf-8") as stream:
            run = subprocess.Popen(
                [*program, *words],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=stream,
                preexec_fn=lambda: _limited(limit),
            )
            _, status, used = os.wait4(run.pid, 0)
        run.returncode = os.waitstatus_to_exitcode(status)
        return Cost(
            processor=used.ru_utime + used.ru_stime,
            wall=time.monotonic() - begun,
            peak=1024.0 * used.ru_maxrss,
            code=run.returncode,
            candidates=len(listed.stdout.splitlines()),
            limit=limit,
            commit=commit(),
            reached=_reached(said.read_text(encoding="utf-8")) if run.returncode else "",
        )


def _reached(said: str) -> str:
    """Return the last line that a run printed, without the time in front and the estimate behind it.

    Examples
    --------
    >>> _reached("  12.5 s  fit record 3 of 10 (about 20 s left)\\n")
    'fit record 3 of 10'
    """
    last = ([""] + [line for line in said.splitlines() if line.strip()])[-1]
    return re.sub(r"^ *[0-9.]+ s  | \(about [^()]* left\)$", "", last).replace("|", "\\|")


def _limited(seconds: float | None) -> None:
    if seconds is not None:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), resource.RLIM_INFINITY))


def main() -> int:
    """Measure what is not in the file of results yet, print the tables, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", help=f"sweeps, separated by commas, of: {', '.join(SWEEPS)}")
    parser.add_argument("--most", type=int, help="leave out sizes above")
    parser.add_argument("--limit", type=float, help="minutes of processor time after which a run is ended")
    parser.add_argument("--keep", type=Path, help="file of results: what is in it is not measured again")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    kept: dict[tuple[str, int], Cost] = {}
    if given.keep and given.keep.exists():
        for line in given.keep.read_text(encoding="utf-8").splitlines():
            sweep, size, cost = json.loads(line)
            kept[sweep, size] = Cost(**cost)
    for sweep in given.only.split(",") if given.only else SWEEPS:
        for size, case in SWEEPS[sweep].items():
            if (sweep, size) in kept or (given.most is not None and size > given.most):
                continue
            cost = kept[sweep, size] = measured(case, OPTIONS.get(sweep, ()), given.limit and 60.0 * given.limit)
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps([sweep, size, cost.__dict__]) + "\n")
    tables = "\n\n".join(_table(sweep, kept) for sweep in SWEEPS if any(s == sweep for s, _ in kept))
    print(tables)
    if given.page:
        text = PAGE.format(
            date=datetime.date.today().isoformat(),
            machine=machine(),
            tables=tables,
        )
        given.page.write_text(text, encoding="utf-8")
    return 1 if any(cost.code for cost in kept.values() if cost.ended) else 0


def _table(sweep: str, kept: dict[tuple[str, int], Cost]) -> str:
    """Return the table of a sweep; the slope is that of the processor time, from the size before."""
    lines = [
        f"| {sweep} | candidates | processor, s | wall, s | peak memory, GB | slope | end | at |",
        "| ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    before: tuple[int, Cost] | None = None
    for size, cost in sorted(((size, c) for (of, size), c in kept.items() if of == sweep), key=lambda pair: pair[0]):
        slope = ""
        if before is not None and cost.ended and before[1].ended:
            slope = f"{math.log(cost.processor / before[1].processor) / math.log(size / before[0]):.2f}"
        lines.append(
            f"| {size} | {cost.candidates} | {cost.processor:.3g} | {cost.wall:.4g} | {cost.peak / 1e9:.2f} | {slope} "
            f"| {cost.end} | {cost.commit} |"
        )
        before = size, cost
    return "\n".join(lines)


PAGE = """# Growth with the size of a study

Measured until {date} by `python benchmarks/scale.py --keep FILE --page docs/benchmarks/scale.md`, which writes this
page and may be interrupted and continued. A row is one run of `vtsdt diagnose --max-effects 1` in a process of its
own: the effects that could be named, processor time (all threads), time on the clock, the largest resident memory,
the exit code, and the slope of the processor time on logarithmic scales from the row above (1: proportional). A run
that used the processor longer than `--limit` was ended there. The last column is the commit of the row. The machine
was shared with other programs, so that the time on the clock says less than that of the processor: {machine}.

{tables}

The machine is a chain of masses on springs, dampers and guides with dry friction hidden in the first guide
(`benchmarks/scale_case.py`). Where nothing else is said it has one mass, one output, and one record of 2000 rows beside
one that is held out. Of records of more than 100 000 rows, [sections](../method/residuals.md#sections-of-long-records)
are used. `--memory` bounds what is held of sensitivities and scores; where nothing is said it is half of the machine's
memory, and what fits is kept. In the sweep of candidates the machine stays the same: 22 masses, another
190 weak springs between those that are not neighbours, four outputs; `[candidates] include` allows more and more.
"""

if __name__ == "__main__":
    sys.exit(main())
