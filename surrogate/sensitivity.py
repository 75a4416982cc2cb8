"""Which parameters matter: one at a time (the gearbox paper's Eq. 9) and Morris's elementary effects."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation import evaluate
from surrogate.plots import plot_morris, plot_one_at_a_time
from surrogate.space import DesignSpace, SurrogateWarning

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["MorrisResult", "OneAtATimeResult", "morris", "one_at_a_time", "select_names"]

Array = NDArray[np.float64]


def select_names(names: tuple[str, ...], scores: Array, share: float) -> tuple[str, ...]:
    """Names whose score is at least a share of the largest, strongest first."""
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share must lie between 0 and 1, not {share}")
    order = np.argsort(-np.nan_to_num(scores), kind="stable")
    threshold = share * float(np.nanmax(scores))
    return tuple(names[i] for i in order if scores[i] >= threshold and scores[i] > 0.0)


@dataclass(frozen=True, kw_only=True)
class OneAtATimeResult:
    """Response when one parameter moves and the others stay.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    base : ndarray, shape (k,)
        Where the others stay, in the parameters' units.
    base_response : float
        Response there.
    levels : ndarray, shape (m,)
        Scaled values of the moving parameter.
    responses : ndarray, shape (k, m)
        NaN where the function failed.
    slopes : ndarray, shape (k,)
        Eq. 9 at the base, by central differences of the scaled parameter: response per full range.
    evaluations : int
    """

    space: DesignSpace
    base: Array
    base_response: float
    levels: Array
    responses: Array
    slopes: Array
    evaluations: int

    @property
    def ranges(self) -> Array:
        """Largest minus smallest response over each parameter's range, the base included, shape (k,)."""
        seen = np.column_stack([self.responses, np.full(len(self.space), self.base_response)])
        return np.asarray(np.nanmax(seen, axis=1) - np.nanmin(seen, axis=1))

    def select(self, share: float = 0.1) -> tuple[str, ...]:
        """Parameters whose range is at least this share of the largest, strongest first (Eq. 10)."""
        return select_names(self.space.names, self.ranges, share)

    def to_frame(self) -> pd.DataFrame:
        """Range and slope of each parameter, strongest first."""
        import pandas as pd

        frame = pd.DataFrame(
            {
                "range": self.ranges,
                "slope_at_base": self.slopes,
                "slope_per_unit": self.slopes / self.space.span,
            },
            index=pd.Index(self.space.names, name="parameter"),
        )
        return frame.sort_values("range", ascending=False)

    def plot(self) -> Figure:
        """Response over each parameter's range, as Fig. 8 of the paper; returns the figure."""
        return plot_one_at_a_time(self.space.names, self.levels, self.responses)


def one_at_a_time(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    base: Mapping[str, float] | None = None,
    levels: int = 11,
    step: float = 0.01,
    vectorised: bool | None = None,
    executor: Executor | None = None,
) -> OneAtATimeResult:
    """Move one parameter at a time over its range, and differentiate at the base (Eq. 9).

    Cheap and easy to read, but it sees neither what two parameters do together nor anything away from the
    base: :func:`morris` and :func:`surrogate.sobol` do.

    Parameters
    ----------
    f, vectorised, executor
        As in :func:`surrogate.evaluate`.
    space : DesignSpace
        The parameters.
    base : mapping, optional
        Values of the parameters that stay; the middle of the range where not given.
    levels : int
        Points over each range, at least 2.
    step : float
        Step of the derivative as a share of the range; one-sided at a bound.
    """
    if levels < 2:
        raise ValueError(f"one-at-a-time needs at least 2 levels, not {levels}")
    if not 0.0 < step <= 0.5:
        raise ValueError(f"step must lie in (0, 0.5], not {step}")
    k = len(space)
    point = space.from_unit(np.full(k, 0.5))
    unknown = sorted(set(base or {}) - set(space.names))
    if unknown:
        raise ValueError(f"base names {', '.join(unknown)}, which the space lacks; it has {', '.join(space.names)}")
    for name, value in (base or {}).items():
        point[space.names.index(name)] = value
    centre = space.to_unit(point, inside=True)[0]
    grid = np.linspace(0.0, 1.0, levels)
    rows = [centre]
    for i in range(k):
        for value in (*grid, max(centre[i] - step, 0.0), min(centre[i] + step, 1.0)):
            row = centre.copy()
            row[i] = value
            rows.append(row)
    unit = np.array(rows)
    y = evaluate(f, space, space.from_unit(unit), vectorised=vectorised, executor=executor)
    if not np.isfinite(y[0]):
        raise ValueError(f"the function failed at the base {dict(zip(space.names, point.tolist(), strict=True))}")
    blocks = y[1:].reshape(k, levels + 2)
    ends = unit[1:].reshape(k, levels + 2, k)[np.arange(k), :, np.arange(k)][:, levels:]
    slopes = (blocks[:, -1] - blocks[:, -2]) / (ends[:, 1] - ends[:, 0])
    _warn_of_failures(y)
    return OneAtATimeResult(
        space=space,
        base=point,
        base_response=float(y[0]),
        levels=grid,
        responses=blocks[:, :levels],
        slopes=slopes,
        evaluations=len(y),
    )


