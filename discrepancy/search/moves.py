"""The moves of a search: add one effect, add two at once, exchange one, remove one, replace laws by a free curve.

Every move fits the models that it proposes on trial and compares them by `discrepancy.search.model_comparison`; none of
them changes the search.  `discrepancy.search.loop` makes the moves and keeps what they return.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypedDict

import numpy as np

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import contained, effect_of, simpler_in
from discrepancy.effects.kinds import kind_named
from discrepancy.search.model_comparison import (
    bic_difference,
    error_reduction,
    exceeds_noise,
    excess_error,
    expected_curve_reductions,
    is_relevant,
    left_out_difference,
)
from discrepancy.sensitivities.candidates import candidate_sensitivities, cannot_be_built
from discrepancy.sensitivities.free_curve_scan import FreeCurveScan
from discrepancy.stages.prior_conflict import needs_prior_conflict
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.masking_pairs import MaskingPairs, Pair, find_masking_pairs
from discrepancy.statistics.thresholds import DECISIVE_BIC, LEVEL_SHARES, TWIN_CORRELATION, VERY_STRONG_BIC
from discrepancy.statistics.ties import canonical_correlation
from multibody.base.errors import ModelError
from multibody.base.parallel import parallel_map
from multibody.base.progress import silent
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow
    from discrepancy.statistics.ties import Tie

__all__ = [
    "Decision",
    "Exchange",
    "ScanSettings",
    "find_redundant_effect",
    "predicts_better",
    "propose_curve",
    "propose_curve_for_all",
    "propose_curve_for_laws",
    "propose_effect",
    "propose_exchange",
    "propose_pair",
    "propose_without_significance",
    "require_presence",
    "score_candidates",
]

# -------------------------------------------------------------------- thresholds: chosen where nothing else is said

FINALISTS = 3  # candidates that are refitted, of those that differ in what they change
FINALIST_REDUCTION = 0.5  # share of the best candidate's expected error reduction from which another is a finalist
SIMPLER_REDUCTION = 0.8  # share of a richer law's error reduction with which the simpler law in it is the first answer
UNFITTED_TIE_CORRELATION = 0.98  # of what two effects change, from which the scan alone can call them a tie
SAME_CORRELATION = 0.9999  # of the same, from which a refit of the second would add no information
PRESENCE = 2.0  # standard deviations of the full fit from which a strength is known to be different from zero
PAIRS = 5  # pairs that are refitted, of those that differ in what they change
LIKELY_REDUCTION = 0.25  # error reduction that an effect without significance needs, on average over the outputs
EXCHANGE_DELTA_BIC = 30.0  # up to which a rival is tried again in an exchange step
EXCHANGE_CORRELATION = 0.9  # from which the same law at another place is tried in an exchange step
EXCHANGES = 4  # rivals of one effect that are tried
LINEAR_ERROR = 3.0  # most that a refit gains over its linear prediction: up to 2.8 seen (docs/method/which-law.md)
CURVE_REDUCTION = 0.03  # share of the excess error that a curve must remove beyond the law that it replaces
REPEATS = 2.0  # periods within the motion from which a wave is seen to repeat
WAVE_REDUCTION = 0.9  # share of what several waves remove that a curve in their place must remove


# -------------------------------------------------------------------- values


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


class ScanSettings(TypedDict):
    """How candidates are scored: patterns of the catalogue, family-wise level, seed and progress."""

    include: Sequence[str]
    exclude: Sequence[str]
    level: float
    seed: int
    progress: Callable[[str], None]


# -------------------------------------------------------------------- fits on trial


class TrialFit(Protocol):
    """Fit a stage on trial, given its name, its effects, and the stage from which the fit begins."""

    def __call__(self, name: str, effects: tuple[Effect, ...], start: Stage, /) -> Stage: ...


class EffectFit(Protocol):
    """Add an effect to a stage's model, replacing others, and fit everything again on trial.

    With ``from_prior`` the fit begins from the parameters as stated, else from those of the stage's fit.
    """

    def __call__(self, effect: Effect, instead_of: Sequence[Effect] = (), from_prior: bool = False) -> Stage: ...


def _fit(
    fit: TrialFit, name: str, effects: tuple[Effect, ...], start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None, with a message, where the machine cannot be simulated or built."""
    try:
        return fit(name, effects, start)
    except (RuntimeError, ModelError) as error:
        progress(f"{' and '.join(map(str, effects))} could not be simulated: {error}")
        return None


def _fits_of(
    refit: EffectFit,
    entry: Entry,
    row: ScanRow,
    shapes: Sequence[Mapping[str, float]],
    effects: Sequence[Effect],
    simpler: Sequence[Effect] = (),
    *,
    from_prior: bool = False,
) -> list[Callable[[], Stage]]:
    """Return the fits of one candidate: from the parameters as fitted, and from the parameters as stated.

    Calibration of a model without a backlash replaces it by other parameters as well as possible, by a softer spring
    for instance, and from there no small step leads to the backlash.  So for a law that is not linear in its strength
    fits also begin at the strengths of the scan, with the parameters as stated.

    Parameters
    ----------
    refit : EffectFit
    entry : Entry
        Of the catalogue.
    row : ScanRow
        Of the scan: the expected strengths.
    shapes : sequence of mapping
        Shape parameters of the scan.
    effects : sequence of Effect
        Already in the model.
    simpler : sequence of Effect
        Those of them that the candidate replaces.
    from_prior : bool
        Whether the fit of a linear law begins from the stated parameters as well.
    """
    expected = effect_of(entry, row, effects, simpler)
    fits: list[Callable[[], Stage]] = [partial(refit, expected, simpler)]
    if entry.kind.linear:
        starts = [expected] if from_prior else []
    else:
        sizes = sorted({float(s["amplitude"]) for s in shapes if s.get("amplitude", 0.0) > 0.0})
        starts = [replace(expected, strengths=dict.fromkeys(expected.strengths, z)) for z in sizes] or [expected]
    return [*fits, *(partial(refit, start, simpler, from_prior=True) for start in starts)]


