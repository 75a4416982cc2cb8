"""The conclusion of a study: a plain value, which the report, the figures and ``diagnosis.json`` show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.posterior import Posterior
from discrepancy.questions.compare import Comparison, compare
from discrepancy.questions.locate import WhereItFails, locate
from discrepancy.questions.unknown_force import UnknownCurve
from discrepancy.stages.stage import AcceptedEffect, Stage

__all__ = ["Conclusion", "Evidence", "HiddenEffect", "NegligibleEffect", "RefusedEffect", "evidence_of"]


class RefusedEffect(NamedTuple):
    """An effect that these records cannot answer for, and why."""

    kind: str
    where: str
    why: str


class HiddenEffect(NamedTuple):
    """An effect that was searched for and not found.

    Parameters
    ----------
    kind, where : str
    mde : float
        Smallest amplitude that would have been detected.
    delta : float
        Amplitude that would matter.
    unit : str
        Of both.
    """

    kind: str
    where: str
    mde: float
    delta: float
    unit: str


class NegligibleEffect(NamedTuple):
    """An effect that is present but changes too little to be added.

    Parameters
    ----------
    kind, where : str
    amplitude, std : float
        Its strength and standard deviation, in ``unit``.
    p : float
        Family-wise p-value.
    unit : str
    """

    kind: str
    where: str
    amplitude: float
    std: float
    p: float
    unit: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Conclusion:
    """Everything that a study has to say.

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`; empty if nobody asked what is missing (``vtsdt compare``).
    sentence : str
        The answer in two or three plain sentences.
    stages : tuple of Stage
        As given, recalibrated, then one for each effect.
    refused : tuple of RefusedEffect
    hidden : tuple of HiddenEffect
    negligible : tuple of NegligibleEffect
    next_measurement : tuple of str
    unknown : UnknownCurve or None
    warnings : tuple of str
        From records and study.
    residual_mode, residual_reason : str
        How the residual was taken, and why so.
    seed : int
    level : float
        Chance of naming an effect when nothing is missing.
    name : str
        Of the study.
    paths : tuple of str
        Of the study file and the recordings.
    extra : mapping
        Further entries of ``diagnosis.json``.
    probabilities : Posterior or None
        Of what is missing, where the search was by evidence.
    models : tuple of TriedModel
        Every model that such a search tried, in that order.
    """

    verdict: str
    sentence: str
    stages: tuple[Stage, ...]
    refused: tuple[RefusedEffect, ...] = ()
    hidden: tuple[HiddenEffect, ...] = ()
    negligible: tuple[NegligibleEffect, ...] = ()
    next_measurement: tuple[str, ...] = ()
    unknown: UnknownCurve | None = None
    warnings: tuple[str, ...] = ()
    residual_mode: str = "simulation"
    residual_reason: str = ""
    seed: int = 0
    level: float = 0.02
    name: str = ""
    paths: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    probabilities: Posterior | None = None
    models: tuple[TriedModel, ...] = ()

    @property
    def baseline(self) -> Stage:
        """The recalibrated stage, or the only one there is."""
        return self.stages[min(1, len(self.stages) - 1)]

    @property
    def final(self) -> Stage:
        """The last stage."""
        return self.stages[-1]

    @property
    def accepted(self) -> tuple[AcceptedEffect, ...]:
        """What was added, in that order, with the values of the last stage."""
        last = {(e.kind, e.where, e.number): e for e in self.final.effects}
        accepted = [s.accepted for s in self.stages if s.accepted is not None]
        keys = [(a.effect.kind, a.effect.where, a.effect.number) for a in accepted]
        return tuple(replace(a, effect=last.get(k, a.effect)) for a, k in zip(accepted, keys, strict=True))

    @property
    def judged_on(self) -> str:
        """Part on which the falling error is judged: held-out records where there are any."""
        return "validate" if self.baseline.fits("validate") else "identify"

    def _repr_html_(self) -> str:
        from discrepancy.stages.errors_view import errors_view

        return errors_view((self.verdict or "compared only").capitalize(), self.stages, self.sentence)

    def __repr__(self) -> str:
        effects = ", ".join(str(a.effect) for a in self.accepted) or "none"
        return f"Conclusion({self.verdict or 'compared only'!r}, effects: {effects})\n  {self.sentence}"


@dataclass(frozen=True, eq=False)
class Evidence:
    """Comparisons and locations of the error, computed once for JSON, figures and page.

    Attributes
    ----------
    comparisons : tuple of Comparison
        Of every stage.
    before, after : WhereItFails
        Of the recalibrated and of the last stage, on the identification records.
    """

    comparisons: tuple[Comparison, ...]
    before: WhereItFails
    after: WhereItFails


def evidence_of(conclusion: Conclusion) -> Evidence:
    """Compare every stage and locate the error before and after."""
    before = locate(conclusion.baseline)
    after = before if conclusion.final is conclusion.baseline else locate(conclusion.final)
    return Evidence(tuple(compare(s) for s in conclusion.stages), before, after)
