"""How large a change is, with its interval, and whether it came at once or grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["ChangeSize", "change_size"]

#: Records on either side from which a size is stated.
FEWEST = 2
#: Difference of BIC from which the shape counts as known ("positive" evidence, Kass and Raftery 1995).
KNOWN = 2.0


@dataclass(frozen=True, kw_only=True)
class ChangeSize:
    """A change of a series.

    Parameters
    ----------
    size, std : float
        Mean since the change minus mean before, or for one that grows the value at its end, and its deviation.
    shape : {"at once", "growing", "not known"}
    per_day : float
        Growth, for one that grows; else 0.
    """

    size: float
    std: float
    shape: str
    per_day: float

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the size."""
        return self.size - 1.96 * self.std, self.size + 1.96 * self.std


def change_size(times: np.ndarray, values: np.ndarray, since: int, first: int = 0) -> ChangeSize:
    """Return the size and shape of a change, by least squares of a step and of a ramp.

    Parameters
    ----------
    times : ndarray, shape (n,), s
    values : ndarray, shape (n,)
    since : int
        Index of the first record after the change.
    first : int
        Index of the first record of the level before it.
    """
    t, y = np.asarray(times, dtype=float)[first:], np.asarray(values, dtype=float)[first:]
    at = since - first
    known = np.isfinite(y)
    after = np.arange(y.size) >= at
    if min(np.count_nonzero(known & ~after), np.count_nonzero(known & after)) < FEWEST:
        return ChangeSize(size=float("nan"), std=float("inf"), shape="not known", per_day=0.0)
    begin = 0.5 * (t[at - 1] + t[at])
    length = max(float(t[-1] - begin), 1e-9)
    fits = {}
    for shape, column in (("at once", after.astype(float)), ("growing", np.clip((t - begin) / length, 0.0, None))):
        x = np.column_stack([np.ones(y.size), column])[known]
        solution, *_ = np.linalg.lstsq(x, y[known], rcond=None)
        rest = y[known] - x @ solution
        dof = max(rest.size - 2, 1)
        variance = float(rest @ rest) / dof
        covariance = np.linalg.pinv(x.T @ x) * variance
        fits[shape] = float(rest @ rest), float(solution[1]), float(np.sqrt(covariance[1, 1]))
    count = int(np.count_nonzero(known))
    apart = count * np.log(max(fits["at once"][0], 1e-300) / max(fits["growing"][0], 1e-300))
    shape = "not known" if abs(apart) < KNOWN else ("growing" if apart > 0.0 else "at once")
    _, size, std = fits["growing" if shape == "growing" else "at once"]
    growth = size / (length / 86400.0) if shape == "growing" else 0.0
    return ChangeSize(size=size, std=std, shape=shape, per_day=growth)