def _best_of(
    fits: Sequence[Callable[[], Stage]], stage: Stage, progress: Callable[[str], None]
) -> Stage | ModelError | None:
    """Return the best of some fits; None if none can be simulated, the error if the model cannot be built.

    A fit that sets every strength of its effect to zero explains nothing: the law would have to act with the sign that
    it cannot have, such as a sensor that is early.
    """
    fitted: list[Stage] = []
    for fit in fits:
        try:
            fitted.append(fit())
        except RuntimeError as error:  # a simulation that fails is a bad explanation, not the end of the search
            progress(f"it could not be simulated: {error}")
        except ModelError as error:  # such as an algebraic loop: this model cannot answer for the candidate
            return error
    present = [s for s in fitted if not s.effects or any(s.effects[-1].strengths.values())]
    return min(present, key=lambda s: bic_difference(s, stage), default=None)


def _entries(stage: Stage, include: Sequence[str] = ("*",), exclude: Sequence[str] = ()) -> list[Entry]:
    experiment = stage.identify.fits[0].experiment
    return catalogue(stage.system, experiment.outputs, experiment.inputs, include=include, exclude=exclude)


# -------------------------------------------------------------------- add one effect


def score_candidates(
    stage: Stage,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> tuple[list[ScanResult], list[Candidate], list[tuple[Entry, str]]]:
    """Return the scans of a stage's residual, the candidates scored, and those that the records cannot answer for.

    Parameters as of `propose_effect`.
    """
    problem = stage.weighted_problem()
    entries = _entries(stage, include, exclude)
    candidates, refused = candidate_sensitivities(problem, entries, progress, stage.effects, curves=not stage.effects)
    residual, sensitivities = problem.residual(), problem.sensitivities()
    progress(f"scores of {count_text(len(candidates), 'candidate')}")
    return _scans(residual, sensitivities, candidates, level, seed, stage.noise), candidates, refused


def _scans(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    level: float,
    seed: int,
    noise: Mapping[str, float],
) -> list[ScanResult]:
    """Scan without whitening, which tolerates effects of inexact shape; then with whitening, which finds small ones.

    Each scan gets its share of the level, as the free curves and the omnibus test do, so that all together keep it.
    Where the residual is correlated over so long that it has few independent pieces, no null distribution exists for
    the scan without whitening, as with a disturbance that adds up along the record: only the whitened scan is made.
    """
    from discrepancy.statistics.scan import scan
    from discrepancy.statistics.verdicts import Verdict
    from discrepancy.statistics.whitened import scaled_by_rms

    plain = scaled_by_rms(residual, sensitivities, candidates)

    def scanned(whiten: bool) -> ScanResult:
        return scan(
            residual,
            sensitivities,
            candidates,
            level=level / LEVEL_SHARES,
            seed=seed,
            noise_floor=[noise[c] for c in residual.channels],
            whiten=whiten,
            plain=plain,
        )

    first = scanned(whiten=False)
    if first.null.pieces.too_few:
        return [scanned(whiten=True)]
    if any(r.verdict is Verdict.MISSING for r in first.rows):
        return [first]
    return [first, scanned(whiten=True)]


def propose_effect(
    stage: Stage,
    refit: EffectFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None] = silent,
) -> Decision:
    """Score all candidates on a stage's residual, refit the best of them, and accept one or none.

    Parameters
    ----------
    stage : Stage
    refit : EffectFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise significance level.
    seed : int
    progress : callable
    """
    scans, candidates, refused = score_candidates(
        stage, include=include, exclude=exclude, level=level, seed=seed, progress=progress
    )
    finalists = _finalists(scans, [c.name for c in candidates], stage.effects)
    if not finalists:
        return Decision(scans=tuple(scans), refused=tuple(refused), reason="no candidate is significant")
    by_name = {c.name: c for c in candidates}

    def fitted(row: ScanRow) -> Stage | ModelError | None:
        candidate = by_name[row.name]
        entry: Entry = candidate.info["entry"]
        simpler = simpler_in(stage.effects, row.kind, row.where)
        effect = effect_of(entry, row, stage.effects, simpler)
        progress(f"refit with {effect}" + (f" in place of {simpler[0]}" if simpler else ""))
        best = _best_of(_fits_of(refit, entry, row, candidate.shapes, stage.effects, simpler), stage, progress)
        if isinstance(best, Stage) and simpler and not entry.kind.by_direction and bic_difference(best, stage) >= 0.0:
            added = partial(refit, effect_of(entry, row, stage.effects), ())  # in addition to them, not in their place
            best = _best_of([added], stage, progress)
        return best

    better: list[tuple[Stage, ScanRow]] = []
    irrelevant: list[ScanRow] = []
    trials: list[TriedModel] = []

    def try_all(rows: Sequence[ScanRow]) -> None:
        for row, result in zip(rows, parallel_map(fitted, rows), strict=True):
            if isinstance(result, ModelError):
                refused.append((by_name[row.name].info["entry"], cannot_be_built(result)))
            if not isinstance(result, Stage):
                trials.append(TriedModel(row.name, np.nan, "failed"))
                continue
            difference = bic_difference(result, stage)
            if not difference < 0.0:
                trials.append(TriedModel(row.name, difference, "not better"))
            elif is_relevant(result, stage) or needs_prior_conflict(result.identify, stage.identify):
                trials.append(TriedModel(row.name, difference, "better"))
                better.append((result, row))
            else:
                trials.append(TriedModel(row.name, difference, "not relevant"))
                irrelevant.append(row)
        better.sort(key=lambda t: bic_difference(t[0], stage))

    try_all(finalists)
    if not better:
        return Decision(
            scans=tuple(scans),
            trials=tuple(trials),
            refused=tuple(refused),
            irrelevant=tuple(irrelevant),
            reason="no refit is better by BIC and above the noise floor",
        )
    p_value = min(1.0, LEVEL_SHARES * better[0][1].p_value)
    if error_reduction(better[0][0], stage) < SIMPLER_REDUCTION:
        try_all(_nonlinear_at(scans[-1], better[0][1].where, [r.name for r in finalists]))
    better = _simplest_first(better, stage)
    best, row = better[0]
    p_value = min(p_value, LEVEL_SHARES * row.p_value)
    rivals = _rivals(best, stage, better[1:], scans, row.name)
    accepted = AcceptedEffect(
        effect=best.effects[-1], p_value=p_value, delta_bic=bic_difference(best, stage), rivals=rivals
    )
    return Decision(
        scans=tuple(scans),
        trials=tuple(trials),
        refused=tuple(refused),
        irrelevant=tuple(irrelevant),
        accepted=accepted,
        stage=best,
        reason="the simplest of the refits that are as good as the best one",
    )


