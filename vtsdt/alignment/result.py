"""The estimated alignment: δ over height by trip, the estimate with its error, and the sections to correct."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.quantity_text import count_text
from vtsdt.alignment.rail import rail_profile
from vtsdt.alignment.sections import ONE_SIDED_95, Section, sections

if TYPE_CHECKING:
    import pandas

    from estimation.filters.observability_gramian import Observability
    from vtsdt.alignment.filter import Tuning

__all__ = ["Alignment"]

_NEIGHBOURS = 0.1  # m to each side: the spread of the trips is averaged over this range of heights
#: Trips from which on their scatter tells how certain their estimate is.
FEWEST_TRIPS = 2
#: Variance of the estimate of Hodges and Lehmann over that of the mean, for normal errors; of the median it is π/2.
_HODGES_LEHMANN = np.pi / 3.0


@dataclass(frozen=True, eq=False, kw_only=True)
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
        Equivalent deviation by trip; NaN where the cabin stood still or did not pass.
    threshold : float, m
    tuning : Tuning
    tension_error : float or None, N
        Estimated from trips both ways and subtracted; None if all trips go the same way.
    shoes : tuple of float, m
        Heights of the shoes above the floor.
    loose : float
        Deviation below which the shoes are loose, m.
    slope : float
        Friction per deviation, N/m.
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
    def estimate(self) -> np.ndarray:
        """Estimate from all trips, shape (n,), m: the median over the means of all pairs of trips.

        It is as robust against a few outlying trips as the median, with a smaller error: for normal errors the
        variances of the median, of this estimate and of the mean are π/2, π/3 and 1 over the number of trips.
        J. L. Hodges, E. L. Lehmann: Estimates of location based on rank tests, Ann. Math. Statist. 34 (1963).
        """
        i, j = np.triu_indices(len(self.curves))
        return _along(np.nanmedian, 0.5 * (self.curves[i] + self.curves[j]))

    @cached_property
    def std(self) -> np.ndarray:
        """Standard deviation of the estimate from the spread of the trips, shape (n,), m.

        The spread is averaged over 0.1 m to each side.  A single trip has no spread; its standard deviation is the
        deviation that 1 N of unknown force amounts to.
        """
        known = np.isfinite(self.curves)
        count = known.sum(axis=0)
        squares = np.where(known, (self.curves - self.estimate) ** 2, 0.0).sum(axis=0)
        near = (np.abs(self.height[:, None] - self.height[None, :]) <= _NEIGHBOURS + 1e-9).astype(float)
        freedom = near @ np.maximum(count - 1, 0)
        with np.errstate(all="ignore"):
            spread = np.sqrt(near @ np.where(count > 1, squares, 0.0) / freedom)
            factor = np.sqrt(np.where(count > 2, _HODGES_LEHMANN, 1.0) / count)
            std = factor * np.where(freedom > 0, spread, 1.0 / self.slope)
        return np.where(count > 0, std, np.nan)

    @cached_property
    def expected_correlation(self) -> float | None:
        """Correlation of the estimate with the guide that follows from the spread of the trips; None below three trips.

        Differences between trips are errors; their share of the estimate's variance over height does not come from the
        guide.  Errors that all trips have in common are not included.
        """
        noise, total = self._variances
        return float(np.sqrt(max(0.0, 1.0 - noise / total))) if len(self.trips) > 2 and total > 0.0 else None

    def trips_for(self, correlation: float) -> int | None:
        """Return how many trips of this spread should give a correlation; None if no number would.

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
        """Variance of the estimate's error and of the estimate over height, both about their means."""
        middle = self.estimate
        shift = np.array([np.nanmean(curve - middle) if np.isfinite(curve).any() else 0.0 for curve in self.curves])
        level = self.curves - shift[:, None]
        count = np.isfinite(level).sum(axis=0)
        full = count > 2
        if not full.any():
            return np.nan, np.nan
        noise = _HODGES_LEHMANN * np.nanvar(level[:, full], axis=0, ddof=1) / count[full]
        return float(np.mean(noise)), float(np.var(middle[full]))

    @cached_property
    def sections(self) -> tuple[Section, ...]:
        """Ranges of height above the threshold, from the bottom up."""
        from scipy.special import ndtr

        result = []
        for low, high in sections(self.height, self.estimate, self.threshold, self.std):
            inside = (self.height >= low) & (self.height <= high)
            k = int(np.nanargmax(np.where(inside, self.estimate, np.nan)))
            largest, std = float(self.estimate[k]), max(float(self.std[k]), 1e-9)
            means = _along(np.nanmean, self.curves[:, inside].T)
            share = float(np.mean(means[np.isfinite(means)] > self.threshold))
            trips = int(np.isfinite(self.curves[:, k]).sum())
            known = trips >= FEWEST_TRIPS
            confidence = float(ndtr((largest - self.threshold) / std)) if known else float("nan")
            result.append(
                Section(
                    low=low, high=high, largest=largest, at=float(self.height[k]), share=share, confidence=confidence
                )
            )
        return tuple(result)

    @cached_property
    def undecided(self) -> tuple[tuple[float, float], ...]:
        """Ranges of height outside the sections where the estimate does not exclude the threshold, m.

        The estimate is below it there, by less than 1.645 standard deviations: 95 % on one side.
        """
        reach = sections(self.height, self.estimate + ONE_SIDED_95 * self.std, self.threshold)
        return tuple((a, b) for a, b in reach if not any(a <= s.high and s.low <= b for s in self.sections))

    @cached_property
    def rail(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A rail that has this equivalent deviation: heights, deviation, standard deviation, m."""
        known = np.isfinite(self.estimate)
        return rail_profile(self.height[known], self.estimate[known], self.std[known], self.shoes)

    def sentences(self) -> list[str]:
        """Return the results, one sentence each."""
        at = self.height[np.isfinite(self.estimate)]
        known = self.estimate[np.isfinite(self.estimate)]
        texts = [
            f"Median deviation {1e3 * np.median(known):.2f} mm, largest {1e3 * known.max():.2f} mm, over "
            f"{at[0]:.2f} to {at[-1]:.2f} m."
        ]
        if self.sections:
            listed = "; ".join(str(s) for s in self.sections)
            texts.append(f"Above {1e3 * self.threshold:.2g} mm: {listed}.")
        else:
            texts.append(f"Nowhere above {1e3 * self.threshold:.2g} mm.")
        if self.undecided:
            listed = ", ".join(f"{a:.2f} to {b:.2f} m" for a, b in self.undecided)
            texts.append(f"Undecided, below it by less than the error of the estimate (95 %): {listed}.")
        expected = self.expected_correlation
        if expected is not None:
            goal = 0.9 if expected < 0.9 else 0.95
            more = self.trips_for(goal)
            texts.append(
                "From the spread of the trips, the expected correlation of the estimate with the guide is "
                f"{expected:.2f}"
                + ("." if more is None or expected >= goal else f"; {goal:g} would take {more} such trips.")
            )
        if self.tension_error is None:
            texts.append(
                "All trips go the same way, so an error of the tension's zero or of the cabin's mass cannot be "
                f"separated from friction: 1 N of it shifts δ by {1e3 / self.slope:.2f} mm everywhere. Record trips "
                "both ways."
            )
        else:
            texts.append(
                f"Trips up and down together show {self.tension_error:+.2f} N that is not friction (zero of the "
                "tension sensor, mass of the cabin); it was subtracted."
            )
        return texts

    def to_frame(self) -> pandas.DataFrame:
        """Return estimate, median, quartiles and trips by height, in mm."""
        import pandas

        data = {
            "estimate [mm]": 1e3 * self.estimate,
            "median [mm]": 1e3 * self.median,
            "lower quartile [mm]": 1e3 * self.quantile(0.25),
            "upper quartile [mm]": 1e3 * self.quantile(0.75),
            "std of the estimate [mm]": 1e3 * self.std,
        }
        data |= {f"{name} [mm]": 1e3 * curve for name, curve in zip(self.trips, self.curves, strict=True)}
        return pandas.DataFrame(data, index=pandas.Index(self.height, name="height [m]"))

    def to_json(self) -> dict[str, Any]:
        """Return all results as lists and numbers; ``profile`` is the input of `vtsdt what-if`."""
        height, delta, spread = self.rail
        observed = self.observability
        return {
            "schema": 1,
            "threshold_mm": 1e3 * self.threshold,
            "tuning": self.tuning.name,
            "tension_error_N": self.tension_error,
            "expected_correlation": None if (e := self.expected_correlation) is None else round(e, 4),
            "height_m": _rounded(self.height),
            "estimate_mm": _rounded(1e3 * self.estimate),
            "median_mm": _rounded(1e3 * self.median),
            "lower_quartile_mm": _rounded(1e3 * self.quantile(0.25)),
            "upper_quartile_mm": _rounded(1e3 * self.quantile(0.75)),
            "std_mm": _rounded(1e3 * self.std),
            "sections": [
                {
                    "from_m": round(s.low, 4),
                    "to_m": round(s.high, 4),
                    "largest_mm": round(1e3 * s.largest, 4),
                    "at_m": round(s.at, 4),
                    "share_of_trips": round(s.share, 4),
                    "confidence": round(s.confidence, 4) if np.isfinite(s.confidence) else None,
                }
                for s in self.sections
            ],
            "undecided": [{"from_m": round(a, 4), "to_m": round(b, 4)} for a, b in self.undecided],
            "trips": [
                {"name": name, "direction": "up" if d > 0 else "down", "delta_mm": _rounded(1e3 * curve)}
                for name, d, curve in zip(self.trips, self.directions, self.curves, strict=True)
            ],
            "profile": {
                "height_m": _rounded(height),
                "delta_mm": _rounded(1e3 * delta),
                "spread_mm": _rounded(1e3 * spread),
            },
            "observability": None
            if observed is None
            else {
                "detectable": observed.detectable,
                "rank": observed.rank,
                "states": len(observed.names),
                "bounded": {name: observed.bounded(name) for name in observed.names},
            },
            "notes": list(self.notes),
        }

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
        axes.plot(self.height, 1e3 * self.median, color="black", linewidth=0.9, linestyle="--", label="median")
        axes.plot(self.height, 1e3 * self.estimate, color="black", linewidth=2.0, label="estimate (pairs of trips)")
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
        """Draw the rail that has this equivalent deviation, with its uncertainty; returns the figure."""
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
        return f"Alignment({count_text(len(self.trips), 'trip')}, above {1e3 * self.threshold:.2g} mm: {listed})"


def _along(function: Any, values: np.ndarray) -> np.ndarray:
    """Apply a NaN-ignoring function over the trips, without a warning where all are NaN."""
    known = np.isfinite(values).any(axis=0)
    out = np.full(values.shape[1], np.nan)
    if known.any():
        out[known] = function(values[:, known], axis=0)
    return out


def _rounded(values: np.ndarray) -> list[float | None]:
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]
