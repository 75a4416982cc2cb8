"""A row and a chapter of the validation, as ``vtsdt validate papers`` takes them from any package."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["AGREES", "DIFFERS", "UNCHECKED", "Chapter", "Row", "compared", "counted"]

AGREES, DIFFERS, UNCHECKED = "agrees", "differs", "cannot be checked"
#: Short name of the paper.
PAPER = "Digital twin-assisted gearbox dynamic model updating"


@dataclass(frozen=True)
class Row:
    """One figure of the paper beside ours.

    Parameters
    ----------
    what, paper, ours : str
        As they are printed.
    verdict : {"agrees", "differs", "cannot be checked"}
    why : str
        The tolerance, the known reason, or why it cannot be checked; never empty for the last two.
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


@dataclass(frozen=True, eq=False)
class Chapter:
    """A table or figure of the paper.

    Parameters
    ----------
    place, title : str
        Such as ``"Table 6"``.
    rows : tuple of Row
    figures : dict
        Ours, by file name without its ending.
    text : str
        What has to be known to read the rows.
    paper : str
    """

    place: str
    title: str
    rows: tuple[Row, ...]
    figures: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    paper: str = PAPER


def compared(
    what: str, paper: float, ours: float, tolerance: float, unit: str = "", *, digits: int = 2, basis: str = "",
    why: str = "",
) -> Row:  # fmt: skip
    """Return a row of two numbers: it agrees within the tolerance, else it differs for the reason given.

    Examples
    --------
    >>> compared("transverse contact ratio", 1.639, 1.6392, 5e-4, digits=3).verdict
    'agrees'
    """
    unit = f" {unit}" if unit else ""
    shown = (f"{paper:.{digits}f}{unit}", f"{ours:.{digits}f}{unit}")
    if abs(ours - paper) <= tolerance:
        return Row(what, *shown, AGREES, f"within {tolerance:.3g}{unit}" + (f": {basis}" if basis else ""))
    return Row(what, *shown, DIFFERS, why or "the reason is not known")


def counted(hits: int, trials: int, of: str = "") -> str:
    """Return a count with the 95 % interval (Wilson) of the rate behind it, in per cent.

    Examples
    --------
    >>> counted(98, 100, "seeds")
    '98 of 100 seeds (93 to 99 %)'
    """
    from discrepancy.validation.trials import wilson

    low, high = wilson(hits, trials)
    return f"{hits} of {trials}{f' {of}' if of else ''} ({100 * low:.0f} to {100 * high:.0f} %)"
