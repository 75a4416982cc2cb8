"""The score scan: which missing effect would explain the residual, and how sure that is.

`scan` is the one door. See docs/method/score-scan.md for the method in plain words and in equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities, check_compatible
from discrepancy.statistics.null import Null, cut, null_distribution
from discrepancy.statistics.projection import Layout
from discrepancy.statistics.scan_result import ScanResult
from discrepancy.statistics.score import Columns, Scores
from discrepancy.statistics.verdicts import Row, Verdict, decide, smallest_visible
from discrepancy.statistics.whitened import (
    Clean,
    Whitened,
    best_groups,
    fit_whitened,
    louder,
    plainly_weighed,
    raw_residual,
    remove_effects,
    share_removed,
    surprise_of,
)

MAX_CLEAN = 4
CLEAN_LEVEL = 0.01
# Columns from which on what stands out is told by shuffling: laws have at most four, free curves 17.
FEW_COLUMNS = 4
# At the textbook amplitude 58 % were detected instead of 80 %, at 1.2 times it 79 % (156 of 198): λ and the
# shape are estimated, which the formula takes as known.
MDE_MARGIN = 1.2


def scan(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    *,
    level: float = 0.02,
    draws: int = 400,
    seed: int | np.random.Generator = 0,
    max_order: int = 24,
    whiten: bool = True,
    noise_floor: Sequence[float] | None = None,
    rounds: int = 2,
    clean: int = 2,
    plain: Whitened | None = None,
    few: Sequence[Candidate] | None = None,
) -> ScanResult:
    """Score every candidate effect on a residual, and say how sure that is.

    Parameters
    ----------
    residual : Residual
        Measured minus modelled outputs.
    sensitivities : Sensitivities
        What calibration may move: parameters with priors, nuisances of single blocks.
    candidates : sequence of Candidate
        Effects that might be missing.
    level : float
        Family-wise level: chance of naming anything when nothing is missing.
    draws : int
        Shuffled residuals in the null.
    seed : int or Generator
    max_order : int
        Largest number of whitening coefficients per channel.
    whiten : bool
        False: every channel is weighed by its root mean square alone, and its colour is left as it is.
    noise_floor : sequence of float, optional
        Standard deviation of each channel's noise, for the amplitude that would matter; default from the
        residual.
    rounds : int
        How often the whitening is refitted after removing calibration and the best candidates.
    clean : int
        How many of the best candidates are removed before the whitening is fitted.
    plain : Whitened, optional
        What `discrepancy.statistics.whitened.plainly_weighed` gives for the same arrays, if it is there already.
    few : sequence of Candidate, optional
        Those among which ``clean`` looks for the best, if not all: not those with many columns, for instance.

    Returns
    -------
    ScanResult

    Raises
    ------
    ValueError
        If arrays do not fit together, or level and draws are out of range.
    """
    check_compatible(residual, sensitivities, candidates)
    if not 0 < level < 0.5:
        raise ValueError(f"level must lie between 0 and 0.5, got {level}")
    if draws < 50:
        raise ValueError(f"draws must be at least 50, got {draws}")
    rng = np.random.default_rng(seed)
    if whiten:
        w = fit_whitened(residual, sensitivities, candidates, max_order, rounds, clean, plain, few)
    else:
        w = plain or plainly_weighed(residual, sensitivities, candidates)
    return judge(w, residual, sensitivities, candidates, level, draws, rng, noise_floor)


def judge(
    w: Whitened,
    residual: Residual,
    sens: Sensitivities,
    candidates: Sequence[Candidate],
    level: float,
    draws: int,
    rng: np.random.Generator,
    noise_floor: Sequence[float] | None,
) -> ScanResult:
    """Score candidates that are whitened and projected already; the rest is as in `scan`."""
    lay = w.projection.layout
    refused = _refused(candidates, w.columns)
    if w.scorer is None:
        pieces = cut(lay, residual.dt, w.e)
        null = Null(np.zeros((0, draws)), np.zeros(0), pieces)
        return ScanResult(
            (),
            refused,
            None,
            None,
            level,
            float(lay.n_data),
            1.0,
            "",
            (),
            w.projection.not_excited,
            null,
            w.whitener,
            w.projection,
            w.e,
            None,
        )
    scorer = w.scorer
    cleaned, null = _without_what_stands_out(w, residual.dt, draws, rng, len(candidates))
    pieces = null.pieces
    share = share_removed(scorer, cleaned.basis)
    s = scorer(w.e[:, None], cleaned.e[:, None], share) if cleaned.groups else scorer(w.e[:, None])
    s = louder(s, scorer, cleaned.e)
    best = best_groups(scorer, s)
    lam_bar = float(np.median(s.lam[:, 0]))
    n_eff = lay.n_data / lam_bar
    floor = np.zeros(len(residual.channels)) if noise_floor is None else np.asarray(noise_floor, dtype=float)
    if not np.all(floor > 0.0):  # a noise that is not known is at most what is left
        left = np.std(np.concatenate(raw_residual(w, residual, sens, candidates, cleaned.groups)), axis=0)
        floor = np.where(floor > 0.0, floor, left)
    most = np.zeros(len(candidates))
    most[list(best)] = [surprise_of(scorer, s, c) for c in best]
    p_values, least = null.p_value(most), null.critical(level)
    shapes: dict[int, list[int]] = {c: [] for c in best}
    for g, group in enumerate(scorer.columns.groups):
        shapes[group.candidate].append(g)
    rows = []
    for c, g in best.items():
        visible = _Visible(candidates[c], w, s, least[c], floor, residual)
        rows.append(
            _row(candidates[c], g, shapes[c], visible, w, s, null, level, lam_bar, n_eff, most[c], p_values[c], sens)
        )
    rows.sort(key=lambda r: (-(r.p < level), r.delta_bic))
    significant = [r for r in rows if r.verdict is Verdict.MISSING]
    top = significant[0] if significant else None
    few = ""
    if pieces.few:
        few = (
            f"only {len(pieces.spans)} independent pieces of residual (correlation time "
            f"{pieces.correlation_time:.2g} s in {residual.duration:.3g} s): record longer or more often"
        )
    removed = tuple(candidates[scorer.columns.groups[i].candidate].name for i in cleaned.groups)
    found = ScanResult(
        tuple(rows),
        refused,
        top,
        None,
        level,
        n_eff,
        lam_bar,
        few,
        removed,
        w.projection.not_excited,
        null,
        w.whitener,
        w.projection,
        w.e,
        scorer,
    )
    return found if top is None else replace(found, ties=found.ties_of(top.name))


def _without_what_stands_out(
    w: Whitened, dt: float, draws: int, rng: np.random.Generator, n_candidates: int
) -> tuple[Clean, Null]:
    """Return the residual without the effects that stand out, and what luck gives with that residual.

    A group of a few columns stands out where its surprise could not be luck if it were an exact one.  One of many
    columns, as a free curve, takes what is slow in the noise for itself; were it removed, the noise would seem lower
    than it is.  It stands out where its surprise is larger than luck gives with the residual as it is.
    """
    scorer = w.scorer
    assert scorer is not None

    def luck(e: Array) -> Null:
        pieces = cut(w.projection.layout, dt, e)
        return null_distribution(
            scorer, w.projection, e, draws=draws, rng=rng, n_candidates=n_candidates, pieces=pieces
        )

    least = np.full(len(scorer.columns.groups), -np.log(CLEAN_LEVEL / len(scorer.columns.groups)))
    cleaned = remove_effects(w, MAX_CLEAN, least)
    if not cleaned.groups or np.all(scorer.kdim[list(cleaned.groups)] <= FEW_COLUMNS):
        return cleaned, luck(cleaned.e)
    as_it_is = luck(w.e)
    many = scorer.kdim > FEW_COLUMNS
    own = as_it_is.critical(CLEAN_LEVEL)[[g.candidate for g in scorer.columns.groups]]
    least[many] = np.maximum(least, own)[many]
    cleaned = remove_effects(w, MAX_CLEAN, least)
    return cleaned, luck(cleaned.e) if cleaned.groups else as_it_is


def _refused(candidates: Sequence[Candidate], columns: Columns) -> dict[str, str]:
    """Candidates of which no point of the shape grid can be scored."""
    scored = {g.candidate for g in columns.groups}
    out = {}
    for i, c in enumerate(candidates):
        if i not in scored:
            out[c.name] = next(why for (cand, _), why in columns.dropped.items() if cand == i)
    return out


@dataclass(frozen=True)
class _Visible:
    """What these records would show of a candidate, shape by shape."""

    candidate: Candidate
    w: Whitened
    s: Scores
    u_crit: float
    floor: Array
    residual: Residual

    def needed(self, g: int) -> float:
        """Return √(LM/λ) that the family-wise test requires of a group."""
        from scipy.special import fdtri

        assert self.w.scorer is not None
        k, nu = float(self.w.scorer.kdim[g]), float(self.w.scorer.dof[g])
        return float(np.sqrt(k * fdtri(k, nu, 1.0 - np.exp(-max(self.u_crit, 1e-9)))))

    def at(self, g: int) -> tuple[float, float]:
        """Return the smallest amplitude that would be seen at a group's shape, and that which would matter there."""
        assert self.w.scorer is not None
        group = self.w.scorer.columns.groups[g]
        _, cov = self.w.scorer.raw_amplitude(g, self.s.amplitude[group.cols, 0])
        variance = float(np.max(np.diag(cov)) * self.s.lam[g, 0])
        return MDE_MARGIN * smallest_visible(self.needed(g), variance), self._matters(group.shape)

    def least(self, groups: Sequence[int]) -> tuple[float, float]:
        """Return the same at the shape at which an amplitude that matters shows least."""
        every = [(mde, delta) for mde, delta in map(self.at, groups) if np.isfinite(delta)]
        return max(every, key=lambda t: t[0] / t[1], default=self.at(groups[0]))

    def _matters(self, shape: int) -> float:
        if self.candidate.delta is not None:
            return self.candidate.delta
        blocks = self.candidate.columns[shape]
        if self.residual.weighing:  # what the outputs themselves would do
            blocks = tuple(shaping.undone(b) for shaping, b in zip(self.residual.weighing, blocks, strict=True))
        peak = np.max([np.max(np.abs(b), axis=(0, 2)) for b in blocks], axis=0)
        ok = self.floor > 0
        return float(1.0 / np.max(peak[ok] / self.floor[ok])) if np.any(peak[ok] > 0) else float("inf")


