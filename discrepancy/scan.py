"""The score scan: which missing effect would explain the residual, and how sure that is.

`scan` is the one door. See docs/method/score-scan.md for the method in plain words and in equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.blocks import Array, Candidate, Residual, Sensitivities, check_compatible
from discrepancy.null import Null, cut, null_distribution
from discrepancy.projection import Layout, Projection, project
from discrepancy.score import Columns, Scorer, Scores, make_scorer, prepare_columns
from discrepancy.ties import Ties, find_ties
from discrepancy.verdict import Row, Verdict, decide, smallest_visible, summary
from discrepancy.whitening import Whitener, fit_whitener

if TYPE_CHECKING:
    import pandas as pd

MAX_CLEAN = 4
CLEAN_LEVEL = 0.01
# Surprise (−ln p of one column) above which an effect is kept out of the whitening fit.
LEAST = 8.0


@dataclass(frozen=True)
class ScanResult:
    """What the scan found.

    Attributes
    ----------
    rows : tuple of Row
        One per candidate that could be scored, best first.
    refused : dict
        Candidate → why it cannot be scored.
    best : Row or None
        The effect to add next: the significant one with the largest penalised gain.
    ties : Ties or None
        What else the best could be.
    level : float
        Family-wise level of the claims.
    n_eff : float
        Effective number of observations, N/λ̄.
    lam_bar : float
        Typical inflation λ̄.
    too_few : str
        Warning when the records are too short for the level asked, else empty.
    removed : tuple of str
        Effects whose fit was removed before the noise was measured.
    not_excited : tuple of str
        Uncertain parameters with zero sensitivity.
    """

    rows: tuple[Row, ...]
    refused: dict[str, str]
    best: Row | None
    ties: Ties | None
    level: float
    n_eff: float
    lam_bar: float
    too_few: str
    removed: tuple[str, ...]
    not_excited: tuple[str, ...]
    null: Null = field(repr=False)
    whitener: Whitener = field(repr=False)
    projection: Projection = field(repr=False)
    residual: Array = field(repr=False)
    scorer: Scorer | None = field(repr=False)

    @property
    def verdict(self) -> str:
        """The scan in one sentence."""
        return summary(self.rows, self.refused, self.too_few)

    @property
    def nothing_missing(self) -> bool:
        """True only if nothing is significant and every effect that matters would have been seen."""
        quiet = all(r.verdict in (Verdict.ABSENT, Verdict.NEGLIGIBLE) for r in self.rows)
        return quiet and not self.refused and all(r.mde < r.delta for r in self.rows)

    def __getitem__(self, name: str) -> Row:
        for r in self.rows:
            if r.name == name or r.kind == name:
                return r
        if name in self.refused:
            raise KeyError(f"{name} was refused: {self.refused[name]}")
        raise KeyError(f"{name} is not among the candidates: {', '.join(r.name for r in self.rows)}")

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per candidate."""
        import pandas as pd

        cols = ("kind", "where", "lm", "lam", "p", "gain", "delta_bic", "amplitude", "std", "unit", "kappa", "mde",
                "delta", "error_drop", "held_out_gain", "verdict", "reason", "shape")
        data = []
        for r in self.rows:
            d = {c: getattr(r, c) for c in cols}
            for c in ("amplitude", "std"):
                d[c] = float(d[c][0]) if len(d[c]) == 1 else tuple(float(v) for v in d[c])
            d["verdict"] = str(r.verdict)
            data.append(d)
        for n, why in self.refused.items():
            kind, _, where = n.partition("@")
            data.append({"kind": kind, "where": where, "verdict": str(Verdict.REFUSED), "reason": why})
        return pd.DataFrame(data, columns=list(cols))

    def __repr__(self) -> str:
        head = f"ScanResult: {self.verdict}\n"
        lines = [f"  {'candidate':38s} {'LM/λ':>9s} {'p':>8s} {'amplitude':>11s} {'±':>9s} {'MDE':>9s}  verdict"]
        for r in self.rows[:12]:
            lines.append(
                f"  {r.name:38s} {r.lm / r.lam:9.1f} {r.p:8.2g} {np.linalg.norm(r.amplitude):11.4g} "
                f"{np.linalg.norm(r.std):9.2g} {r.mde:9.3g}  {r.verdict}"
            )
        if len(self.rows) > 12:
            lines.append(f"  … {len(self.rows) - 12} more")
        return head + "\n".join(lines)


