"""A polynomial response surface: prediction with intervals, derivatives, quality."""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surrogate.least_squares import LinearFit, solve
from surrogate.plots import plot_surface
from surrogate.polynomial import Terms, TermSet, polynomial_terms
from surrogate.quality import FitQuality, TestQuality, r_squared, relative_errors
from surrogate.space import DesignSpace, SurrogateWarning

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["ResponseSurface"]

Array = NDArray[np.float64]
_SCHEMA = 1
_NEEDED = ("schema", "space", "exponents", "coefficients", "response", "unit")


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseSurface:
    """A polynomial in parameters scaled to [0, 1].

    Made by :func:`surrogate.fit_response_surface`, or from published coefficients by
    :meth:`from_coefficients`. Calling it is :meth:`predict`.

    Parameters
    ----------
    space : DesignSpace
        The parameters and the bounds that scale them.
    terms : Terms
        The monomials in the scaled parameters.
    coefficients : ndarray, shape (p,)
        In the response's unit.
    response : str
        What the surface stands for.
    unit : str
        The response's unit.
    train_points, train_responses : ndarray, shape (n, k) and (n,), optional
        What it was fitted to, in the parameters' units; absent from published surfaces.
    test_quality : TestQuality, optional
        On points kept for testing.
    limits : tuple of two float, optional
        Bounds that no response can exceed, such as (−1, 1) for a cosine similarity; a polynomial can, and
        :func:`surrogate.maximise` warns where its maximum does.
    """

    space: DesignSpace
    terms: Terms
    coefficients: Array
    response: str = "response"
    unit: str = ""
    train_points: Array | None = None
    train_responses: Array | None = None
    test_quality: TestQuality | None = None
    limits: tuple[float, float] | None = None
    _fit: LinearFit | None = field(default=None, repr=False)

    #: Points of shape (n, k) are accepted: optimisers evaluate whole swarms at once.
    vectorised: ClassVar[bool] = True

    def __post_init__(self) -> None:
        c = np.array(self.coefficients, dtype=float)
        if self.terms.variables != len(self.space):
            raise ValueError(f"the terms have {self.terms.variables} variables for {len(self.space)} parameters")
        if c.shape != (len(self.terms),):
            raise ValueError(f"{c.size} coefficients of shape {c.shape} for {len(self.terms)} terms")
        if not np.isfinite(c).all():
            bad = [name for name, ok in zip(self.term_names, np.isfinite(c), strict=True) if not ok]
            raise ValueError(f"coefficients are not finite: {', '.join(bad)}")
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise ValueError(f"limits must rise, not {self.limits}")
        c.setflags(write=False)
        object.__setattr__(self, "coefficients", c)
        if (self.train_points is None) != (self.train_responses is None):
            raise ValueError("give the points of the fit and their responses together, or neither")
        if self.train_points is not None and self._fit is None:
            t = self.space.to_unit(self.train_points)
            object.__setattr__(self, "_fit", solve(self.terms.values(t), np.asarray(self.train_responses)))

    @classmethod
    def from_coefficients(
        cls,
        space: DesignSpace,
        coefficients: ArrayLike,
        *,
        order: int = 3,
        terms: TermSet | Terms = "paper",
        response: str = "response",
        unit: str = "",
    ) -> ResponseSurface:
        """A surface from known coefficients, in the order of :func:`polynomial_terms`."""
        chosen = terms if isinstance(terms, Terms) else polynomial_terms(len(space), order, terms)
        return cls(
            space=space,
            terms=chosen,
            coefficients=np.asarray(coefficients, dtype=float),
            response=response,
            unit=unit,
        )

    @property
    def term_names(self) -> tuple[str, ...]:
        """The terms in words; a name stands for the scaled parameter."""
        return self.terms.names(self.space.names)

    @property
    def quality(self) -> FitQuality:
        """Quality of the fit, leave-one-out included.

        Raises
        ------
        ValueError
            If the surface was made from coefficients.
        """
        fit = self._needs_fit("its quality")
        y = np.asarray(self.train_responses)
        predicted = self.terms.values(self.space.to_unit(np.asarray(self.train_points))) @ self.coefficients
        errors = y - predicted
        n, spare = len(y), len(y) - fit.rank
        worst, mean = relative_errors(y, predicted)
        r2 = r_squared(y, errors)
        return FitQuality(
            points=n,
            coefficients=len(self.terms),
            rank=fit.rank,
            r2=r2,
            r2_adjusted=1.0 - (1.0 - r2) * (n - 1) / spare if spare > 0 else float("nan"),
            r2_loo=r_squared(y, self.loo_residuals()),
            rmse=float(np.sqrt(np.mean(errors**2))),
            sigma=float(np.sqrt((errors**2).sum() / spare)) if spare > 0 else float("nan"),
            max_relative_error=worst,
            mean_relative_error=mean,
            condition=fit.condition,
        )

    def loo_residuals(self) -> Array:
        """Response minus prediction with each point left out in turn, shape (n,).

        From the hat matrix, without refitting; NaN where a point alone determines a coefficient.
        """
        fit = self._needs_fit("leave-one-out residuals")
        t = self.space.to_unit(np.asarray(self.train_points))
        errors = np.asarray(self.train_responses) - self.terms.values(t) @ self.coefficients
        free = 1.0 - fit.leverages
        possible = free > 1e-10
        return np.where(possible, errors / np.where(possible, free, 1.0), np.nan)

    def predict(self, points: ArrayLike, *, outside: Literal["raise", "allow"] = "raise") -> Array:
        """Response at points.

        Parameters
        ----------
        points : array_like, shape (n, k) or (k,)
            In the parameters' units.
        outside : {"raise", "allow"}
            What to do with points beyond the bounds, where a polynomial means nothing.

        Returns
        -------
        ndarray, shape (n,)
            In the response's unit; one point gives shape (1,).
        """
        return self.terms.values(self._scaled(points, outside)) @ self.coefficients

    def __call__(self, points: ArrayLike) -> Array:
        return self.predict(points)

    def gradient(self, points: ArrayLike) -> Array:
        """Derivatives by the parameters, shape (n, k), response's unit per parameter's unit."""
        slopes = np.einsum("npk,p->nk", self.terms.gradient(self._scaled(points, "raise")), self.coefficients)
        return slopes / self.space.span

    def hessian(self, points: ArrayLike) -> Array:
        """Second derivatives by the parameters, shape (n, k, k)."""
        curved = np.einsum("npij,p->nij", self.terms.hessian(self._scaled(points, "raise")), self.coefficients)
        return curved / np.multiply.outer(self.space.span, self.space.span)

    def prediction_interval(self, points: ArrayLike, *, confidence: float = 0.95) -> tuple[Array, Array, Array]:
        """Prediction and the interval in which a new response is expected.

        Student's t on the residual scatter: right for scatter that is independent from point to point. A
        simulation's misfit to a polynomial is not, so check the coverage on test points before relying on it.

        Parameters
        ----------
        points : array_like, shape (n, k)
            In the parameters' units.
        confidence : float
            Between 0 and 1.

        Returns
        -------
        prediction, low, high : ndarray, shape (n,)

        Raises
        ------
        ValueError
            Without spare points, with terms that cannot be told apart, or from published coefficients.
        """
        if not 0.0 < confidence < 1.0:
            raise ValueError(f"confidence must lie between 0 and 1, not {confidence}")
        fit = self._needs_fit("prediction intervals")
        quality = self.quality
        if fit.rank < len(self.terms):
            raise ValueError("no prediction interval: some terms cannot be told apart; fit a lower order")
        if quality.points <= fit.rank:
            raise ValueError(f"no prediction interval: {quality.points} points leave none over to judge scatter")
        from scipy.stats import t as student

        values = self.terms.values(self._scaled(points, "raise"))
        centre = values @ self.coefficients
        leverage = ((values @ fit.spread) ** 2).sum(axis=1)
        factor = float(student.ppf(0.5 + confidence / 2, quality.points - fit.rank))
        half = factor * quality.sigma * np.sqrt(1.0 + leverage)
        return centre, centre - half, centre + half

    def test(self, points: ArrayLike, responses: ArrayLike) -> TestQuality:
        """Quality on points that were not used in the fit."""
        x, y = checked_responses(self.space, points, responses, "test ")
        return TestQuality.of(y, self.predict(x))

    def to_frame(self) -> pd.DataFrame:
        """Coefficients in the scaled parameters, with standard errors where the fit gives them."""
        import pandas as pd

        frame = pd.DataFrame(
            {"coefficient": self.coefficients},
            index=pd.Index(self.term_names, name="term (scaled to [0, 1])"),
        )
        if self._fit is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SurrogateWarning)
                sigma = self.quality.sigma
            std = sigma * np.sqrt((self._fit.spread**2).sum(axis=1))
            frame["std_error"] = np.where(self._fit.rank == len(self.terms), std, np.nan)
        return frame

    def plot(self) -> Figure:
        """Predicted against simulated responses and a cut along each parameter; returns the figure."""
        fitted = None
        if self.train_points is not None:
            responses = np.asarray(self.train_responses)
            fitted = responses, self.predict(self.train_points), responses - self.loo_residuals()
        label = f"{self.response} [{self.unit}]" if self.unit else self.response
        return plot_surface(self.space, self.predict, label, fitted)

    def to_dict(self) -> dict[str, Any]:
        """Plain content, for JSON; numbers keep all their digits."""
        content: dict[str, Any] = {
            "schema": _SCHEMA,
            "kind": "polynomial response surface",
            "response": self.response,
            "unit": self.unit,
            "space": self.space.to_dict(),
            "terms": list(self.term_names),
            "exponents": [list(row) for row in self.terms.exponents],
            "coefficients": self.coefficients.tolist(),
        }
        if self.train_points is not None and self.train_responses is not None:
            content["train"] = {
                "points": self.train_points.tolist(),
                "responses": self.train_responses.tolist(),
            }
        if self.test_quality is not None:
            content["test_quality"] = asdict(self.test_quality)
        if self.limits is not None:
            content["limits"] = list(self.limits)
        return content

    @classmethod
    def from_dict(cls, content: Any) -> ResponseSurface:
        """Read what :meth:`to_dict` returned.

        Raises
        ------
        ValueError
            Naming what is wrong.
        """
        if not isinstance(content, dict):
            raise ValueError(f"expected an object with {', '.join(_NEEDED)}")
        missing = [key for key in _NEEDED if key not in content]
        if missing:
            raise ValueError(f"not a response surface; it lacks {', '.join(missing)}")
        if content["schema"] != _SCHEMA:
            raise ValueError(f"schema {content['schema']} is not known here (expected {_SCHEMA})")
        try:
            train = content.get("train")
            tested = content.get("test_quality")
            limits = content.get("limits")
            space = DesignSpace.from_dict(content["space"])
            points = None if train is None else space.points(train["points"], what="train points")
            responses = None if train is None else np.array(train["responses"], dtype=float)
            if points is not None and responses is not None and responses.shape != (points.shape[0],):
                raise ValueError(f"{responses.size} train responses for {points.shape[0]} train points")
            return cls(
                space=space,
                terms=Terms(tuple(tuple(row) for row in content["exponents"])),
                coefficients=np.array(content["coefficients"], dtype=float),
                response=str(content["response"]),
                unit=str(content["unit"]),
                train_points=points,
                train_responses=responses,
                test_quality=None if tested is None else TestQuality(**tested),
                limits=None if limits is None else (float(limits[0]), float(limits[1])),
            )
        except KeyError as error:
            raise ValueError(f"lacks {error}") from error
        except TypeError as error:
            raise ValueError(str(error)) from error

    def save(self, path: str | Path) -> None:
        """Write to a JSON file."""
        Path(path).write_text(json.dumps(self.to_dict(), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> ResponseSurface:
        """Read from a JSON file written by :meth:`save`.

        Raises
        ------
        ValueError
            Naming the file and what is wrong with it.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{path}: not a JSON file ({error})") from error
        try:
            return cls.from_dict(content)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error

    def __repr__(self) -> str:
        head = f"ResponseSurface of {self.response}{f' [{self.unit}]' if self.unit else ''}: "
        head += f"order {self.terms.order}"
        head += f", {len(self.terms)} coefficients in {', '.join(self.space.names)}"
        if self._fit is None:
            return head + " (given coefficients)"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SurrogateWarning)
            q = self.quality
        tail = f"; {q.points} points, R² {q.r2:.4f}, leave-one-out R² {q.r2_loo:.4f}"
        return head + tail + (f", test R² {self.test_quality.r2:.4f}" if self.test_quality else "")

    def _scaled(self, points: ArrayLike, outside: str) -> Array:
        return self.space.to_unit(points, inside=outside == "raise")

    def _needs_fit(self, what: str) -> LinearFit:
        if self._fit is None:
            raise ValueError(f"this surface was made from given coefficients: {what} would need the fitted points")
        return self._fit


def checked_responses(
    space: DesignSpace, points: ArrayLike, responses: ArrayLike, what: str = ""
) -> tuple[Array, Array]:
    """Check points and responses together; ``what`` is put before both in messages (such as ``"test "``)."""
    x = space.points(points, what=f"{what}points").copy()
    y = np.array(responses, dtype=float)
    if y.shape != (x.shape[0],):
        raise ValueError(f"{what}responses have shape {y.shape} for {x.shape[0]} points; expected ({x.shape[0]},)")
    if not np.isfinite(y).all():
        rows = np.flatnonzero(~np.isfinite(y))
        raise ValueError(
            f"{what}responses are not finite in rows {rows.tolist()}: leave out the points whose simulation failed"
        )
    if len(y) > 1 and np.ptp(y) <= 1e-13 * np.abs(y).max():
        raise ValueError(f"{what}responses are all {y[0]:.6g}: they do not vary, so there is nothing to fit")
    return x, y
