"""Tests of a filter's innovations: whether they are white and as large as the filter predicts.

Y. Bar-Shalom, X. R. Li, T. Kirubarajan: Estimation with Applications to Tracking and Navigation, Wiley 2001,
section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimation.filters.errors import FilterError

__all__ = ["Consistency", "innovation_tests"]

_LAGS = 40


@dataclass(frozen=True, eq=False, kw_only=True)
class Consistency:
    """Tests of a run's innovations.

    Parameters
    ----------
    level : float
        Of the bounds, such as 0.95.
    nis : float
        Mean of the normalised innovation squared over the number of readings of an instant: 1 if the assumptions hold.
    nis_bounds : tuple of float
        Interval in which it lies at the level if the assumptions hold.
    means : dict of str to float
        Mean of each channel's normalised innovations, in standard deviations of that mean.
    autocorrelation : dict of str to ndarray
        Of each channel's normalised innovations at lags 1 to 40.
    whiteness : dict of str to float
        p-value of Ljung and Box's test over these lags.
    """

    level: float
    nis: float
    nis_bounds: tuple[float, float]
    means: dict[str, float]
    autocorrelation: dict[str, np.ndarray] = field(repr=False)
    whiteness: dict[str, float] = field(default_factory=dict)
    count: int = 0

    @property
    def consistent(self) -> bool:
        """True if NIS lies within its bounds and every channel is white at the level."""
        low, high = self.nis_bounds
        return low <= self.nis <= high and all(p >= 1.0 - self.level for p in self.whiteness.values())

    def sentences(self) -> list[str]:
        """Return the outcome of each test as a sentence, with the remedy."""
        low, high = self.nis_bounds
        sentences = []
        if self.nis > high:
            sentences.append(
                f"the innovations are larger than the filter predicts (NIS {self.nis:.3g}, within {low:.3f} to "
                f"{high:.3f} if the assumptions held): raise the process or measurement noise"
            )
        elif self.nis < low:
            sentences.append(
                f"the innovations are smaller than the filter predicts (NIS {self.nis:.3g}, within {low:.3f} to "
                f"{high:.3f} if the assumptions held): its standard deviations are too wide"
            )
        else:
            sentences.append(f"the innovations are as large as the filter predicts (NIS {self.nis:.3f})")
        for name, p in self.whiteness.items():
            if p < 1.0 - self.level:
                rho = self.autocorrelation[name]
                sentences.append(
                    f"the innovations of '{name}' are not white (autocorrelation {rho[0]:.2f} at one sample): filtered "
                    "readings, or a dynamic effect that the model lacks"
                )
        return sentences

    def plot(self, axes: Any = None) -> Any:
        """Draw the autocorrelation of each channel with its bounds; returns the figure."""
        import matplotlib.pyplot as plt
        from scipy.stats import norm

        names = list(self.autocorrelation)
        if axes is None:
            _, grid = plt.subplots(1, len(names), squeeze=False, figsize=(4 * len(names), 2.6), layout="constrained")
            axes = grid[0]
        axes = np.atleast_1d(axes)
        bound = norm.ppf(0.5 + 0.5 * self.level) / np.sqrt(max(self.count, 1))
        for axis, name in zip(axes, names, strict=True):
            rho = self.autocorrelation[name]
            axis.axhspan(-bound, bound, alpha=0.2, label=f"{self.level:.0%} of white noise")
            axis.stem(np.arange(1, rho.size + 1), rho, basefmt=" ", markerfmt=".")
            axis.set_xlabel("lag [samples]")
            axis.set_ylabel("autocorrelation [1]")
            axis.set_title(name, fontsize="medium")
            axis.legend(fontsize="small")
        return axes[0].figure


def innovation_tests(normalised: np.ndarray, channels: Sequence[str], level: float = 0.95) -> Consistency:
    """Test innovations: their size (NIS), their mean, and whether they are white.

    Parameters
    ----------
    normalised : ndarray, shape (k, m)
        Innovations over their standard deviations; NaN where nothing was read.
    channels : sequence of str
        Names of the m measured outputs.
    level : float
        Of the bounds.
    """
    from scipy.stats import chi2

    readings = int(np.isfinite(normalised).sum())
    if readings < 2:
        raise FilterError("consistency", ["the run has fewer than two readings"])
    total = float(np.nansum(normalised**2))
    bounds = chi2.ppf([0.5 - 0.5 * level, 0.5 + 0.5 * level], readings) / readings
    means, autocorrelation, whiteness = {}, {}, {}
    for column, name in enumerate(channels):
        e = normalised[:, column]
        e = e[np.isfinite(e)]
        if e.size < 10:
            continue
        means[name] = float(e.mean() * np.sqrt(e.size))
        lags = min(_LAGS, e.size // 4)
        centred = e - e.mean()
        power = float(centred @ centred)
        rho = np.array([centred[k:] @ centred[:-k] for k in range(1, lags + 1)]) / max(power, 1e-300)
        autocorrelation[name] = rho
        box = e.size * (e.size + 2) * float(np.sum(rho**2 / (e.size - np.arange(1, lags + 1))))
        whiteness[name] = float(chi2.sf(box, lags))
    low, high = map(float, np.asarray(bounds))
    return Consistency(
        level=level,
        nis=total / readings,
        nis_bounds=(low, high),
        means=means,
        autocorrelation=autocorrelation,
        whiteness=whiteness,
        count=len(normalised),
    )
