"""Faults from outside while a diagnosis runs: kills, full disks, memory limits, two processes, clock jumps; the page.

``python benchmarks/faults.py [--only "killed,disk full"] [--count N] [--seed N] [--keep FILE]
[--page docs/benchmarks/faults.md]``
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from fault_cases import KINDS, can_mount, prepare, try_fault
from run import commit
from share_interval import share_interval

HERE = Path(__file__).resolve().parent

#: How often each fault is tried where nothing is said.
COUNTS = dict(zip(KINDS, (200, 50, 50, 20, 20), strict=True))


def main() -> int:
    """Try the faults, print what was not survived, and write the page; return 1 where something was not survived."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", help=f"kinds, separated by commas, of: {', '.join(KINDS)}")
    parser.add_argument("--count", type=int, help="how often each kind is tried")
    parser.add_argument("--seed", type=int, default=0, help="of the moments and sizes; each has cases of its own")
    parser.add_argument("--keep", type=Path, help="file of outcomes of one seed: what is in it is not tried again")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no further fault after so long")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    kinds = given.only.split(",") if given.only else list(KINDS)
    counts = {kind: COUNTS[kind] if given.count is None else given.count for kind in kinds}
    if "disk full" in counts and not can_mount():
        print("disk full: skipped, because a small disk can be made by the administrator of a Linux system only")
        del counts["disk full"]
    version = commit()
    kept: dict[tuple[str, int], tuple[str, int, str]] = {}
    if given.keep and given.keep.exists():
        for line in given.keep.read_text(encoding="utf-8").splitlines():
            kind, k, *outcome = json.loads(line)
            kept[kind, k] = tuple(outcome)
    todo = [(kind, k) for k in range(max(counts.values())) for kind in counts if k < counts[kind]]
    todo = [case for case in todo if case not in kept]
    begun = time.monotonic()
    if todo:
        with tempfile.TemporaryDirectory() as temporary:
            bench = prepare(Path(temporary) / "bench")
            for kind, k in todo:
                if time.monotonic() - begun > given.seconds:
                    break
                rng = np.random.default_rng([KINDS.index(kind), k, given.seed])  # each of its own: it may go on
                outcome = try_fault(kind, bench, rng, Path(temporary) / "case")
                kept[kind, k] = outcome.wrong, outcome.code, version
                if given.keep:
                    with given.keep.open("a", encoding="utf-8") as stream:
                        stream.write(json.dumps([kind, k, outcome.wrong, outcome.code, version]) + "\n")
                if outcome.wrong:
                    print(f"{kind} {k}: {outcome.wrong}", flush=True)
    lines = _table(kept)
    print("\n".join(lines))
    if given.page:
        given.page.write_text(_page(lines, kept, given.seed), encoding="utf-8")
    return 1 if any(wrong for wrong, *_ in kept.values()) else 0


def _table(kept: dict[tuple[str, int], tuple[str, int, str]]) -> list[str]:
    lines = [
        "| fault | tried | survived | 95 % interval | how the runs ended | at |",
        "| --- | ---: | ---: | --- | --- | --- |",
    ]
    for kind in KINDS:
        outcomes = [outcome for (of, _), outcome in kept.items() if of == kind]
        if outcomes:
            survived = sum(not wrong for wrong, *_ in outcomes)
            ends = Counter(f"signal {-code}" if code < 0 else f"exit code {code}" for _, code, _ in outcomes)
            how = ", ".join(f"{n} {end}" for end, n in sorted(ends.items()))
            at = ", ".join(dict.fromkeys(at for *_, at in outcomes))
            share = share_interval(survived, len(outcomes))
            lines.append(f"| {kind} | {len(outcomes)} | {survived} | {share} | {how} | {at} |")
    return lines


def _page(lines: list[str], kept: dict[tuple[str, int], tuple[str, int, str]], seed: int) -> str:
    rule = (HERE / "fault_cases.py").read_text(encoding="utf-8").split('"""')[1].strip()
    wrong = [f"- {kind}, case {k}: {' '.join(text.split())}" for (kind, k), (text, *_) in kept.items() if text]
    return PAGE.format(
        date=datetime.date.today().isoformat(),
        seed=seed,
        lines="\n".join(lines),
        rule=rule,
        wrong="\n".join(wrong) or "Every fault was survived.",
        planned=", ".join(f"{n} of '{kind}'" for kind, n in COUNTS.items()),
    )


PAGE = """# Faults from outside

Measured on {date} with seed {seed} by `python benchmarks/faults.py --keep FILE --page docs/benchmarks/faults.md`, which
writes this page and may be interrupted and continued. A whole suite is {planned}. Where a fault is not survived, the
program is mended and the whole kind is tried again: the last column says at which commit each was.

{lines}

{rule}

The disk is a tmpfs that has room for a part of what the run writes, of results or of compiled code; the limit of
memory is one of address space (`ulimit -v`): in half of the cases from the start of a new process, 64 MiB to 2 GiB,
where the program must say itself what it lacks; in the others up to 400 MiB beyond what a process has that skips this
question and has loaded its libraries. The moment of a kill is drawn uniformly from the length of a run. The clock is
the one that the program reads; the machine's own stays as it is.

{wrong}
"""

if __name__ == "__main__":
    sys.exit(main())
