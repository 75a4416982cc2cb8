"""The other explanations of an accepted effect: refitted, tied in the scan, or next in its ranking."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.policy import POLICY
from discrepancy.stages.stage import RivalExplanation, Stage
from discrepancy.statistics.masking_pairs import Pair
from discrepancy.statistics.thresholds import DECISIVE_BIC, TWIN_CORRELATION

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow
    from discrepancy.statistics.ties import Tie

__all__ = ["by_bic", "rival_explanation", "rival_pair", "rivals_of_effect", "rivals_of_pair"]


def rivals_of_effect(
    best: Stage, stage: Stage, others: Sequence[tuple[Stage, ScanRow]], scans: Sequence[ScanResult], name: str
) -> tuple[RivalExplanation, ...]:
    """Return the other explanations: refitted finalists, ties of the scan, and the next in its ranking.

    Parameters
    ----------
    best : Stage
        With the accepted effect as its last.
    stage : Stage
        Before it.
    others : sequence of (Stage, ScanRow)
        The refits that were better than that stage as well.
    scans : sequence of ScanResult
    name : str
        ``kind@where`` of the accepted effect.
    """
    listed: dict[str, RivalExplanation] = {}
    ties = [t for scan in scans if (of := scan.ties_of(name)) for t in (*of.same_kind, *of.other_kind)]
    twins = {t.name for t in ties if t.correlation >= TWIN_CORRELATION}
    for other, row in others:
        difference = bic_difference(other, stage) - bic_difference(best, stage)
        # fits on trial of almost the same model end a few points of BIC apart
        close = difference < (POLICY.twin_tie * DECISIVE_BIC if row.name in twins else DECISIVE_BIC)
        tied = close and not _is_richer(row.kind, best)
        listed[row.name] = rival_explanation(row, float(difference), refitted=True, tied=tied)
    for tie in ties:
        # a part of the accepted effect lies in its span as well, but explains less
        same = tie.correlation >= POLICY.unfitted_tie_correlation and abs(2.0 * tie.gain_deficit) < DECISIVE_BIC
        if tie.name not in listed and same and not _is_richer(tie.kind, best):
            listed[tie.name] = rival_explanation(tie, 2.0 * tie.gain_deficit, refitted=False, tied=True)
    plain = scans[0]
    if name not in plain.refused:
        top = plain[name]
        for row in sorted(plain.rows, key=lambda r: -r.error_reduction)[: POLICY.listed]:
            if row.name != name and row.name not in listed:
                difference = float(row.delta_bic - top.delta_bic)
                listed[row.name] = rival_explanation(row, difference, refitted=False, tied=False)
    return by_bic(listed.values())


def _is_richer(kind: str, best: Stage) -> bool:
    """Tell whether a kind contains the accepted effect or has more strengths: the same law with more freedom."""
    simple = best.effects[-1]
    return simple.kind in kind_named(kind).contains or len(kind_named(kind).strengths) > len(simple.strengths)


def rivals_of_pair(
    better: Sequence[tuple[Stage, Sequence[Pair]]], stage: Stage, names: tuple[str, str]
) -> Mapping[str, tuple[RivalExplanation, ...]]:
    """Return for each effect of the best pair what replaces it in the others; two new ones go with the last.

    Of pairs that change almost the same only the first was refitted; the others are known by the scan alone.

    Parameters
    ----------
    better : sequence of (Stage, sequence of Pair)
        Refitted pairs with those that change almost the same; the best first.
    stage : Stage
        Before them.
    names : (str, str)
        ``kind@where`` of the effects of the best pair, in the order in which they are added.
    """
    least, own = bic_difference(better[0][0], stage), better[0][1]
    others = [(p, own[0].gain - p.gain, False) for p in own[1:]]
    others += [(f[0], bic_difference(s, stage) - least, True) for s, f in better[1:]]
    listed: dict[str, list[RivalExplanation]] = {n: [] for n in names}
    for pair, difference, refitted in others:
        new = [r for r in pair.rows if r.name not in names]
        if len(new) == 2:
            listed[names[-1]].append(rival_pair(new, float(difference), refitted))
        else:
            replaced = next(n for n in names if n not in pair.names)
            tied = difference < DECISIVE_BIC
            listed[replaced].append(rival_explanation(new[0], float(difference), refitted=refitted, tied=tied))
    return {n: by_bic(r) for n, r in listed.items()}


def rival_pair(rows: Sequence[ScanRow], difference: float, refitted: bool = True) -> RivalExplanation:
    """Return two effects as one other explanation."""
    rival = rival_explanation(rows[0], difference, refitted=refitted, tied=difference < DECISIVE_BIC)
    return replace(rival, kind=f"{rows[0].kind} with {rows[1].name}")


def rival_explanation(of: Effect | ScanRow | Tie, delta_bic: float, *, refitted: bool, tied: bool) -> RivalExplanation:
    """Return an effect, a candidate or a tie of the scan as another explanation; ``tied`` if indistinguishable."""
    return RivalExplanation(
        kind=of.kind, where=of.where, delta_bic=delta_bic, refitted=refitted, indistinguishable=tied
    )


def by_bic(rivals: Iterable[RivalExplanation]) -> tuple[RivalExplanation, ...]:
    """Return explanations in the order of their BIC."""
    return tuple(sorted(rivals, key=lambda r: r.delta_bic))
