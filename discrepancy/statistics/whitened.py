"""Residual, sensitivities and candidates in the whitened metric; effects removed before noise is measured.

The whitening is fitted on the residual without calibration and without the effects that stand out, because an
effect that stays in the residual would be taken for colour and whitened away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities
from discrepancy.statistics.columns import columns_together
from discrepancy.statistics.projection import Layout, Projection, project
from discrepancy.statistics.score import (
    PER_COLUMN,
    CandidateColumns,
    Scorer,
    Scores,
    make_scorer,
    most_explaining,
    prepare_columns,
)
from discrepancy.statistics.whitening import Whitener, fit_whitener, identity

#: −ln p of one column above which an effect is kept out of the whitening fit.
REMOVED_WHITENED = 8.0
#: The same before any whitening, where slow noise stands out too: a level that drift does not reach.
REMOVED_UNWHITENED = 16.0


@dataclass(frozen=True, kw_only=True)
class WhitenedProblem:
    """Residual and candidates in the whitened metric.

    Attributes
    ----------
    whitener : Whitener
    projection : Projection
    e_raw, e : ndarray, shape (n_rows,)
        Whitened residual before and after the projection.
    columns : CandidateColumns
    scorer : Scorer or None
        None where no candidate can be scored.
    """

    whitener: Whitener
    projection: Projection
    e_raw: Array
    e: Array
    columns: CandidateColumns
    scorer: Scorer | None


def whiten_all(
    whitener: Whitener,
    residual: Residual,
    sens: Sensitivities,
    candidates: Sequence[Candidate],
    *,
    shortlist: bool = False,
) -> WhitenedProblem:
    """Whiten and project residual, sensitivities and candidates; ``shortlist`` keeps those that explain most."""
    has_prior = np.isfinite(sens.prior_std)
    proj = projection_in(whitener, residual, sens)
    layout = proj.layout
    e_raw = layout.stack(whitener, residual.blocks, sens.prior_offset[has_prior] / sens.prior_std[has_prior])
    e = proj.remove(e_raw.copy())
    # One scale for all channels keeps their relative weight and makes the noise variance one.
    columns = prepare_columns(_stacked(layout, whitener, candidates), proj)
    if shortlist:
        columns = most_explaining(columns, e)
    scorer = make_scorer(columns, proj, residual.dt) if columns.groups else None
    return WhitenedProblem(whitener=whitener, projection=proj, e_raw=e_raw, e=e, columns=columns, scorer=scorer)


def projection_in(whitener: Whitener, residual: Residual, sens: Sensitivities) -> Projection:
    """Return the projection onto what calibration cannot explain, in the metric of a whitener."""
    known = int(np.isfinite(sens.prior_std).sum())
    return project(whitener, sens, Layout(tuple(len(b) for b in residual.blocks), len(residual.channels), known))


def rms_projection(residual: Residual, sens: Sensitivities) -> Projection:
    """Return the same with each channel divided by its root mean square alone."""
    return projection_in(rms_whitener(residual), residual, sens)


def _stacked(
    layout: Layout, whitener: Whitener, candidates: Sequence[Candidate]
) -> Iterator[tuple[int, int, bool, Array]]:
    """Whiten the sensitivities of many candidates together: one pass costs little more than one candidate's."""
    most = columns_together(layout.n_rows)
    entries: list[tuple[int, int, bool, tuple[Array, ...]]] = []
    width = 0

    def whitened() -> Iterator[tuple[int, int, bool, Array]]:
        together = [np.concatenate([cols[b] for *_, cols in entries], axis=2) for b in range(len(layout.lengths))]
        white = layout.stack(whitener, together)
        ends = np.cumsum([cols[0].shape[2] for *_, cols in entries])
        parts = np.split(white, ends[:-1], axis=1)
        yield from ((i, j, one, z) for (i, j, one, _), z in zip(entries, parts, strict=True))

    for i, c in enumerate(candidates):
        for j in range(len(c.shapes)):
            if entries and width + c.n_strengths > most:
                yield from whitened()
                entries, width = [], 0
            entries.append((i, j, c.one_sided, tuple(c.sensitivities[j])))
            width += c.n_strengths
    if entries:
        yield from whitened()


def with_local_noise(s: Scores, scorer: Scorer, e: Array) -> Scores:
    """Return scores with λ raised where the residual is noisier at the times at which a candidate acts."""
    inflation = s.inflation * scorer.local_inflation(e)[:, None]
    return Scores(s.score, inflation, scorer.neg_log_p(s.score / inflation), s.amplitude)


def best_groups(scorer: Scorer, s: Scores) -> dict[int, int]:
    """Point of the shape grid that fits best, for each candidate."""
    best: dict[int, int] = {}
    for i, g in enumerate(scorer.columns.groups):
        j = best.get(g.candidate)
        if j is None or s.score[i, 0] > s.score[j, 0]:
            best[g.candidate] = i
    return best


def largest_neg_log_p(scorer: Scorer, s: Scores, candidate: int) -> float:
    """Return the largest −ln p on a candidate's shape grid, which the null distribution is compared with."""
    return max(float(s.neg_log_p[i, 0]) for i, g in enumerate(scorer.columns.groups) if g.candidate == candidate)


