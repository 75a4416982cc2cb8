"""Derivatives of a simulation's outputs by differences of whole runs: for machines that show no rates."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from multibody.solvers.problem import Directions

__all__ = ["derivatives_of_runs"]

#: Outputs of a run with parameters, a start state, and what is added to inputs (times and values, by index).
Run = Callable[[np.ndarray, np.ndarray, dict[int, tuple[np.ndarray, np.ndarray]]], np.ndarray]

#: Change of an output, as a share of its spread, that a difference aims at, and between which it is taken as it is: far
#: above the error of a run's own integration (1e-6 of the spread and less), and small enough for a central difference.
AIM, LEAST, MOST = 1e-3, 2e-4, 5e-3
#: Attempts to reach it, and the factor by which a size that changes nothing at all is raised.
ATTEMPTS, RAISED = 8, 1e4
#: Size of a first step, as a share of the value, or of one unit where the value is zero.
FIRST = 1e-3


def derivatives_of_runs(
    run: Run,
    y: np.ndarray,
    p: np.ndarray,
    x0: np.ndarray,
    time: np.ndarray,
    bounds: np.ndarray,
    directions: Directions,
) -> np.ndarray:
    """Return the derivatives of the outputs along directions, shape (nt, c, m).

    The size of each difference follows from what it changes; it is central where the bounds of the parameters allow it.

    Parameters
    ----------
    run : callable
    y : ndarray, shape (nt, c)
        Outputs of the run that is varied.
    p, x0 : ndarray
        Its parameters and start state.
    time : ndarray, shape (nt,), s
    bounds : ndarray, shape (n_p, 2)
        Of the parameters, not a number where there is none.
    directions : Directions

    Raises
    ------
    SimulationError
        If the runs fail on both sides.
    """
    spread = np.ptp(y, axis=0)
    spread = np.where(spread > 0.0, spread, np.maximum(np.max(np.abs(y), axis=0), 1e-300))
    derivatives = np.empty((*y.shape, directions.count))
    for k in range(directions.count):
        derivatives[:, :, k] = _Along(run, y, p, x0, time, bounds, directions, k, spread).derivative()
    return derivatives


class _Along:
    """Differences along one direction."""

    def __init__(
        self,
        run: Run,
        y: np.ndarray,
        p: np.ndarray,
        x0: np.ndarray,
        time: np.ndarray,
        bounds: np.ndarray,
        directions: Directions,
        k: int,
        spread: np.ndarray,
    ) -> None:
        self.run, self.y, self.p, self.x0, self.spread = run, y, p, x0, spread
        self.p_dot, self.x_dot = directions.p_dot[k], directions.x0_dot[k]
        self.channel = int(directions.channel[k]) if directions.channel is not None else -1
        self.added: tuple[np.ndarray, np.ndarray] | None = None
        size = 1.0
        if self.channel >= 0 and directions.shape is not None:
            self.added = (time if directions.shape_t is None else directions.shape_t, directions.shape[:, k])
            size = 1.0 / max(float(np.max(np.abs(self.added[1]))), 1e-300)
        moved = np.flatnonzero(self.p_dot)
        values = np.concatenate([np.abs(p[moved]), np.abs(x0[np.flatnonzero(self.x_dot)])])
        if values.size and np.all(values > 0.0):
            size = float(values.min())
        self.first = FIRST * size
        # Along a parameter the steps end where it would leave its bounds.
        steps = (bounds[moved] - p[moved, None]) / self.p_dot[moved, None] if moved.size else np.empty((0, 2))
        steps = np.sort(np.where(np.isnan(steps), [-np.inf, np.inf], steps), axis=1)
        self.low = float(np.max(steps[:, 0], initial=-np.inf))
        self.high = float(np.min(steps[:, 1], initial=np.inf))

    def outputs(self, h: float) -> np.ndarray | None:
        """Return the outputs of a run with a step, None where it fails or leaves the bounds."""
        if not self.low <= h <= self.high:
            return None
        extra = {} if self.added is None else {self.channel: (self.added[0], h * self.added[1])}
        try:
            return self.run(self.p + h * self.p_dot, self.x0 + h * self.x_dot, extra)
        except SimulationError:
            return None

    def change(self, y: np.ndarray) -> float:
        """Return the largest change of an output, as a share of its spread."""
        return float(np.max(np.max(np.abs(y - self.y), axis=0) / self.spread))

    def derivative(self) -> np.ndarray:
        """Return the derivative, shape (nt, c)."""
        if self.added is not None and not np.any(self.added[1]):
            return np.zeros_like(self.y)
        h, above, below = self.first, None, None
        for _ in range(ATTEMPTS):
            above, below = self.outputs(h), self.outputs(-h)
            changes = [self.change(y) for y in (above, below) if y is not None]
            if not changes:
                h *= 0.1
                continue
            size = max(changes)
            if LEAST <= size <= MOST:
                break
            wanted = h * float(np.clip(AIM / size if size > 0.0 else RAISED, 1e-4, RAISED))
            room = max(self.high, -self.low)
            if wanted > room:
                wanted = room
            if wanted == h:
                break
            h = wanted
        if above is None and below is None:
            raise SimulationError("no run with a slightly different parameter, start or input can be simulated")
        if above is not None and below is not None:
            return (above - below) / (2.0 * h)
        return (above - self.y) / h if above is not None else (self.y - below) / h  # type: ignore[operator]
