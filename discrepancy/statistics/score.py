"""Scores of many candidate columns against one or many residuals, in plain linear algebra.

The same code scores the measured residual and every shuffled one, so that whatever is done to the data is
done to the null as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.projection import Layout, Projection
from discrepancy.statistics.score_variance import ScoreVariance, make_bands, score_variance
from multibody.base.parallel import parallel_map

INFLATION_FLOOR = 0.5
WINDOWS_PER_BLOCK = 48
MIN_WINDOW = 16
# Norm of a column relative to the largest value on the candidate's own shape grid.
NOT_EXCITED = 1e-9
ABSORBED = 1.0 - 1e-6
CANCELLED = 1e-2  # share of a column's energy left by a projection below which it is projected again; chosen
TOGETHER = 128  # columns that are projected in one product
# Log-likelihood that a column must explain to be removed; columns that are shortlisted for that; chosen.
PER_COLUMN = 8.0
SHORTLIST = 256


@dataclass(frozen=True)
class Group:
    """CandidateColumns of one candidate at one point of its shape grid."""

    candidate: int
    shape: int
    columns: slice
    one_sided: bool


@dataclass(frozen=True, kw_only=True)
class CandidateColumns:
    """The candidates' sensitivities, projected and made orthonormal group by group.

    Attributes
    ----------
    Z : ndarray, shape (n_rows, n_columns)
    groups : list of Group
    R : list of ndarray, shape (k, k)
        Triangular factors: raw projected columns are ``Z[:, cols] @ R``.
    imitation : list of ndarray, shape (n_theta, k)
        Parameter change that imitates a unit strength.
    confounding : dict
        (candidate, shape) → κ, the share of the candidate's effect that calibration can absorb.
    dropped : dict
        (candidate, shape) → why it cannot be scored.
    """

    Z: Array
    groups: list[Group]
    R: list[Array]
    imitation: list[Array]
    confounding: dict[tuple[int, int], float]
    dropped: dict[tuple[int, int], str]


def prepare_columns(
    whitened: list[tuple[int, int, bool, Array]],
    projection: Projection,
    uncertain: str = "the uncertain parameters",
) -> CandidateColumns:
    """Project and orthonormalise; ``whitened`` holds (candidate, shape, one_sided, columns (n_rows, k))."""
    groups, Rs, imitation = [], [], []
    confounding: dict[tuple[int, int], float] = {}
    dropped: dict[tuple[int, int], str] = {}
    sizes = [Z.shape[1] for *_, Z in whitened]
    Zall = np.empty((projection.layout.n_rows, sum(sizes)))
    projected = _orthonormal(whitened, projection, Zall)
    strongest: dict[int, float] = {}
    for (cand, *_), one in zip(whitened, projected, strict=True):
        strongest[cand] = max(strongest.get(cand, 0.0), one.peak)
    kept = np.ones(Zall.shape[1], dtype=bool)
    start, at = 0, 0
    for (cand, shape, one_sided, _), one, k in zip(whitened, projected, sizes, strict=True):
        key, own, at = (cand, shape), slice(at, at + k), at + k
        if not np.all(one.norm > NOT_EXCITED * strongest[cand]) or strongest[cand] == 0.0:
            dropped[key], confounding[key] = "not excited: these records never make it act", float("nan")
            kept[own] = False
            continue
        confounding[key] = one.confounding
        if one.confounding > ABSORBED or one.R is None:
            dropped[key] = f"not identifiable: {uncertain} can imitate it entirely"
            kept[own] = False
            continue
        Rs.append(one.R)
        imitation.append(one.theta)
        groups.append(Group(cand, shape, slice(start, start + k), one_sided))
        start += k
    return CandidateColumns(
        Z=Zall if kept.all() else Zall[:, kept],
        groups=groups,
        R=Rs,
        imitation=imitation,
        confounding=confounding,
        dropped=dropped,
    )


@dataclass(frozen=True, kw_only=True)
class _Projected:
    """One group of columns, projected and made orthonormal.

    Attributes
    ----------
    norm : ndarray, shape (k,)
        Before the projection.
    peak : float
        Largest absolute value before the projection.
    confounding : float
    R : ndarray, shape (k, k), or None
        None where what is left of the columns is linearly dependent.
    theta : ndarray, shape (n_theta, k)
    """

    norm: Array
    peak: float
    confounding: float
    R: Array | None
    theta: Array


def _orthonormal(whitened: list[tuple[int, int, bool, Array]], projection: Projection, out: Array) -> list[_Projected]:
    """Write orthonormal columns of each group into ``out``; by Cholesky and many groups at a time, which is fastest."""
    packs: list[list[Array]] = [[]]
    for *_, Z in whitened:
        if packs[-1] and sum(z.shape[1] for z in packs[-1]) + Z.shape[1] > TOGETHER:
            packs.append([])
        packs[-1].append(Z)
    ends = np.cumsum([sum(z.shape[1] for z in pack) for pack in packs])

    def straightened(pack: list[Array], end: int) -> list[_Projected]:
        together = np.concatenate(pack, axis=1)
        width = together.shape[1]
        norm = np.sqrt(np.einsum("ij,ij->j", together, together))
        peak = np.maximum(together.max(axis=0, initial=0.0), -together.min(axis=0, initial=0.0))
        theta = projection.take_out(together)
        left = np.einsum("ij,ij->j", together, together)
        if np.any(left < CANCELLED * norm**2):  # remove what rounding left of nearly collinear columns
            projection.remove(together)
        scale = np.where(norm > 0.0, norm, 1.0)
        straight = np.zeros((width, width))
        projected, first = [], 0
        for Z in pack:
            own = slice(first, first + Z.shape[1])
            part = together[:, own]
            gram = part.T @ part / np.outer(scale[own], scale[own])
            R = None
            if np.linalg.eigvalsh(gram)[0] >= 1.0 - ABSORBED:
                r = np.linalg.cholesky(gram).T
                straight[own, own] = np.linalg.inv(r) / scale[own, None]
                R = r * norm[own]
            total = float(np.sum(norm[own] ** 2))
            share = float(np.diag(gram) @ norm[own] ** 2) / total if total > 0.0 else 0.0
            projected.append(
                _Projected(
                    norm=norm[own],
                    peak=float(peak[own].max(initial=0.0)),
                    confounding=1.0 - share,
                    R=R,
                    theta=theta[:, own],
                )
            )
            first = own.stop
        np.matmul(together, straight, out=out[:, end - width : end])
        return projected

    packed = [(pack, int(end)) for pack, end in zip(packs, ends, strict=True) if pack]
    return [one for pack in parallel_map(lambda work: straightened(*work), packed) for one in pack]


def most_explaining(columns: CandidateColumns, e: Array) -> CandidateColumns:
    """Return the groups that explain most of a projected residual, some `SHORTLIST` columns of them.

    Parameters
    ----------
    columns : CandidateColumns
    e : ndarray, shape (n_rows,)
    """
    if columns.Z.shape[1] <= SHORTLIST:
        return columns
    size = np.array([g.columns.stop - g.columns.start for g in columns.groups])
    used = allowed(columns, (columns.Z.T @ e)[:, None])[:, 0]
    gain = np.add.reduceat(used**2, [g.columns.start for g in columns.groups]) - PER_COLUMN * size
    order = np.argsort(-gain, kind="stable")
    keep = np.sort(order[: max(1, int(np.searchsorted(np.cumsum(size[order]), SHORTLIST, side="right")))])
    ends = np.cumsum(size[keep])
    groups = [
        replace(columns.groups[i], columns=slice(int(z - k), int(z)))
        for i, k, z in zip(keep, size[keep], ends, strict=True)
    ]
    return replace(
        columns,
        Z=np.concatenate([columns.Z[:, columns.groups[i].columns] for i in keep], axis=1),
        groups=groups,
        R=[columns.R[i] for i in keep],
        imitation=[columns.imitation[i] for i in keep],
    )


def allowed(columns: CandidateColumns, A: Array) -> Array:
    """Return amplitudes (n_columns, m) that their signs allow: a wrong sign counts as zero."""
    used = A.copy()
    for i, g in enumerate(columns.groups):
        if not g.one_sided:
            continue
        part = A[g.columns]
        R = columns.R[i]
        if part.shape[0] == 1:
            used[g.columns] = np.maximum(part, 0.0)
            continue
        raw = np.linalg.solve(R, part)
        d = R / np.linalg.norm(R, axis=0)
        along = np.maximum(d.T @ part, 0.0)
        pick = np.argmax(along, axis=0)
        single = d[:, pick] * along[pick, np.arange(part.shape[1])]
        used[g.columns] = np.where(np.all(raw >= 0, axis=0), part, single)
    return used


@dataclass(frozen=True)
class Scores:
    """Scores of every group for every residual.

    Attributes
    ----------
    score : ndarray, shape (n_groups, m)
        LM, in units of the whitened noise variance.
    inflation : ndarray, shape (n_groups, m)
        λ, the variance of the noise where each group acts.
    neg_log_p : ndarray, shape (n_groups, m)
        −ln of the F tail probability of LM/λ.
    amplitude : ndarray, shape (n_columns, m)
        In the orthonormal columns.
    """

    score: Array
    inflation: Array
    neg_log_p: Array
    amplitude: Array


class Windows:
    """Short windows of one block, in which the noise is measured channel by channel.

    Parameters
    ----------
    layout : Layout
    block : int

    Attributes
    ----------
    count : ndarray, shape (n_windows, 1, 1)
        Samples in each.
    """

    def __init__(self, layout: Layout, block: int) -> None:
        n = layout.lengths[block]
        edges = np.linspace(0, n, max(1, min(WINDOWS_PER_BLOCK, n // MIN_WINDOW)) + 1).astype(int)
        self._layout, self._block, self._first = layout, block, edges[:-1]
        self.count = np.diff(edges).astype(float)[:, None, None]

    def of(self, stacked: Array) -> Array:
        """Return the block of a stacked vector or matrix, shape (n_t, n_channels, …)."""
        return self._layout.view(stacked, self._block)

    def sums(self, values: Array) -> Array:
        """Return the sums over each window of values (n_t, n_channels, m), shape (n_windows, n_channels, m)."""
        out: Array = np.add.reduceat(values, self._first, axis=0)
        return out


@dataclass(frozen=True, kw_only=True)
class Scorer:
    """Scores residuals; made once for a set of columns.

    Attributes
    ----------
    columns : CandidateColumns
    variance : ScoreVariance
    kdim, dof : ndarray, shape (n_groups,)
        Columns of each group, and degrees of freedom with which the noise is known where it acts.
    own_trace : ndarray, shape (n_groups,)
        Share of the noise's variance that the group's own fit takes.
    windows, energies : list
        Of each block: short windows, and the energy of each group in them.
    """

    columns: CandidateColumns
    variance: ScoreVariance
    kdim: Array
    dof: Array
    own_trace: Array
    windows: list[Windows]
    energies: list[Array]

    def __call__(self, E: Array, noise: Array | None = None, removed: Array | None = None) -> Scores:
        """Score residuals.

        Parameters
        ----------
        E : ndarray, shape (n_rows, m)
            Projected residuals.
        noise : ndarray, shape (n_rows, m), optional
            Residuals from which the noise is measured, if other than E (known effects removed).
        removed : ndarray, shape (n_groups,), optional
            Share of each group's columns that was removed to make ``noise``; its own fit is then not removed
            twice.
        """
        Z = self.columns.Z
        A = Z.T @ E
        used = allowed(self.columns, A)
        score = self._sum(used**2)
        N = E if noise is None else noise
        cross = self.variance.bands.cross(N)
        m = N.shape[1]
        V = (self.variance.weights @ cross.reshape(-1, m)).real + self.variance.prior_share[:, None]
        a = used if noise is None else Z.T @ N
        r = self.variance.functional.T @ N
        quad = V - 2.0 * self._sum(a * r) + self._own(a)
        left = 1.0 - self.own_trace
        if removed is not None:
            left = 1.0 - self.own_trace * (1.0 - removed)
        inflation = np.maximum(quad / np.maximum(left, 0.1)[:, None], INFLATION_FLOOR)
        return Scores(score, inflation, self.neg_log_p(score / inflation), used)

    def local_inflation(self, e: Array) -> Array:
        """Return how much noisier the residual is at the *times* at which each group acts; never below one.

        The candidate's own fit is removed first; ``e`` has shape (n_rows,).
        """
        a = allowed(self.columns, (self.columns.Z.T @ e)[:, None])[:, 0]
        num = np.zeros(len(self.columns.groups))
        den = np.zeros_like(num)
        level_d = 0.0
        starts = [g.columns.start for g in self.columns.groups]
        for part, energy in zip(self.windows, self.energies, strict=True):
            fit = np.add.reduceat(part.of(self.columns.Z) * a, starts, axis=2)
            fit -= part.of(e)[:, :, None]
            left = np.maximum(part.count - energy, 0.5 * part.count)
            num += np.sum(energy * part.sums(np.square(fit, out=fit)) / left, axis=(0, 1))
            den += np.sum(energy, axis=(0, 1))
            level_d += float(np.sum(part.count)) * energy.shape[1]
        e2 = float(e @ e)
        own = np.add.reduceat(a**2, starts)
        level = (e2 - own) / max(1.0, level_d - 1.0)
        return np.maximum(1.0, num / np.maximum(den, 1e-300) / np.maximum(level, 1e-300))

    def neg_log_p(self, ratio: Array) -> Array:
        """Return −ln of the F tail probability of LM/λ: one scale for groups of any size and noise."""
        from scipy.special import betaln, fdtrc

        k, nu = self.kdim[:, None], self.dof[:, None]
        with np.errstate(divide="ignore"):
            tail = np.maximum(fdtrc(k, nu, ratio / k), 0.0)
            out = -np.log(tail)
        tiny = ~np.isfinite(out)
        if np.any(tiny):
            # Leading term of the incomplete beta function where the tail underflows.
            x = np.broadcast_to(nu, ratio.shape) / (nu + ratio)
            series = -(nu / 2) * np.log(x) + np.log(nu / 2) + betaln(nu / 2, k / 2)
            out = np.where(tiny, series, out)
        return out

    def _sum(self, x: Array) -> Array:
        return np.add.reduceat(x, [g.columns.start for g in self.columns.groups], axis=0)

    def _own(self, a: Array) -> Array:
        out = np.empty((len(self.columns.groups), a.shape[1]))
        single = [i for i, g in enumerate(self.columns.groups) if g.columns.stop - g.columns.start == 1]
        if single:
            c = np.array([self.variance.own[i][0, 0] for i in single])
            out[single] = c[:, None] * a[[self.columns.groups[i].columns.start for i in single]] ** 2
        for i, g in enumerate(self.columns.groups):
            if g.columns.stop - g.columns.start > 1:
                part = a[g.columns]
                out[i] = np.einsum("cm,cd,dm->m", part, self.variance.own[i], part)
        return out

    def strength(self, group: int, a: Array) -> tuple[Array, Array]:
        """Return the strength in the candidate's unit, from amplitudes, and its covariance for λ = 1."""
        Rinv = np.linalg.inv(self.columns.R[group])
        return Rinv @ a, Rinv @ Rinv.T


