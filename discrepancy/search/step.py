"""One step of the search: score every candidate, refit the best in full simulation, keep one or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of, simpler_in
from discrepancy.effects.kinds import kind_named
from discrepancy.search.model_comparison import bic_difference, matters, taken
from discrepancy.search.trial_fits import Refit, best_of, fits_with
from discrepancy.sensitivities.candidates import candidate_sensitivities, cannot_be_built
from discrepancy.stages.prior_conflict import needs_prior_conflict
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.thresholds import DECISIVE_BIC, TWIN_CORRELATION
from multibody.base.errors import ModelError
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow

__all__ = ["FINALISTS", "LOOKS", "Step", "scored", "search_step"]

FINALISTS = 3
LOOKS = 5  # plain scan, whitened scan, pairs, free curves, omnibus test: each gets a share of the level
TIE_CORRELATION = 0.98  # correlation of what two effects change from which the scan alone calls them a tie; chosen
SAME = 0.9999  # the same from which a refit of the second would tell nothing; chosen
MOST = 0.8  # share of a richer law's gain that makes the simpler law in it the first answer


@dataclass(frozen=True, eq=False)
class Step:
    """What one step of the search found.

    Parameters
    ----------
    scans : tuple of ScanResult
        Scores of all candidates, plainly weighed; then whitened, where that was asked as well.
    accepted : AcceptedEffect or None
    stage : Stage or None
        With the accepted effect in it.
    refused : tuple of (Entry, str)
        Candidates that these records cannot speak about.
    slight : tuple of ScanRow
        Candidates with which the refitted model is the better one, by too little to matter.
    first : tuple of (AcceptedEffect, Stage), optional
        Of two effects that hide each other the one that is added first, and the stage with it alone; the accepted one
        comes after it (`discrepancy.search.look_ahead`).
    """

    scans: tuple[ScanResult, ...]
    accepted: AcceptedEffect | None
    stage: Stage | None
    refused: tuple[tuple[Entry, str], ...]
    slight: tuple[ScanRow, ...] = ()
    first: tuple[AcceptedEffect, Stage] | None = None

    @property
    def scan(self) -> ScanResult:
        """The first of the scans."""
        return self.scans[0]

    @property
    def added(self) -> tuple[AcceptedEffect, ...]:
        """What the step adds, in that order."""
        last = () if self.accepted is None else (self.accepted,)
        return last if self.first is None else (self.first[0], *last)


def scored(
    stage: Stage,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> tuple[list[ScanResult], list[Candidate], list[tuple[Entry, str]]]:
    """Return the scans of a stage's residual, what was scored, and what these records cannot speak about.

    Parameters as of `search_step`.
    """
    facts = stage.weighted_problem()
    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs, include=include, exclude=exclude)
    candidates, refused = candidate_sensitivities(facts, entries, progress, stage.effects, curves=not stage.effects)
    residual, sensitivities = facts.residual(), facts.sensitivities()
    progress(f"scores of {len(candidates)} candidates")
    return _scans(residual, sensitivities, candidates, level, seed, stage.noise), candidates, refused


def search_step(
    stage: Stage,
    refit: Refit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> Step:
    """Score all candidates on a stage's residual and try the best of them.

    Parameters
    ----------
    stage : Stage
    refit : callable
        See `discrepancy.search.trial_fits.Refit`.
    include, exclude : sequence of str
    level : float
        Family-wise level.
    seed : int
    progress : callable
    """
    scans, candidates, refused = scored(
        stage, include=include, exclude=exclude, level=level, seed=seed, progress=progress
    )
    rows = _finalists(scans, [c.name for c in candidates], stage.effects)
    if not rows:
        return Step(tuple(scans), None, None, tuple(refused))
    by_name = {c.name: c for c in candidates}

    def trial(row: ScanRow) -> Stage | ModelError | None:
        candidate = by_name[row.name]
        entry: Entry = candidate.info["entry"]
        simpler = simpler_in(stage.effects, row.kind, row.where)
        effect = effect_of(entry, row, stage.effects, simpler)
        progress(f"refit with {effect}" + (f" in the place of {simpler[0]}" if simpler else ""))
        found = best_of(fits_with(refit, entry, row, candidate.shapes, stage.effects, simpler), stage, progress)
        if isinstance(found, Stage) and simpler and not entry.kind.by_direction and bic_difference(found, stage) >= 0.0:
            beside = partial(refit, effect_of(entry, row, stage.effects), ())  # not in their place: is it beside them?
            found = best_of([beside], stage, progress)
        return found

    tried: list[tuple[Stage, ScanRow]] = []
    slight: list[ScanRow] = []

    def look_at(some: Sequence[ScanRow]) -> None:
        for row, found in zip(some, parallel_map(trial, some), strict=True):
            if isinstance(found, ModelError):
                refused.append((by_name[row.name].info["entry"], cannot_be_built(found)))
            elif found is not None and bic_difference(found, stage) < 0.0:
                if matters(found, stage) or needs_prior_conflict(found.identify, stage.identify):
                    tried.append((found, row))
                else:
                    slight.append(row)
        tried.sort(key=lambda t: bic_difference(t[0], stage))

    look_at(rows)
    if not tried:
        return Step(tuple(scans), None, None, tuple(refused), tuple(slight))
    p_value = min(1.0, LOOKS * tried[0][1].p_value)
    if taken(tried[0][0], stage) < MOST:
        look_at(_bent(scans[-1], tried[0][1].where, [r.name for r in rows]))
    tried = _simplest_first(tried, stage)
    best, row = tried[0]
    p_value = min(p_value, LOOKS * row.p_value)
    rivals = _rivals(best, stage, tried[1:], scans, row.name)
    accepted = AcceptedEffect(
        effect=best.effects[-1], p_value=p_value, delta_bic=bic_difference(best, stage), rivals=rivals
    )
    return Step(tuple(scans), accepted, best, tuple(refused), tuple(slight))


def _scans(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    level: float,
    seed: int,
    noise: Mapping[str, float],
) -> list[ScanResult]:
    """Scan plainly weighed, which effects that are only roughly known survive; then whitened, which sees small ones.

    Each scan gets its share of the level, as the free curves and the omnibus test do, so that all together keep it.
    Where what is left remembers so long that there are few independent pieces of it, nothing shows what luck could do
    to the plain scan, as with a disturbance that adds up along the record: only the whitened one is asked.
    """
    from discrepancy.statistics.scan import scan
    from discrepancy.statistics.verdicts import Verdict
    from discrepancy.statistics.whitened import scaled_by_rms

    plain = scaled_by_rms(residual, sensitivities, candidates)

    def scanned(whiten: bool) -> ScanResult:
        return scan(
            residual, sensitivities, candidates, level=level / LOOKS, seed=seed,
            noise_floor=[noise[c] for c in residual.channels], whiten=whiten, plain=plain,
        )  # fmt: skip

    first = scanned(whiten=False)
    if first.null.pieces.too_few:
        return [scanned(whiten=True)]
    if any(r.verdict is Verdict.MISSING for r in first.rows):
        return [first]
    return [first, scanned(whiten=True)]


def _finalists(scans: Sequence[ScanResult], known: Sequence[str], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the significant candidates worth a refit, best first.

    Each brings the simpler kinds that it contains with it.  Significant richer kinds of the effects that are in the
    model already are tried as well, however little they explain: a law that was only the first answer may be what is
    wrong.
    """
    from discrepancy.statistics.verdicts import Verdict

    scan = scans[-1]
    significant = sorted((r for r in scan.rows if r.verdict is Verdict.MISSING), key=lambda r: r.delta_bic)
    if not significant:
        return []
    worth = _unlike(scan, [r for r in significant if r.error_reduction > 0.5 * significant[0].error_reduction], effects)
    simpler = [f"{kind}@{r.where}" for r in worth for kind in kind_named(r.kind).contains]
    names = [r.name for r in worth]
    richer = [r.name for r in significant if simpler_in(effects, r.kind, r.where)]
    more = dict.fromkeys([*simpler, *richer])
    names += [n for n in more if n not in names and n in known and n not in scan.refused]
    return [scan[n] for n in names]


