"""How near an estimate of the guide's alignment is to the truth, and what is wrong with which section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vtsdt.alignment.estimate import THRESHOLD, Alignment, sections

__all__ = ["CORRELATION", "HEIGHTS", "RMS", "WRONG", "Score", "WrongSection", "score"]

#: Heights that count, m: those of the paper's Fig. 9.
HEIGHTS = (0.1, 1.8)
#: What an estimate has to reach: correlation, error in m, and sections found that are none or missed, of either kind.
CORRELATION, RMS, WRONG = 0.9, 0.3e-3, 1
Ranges = list[tuple[float, float]]
_NEAR = 0.05  # m: sections that meet within this distance are the same


@dataclass(frozen=True)
class WrongSection:
    """A section that is found and is none, or that is missed.

    Parameters
    ----------
    kind : {"false", "missed"}
    low, high : float, m
        Its range: of the estimate if it is false, of the truth if it is missed.
    true, estimate : float, m
        Largest of both over the range.
    std : float, m
        Standard deviation of the estimate where the estimate is largest.
    undecided : bool
        True if a missed one meets a range that the command lists as undecided.
    """

    kind: Literal["false", "missed"]
    low: float
    high: float
    true: float
    estimate: float
    std: float
    undecided: bool = False

    def reason(self) -> str:
        """Return one sentence with its numbers."""
        off = 1e3 * (self.true - THRESHOLD)
        told = (
            f"{self.kind}, {self.low:.2f} to {self.high:.2f} m: the truth is {abs(off):.2f} mm "
            f"{'beyond' if off > 0.0 else 'below'} the threshold at most, the estimate "
            f"{1e3 * abs(self.estimate - THRESHOLD):.2f} mm {'beyond' if self.estimate > THRESHOLD else 'below'} it, "
            f"with a standard deviation of {1e3 * self.std:.2f} mm"
        )
        if self.kind == "missed":
            told += "; listed as undecided" if self.undecided else "; not listed as undecided"
        return told


@dataclass(frozen=True)
class Score:
    """How near an estimate is to the truth, over the heights that count.

    Parameters
    ----------
    correlation, median : float
        Of the estimate and of the trips' median with the truth.
    rms, level : float, m
        Root mean square and mean of the estimate's error.
    false, missed : int
        Sections found that are none, and sections not found, whatever they are beyond the threshold by.
    farthest : float, m
        How far from the threshold the truth is at the worst of these; zero if there are none.
    right : float
        Share of the heights that are inside a section, or outside all, as they truly are beyond the threshold or not.
    expected : float, optional
        Correlation that the estimate expects from the spread of its trips.
    in_plane : float, optional
        Correlation of the estimate with the sum of both rails' deviations in x alone.
    covered : float, optional
        Share of the heights where the truth is within 1.96 standard deviations of the estimate.
    wrong : tuple of WrongSection
    """

    correlation: float
    median: float
    rms: float
    false: int
    missed: int
    farthest: float = 0.0
    right: float = 1.0
    expected: float | None = None
    in_plane: float | None = None
    level: float = 0.0
    covered: float | None = None
    wrong: tuple[WrongSection, ...] = ()

    @property
    def good(self) -> bool:
        """True if all that is asked for is reached."""
        return not self.short()

    def short(self) -> list[str]:
        """Return what is not reached, in words."""
        told = []
        if not self.correlation >= CORRELATION:
            told.append(f"correlation {self.correlation:.3f}")
        if not self.rms <= RMS:
            told.append(f"error {1e3 * self.rms:.2f} mm")
        told += [f"{n} {kind}" for n, kind in ((self.false, "false"), (self.missed, "missed")) if n > WRONG]
        return told

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Score:
        """Return a score as `dataclasses.asdict` wrote it."""
        return cls(**{**stored, "wrong": tuple(WrongSection(**w) for w in stored["wrong"])})


def score(found: Alignment, height: np.ndarray, truth: np.ndarray, in_plane: np.ndarray | None = None) -> Score:
    """Lay an estimate beside the truth.

    Parameters
    ----------
    found : Alignment
    height, truth : ndarray, shape (n,), m
        The true deviation by the height of the floor.
    in_plane : ndarray, shape (n,), m, optional
        The sum of both rails' deviations in x.
    """
    inside = (found.height >= HEIGHTS[0] - 1e-9) & (found.height <= HEIGHTS[1] + 1e-9) & np.isfinite(found.estimate)
    at, estimate, std = found.height[inside], found.estimate[inside], found.std[inside]
    true = np.interp(at, height, truth)
    ours = sections(at, estimate, THRESHOLD, std)
    theirs = sections(at, true, THRESHOLD)
    wrong: list[WrongSection] = []
    pairs: tuple[tuple[Literal["false", "missed"], Ranges, Ranges], ...] = (
        ("false", ours, theirs), ("missed", theirs, ours),
    )  # fmt: skip
    for kind, these, those in pairs:
        for low, high in _alone(these, those):
            here = (at >= low - 1e-9) & (at <= high + 1e-9)
            k = int(np.argmax(np.where(here, estimate, -np.inf)))
            met = kind == "missed" and any(a <= high + 1e-9 and low - 1e-9 <= b for a, b in found.undecided)
            wrong.append(
                WrongSection(kind, low, high, float(true[here].max()), float(estimate[k]), float(std[k]), met)
            )
    told = np.array([any(low - 1e-9 <= h <= high + 1e-9 for low, high in ours) for h in at])

    def with_truth(values: np.ndarray, other: np.ndarray = true) -> float:
        return float(np.corrcoef(values, other)[0, 1])

    false, missed = (sum(w.kind == kind for w in wrong) for kind in ("false", "missed"))
    return Score(
        with_truth(estimate), with_truth(found.median[inside]), float(np.sqrt(np.mean((estimate - true) ** 2))),
        false, missed, max((abs(w.true - THRESHOLD) for w in wrong), default=0.0),
        float(np.mean(told == (true > THRESHOLD))), found.expected_correlation,
        None if in_plane is None else with_truth(estimate, np.interp(at, height, in_plane)),
        float(np.mean(estimate - true)), float(np.mean(np.abs(estimate - true) < 1.96 * std)), tuple(wrong),
    )  # fmt: skip


def _alone(these: Ranges, those: Ranges) -> Ranges:
    """Return the ranges that none of the others meets."""
    return [(low, high) for low, high in these if not any(low <= y + _NEAR and x - _NEAR <= high for x, y in those)]
