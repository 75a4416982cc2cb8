"""From numbers to sentences: missing, negligible, absent, or cannot tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from discrepancy.statistics.blocks import Array

#: Log-likelihood that many columns must gain on blocks left out: what tells two explanations apart elsewhere.
HELD_OUT = 3.0


class Verdict(StrEnum):
    """What the records say about one candidate."""

    MISSING = "missing"
    NEGLIGIBLE = "present but negligible"
    ABSENT = "absent"
    CANNOT_TELL = "cannot tell"
    REFUSED = "refused"


@dataclass(frozen=True)
class Row:
    """What a scan found about one candidate.

    Attributes
    ----------
    lm : float
        Score statistic sᵀH⁻¹s in units of the whitened noise variance.
    lam : float
        Inflation of its variance by the colour of the residual.
    p, p_single : float
        Family-wise p (the largest score of all candidates by luck) and the candidate's own, shape grid
        included.
    gain : float
        Calibrated log-likelihood gain, LM/(2·λ̄) with one λ̄ for all candidates, so that gains can be
        compared.
    delta_bic : float
        Change of BIC with the effective number of observations; negative favours the effect.
    amplitude, std : ndarray, shape (k,)
        Expected amplitude after recalibration and its standard error.
    kappa : float
        Share of the effect that calibration can absorb.
    mde : float
        Smallest amplitude that this scan would have declared with a chance of 80 %, at the shape that fits best; where
        the verdict there is "absent", at the shape of the grid at which what matters shows least.
    delta : float
        Amplitude that would matter, at the same shape.
    error_drop : float
        Predicted relative drop of the whitened residual's energy.
    absorbed : dict
        Parameter → change that calibration had made to imitate the effect.
    held_out_gain : float
        Log-likelihood gain predicted for a block from the amplitude of the others, summed over blocks.
    reason : str
        Why the verdict is what it is.
    group : int
        Of the scorer, for the shape that fits best.
    needed : float
        Standard errors at which this candidate would be declared.
    """

    kind: str
    where: str
    lm: float
    lam: float
    p: float
    p_single: float
    gain: float
    delta_bic: float
    amplitude: Array
    std: Array
    kappa: float
    mde: float
    delta: float
    error_drop: float
    dof: float
    verdict: Verdict
    reason: str
    shape: dict[str, float]
    absorbed: dict[str, float]
    held_out_gain: float
    unit: str = ""
    group: int = -1
    needed: float = float("nan")

    @property
    def carries_over(self) -> bool:
        """True if the amplitude found on all blocks but one says something of that one.

        What has many columns can follow a residual that one or two of a few blocks carry.
        """
        return self.held_out_gain > HELD_OUT

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind}@{self.where}"


def decide(
    *, p: float, level: float, size: float, mde: float, delta: float, dof: float, few: bool
) -> tuple[Verdict, str]:
    """Verdict and its reason for one candidate.

    Parameters
    ----------
    p : float
        Family-wise p.
    level : float
        Claims are made below it.
    size : float
        Size of the expected amplitude.
    mde, delta : float
        Smallest amplitude that can be shown; amplitude that would matter.
    dof : float
        Degrees of freedom with which the noise is known where the candidate acts.
    few : bool
        True if there are too few pieces to shuffle.
    """
    if p < level:
        if size > delta:
            return Verdict.MISSING, f"p = {p:.2g}, expected amplitude {size:.3g} exceeds {delta:.3g}"
        return (
            Verdict.NEGLIGIBLE,
            f"p = {p:.2g}, but its amplitude {size:.3g} is below {delta:.3g}, which would matter",
        )
    short = "; too few independent data where it acts" if dof < 6 or few else ""
    if mde < delta:
        return Verdict.ABSENT, f"an amplitude of {mde:.3g} would have been seen, {delta:.3g} would matter"
    return (
        Verdict.CANNOT_TELL,
        f"only an amplitude above {mde:.3g} would be seen, {delta:.3g} would matter{short}",
    )


def summary(rows: Sequence[Row], refused: dict[str, str], too_few: str) -> str:
    """One sentence about all candidates.

    "Nothing is missing" is said only when every effect that matters would have been seen.
    """
    found = [r.name for r in rows if r.verdict is Verdict.MISSING]
    if found:
        return f"missing: {found[0]}" + (f" (also significant: {', '.join(found[1:])})" if found[1:] else "")
    hide = [f"{r.name} up to {r.mde:.3g} {r.unit}".rstrip() for r in rows if not r.mde < r.delta]
    hide += [f"{n} (refused)" for n in refused]
    text = "nothing is missing" if not hide else "nothing found; these could hide: " + ", ".join(hide)
    return text + (f". {too_few}" if too_few else "")


def smallest_visible(crit: float, variance: float) -> float:
    """Amplitude seen with 80 % chance when √(LM/λ) must exceed ``crit``, for an amplitude's variance."""
    z80 = 0.8416212335729143
    return float((crit + z80) * np.sqrt(variance))