def _row(
    c: Candidate,
    g: int,
    shapes: Sequence[int],
    visible: _Visible,
    w: Whitened,
    s: Scores,
    null: Null,
    level: float,
    lam_bar: float,
    n_eff: float,
    u: float,
    p: float,
    sens: Sensitivities,
) -> Row:
    scorer = w.scorer
    assert scorer is not None
    group = scorer.columns.groups[g]
    lm, lam = float(s.lm[g, 0]), float(s.lam[g, 0])
    amp, cov = scorer.raw_amplitude(g, s.amplitude[group.cols, 0])
    std = np.sqrt(np.diag(cov) * lam)
    nu = float(scorer.dof[g])
    mde, delta = visible.at(g)
    p_single = (1.0 + float(np.sum(null.single[group.candidate] >= u))) / (null.single.shape[1] + 1.0)
    judged = partial(decide, p=float(p), level=level, size=float(np.max(np.abs(amp))), dof=nu, few=null.pieces.few)
    verdict, reason = judged(mde=mde, delta=delta)
    if verdict is Verdict.ABSENT and len(shapes) > 1:  # absent is what would have been seen whatever its shape
        mde, delta = visible.least(shapes)
        verdict, reason = judged(mde=mde, delta=delta)
    free = c.k + c.n_shape
    theta = -scorer.columns.absorbed[g] @ amp
    return Row(
        c.kind,
        c.where,
        lm,
        lam,
        float(p),
        p_single,
        lm / (2 * lam_bar),
        -lm / lam_bar + free * float(np.log(n_eff)),
        amp,
        std,
        w.columns.kappa[(group.candidate, group.shape)],
        mde,
        delta,
        lm / float(w.e @ w.e),
        nu,
        verdict,
        reason,
        dict(c.shapes[group.shape]),
        dict(zip(sens.names, theta.tolist(), strict=True)),
        held_out_gain(w.columns.Z[:, group.cols], w.e, w.projection.layout, lam),
        c.unit,
        g,
        visible.needed(g),
    )


def held_out_gain(Z: Array, e: Array, layout: Layout, lam: float) -> float:
    """Log-likelihood gain on each block with the amplitude fitted on the others, summed.

    What is left out is `Layout.left_out`.  An amplitude that only the block itself determines, as a point
    of a curve at a speed that no other record reaches, is not known from the others: it is held near zero, by a normal
    prior of the spread that the amplitudes of the whole fit have.

    Parameters
    ----------
    Z : ndarray, shape (n_rows, k)
        Orthonormal columns.
    e : ndarray, shape (n_rows,)
    layout : Layout
    lam : float
        Variance of the noise.
    """
    spans = layout.left_out()
    S = np.array([Z[sp].T @ e[sp] for sp in spans])
    H = np.array([Z[sp].T @ Z[sp] for sp in spans])
    whole = S.sum(axis=0)
    prior = lam * whole.size / max(float(whole @ whole), 1e-300) * np.eye(whole.size)
    total = 0.0
    for i in range(len(spans)):
        a = np.linalg.solve(H.sum(axis=0) - H[i] + prior, whole - S[i])
        total += float(2 * a @ S[i] - a @ H[i] @ a)
    return total / (2.0 * lam)