@dataclass(frozen=True)
class MorrisResult:
    """Elementary effects: change of the response over a parameter's full range, met at many places.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    effects : ndarray, shape (r, k)
        One for each trajectory and parameter, in the response's unit per full range; NaN where one failed.
    evaluations : int
    """

    space: DesignSpace
    effects: Array
    evaluations: int

    @property
    def mu(self) -> Array:
        """Mean effect, shape (k,)."""
        return np.asarray(np.nanmean(self.effects, axis=0))

    @property
    def mu_star(self) -> Array:
        """Mean size of the effect, shape (k,): the ranking."""
        return np.asarray(np.nanmean(np.abs(self.effects), axis=0))

    @property
    def sigma(self) -> Array:
        """Standard deviation of the effect, shape (k,): curvature and interaction."""
        return np.asarray(np.nanstd(self.effects, axis=0, ddof=1))

    def select(self, share: float = 0.1) -> tuple[str, ...]:
        """Parameters whose ``mu_star`` is at least this share of the largest, strongest first."""
        return select_names(self.space.names, self.mu_star, share)

    def to_frame(self) -> pd.DataFrame:
        """Figures of each parameter with the standard error of ``mu_star``, strongest first."""
        import pandas as pd

        counted = np.isfinite(self.effects).sum(axis=0)
        error = np.nanstd(np.abs(self.effects), axis=0, ddof=1) / np.sqrt(counted)
        frame = pd.DataFrame(
            {"mu_star": self.mu_star, "mu_star_error": error, "mu": self.mu, "sigma": self.sigma},
            index=pd.Index(self.space.names, name="parameter"),
        )
        return frame.sort_values("mu_star", ascending=False)

    def plot(self) -> Figure:
        """Spread over size of the effects; returns the figure."""
        return plot_morris(self.space.names, self.mu_star, self.sigma)


def morris(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    trajectories: int = 20,
    levels: int = 4,
    seed: int | np.random.Generator = 0,
    vectorised: bool | None = None,
    executor: Executor | None = None,
) -> MorrisResult:
    """Elementary effects (Morris 1991) at ``trajectories * (k + 1)`` evaluations.

    Parameters
    ----------
    f, vectorised, executor
        As in :func:`surrogate.evaluate`.
    space : DesignSpace
        The parameters.
    trajectories : int
        Number of random walks that change each parameter once, at least 2.
    levels : int
        Even number of levels of the grid; the step is ``levels / (2 (levels - 1))`` of the range.
    seed : int or Generator
        Source of randomness.
    """
    if trajectories < 2:
        raise ValueError(f"Morris needs at least 2 trajectories, not {trajectories}")
    if levels < 2 or levels % 2:
        raise ValueError(f"Morris needs an even number of levels of at least 2, not {levels}")
    rng = np.random.default_rng(seed)
    k = len(space)
    delta = levels / (2.0 * (levels - 1))
    starts = rng.integers(levels // 2, size=(trajectories, k)) / (levels - 1)
    directions = rng.choice([-1.0, 1.0], size=(trajectories, k))
    starts = np.where(directions > 0, starts, starts + delta)
    orders = np.array([rng.permutation(k) for _ in range(trajectories)])
    unit = np.repeat(starts[:, None, :], k + 1, axis=1)
    for walk, (order, direction) in enumerate(zip(orders, directions, strict=True)):
        for moved, i in enumerate(order, start=1):
            unit[walk, moved:, i] += direction[i] * delta
    flat = np.clip(unit.reshape(-1, k), 0.0, 1.0)
    y = evaluate(f, space, space.from_unit(flat), vectorised=vectorised, executor=executor)
    _warn_of_failures(y)
    effects = np.full((trajectories, k), np.nan)
    changes = np.diff(y.reshape(trajectories, k + 1), axis=1)
    rows = np.arange(trajectories)[:, None]
    effects[rows, orders] = changes / (directions[rows, orders] * delta)
    lost = [name for name, seen in zip(space.names, np.isfinite(effects).sum(axis=0), strict=True) if seen < 2]
    if lost:
        raise ValueError(f"too many evaluations failed: fewer than two effects are left for {', '.join(lost)}")
    return MorrisResult(space, effects, len(y))


def _warn_of_failures(y: Array) -> None:
    failed = int((~np.isfinite(y)).sum())
    if failed:
        warnings.warn(
            f"the function failed (not a finite number) at {failed} of {len(y)} points; they are left out",
            SurrogateWarning,
            stacklevel=3,
        )
