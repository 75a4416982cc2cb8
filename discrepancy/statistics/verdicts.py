"""From numbers to sentences: missing, negligible, absent, or cannot tell."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Verdict", "decide"]


class Verdict(StrEnum):
    """What the records say about one candidate."""

    MISSING = "missing"
    NEGLIGIBLE = "present but negligible"
    ABSENT = "absent"
    CANNOT_TELL = "cannot tell"
    REFUSED = "refused"


def decide(
    *, p: float, level: float, strength: float, visible: float, matters: float, dof: float, few: bool
) -> tuple[Verdict, str]:
    """Return the verdict on one candidate and its reason.

    Parameters
    ----------
    p : float
        Family-wise p-value.
    level : float
        Claims are made below it.
    strength : float
        Size of the expected strength.
    visible, matters : float
        Smallest strength that would be seen; strength that would matter.
    dof : float
        Degrees of freedom with which the noise is known where the candidate acts.
    few : bool
        True if there are too few pieces to shuffle.
    """
    if p < level:
        if strength > matters:
            return Verdict.MISSING, f"p = {p:.2g}, expected strength {strength:.3g} exceeds {matters:.3g}"
        return (
            Verdict.NEGLIGIBLE,
            f"p = {p:.2g}, but its strength {strength:.3g} is below {matters:.3g}, which would matter",
        )
    if visible < matters:
        return Verdict.ABSENT, f"a strength of {visible:.3g} would have been seen, {matters:.3g} would matter"
    short = "; too few independent data where it acts" if dof < 6 or few else ""
    return (
        Verdict.CANNOT_TELL,
        f"only a strength above {visible:.3g} would be seen, {matters:.3g} would matter{short}",
    )