@dataclass(frozen=True)
class _Whitened:
    """Everything in the whitened metric."""

    whitener: Whitener
    projection: Projection
    e_raw: Array
    e: Array
    columns: Columns
    scorer: Scorer | None


def _whitened(
    whitener: Whitener, residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate]
) -> _Whitened:
    has_prior = np.isfinite(sens.prior_std)
    layout = Layout(tuple(len(b) for b in residual.blocks), len(residual.channels), int(has_prior.sum()))
    proj = project(whitener, sens, layout)
    e_raw = layout.stack(whitener, residual.blocks, sens.prior_offset[has_prior] / sens.prior_std[has_prior])
    e = proj.remove(e_raw.copy())
    # One scale for all channels keeps their relative weight and makes the noise variance one.
    stacked = (
        (i, j, c.one_sided, layout.stack(whitener, cols))
        for i, c in enumerate(candidates)
        for j, cols in enumerate(c.columns)
    )
    columns = prepare_columns(list(stacked), proj)
    scorer = make_scorer(columns, proj, residual.dt) if columns.groups else None
    return _Whitened(whitener, proj, e_raw, e, columns, scorer)


def _louder(s: Scores, scorer: Scorer, e: Array) -> Scores:
    """Raise λ where the residual is louder at the times at which a candidate acts (noise in motion only)."""
    lam = s.lam * scorer.local(e)[:, None]
    return Scores(s.lm, lam, scorer.surprise(s.lm / lam), s.amplitude)


def _best_groups(scorer: Scorer, s: Scores) -> dict[int, int]:
    """Point of the shape grid that fits best, for each candidate."""
    best: dict[int, int] = {}
    for i, g in enumerate(scorer.columns.groups):
        j = best.get(g.candidate)
        if j is None or s.lm[i, 0] > s.lm[j, 0]:
            best[g.candidate] = i
    return best


def _surprise_of(scorer: Scorer, s: Scores, candidate: int) -> float:
    """Largest surprise on a candidate's shape grid: what the null compares with."""
    return max(float(s.u[i, 0]) for i, g in enumerate(scorer.columns.groups) if g.candidate == candidate)


@dataclass(frozen=True)
class _Clean:
    """Residual without the effects that were fitted to it."""

    e: Array
    basis: Array
    groups: tuple[int, ...]


def _remove_effects(w: _Whitened, limit: int, least_u: float) -> _Clean:
    """Remove the best candidates one after another while each stands out."""
    assert w.scorer is not None
    Z = w.columns.Z
    basis = np.zeros((len(w.e), 0))
    e = w.e.copy()
    chosen: list[int] = []
    scorer_k = w.scorer.kdim
    for _ in range(limit):
        share = _share_removed(w.scorer, basis)
        s = w.scorer(e[:, None], None if not chosen else e[:, None], share)
        u = np.where(share > 0.999, 0.0, s.u[:, 0])
        # Columns were made orthonormal before anything was removed; scale up what is left of them.
        if u.max() < least_u:
            break
        # Among those that stand out, the one that explains most, as a fit would choose.
        i = int(np.argmax(np.where(u >= least_u, s.lm[:, 0] - 8.0 * scorer_k, -np.inf)))
        chosen.append(i)
        cols = Z[:, w.columns.groups[i].cols]
        q = cols - basis @ (basis.T @ cols)
        q, _ = np.linalg.qr(q)
        basis = np.concatenate([basis, q], axis=1)
        e = e - q @ (q.T @ e)
    return _Clean(e, basis, tuple(chosen))


def _share_removed(scorer: Scorer, basis: Array) -> Array:
    """Share of each group's column energy that lies in ``basis``."""
    if basis.shape[1] == 0:
        return np.zeros(len(scorer.columns.groups))
    energy = np.sum((basis.T @ scorer.columns.Z) ** 2, axis=0)
    starts = [g.cols.start for g in scorer.columns.groups]
    out: Array = np.minimum(1.0, np.add.reduceat(energy, starts) / scorer.kdim)
    return out


def _raw_residual(
    w: _Whitened, residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate], groups: Sequence[int]
) -> list[Array]:
    """Residual in the outputs' units with calibration, nuisances and the given groups fitted and removed."""
    lay = w.projection.layout
    Z = [w.columns.Z[:, w.columns.groups[i].cols] @ w.columns.R[i] for i in groups]
    amp = np.zeros(0)
    e = w.e_raw.copy()
    raw_cols: list[tuple[Array, ...]] = []
    if groups:
        amp = np.linalg.lstsq(np.concatenate(Z, axis=1), w.e, rcond=1e-10)[0]
        at = 0
        for i in groups:
            g = w.columns.groups[i]
            cols = candidates[g.candidate].columns[g.shape]
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


