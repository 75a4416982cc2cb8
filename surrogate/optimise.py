"""Every optimiser behind one function, and a list of the local maxima of a cheap function."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from surrogate.methods import SEARCHES, climb, complete_options
from surrogate.objective import BudgetExhausted, CountedObjective
from surrogate.optimisation_result import OptimisationResult, StopReason
from surrogate.space import DesignSpace, SurrogateWarning

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["METHODS", "local_maxima", "maximise"]

Array = NDArray[np.float64]
Method = Literal["firefly", "differential_evolution", "direct", "multistart"]
METHODS: tuple[str, ...] = tuple(SEARCHES)

#: Points from which a polish climbs differ by at least this share of the cube's diagonal: nearer ones would
#: climb the same hill.
_APART = 0.15
#: Points looked through for places to climb from, best first; the search for them grows with its square.
_SCANNED = 20_000


def maximise(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    method: Method = "firefly",
    budget: int | None = None,
    seed: int | np.random.Generator = 0,
    polish: int | bool = 5,
    gradient: Callable[..., Any] | None = None,
    vectorised: bool | None = None,
    executor: Executor | None = None,
    options: Mapping[str, Any] | None = None,
) -> OptimisationResult:
    """Find the largest value of a function within bounds.

    Parameters
    ----------
    f : callable
        Function of the parameters, as in :func:`surrogate.evaluate`, such as a
        :class:`surrogate.ResponseSurface`. Points where it returns something that is not finite count as
        failed and are avoided.
    space : DesignSpace
        The parameters.
    method : {"firefly", "differential_evolution", "direct", "multistart"}
        ``"firefly"`` is the paper's, the others are SciPy's. For a smooth function ``"multistart"`` is
        usually the quickest; :func:`surrogate.compare_optimisers` compares them on your own function.
    budget : int, optional
        Evaluations at most, the polish included. By default 3000, or what firefly's ``population`` and
        ``iterations`` need plus the polish. Calls of an analytic gradient are counted apart.
    seed : int or Generator
        Source of randomness.
    polish : int
        Number of points of the search, each better than all evaluated points near it, from which L-BFGS-B
        climbs at the end; 0 for none. ``"multistart"`` climbs anyway.
    gradient : callable, optional
        Gradient of ``f`` at one point, shape (k,), in the parameters' units; by default ``f.gradient`` if it
        has one, else finite differences.
    vectorised, executor
        As in :func:`surrogate.evaluate`.
    options : mapping, optional
        Settings of the method. firefly: :class:`surrogate.FireflySettings`; differential_evolution:
        ``population``, ``strategy``, ``mutation``, ``recombination``, ``tol``, ``restart`` (begin anew after
        convergence until the budget is spent); direct: ``eps``, ``locally_biased``, ``vol_tol``, ``len_tol``;
        multistart: ``starts``.

    Returns
    -------
    OptimisationResult

    Raises
    ------
    ValueError
        For unknown methods or options, a budget below one generation, or when every evaluation failed.

    Warns
    -----
    SurrogateWarning
        When a response surface promises more than its ``limits`` allow, such as a cosine similarity of 1.19.
    """
    chosen = complete_options(method, options)
    climbs = 0 if method == "multistart" else int(polish)
    if climbs < 0:
        raise ValueError(f"polish must be 0 or more starting points, not {polish}")
    analytic = gradient if gradient is not None else getattr(f, "gradient", None)
    # Enough for some twenty steps of L-BFGS-B; the line search sees one value per step, differences k + 1.
    reserve = climbs * 20 * (1 if callable(analytic) else len(space) + 1)
    swarm = chosen.get("population", 1)
    total = budget
    if total is None:
        iterations = chosen.get("iterations")
        total = 3000 if iterations is None else swarm * (iterations + 1) + reserve
    # With little to spend, the search matters more than the polish.
    reserve = min(reserve, total // 4)
    if total - reserve < swarm:
        raise ValueError(
            f"a budget of {total} evaluations ({reserve} of them for the polish) is less than one generation "
            f"of {swarm} of {method}"
        )
    objective = CountedObjective(
        f,
        space,
        int(total),
        gradient=analytic if callable(analytic) else None,
        vectorised=vectorised,
        executor=executor,
    )
    objective.limit = objective.budget - reserve
    try:
        stopped = SEARCHES[method][0](objective, chosen, np.random.default_rng(seed))
    except BudgetExhausted:
        stopped = StopReason.BUDGET
    if not np.isfinite(objective.best_value):
        raise ValueError(f"the function gave no finite number at any of {objective.evaluations} points")
    searched = objective.best_value
    _polish(objective, climbs)
    _warn_beyond(getattr(f, "limits", None), getattr(f, "response", "the response"), objective.best_value)
    return OptimisationResult(
        space=space,
        method=method,
        x=space.from_unit(objective.best),
        value=objective.best_value,
        evaluations=objective.evaluations,
        gradient_evaluations=objective.gradient_evaluations,
        failed=objective.failed,
        improved_at=np.array(objective.improved_at, dtype=np.int64),
        improved_to=np.array(objective.improved_to),
        value_before_polish=searched,
        stopped=stopped,
        options=chosen | {"polish": climbs, "budget": int(total)},
    )


def _warn_beyond(limits: tuple[float, float] | None, response: str, value: float) -> None:
    if limits is not None and value > limits[1]:
        warnings.warn(
            f"the surface promises {response} {value:.3g}, and none is above {limits[1]:g}: it is wrong there; "
            "simulate its optimum, and compare with the best of the simulated points",
            SurrogateWarning,
            stacklevel=3,
        )


def local_maxima(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    starts: int = 200,
    seed: int | np.random.Generator = 0,
    gradient: Callable[..., Any] | None = None,
    vectorised: bool | None = None,
) -> pd.DataFrame:
    """Local maxima of a cheap function within bounds, best first.

    Climbs from a Latin hypercube of starts and joins what ends in the same place: rivals of the best point
    that an optimiser's single answer hides. It proves nothing about hills that none of the starts is on.

    Parameters
    ----------
    f, gradient, vectorised
        As in :func:`maximise`.
    space : DesignSpace
        The parameters.
    starts : int
        Number of climbs.
    seed : int or Generator
        Source of randomness.

    Returns
    -------
    DataFrame
        One column for each parameter, ``value`` and ``starts``, the share of the climbs that ended there.
    """
    from scipy.stats import qmc

    if starts < 1:
        raise ValueError(f"at least one start is needed, not {starts}")
    analytic = gradient if gradient is not None else getattr(f, "gradient", None)
    # No limit that matters: 10 000 evaluations a climb is beyond what L-BFGS-B does in 200 iterations.
    objective = CountedObjective(
        f,
        space,
        10_000 * starts * (len(space) + 1),
        gradient=analytic if callable(analytic) else None,
        vectorised=vectorised,
    )
    sample = qmc.LatinHypercube(len(space), rng=np.random.default_rng(seed)).random(starts)
    ends = np.array([climb(objective, start) for start in sample])
    values = objective.many(ends)
    places: list[tuple[float, Array, int]] = []
    for index in np.argsort(-values, kind="stable"):
        if not np.isfinite(values[index]):
            continue
        for number, (value, place, count) in enumerate(places):
            if np.abs(place - ends[index]).max() < 1e-3:
                places[number] = (value, place, count + 1)
                break
        else:
            places.append((float(values[index]), ends[index], 1))
    frame = space.to_frame(space.from_unit(np.array([place for _, place, _ in places]).reshape(-1, len(space))))
    return frame.assign(value=[value for value, _, _ in places], starts=[count / starts for _, _, count in places])


def _polish(objective: CountedObjective, climbs: int) -> None:
    starts = _peaks(objective.points, objective.values, climbs)
    left = objective.budget - objective.evaluations
    for number, start in enumerate(starts):
        # Each climb may use an equal share of what is left, and the last one all of it.
        objective.limit = objective.evaluations + left // (len(starts) - number)
        before = objective.evaluations
        with suppress(BudgetExhausted):
            climb(objective, start)
        left -= objective.evaluations - before


def _peaks(points: Array, values: Array, most: int) -> list[Array]:
    """Points that have no better one near them, best first.

    The best points that lie apart from each other would not do: the second of them is a place on the slope of
    the first one's hill, just outside the distance.
    """
    order = [i for i in np.argsort(-values, kind="stable")[:_SCANNED] if np.isfinite(values[i])]
    ranked = points[order]
    apart = _APART**2 * points.shape[1]
    peaks: list[Array] = []
    for rank, point in enumerate(ranked):
        if len(peaks) >= most:
            break
        if not (((ranked[:rank] - point) ** 2).sum(axis=1) < apart).any():
            peaks.append(point)
    return peaks
