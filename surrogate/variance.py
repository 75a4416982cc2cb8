"""Shares of the response's variance (Sobol indices), by SciPy."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation import evaluate
from surrogate.plots import plot_sobol
from surrogate.sensitivity import select_names
from surrogate.space import DesignSpace

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["SobolResult", "sobol"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SobolResult:
    """Variance shares with parameters uniform over their ranges.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    first, total : ndarray, shape (k,)
        Share of a parameter alone, and with everything it interacts in (dimensionless).
    first_interval, total_interval : ndarray, shape (k, 2)
        Bootstrap intervals.
    evaluations : int
    """

    space: DesignSpace
    first: Array
    total: Array
    first_interval: Array
    total_interval: Array
    evaluations: int

    def select(self, share: float = 0.1) -> tuple[str, ...]:
        """Parameters whose total share is at least this share of the largest, strongest first."""
        return select_names(self.space.names, self.total, share)

    def to_frame(self) -> pd.DataFrame:
        """Shares with their intervals, strongest total first."""
        import pandas as pd

        frame = pd.DataFrame(
            {
                "first": self.first,
                "first_low": self.first_interval[:, 0],
                "first_high": self.first_interval[:, 1],
                "total": self.total,
                "total_low": self.total_interval[:, 0],
                "total_high": self.total_interval[:, 1],
            },
            index=pd.Index(self.space.names, name="parameter"),
        )
        return frame.sort_values("total", ascending=False)

    def plot(self) -> Figure:
        """Bars of first and total shares; returns the figure."""
        return plot_sobol(self.space.names, (self.first, self.first_interval), (self.total, self.total_interval))


def sobol(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    samples: int = 1024,
    confidence: float = 0.95,
    seed: int | np.random.Generator = 0,
    vectorised: bool | None = None,
    executor: Executor | None = None,
) -> SobolResult:
    """Sobol indices by Saltelli's estimator at ``samples * (k + 2)`` evaluations: meant for a surface.

    Parameters
    ----------
    f, vectorised, executor
        As in :func:`surrogate.evaluate`; every evaluation must succeed.
    space : DesignSpace
        The parameters.
    samples : int
        A power of two.
    confidence : float
        Of the bootstrap intervals.
    seed : int or Generator
        Source of randomness.

    Raises
    ------
    ValueError
        If the response does not vary or some evaluations fail.
    """
    if samples < 2 or samples & (samples - 1):
        raise ValueError(f"Sobol indices need a power of two of samples (such as 1024), not {samples}")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie between 0 and 1, not {confidence}")
    from scipy.stats import sobol_indices, uniform

    count = 0

    def columns(t: Array) -> Array:
        nonlocal count
        points = space.from_unit(t.reshape(len(space), -1).T)
        y = evaluate(f, space, points, vectorised=vectorised, executor=executor)
        count += len(y)
        failed = int(np.isnan(y).sum())
        if failed:
            raise ValueError(
                f"the function failed (not a finite number) at {failed} of {len(y)} points: the estimator "
                "needs all of them; fit a response surface to those that succeed and analyse that"
            )
        if np.ptp(y) <= 1e-13 * np.abs(y).max():
            raise ValueError(
                f"the response is {y[0]:.6g} everywhere: there is no variance to divide among the parameters"
            )
        return y.reshape(1, *t.shape[1:])

    rng = np.random.default_rng(seed)
    indices = sobol_indices(func=columns, n=samples, dists=cast(Any, [uniform()] * len(space)), rng=rng)
    spread = indices.bootstrap(confidence_level=confidence)
    return SobolResult(
        space=space,
        first=np.ravel(indices.first_order),
        total=np.ravel(indices.total_order),
        first_interval=_interval(spread.first_order),
        total_interval=_interval(spread.total_order),
        evaluations=count,
    )


def _interval(bootstrap: Any) -> Array:
    bounds = bootstrap.confidence_interval
    return np.column_stack([np.ravel(bounds.low), np.ravel(bounds.high)])
