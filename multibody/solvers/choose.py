"""Which method is cheaper for a problem: the explicit or the stiff one, with the reason in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.solvers.base import NativeSolver, Samples
from multibody.solvers.dormand_prince import DormandPrince54
from multibody.solvers.problem import NativeProblem, ProblemError
from multibody.solvers.rosenbrock import Rodas5P, relative_cost
from multibody.solvers.run import integrate

__all__ = ["choose_method", "jacobian", "spectral_radius"]

# Length of the stability region of the Dormand-Prince pair on the negative real axis.
REACH = 3.3
PROBE_POINTS = 9


@dataclass(frozen=True)
class Choice:
    """A method and why.

    Parameters
    ----------
    method : type
        `DormandPrince54` or `Rodas5P`.
    reason : str
        One sentence.
    fastest : float, 1/s
        Largest magnitude of an eigenvalue of the Jacobian that was met.
    gain : float
        Estimated cost of the explicit method over that of the stiff one.
    """

    method: type[NativeSolver]
    reason: str
    fastest: float
    gain: float


def jacobian(problem: NativeProblem, t: float, x: np.ndarray) -> np.ndarray:
    """Return ∂f/∂x at (t, x), shape (n, n), by directional derivatives."""
    if problem.tangent is None:
        raise ProblemError("the Jacobian needs the tangent of the right-hand side: NativeProblem(..., tangent=...)")
    u = problem.table(t, problem.p)
    no_u, no_p = np.zeros_like(u), np.zeros_like(problem.p)
    matrix, column = np.zeros((problem.n, problem.n)), np.empty(problem.n)
    for owner in problem.owners():
        rows = np.flatnonzero(owner >= 0)
        seed = np.zeros(problem.n)
        seed[owner[rows]] = 1.0
        problem.tangent(t, x, u, problem.p, seed, no_u, no_p, column)
        matrix[rows, owner[rows]] = column[rows]
    return matrix


def spectral_radius(problem: NativeProblem, t: float, x: np.ndarray) -> float:
    """Return the largest magnitude of an eigenvalue of ∂f/∂x at (t, x), 1/s; infinite if it is not finite."""
    matrix = jacobian(problem, t, x)
    if not np.all(np.isfinite(matrix)):
        return np.inf
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))


def choose_method(
    problem: NativeProblem,
    t_span: tuple[float, float],
    x0: Any,
    rtol: Any = 1e-3,
    atol: Any = 1e-6,
    max_step: float = np.inf,
) -> Choice:
    """Choose between the explicit and the stiff method.

    A coarse solution by the stiff method gives points along the trajectory.  There the largest eigenvalue
    bounds the explicit method's step; the coarse solution's own steps, shortened for the tolerance asked for,
    are what accuracy would allow.  Stiff is what the first limits to far below the second.

    Parameters
    ----------
    problem : NativeProblem
        Without a tangent the explicit method is the only one.
    t_span, x0, rtol, atol, max_step
        As for the integration itself.
    """
    if problem.tangent is None:
        return Choice(DormandPrince54, "explicit: there is no tangent for the Jacobian of the stiff method", 0.0, 0.0)
    x0 = np.asarray(x0, dtype=np.float64)
    plain = NativeProblem(
        rhs=problem.rhs,
        p=problem.p,
        table=problem.table,
        n=problem.n,
        tangent=problem.tangent,
        colours=problem.colours,
        pattern=problem.pattern,
    )
    span = abs(t_span[1] - t_span[0])
    samples = Samples(np.linspace(*t_span, PROBE_POINTS))
    coarse = np.maximum(np.asarray(rtol, dtype=np.float64), 1e-2)
    probe = integrate(plain, t_span, x0, method=Rodas5P, samples=samples, rtol=coarse, atol=atol, max_step=max_step)
    points = zip(samples.times[: samples.count], samples.states[: samples.count], strict=True)
    radii = [spectral_radius(plain, t_span[0], x0), *(spectral_radius(plain, t, x) for t, x in points)]
    fastest = max(radii)
    if not probe.success or span == 0.0 or fastest == 0.0:
        why = "the coarse probe failed" if not probe.success else "nothing moves"
        return Choice(DormandPrince54, f"explicit: {why}", fastest, 0.0)
    # Both methods are of order 5, so that accuracy asks the same number of steps of them.
    shrink = float(np.min(np.asarray(rtol, dtype=np.float64) / coarse)) ** 0.2
    accurate = max(probe.njev, 1) / max(shrink, 1e-3)
    stable = span * float(np.mean(radii)) / REACH
    gain = max(stable, accurate) / (accurate * relative_cost(problem))
    words = (
        f"stability limits explicit steps to {REACH / fastest:.2g} s (fastest eigenvalue {fastest:.3g} 1/s) "
        f"where accuracy allows {span / accurate:.2g} s"
    )
    if gain > 1.0:
        return Choice(Rodas5P, f"stiff: {words}; estimated {gain:.1f} times cheaper than explicit", fastest, gain)
    if stable <= accurate:
        words = f"accuracy and not stability limits the step (fastest eigenvalue {fastest:.3g} 1/s)"
    return Choice(DormandPrince54, f"explicit: {words}; a stiff step costs more than it saves", fastest, gain)