@dataclass(frozen=True)
class CleanedResidual:
    """Residual without the effects that were fitted to it."""

    e: Array
    basis: Array
    groups: tuple[int, ...]


def remove_effects(w: WhitenedProblem, limit: int, least_u: float | Array) -> CleanedResidual:
    """Remove the best candidates one after another while −ln p reaches ``least_u``, one value or one for each group."""
    assert w.scorer is not None
    Z = w.columns.Z
    basis = np.zeros((len(w.e), 0))
    e = w.e.copy()
    chosen: list[int] = []
    for _ in range(limit):
        share = share_removed(w.scorer, basis)
        s = w.scorer(e[:, None], None if not chosen else e[:, None], share)
        u = np.where(share > 0.999, 0.0, s.neg_log_p[:, 0])
        # CandidateColumns were made orthonormal before anything was removed; scale up what is left of them.
        if not np.any(u >= least_u):
            break
        # Among those that stand out, the one that explains most, as a fit would choose.
        i = int(np.argmax(np.where(u >= least_u, s.score[:, 0] - PER_COLUMN * w.scorer.kdim, -np.inf)))
        chosen.append(i)
        cols = Z[w.columns.groups[i].columns]
        q = cols - basis @ (basis.T @ cols)
        q, _ = np.linalg.qr(q)
        basis = np.concatenate([basis, q], axis=1)
        e = e - q @ (q.T @ e)
    return CleanedResidual(e, basis, tuple(chosen))


def share_removed(scorer: Scorer, basis: Array) -> Array:
    """Share of each group's column energy that lies in ``basis``."""
    if basis.shape[1] == 0:
        return np.zeros(len(scorer.columns.groups))
    energy = np.sum(scorer.columns.Z.transposed_times(basis) ** 2, axis=1)
    starts = [g.columns.start for g in scorer.columns.groups]
    out: Array = np.minimum(1.0, np.add.reduceat(energy, starts) / scorer.kdim)
    return out


def raw_residual(
    w: WhitenedProblem,
    residual: Residual,
    sens: Sensitivities,
    candidates: Sequence[Candidate],
    groups: Sequence[int],
) -> list[Array]:
    """Residual in the outputs' units with calibration, nuisances and the given groups fitted and removed."""
    lay = w.projection.layout
    Z = [w.columns.Z[w.columns.groups[i].columns] @ w.columns.R[i] for i in groups]
    amp: Array = np.zeros(0)
    e = w.e_raw.copy()
    raw_cols: list[tuple[Array, ...]] = []
    if groups:
        amp = np.asarray(np.linalg.lstsq(np.concatenate(Z, axis=1), w.e, rcond=1e-10)[0], dtype=float)
        at = 0
        for i in groups:
            g = w.columns.groups[i]
            cols = candidates[g.candidate].sensitivities[g.shape]
            k = cols[0].shape[2]
            raw_cols.append(tuple(c @ amp[at : at + k] for c in cols))
            e -= lay.stack(w.whitener, [c @ amp[at : at + k] for c in cols])
            at += k
    w.projection.remove_local(e)
    theta = w.projection.parameters(e) if sens.names else np.zeros(0)
    out = []
    for b, y in enumerate(residual.blocks):
        r = y - sens.blocks[b] @ theta
        for cols_b in raw_cols:
            r = r - cols_b[b]
        nuis = sens.nuisance[b]
        if nuis is not None:
            flat = w.whitener.apply(nuis).reshape(-1, nuis.shape[2])
            target = w.whitener.apply(r).reshape(-1)
            r = r - nuis @ np.linalg.lstsq(flat, target, rcond=1e-10)[0]
        out.append(r)
    return out


def rms_whitener(residual: Residual) -> Whitener:
    """Return the division of each channel by its root mean square, which leaves its colour as it is."""
    std = np.sqrt(np.mean(np.concatenate(residual.blocks) ** 2, axis=0))
    std[std == 0] = 1.0
    return identity(list(std), residual.channels, residual.dt)


def scaled_by_rms(residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate]) -> WhitenedProblem:
    """Return residual and candidates with each channel divided by its root mean square, not whitened."""
    return whiten_all(rms_whitener(residual), residual, sens, candidates)


def fit_whitened(
    residual: Residual,
    sens: Sensitivities,
    candidates: Sequence[Candidate],
    max_order: int,
    rounds: int,
    clean: int,
    plain: WhitenedProblem | None = None,
    few: Sequence[Candidate] | None = None,
) -> WhitenedProblem:
    """Fit the whitening on what is left without calibration and the best candidates, and apply it to everything.

    The fit begins with ``plain``, what `scaled_by_rms` returns, if it was computed before; ``few`` are those of the
    candidates among which the best are searched, if not all.
    """
    searched = candidates if few is None else few
    w = plain or whiten_all(rms_whitener(residual), residual, sens, searched, shortlist=True)
    for r in range(rounds):
        groups: tuple[int, ...] = ()
        if w.scorer is not None and clean:
            groups = remove_effects(w, clean, REMOVED_WHITENED if r else REMOVED_UNWHITENED).groups
        raw = raw_residual(w, residual, sens, searched, groups)
        fitted = fit_whitener(raw, residual.dt, residual.channels, max_order=max_order)
        last = r + 1 == rounds
        w = whiten_all(fitted, residual, sens, candidates if last else searched, shortlist=not last)
    return w
