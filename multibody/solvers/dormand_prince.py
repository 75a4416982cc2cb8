"""The explicit method: Dormand-Prince 5(4), for problems that are not stiff."""

from __future__ import annotations

from multibody.solvers.base import NativeSolver

__all__ = ["DormandPrince54"]


class DormandPrince54(NativeSolver):
    """Dormand and Prince's pair of orders 5 and 4 with a compiled loop over many steps.

    SciPy's ``RK45`` in method, several times to tens of times faster.  Held inputs end the steps at their
    jumps. Parameters are those of `NativeSolver`.

    Examples
    --------
    ``solve_ivp(problem.fun, (0, 6), problem.initial(x0), method=DormandPrince54, problem=problem,
    rtol=1e-6)``
    """

    ORDER = 5
    STAGES = 7
    DRIVER = "multibody.solvers.kernels.dormand_prince"
