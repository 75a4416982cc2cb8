"""What the alignment sensor found: δ over height for each trip, their median and spread, sections to correct."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

    from estimation.filters import Observability
    from vtsdt.alignment_filter import Tuning

__all__ = ["Alignment", "Section", "equivalent_deviation", "rail_profile", "sections"]

_JOIN = 0.03  # m: sections nearer to each other are one
_SHORTEST = 0.02  # m


@dataclass(frozen=True)
class Section:
    """A range of heights where the deviation is beyond the threshold.

    Parameters
    ----------
    low, high : float, m
    largest, at : float, m
        Largest median deviation, and where.
    share : float
        Of the trips whose mean deviation over the range is beyond the threshold.
    """

    low: float
    high: float
    largest: float
    at: float
    share: float = 1.0

    def __str__(self) -> str:
        return f"{self.low:.2f} to {self.high:.2f} m (up to {1e3 * self.largest:.2f} mm at {self.at:.2f} m)"


def sections(height: np.ndarray, deviation: np.ndarray, threshold: float) -> list[tuple[float, float]]:
    """Return the ranges of height where a deviation is beyond a threshold.

    Ranges less than 30 mm apart are one, and ranges shorter than 20 mm are left out.

    Parameters
    ----------
    height, deviation : ndarray, shape (n,), m
        NaN where nothing is known.
    threshold : float, m

    Examples
    --------
    >>> h = np.linspace(0.0, 1.0, 101)
    >>> [(round(a, 2), round(b, 2)) for a, b in sections(h, np.where(abs(h - 0.5) < 0.105, 3e-3, 1e-3), 2.3e-3)]
    [(0.4, 0.6)]
    """
    above = np.nan_to_num(deviation, nan=-np.inf) > threshold
    edges = np.diff(np.concatenate([[0], above.astype(int), [0]]))
    found: list[list[float]] = []
    for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
        if found and height[a] - found[-1][1] < _JOIN:
            found[-1][1] = float(height[b])
        else:
            found.append([float(height[a]), float(height[b])])
    return [(a, b) for a, b in found if b - a >= _SHORTEST - 1e-12]


def equivalent_deviation(rails: dict[str, Any], shoes: Sequence[float], height: np.ndarray) -> np.ndarray:
    """Return the deviation of a single rail that presses the shoes as both rails do, by the cabin's height.

    With all four shoes in contact each level of shoes is squeezed by the sum of its two rails' deviations, and the
    normal forces add up to the mean of the levels.

    Parameters
    ----------
    rails : dict of str to Profile
        ``left_x`` and ``right_x``; one that is missing is straight.
    shoes : sequence of float, m
        Heights of the shoes above the floor.
    height : ndarray, shape (n,), m
    """
    used = [rails[name] for name in ("left_x", "right_x") if rails.get(name) is not None]
    return np.array([np.mean([sum(r.at(h + s) for r in used) for s in shoes]) if used else 0.0 for h in height])


def rail_profile(
    height: np.ndarray, deviation: np.ndarray, std: np.ndarray, shoes: Sequence[float], *, length: float = 0.15,
    size: float = 0.5e-3, step: float = 0.02,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return a rail whose equivalent deviation is the given one: heights, deviation, standard deviation.

    Two levels of shoes see the rail's mean at two heights, so waves of twice their distance cannot be told: the
    answer is the mean of a Gaussian process (Matérn-3/2) given the equivalent deviation, whose own standard
    deviation says where the rail remains unknown.

    Parameters
    ----------
    height, deviation, std : ndarray, shape (n,), m
        Equivalent deviation by the cabin's height, and how sure it is.
    shoes : sequence of float, m
    length, size : float, m
        Correlation length and size of the rail's deviations about their mean.
    step : float, m
        Between the heights of the result.
    """
    low, high = height[0] + min(shoes), height[-1] + max(shoes)
    points = np.linspace(low, high, int(np.ceil((high - low) / step)) + 1)

    def covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        apart = np.sqrt(3.0) * np.abs(a[:, None] - b[None, :]) / length
        return size**2 * (1.0 + apart) * np.exp(-apart)

    levels = [height + s for s in shoes]
    k_yy = np.mean([covariance(a, b) for a in levels for b in levels], axis=0)
    k_xy = np.mean([covariance(points, b) for b in levels], axis=0)
    noise = np.diag(np.maximum(std, 0.02e-3) ** 2)
    middle = float(np.mean(deviation))
    weights = np.linalg.solve(k_yy + noise, np.column_stack([deviation - middle, k_xy.T]))
    mean = middle + k_xy @ weights[:, 0]
    variance = size**2 - np.einsum("ij,ji->i", k_xy, weights[:, 1:])
    return points, mean, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True, eq=False)