def _unlike(scan: ScanResult, rows: Sequence[ScanRow], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the first `FINALISTS` of some candidates that do not all but change what another of them does.

    Of those that do, the one stays at whose place something was found already, else the first.
    """
    known = {e.where for e in effects}
    left = list(rows)
    kept: list[ScanRow] = []
    while left and len(kept) < FINALISTS:
        ties = scan.ties_of(left[0].name)
        alike = (*ties.same_kind, *ties.other_kind) if ties is not None else ()
        same = {left[0].name, *(t.name for t in alike if t.correlation >= SAME)}
        kept.append(next((r for r in left if r.name in same and r.where in known), left[0]))
        left = [r for r in left if r.name not in same]
    return kept


def _bent(scan: ScanResult, where: str, known: Sequence[str]) -> list[ScanRow]:
    """Return the kinds at a place that are not linear in their strength: a scan along straight lines misjudges them."""
    return [r for r in scan.rows if r.where == where and r.name not in known and not kind_named(r.kind).linear]


def _richer(kind: str, best: Stage) -> bool:
    """Tell whether a kind has the accepted effect in it, or more strengths: it may be the same with more freedom."""
    simple = best.effects[-1]
    return simple.kind in kind_named(kind).contains or len(kind_named(kind).strengths) > len(simple.strengths)


def _simplest_first(tried: list[tuple[Stage, ScanRow]], stage: Stage) -> list[tuple[Stage, ScanRow]]:
    """Put first the simplest explanation that the records do not tell from the best, or that does most of its work.

    A law with more freedom always fits a little better, because no law is exact.  Where a simpler law that it contains
    takes nearly as much of the error away, that one is the answer to this step; if the rest matters, the next step
    finds it, and what has become idle is then taken out.
    """
    best = tried[0][0]
    least = bic_difference(best, stage)
    close = [t for t in tried if bic_difference(t[0], stage) - least < DECISIVE_BIC]
    known = {e.where for e in stage.effects}  # of two places that look the same, the one where something was found
    first = min(close, key=lambda t: (_size(t), t[1].where not in known))
    inside = [
        t
        for t in tried
        if t[1].kind in first[0].effects[-1].definition.contains
        and t[1].where == first[1].where
        and taken(t[0], stage) >= MOST * taken(first[0], stage)
    ]
    first = inside[0] if inside else first
    return [first, *(t for t in tried if t is not first)]


def _size(tried: tuple[Stage, ScanRow]) -> tuple[int, int, int]:
    """Return what makes an explanation long: strengths and effects of its model, and what its last law contains."""
    effects = tried[0].effects
    return sum(len(e.strengths) for e in effects), len(effects), len(effects[-1].definition.contains)


def _rivals(
    best: Stage, stage: Stage, others: Sequence[tuple[Stage, ScanRow]], scans: Sequence[ScanResult], name: str
) -> tuple[RivalExplanation, ...]:
    """Return the other explanations: refitted finalists, and what the scan cannot tell apart or ranks next."""
    found: dict[str, RivalExplanation] = {}
    alike = [t for scan in scans if (ties := scan.ties_of(name)) for t in (*ties.same_kind, *ties.other_kind)]
    twins = {t.name for t in alike if t.correlation >= TWIN_CORRELATION}
    for other, row in others:
        difference = bic_difference(other, stage) - bic_difference(best, stage)
        # fits on trial end a few of BIC apart, even of what is all but the same
        close = difference < (2.0 * DECISIVE_BIC if row.name in twins else DECISIVE_BIC)
        found[row.name] = RivalExplanation(
            kind=row.kind,
            where=row.where,
            delta_bic=float(difference),
            refitted=True,
            indistinguishable=close and not _richer(row.kind, best),
        )
    for tie in alike:
        # a part of the accepted effect lies in its span as well, but explains less
        same = tie.correlation >= TIE_CORRELATION and abs(2.0 * tie.gain_deficit) < DECISIVE_BIC
        if tie.name not in found and same and not _richer(tie.kind, best):
            found[tie.name] = RivalExplanation(
                kind=tie.kind, where=tie.where, delta_bic=2.0 * tie.gain_deficit, refitted=False, indistinguishable=True
            )
    plain = scans[0]
    if name not in plain.refused:
        top = plain[name]
        for row in sorted(plain.rows, key=lambda r: -r.error_reduction)[:8]:
            if row.name != name and row.name not in found:
                found[row.name] = RivalExplanation(
                    kind=row.kind,
                    where=row.where,
                    delta_bic=float(row.delta_bic - top.delta_bic),
                    refitted=False,
                    indistinguishable=False,
                )
    return tuple(sorted(found.values(), key=lambda r: r.delta_bic))
