"""Bounded nonlinear least squares for simulations: few evaluations, fewer Jacobians, tall ones kept in pieces.

Levenberg and Marquardt with the damping of Nielsen (1999), variables held at a bound while the gradient points
outwards.  A Jacobian costs as much as many simulations, so between two of them it is corrected from each step (Broyden
1965, in the metric of the column lengths; a piece that does not depend on some unknowns keeps their columns zero,
Schubert 1970).  A fit ends on a new Jacobian only: no corrected one decides that it has converged.  Where an incomplete
model leaves large residuals, their curvature matters too; without it the last steps only halve.  It is updated from one
new Jacobian to the next (Dennis, Gay and Welsch 1981, ACM TOMS 7, 348).  Where unknowns make up for each other along a
curved valley, a straight step leaves it, and is then bent by what the residuals show of the curve (geodesic
acceleration: Transtrum and Sethna 2012, arXiv:1201.5885).  Steps come from the small normal matrix with
columns scaled to unit length; as the residual itself is exact, the condition of that matrix limits the speed of the
last digits and not their accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

__all__ = ["AT_LIMIT", "Piece", "Solution", "solve", "step_within"]

AT_LIMIT = "reached the largest number of simulations"  # message of a fit that was stopped before its end
FLAT = "the error hardly decreases any more"

POOR = 0.3  # share of the predicted decrease that a step with a corrected Jacobian must reach, or a new one is made
STEEP = 0.1  # share of the flattest direction's curvature that must be left for the residuals' curvature to be used
CORRECTIONS = 5  # steps on one Jacobian, at most
VALLEY = 10.0  # what a step's unknowns change one by one, over what they change together, if it may be bent; chosen
STRAIGHT = 4  # Jacobians that suffice without a valley: in 95 % of 557 fits on six machines
BENT = 0.75  # share of the predicted decrease below which such a step is bent, which costs a simulation; chosen
SHARPEST = 0.75  # length of the bend as a share of the step's, from which it is not bent; chosen


@dataclass
class Piece:
    """Rows of the problem.

    Parameters
    ----------
    jacobian : ndarray, shape (m, c)
        Derivatives by those unknowns that these rows depend on.
    columns : ndarray of int, shape (c,)
        Which unknowns these are.
    residual : ndarray, shape (m,)
    """

    jacobian: np.ndarray
    columns: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The end point of a least-squares fit.

    Parameters
    ----------
    x : ndarray, shape (k,)
    cost : float
        Half the sum of squares.
    evaluations : int
        Points at which residuals were computed.
    message : str
        Why it ended.
    jacobians : int
        Points at which a Jacobian was computed.
    pieces : sequence of Piece
        At the end, where they are kept; their Jacobians may be corrected ones.
    """

    x: np.ndarray
    cost: float
    evaluations: int
    message: str
    jacobians: int = 0
    pieces: Sequence[Piece] = ()


