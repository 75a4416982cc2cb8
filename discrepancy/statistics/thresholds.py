"""Thresholds that several decisions share, each in one place with its reason."""

from __future__ import annotations

__all__ = [
    "DECISIVE_BIC",
    "DECISIVE_LOG_LIKELIHOOD",
    "FEWEST_FORCES",
    "LEVEL_SHARES",
    "TWIN_CORRELATION",
    "VERY_STRONG_BIC",
]

#: Difference of BIC from which two explanations are told apart: odds of twenty to one, which Kass and Raftery (1995),
#: J. Am. Stat. Assoc. 90, 773, call strong evidence.
DECISIVE_BIC = 6.0
#: Difference of BIC that they call very strong evidence: required of a pair of effects, and of a free curve.
VERY_STRONG_BIC = 10.0
#: `DECISIVE_BIC` as a difference of log-likelihood.
DECISIVE_LOG_LIKELIHOOD = 0.5 * DECISIVE_BIC
#: Correlation of what two effects change from which a fit of the second shows nothing that the first did not; chosen.
TWIN_CORRELATION = 0.999
#: Tests of one step that share the significance level: plain scan, whitened scan, pairs, free curves, omnibus test.
LEVEL_SHARES = 5
#: Instants at which a force has to be known before it is said what it is a function of: eight blocks of eight; chosen.
FEWEST_FORCES = 64
