"""Whether shown probabilities hold: Brier score, calibration error, reliability diagram, and a temperature."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "brier_score",
    "brier_score_of_models",
    "calibration_error",
    "fitted_temperature",
    "jeffreys",
    "reliability",
    "reliability_figure",
    "tempered",
]

Array = NDArray[np.float64]

BINS = 10  # of equal width, as usual for the expected calibration error (Guo et al. 2017)
TEMPERATURES = (0.05, 100.0)  # between which one is looked for: from nearly certain to nearly uniform
STARTS = 40  # temperatures among which the neighbourhood of the best is looked for


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Statements of about one probability: its mean, how often they are true, the 95 % interval, their number."""

    shown: float
    frequency: float
    low: float
    high: float
    count: int


def jeffreys(hits: int, trials: int) -> tuple[float, float]:
    """Return the 95 % Jeffreys interval of a rate (Brown, Cai and DasGupta 2001).

    Examples
    --------
    >>> low, high = jeffreys(0, 60)
    >>> low, round(high, 3)
    (0.0, 0.041)
    """
    from scipy.stats import beta

    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits + 0.5, trials - hits + 0.5))
    high = 1.0 if hits == trials else float(beta.ppf(0.975, hits + 0.5, trials - hits + 0.5))
    return low, high


def brier_score(shown: ArrayLike, true: ArrayLike) -> float:
    """Return the mean square of probability shown less truth (0 or 1).

    Examples
    --------
    >>> brier_score([1.0, 1.0, 0.5, 0.5], [1, 0, 1, 0])
    0.375
    """
    return float(np.mean((np.asarray(shown, float) - np.asarray(true, float)) ** 2))


def brier_score_of_models(probability: ArrayLike, true: ArrayLike) -> float:
    """Return the Brier score of several categories: (1 − p of the truth)² + Σ p² of the others, the mean over cases.

    Parameters
    ----------
    probability : array_like, shape (cases, models)
    true : array_like of bool, shape (cases, models)

    Examples
    --------
    >>> brier_score_of_models([[0.5, 0.5], [1.0, 0.0]], [[True, False], [True, False]])
    0.25
    """
    p, right = np.asarray(probability, float), np.asarray(true, bool)
    of_truth = np.where(right, p, 0.0).sum(axis=1)
    return float(np.mean((1.0 - of_truth) ** 2 + np.where(right, 0.0, p**2).sum(axis=1)))


def reliability(shown: ArrayLike, true: ArrayLike) -> list[Bin]:
    """Return the bins of a reliability diagram that have statements in them."""
    p, t = np.asarray(shown, float), np.asarray(true, float)
    place = np.minimum((p * BINS).astype(int), BINS - 1)
    bins = []
    for k in np.unique(place):
        of = place == k
        count, hits = int(of.sum()), int(t[of].sum())
        low, high = jeffreys(hits, count)
        bins.append(Bin(shown=float(p[of].mean()), frequency=hits / count, low=low, high=high, count=count))
    return bins


def calibration_error(shown: ArrayLike, true: ArrayLike) -> float:
    """Return the expected calibration error: |probability shown − frequency|, averaged over statements by bins.

    Examples
    --------
    >>> round(calibration_error([0.9, 0.9, 0.9, 0.9, 0.1, 0.1], [1, 1, 1, 0, 0, 0]), 4)
    0.1333
    """
    bins = reliability(shown, true)
    total = sum(b.count for b in bins)
    return float(sum(b.count * abs(b.shown - b.frequency) for b in bins) / total) if total else float("nan")


def tempered(log_evidence: ArrayLike, temperature: float, log_prior: ArrayLike = 0.0) -> Array:
    """Return softmax(log evidence / temperature + log prior) over the models, the last axis.

    Probabilities are tempered by giving their logarithms.

    Examples
    --------
    >>> tempered([[0.0, np.log(3.0)]], 1.0).round(2).tolist()
    [[0.25, 0.75]]
    """
    from scipy.special import softmax

    return np.asarray(softmax(np.asarray(log_evidence, float) / temperature + np.asarray(log_prior, float), axis=-1))


def fitted_temperature(log_evidence: ArrayLike, true: ArrayLike, log_prior: ArrayLike = 0.0) -> float:
    """Return the temperature of the smallest Brier score; fit it on one half and show the other.

    The likelihood of the true models would ask for one that excuses the worst case: a true model whose fit ended
    hundreds of nats too low.  The Brier score is bounded.

    Parameters
    ----------
    log_evidence : array_like, shape (cases, models)
        −inf where a case has fewer models.
    true : array_like of bool, shape (cases, models)
        The models that are true: one, or several that do not differ in what counts.
    log_prior : array_like, shape (cases, models), optional
        What was known before the records were seen, which is not divided.

    Raises
    ------
    ValueError
        If no case has a finite evidence of its true model.
    """
    from scipy.optimize import minimize_scalar

    evidence, right = np.asarray(log_evidence, float), np.asarray(true, bool)
    prior = np.broadcast_to(np.asarray(log_prior, float), evidence.shape)
    known = (np.isfinite(evidence) & right).any(axis=1)
    if not known.any():
        raise ValueError("no case has a finite evidence of its true model: a temperature cannot be fitted")
    evidence, right, prior = evidence[known], right[known], prior[known]

    def score(log_temperature: float) -> float:
        return brier_score_of_models(tempered(evidence, math.exp(log_temperature), prior), right)

    grid = np.linspace(math.log(TEMPERATURES[0]), math.log(TEMPERATURES[1]), STARTS)
    k = int(np.argmin([score(x) for x in grid]))  # there may be several minima
    minimum = minimize_scalar(score, bounds=(grid[max(k - 1, 0)], grid[min(k + 1, STARTS - 1)]), method="bounded")
    return float(np.exp(minimum.x))


def reliability_figure(series: Sequence[tuple[str, ArrayLike, ArrayLike]]) -> Figure:
    """Draw a reliability diagram.

    Parameters
    ----------
    series : sequence of (name, shown, true)
        Each with the probabilities shown and whether they came true.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", lw=1.0, label="as often as shown")
    for name, shown, true in series:
        bins = reliability(shown, true)
        x, y = [b.shown for b in bins], [b.frequency for b in bins]
        spread = [[b.frequency - b.low for b in bins], [b.high - b.frequency for b in bins]]
        label = f"{name} (error {calibration_error(shown, true):.3f}, Brier {brier_score(shown, true):.3f})"
        axes.errorbar(x, y, yerr=np.maximum(spread, 0.0), fmt="o-", capsize=3, lw=1.2, label=label)
        for b in bins:
            axes.annotate(f"{b.count}", (b.shown, b.frequency), xytext=(5, -11), textcoords="offset points", fontsize=7)
    axes.set(xlabel="probability shown", ylabel="share that is true", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
    axes.legend(loc="upper left", fontsize=8)
    return figure