def solve(
    residuals: Callable[[np.ndarray], Sequence[np.ndarray] | None],
    pieces: Callable[[np.ndarray], Iterable[Piece]],
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    tolerance: float = 1e-7,
    max_evaluations: int = 40,
    confirm: bool = True,
    begin: Sequence[Piece] = (),
    keep: bool = False,
) -> Solution:
    """Minimise half the sum of squares within bounds.

    Parameters
    ----------
    residuals : callable
        Residuals at a point, one array for each piece; None where the simulation fails.
    pieces : callable
        Pieces of the problem at a point.
    x : ndarray, shape (k,)
        Start, within the bounds.
    low, high : ndarray, shape (k,)
    tolerance : float
        Relative decrease of the cost below which no further step is taken.
    max_evaluations : int
        Points at which residuals are computed, at most.
    confirm : bool
        End on a new Jacobian; else a corrected one may suffice, which saves one.
    begin : sequence of Piece
        Pieces at the start, where they are known; their Jacobians may be corrected ones, which saves the first.
    keep : bool
        Whether the pieces at the end are wanted.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 20)
    >>> y = np.exp(-2.0 * t)
    >>> def residuals(x):
    ...     return [np.exp(-x[0] * t) - y]
    >>> def pieces(x):
    ...     yield Piece((-t * np.exp(-x[0] * t))[:, None], np.array([0]), np.exp(-x[0] * t) - y)
    >>> round(float(solve(residuals, pieces, np.array([1.0]), np.array([0.0]), np.array([9.0])).x[0]), 6)
    2.0
    """
    x = np.clip(np.asarray(x, dtype=float), low, high)
    corrected, jacobians = (1, 0) if begin else (0, 1)
    rows = [replace(piece) for piece in begin] or list(pieces(x))  # corrected in place below
    current, evaluations = _cost([r.residual for r in rows]), 1
    damping, growth = 1e-4, 2.0
    curvature, last = np.zeros((x.size, x.size)), None
    longest = np.zeros(x.size)  # of each column so far: where one has become short, the model has gone flat
    while True:
        normal, gradient = _normal(rows, x.size)
        longest = np.maximum(longest, np.sqrt(np.diag(normal)))
        if not corrected and last is not None:
            curvature = _updated_curvature(curvature, last, x, gradient, rows)
        if not corrected:
            last = x.copy(), gradient, [r.jacobian for r in rows]
        held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
        free = ~held & (np.diag(normal) > 0)
        message, improved, poor = "no step improves any more", False, False
        while True:
            if not free.any() or _gradient_vanishes(gradient, normal, free, current):
                message = "the gradient vanishes"
                break
            trial, predicted = step_within(
                x, _with_curvature(normal, curvature, free), gradient, free, damping * longest**2, low, high
            )
            change, size = trial - x, np.sqrt(np.diag(normal))  # by what each unknown moves: their units differ
            if np.linalg.norm(size * change) <= tolerance * 1e-2 * np.linalg.norm(size * x) or predicted <= 0:
                break
            if predicted < tolerance * current:
                message = FLAT
                break
            if evaluations >= max_evaluations:
                message = AT_LIMIT
                break
            errors = residuals(trial)
            evaluations += 1
            reached = np.inf if errors is None else _cost(errors)
            valley = np.linalg.norm(size * change) > VALLEY * np.sqrt(change @ normal @ change)
            asked = bool(valley) and jacobians > STRAIGHT and evaluations < max_evaluations
            if asked and errors is not None and current - reached < BENT * predicted:
                within = free & (trial > low) & (trial < high)
                bent = np.clip(_bent(rows, errors, x, trial, normal, within, damping * longest**2), low, high)
                if not np.array_equal(bent, trial):
                    there = residuals(bent)
                    evaluations += 1
                    if there is not None and _cost(there) < reached:
                        trial, errors, reached, change = bent, there, _cost(there), bent - x
            if errors is not None and reached < current:
                gain = (current - reached) / predicted
                damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
                growth, poor, improved = 2.0, gain < POOR, True
                _correct(rows, errors, change, normal)
                x, current = trial, reached
                break
            if corrected:
                break
            damping, growth = damping * growth, growth * 2.0
        if improved and not poor and corrected < CORRECTIONS:
            corrected += 1
            continue
        converged = not improved and (not corrected or (not confirm and message == FLAT))
        if converged or message == AT_LIMIT:
            kept = rows if keep else ()
            return Solution(
                x=x, cost=current, evaluations=evaluations, message=message, jacobians=jacobians, pieces=kept
            )
        rows = list(pieces(x))
        corrected, jacobians = 0, jacobians + 1


def _bent(
    rows: Sequence[Piece],
    errors: Sequence[np.ndarray],
    x: np.ndarray,
    trial: np.ndarray,
    normal: np.ndarray,
    within: np.ndarray,
    damping: np.ndarray,
) -> np.ndarray:
    """Return a step's end moved by what the residuals there show of their curvature; the same end where that is sharp.

    Along the step d the residuals are r + J d + c: the bend is the damped step that takes c away.
    """
    index, step = np.flatnonzero(within), trial - x
    if not index.size:
        return trial
    pull = np.zeros(x.size)
    for row, residual in zip(rows, errors, strict=True):
        pull[row.columns] += row.jacobian.T @ (residual - row.residual - row.jacobian @ step[row.columns])
    size = np.sqrt(np.diag(normal))
    scale = size[index]
    scaled = normal[np.ix_(index, index)] / np.outer(scale, scale)
    bend = -np.linalg.solve(scaled + np.diag(damping[index] / scale**2 + 1e-14), pull[index] / scale)
    if not np.linalg.norm(bend) < SHARPEST * np.linalg.norm(size * step):
        return trial
    end = trial.copy()
    end[index] += bend / scale
    return end


