"""Surfaces of what the model puts out, instead of one surface of a misfit.

A misfit has kinks, valleys and a flat top that a cubic cannot follow; the complex amplitudes behind it are smooth in
the parameters.  Each gets its own surface, and the objective is worked out from what they predict.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gearbox.updating.objectives import AmplitudeObjective
from surrogate import DesignSpace, ResponseSurface, SurrogateWarning, TestQuality, fit_response_surface

__all__ = ["OutputSurfaces", "output_surface_study"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputSurfaces:
    """An objective of amplitudes, predicted from surfaces of each amplitude's real and imaginary part.

    Parameters
    ----------
    objective : AmplitudeObjective
    space : DesignSpace
    surfaces : tuple of ResponseSurface
        In the order of the numbers: real parts, then imaginary parts, each over recordings, sensors, orders.
    train_points : ndarray, shape (n, k)
    train_responses : ndarray, shape (n,)
        The objective at the simulated points.
    test_quality : TestQuality, optional
    """

    objective: AmplitudeObjective
    space: DesignSpace
    surfaces: tuple[ResponseSurface, ...]
    train_points: Array
    train_responses: Array
    test_quality: TestQuality | None = None
    shape: tuple[int, ...] = field(default=())

    vectorised: ClassVar[bool] = True

    def predict(self, points: ArrayLike) -> Array:
        """The objective at points, shape (n,)."""
        return self._values(np.column_stack([s.predict(points) for s in self.surfaces]))

    def __call__(self, points: ArrayLike) -> Array:
        return self.predict(points)

    def loo_residuals(self) -> Array:
        """Objective minus what the surfaces say with each point left out in turn, shape (n,)."""
        left_out = np.column_stack([np.asarray(s.train_responses) - s.loo_residuals() for s in self.surfaces])
        return np.asarray(self.train_responses - self._values(left_out))

    def _values(self, numbers: Array) -> Array:
        half = numbers.shape[1] // 2
        tables = (numbers[:, :half] + 1j * numbers[:, half:]).reshape(-1, *self.shape)
        return np.array([1.0 - self.objective.misfit(t) if np.isfinite(t).all() else np.nan for t in tables])

    @property
    def term_names(self) -> tuple[str, ...]:
        """Terms of each surface."""
        return self.surfaces[0].term_names

    @property
    def coefficients(self) -> Array:
        """Coefficients of all surfaces, shape (numbers, terms)."""
        return np.array([s.coefficients for s in self.surfaces])

    def __repr__(self) -> str:
        quality = f", test R² {self.test_quality.r2:.4f}" if self.test_quality else ""
        return f"OutputSurfaces({len(self.surfaces)} surfaces of {self.objective.name}{quality})"


def _numbers(tables: NDArray[np.complex128]) -> Array:
    flat = tables.reshape(tables.shape[0], -1)
    return np.hstack([flat.real, flat.imag])


def fit_output_surfaces(
    objective: AmplitudeObjective,
    space: DesignSpace,
    points: Array,
    tables: NDArray[np.complex128],
    *,
    order: int,
    test: tuple[Array, NDArray[np.complex128]] | None = None,
) -> OutputSurfaces:
    """Fit a surface to each number that the objective compares.

    Parameters
    ----------
    objective : AmplitudeObjective
    space : DesignSpace
    points : ndarray, shape (n, k)
    tables : ndarray of complex, shape (n, recordings, sensors, orders)
        As :meth:`AmplitudeObjective.of_runs` returns them.
    order : int
    test : (points, tables), optional
        Kept for testing.

    Raises
    ------
    ValueError
        As :func:`surrogate.fit_response_surface`.
    """
    numbers = _numbers(tables)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurrogateWarning)
        surfaces = tuple(fit_response_surface(space, points, column, order=order) for column in numbers.T)
    values = np.array([1.0 - objective.misfit(t) for t in tables])
    surfaces_of_outputs = OutputSurfaces(
        objective=objective,
        space=space,
        surfaces=surfaces,
        train_points=points,
        train_responses=values,
        test_quality=None,
        shape=tables.shape[1:],
    )
    if test is None:
        return surfaces_of_outputs
    wanted = np.array([1.0 - objective.misfit(t) for t in test[1]])
    judged = TestQuality.of(wanted, surfaces_of_outputs.predict(test[0]))
    return OutputSurfaces(
        objective=objective,
        space=space,
        surfaces=surfaces,
        train_points=points,
        train_responses=values,
        test_quality=judged,
        shape=tables.shape[1:],
    )


def output_surface_study(
    objective: AmplitudeObjective,
    space: DesignSpace,
    designs: Sequence[tuple[Array, NDArray[np.complex128]]],
    test: tuple[Array, NDArray[np.complex128]],
    orders: Sequence[int],
) -> tuple[Any, dict[tuple[int, int], OutputSurfaces]]:
    """Quality of the objective that the surfaces predict, over sample counts and orders.

    Returns
    -------
    study : DataFrame
        As :func:`surrogate.surface_study`.
    fitted : dict
        By number of points and order.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    fitted = {}
    for points, tables in designs:
        for order in orders:
            row: dict[str, Any] = {"points": len(points), "order": order, "note": ""}
            try:
                outputs = fit_output_surfaces(objective, space, points, tables, order=order, test=test)
            except ValueError as error:
                rows.append(row | {"note": str(error)})
                continue
            y, unseen = outputs.train_responses, outputs.test_quality
            assert unseen is not None
            spread = float(((y - y.mean()) ** 2).sum())
            row |= {
                "coefficients": len(outputs.term_names),
                "r2": 1.0 - float(((y - outputs.predict(points)) ** 2).sum()) / spread,
                "r2_loo": 1.0 - float((outputs.loo_residuals() ** 2).sum()) / spread,
                "test_r2": unseen.r2,
                "test_max_relative_error": unseen.max_relative_error,
                "test_mean_relative_error": unseen.mean_relative_error,
            }
            rows.append(row)
            fitted[len(points), order] = outputs
    return pd.DataFrame(rows), fitted
