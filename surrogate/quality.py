"""How well a surface fits: on its own points, with each point left out, and on points it has not seen."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from surrogate.space import SurrogateWarning

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FitQuality", "TestQuality", "r_squared", "relative_errors"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FitQuality:
    """Quality on the points of the fit.

    Parameters
    ----------
    points, coefficients, rank : int
        Size of the problem; a rank below the number of coefficients means that some cannot be told apart.
    r2 : float
        Share of the responses' variance explained (Eq. 6). Never falls when terms are added: not to be
        reported alone.
    r2_adjusted : float
        The same, freed of the number of coefficients; NaN without spare points.
    r2_loo : float
        Share explained when each point is predicted from the others; NaN if a point cannot be left out.
    rmse : float
        Root mean square residual, in the response's unit.
    sigma : float
        Its estimate corrected for the number of coefficients; NaN without spare points.
    max_relative_error, mean_relative_error : float
        Of the residuals, relative to the responses.
    condition : float
        Condition number of the column-scaled matrix of terms.
    """

    points: int
    coefficients: int
    rank: int
    r2: float
    r2_adjusted: float
    r2_loo: float
    rmse: float
    sigma: float
    max_relative_error: float
    mean_relative_error: float
    condition: float

    def to_frame(self) -> pd.DataFrame:
        """One row with every figure."""
        import pandas as pd

        return pd.DataFrame([asdict(self)])


@dataclass(frozen=True, kw_only=True)
class TestQuality:
    """Quality on points that were not used in the fit; fields as in :class:`FitQuality`."""

    __test__ = False  # the name would make pytest collect it

    points: int
    r2: float
    rmse: float
    max_relative_error: float
    mean_relative_error: float

    def to_frame(self) -> pd.DataFrame:
        """One row with every figure."""
        import pandas as pd

        return pd.DataFrame([asdict(self)])

    @classmethod
    def of(cls, responses: Array, predictions: Array) -> TestQuality:
        """Compare predictions with responses, both of shape (n,)."""
        worst, mean = relative_errors(responses, predictions)
        return cls(
            points=len(responses),
            r2=r_squared(responses, responses - predictions),
            rmse=float(np.sqrt(np.mean((responses - predictions) ** 2))),
            max_relative_error=worst,
            mean_relative_error=mean,
        )


def r_squared(responses: Array, errors: Array) -> float:
    """Eq. 6: one minus the errors' sum of squares over the responses' about their mean.

    NaN for a single response; constant responses are refused by the caller.
    """
    total = float(((responses - responses.mean()) ** 2).sum())
    return 1.0 - float((errors**2).sum()) / total if total > 0.0 else float("nan")


def relative_errors(responses: Array, predictions: Array) -> tuple[float, float]:
    """Largest and mean |error| / |response|; responses that are zero compared with the others are left out."""
    scale = np.abs(responses)
    usable = scale > 1e-12 * scale.max()
    if not usable.all():
        warnings.warn(
            f"relative errors leave out rows {np.flatnonzero(~usable).tolist()}: their responses are zero",
            SurrogateWarning,
            stacklevel=3,
        )
    if not usable.any():
        return float("nan"), float("nan")
    relative = np.abs(predictions - responses)[usable] / scale[usable]
    return float(relative.max()), float(relative.mean())
