"""A year of a simulated fleet of lifts against its truth: time to detection, right names, false alarms, cost.

``python benchmarks/fleet_year.py --out FOLDER [--lifts 40] [--visits 26] [--seed 0] [--page PAGE]``

Visits that the folder has already, from an earlier run or from ``vtsdt validate fleet``, are not simulated again.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from discrepancy.validation.source_hash import source_hash
from vtsdt.cli import main as vtsdt

PAGE = """# A year of a fleet

What `vtsdt follow` makes of a year of {lifts} virtual lifts (synthetic: the rig with 37 states, each lift with rails,
parameters and sensors of its own), {visits} visits of two trips each. Something begins on a day between a third and
two thirds of the year and grows for 150 days, or comes at once where guides are lubricated; to {quiet} lifts nothing
happens. Nothing of the truth enters the judgement. Brackets are 95 % intervals (Clopper and Pearson; of the rate, of a
Poisson count).

| what happened | lifts | found in the year | median days to detection (quartiles) | right name, of those found |
| --- | ---: | ---: | ---: | ---: |
{found}

**False alarms: {false} in {years:.1f} machine years without a change, {rate:.2g} a machine and year
({low:.2g} to {high:.2g}); stated {stated:g}.**

## Days to detection

Share of the lifts that were found so many days after the beginning, of those that were followed for so long.

| what happened | {days} |
| --- | {rules} |
{curves}

## What it costs

{cost}

Measured on {date}, seed {seed}; hash of the sources {hash}; Python {python}, numpy {numpy}, scipy {scipy}. Written by
`python benchmarks/fleet_year.py --lifts {lifts} --visits {visits} --seed {seed} --out FOLDER --page PAGE`.
"""


def share(value: float | None, interval: Sequence[float | None] | None) -> str:
    """Return a share with its interval in percent."""
    if value is None or interval is None or None in interval:
        return ""
    low, high = (100.0 * float(v or 0.0) for v in interval)
    return f"{100.0 * value:.0f} % ({low:.0f} to {high:.0f})"


def found_rows(scores: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the table of what was found."""
    rows = []
    for s in scores:
        days = ""
        if s["detected"]:
            days = f"{s['median_days']:.0f} ({s['quartiles_days'][0]:.0f} to {s['quartiles_days'][1]:.0f})"
        right = share(s["right_name"] / s["detected"], s["right_name_interval"]) if s["detected"] else ""
        found = share(s["detected"] / s["machines"], s["detected_interval"])
        rows.append(f"| {s['truth']} | {s['machines']} | {found} | {days} | {right} |")
    return rows


def page(content: Mapping[str, Any], seconds: float | None) -> str:
    """Return the page of a fleet's year."""
    scores = content["scores"]
    days = [point["days"] for point in scores[0]["detection_curve"]]
    curves = [
        f"| {s['truth']} | {' | '.join(share(p['share'], p['interval']) for p in s['detection_curve'])} |"
        for s in scores
    ]
    rate = content["false_alarms"]
    cost = "All visits were there already; what one costs was not measured in this run."
    if seconds is not None:
        yearly = seconds * content["visits"]
        cost = (
            f"{seconds:.2f} s of processor time for a visit, with its simulation: {yearly:.0f} s a machine and year.\n"
            f"Visits are judged independently of each other, so the time grows in proportion to the machines:\n"
            f"{200.0 * yearly / 60.0:.0f} minutes of one processor for 200 lifts."
        )
    return PAGE.format(
        lifts=content["lifts"],
        visits=content["visits"],
        quiet=sum(1 for m in content["machines"] if not m["truth"]),
        found="\n".join(found_rows(scores)),
        false=rate["false_alarms"],
        years=rate["machine_years"],
        rate=rate["per_year"],
        low=rate["interval"][0],
        high=rate["interval"][1],
        stated=content["stated_false_alarms"],
        days=" | ".join(f"{d:g}" for d in days),
        rules=" | ".join("---:" for _ in days),
        curves="\n".join(curves),
        cost=cost,
        date=datetime.date.today().isoformat(),
        seed=content["seed"],
        hash=source_hash("vtsdt.fleet.command"),
        python=sys.version.split()[0],
        **{name: version(name) for name in ("numpy", "scipy")},
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the fleet's year where it has not been run, and write its page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--lifts", type=int, default=40)
    parser.add_argument("--visits", type=int, default=26)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    path = given.out / "fleet.json"
    before = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    numbers = ("lifts", "visits", "seed")
    words = [word for name in numbers for word in (f"--{name}", str(getattr(given, name)))]
    code = int(vtsdt(["validate", "fleet", *words, "--out", str(given.out)]))
    if code or not given.page:
        return code
    content = json.loads(path.read_text(encoding="utf-8"))
    seconds = content["processor_seconds_per_visit"] or before.get("processor_seconds_per_visit")
    given.page.write_text(page(content, seconds), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
