"""How close an estimate of the guide's alignment is to the truth, and which sections are wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vtsdt.alignment.estimate import THRESHOLD
from vtsdt.alignment.result import Alignment
from vtsdt.alignment.sections import sections

__all__ = ["HEIGHTS", "MAX_RMS", "MAX_WRONG", "MIN_CORRELATION", "Score", "score"]

#: Heights that are evaluated, m: those of the paper's Fig. 9.
HEIGHTS = (0.1, 1.8)
#: What an estimate has to reach: correlation, RMS error in m, and number of false and of missed sections.
MIN_CORRELATION, MAX_RMS, MAX_WRONG = 0.9, 0.3e-3, 1
Ranges = list[tuple[float, float]]
_NEAR = 0.05  # m: sections within this distance of each other are the same


@dataclass(frozen=True, kw_only=True)
class WrongSection:
    """A section that is estimated and not true (false), or true and not estimated (missed).

    Parameters
    ----------
    kind : {"false", "missed"}
    low, high : float, m
        Its range: of the estimate if it is false, of the truth if it is missed.
    true, estimate : float, m
        Largest true and largest estimated deviation in the range.
    std : float, m
        Standard deviation of the estimate where the estimate is largest.
    undecided : bool
        True if a missed one meets a range that is listed as undecided.
    """

    kind: Literal["false", "missed"]
    low: float
    high: float
    true: float
    estimate: float
    std: float
    undecided: bool = False

    def sentence(self) -> str:
        """Return one sentence with its numbers."""
        text = (
            f"{self.kind}, {self.low:.2f} to {self.high:.2f} m: the largest true deviation is "
            f"{_from_threshold(self.true)} the threshold, the largest estimate {_from_threshold(self.estimate)} it, "
            f"with a standard deviation of {1e3 * self.std:.2f} mm"
        )
        if self.kind == "missed":
            text += "; listed as undecided" if self.undecided else "; not listed as undecided"
        return text


def _from_threshold(deviation: float) -> str:
    distance = 1e3 * (deviation - THRESHOLD)
    return f"{abs(distance):.2f} mm {'above' if distance > 0.0 else 'below'}"


@dataclass(frozen=True, kw_only=True)
class Score:
    """How close an estimate is to the truth, over the heights that are evaluated.

    Parameters
    ----------
    correlation, median_correlation : float
        Of the estimate, and of the median over the trips, with the truth.
    rms, mean_error : float, m
        Root mean square and mean of the estimate's error.
    false, missed : int
        Sections that are estimated and not true, and true and not estimated, however small the excess.
    farthest : float, m
        Largest distance of the truth from the threshold among these; zero if there are none.
    agreement : float
        Share of the heights that are inside a section, or outside, as they truly are above the threshold or not.
    expected_correlation : float, optional
        Correlation that the estimate expects from the spread of its trips.
    in_plane_correlation : float, optional
        Correlation of the estimate with the sum of both rails' deviations in x alone.
    coverage : float, optional
        Share of the heights where the truth is within 1.96 standard deviations of the estimate.
    wrong : tuple of WrongSection
    """

    correlation: float
    median_correlation: float
    rms: float
    false: int
    missed: int
    farthest: float = 0.0
    agreement: float = 1.0
    expected_correlation: float | None = None
    in_plane_correlation: float | None = None
    mean_error: float = 0.0
    coverage: float | None = None
    wrong: tuple[WrongSection, ...] = ()

    @property
    def passed(self) -> bool:
        """True if the estimate reaches everything that is required."""
        return not self.shortfalls()

    def shortfalls(self) -> list[str]:
        """Return what is not reached, in words."""
        texts = []
        if not self.correlation >= MIN_CORRELATION:
            texts.append(f"correlation {self.correlation:.3f}")
        if not self.rms <= MAX_RMS:
            texts.append(f"error {1e3 * self.rms:.2f} mm")
        texts += [f"{n} {kind}" for n, kind in ((self.false, "false"), (self.missed, "missed")) if n > MAX_WRONG]
        return texts

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Score:
        """Return a score from the content of `dataclasses.asdict`."""
        return cls(**{**stored, "wrong": tuple(WrongSection(**w) for w in stored["wrong"])})


def score(alignment: Alignment, height: np.ndarray, truth: np.ndarray, in_plane: np.ndarray | None = None) -> Score:
    """Compare an estimate with the truth.

    Parameters
    ----------
    alignment : Alignment
    height, truth : ndarray, shape (n,), m
        The true deviation by the height of the floor.
    in_plane : ndarray, shape (n,), m, optional
        The sum of both rails' deviations in x.
    """
    inside = (
        (alignment.height >= HEIGHTS[0] - 1e-9)
        & (alignment.height <= HEIGHTS[1] + 1e-9)
        & np.isfinite(alignment.estimate)
    )
    at, estimate, std = alignment.height[inside], alignment.estimate[inside], alignment.std[inside]
    true = np.interp(at, height, truth)
    estimated_sections = sections(at, estimate, THRESHOLD, std)
    true_sections = sections(at, true, THRESHOLD)
    wrong: list[WrongSection] = []
    pairs: tuple[tuple[Literal["false", "missed"], Ranges, Ranges], ...] = (
        ("false", estimated_sections, true_sections),
        ("missed", true_sections, estimated_sections),
    )
    for kind, ranges, others in pairs:
        for low, high in _without_counterpart(ranges, others):
            here = (at >= low - 1e-9) & (at <= high + 1e-9)
            k = int(np.argmax(np.where(here, estimate, -np.inf)))
            undecided = kind == "missed" and any(a <= high + 1e-9 and low - 1e-9 <= b for a, b in alignment.undecided)
            wrong.append(
                WrongSection(
                    kind=kind,
                    low=low,
                    high=high,
                    true=float(true[here].max()),
                    estimate=float(estimate[k]),
                    std=float(std[k]),
                    undecided=undecided,
                )
            )
    in_section = np.array([any(low - 1e-9 <= h <= high + 1e-9 for low, high in estimated_sections) for h in at])

    def correlation(values: np.ndarray, other: np.ndarray = true) -> float:
        return float(np.corrcoef(values, other)[0, 1])

    return Score(
        correlation=correlation(estimate),
        median_correlation=correlation(alignment.median[inside]),
        rms=float(np.sqrt(np.mean((estimate - true) ** 2))),
        false=sum(w.kind == "false" for w in wrong),
        missed=sum(w.kind == "missed" for w in wrong),
        farthest=max((abs(w.true - THRESHOLD) for w in wrong), default=0.0),
        agreement=float(np.mean(in_section == (true > THRESHOLD))),
        expected_correlation=alignment.expected_correlation,
        in_plane_correlation=(None if in_plane is None else correlation(estimate, np.interp(at, height, in_plane))),
        mean_error=float(np.mean(estimate - true)),
        coverage=float(np.mean(np.abs(estimate - true) < 1.96 * std)),
        wrong=tuple(wrong),
    )


def _without_counterpart(ranges: Ranges, others: Ranges) -> Ranges:
    """Return the ranges that none of the others meets."""
    return [(low, high) for low, high in ranges if not any(low <= y + _NEAR and x - _NEAR <= high for x, y in others)]
