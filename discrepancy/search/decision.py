"""What one step of a search tried, with its numbers, and what it accepted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import Entry
from discrepancy.stages.stage import AcceptedEffect, Stage

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow

__all__ = ["Decision", "TriedModel"]


@dataclass(frozen=True)
class TriedModel:
    """A model that was fitted on trial.

    Parameters
    ----------
    name : str
        ``kind@where`` of its new effect, or of its two new effects joined by ``" + "``.
    delta_bic : float
        BIC of this model minus that of the stage before; NaN where it could not be simulated or built.
    outcome : str
        ``"better"``, ``"not better"``, ``"not relevant"`` (below the noise floor of every output) or ``"failed"``.
    """

    name: str
    delta_bic: float
    outcome: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """What one step of the search tried, with its numbers, and what it accepted.

    Parameters
    ----------
    scans : tuple of ScanResult
        Scores of all candidates without whitening; then with whitening, where that was needed too.
    reason : str
        Why the effect was accepted, or why none was.
    trials : tuple of TriedModel
        Models that were fitted on trial.
    accepted : AcceptedEffect or None
    stage : Stage or None
        With the accepted effect in it.
    first : (AcceptedEffect, Stage), optional
        Of a masking pair the effect that is added first, and the stage with it alone; ``accepted`` is the second.
    refused : tuple of (Entry, str)
        Candidates that these records cannot answer for, and why.
    irrelevant : tuple of ScanRow
        Candidates with which the refitted model is better, but by less than the noise floor of every output.
    """

    scans: tuple[ScanResult, ...]
    reason: str
    trials: tuple[TriedModel, ...] = ()
    accepted: AcceptedEffect | None = None
    stage: Stage | None = None
    first: tuple[AcceptedEffect, Stage] | None = None
    refused: tuple[tuple[Entry, str], ...] = ()
    irrelevant: tuple[ScanRow, ...] = ()

    @property
    def scan(self) -> ScanResult:
        """The first of the scans."""
        return self.scans[0]

    @property
    def added(self) -> tuple[AcceptedEffect, ...]:
        """Effects that the step adds, in that order."""
        last = () if self.accepted is None else (self.accepted,)
        return last if self.first is None else (self.first[0], *last)

    def __repr__(self) -> str:
        what = " and ".join(str(a.effect) for a in self.added) or "nothing"
        tried = [f"  tried {t.name}: ΔBIC = {t.delta_bic:.1f}, {t.outcome}" for t in self.trials]
        return "\n".join([f"Decision: add {what}; {self.reason}", *tried])