def _finalists(scans: Sequence[ScanResult], known: Sequence[str], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the significant candidates that deserve a refit, best first.

    Each brings the simpler kinds that it contains.  Significant richer kinds of the effects that are already in the
    model are tried as well, however little they explain: a law that was only the first answer may be what is wrong.
    """
    from discrepancy.statistics.verdicts import Verdict

    scan = scans[-1]
    significant = sorted((r for r in scan.rows if r.verdict is Verdict.MISSING), key=lambda r: r.delta_bic)
    if not significant:
        return []
    close = [r for r in significant if r.error_reduction > FINALIST_REDUCTION * significant[0].error_reduction]
    strongest = _different(scan, close, effects)
    simpler = [f"{kind}@{r.where}" for r in strongest for kind in kind_named(r.kind).contains]
    names = [r.name for r in strongest]
    richer = [r.name for r in significant if simpler_in(effects, r.kind, r.where)]
    more = dict.fromkeys([*simpler, *richer])
    names += [n for n in more if n not in names and n in known and n not in scan.refused]
    return [scan[n] for n in names]


def _different(scan: ScanResult, rows: Sequence[ScanRow], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the first `FINALISTS` candidates of which no two change the same.

    Of several that change the same, the one at a place where something was found already is kept, else the first.
    """
    known = {e.where for e in effects}
    left = list(rows)
    kept: list[ScanRow] = []
    while left and len(kept) < FINALISTS:
        ties = scan.ties_of(left[0].name)
        tied = (*ties.same_kind, *ties.other_kind) if ties is not None else ()
        same = {left[0].name, *(t.name for t in tied if t.correlation >= SAME_CORRELATION)}
        kept.append(next((r for r in left if r.name in same and r.where in known), left[0]))
        left = [r for r in left if r.name not in same]
    return kept


def _nonlinear_at(scan: ScanResult, where: str, known: Sequence[str]) -> list[ScanRow]:
    """Return the kinds at a place that are not linear in their strength, which a linear scan misjudges."""
    return [r for r in scan.rows if r.where == where and r.name not in known and not kind_named(r.kind).linear]


def _is_richer(kind: str, best: Stage) -> bool:
    """Tell whether a kind contains the accepted effect or has more strengths: the same law with more freedom."""
    simple = best.effects[-1]
    return simple.kind in kind_named(kind).contains or len(kind_named(kind).strengths) > len(simple.strengths)


def _simplest_first(better: list[tuple[Stage, ScanRow]], stage: Stage) -> list[tuple[Stage, ScanRow]]:
    """Put first the simplest explanation that is tied with the best, or that does most of its work.

    A law with more freedom always fits a little better, because no law is exact.  Where a simpler law that it contains
    removes nearly as much of the error, that one is the answer of this step; if the rest matters, the next step finds
    it, and redundant effects are then removed.
    """
    least = bic_difference(better[0][0], stage)
    tied = [t for t in better if bic_difference(t[0], stage) - least < DECISIVE_BIC]
    known = {e.where for e in stage.effects}  # of two places that look the same, the one where something was found
    first = min(tied, key=lambda t: (_complexity(t[0]), t[1].where not in known))
    contained_in_first = [
        t
        for t in better
        if t[1].kind in first[0].effects[-1].definition.contains
        and t[1].where == first[1].where
        and error_reduction(t[0], stage) >= SIMPLER_REDUCTION * error_reduction(first[0], stage)
    ]
    first = contained_in_first[0] if contained_in_first else first
    return [first, *(t for t in better if t is not first)]


def _complexity(stage: Stage) -> tuple[int, int, int]:
    """Return strengths and effects of a model, and the number of laws that its last law contains."""
    effects = stage.effects
    return sum(len(e.strengths) for e in effects), len(effects), len(effects[-1].definition.contains)


def _rivals(
    best: Stage, stage: Stage, others: Sequence[tuple[Stage, ScanRow]], scans: Sequence[ScanResult], name: str
) -> tuple[RivalExplanation, ...]:
    """Return the other explanations: refitted finalists, ties of the scan, and the next in its ranking."""
    listed: dict[str, RivalExplanation] = {}
    ties = [t for scan in scans if (of := scan.ties_of(name)) for t in (*of.same_kind, *of.other_kind)]
    twins = {t.name for t in ties if t.correlation >= TWIN_CORRELATION}
    for other, row in others:
        difference = bic_difference(other, stage) - bic_difference(best, stage)
        # fits on trial of almost the same model end a few points of BIC apart
        close = difference < (2.0 * DECISIVE_BIC if row.name in twins else DECISIVE_BIC)
        tied = close and not _is_richer(row.kind, best)
        listed[row.name] = _rival(row, float(difference), refitted=True, tied=tied)
    for tie in ties:
        # a part of the accepted effect lies in its span as well, but explains less
        same = tie.correlation >= UNFITTED_TIE_CORRELATION and abs(2.0 * tie.gain_deficit) < DECISIVE_BIC
        if tie.name not in listed and same and not _is_richer(tie.kind, best):
            listed[tie.name] = _rival(tie, 2.0 * tie.gain_deficit, refitted=False, tied=True)
    plain = scans[0]
    if name not in plain.refused:
        top = plain[name]
        for row in sorted(plain.rows, key=lambda r: -r.error_reduction)[:8]:
            if row.name != name and row.name not in listed:
                difference = float(row.delta_bic - top.delta_bic)
                listed[row.name] = _rival(row, difference, refitted=False, tied=False)
    return _by_bic(listed.values())


def _rival(of: Effect | ScanRow | Tie, delta_bic: float, *, refitted: bool, tied: bool) -> RivalExplanation:
    return RivalExplanation(
        kind=of.kind, where=of.where, delta_bic=delta_bic, refitted=refitted, indistinguishable=tied
    )


def _by_bic(rivals: Iterable[RivalExplanation]) -> tuple[RivalExplanation, ...]:
    return tuple(sorted(rivals, key=lambda r: r.delta_bic))


def require_presence(decision: Decision, stage: Stage, fit: Callable[[Stage], Stage]) -> Decision:
    """Withdraw an effect that removes no error, unless the full fit shows that its strength differs from zero.

    An effect that calibration replaces with parameters outside their stated uncertainty is accepted for their sake.  A
    model that is wrong in another way also drives parameters outside, and the strength of the effect that brings them
    back is then badly known: intervals account for the correlation of the residual.

    Parameters
    ----------
    decision : Decision
    stage : Stage
        From which the step begins.
    fit : callable
        Fits the stage of a trial fully.
    """
    if decision.accepted is None or decision.stage is None or is_relevant(decision.stage, stage):
        return decision
    effect = decision.accepted.effect
    fitted = fit(decision.stage).identify
    deviations = {q.name: float(s) for q, s in zip(fitted.parameters, fitted.std, strict=True)}
    for name in map(effect.parameter_name, effect.strengths):
        if np.isfinite(deviations[name]) and abs(fitted[name]) > PRESENCE * deviations[name]:
            return decision
    reason = f"{effect} removes no error above the noise floor, and its strength may be zero"
    return replace(decision, accepted=None, stage=None, reason=reason)


# -------------------------------------------------------------------- add a masking pair


def propose_pair(
    decision: Decision,
    stage: Stage,
    fit: TrialFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> Decision:
    """Replace a decision by one for a masking pair, where the two effects together clearly explain more.

    A step finds one effect at a time.  Of two that nearly cancel neither points along the residual, and the step finds
    nothing, or a third effect that resembles their difference.  The pair is accepted where both together clearly beat
    that third effect, and that effect with the best partner it has.

    Parameters
    ----------
    decision : Decision
        Of the step with one effect at a time.
    stage : Stage
        From which it begins.
    fit : TrialFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise level of the study, of which this test has its share.
    seed : int
    progress : callable
    """
    entries = {e.name: e for e in _entries(stage, include, exclude)}
    refused = {e.name for e, _ in decision.refused}
    known = {r.name for r in decision.scan.rows if r.name in refused or simpler_in(stage.effects, r.kind, r.where)}

    def excluded(a: ScanRow, b: ScanRow) -> bool:
        return contained(a, b) or a.name in known or b.name in known

    single = str(decision.accepted.effect) if decision.accepted is not None else ""
    pairs = find_masking_pairs(decision.scans, excluded, level=level / LEVEL_SHARES, seed=seed, singly=single)
    if pairs is None:
        return decision

    def together(pair: Pair) -> Stage | None:
        progress(f"refit with the masking pair {' and '.join(pair.names)}")
        new = [effect_of(entries[r.name], r, stage.effects) for r in pair.rows]
        return _fitted_present(fit, (*stage.effects, *new), 2, stage, progress)

    families = _families(pairs)
    fits = parallel_map(lambda f: together(f[0]), families)
    decision = replace(decision, trials=(*decision.trials, *_pair_trials(fits, families, stage)))
    better = [(s, f) for s, f in zip(fits, families, strict=True) if s is not None]
    better = [t for t in better if bic_difference(t[0], stage) < -DECISIVE_BIC and is_relevant(t[0], stage)]
    if not better:
        return decision
    better = _simplest_pair_first(better, stage)
    best = better[0][0]
    if decision.stage is not None and bic_difference(best, decision.stage) > -VERY_STRONG_BIC:
        return decision
    if decision.stage is not None and decision.accepted is not None and pairs.singly is not None:
        other = next(r for r in pairs.singly.rows if r.name != single)
        progress(f"refit with {single} and {other.name}")
        partner = effect_of(entries[other.name], other, decision.stage.effects)
        rival = _fitted_present(fit, (*decision.stage.effects, partner), 1, decision.stage, progress)
        if rival is not None and bic_difference(best, rival) > -VERY_STRONG_BIC:
            accepted = decision.accepted
            others = ((s, f[0]) for s, f in better if single not in f[0].names)
            more = (_pair_rival(pair.rows, bic_difference(s, rival)) for s, pair in others)
            rivals = (*accepted.rivals, *(r for r in more if r.indistinguishable))
            return replace(decision, accepted=replace(accepted, rivals=_by_bic(rivals)))
    return _both(decision, stage, better, min(1.0, LEVEL_SHARES * pairs.p_value), fit, progress)


def _pair_trials(fits: Sequence[Stage | None], families: Sequence[Sequence[Pair]], stage: Stage) -> list[TriedModel]:
    trials = []
    for fitted, family in zip(fits, families, strict=True):
        name = " + ".join(family[0].names)
        difference = bic_difference(fitted, stage) if fitted is not None else np.nan
        outcome = "failed" if fitted is None else "better" if difference < -DECISIVE_BIC else "not better"
        trials.append(TriedModel(name, difference, outcome))
    return trials


def _families(pairs: MaskingPairs) -> list[list[Pair]]:
    """Return the pairs that deserve a refit, each with those that change almost the same."""
    families: list[list[Pair]] = []
    for pair in (p for p in pairs.pairs if p.gain > FINALIST_REDUCTION * pairs.pairs[0].gain):
        family = next((f for f in families if pairs.scores.twins(pair, f[0])), None)
        if family is not None:
            family.append(pair)
        elif len(families) < PAIRS:
            families.append([pair])
    return families


def _fitted_present(
    fit: TrialFit, effects: tuple[Effect, ...], new: int, start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None if it cannot be simulated, or sets one of the last ``new`` to zero."""
    stage = _fit(fit, f"+ {effects[-1]}", effects, start, progress)
    return stage if stage is not None and all(any(e.strengths.values()) for e in stage.effects[-new:]) else None


def _simplest_pair_first(better: Sequence[tuple[Stage, list[Pair]]], stage: Stage) -> list[tuple[Stage, list[Pair]]]:
    """Return pairs by their BIC, but first the simplest that is as good as the best, or does most of its work.

    As `_simplest_first` of single effects: a law with more freedom always fits a little better.
    """
    ranked = sorted(better, key=lambda t: bic_difference(t[0], stage))
    best = ranked[0][0]
    least, needed = bic_difference(best, stage), SIMPLER_REDUCTION * error_reduction(best, stage)

    def contained_in_best(other: Stage) -> bool:
        names = [{f"{k}@{e.where}" for k in (e.kind, *e.definition.contains)} for e in best.effects[-2:]]
        a, b = map(str, other.effects[-2:])
        both = any(a in one and b in two for one, two in (names, names[::-1]))
        return both and error_reduction(other, stage) >= needed

    close = [t for t in ranked if bic_difference(t[0], stage) - least < DECISIVE_BIC or contained_in_best(t[0])]
    first = min(close, key=lambda t: sum(len(e.strengths) for e in t[0].effects))
    return [first, *(t for t in ranked if t is not first)]


def _both(
    decision: Decision,
    stage: Stage,
    better: Sequence[tuple[Stage, Sequence[Pair]]],
    p_value: float,
    fit: TrialFit,
    progress: Callable[[str], None],
) -> Decision:
    """Return the decision for both effects of the best pair; the one that is better alone comes first."""
    best = better[0][0]
    two = best.effects[-2:]
    alone: list[tuple[float, Stage, Effect]] = []
    for effect, other in (two, two[::-1]):
        progress(f"refit with {effect} alone")
        by_itself = _fit(fit, f"+ {effect}", (*stage.effects, effect), stage, progress)
        if by_itself is not None:
            alone.append((bic_difference(by_itself, stage), by_itself, other))
    if not alone:
        return decision
    difference, first, second = min(alone, key=lambda t: t[0])
    ordered = (*best.effects[:-2], next(e for e in two if e is not second), second)
    both = replace(best, name=f"+ {second}", effects=ordered)
    rivals = _rivals_of_pair(better, stage, (str(ordered[-2]), str(second)))
    accepted = [
        AcceptedEffect(
            effect=effect, p_value=p_value, delta_bic=change, rivals=rivals[str(effect)], masked_by=str(other)
        )
        for effect, other, change in (
            (ordered[-2], second, difference),
            (second, ordered[-2], bic_difference(both, first)),
        )
    ]
    reason = "both together are clearly better than any single effect"
    return replace(decision, first=(accepted[0], first), accepted=accepted[1], stage=both, reason=reason)


def _rivals_of_pair(
    better: Sequence[tuple[Stage, Sequence[Pair]]], stage: Stage, names: tuple[str, str]
) -> Mapping[str, tuple[RivalExplanation, ...]]:
    """Return for each effect of the best pair what replaces it in the others; two new ones go with the last.

    Of pairs that change almost the same only the first was refitted; the others are known by the scan alone.
    """
    least, own = bic_difference(better[0][0], stage), better[0][1]
    others = [(p, own[0].gain - p.gain, False) for p in own[1:]]
    others += [(f[0], bic_difference(s, stage) - least, True) for s, f in better[1:]]
    listed: dict[str, list[RivalExplanation]] = {n: [] for n in names}
    for pair, difference, refitted in others:
        new = [r for r in pair.rows if r.name not in names]
        if len(new) == 2:
            listed[names[-1]].append(_pair_rival(new, float(difference), refitted))
        else:
            replaced = next(n for n in names if n not in pair.names)
            tied = difference < DECISIVE_BIC
            listed[replaced].append(_rival(new[0], float(difference), refitted=refitted, tied=tied))
    return {n: _by_bic(r) for n, r in listed.items()}


def _pair_rival(rows: Sequence[ScanRow], difference: float, refitted: bool = True) -> RivalExplanation:
    """Return two effects as one other explanation."""
    rival = _rival(rows[0], difference, refitted=refitted, tied=difference < DECISIVE_BIC)
    return replace(rival, kind=f"{rows[0].kind} with {rows[1].name}")


# -------------------------------------------------------------------- add the likeliest effect without significance


def propose_without_significance(
    stage: Stage,
    scan: ScanResult,
    refit: EffectFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    p_value: float,
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the likeliest effect where none is significant and yet the residual follows the inputs.

    A scan is linear about the recalibrated model.  An effect that is too nonlinear for that, such as a large backlash
    that calibration has replaced by softer springs, is found by fits from the parameters as stated.  They are made only
    where the omnibus test says that something is missing, so they keep its level; one is accepted only if it removes a
    good part of the error.  Before them come the effects that the scan has found to be present but irrelevant: one of
    them is the likeliest reason for a residual that follows the inputs, and it only has to be the better model.

    Parameters
    ----------
    stage : Stage
        In which no effect was significant.
    scan : ScanResult
        Of that stage.
    refit : EffectFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    p_value : float
        Of the omnibus test.
    progress : callable
    """
    entries = {e.name: e for e in _entries(stage, include, exclude)}
    present = _best_present(stage, scan, refit, entries, progress)
    if present is not None or not exceeds_noise(stage):
        return present
    problem = stage.linearised_problem()
    by_reduction = sorted((r for r in scan.rows if r.name in entries), key=lambda r: -r.error_reduction)
    nonlinear = [r for r in by_reduction if not entries[r.name].kind.linear]
    rows = list({r.name: r for r in (*nonlinear, *by_reduction[:FINALISTS])}.values())

    def fitted(row: ScanRow) -> Stage | None:
        entry = entries[row.name]
        progress(f"refit with {row.name}, from the parameters as stated")
        shapes = entry.kind.shape_grid(problem.motion_range(entry)) if entry.kind.at == "connection" else [row.shape]
        fits = _fits_of(refit, entry, row, shapes, stage.effects, from_prior=True)
        best = _best_of(fits, stage, progress)
        return best if isinstance(best, Stage) else None

    fits = [s for s in parallel_map(fitted, rows) if s is not None and error_reduction(s, stage) > LIKELY_REDUCTION]
    return _best_with_rivals(fits, stage, dict.fromkeys((str(s.effects[-1]) for s in fits), p_value))


def _best_present(
    stage: Stage,
    scan: ScanResult,
    refit: EffectFit,
    entries: Mapping[str, Entry],
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the best of the effects that the scan has found to be present but irrelevant, or None."""
    from discrepancy.statistics.verdicts import Verdict

    present = [r for r in scan.rows if r.verdict in (Verdict.NEGLIGIBLE, Verdict.MISSING) and r.name in entries]
    rows = sorted(present, key=lambda r: r.delta_bic)[:FINALISTS]

    def fitted(row: ScanRow) -> Stage | None:
        progress(f"refit with {row.name}, which is present and changes little")
        best = _best_of(_fits_of(refit, entries[row.name], row, [row.shape], stage.effects), stage, progress)
        return best if isinstance(best, Stage) else None

    fits = [s for s in parallel_map(fitted, rows) if s is not None]
    return _best_with_rivals(fits, stage, {r.name: min(1.0, LEVEL_SHARES * r.p_value) for r in rows})


def _best_with_rivals(fits: Sequence[Stage], stage: Stage, p_values: Mapping[str, float]) -> Stage | None:
    """Return the best of some fits by BIC, the others as its rivals; None if none is clearly better."""
    improved = (s for s in fits if bic_difference(s, stage) < -DECISIVE_BIC)
    better = sorted(improved, key=lambda s: bic_difference(s, stage))
    if not better:
        return None
    best, least = better[0], bic_difference(better[0], stage)
    rivals = []
    for other in better[1:]:
        effect, difference = other.effects[-1], bic_difference(other, stage) - least
        tied = difference < DECISIVE_BIC
        rivals.append(_rival(effect, difference, refitted=True, tied=tied))
    effect = best.effects[-1]
    accepted = AcceptedEffect(effect=effect, p_value=p_values[str(effect)], delta_bic=least, rivals=tuple(rivals))
    return replace(best, accepted=accepted)


# -------------------------------------------------------------------- exchange one effect


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
        first = _rival(self.old, self.improvement, refitted=True, tied=False)
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
    entries = {e.name: e for e in _entries(last)}
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
        names = [n for n in _exchange_names(stage.accepted, scan) if n in entries and n not in present][:EXCHANGES]
        proposals += [(index, old, effect_of(entries[n], scan[n], rest)) for n in names]

    def fitted(proposal: tuple[int, Effect, Effect]) -> Stage | None:
        _, old, new = proposal
        progress(f"refit with {new} in place of {old}")
        stage = _fit(fit, last.name, tuple(new if e is old else e for e in last.effects), last, progress)
        return stage if stage is not None and all(any(e.strengths.values()) for e in stage.effects) else None

    exchanges = [
        Exchange(index=index, old=old, new=new, stage=stage, improvement=-bic_difference(stage, last))
        for (index, old, new), stage in zip(proposals, parallel_map(fitted, proposals), strict=True)
        if stage is not None
    ]
    best = max(exchanges, key=lambda s: s.improvement, default=None)
    return best if best is not None and best.improvement > DECISIVE_BIC else None


def _exchange_names(accepted: AcceptedEffect, scan: ScanResult) -> list[str]:
    """Return the candidates that may replace an effect: its closest rivals, then the same law elsewhere."""
    close = [r for r in accepted.rivals if r.delta_bic < EXCHANGE_DELTA_BIC and " " not in r.kind]
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
            and canonical_correlation(own, columns.Z[columns.groups[r.group].columns]) >= EXCHANGE_CORRELATION
        ]
        names += [r.name for r in sorted(similar, key=lambda r: -r.score)]
    return [n for n in dict.fromkeys(names) if n in rows]


# -------------------------------------------------------------------- remove one effect


def find_redundant_effect(
    stages: Sequence[Stage], fit: TrialFit, progress: Callable[[str], None]
) -> tuple[Stage, Effect] | None:
    """Return the last stage without an effect that later ones made redundant, and that effect; else None."""
    last = stages[-1]
    if len(last.effects) < 2:
        return None
    for k, effect in enumerate(last.effects[:-1]):
        rest = tuple(e for j, e in enumerate(last.effects) if j != k)
        progress(f"is {effect} still needed?")
        try:
            without = fit(last.name, rest, last)
        except RuntimeError as error:  # the model needs it to follow its inputs at all
            progress(f"without {effect} the machine could not be simulated: {error}")
            continue
        if bic_difference(last, without) > 0.0:
            return without, effect
    return None


# -------------------------------------------------------------------- free curves


def propose_curve(
    stage: Stage, fit: TrialFit, *, level: float, seed: int, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage with the best free curve added, if it is significant; for a stage that no law improves."""
    offer = _offered(stage, level / LEVEL_SHARES, seed, progress)
    return _best_curve(stage, stage, offer.effects, offer.p_values, fit, progress)


def propose_curve_for_laws(
    stages: Sequence[Stage],
    fit: TrialFit,
    *,
    level: float,
    seed: int,
    progress: Callable[[str], None],
    final: bool = True,
) -> tuple[int, Stage] | None:
    """Try to replace all laws found at a connection by one free curve.

    A law that is only near the truth leaves a pattern that further laws then fit.  Where one curve beats the law found
    at its connection by strong evidence, removes clearly more of the error and clearly predicts records left out
    better, the curve is the honest answer; against several laws at one connection it is enough that the curve is the
    better model.  While the search goes on (not ``final``) that is not enough: the next law may be the missing one.
    Against one law only curves are fitted of which that can be expected (`expected_curve_reductions`).

    Returns
    -------
    (int, Stage) or None
        The number of stages that remain before the new one, and the new stage.
    """
    last = stages[-1]
    laws = [e for e in last.effects if e.definition.at == "connection" and not e.definition.free_form]
    for where in dict.fromkeys(e.where for e in laws):
        first = min(k for k, s in enumerate(stages) if any(e.where == where for e in s.effects))
        before = stages[first - 1]
        new = _since(before, last)
        if any(e.where != where for e in new):
            continue  # effects at several connections: a curve at one of them is no simpler
        several = final and len(new) > 1
        promising = None if several else _promising(before, last, where)
        if promising or several or _are_waves(new):
            offer = _offered(before, level, seed, progress, [where])
        else:
            continue
        least = 0.0 if several else VERY_STRONG_BIC
        curve = _best_curve(before, last, *_two_of(offer, promising), fit, progress, least)
        if curve is None or not (several or _is_better_than_law(curve, last, before, new)):
            curve = _curve_for_waves(before, last, new, offer, fit, progress)
        if curve is not None:
            return first, curve
    return None


def propose_curve_for_all(
    stages: Sequence[Stage], fit: TrialFit, *, level: float, seed: int, progress: Callable[[str], None]
) -> tuple[int, Stage] | None:
    """Try to replace everything that was found by one free curve, at any connection.

    A force that no law describes can look like a drift of a sensor or like laws at several connections.

    Returns
    -------
    (int, Stage) or None
        As `propose_curve_for_laws`, which looks at each connection by itself.
    """
    first = min(k for k, s in enumerate(stages) if s.accepted is not None)
    before, last = stages[first - 1], stages[-1]
    new = _since(before, last)
    if not new or any(e.definition.free_form for e in new):
        return None
    promising = _promising(before, last)
    if not promising:
        return None
    offer = _offered(before, level, seed, progress)
    curve = _best_curve(before, last, *_two_of(offer, promising), fit, progress)
    if curve is None or not _removes_more(curve, last, before):
        return None
    same_place = {e.where for e in new} == {curve.effects[-1].where}  # the case of `propose_curve_for_laws`
    return (first, curve) if not same_place or predicts_better(curve, last, new) else None


def _is_better_than_law(curve: Stage, last: Stage, before: Stage, laws: Sequence[Effect]) -> bool:
    return _removes_more(curve, last, before) and predicts_better(curve, last, laws)


def _since(before: Stage, last: Stage) -> list[Effect]:
    """Return the effects that came after a stage; those that it had are fitted anew since."""
    had = {e.component_name for e in before.effects}
    return [e for e in last.effects if e.component_name not in had]


def _offered(
    before: Stage, level: float, seed: int, progress: Callable[[str], None], where: Sequence[str] | None = None
) -> FreeCurveScan:
    return before.free_curve_scan(level=level, seed=seed, where=where, progress=progress)


def _promising(before: Stage, last: Stage, where: str | None = None) -> set[tuple[str, str]]:
    """Return place and regressor of the curves that may remove clearly more of the error than what was found."""
    shares = expected_curve_reductions(before, last)
    return {
        curve for curve, share in shares.items() if LINEAR_ERROR * share > CURVE_REDUCTION and where in (None, curve[0])
    }


def _two_of(offer: FreeCurveScan, promising: set[tuple[str, str]] | None) -> tuple[list[Effect], list[float]]:
    """Return the two best curves of an offer, with their p-values; of these only the promising ones, if given."""
    two = list(zip(offer.effects, offer.p_values, strict=True))[:2]
    kept = [(e, p) for e, p in two if promising is None or (e.where, e.over) in promising]
    return [e for e, _ in kept], [p for _, p in kept]


def _are_waves(laws: Sequence[Effect]) -> bool:
    return len(laws) > 1 and all(e.kind == "angle_harmonic" for e in laws)


def _curve_for_waves(
    before: Stage,
    last: Stage,
    waves: Sequence[Effect],
    offer: FreeCurveScan,
    fit: TrialFit,
    progress: Callable[[str], None],
) -> Stage | None:
    """Return a curve over position in place of several waves that do not repeat, if it removes as much.

    Waves along the path can add up to any curve.  Where one of them passes fewer than two of its periods, nothing
    shows that it repeats, and the curve is what is known.
    """
    if not _are_waves(waves):
        return None
    k = next((k for k, e in enumerate(offer.effects) if e.over == "position"), None)
    if k is None:
        return None
    curve = offer.effects[k]
    path = curve.shape["high"] - curve.shape["low"]
    if min(abs(e.shape["order"]) for e in waves) * path / (2.0 * np.pi) >= REPEATS:
        return None
    best = _best_curve(before, last, [curve], offer.p_values[k:], fit, progress, least=-np.inf)
    enough = WAVE_REDUCTION * error_reduction(last, before)
    return best if best is not None and error_reduction(best, before) >= enough else None


def _best_curve(
    before: Stage,
    rival: Stage,
    effects: Sequence[Effect],
    p_values: Sequence[float],
    fit: TrialFit,
    progress: Callable[[str], None],
    least: float = VERY_STRONG_BIC,
) -> Stage | None:
    """Refit the offered curves; return the best relevant one if its BIC is below that of ``rival`` by ``least``."""
    fits = []
    for effect, p in list(zip(effects, p_values, strict=False))[:2]:
        progress(f"refit with a free curve over {effect.over} at {effect.where}")
        stage = _fit(fit, f"+ {effect} over {effect.over}", (*before.effects, effect), before, progress)
        if stage is not None and is_relevant(stage, before):  # as is required of a law
            fits.append((bic_difference(stage, rival), stage, p))
    fits.sort(key=lambda t: t[0])
    if not fits or fits[0][0] > -least:
        return None
    difference, stage, p = fits[0]
    rivals = []
    for other_difference, other, _ in fits[1:]:
        curve, more = other.effects[-1], other_difference - difference
        other_curve = _rival(curve, more, refitted=True, tied=more < VERY_STRONG_BIC)
        rivals.append(replace(other_curve, kind=f"{curve.kind} over {curve.over}"))
    accepted = AcceptedEffect(
        effect=stage.effects[-1], p_value=p, delta_bic=bic_difference(stage, before), rivals=tuple(rivals)
    )
    return replace(stage, accepted=accepted)


def predicts_better(curve: Stage, last: Stage, laws: Sequence[Effect]) -> bool:
    """Tell whether a curve over position clearly predicts records left out better than one law.

    It may be a curve of force or of the level of friction.  A curve of many points follows what is slow in a
    disturbance and beats the true law on the records it is fitted to.  The predictions of several laws that stand in
    for another one are no measure, so against several laws this is not required.  A curve over speed is not tested:
    other records do not reach the speed of the fastest one.  Over time it was not examined.
    """
    if len(laws) > 1 or curve.effects[-1].over not in ("position", "friction"):
        return True
    return left_out_difference(curve, last, last.scan_preparation) < -VERY_STRONG_BIC


def _removes_more(curve: Stage, laws: Stage, before: Stage) -> bool:
    """Tell whether a curve removes clearly more of the error above the noise floor than the laws do."""
    with_laws, with_curve = laws.rmse("identify"), curve.rmse("identify")
    shares = [(with_laws[n] ** 2 - with_curve[n] ** 2) / start for n, start in excess_error(before).items()]
    return max(shares, default=0.0) > CURVE_REDUCTION
