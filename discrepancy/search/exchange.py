"""Now that more is known: would another effect do better in the place of one that was found before?

The first effect of several is named while the others are still in the residual, and they can make a neighbour of it
look better: the same law at a place beyond a stiff connection, say.  Once they are in the model the two are told apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.trial_fits import Fit, tried
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.statistics.ties import canonical_correlation
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["Swap", "better_in_its_place"]

CLOSE = 30.0  # difference of BIC up to which another explanation is worth a second look; chosen
SAME_LAW_CORRELATION = 0.9  # correlation from which the same law at another place is; chosen
MOST = 4  # other explanations of one effect that are fitted


@dataclass(frozen=True)
class Swap:
    """An effect that does better in the place of another.

    Parameters
    ----------
    index : int
        Of the stage that added the other.
    old, new : Effect
    stage : Stage
        The last one with the new effect in it, fitted on trial.
    better : float
        Difference of BIC that it makes.
    """

    index: int
    old: Effect
    new: Effect
    stage: Stage
    better: float

    def accepted(self, before: AcceptedEffect, delta_bic: float) -> AcceptedEffect:
        """Return why an effect of the story is there, told anew: the new one in the place of the old, or as it was."""
        masked_by = str(self.new) if before.masked_by == str(self.old) else before.masked_by
        if before.effect.component_name != self.old.component_name:
            return replace(before, delta_bic=delta_bic, masked_by=masked_by)
        others = (r for r in before.rivals if (r.kind, r.where) != (self.new.kind, self.new.where))
        first = RivalExplanation(
            kind=self.old.kind, where=self.old.where, delta_bic=self.better, refitted=True, indistinguishable=False
        )
        return replace(before, effect=self.new, delta_bic=delta_bic, rivals=(first, *others))


def better_in_its_place(stages: Sequence[Stage], fit: Fit, progress: Callable[[str], None]) -> Swap | None:
    """Return the exchange of one effect that makes the last of some stages clearly better, or None.

    Tried are the closest explanations that were told when the effect was added, and the same law at other places where
    it does nearly the same.

    Parameters
    ----------
    stages : sequence of Stage
    fit : callable
        Fits a stage on trial, given its name, its effects, and the stage from where it begins.
    progress : callable
    """
    last = stages[-1]
    if len(last.effects) < 2:
        return None
    experiment = last.identify.fits[0].experiment
    entries = {e.name: e for e in catalogue(last.system, experiment.outputs, experiment.inputs)}
    there = {str(e) for e in last.effects}
    asked: list[tuple[int, Effect, Effect]] = []
    for index, stage in enumerate(stages):
        scan = stages[index - 1].scan
        if stage.accepted is None or scan is None or stage.accepted.effect.definition.free_form:
            continue
        old = next((e for e in last.effects if e.component_name == stage.accepted.effect.component_name), None)
        if old is None:
            continue
        rest = [e for e in last.effects if e is not old]
        names = [n for n in _others(stage.accepted, scan) if n in entries and n not in there][:MOST]
        asked += [(index, old, effect_of(entries[n], scan[n], rest)) for n in names]

    def trial(each: tuple[int, Effect, Effect]) -> Stage | None:
        _, old, new = each
        progress(f"now, {new} in the place of {old}?")
        found = tried(fit, last.name, tuple(new if e is old else e for e in last.effects), last, progress)
        return found if found is not None and all(any(e.strengths.values()) for e in found.effects) else None

    swaps = [
        Swap(index, old, new, found, -bic_difference(found, last))
        for (index, old, new), found in zip(asked, parallel_map(trial, asked), strict=True)
        if found is not None
    ]
    best = max(swaps, key=lambda s: s.better, default=None)
    return best if best is not None and best.better > DECISIVE_BIC else None


def _others(accepted: AcceptedEffect, scan: ScanResult) -> list[str]:
    """Return what else an effect could be, the closest first: its rivals, and the same law elsewhere."""
    close = [r for r in accepted.rivals if r.delta_bic < CLOSE and " " not in r.kind]
    names = [f"{r.kind}@{r.where}" for r in sorted(close, key=lambda r: r.delta_bic)]
    name = str(accepted.effect)
    rows = {r.name: r for r in scan.rows}
    if scan.scorer is not None and name in rows:
        columns = scan.scorer.columns
        own = columns.Z[:, columns.groups[rows[name].group].columns]
        alike = [
            r for r in scan.rows
            if r.kind == accepted.effect.kind and r.name != name
            and canonical_correlation(own, columns.Z[:, columns.groups[r.group].columns]) >= SAME_LAW_CORRELATION
        ]  # fmt: skip
        names += [r.name for r in sorted(alike, key=lambda r: -r.score)]
    return [n for n in dict.fromkeys(names) if n in rows]
