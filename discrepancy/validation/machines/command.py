"""``vtsdt validate discrepancy machines``: the search judged on machines of plain equations."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from discrepancy.validation.machines.case import NATS, WHAT
from discrepancy.validation.machines.fleet import NAMES, machine_named
from discrepancy.validation.machines.page import page, statements
from discrepancy.validation.machines.suite import Limits, cases, run_cases
from discrepancy.validation.machines.temperature import temperature_lines

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Write the cases, diagnose each in a process of its own, score them; ``results.csv``, ``results.md``, a figure."""
    import argparse
    from datetime import date

    usual = Limits()
    parser = argparse.ArgumentParser(
        prog="vtsdt validate discrepancy machines",
        description="How often the search for a missing effect is right, on machines of plain equations.",
    )
    parser.add_argument("--machine", action="append", choices=NAMES, metavar="NAME", help=f"of {', '.join(NAMES)}")
    parser.add_argument(
        "--what",
        action="append",
        metavar="WHAT",
        help=f"what is hidden: {', '.join(WHAT)}, or an effect of the machine; may be repeated; default: all five",
    )
    parser.add_argument("--nats", nargs="+", type=float, default=list(NATS), help="default: 10 30 100 1000")
    parser.add_argument("--trials", type=int, default=1, help="seeds for each machine, what and nats; default 1")
    parser.add_argument("--seeds", choices=("development", "final"), default="development")
    parser.add_argument("--final", action="store_true", help="yes, run the final seeds: once, after the last change")
    parser.add_argument(
        "--seconds", type=float, default=usual.seconds, help=f"processor time of a case; {usual.seconds:g}"
    )
    parser.add_argument("--megabytes", type=float, default=usual.megabytes, help=f"of a case; {usual.megabytes:g}")
    parser.add_argument("--out", required=True, type=Path, help="folder of cases and results; a run goes on there")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    args = parser.parse_args(list(arguments))
    machines, what = args.machine or list(NAMES), args.what or list(WHAT)
    final = args.seeds == "final"
    if final != args.final:
        parser.error("the final seeds are run once, after the last change: give --seeds final and --final together")
    faults = []
    if args.trials < 1:
        faults.append("--trials must be at least 1")
    if min(args.nats) <= 0.0:
        faults.append("--nats must be above zero")
    for name in machines:
        known = {*WHAT, *(e.name for e in machine_named(name).effects)}
        unknown = [w for w in what if w not in known]
        if unknown:
            faults.append(f"--what {unknown[0]}: the machine '{name}' has {', '.join(sorted(known))}")
    if faults:
        parser.error("; ".join(faults))
    rows = run_cases(
        cases(machines, what, args.nats, args.trials, final=final),
        args.out,
        code=_code_hash(),
        limits=Limits(args.seconds, args.megabytes),
        progress=(lambda text: None) if args.quiet else lambda text: print(text, file=sys.stderr, flush=True),
    )
    further = temperature_lines(args.out, rows)
    text = page(rows, date=date.today().isoformat(), final=final, further=further)
    (args.out / "results.md").write_text(text)
    shown, true = statements(rows)
    if shown:
        from discrepancy.validation.machines.reliability import reliability_figure

        reliability_figure([("as shown", shown, true)]).savefig(args.out / "reliability.png", dpi=150)
    print(text.partition("## Cases")[0])
    return 0


def _code_hash() -> str:
    """Return a hash over the source files of the packages that make the answer."""
    import hashlib

    root = Path(__file__).resolve().parents[3]
    digest = hashlib.sha256()
    for package in ("multibody", "estimation", "discrepancy"):
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]