def make_scorer(
    columns: CandidateColumns, projection: Projection, dt: float, extra: list[Array] | None = None
) -> Scorer:
    """Prepare the scorer; ``extra`` are orthonormal directions also removed from the residual's noise."""
    basis = [projection.basis]
    lay = projection.layout
    for b, q in enumerate(projection.local):
        if q is not None:
            full = np.zeros((lay.n_rows, q.shape[1]))
            full[lay.rows(b)] = q
            basis.append(full)
    bands = make_bands(lay, dt, basis + list(extra or []))
    var = score_variance(columns.Z, [g.columns for g in columns.groups], bands)
    kdim = np.array([float(g.columns.stop - g.columns.start) for g in columns.groups])
    own = np.array([float(np.trace(c)) for c in var.own])
    # The group's own fit takes its share of the degrees of freedom too.
    windows = [Windows(lay, b) for b in range(len(lay.lengths))]
    starts = [g.columns.start for g in columns.groups]
    energies = parallel_map(lambda w: w.sums(np.add.reduceat(w.of(columns.Z) ** 2, starts, axis=2)), windows)
    # Degrees of freedom with which the noise is known at the times at which each group acts.
    first = sum(np.sum(energy, axis=(0, 1)) for energy in energies)
    second = sum(np.sum(energy**2 / w.count, axis=(0, 1)) for w, energy in zip(windows, energies, strict=True))
    dof = np.minimum(var.dof, first**2 / np.maximum(second, 1e-300))
    return Scorer(
        columns=columns,
        variance=var,
        kdim=kdim,
        dof=np.maximum(dof - kdim, 1.0),
        own_trace=own,
        windows=windows,
        energies=energies,
    )
