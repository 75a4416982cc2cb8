"""Which cause a change has: the evidence of patterns, one for each cause, in several quantities at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["Cause", "Explanation", "explain_courses"]


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


def _evidences(
    change: np.ndarray, covariance: np.ndarray, causes: Mapping[str, Cause], usual: np.ndarray
) -> dict[str, tuple[float, float, float]]:
    """Return log evidence, amount and deviation of each cause and of "something else"."""
    from scipy.stats import multivariate_normal, norm

    # In units of usual changes: of quantities in metres and newtons the small variances would be taken for zero.
    unit = np.asarray(usual, dtype=float)
    d, sigma = np.asarray(change, dtype=float) / unit, np.asarray(covariance, dtype=float) / np.outer(unit, unit)
    evidences: dict[str, tuple[float, float, float]] = {}
    for name, cause in causes.items():
        s = np.asarray(cause.pattern, dtype=float) / unit
        whole = sigma + cause.size**2 * np.outer(s, s)
        evidence = float(multivariate_normal.logpdf(d, cov=whole, allow_singular=True))
        gain = cause.size**2 * np.linalg.solve(whole, s)
        amount, variance = float(gain @ d), float(cause.size**2 * (1.0 - gain @ s))
        std = float(np.sqrt(max(variance, 0.0)))
        if cause.sign:  # half of the prior, and the part of the posterior that lies on that side
            evidence += np.log(2.0) + float(norm.logcdf(cause.sign * amount / max(std, 1e-300)))
        evidences[name] = evidence, amount, std
    other = sigma + np.eye(len(unit))
    evidences[SOMETHING_ELSE] = float(multivariate_normal.logpdf(d, cov=other)), float("nan"), float("nan")
    return evidences


def explain_courses(
    rows: np.ndarray,
    courses: Mapping[str, np.ndarray],
    causes: Mapping[str, Mapping[str, Cause]],
    usual: np.ndarray,
    pattern_error: float = 0.0,
    shrinkage: float = 0.0,
) -> tuple[Explanation, ...]:
    """Return the causes of a change with their probabilities, the most probable first.

    Each cause has the marginal likelihood of the records with its amount integrated over the prior; "something else" is
    a change of every quantity by itself.  All have the same prior probability.  Causes may differ in their course over
    time as well: record k is a level plus the change times the course, plus noise with one covariance for all courses,
    that of the residuals of the course that fits best.

    Parameters
    ----------
    rows : ndarray, shape (n, m)
        Quantities of each record, in the order of time.
    courses : mapping of str to ndarray, shape (n,)
        Such as a step and a ramp, zero before the change.
    causes : mapping of str to mapping of str to Cause
        By course.
    usual : ndarray, shape (m,)
        Size of changes of each quantity, for "something else", which may have any of the courses.
    pattern_error : float
        Share of the largest change, relative to the usual ones, by which patterns may be wrong.
    shrinkage : float
        Share by which the covariance of few records is pulled towards a diagonal one.
    """
    fits = {}
    for name, course in courses.items():
        x = np.column_stack([np.ones(len(rows)), course])
        solution, *_ = np.linalg.lstsq(x, rows, rcond=None)
        rest = rows - x @ solution
        fits[name] = solution[1], rest, float(np.linalg.inv(x.T @ x)[1, 1])
    scale = np.asarray(usual, dtype=float)
    best = min(fits.values(), key=lambda fit: float(np.sum((fit[1] / scale) ** 2)))
    noise = best[1].T @ best[1] / max(len(rows) - 2, 1)
    noise = (1.0 - shrinkage) * noise + shrinkage * np.diag(np.diag(noise)) + np.diag((1e-6 * scale) ** 2)
    precision = np.linalg.inv(noise)
    by_cause: dict[str, tuple[float, float, float]] = {}
    for name, (change, rest, factor) in fits.items():
        wrong = pattern_error * float(np.max(np.abs(change / scale))) * scale
        fitted = -0.5 * float(np.sum((rest @ precision) * rest)) + 0.5 * float(np.linalg.slogdet(noise * factor)[1])
        evidences = _evidences(change, noise * factor + np.diag(wrong**2), causes[name], usual)
        for cause, (evidence, amount, std) in evidences.items():
            if cause not in by_cause or evidence + fitted > by_cause[cause][0]:
                by_cause[cause] = evidence + fitted, amount, std
    return _ranked(by_cause)


def _ranked(found: Mapping[str, tuple[float, float, float]]) -> tuple[Explanation, ...]:
    """Return explanations from log evidence, amount and deviation of each."""
    most = max(evidence for evidence, _, _ in found.values())
    weights = {name: float(np.exp(evidence - most)) for name, (evidence, _, _) in found.items()}
    whole_weight = sum(weights.values())
    explanations = [
        Explanation(cause=n, amount=found[n][1], std=found[n][2], probability=w / whole_weight)
        for n, w in weights.items()
    ]
    return tuple(sorted(explanations, key=lambda e: -e.probability))
