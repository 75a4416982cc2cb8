"""Scores of many candidate columns against one or many residuals, in plain linear algebra.

The same code scores the measured residual and every shuffled one, so that whatever is done to the data is
done to the null as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from discrepancy.blocks import Array
from discrepancy.projection import Layout, Projection
from discrepancy.spectral import ScoreVariance, make_bands, score_variance

LAMBDA_FLOOR = 0.5
WINDOWS_PER_BLOCK = 48
MIN_WINDOW = 16
# Norm of a column relative to the largest value on the candidate's own shape grid.
NOT_EXCITED = 1e-9
ABSORBED = 1.0 - 1e-6
TOGETHER = 128  # columns that are projected in one product


@dataclass(frozen=True)
class Group:
    """Columns of one candidate at one point of its shape grid."""

    candidate: int
    shape: int
    cols: slice
    one_sided: bool


@dataclass(frozen=True)
class Columns:
    """Projected and orthonormalised candidate columns.

    Attributes
    ----------
    Z : ndarray, shape (n_rows, n_columns)
    groups : list of Group
    R : list of ndarray, shape (k, k)
        Triangular factors: raw projected columns are ``Z[:, cols] @ R``.
    absorbed : list of ndarray, shape (n_theta, k)
        Parameter change that imitates a unit amplitude.
    kappa : dict
        (candidate, shape) → share of the candidate's effect that calibration can absorb.
    dropped : dict
        (candidate, shape) → why it cannot be scored.
    """

    Z: Array
    groups: list[Group]
    R: list[Array]
    absorbed: list[Array]
    kappa: dict[tuple[int, int], float]
    dropped: dict[tuple[int, int], str]


def prepare_columns(
    whitened: list[tuple[int, int, bool, Array]],
    projection: Projection,
    uncertain: str = "the uncertain parameters",
) -> Columns:
    """Project and orthonormalise; ``whitened`` holds (candidate, shape, one_sided, columns (n_rows, k))."""
    parts, groups, Rs, absorbed = [], [], [], []
    kappa: dict[tuple[int, int], float] = {}
    dropped: dict[tuple[int, int], str] = {}
    start = 0
    strongest: dict[int, float] = {}
    for cand, _, _, Z in whitened:
        strongest[cand] = max(strongest.get(cand, 0.0), float(np.max(np.abs(Z), initial=0.0)))
    for (cand, shape, one_sided, Z), (theta, Zp) in zip(whitened, _projected(whitened, projection), strict=True):
        key = (cand, shape)
        norm = np.linalg.norm(Z, axis=0)
        if not np.all(norm > NOT_EXCITED * strongest[cand]) or strongest[cand] == 0.0:
            dropped[key] = "not excited: these records never make it act"
            kappa[key] = float("nan")
            continue
        kept = float(np.sum(Zp**2) / np.sum(Z**2))
        kappa[key] = 1.0 - kept
        q, r = np.linalg.qr(Zp / norm)
        least = np.linalg.svd(r, compute_uv=False)[-1]
        if kappa[key] > ABSORBED or least**2 < 1.0 - ABSORBED:
            dropped[key] = f"not identifiable: {uncertain} can imitate it entirely"
            continue
        flip = np.sign(np.diag(r))
        k = Z.shape[1]
        parts.append(q * flip)
        Rs.append((r * flip[:, None]) * norm)
        absorbed.append(theta)
        groups.append(Group(cand, shape, slice(start, start + k), one_sided))
        start += k
    rows = projection.layout.n_rows
    Zall = np.concatenate(parts, axis=1) if parts else np.zeros((rows, 0))
    return Columns(Zall, groups, Rs, absorbed, kappa, dropped)


def _projected(
    whitened: list[tuple[int, int, bool, Array]], projection: Projection
) -> Iterator[tuple[Array, Array]]:
    """Yield what calibration makes of each candidate's columns, and what is left of them; many columns at a time."""
    waiting = list(whitened)
    while waiting:
        taken, width = 0, 0
        while taken < len(waiting) and (taken == 0 or width + waiting[taken][3].shape[1] <= TOGETHER):
            width += waiting[taken][3].shape[1]
            taken += 1
        parts = [Z for *_, Z in waiting[:taken]]
        del waiting[:taken]
        together = np.concatenate(parts, axis=1)
        theta = projection.parameters(together)
        projection.remove(together)
        # A second pass removes what rounding left of nearly collinear columns.
        projection.remove(together)
        first = 0
        for Z in parts:
            own = slice(first, first + Z.shape[1])
            yield theta[:, own], np.ascontiguousarray(together[:, own])
            first = own.stop


@dataclass(frozen=True)
class Scores:
    """Scores of every group for every residual, shape (n_groups, m).

    Amplitudes have shape (n_columns, m) and refer to the orthonormal columns.
    """

    lm: Array
    lam: Array
    u: Array
    amplitude: Array


