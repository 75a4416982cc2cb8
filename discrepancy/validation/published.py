"""A paper's tables and figures compared with ours, row by row, each row with a verdict.

A row agrees within a stated tolerance, differs for a stated reason, or cannot be checked, and says why.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from discrepancy.validation.trials import wilson

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AGREES", "DIFFERS", "UNCHECKED", "PaperChapter", "PaperRow", "compared", "counted"]

AGREES, DIFFERS, UNCHECKED = "agrees", "differs", "cannot be checked"


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """One value of a paper and ours.

    Parameters
    ----------
    what : str
    paper, ours : str
        As they are printed.
    verdict : {"agrees", "differs", "cannot be checked"}
    why : str
        The tolerance, the known reason, or why it cannot be checked; never empty for the last two verdicts.
    """

    what: str
    paper: str
    ours: str
    verdict: str
    why: str = ""

    def __post_init__(self) -> None:
        if self.verdict not in (AGREES, DIFFERS, UNCHECKED):
            raise ValueError(f"'{self.what}': there is no verdict '{self.verdict}'")
        if self.verdict != AGREES and not self.why:
            raise ValueError(f"'{self.what}': a row that {self.verdict} needs its reason")


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
    >>> compared("E_c, original", 13.87, 13.867, 0.07, "J").verdict
    'agrees'
    """
    unit = f" {unit}" if unit else ""
    printed, calculated = f"{paper:.{digits}f}{unit}", f"{ours:.{digits}f}{unit}"
    if abs(ours - paper) <= tolerance:
        why = f"within {tolerance:.{significant}g}{unit}" + (f": {basis}" if basis else "")
        return PaperRow(what=what, paper=printed, ours=calculated, verdict=AGREES, why=why)
    return PaperRow(what=what, paper=printed, ours=calculated, verdict=DIFFERS, why=why or "the reason is not known")


def counted(hits: int, trials: int, of: str = "") -> str:
    """Return a count with the 95 % interval (Wilson) of the rate behind it, in per cent.

    Examples
    --------
    >>> counted(98, 100, "seeds")
    '98 of 100 seeds (93 to 99 %)'
    """
    low, high = wilson(hits, trials)
    return f"{hits} of {trials}{f' {of}' if of else ''} ({100 * low:.0f} to {100 * high:.0f} %)"
