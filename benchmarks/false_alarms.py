"""False alarms of ``vtsdt follow`` where records are correlated or have heavy tails, and what that costs in delay.

``python benchmarks/false_alarms.py [--years 400] [--seed 0] [--page docs/benchmarks/false-alarms.md]``
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar
from unittest.mock import patch

import numpy as np

from discrepancy.validation.source_hash import source_hash
from operation.follow.settings import FollowSettings
from operation.follow.watch import watch
from operation.statistics.control_chart import control_chart
from operation.store.judgement import Judgement, Quantity

Result = TypeVar("Result")
DAY = 86400.0
#: Records of a machine in a year, one a day, and quantities of each.
RECORDS, QUANTITIES = 365, 6
STATED = 0.2
#: Records before a step and after it.
BEFORE, AFTER = 100, 100
#: Records by which an autoregressive series has forgotten its start.
SETTLED = 100


@dataclass(frozen=True)
class Noise:
    """Values from record to record of a machine that does not change, of unit variance."""

    name: str
    lag: float = 0.0
    tails: float = 0.0

    def draw(self, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
        """Return independent columns; `shape` is (records, columns)."""
        from scipy.signal import lfilter

        size = (shape[0] + SETTLED, shape[1])
        if self.tails:
            return rng.standard_t(self.tails, shape) * np.sqrt((self.tails - 2.0) / self.tails)
        shocks = rng.standard_normal(size) * np.sqrt(1.0 - self.lag**2)
        return lfilter([1.0], [1.0, -self.lag], shocks, axis=0)[SETTLED:]


NORMAL = tuple(Noise(f"normal, lag-1 correlation {lag:g}", lag) for lag in (-0.3, 0.0, 0.1, 0.2, 0.3, 0.5, 0.7))
HEAVY = Noise("independent, Student's t with five degrees of freedom", tails=5.0)


def machine_year(values: np.ndarray) -> int:
    """Return the changes that are raised in a year of a machine, of values of shape (records, quantities)."""
    made = [
        Judgement(
            key=f"{k}",
            name=f"{k}",
            at=k * DAY,
            quantities={f"q{i}": Quantity(value=float(v), kind="feature") for i, v in enumerate(row)},
        )
        for k, row in enumerate(values)
    ]
    return len(watch(made, FollowSettings(false_alarms=STATED)).changes)


def as_if_independent(work: Callable[[], Result]) -> Result:
    """Return a result with the standardised residuals charted as they are."""
    with patch("operation.statistics.control_chart.prediction_errors", lambda residuals, earlier: residuals):
        return work()


def rate(count: int, years: int) -> str:
    """Return a rate per year with the exact 95 % interval of a Poisson count."""
    from scipy.stats import chi2

    low = 0.5 * chi2.ppf(0.025, 2 * count) if count else 0.0
    high = 0.5 * chi2.ppf(0.975, 2 * count + 2)
    return f"{count / years:.2g} ({low / years:.2g} to {high / years:.2g})"


def false_alarms(years: int, seed: int) -> list[str]:
    """Return the table of false alarms."""
    lines = [
        "| records of a machine that does not change | false alarms per machine and year | charted as if independent |",
        "| --- | ---: | ---: |",
    ]
    for k, noise in enumerate((*NORMAL, HEAVY)):
        rng = np.random.default_rng([seed, k])
        found = independent = 0
        for _ in range(years):
            values = noise.draw(rng, (RECORDS, QUANTITIES))
            found += machine_year(values)
            independent += as_if_independent(lambda v=values: machine_year(v))
        lines.append(f"| {noise.name} | {rate(found, years)} | {rate(independent, years)} |")
        print(lines[-1], flush=True)
    return lines


def delays(trials: int, seed: int) -> list[str]:
    """Return the table of the records that a step takes to be found."""
    per_alarm = 365.25 * QUANTITIES / STATED
    lines = [
        "| lag-1 correlation | step [standard deviations] | median records to detection | not found in "
        f"{AFTER} records | as if independent: median | not found |",
        "| ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for k, noise in enumerate(n for n in NORMAL if n.lag in (0.0, 0.3, 0.5)):
        for size in (1.0, 2.0, 4.0):
            values = noise.draw(np.random.default_rng([seed, 100 + k]), (BEFORE + AFTER, trials))
            values[BEFORE:] += size

            def waits(series: np.ndarray = values) -> list[int]:
                found = ([c.found for c in control_chart(y, per_alarm) if c.found >= BEFORE] for y in series.T)
                return [f[0] - BEFORE + 1 if f else AFTER + 1 for f in found]

            cells = []
            for after in (waits(), as_if_independent(waits)):
                missed = np.asarray(after) > AFTER
                median = float(np.median(after))
                cells += [f"{median:.0f}" if median <= AFTER else f"> {AFTER}", f"{100 * np.mean(missed):.0f} %"]
            lines.append(f"| {noise.lag:g} | {size:g} | {' | '.join(cells)} |")
            print(lines[-1], flush=True)
    return lines


PAGE = """# False alarms

How often `vtsdt follow` raises a change of a machine that does not change, at a stated rate of {stated} per machine
and year: {years} simulated machine years a row, {records} records of {quantities} quantities each; in brackets the 95 %
interval of a Poisson count. Measured on {date}, seed {seed}; hash of the sources {hash}; Python {python},
numpy {numpy}, scipy {scipy}. Written by `python benchmarks/false_alarms.py --page docs/benchmarks/false-alarms.md`.

{alarms}

The last column is the same chart without [the correlation from record to record](../method/operation.md#a-change)
taken off.

## What it costs

A step after {before} records, {trials} trials a row, in standard deviations of a record. Where records are correlated,
the chart for independent records owes its speed to its false alarms.

{delays}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the tables, print them, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--years", type=int, default=400)
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    alarms, waits = false_alarms(given.years, given.seed), delays(given.trials, given.seed)
    if given.page:
        page = PAGE.format(
            stated=STATED,
            years=given.years,
            trials=given.trials,
            records=RECORDS,
            quantities=QUANTITIES,
            before=BEFORE,
            date=datetime.date.today().isoformat(),
            seed=given.seed,
            hash=source_hash("operation.follow.watch"),
            python=sys.version.split()[0],
            alarms="\n".join(alarms),
            delays="\n".join(waits),
            **{name: version(name) for name in ("numpy", "scipy")},
        )
        given.page.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
