"""Every broken input of the corpus through ``vtsdt compare``, judged by rule; writes the page.

``python benchmarks/broken_inputs.py [--page docs/benchmarks/broken-inputs.md] [--every N]``
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import importlib
import io
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))

from broken_inputs import Broken, corpus, judged, write
from share_interval import share_interval

LIMIT = 10.0  # s of processor time


def answer(broken: Broken, folder: Path) -> tuple[int, str, float]:
    """Return exit code, message and processor time, s, of one input, in a process of its own."""
    from vtsdt.cli.command_line import main

    study = write(broken, folder)
    told = folder / "told.txt"
    process = os.fork()
    if process == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (int(LIMIT), int(LIMIT) + 2))
        code = 1
        with told.open("w") as stream, contextlib.redirect_stderr(stream), contextlib.redirect_stdout(io.StringIO()):
            os.chdir(folder)
            code = main(["compare", str(study), "--out", str(folder / "out"), "--quiet", *broken.words])
        os._exit(code)
    _, status, used = os.wait4(process, 0)
    seconds = used.ru_utime + used.ru_stime
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        return -1, "", seconds
    return os.waitstatus_to_exitcode(status), told.read_text(), seconds


def main() -> None:
    """Run, print what is not clear, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--page", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="place of the first input that is taken")
    parser.add_argument("--keep", type=Path, help="file of answers: what is in it is not run again")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no further input after so long")
    given = parser.parse_args()
    inputs = corpus()[given.first :: given.every]
    for module in (
        "discrepancy.study.command",
        "discrepancy.problem.model",
        "estimation.files.read_csv",
        "pint",
        "numba",
    ):
        importlib.import_module(module)  # once, and not again in every process
    from discrepancy.problem.problem import read_problem

    known: dict[str, str] = {}
    if given.keep and given.keep.exists():
        known = dict(json.loads(line)[:2] for line in given.keep.read_text(encoding="utf-8").splitlines())
    verdicts: Counter[str] = Counter()
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as temporary:
        read_problem(write(Broken("sound", "", {}), Path(temporary) / "sound"))
        for k, broken in enumerate(inputs):
            name = f"{broken.kind} | {broken.variant}"
            if name in known:
                verdicts[known[name]] += 1
                continue
            if time.perf_counter() - begun > given.seconds:
                print(f"{len(inputs) - sum(verdicts.values())} inputs are left: run it again with --keep")
                return
            code, message, seconds = answer(broken, Path(temporary) / str(k))
            verdict = "hang" if code == -1 else judged(broken, code, message)
            verdicts[verdict] += 1
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps([name, verdict, message.strip()[:1000]]) + "\n")
            if verdict != "clear":
                print(
                    f"{verdict:7} {broken.kind} | {broken.variant} | {message.strip()[:230]} ({seconds:.1f} s)",
                    flush=True,
                )
    kinds = len({b.kind for b in inputs})
    line = f"{len(inputs)} inputs of {kinds} kinds: " + ", ".join(
        f"{verdicts[v]} {v} ({share_interval(verdicts[v], len(inputs))})"
        for v in ("clear", "vague", "silent", "fault", "hang")
    )
    print(line, f"({time.perf_counter() - begun:.0f} s)")
    if given.page:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
        ).stdout.strip()
        given.page.write_text(
            PAGE.format(line=line, rule=RULE, date=datetime.date.today().isoformat(), commit=commit or "unknown"),
            encoding="utf-8",
        )


RULE = (
    (Path(__file__).parents[1] / "tests/unit/broken_inputs.py").read_text().split('"""')[1].partition("\n\n")[2].strip()
)
PAGE = """# Broken inputs

{line}; in brackets 95 % intervals. Measured on {date} at {commit} by
`python benchmarks/broken_inputs.py --page docs/benchmarks/broken-inputs.md`, which writes this page.

The corpus is in `tests/unit/broken_inputs.py`: faults of a study file, of recordings and of a model's file, each put
into a sound study and given to `vtsdt compare`. It tests this program against faults that its authors thought of, so it
says little about those that nobody has thought of. Answers that were not clear in earlier runs of this corpus were
mended, so these shares are those of inputs that were looked at and not of a fresh sample.

The rule: {rule}
"""

if __name__ == "__main__":
    main()
