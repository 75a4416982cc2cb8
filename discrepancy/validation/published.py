"""A paper's tables and figures compared with ours, row by row: what agrees, and what an agreement is worth.

Verdict and kind of a row are worked out from its numbers; neither can be given.  A row without numbers to compare
cannot be checked.  A figure is *fitted* if parameters were chosen to meet it, *predicted* if it would have come out
otherwise with other admissible inputs, and else *identity or arithmetic*: an agreement that had to be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from discrepancy.validation.trials import wilson

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "AGREES",
    "DIFFERS",
    "FITTED",
    "IDENTITY",
    "KINDS",
    "PREDICTED",
    "UNCHECKED",
    "Check",
    "PaperChapter",
    "PaperRow",
    "claimed",
    "compared",
    "counted",
    "unchecked",
]

AGREES, DIFFERS, UNCHECKED = "agrees", "differs", "cannot be checked"
PREDICTED, FITTED, IDENTITY = "predicted", "fitted", "identity or arithmetic"
KINDS = (PREDICTED, FITTED, IDENTITY)


@dataclass(frozen=True, kw_only=True)
class Check:
    """A number of ours, the bounds that the paper sets it, and what it could have been.

    Parameters
    ----------
    value : float
    low, high : float
        Bounds in which it agrees with the paper.
    otherwise : tuple of float
        The same figure from other admissible inputs: other values of what the paper does not publish, other designs.
        Without any, nothing shows that it could have come out otherwise.
    fitted : bool
        True if parameters were chosen to meet the paper's figure.
    """

    value: float
    low: float = -math.inf
    high: float = math.inf
    otherwise: tuple[float, ...] = ()
    fitted: bool = False

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"the bounds {self.low:g} and {self.high:g} are not in order")

    def _inside(self, value: float) -> bool:
        return self.low <= value <= self.high

    @property
    def agrees(self) -> bool:
        """Whether the value lies within its bounds."""
        return self._inside(self.value)

    @property
    def kind(self) -> str:
        """What the comparison is: one of `KINDS`.

        An agreement is predicted if another admissible input would have made it a difference, or moved the figure by
        more than the width of its bounds; a difference is, if another input moves the figure at all.
        """
        if self.fitted:
            return FITTED
        width = self.high - self.low if self.agrees else 1e-6 * abs(self.value)
        moved = any(self._inside(v) != self.agrees or abs(v - self.value) > width for v in self.otherwise)
        return PREDICTED if moved else IDENTITY


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """One value of a paper and ours.

    Parameters
    ----------
    what : str
    paper, ours : str
        As they are printed.
    check : Check or None
        Their comparison; None where the paper prints nothing that ours could be compared with.
    why : str
        The tolerance, the known reason, or why it cannot be checked; never empty for the last two verdicts.
    """

    what: str
    paper: str
    ours: str
    check: Check | None = None
    why: str = ""

    def __post_init__(self) -> None:
        if self.verdict != AGREES and not self.why:
            raise ValueError(f"'{self.what}': a row that {self.verdict} needs its reason")

    @property
    def verdict(self) -> str:
        """``"agrees"``, ``"differs"`` or ``"cannot be checked"``."""
        return UNCHECKED if self.check is None else AGREES if self.check.agrees else DIFFERS

    @property
    def kind(self) -> str:
        """One of `KINDS`; empty for a row that cannot be checked."""
        return "" if self.check is None else self.check.kind


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperChapter:
    """A table or figure of a paper.

    Parameters
    ----------
    paper : str
        Short name of the paper.
    place : str
        Such as ``"Table 4"``.
    title : str
    rows : tuple of PaperRow
    figures : dict
        Ours, by file name without its ending.
    text : str
        What the reader of the rows has to know.
    """

    paper: str
    place: str
    title: str
    rows: tuple[PaperRow, ...]
    figures: dict[str, Figure] = field(default_factory=dict)
    text: str = ""


def compared(
    what: str,
    paper: float,
    ours: float,
    tolerance: float,
    unit: str = "",
    *,
    otherwise: Iterable[float] = (),
    fitted: bool = False,
    digits: int = 2,
    significant: int = 2,
    basis: str = "",
    why: str = "",
) -> PaperRow:
    """Return a row of two numbers: it agrees within the tolerance, else it differs for the reason given.

    Parameters
    ----------
    what : str
    paper, ours, tolerance : float
    unit : str
    otherwise, fitted
        See `Check`.
    digits : int
        Printed after the decimal point.
    significant : int
        Digits of the tolerance, as printed.
    basis : str
        Where the tolerance comes from.
    why : str
        Known reason of a difference; a row beyond its tolerance without one is an error of the validation.

    Examples
    --------
    >>> row = compared("E_c, lubrication", 12.43, 12.40, 0.07, "J", otherwise=(12.1, 12.7))
    >>> row.verdict, row.kind
    ('agrees', 'predicted')
    >>> compared("2 × mesh", 1066.7, 1066.67, 0.05, "Hz").kind
    'identity or arithmetic'
    """
    unit = f" {unit}" if unit else ""
    slack = 1e-9 * max(abs(paper), 1.0)  # a difference of exactly the tolerance is within it
    check = Check(
        value=ours,
        low=paper - tolerance - slack,
        high=paper + tolerance + slack,
        otherwise=tuple(map(float, otherwise)),
        fitted=fitted,
    )
    if check.agrees:
        why = f"within {tolerance:.{significant}g}{unit}" + (f": {basis}" if basis else "")
    return PaperRow(
        what=what,
        paper=f"{paper:.{digits}f}{unit}",
        ours=f"{ours:.{digits}f}{unit}",
        check=check,
        why=why or "the reason is not known",
    )


def claimed(
    what: str,
    paper: str,
    ours: str,
    value: float,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    otherwise: Iterable[float] = (),
    fitted: bool = False,
    bar: str = "",
    why: str = "",
) -> PaperRow:
    """Return a row of what a paper says in words or as a bound, held against a number of ours.

    Parameters
    ----------
    what, paper, ours : str
    value : float
        Our number.
    low, high : float
        Bounds within which it meets the paper's words.
    otherwise, fitted
        See `Check`.
    bar : str
        The bounds in words, and whose they are; shown where it agrees.
    why : str
        Known reason of a difference.

    Examples
    --------
    >>> claimed("R², order 3", "R² ≥ 0.97", "0.95", 0.95, low=0.97, why="another response").verdict
    'differs'
    """
    check = Check(value=value, low=low, high=high, otherwise=tuple(map(float, otherwise)), fitted=fitted)
    reason = bar if check.agrees else "; ".join(part for part in (why, bar) if part)
    return PaperRow(what=what, paper=paper, ours=ours, check=check, why=reason)


def unchecked(what: str, paper: str, ours: str, why: str) -> PaperRow:
    """Return a row that cannot be checked, and why."""
    return PaperRow(what=what, paper=paper, ours=ours, why=why)


def counted(hits: int, trials: int, of: str = "") -> str:
    """Return a count with the 95 % interval (Wilson) of the rate behind it, in per cent.

    Examples
    --------
    >>> counted(98, 100, "seeds")
    '98 of 100 seeds (93 to 99 %)'
    """
    low, high = wilson(hits, trials)
    return f"{hits} of {trials}{f' {of}' if of else ''} ({100 * low:.0f} to {100 * high:.0f} %)"