def _start_whitener(residual: Residual, sens: Sensitivities) -> Whitener:
    """Channel scales from the raw residual after an unweighted fit of the sensitivities."""
    from discrepancy.whitening import identity

    std = np.sqrt(np.mean(np.concatenate(residual.blocks) ** 2, axis=0))
    std[std == 0] = 1.0
    return identity(list(std), residual.channels, residual.dt)


def scan(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    *,
    level: float = 0.02,
    draws: int = 400,
    seed: int | np.random.Generator = 0,
    max_order: int = 24,
    whitener: Whitener | None = None,
    noise_floor: Sequence[float] | None = None,
    rounds: int = 2,
    clean: int = 2,
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
    whitener : Whitener, optional
        Use this one and do not fit it.
    noise_floor : sequence of float, optional
        Standard deviation of each channel's noise, for the amplitude that would matter; default from the residual.
    rounds : int
        How often the whitening is refitted after removing calibration and the best candidates.
    clean : int
        How many of the best candidates are removed before the whitening is fitted.

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
    w = _fit(residual, sensitivities, candidates, whitener, max_order, rounds, clean)
    return _judge(w, residual, sensitivities, candidates, level, draws, rng, noise_floor)


def _fit(
    residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate], whitener: Whitener | None,
    max_order: int, rounds: int, clean: int,
) -> _Whitened:
    if whitener is not None:
        return _whitened(whitener, residual, sens, candidates)
    w = _whitened(_start_whitener(residual, sens), residual, sens, candidates)
    for r in range(rounds):
        groups: tuple[int, ...] = ()
        if w.scorer is not None and clean:
            least = LEAST if r else np.inf
            groups = _remove_effects(w, clean, least).groups
        raw = _raw_residual(w, residual, sens, candidates, groups)
        fitted = fit_whitener(raw, residual.dt, residual.channels, max_order=max_order)
        w = _whitened(fitted, residual, sens, candidates)
    return w


def _judge(
    w: _Whitened, residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate], level: float, draws: int,
    rng: np.random.Generator, noise_floor: Sequence[float] | None,
) -> ScanResult:
    lay = w.projection.layout
    refused = _refused(candidates, w.columns)
    if w.scorer is None:
        pieces = cut(lay, residual.dt, w.e)
        null = Null(np.zeros(draws), np.zeros((0, draws)), np.zeros(0), pieces)
        return ScanResult((), refused, None, None, level, float(lay.n_data), 1.0, "", (), w.projection.not_excited,
                          null, w.whitener, w.projection, w.e, None)
    scorer = w.scorer
    cleaned = _remove_effects(w, MAX_CLEAN, -np.log(CLEAN_LEVEL / len(scorer.columns.groups)))
    share = _share_removed(scorer, cleaned.basis)
    s = scorer(w.e[:, None], cleaned.e[:, None], share) if cleaned.groups else scorer(w.e[:, None])
    s = _louder(s, scorer, cleaned.e)
    pieces = cut(lay, residual.dt, cleaned.e)
    null = null_distribution(scorer, w.projection, cleaned.e, draws=draws, rng=rng, n_candidates=len(candidates),
                             pieces=pieces)
    best = _best_groups(scorer, s)
    lam_bar = float(np.median(s.lam[:, 0]))
    n_eff = lay.n_data / lam_bar
    floor = np.asarray(noise_floor) if noise_floor is not None else np.std(
        np.concatenate(_raw_residual(w, residual, sens, candidates, cleaned.groups)), axis=0)
    u_crit = null.critical(level)
    rows = [
        _row(candidates[c], g, w, s, null, level, lam_bar, n_eff, floor, u_crit, sens) for c, g in best.items()
    ]
    pen = {id(r): r.gain - 0.5 * (len(r.amplitude) + _n_shape(candidates, r)) * np.log(n_eff) for r in rows}
    rows.sort(key=lambda r: (-(r.p < level), -pen[id(r)]))
    significant = [r for r in rows if r.verdict is Verdict.MISSING]
    top = significant[0] if significant else None
    ties = None
    if top is not None:
        bases: list[Array | None] = [w.columns.Z[:, scorer.columns.groups[r.group].cols] for r in rows]
        ties = find_ties(rows.index(top), [(r.kind, r.where) for r in rows], [pen[id(r)] for r in rows], bases,
                         [r.p < level for r in rows])
    few = ""
    if pieces.few:
        few = (f"only {len(pieces.spans)} independent pieces of residual (correlation time "
               f"{pieces.correlation_time:.2g} s in {residual.duration:.3g} s): record longer or more often")
    removed = tuple(candidates[scorer.columns.groups[i].candidate].name for i in cleaned.groups)
    return ScanResult(tuple(rows), refused, top, ties, level, n_eff, lam_bar, few, removed, w.projection.not_excited,
                      null, w.whitener, w.projection, w.e, scorer)


