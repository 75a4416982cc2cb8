"""The function as optimisers see it: on the unit cube, counted, limited, and remembered."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation import evaluate
from surrogate.space import DesignSpace

__all__ = ["BudgetExhausted", "CountedObjective"]

Array = NDArray[np.float64]


class BudgetExhausted(Exception):
    """Raised inside a search when no evaluation is left; never seen by the caller of ``maximise``."""


class CountedObjective:
    """Counts evaluations, refuses those beyond the budget, and keeps every point with its value.

    Values are −inf where the function failed.  ``limit`` may be set below the budget while something is to be
    left for a polish.
    """

    def __init__(
        self,
        f: Callable[..., Any],
        space: DesignSpace,
        budget: int,
        *,
        gradient: Callable[..., Any] | None = None,
        vectorised: bool | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.f, self.space, self.budget, self.limit = f, space, budget, budget
        self._gradient, self._vectorised, self._executor = gradient, vectorised, executor
        self.evaluations = self.gradient_evaluations = self.failed = 0
        self.best_value = -np.inf
        self.best = np.full(len(space), np.nan)
        self.improved_at: list[int] = []
        self.improved_to: list[float] = []
        self._points: list[Array] = []
        self._values: list[Array] = []

    @property
    def has_gradient(self) -> bool:
        """Whether climbs need no finite differences."""
        return self._gradient is not None

    @property
    def left(self) -> int:
        """Evaluations left below the present limit."""
        return self.limit - self.evaluations

    @property
    def points(self) -> Array:
        """All points so far on the unit cube, shape (n, k)."""
        return np.concatenate(self._points) if self._points else np.empty((0, len(self.space)))

    @property
    def values(self) -> Array:
        """Their values, shape (n,)."""
        return np.concatenate(self._values) if self._values else np.empty(0)

    def many(self, t: Array) -> Array:
        """Values at points of the unit cube, shape (n, k) → (n,).

        Raises
        ------
        BudgetExhausted
            If not all of them are within the limit; those that are have then been evaluated and kept.
        """
        wanted, t = len(t), np.array(t[: max(self.left, 0)])
        if len(t):
            y = evaluate(
                self.f,
                self.space,
                self.space.from_unit(t),
                vectorised=self._vectorised,
                executor=self._executor,
            )
            y = np.where(np.isnan(y), -np.inf, y)
            self._points.append(t)
            self._values.append(y)
            running = np.maximum.accumulate(np.maximum(y, self.best_value))
            before = np.concatenate([[self.best_value], running[:-1]])
            for index in np.flatnonzero(running > before):
                self.improved_at.append(self.evaluations + int(index) + 1)
                self.improved_to.append(float(running[index]))
            if y.max() > self.best_value:
                self.best_value, self.best = float(y.max()), t[int(y.argmax())].copy()
            self.evaluations += len(t)
            self.failed += int(np.isneginf(y).sum())
        if len(t) < wanted:
            raise BudgetExhausted
        return y

    def one(self, t: Array) -> float:
        """Value at one point of the unit cube."""
        return float(self.many(np.clip(t, 0.0, 1.0)[None, :])[0])

    def loss(self, t: Array) -> float:
        """What SciPy minimises: the negative value, and for a failure more than any so far."""
        return float(self._as_loss(np.array([self.one(t)]))[0])

    def losses(self, t: Array) -> Array:
        """The same for SciPy's columns, shape (k, n) → (n,)."""
        return self._as_loss(self.many(np.clip(t.T, 0.0, 1.0)))

    def loss_gradient(self, t: Array) -> Array:
        """Gradient of :meth:`loss` on the unit cube."""
        if self._gradient is None:
            raise ValueError("no gradient was given")
        point = self.space.from_unit(np.clip(t, 0.0, 1.0))
        g = np.asarray(self._gradient(point), dtype=float).reshape(-1)
        if g.shape != (len(self.space),) or not np.isfinite(g).all():
            raise ValueError(f"the gradient at {point} is {g}; expected {len(self.space)} finite numbers")
        self.gradient_evaluations += 1
        return -g * self.space.span

    def _as_loss(self, y: Array) -> Array:
        # A finite stand-in: infinities break SciPy's line searches and DIRECT's bounds.
        if not np.isneginf(y).any():
            return -y
        seen = self.values
        seen = seen[np.isfinite(seen)]
        worst = 1.0 - seen.min() + np.ptp(seen) if seen.size else 1.0
        return np.where(np.isneginf(y), worst, -y)