class Alignment:
    """The estimated alignment of the cabin's guides.

    Parameters
    ----------
    height : ndarray, shape (n,), m
        Of the cabin's floor.
    trips : tuple of str
    directions : ndarray of int, shape (k,)
        1 up, -1 down.
    curves : ndarray, shape (k, n), m
        Equivalent deviation by trip; NaN where the cabin stood, or did not come.
    threshold : float, m
    tuning : Tuning
    tension_error : float or None, N
        Found from trips of both directions and taken off; None if all trips went the same way.
    shoes : tuple of float, m
        Heights of the shoes above the floor.
    loose : float
        Deviation below which the shoes are loose, m.
    slope : float
        Friction for a deviation, N/m.
    observability : Observability, optional
        Of the first trip.
    notes : tuple of str
    """

    height: np.ndarray
    trips: tuple[str, ...]
    directions: np.ndarray
    curves: np.ndarray
    threshold: float
    tuning: Tuning
    tension_error: float | None
    shoes: tuple[float, ...]
    loose: float
    slope: float
    observability: Observability | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    @cached_property
    def median(self) -> np.ndarray:
        """Median of the trips, shape (n,), m."""
        return _along(np.nanmedian, self.curves)

    def quantile(self, share: float) -> np.ndarray:
        """Return a quantile of the trips, shape (n,), m."""
        return _along(lambda x, axis: np.nanquantile(x, share, axis=axis), self.curves)

    @cached_property
    def std(self) -> np.ndarray:
        """Standard deviation of the median, from the spread of the trips, shape (n,), m."""
        spread = 1.4826 * _along(np.nanmedian, np.abs(self.curves - self.median))
        count = np.maximum(np.isfinite(self.curves).sum(axis=0), 1)
        return 1.2533 * spread / np.sqrt(count)

    @cached_property
    def expected_correlation(self) -> float | None:
        """Correlation of the median with the guide, as far as the spread of the trips tells; None below three trips.

        What varies from trip to trip is error; of the median's variance over height that share is no guide.  Errors
        that all trips have in common do not show here.
        """
        noise, total = self._variances
        return float(np.sqrt(max(0.0, 1.0 - noise / total))) if len(self.trips) > 2 and total > 0.0 else None

    def trips_for(self, correlation: float) -> int | None:
        """Return how many trips of this spread should bring a correlation; None if no number would.

        Parameters
        ----------
        correlation : float
            Between 0 and 1.
        """
        noise, total = self._variances
        if len(self.trips) < 3 or not 0.0 < noise < total:
            return None
        allowed = (total - noise) * (1.0 / correlation**2 - 1.0)
        return int(np.ceil(len(self.trips) * noise / allowed - 1e-9))

    @cached_property
    def _variances(self) -> tuple[float, float]:
        """Variance of the median's error and of the median over height, both about their means."""
        middle = self.median
        off = np.array([np.nanmean(curve - middle) if np.isfinite(curve).any() else 0.0 for curve in self.curves])
        level = self.curves - off[:, None]
        count = np.isfinite(level).sum(axis=0)
        full = count > 2
        if not full.any():
            return np.nan, np.nan
        # A median of normal errors has π/2 times the variance of the mean.
        noise = 0.5 * np.pi * np.nanvar(level[:, full], axis=0, ddof=1) / count[full]
        return float(np.mean(noise)), float(np.var(middle[full]))

    @cached_property
    def sections(self) -> tuple[Section, ...]:
        """Ranges of height beyond the threshold, from the bottom up."""
        found = []
        for low, high in sections(self.height, self.median, self.threshold):
            inside = (self.height >= low) & (self.height <= high)
            k = int(np.nanargmax(np.where(inside, self.median, np.nan)))
            means = _along(np.nanmean, self.curves[:, inside].T)
            share = float(np.mean(means[np.isfinite(means)] > self.threshold))
            found.append(Section(low, high, float(self.median[k]), float(self.height[k]), share))
        return tuple(found)

    @cached_property
    def rail(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A rail that has this equivalent deviation: heights, deviation, standard deviation, m."""
        known = np.isfinite(self.median)
        return rail_profile(self.height[known], self.median[known], self.std[known], self.shoes)

    def sentences(self) -> list[str]:
        """Return what was found, one sentence each."""
        known = self.median[np.isfinite(self.median)]
        told = [
            f"Median deviation {1e3 * np.median(known):.2f} mm, largest {1e3 * known.max():.2f} mm, over "
            f"{self.height[np.isfinite(self.median)][0]:.2f} to {self.height[np.isfinite(self.median)][-1]:.2f} m."
        ]
        if self.sections:
            listed = "; ".join(str(s) for s in self.sections)
            told.append(f"Beyond {1e3 * self.threshold:.2g} mm: {listed}.")
        else:
            told.append(f"Nowhere beyond {1e3 * self.threshold:.2g} mm.")
        expected = self.expected_correlation
        if expected is not None:
            goal = 0.9 if expected < 0.9 else 0.95
            more = self.trips_for(goal)
            told.append(
                f"As far as the spread of the trips tells, the median follows the guide with a correlation of "
                f"{expected:.2f}"
                + ("." if more is None or expected >= goal else f"; {goal:g} would take {more} trips like these.")
            )
        if self.tension_error is None:
            told.append(
                "All trips go the same way, so an error of the tension's zero or of the cabin's mass cannot be told "
                f"from friction: 1 N of it moves δ by {1e3 / self.slope:.2f} mm everywhere. Record trips both ways."
            )
        else:
            told.append(
                f"Trips up and down together show {self.tension_error:+.2f} N that is not friction (zero of the "
                "tension sensor, mass of the cabin); it was taken off."
            )
        return told

    def to_frame(self) -> pandas.DataFrame:
        """Return median, quartiles and trips by height, in mm."""
        import pandas

        data = {
            "median [mm]": 1e3 * self.median, "lower quartile [mm]": 1e3 * self.quantile(0.25),
            "upper quartile [mm]": 1e3 * self.quantile(0.75), "std of the median [mm]": 1e3 * self.std,
        }  # fmt: skip
        data |= {f"{name} [mm]": 1e3 * curve for name, curve in zip(self.trips, self.curves, strict=True)}
        return pandas.DataFrame(data, index=pandas.Index(self.height, name="height [m]"))

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain lists and numbers; ``profile`` is what `vtsdt what-if` takes."""
        height, delta, spread = self.rail
        seen = self.observability
        return {
            "schema": 1,
            "threshold_mm": 1e3 * self.threshold,
            "tuning": self.tuning.name,
            "tension_error_N": self.tension_error,
            "expected_correlation": None if (e := self.expected_correlation) is None else round(e, 4),
            "height_m": _rounded(self.height),
            "median_mm": _rounded(1e3 * self.median),
            "lower_quartile_mm": _rounded(1e3 * self.quantile(0.25)),
            "upper_quartile_mm": _rounded(1e3 * self.quantile(0.75)),
            "std_mm": _rounded(1e3 * self.std),
            "sections": [
                {"from_m": round(s.low, 4), "to_m": round(s.high, 4), "largest_mm": round(1e3 * s.largest, 4),
                 "at_m": round(s.at, 4), "share_of_trips": round(s.share, 4)}
                for s in self.sections
            ],
            "trips": [
                {"name": name, "direction": "up" if d > 0 else "down", "delta_mm": _rounded(1e3 * curve)}
                for name, d, curve in zip(self.trips, self.directions, self.curves, strict=True)
            ],
            "profile": {"height_m": _rounded(height), "delta_mm": _rounded(1e3 * delta),
                        "spread_mm": _rounded(1e3 * spread)},
            "observability": None if seen is None else {
                "detectable": seen.detectable, "rank": seen.rank, "states": len(seen.names),
                "bounded": {name: seen.bounded(name) for name in seen.names},
            },
            "notes": list(self.notes),
        }  # fmt: skip

    def plot(self, axes: Any = None, truth: np.ndarray | None = None) -> Any:
        """Draw δ over height: trips, median, quartiles, threshold (Fig. 9 of the paper); returns the figure.

        Parameters
        ----------
        axes : matplotlib axes, optional
        truth : ndarray, shape (n,), m, optional
            True equivalent deviation, where it is known.
        """
        import matplotlib.pyplot as plt

        if axes is None:
            _, axes = plt.subplots(figsize=(8, 4), layout="constrained")
        for direction, colour, label in ((1, "tab:blue", "trips up"), (-1, "tab:green", "trips down")):
            for k, curve in enumerate(self.curves[self.directions == direction]):
                axes.plot(
                    self.height, 1e3 * curve, color=colour, linewidth=0.5, alpha=0.6, label=label if k == 0 else None
                )
        quartiles = 1e3 * self.quantile(0.25), 1e3 * self.quantile(0.75)
        axes.fill_between(self.height, *quartiles, color="0.6", alpha=0.5, label="middle half of the trips")
        axes.plot(self.height, 1e3 * self.median, color="black", linewidth=2.0, label="median")
        if truth is not None:
            axes.plot(self.height, 1e3 * truth, color="tab:red", linestyle="--", linewidth=1.5, label="truth")
        axes.axhline(1e3 * self.threshold, color="0.4", linestyle=":", label=f"threshold {1e3 * self.threshold:.2g} mm")
        for section in self.sections:
            axes.axvspan(section.low, section.high, color="tab:orange", alpha=0.15, linewidth=0)
        shown = np.concatenate([1e3 * self.median, *quartiles, [1e3 * self.threshold]])
        shown = shown[np.isfinite(shown)]
        margin = 0.35 * (shown.max() - shown.min()) + 0.1
        axes.set_ylim(shown.min() - margin, shown.max() + margin)
        axes.set_xlabel("height of the cabin floor [m]")
        axes.set_ylabel("equivalent deviation δ [mm]")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", ncols=2)
        return axes.figure

    def plot_rail(self, axes: Any = None) -> Any:
        """Draw the rail that has this equivalent deviation, with what remains unknown of it; returns the figure."""
        import matplotlib.pyplot as plt

        if axes is None:
            _, axes = plt.subplots(figsize=(8, 3), layout="constrained")
        height, delta, std = (np.asarray(v) for v in self.rail)
        band = 1e3 * (delta - 2 * std), 1e3 * (delta + 2 * std)
        axes.fill_between(height, *band, alpha=0.25, label="±2 standard deviations")
        axes.plot(height, 1e3 * delta, label="right rail, the left one straight")
        axes.set_xlabel("height on the rail [m]")
        axes.set_ylabel("deviation of the rail [mm]")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
        return axes.figure

    def __repr__(self) -> str:
        listed = "; ".join(f"{s.low:.2f} to {s.high:.2f} m" for s in self.sections) or "nowhere"
        return f"Alignment({len(self.trips)} trips, beyond {1e3 * self.threshold:.2g} mm: {listed})"


def _along(function: Any, values: np.ndarray) -> np.ndarray:
    """Apply a NaN-ignoring function over the trips without a word where all are NaN."""
    known = np.isfinite(values).any(axis=0)
    out = np.full(values.shape[1], np.nan)
    if known.any():
        out[known] = function(values[:, known], axis=0)
    return out


def _rounded(values: np.ndarray) -> list[float | None]:
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]