def _cost(residuals: Iterable[np.ndarray]) -> float:
    with np.errstate(over="ignore"):  # infinite is worse than anything
        return 0.5 * sum(float(e @ e) for e in residuals)


def _correct(rows: Sequence[Piece], errors: Sequence[np.ndarray], change: np.ndarray, normal: np.ndarray) -> None:
    """Set the residuals of a new point, and correct each Jacobian so that it gives their change (Broyden)."""
    weight = np.diag(normal) * change
    for row, residual in zip(rows, errors, strict=True):
        mine, pull = change[row.columns], weight[row.columns]
        size = float(mine @ pull)
        if size > 0.0:
            row.jacobian = row.jacobian + np.outer((residual - row.residual - row.jacobian @ mine) / size, pull)
        row.residual = residual


def _normal(rows: Iterable[Piece], k: int) -> tuple[np.ndarray, np.ndarray]:
    normal, gradient = np.zeros((k, k)), np.zeros(k)
    for row in rows:
        normal[np.ix_(row.columns, row.columns)] += row.jacobian.T @ row.jacobian
        gradient[row.columns] += row.jacobian.T @ row.residual
    return normal, gradient


def _updated_curvature(
    curvature: np.ndarray,
    last: tuple[np.ndarray, np.ndarray, list[np.ndarray]],
    x: np.ndarray,
    gradient: np.ndarray,
    rows: Sequence[Piece],
) -> np.ndarray:
    """Return the residuals' curvature, updated by the secant condition along the way to a new Jacobian."""
    before, slope, jacobians = last
    way, turn = x - before, gradient - slope
    along = float(way @ turn)
    if not along > 1e-12 * float(np.linalg.norm(way) * np.linalg.norm(turn)):
        return curvature
    secant = gradient.copy()
    for row, jacobian in zip(rows, jacobians, strict=True):
        secant[row.columns] -= jacobian.T @ row.residual
    pulled = curvature @ way
    size = abs(float(way @ pulled))
    share = min(1.0, abs(float(way @ secant)) / size) if size > 0.0 else 1.0
    miss = secant - share * pulled
    return (
        share * curvature
        + (np.outer(miss, turn) + np.outer(turn, miss)) / along
        - float(way @ miss) / along**2 * np.outer(turn, turn)
    )


def _with_curvature(normal: np.ndarray, curvature: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the normal matrix with the residuals' curvature, where the sum is clearly positive definite."""
    if not curvature.any():
        return normal
    index = np.flatnonzero(free)
    size = np.sqrt(np.diag(normal)[index])
    bent = (normal + curvature)[np.ix_(index, index)] / np.outer(size, size)
    straight = normal[np.ix_(index, index)] / np.outer(size, size)
    least = np.linalg.eigvalsh(bent)[0]
    return normal + curvature if least > STEEP * max(np.linalg.eigvalsh(straight)[0], 0.0) and least > 0.0 else normal


def _gradient_vanishes(gradient: np.ndarray, normal: np.ndarray, free: np.ndarray, cost: float) -> bool:
    """Return whether the cosine between residual and every free column is below rounding."""
    size = np.sqrt(np.diag(normal)[free]) * max(2.0 * cost, 1e-300) ** 0.5
    return bool(np.all(np.abs(gradient[free]) <= 1e-9 * size))


def step_within(
    x: np.ndarray,
    normal: np.ndarray,
    gradient: np.ndarray,
    free: np.ndarray,
    damping: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Return the damped step, limited by the bounds, and the decrease of the cost that it predicts.

    ``damping`` is added to the diagonal of the normal matrix.
    """
    index = np.flatnonzero(free)
    trial = x.copy()
    for _ in range(index.size):
        scale = np.sqrt(np.diag(normal)[index])
        scaled = normal[np.ix_(index, index)] / np.outer(scale, scale)
        # what has hit a bound in this step stays there and acts on the others through the gradient
        pull = gradient[index] + normal[index] @ (trial - x) - normal[np.ix_(index, index)] @ (trial - x)[index]
        change = -np.linalg.solve(scaled + np.diag(damping[index] / scale**2 + 1e-14), pull / scale) / scale
        wanted = x[index] + change
        over = (wanted < low[index]) | (wanted > high[index])
        trial[index] = np.clip(wanted, low[index], high[index])
        if not over.any() or over.all():
            break
        index = index[~over]
    change = trial - x
    return trial, float(-(gradient @ change + 0.5 * change @ normal @ change))
