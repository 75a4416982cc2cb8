"""Evaluating a function at many points, with its faults named."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surrogate.space import DesignSpace

__all__ = ["evaluate"]

Array = NDArray[np.float64]


def is_vectorised(f: Callable[..., Any], vectorised: bool | None) -> bool:
    """What the caller says, else what the function says of itself (attribute ``vectorised``), else no."""
    return bool(getattr(f, "vectorised", False)) if vectorised is None else vectorised


def evaluate(
    f: Callable[..., Any],
    space: DesignSpace,
    points: ArrayLike,
    *,
    vectorised: bool | None = None,
    executor: Executor | None = None,
) -> Array:
    """Evaluate a function of the parameters at points.

    Parameters
    ----------
    f : callable
        Takes one point, shape (k,), and returns a number; if vectorised, takes (n, k) and returns (n,).
    space : DesignSpace
        The parameters.
    points : array_like, shape (n, k)
        In the parameters' units.
    vectorised : bool, optional
        Whether ``f`` accepts (n, k); by default its attribute ``vectorised``, else False.
    executor : concurrent.futures.Executor, optional
        Points of a function that is not vectorised are spread over it.

    Returns
    -------
    ndarray, shape (n,)
        NaN where ``f`` returned something that is not finite.

    Raises
    ------
    ValueError
        If ``f`` returns another shape. What ``f`` itself raises is passed on, with the point noted.
    """
    x = space.points(points)
    if x.shape[0] == 0:
        return np.empty(0)
    if is_vectorised(f, vectorised):
        y = np.asarray(f(x), dtype=float)
        if y.shape != (x.shape[0],):
            raise ValueError(
                f"the function returned shape {y.shape} for points of shape {x.shape}; expected "
                f"({x.shape[0]},) (if it takes one point at a time, pass vectorised=False)"
            )
    elif executor is not None:
        y = np.array([_number(value, point) for value, point in zip(executor.map(f, x), x, strict=True)])
    else:
        y = np.array([_one(f, point, space) for point in x])
    return np.where(np.isfinite(y), y, np.nan)


def _one(f: Callable[..., Any], point: Array, space: DesignSpace) -> float:
    try:
        value = f(point)
    except Exception as error:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(space.names, point, strict=True))
        error.add_note(f"while evaluating the function at {where}")
        raise
    return _number(value, point)


def _number(value: Any, point: Array) -> float:
    y = np.asarray(value, dtype=float)
    if y.size != 1:
        raise ValueError(f"the function returned shape {y.shape} for the point {point}; expected one number")
    return float(y.reshape(()))
