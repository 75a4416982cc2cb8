"""Latin hypercube designs: SciPy's, its optimised variants, and a maximin one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from surrogate.plots import plot_design
from surrogate.space import DesignSpace

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Design", "latin_hypercube"]

Array = NDArray[np.float64]
Optimisation = Literal["none", "random-cd", "lloyd", "maximin"]
_OPTIMISATIONS = ("none", "random-cd", "lloyd", "maximin")

#: Exponent of the Morris–Mitchell criterion sum d^-p: large enough that the smallest distance decides, small
#: enough that the second smallest still counts (Morris and Mitchell 1995 use up to 50).
_MORRIS_MITCHELL_POWER = 15


@dataclass(frozen=True)
class Design:
    """A sampling plan.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    unit : ndarray, shape (n, k)
        The points, scaled to [0, 1].
    optimisation : str
        How they were spread.
    """

    space: DesignSpace
    unit: Array
    optimisation: str = "none"

    @property
    def points(self) -> Array:
        """The points in the parameters' units, shape (n, k)."""
        return self.space.from_unit(self.unit)

    @property
    def discrepancy(self) -> float:
        """Centred L2 discrepancy (dimensionless; small = evenly spread)."""
        from scipy.stats import qmc

        return float(qmc.discrepancy(self.unit, method="CD"))

    @property
    def min_distance(self) -> float:
        """Smallest distance between two points in the unit cube (dimensionless)."""
        from scipy.spatial.distance import pdist

        return float(pdist(self.unit).min()) if len(self) > 1 else float("inf")

    @property
    def is_latin(self) -> bool:
        """Whether every parameter has exactly one point in each of n equal strata."""
        n = len(self)
        strata = np.minimum((self.unit * n).astype(int), n - 1)
        return bool((np.sort(strata, axis=0) == np.arange(n)[:, None]).all())

    def __len__(self) -> int:
        return int(self.unit.shape[0])

    def __repr__(self) -> str:
        return (
            f"Design({len(self)} points of {', '.join(self.space.names)}; {self.optimisation}, "
            f"discrepancy {self.discrepancy:.3g}, smallest distance {self.min_distance:.3g})"
        )

    def to_frame(self) -> pd.DataFrame:
        """The points, one column for each parameter."""
        return self.space.to_frame(self.points)

    def plot(self) -> Figure:
        """Scatter of every pair of parameters; returns the matplotlib figure."""
        return plot_design(self.space, self.points)


def latin_hypercube(
    space: DesignSpace,
    n: int,
    *,
    optimisation: Optimisation = "random-cd",
    seed: int | np.random.Generator = 0,
) -> Design:
    """Draw a Latin hypercube design.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    n : int
        Number of points.
    optimisation : {"none", "random-cd", "lloyd", "maximin"}
        ``"none"`` is the plain design of the paper. ``"random-cd"`` (SciPy) permutes it to a low centred
        discrepancy and ``"maximin"`` to a large smallest distance; both stay Latin. ``"lloyd"`` (SciPy) moves
        the inner points apart and gives up one point per stratum; with few points in several dimensions
        hardly any point is an inner one.
    seed : int or Generator
        Source of randomness.

    Returns
    -------
    Design

    Raises
    ------
    ValueError
        If ``n`` is below two or the optimisation is unknown.

    Examples
    --------
    >>> latin_hypercube(DesignSpace.unit_cube("ab"), 20, optimisation="maximin", seed=1).is_latin
    True
    """
    if isinstance(n, bool) or int(n) != n or n < 2:
        raise ValueError(f"a design needs a whole number of at least 2 points, not {n}")
    if optimisation not in _OPTIMISATIONS:
        raise ValueError(f"unknown optimisation '{optimisation}'; choose one of {', '.join(_OPTIMISATIONS)}")
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    scheme = optimisation if optimisation in ("random-cd", "lloyd") else None
    unit = np.asarray(qmc.LatinHypercube(len(space), optimization=scheme, rng=rng).random(int(n)))
    if optimisation == "maximin" and len(space) > 1:
        unit = _maximin(unit, rng)
    return Design(space, unit, optimisation)


def _maximin(unit: Array, rng: np.random.Generator) -> Array:
    """Swap two points' entries in one column as long as the Morris–Mitchell criterion falls."""
    n, k = unit.shape
    if n < 3:
        return unit
    x = unit.copy()

    def closeness(point: Array, row: int) -> Array:
        squared = ((x - point) ** 2).sum(axis=1)
        squared[row] = np.inf
        return squared ** (-_MORRIS_MITCHELL_POWER / 2)

    pairs = np.array([closeness(x[i], i) for i in range(n)])
    tries = 60 * n * k
    columns = rng.integers(k, size=tries)
    first = rng.integers(n, size=tries)
    second = (first + 1 + rng.integers(n - 1, size=tries)) % n
    # Half of the attempts start at the point that is worst placed: the others polish the rest.
    for attempt, (c, a, b) in enumerate(zip(columns, first, second, strict=True)):
        if attempt % 2:
            a = int(pairs.sum(axis=1).argmax())
            if a == b:
                continue
        before = pairs[a].sum() + pairs[b].sum() - pairs[a, b]
        x[a, c], x[b, c] = x[b, c], x[a, c]
        row_a, row_b = closeness(x[a], a), closeness(x[b], b)
        if row_a.sum() + row_b.sum() - row_a[b] < before:
            pairs[a, :] = pairs[:, a] = row_a
            pairs[b, :] = pairs[:, b] = row_b
        else:
            x[a, c], x[b, c] = x[b, c], x[a, c]
    return x
