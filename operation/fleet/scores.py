"""A simulated year against its truth: time to detection, false alarms, right names, with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["MachineYear", "Scores", "detection_curve", "scores", "share_interval"]

YEAR = 365.25


@dataclass(frozen=True, kw_only=True)
class MachineYear:
    """A machine's year, as it was and as it was seen.

    Parameters
    ----------
    machine : str
    truth : str
        What happened; empty if nothing.
    begins : float, days
        When it began.
    days : float
        How long the machine was followed.
    alarms : tuple of float, days
        When changes were raised.
    named : str
        What the change was called; empty where there was none.
    probability : float
        That was given to this name.
    """

    machine: str
    truth: str
    begins: float
    days: float
    alarms: tuple[float, ...] = ()
    named: str = ""
    probability: float = float("nan")

    @property
    def detected(self) -> float | None:
        """Days from the beginning to the first alarm since; None without one."""
        since = [a - self.begins for a in self.alarms if a >= self.begins]
        return min(since) if self.truth and since else None

    @property
    def false_alarms(self) -> int:
        """Alarms before anything happened."""
        return sum(1 for a in self.alarms if not self.truth or a < self.begins)

    @property
    def quiet_days(self) -> float:
        """Days in which an alarm is false."""
        return self.begins if self.truth else self.days


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Scores of one truth, or of all.

    Parameters
    ----------
    truth : str
    machines, detected, right : int
    median_days : float
        From the beginning to the alarm, over the detected ones.
    quartiles : (float, float), days
    """

    truth: str
    machines: int
    detected: int
    right: int
    median_days: float
    quartiles: tuple[float, float]


def share_interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Clopper and Pearson 1934).

    Examples
    --------
    >>> low, high = share_interval(9, 10)
    >>> round(low, 3), round(high, 3)
    (0.555, 0.997)
    """
    from scipy.stats import beta

    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def rate_interval(events: int, years: float) -> tuple[float, float]:
    """Return the 95 % interval of a rate of rare events (Garwood 1936)."""
    from scipy.stats import chi2

    low = 0.5 * float(chi2.ppf(0.025, 2 * events)) if events else 0.0
    return low / years, 0.5 * float(chi2.ppf(0.975, 2 * (events + 1))) / years


def scores(years: Sequence[MachineYear]) -> tuple[list[Scores], Mapping[str, Any]]:
    """Return the scores of each truth, and false alarms per machine and year with their interval."""
    out = []
    for truth in sorted({y.truth for y in years if y.truth}):
        own = [y for y in years if y.truth == truth]
        delays = [d for y in own if (d := y.detected) is not None]
        quartiles = np.quantile(delays, [0.25, 0.75]) if delays else (np.nan, np.nan)
        out.append(
            Scores(
                truth=truth,
                machines=len(own),
                detected=len(delays),
                right=sum(1 for y in own if y.detected is not None and y.named == truth),
                median_days=float(np.median(delays)) if delays else float("nan"),
                quartiles=(float(quartiles[0]), float(quartiles[1])),
            )
        )
    quiet = sum(y.quiet_days for y in years) / YEAR
    false = sum(y.false_alarms for y in years)
    rate: dict[str, Any] = {"false_alarms": false, "machine_years": quiet, "per_year": false / max(quiet, 1e-9)}
    rate["interval"] = rate_interval(false, max(quiet, 1e-9))
    return out, rate


def detection_curve(years: Sequence[MachineYear], truth: str, days: np.ndarray) -> np.ndarray:
    """Return the share of machines detected so many days after the beginning, with its interval, shape (n, 3).

    Machines that were not followed for so long count only as long as they were.
    """
    own = [y for y in years if y.truth == truth]
    rows = []
    for day in days:
        at_risk = [y for y in own if y.days - y.begins >= day]
        hits = sum(1 for y in at_risk if y.detected is not None and y.detected <= day)
        share = hits / len(at_risk) if at_risk else float("nan")
        rows.append((share, *(share_interval(hits, len(at_risk)) if at_risk else (np.nan, np.nan))))
    return np.array(rows)
