"""Which cause a change has: the evidence of patterns, one for each cause, in several quantities at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["Cause", "Explanation", "explain_change"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """What a cause does to the quantities.

    Parameters
    ----------
    pattern : ndarray, shape (m,)
        Change of each quantity for a unit of the cause.
    size : float
        How much of it is usual: standard deviation of its prior.
    sign : int
        1 or -1 where it can only go one way, else 0.
    unit : str
    """

    pattern: np.ndarray
    size: float
    sign: int = 0
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A cause as an explanation of a change.

    Parameters
    ----------
    cause : str
    amount, std : float
        Of the cause, if it is the one.
    probability : float
        Among all causes that were given and "something else".
    """

    cause: str
    amount: float
    std: float
    probability: float

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the amount."""
        return self.amount - 1.96 * self.std, self.amount + 1.96 * self.std


#: Name of what none of the causes is.
SOMETHING_ELSE = "something else"


def explain_change(
    change: np.ndarray, covariance: np.ndarray, causes: Mapping[str, Cause], usual: np.ndarray
) -> tuple[Explanation, ...]:
    """Return the causes of a change with their probabilities, the most probable first.

    Each cause has the marginal likelihood of the change with its amount integrated over the prior;
    "something else" is a change of every quantity by itself.  All have the same prior probability.

    Parameters
    ----------
    change : ndarray, shape (m,)
    covariance : ndarray, shape (m, m)
        Of the change as it was estimated.
    causes : mapping of str to Cause
    usual : ndarray, shape (m,)
        Size of changes of each quantity, for "something else".
    """
    from scipy.stats import multivariate_normal, norm

    d, sigma = np.asarray(change, dtype=float), np.asarray(covariance, dtype=float)
    found: dict[str, tuple[float, float, float]] = {}
    for name, cause in causes.items():
        s = np.asarray(cause.pattern, dtype=float)
        whole = sigma + cause.size**2 * np.outer(s, s)
        evidence = float(multivariate_normal.logpdf(d, cov=whole, allow_singular=True))
        gain = cause.size**2 * np.linalg.solve(whole, s)
        amount, variance = float(gain @ d), float(cause.size**2 * (1.0 - gain @ s))
        std = float(np.sqrt(max(variance, 0.0)))
        if cause.sign:  # half of the prior, and the part of the posterior that lies on that side
            evidence += np.log(2.0) + float(norm.logcdf(cause.sign * amount / max(std, 1e-300)))
        found[name] = evidence, amount, std
    other = sigma + np.diag(np.asarray(usual, dtype=float) ** 2)
    found[SOMETHING_ELSE] = float(multivariate_normal.logpdf(d, cov=other)), float("nan"), float("nan")
    most = max(evidence for evidence, _, _ in found.values())
    weights = {name: float(np.exp(evidence - most)) for name, (evidence, _, _) in found.items()}
    whole_weight = sum(weights.values())
    explanations = [
        Explanation(cause=n, amount=found[n][1], std=found[n][2], probability=w / whole_weight)
        for n, w in weights.items()
    ]
    return tuple(sorted(explanations, key=lambda e: -e.probability))
