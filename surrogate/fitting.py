"""Fitting response surfaces, and how their quality depends on order and sample count."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from surrogate.least_squares import solve
from surrogate.polynomial import Terms, TermSet, polynomial_terms
from surrogate.response_surface import ResponseSurface, checked_responses
from surrogate.space import DesignSpace, SurrogateWarning

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["RankDeficiencyError", "fit_response_surface", "surface_study"]

#: Below this many points for each coefficient a cubic's training R² says nothing about its predictions.
POINTS_PER_COEFFICIENT = 4


class RankDeficiencyError(ValueError):
    """The points cannot tell some of the terms apart."""


def fit_response_surface(
    space: DesignSpace,
    points: ArrayLike,
    responses: ArrayLike,
    *,
    order: int = 3,
    terms: TermSet | Terms = "paper",
    test: tuple[ArrayLike, ArrayLike] | None = None,
    response: str = "response",
    unit: str = "",
    limits: tuple[float, float] | None = None,
    on_rank_deficiency: Literal["raise", "warn"] = "raise",
) -> ResponseSurface:
    """Fit a polynomial response surface (gearbox paper, Eqs. 4, 6 and 11) by least squares.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    points : array_like, shape (n, k)
        In the parameters' units.
    responses : array_like, shape (n,)
        What was simulated there.
    order : {1, 2, 3}
        Highest degree.
    terms : {"paper", "full", "eq11"} or Terms
        Which terms; see :func:`polynomial_terms`.
    test : (points, responses), optional
        Points kept for testing.
    response, unit : str
        Name and unit of the response.
    limits : tuple of two float, optional
        Bounds that no response can exceed; see :class:`ResponseSurface`.
    on_rank_deficiency : {"raise", "warn"}
        What to do when the points cannot tell some terms apart; "warn" takes the smallest coefficients.

    Returns
    -------
    ResponseSurface

    Raises
    ------
    ValueError
        For wrong sizes, responses or points that are not finite, points out of bounds, constant responses, a
        parameter that never changes, or more coefficients than points.
    RankDeficiencyError
        When terms cannot be told apart, naming them.

    Warns
    -----
    SurrogateWarning
        Below four points for each coefficient.
    """
    x, y = checked_responses(space, points, responses)
    chosen = terms if isinstance(terms, Terms) else polynomial_terms(len(space), order, terms)
    n, p = len(y), len(chosen)
    if chosen.variables != len(space):
        raise ValueError(f"the terms have {chosen.variables} variables for {len(space)} parameters")
    still = [name for name, column in zip(space.names, x.T, strict=True) if np.ptp(column) == 0.0]
    if still:
        raise ValueError(f"{', '.join(still)} never changes over the points: leave it out of the design space")
    if p > n:
        raise ValueError(
            f"{p} coefficients cannot be found from {n} points: take a lower order or fewer parameters, or "
            f"simulate at least {POINTS_PER_COEFFICIENT * p} points"
        )
    fit = solve(chosen.values(space.to_unit(x)), y)
    if fit.rank < p:
        names = chosen.names(space.names)
        involved = np.abs(fit.null).max(axis=1) > 1e-6
        message = (
            f"the points determine only {fit.rank} of {p} coefficients; these terms cannot be told apart: "
            f"{', '.join(name for name, hit in zip(names, involved, strict=True) if hit)}"
            " (too few different values of a parameter, or repeated points)"
        )
        if on_rank_deficiency == "raise":
            raise RankDeficiencyError(message)
        warnings.warn(message, SurrogateWarning, stacklevel=2)
    if n < POINTS_PER_COEFFICIENT * p:
        warnings.warn(
            f"{n} points for {p} coefficients ({n / p:.1f} each, {POINTS_PER_COEFFICIENT} advised): judge "
            "this surface by its leave-one-out or test R², not by its R²",
            SurrogateWarning,
            stacklevel=2,
        )
    surface = ResponseSurface(
        space=space,
        terms=chosen,
        coefficients=fit.coefficients,
        response=response,
        unit=unit,
        train_points=x,
        train_responses=y,
        limits=limits,
        _fit=fit,
    )
    return surface if test is None else replace(surface, test_quality=surface.test(*test))


def surface_study(
    space: DesignSpace,
    designs: Mapping[int, tuple[ArrayLike, ArrayLike]] | Sequence[tuple[ArrayLike, ArrayLike]],
    test: tuple[ArrayLike, ArrayLike],
    *,
    orders: Sequence[int] = (2, 3),
    terms: TermSet = "paper",
) -> pd.DataFrame:
    """Quality of the surface over sample counts and orders, as Figs. 9 and 10 of the gearbox paper.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    designs : sequence or mapping of (points, responses)
        One design for each sample count.
    test : (points, responses)
        The points that none of the fits sees.
    orders : sequence of int
        Orders to compare.
    terms : str
        As in :func:`polynomial_terms`.

    Returns
    -------
    DataFrame
        One row for each design and order; a fit that is not possible leaves NaN and its reason in ``note``.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for points, responses in designs.values() if isinstance(designs, Mapping) else designs:
        for order in orders:
            row: dict[str, Any] = {"points": len(np.asarray(responses)), "order": order, "note": ""}
            row["coefficients"] = len(polynomial_terms(len(space), order, terms))
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", SurrogateWarning)
                try:
                    surface = fit_response_surface(space, points, responses, order=order, terms=terms, test=test)
                except ValueError as error:
                    rows.append(row | {"note": str(error)})
                    continue
                fit, unseen = surface.quality, surface.test_quality
            row |= {"r2": fit.r2, "r2_adjusted": fit.r2_adjusted, "r2_loo": fit.r2_loo}
            if unseen is not None:
                row |= {
                    "test_r2": unseen.r2,
                    "test_max_relative_error": unseen.max_relative_error,
                    "test_mean_relative_error": unseen.mean_relative_error,
                }
            rows.append(row | {"note": "; ".join(dict.fromkeys(str(w.message) for w in caught))})
    return pd.DataFrame(rows)