def _n_shape(candidates: Sequence[Candidate], row: Row) -> int:
    return next(c.n_shape for c in candidates if c.name == row.name)


def _refused(candidates: Sequence[Candidate], columns: Columns) -> dict[str, str]:
    """Candidates of which no point of the shape grid can be scored."""
    scored = {g.candidate for g in columns.groups}
    out = {}
    for i, c in enumerate(candidates):
        if i not in scored:
            out[c.name] = next(why for (cand, _), why in columns.dropped.items() if cand == i)
    return out


def _row(
    c: Candidate, g: int, w: _Whitened, s: Scores, null: Null, level: float, lam_bar: float, n_eff: float,
    floor: Array, u_crit: float, sens: Sensitivities,
) -> Row:
    scorer = w.scorer
    assert scorer is not None
    group = scorer.columns.groups[g]
    lm, lam, u = float(s.lm[g, 0]), float(s.lam[g, 0]), _surprise_of(scorer, s, group.candidate)
    amp, cov = scorer.raw_amplitude(g, s.amplitude[group.cols, 0])
    std = np.sqrt(np.diag(cov) * lam)
    k, nu = float(scorer.kdim[g]), float(scorer.dof[g])
    from scipy.special import fdtri

    crit = float(np.sqrt(k * fdtri(k, nu, 1.0 - np.exp(-max(u_crit, 1e-9)))))
    mde = smallest_visible(crit, float(np.max(np.diag(cov)) * lam))
    delta = c.delta
    if delta is None:
        peak = np.max([np.max(np.abs(b), axis=(0, 2)) for b in c.columns[group.shape]], axis=0)
        ok = floor > 0
        delta = float(1.0 / np.max(peak[ok] / floor[ok])) if np.any(peak[ok] > 0) else float("inf")
    p = float(null.p_value(u)[0])
    p_single = (1.0 + float(np.sum(null.single[group.candidate] >= u))) / (null.single.shape[1] + 1.0)
    size = float(np.max(np.abs(amp)))
    verdict, reason = decide(p=p, level=level, size=size, mde=mde, delta=delta, dof=nu, few=null.pieces.few)
    free = c.k + c.n_shape
    theta = -scorer.columns.absorbed[g] @ amp
    return Row(
        c.kind, c.where, lm, lam, p, p_single, lm / (2 * lam_bar), -lm / lam_bar + free * float(np.log(n_eff)), amp,
        std, w.columns.kappa[(group.candidate, group.shape)], mde, delta, lm / float(w.e @ w.e), nu, verdict, reason,
        dict(c.shapes[group.shape]), dict(zip(sens.names, theta.tolist(), strict=True)),
        held_out_gain(w.columns.Z[:, group.cols], w.e, w.projection.layout, lam), c.unit, g,
    )


def held_out_gain(Z: Array, e: Array, layout: Layout, lam: float) -> float:
    """Log-likelihood gain on each block with the amplitude fitted on the others, summed; halves if there is one."""
    spans = [layout.rows(b) for b in range(len(layout.lengths))]
    if len(spans) < 4:
        spans = [slice(int(a), int(z)) for sp in spans
                 for a, z in zip(*(lambda x: (x[:-1], x[1:]))(np.linspace(sp.start, sp.stop, 5).astype(int)),
                                 strict=True)]
    S = np.array([Z[sp].T @ e[sp] for sp in spans])
    H = np.array([Z[sp].T @ Z[sp] for sp in spans])
    total = 0.0
    for i in range(len(spans)):
        a = np.linalg.lstsq(H.sum(axis=0) - H[i], S.sum(axis=0) - S[i], rcond=1e-8)[0]
        total += float(2 * a @ S[i] - a @ H[i] @ a)
    return total / (2.0 * lam)
