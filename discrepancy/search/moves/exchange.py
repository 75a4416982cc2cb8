"""Exchange one effect for another that is better beside the effects found later."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.search.fits_on_trial import TrialFit, fitted_present
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.policy import POLICY
from discrepancy.search.rivals import rival_explanation
from discrepancy.search.scoring import catalogue_of
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.statistics.ties import canonical_correlation
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["Exchange", "propose_exchange"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Exchange:
    """An effect that replaces another and gives the better model.

    Parameters
    ----------
    index : int
        Of the stage that added the old effect.
    old, new : Effect
    stage : Stage
        The last one with the new effect in it, fitted on trial.
    improvement : float
        By how much BIC falls.
    """

    index: int
    old: Effect
    new: Effect
    stage: Stage
    improvement: float

    def applied_to(self, before: AcceptedEffect, delta_bic: float) -> AcceptedEffect:
        """Return why an effect was accepted, after the exchange: the new effect where it was the old one."""
        masked_by = str(self.new) if before.masked_by == str(self.old) else before.masked_by
        if before.effect.component_name != self.old.component_name:
            return replace(before, delta_bic=delta_bic, masked_by=masked_by)
        others = (r for r in before.rivals if (r.kind, r.where) != (self.new.kind, self.new.where))
        first = rival_explanation(self.old, self.improvement, refitted=True, tied=False)
        return replace(before, effect=self.new, delta_bic=delta_bic, rivals=(first, *others))


def propose_exchange(stages: Sequence[Stage], fit: TrialFit, progress: Callable[[str], None]) -> Exchange | None:
    """Return the exchange of one effect that makes the last of some stages clearly better, or None.

    The first effect of several is accepted while the others are still in the residual, and they can favour a neighbour
    of it: the same law at the other end of a stiff connection, say.  Once they are in the model the two can be told
    apart.  The closest rivals of each accepted effect are tried, and the same law at other places where it
    changes almost the same.

    Parameters
    ----------
    stages : sequence of Stage
    fit : TrialFit
    progress : callable
    """
    last = stages[-1]
    if len(last.effects) < 2:
        return None
    entries = {e.name: e for e in catalogue_of(last)}
    present = {str(e) for e in last.effects}
    proposals: list[tuple[int, Effect, Effect]] = []
    for index, stage in enumerate(stages):
        scan = stages[index - 1].scan
        if stage.accepted is None or scan is None or stage.accepted.effect.definition.free_form:
            continue
        old = next((e for e in last.effects if e.component_name == stage.accepted.effect.component_name), None)
        if old is None:
            continue
        rest = [e for e in last.effects if e is not old]
        names = [n for n in _exchange_names(stage.accepted, scan) if n in entries and n not in present]
        proposals += [(index, old, effect_of(entries[n], scan[n], rest)) for n in names[: POLICY.exchanges]]

    def fitted(proposal: tuple[int, Effect, Effect]) -> Stage | None:
        _, old, new = proposal
        progress(f"refit with {new} in place of {old}")
        effects = tuple(new if e is old else e for e in last.effects)
        return fitted_present(fit, last.name, effects, len(effects), last, progress)

    exchanges = [
        Exchange(index=index, old=old, new=new, stage=stage, improvement=-bic_difference(stage, last))
        for (index, old, new), stage in zip(proposals, parallel_map(fitted, proposals), strict=True)
        if stage is not None
    ]
    best = max(exchanges, key=lambda s: s.improvement, default=None)
    return best if best is not None and best.improvement > DECISIVE_BIC else None


def _exchange_names(accepted: AcceptedEffect, scan: ScanResult) -> list[str]:
    """Return the candidates that may replace an effect: its closest rivals, then the same law elsewhere."""
    close = [r for r in accepted.rivals if r.delta_bic < POLICY.exchange_delta_bic and " " not in r.kind]
    names = [f"{r.kind}@{r.where}" for r in sorted(close, key=lambda r: r.delta_bic)]
    name = str(accepted.effect)
    rows = {r.name: r for r in scan.rows}
    if scan.scorer is not None and name in rows:
        columns = scan.scorer.columns
        own = columns.Z[columns.groups[rows[name].group].columns]
        similar = [
            r
            for r in scan.rows
            if r.kind == accepted.effect.kind
            and r.name != name
            and canonical_correlation(own, columns.Z[columns.groups[r.group].columns]) >= POLICY.exchange_correlation
        ]
        names += [r.name for r in sorted(similar, key=lambda r: -r.score)]
    return [n for n in dict.fromkeys(names) if n in rows]