@dataclass(frozen=True)
class Scorer:
    """Scores residuals; made once for a set of columns."""

    columns: Columns
    variance: ScoreVariance
    kdim: Array
    dof: Array
    own_trace: Array
    windows: list[tuple[Array, float]]

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
        used = self._one_sided(A)
        lm = self._sum(used**2)
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
        lam = np.maximum(quad / np.maximum(left, 0.1)[:, None], LAMBDA_FLOOR)
        return Scores(lm, lam, self.surprise(lm / lam), used)

    def local(self, e: Array) -> Array:
        """How much noisier the residual is at the *times* at which each group acts; never below one.

        The candidate's own fit is removed first; ``e`` has shape (n_rows,).
        """
        a = self._one_sided((self.columns.Z.T @ e)[:, None])[:, 0]
        num = np.zeros(len(self.columns.groups))
        den = np.zeros_like(num)
        level_d = 0.0
        starts = [g.cols.start for g in self.columns.groups]
        for rows, count in self.windows:
            Zw = self.columns.Z[rows]
            energy = np.add.reduceat(np.sum(Zw**2, axis=0), starts)
            fit = np.add.reduceat(Zw * a, starts, axis=1)
            left = np.maximum(count - energy, 0.5 * count)
            num += energy * np.sum((e[rows, None] - fit) ** 2, axis=0) / left
            den += energy
            level_d += count
        e2 = float(e @ e)
        own = np.add.reduceat(a**2, starts)
        level = (e2 - own) / max(1.0, level_d - 1.0)
        return np.maximum(1.0, num / np.maximum(den, 1e-300) / np.maximum(level, 1e-300))

    def surprise(self, ratio: Array) -> Array:
        """−ln of the F tail probability of LM/λ: one scale for groups of any size and noise."""
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
        return np.add.reduceat(x, [g.cols.start for g in self.columns.groups], axis=0)

    def _own(self, a: Array) -> Array:
        out = np.empty((len(self.columns.groups), a.shape[1]))
        single = [i for i, g in enumerate(self.columns.groups) if g.cols.stop - g.cols.start == 1]
        if single:
            c = np.array([self.variance.own[i][0, 0] for i in single])
            out[single] = c[:, None] * a[[self.columns.groups[i].cols.start for i in single]] ** 2
        for i, g in enumerate(self.columns.groups):
            if g.cols.stop - g.cols.start > 1:
                part = a[g.cols]
                out[i] = np.einsum("cm,cd,dm->m", part, self.variance.own[i], part)
        return out

    def _one_sided(self, A: Array) -> Array:
        """Amplitudes allowed by sign: a wrong sign counts as zero."""
        used = A.copy()
        for i, g in enumerate(self.columns.groups):
            if not g.one_sided:
                continue
            part = A[g.cols]
            R = self.columns.R[i]
            if part.shape[0] == 1:
                used[g.cols] = np.maximum(part, 0.0)
                continue
            raw = np.linalg.solve(R, part)
            d = R / np.linalg.norm(R, axis=0)
            along = np.maximum(d.T @ part, 0.0)
            pick = np.argmax(along, axis=0)
            single = d[:, pick] * along[pick, np.arange(part.shape[1])]
            used[g.cols] = np.where(np.all(raw >= 0, axis=0), part, single)
        return used

    def raw_amplitude(self, group: int, a: Array) -> tuple[Array, Array]:
        """Amplitude in the candidate's unit and its covariance for λ = 1."""
        Rinv = np.linalg.inv(self.columns.R[group])
        return Rinv @ a, Rinv @ Rinv.T


def make_scorer(
    columns: Columns, projection: Projection, dt: float, extra: list[Array] | None = None
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
    var = score_variance(columns.Z, [g.cols for g in columns.groups], bands)
    kdim = np.array([float(g.cols.stop - g.cols.start) for g in columns.groups])
    own = np.array([float(np.trace(c)) for c in var.own])
    # The group's own fit takes its share of the degrees of freedom too.
    windows = _windows(lay)
    dof = np.minimum(var.dof, _dof_in_time(columns, windows))
    return Scorer(columns, var, kdim, np.maximum(dof - kdim, 1.0), own, windows)


def _windows(layout: Layout) -> list[tuple[Array, float]]:
    """Rows of short windows of one channel of one block, with their number."""
    out = []
    for b, n in enumerate(layout.lengths):
        parts = max(1, min(WINDOWS_PER_BLOCK, n // MIN_WINDOW))
        edges = np.linspace(0, n, parts + 1).astype(int)
        for a, z in pairwise(edges):
            for c in range(layout.n_channels):
                rows = layout.starts[b] + np.arange(a, z) * layout.n_channels + c
                out.append((rows, float(z - a)))
    return out


def _dof_in_time(columns: Columns, windows: list[tuple[Array, float]]) -> Array:
    """Degrees of freedom with which the noise is known at the times at which each group acts."""
    starts = [g.cols.start for g in columns.groups]
    first = np.zeros(len(starts))
    second = np.zeros(len(starts))
    for rows, count in windows:
        energy = np.add.reduceat(np.sum(columns.Z[rows] ** 2, axis=0), starts)
        first += energy
        second += energy**2 / count
    out: Array = first**2 / np.maximum(second, 1e-300)
    return out
