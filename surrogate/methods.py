"""The searches behind ``maximise``: firefly, and SciPy's alternatives, all on the unit cube.

A search takes the objective, its options and a Generator, runs until it converges or the objective refuses
more evaluations, and returns why it stopped.  The objective holds the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from surrogate.firefly import FireflySettings, firefly_search
from surrogate.objective import CountedObjective
from surrogate.optimisation_result import StopReason

__all__ = ["SEARCHES", "climb", "complete_options"]

Array = NDArray[np.float64]
Search = Callable[[CountedObjective, dict[str, Any], np.random.Generator], StopReason]


def climb(objective: CountedObjective, start: Array) -> Array:
    """Climb from a point by L-BFGS-B within the bounds; returns where it ended, shape (k,).

    With the gradient if the objective has one, else by finite differences, which are counted.
    """
    from scipy.optimize import minimize

    result = minimize(
        objective.loss,
        np.asarray(start, dtype=float),
        jac=objective.loss_gradient if objective.has_gradient else "2-point",
        method="L-BFGS-B",
        bounds=[(0.0, 1.0)] * len(objective.space),
        # The default ftol stops at relative 2e-9, which is coarser than a polish should be.
        options={"ftol": 1e-13, "gtol": 1e-9, "maxiter": 200},
    )
    return np.clip(result.x, 0.0, 1.0)


def _firefly(objective: CountedObjective, options: dict[str, Any], rng: np.random.Generator) -> StopReason:
    firefly_search(objective, FireflySettings(**options), rng)
    return StopReason.ITERATIONS


def _differential_evolution(
    objective: CountedObjective, options: dict[str, Any], rng: np.random.Generator
) -> StopReason:
    from scipy.optimize import Bounds, differential_evolution
    from scipy.stats import qmc

    k = len(objective.space)
    members = options["population"]
    while True:
        result = differential_evolution(
            cast(Any, objective.losses),  # the stubs know only functions of one point
            Bounds(np.zeros(k), np.ones(k)),
            strategy=options["strategy"],
            mutation=options["mutation"],
            recombination=options["recombination"],
            tol=options["tol"],
            maxiter=max(objective.left // members, 1),
            init=qmc.LatinHypercube(k, rng=rng).random(members),
            polish=False,
            vectorized=True,
            updating="deferred",
            rng=rng,
        )
        if not options["restart"]:
            return StopReason.CONVERGED if result.success else StopReason.BUDGET


def _direct(objective: CountedObjective, options: dict[str, Any], rng: np.random.Generator) -> StopReason:
    from scipy.optimize import Bounds, direct

    k = len(objective.space)
    full = False

    def loss(t: Array) -> float:
        # DIRECT may ask for a few points more than maxfun: they get a poor value instead of an evaluation.
        nonlocal full
        if objective.left <= 0:
            full = True
            return -objective.best_value + 1.0
        return objective.loss(t)

    result = direct(
        loss,
        Bounds(np.zeros(k), np.ones(k)),
        eps=options["eps"],
        maxfun=objective.left,
        maxiter=objective.left,
        locally_biased=options["locally_biased"],
        vol_tol=options["vol_tol"],
        len_tol=options["len_tol"],
    )
    return StopReason.BUDGET if full or not result.success else StopReason.CONVERGED


def _multistart(objective: CountedObjective, options: dict[str, Any], rng: np.random.Generator) -> StopReason:
    from scipy.stats import qmc

    starts = options["starts"]
    # Starts come in Latin batches, so that they fill the cube whatever number the budget allows.
    sampler = qmc.LatinHypercube(len(objective.space), rng=rng)
    done = 0
    while True:
        for start in sampler.random(starts or 16):
            climb(objective, start)
            done += 1
            if starts is not None and done >= starts:
                return StopReason.ITERATIONS


SEARCHES: dict[str, tuple[Search, dict[str, Any]]] = {
    "firefly": (_firefly, {f.name: f.default for f in fields(FireflySettings)}),
    "differential_evolution": (
        _differential_evolution,
        {
            "population": 30,
            "strategy": "best1bin",
            "mutation": (0.5, 1.0),
            "recombination": 0.7,
            "tol": 1e-8,
            "restart": False,
        },
    ),
    "direct": (_direct, {"eps": 1e-4, "locally_biased": False, "vol_tol": 1e-16, "len_tol": 1e-6}),
    "multistart": (_multistart, {"starts": None}),
}


def complete_options(method: str, options: Mapping[str, Any] | None) -> dict[str, Any]:
    """The method's options with its defaults filled in.

    Raises
    ------
    ValueError
        For an unknown method or option, or a value out of range.
    """
    if method not in SEARCHES:
        raise ValueError(f"unknown method '{method}'; choose one of {', '.join(SEARCHES)}")
    defaults = SEARCHES[method][1]
    unknown = sorted(set(options or {}) - set(defaults))
    if unknown:
        raise ValueError(f"{method} has no option {', '.join(unknown)}; it has {', '.join(defaults)}")
    chosen = defaults | dict(options or {})
    if method == "firefly":
        return asdict(FireflySettings(**chosen))
    for name, least in (("population", 5), ("starts", 1)):
        if chosen.get(name) is not None and not chosen[name] >= least:
            raise ValueError(f"{method}: {name} must be at least {least}, not {chosen[name]}")
    return chosen
