"""The exponential method: one fast motion is followed exactly, everything else explicitly."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from multibody.solvers.base import NativeSolver
from multibody.solvers.differences import forward_differences
from multibody.solvers.kernels import exponential
from multibody.solvers.kernels.exponential import LEFT
from multibody.solvers.kernels.stepping import DONE, EVALUATIONS, JACOBIANS, WANTED, T
from multibody.solvers.problem import ProblemError

__all__ = ["Exponential43"]

#: Steps after which the direction of the fast motion is looked at again, before and after one was found.
SPELLS = (1024, 16384)
#: How much faster than all others a motion must be to be taken as the one.
APART = 2.0


class Exponential43(NativeSolver):
    """Krogstad's exponential Runge-Kutta method of orders 4 and 3 for a problem with one fast motion.

    A stiff damper between two bodies, such as a tooth contact, makes one motion that dies away far faster than anything
    else moves.  Its rate limits the step of an explicit method, and a Rosenbrock method pays for a whole Jacobian and
    its factors.  Here that one direction is split off and its exponential, a number, does the rest: little more than
    four evaluations a step, no matrix.  The direction is that of the eigenvalue of largest magnitude, found at the
    start and looked at again now and then; its rate is renewed every few steps.  Without a motion that stands out the
    method is the classical one of Runge and Kutta with error control.

    Parameters are those of `NativeSolver`; directions are not carried along.  Between steps a cubic is used, and the
    samples of compiled loops are put back on the fast motion's path.
    """

    ORDER = 4
    STAGES = 3
    KERNEL: ClassVar[Any] = exponential

    def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, problem: Any = None, **options: Any) -> None:
        if problem is not None and problem.n_directions:
            raise ProblemError("Exponential43 carries no directions along: take DormandPrince54 or Rodas5P")
        super().__init__(fun, t0, y0, t_bound, problem=problem, **options)
        n = self.problem.n
        self._work = np.zeros(6 * max(n, 1))
        self._left, self._right, self._rates = np.zeros(n), np.zeros(n), np.zeros(5)
        self._fastest = 0.0
        self._due = 0

    def _extra(self) -> tuple[Any, ...]:
        return self._left, self._right, self._rates

    def _advance(self) -> int:
        if self._due <= 0:
            self._look()
        tally = self._tally
        wanted = int(tally[WANTED])
        tally[WANTED] = min(self._due, wanted)
        status = super()._advance()
        tally[WANTED] = wanted
        self._due -= int(tally[DONE])
        return status

    def _look(self) -> None:
        """Find the fast motion at the present state; of several directions the one of the fastest is kept."""
        motion = fast_motion(self._jacobian(float(self._clock[T])))
        if motion is not None and motion[0] < self._fastest:
            self._fastest, self._left[:], self._right[:] = motion
        self._rates[LEFT] = 0.0
        self._due = SPELLS[int(self._fastest < 0.0)]

    def _jacobian(self, t: float) -> np.ndarray:
        """Return the Jacobian at the present state: exact where the problem has a tangent, else by differences."""
        x, tally = self._state, self._tally
        if self.problem.tangent is not None:
            tally[JACOBIANS] += 1
            return self.problem.jac(t, x)
        tally[EVALUATIONS] += x.size + 1
        sizes, rates = np.abs(x) + self.atol / self.rtol, self.problem.fun
        return forward_differences(lambda moved: rates(t, moved), x, sizes)


def fast_motion(matrix: np.ndarray) -> tuple[float, np.ndarray, np.ndarray] | None:
    """Return rate, left and right eigenvector (with the product one) of the fastest motion, if it stands out.

    Parameters
    ----------
    matrix : ndarray, shape (n, n), 1/s
        Jacobian of the rates.

    Returns
    -------
    tuple or None
        Nothing where the eigenvalue of largest magnitude is not real, does not die away or has others near it.

    Examples
    --------
    >>> rate, left, right = fast_motion(np.array([[0.0, 1.0], [-1.0, -1e6]]))
    >>> round(rate), float(round(left @ right, 9))
    (-1000000, 1.0)
    """
    n = len(matrix)
    if n == 0 or not np.all(np.isfinite(matrix)):
        return None
    values, vectors = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(values))
    fastest = values[order[0]]
    if fastest.imag != 0.0 or not fastest.real < 0.0:
        return None
    if n > 1 and abs(fastest) < APART * abs(values[order[1]]):
        return None
    right = vectors[:, order[0]].real
    # the left one by inverse iteration
    shifted = matrix.T - (1.0 + 1e-8) * fastest.real * np.eye(n)
    left = right
    for _ in range(3):
        left = np.linalg.solve(shifted, left)
        left = left / np.linalg.norm(left)
    along = float(left @ right)
    return (float(fastest.real), left / along, right) if abs(along) > 1e-12 else None
