"""The error of estimates against known states (NEES), for simulated runs.

Y. Bar-Shalom, X. R. Li, T. Kirubarajan: Estimation with Applications to Tracking and Navigation, Wiley 2001,
section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.run import Estimate

__all__ = ["Nees", "nees"]


@dataclass(frozen=True, eq=False)
class Nees:
    """Normalised estimation error squared over time, averaged over runs.

    Parameters
    ----------
    times : ndarray, shape (k,), s
    values : ndarray, shape (k,)
        Mean over the runs, divided by the number of states: 1 if the assumptions hold.
    bounds : tuple of float
        Interval in which an instant's value lies at the level.
    inside : float
        Share of the instants within them.
    """

    times: np.ndarray
    values: np.ndarray
    bounds: tuple[float, float]
    inside: float


def nees(
    estimates: Sequence[Estimate],
    truths: Sequence[np.ndarray],
    states: Sequence[str] | None = None,
    level: float = 0.95,
) -> Nees:
    """Compare estimates with the truth of simulated runs.

    Parameters
    ----------
    estimates : sequence of Estimate
        Independent runs with their covariances kept.
    truths : sequence of ndarray, shape (k, n)
        The true states (latent quantities as additions to their targets).
    states : sequence of str, optional
        Only these; default: all.
    """
    from scipy.stats import chi2

    model = estimates[0].model
    chosen = [model.index(name) for name in (states or model.state_names)]
    total = np.zeros(len(estimates[0].times))
    for estimate, truth in zip(estimates, truths, strict=True):
        if estimate.covariances is None:
            raise FilterError("nees", ['the covariances were not kept: run the filter with keep="covariances"'])
        e = (estimate.states - truth)[:, chosen]
        p = estimate.covariances[:, chosen][:, :, chosen]
        total += np.einsum("ki,ki->k", e, np.linalg.solve(p, e[:, :, None])[:, :, 0])
    dof = len(chosen) * len(estimates)
    values = total / dof
    low, high = (float(b) / dof for b in np.asarray(chi2.ppf([0.5 - 0.5 * level, 0.5 + 0.5 * level], dof)))
    inside = float(np.mean((values >= low) & (values <= high)))
    return Nees(estimates[0].times, values, (low, high), inside)
