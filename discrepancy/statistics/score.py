"""Scores of many candidate columns against one or many residuals, in plain linear algebra.

The same code scores the measured residual and every shuffled one, so that whatever is done to the data is
done to the null as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.columns import Columns, columns_together
from discrepancy.statistics.projection import Layout, Projection
from discrepancy.statistics.score_variance import ScoreVariance, make_bands, score_variance
from multibody.base.parallel import available_cores, parallel_map

INFLATION_FLOOR = 0.5
WINDOWS_PER_BLOCK = 48
MIN_WINDOW = 16
# Norm of a column relative to the largest value on the candidate's own shape grid.
NOT_EXCITED = 1e-9
ABSORBED = 1.0 - 1e-6
# Least eigenvalue of the columns of one candidate, of unit length before the projection, as they are after it.  A
# parameter that is known a thousand times better from the records than stated leaves 1e-6 of what it does: friction in
# both directions together, of one that differs with direction.  Rounding leaves less than 1e-20.
DEPENDENT = 1e-12
CANCELLED = 1e-2  # share of a column's energy left by a projection below which it is projected again; chosen
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
    Z : Columns
        Of n_rows rows.
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

    Z: Columns
    groups: list[Group]
    R: list[Array]
    imitation: list[Array]
    confounding: dict[tuple[int, int], float]
    dropped: dict[tuple[int, int], str]

    def groups_in_packs(self) -> list[slice]:
        """Return which groups are in each pack of the columns, none of which divides a group."""
        starts = np.array([g.columns.start for g in self.groups], dtype=int)
        spans = [span for span in self.Z.spans if span.stop > span.start]
        return [slice(*(int(k) for k in np.searchsorted(starts, (span.start, span.stop)))) for span in spans]


def prepare_columns(
    whitened: Iterable[tuple[int, int, bool, Array]],
    projection: Projection,
    uncertain: str = "the uncertain parameters",
) -> CandidateColumns:
    """Project and orthonormalise; ``whitened`` holds (candidate, shape, one_sided, columns (n_rows, k))."""
    groups, Rs, imitation = [], [], []
    confounding: dict[tuple[int, int], float] = {}
    dropped: dict[tuple[int, int], str] = {}
    projected: list[_Projected] = []
    every = Columns.of(_orthonormal(whitened, projection, projected.append), projection.layout.n_rows)
    strongest: dict[int, float] = {}
    for one in projected:
        strongest[one.candidate] = max(strongest.get(one.candidate, 0.0), one.peak)
    kept = np.ones(every.count, dtype=bool)
    start, at = 0, 0
    for one in projected:
        cand, shape, k = one.candidate, one.shape, one.norm.size
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
        groups.append(Group(cand, shape, slice(start, start + k), one.one_sided))
        start += k
    return CandidateColumns(
        Z=every if kept.all() else every.only(kept),
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
    candidate, shape : int
    one_sided : bool
    norm : ndarray, shape (k,)
        Before the projection.
    peak : float
        Largest absolute value before the projection.
    confounding : float
    R : ndarray, shape (k, k), or None
        None where what is left of the columns is linearly dependent.
    theta : ndarray, shape (n_theta, k)
    """

    candidate: int
    shape: int
    one_sided: bool
    norm: Array
    peak: float
    confounding: float
    R: Array | None
    theta: Array


def _orthonormal(
    whitened: Iterable[tuple[int, int, bool, Array]], projection: Projection, visit: Callable[[_Projected], None]
) -> Iterator[Array]:
    """Yield orthonormal columns of each group, in packs; ``visit`` gets each group.

    By Cholesky and many groups at a time, which is fastest.
    """

    def straightened(pack: list[tuple[int, int, bool, Array]]) -> tuple[Array, list[_Projected]]:
        together = np.concatenate([Z for *_, Z in pack], axis=1)
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
        for candidate, shape, one_sided, Z in pack:
            own = slice(first, first + Z.shape[1])
            part = together[:, own]
            gram = part.T @ part / np.outer(scale[own], scale[own])
            R = None
            if np.linalg.eigvalsh(gram)[0] >= DEPENDENT:
                r = np.linalg.cholesky(gram).T
                straight[own, own] = np.linalg.inv(r) / scale[own, None]
                R = r * norm[own]
            total = float(np.sum(norm[own] ** 2))
            share = float(np.diag(gram) @ norm[own] ** 2) / total if total > 0.0 else 0.0
            projected.append(
                _Projected(
                    candidate=candidate,
                    shape=shape,
                    one_sided=one_sided,
                    norm=norm[own],
                    peak=float(peak[own].max(initial=0.0)),
                    confounding=1.0 - share,
                    R=R,
                    theta=theta[:, own],
                )
            )
            first = own.stop
        return together @ straight, projected

    packs = _packs(whitened, columns_together(projection.layout.n_rows))
    while some := list(islice(packs, available_cores())):
        for pack, groups in parallel_map(straightened, some):
            for group in groups:
                visit(group)
            yield pack


def _packs(
    whitened: Iterable[tuple[int, int, bool, Array]], together: int
) -> Iterator[list[tuple[int, int, bool, Array]]]:
    """Yield groups of columns that are worked on in one product, none of them divided."""
    pack: list[tuple[int, int, bool, Array]] = []
    width = 0
    for group in whitened:
        k = group[3].shape[1]
        if pack and width + k > together:
            yield pack
            pack, width = [], 0
        pack.append(group)
        width += k
    if pack:
        yield pack


def most_explaining(columns: CandidateColumns, e: Array) -> CandidateColumns:
    """Return the groups that explain most of a projected residual, some `SHORTLIST` columns of them.

    Parameters
    ----------
    columns : CandidateColumns
    e : ndarray, shape (n_rows,)
    """
    if columns.Z.count <= SHORTLIST:
        return columns
    size = np.array([g.columns.stop - g.columns.start for g in columns.groups])
    used = allowed(columns, columns.Z.transposed_times(e)[:, None])[:, 0]
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
        Z=columns.Z.selected([columns.groups[i].columns for i in keep]),
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
        return self.each([E], noise, removed)[0]

    def each(
        self, residuals: Sequence[Array], noise: Array | None = None, removed: Array | None = None
    ) -> list[Scores]:
        """Return what a call returns, of several sets of residuals; the columns are read once for all of them."""
        noises = [E if noise is None else noise for E in residuals]
        Z, functional, weights = self.columns.Z, self.variance.functional, self.variance.weights
        cross = parallel_map(self.variance.bands.cross, noises)
        A, along, R = ([np.empty((Z.count, E.shape[1])) for E in residuals] for _ in range(3))
        V = [np.empty((len(self.columns.groups), E.shape[1])) for E in residuals]
        in_packs = self.columns.groups_in_packs()
        for k, ((span, columns), (_, vectors), own) in enumerate(
            zip(Z.packs(), functional.packs(), in_packs, strict=True)
        ):
            weight = weights.get(k)

            def of(i: int) -> None:
                E, N, m = residuals[i], noises[i], residuals[i].shape[1]
                A[i][span] = columns.T @ E  # noqa: B023 - called before the loop goes on
                R[i][span] = vectors.T @ N  # noqa: B023
                if noise is not None:
                    along[i][span] = columns.T @ N  # noqa: B023
                V[i][own] = (weight @ cross[i].reshape(-1, m)).real  # noqa: B023

            parallel_map(of, range(len(residuals)))
        return [self._scores(*one, noise is not None, removed) for one in zip(A, along, R, V, strict=True)]

    def _scores(self, A: Array, along: Array, r: Array, V: Array, given: bool, removed: Array | None) -> Scores:
        """Return scores from the products of residuals with all columns; ``given``: noise is measured elsewhere."""
        used = allowed(self.columns, A)
        score = self._sum(used**2)
        a = along if given else used
        quad = V + self.variance.prior_share[:, None] - 2.0 * self._sum(a * r) + self._own(a)
        left = 1.0 - self.own_trace
        if removed is not None:
            left = 1.0 - self.own_trace * (1.0 - removed)
        inflation = np.maximum(quad / np.maximum(left, 0.1)[:, None], INFLATION_FLOOR)
        return Scores(score, inflation, self.neg_log_p(score / inflation), used)

    def local_inflation(self, e: Array) -> Array:
        """Return how much noisier the residual is at the *times* at which each group acts; never below one.

        The candidate's own fit is removed first; ``e`` has shape (n_rows,).
        """
        a = allowed(self.columns, self.columns.Z.transposed_times(e)[:, None])[:, 0]
        num = np.zeros(len(self.columns.groups))
        starts = [g.columns.start for g in self.columns.groups]
        for (span, columns), own in zip(self.columns.Z.packs(), self.columns.groups_in_packs(), strict=True):
            first = np.array(starts[own]) - span.start
            for part, every in zip(self.windows, self.energies, strict=True):
                energy = every[:, :, own]
                fit = np.add.reduceat(part.of(columns) * a[span], first, axis=2)
                fit -= part.of(e)[:, :, None]
                left = np.maximum(part.count - energy, 0.5 * part.count)
                num[own] += np.sum(energy * part.sums(np.square(fit, out=fit)) / left, axis=(0, 1))
        den = sum((np.sum(energy, axis=(0, 1)) for energy in self.energies), np.zeros_like(num))
        level_d = sum(
            float(np.sum(w.count)) * energy.shape[1] for w, energy in zip(self.windows, self.energies, strict=True)
        )
        e2 = float(e @ e)
        fitted = np.add.reduceat(a**2, starts)
        level = (e2 - fitted) / max(1.0, level_d - 1.0)
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
    in_packs = columns.groups_in_packs()
    var = score_variance(columns.Z, [[g.columns for g in columns.groups[own]] for own in in_packs], bands)
    kdim = np.array([float(g.columns.stop - g.columns.start) for g in columns.groups])
    own = np.array([float(np.trace(c)) for c in var.own])
    # The group's own fit takes its share of the degrees of freedom too.
    windows = [Windows(lay, b) for b in range(len(lay.lengths))]
    starts = [g.columns.start for g in columns.groups]
    energies = [np.empty((len(w.count), lay.n_channels, len(starts))) for w in windows]
    for (span, pack), groups in zip(columns.Z.packs(), in_packs, strict=True):
        first = np.array(starts[groups]) - span.start

        def of_block(b: int) -> None:
            energies[b][:, :, groups] = windows[b].sums(  # noqa: B023 - called before the loop goes on
                np.add.reduceat(windows[b].of(pack) ** 2, first, axis=2)  # noqa: B023
            )

        parallel_map(of_block, range(len(windows)))
    # Degrees of freedom with which the noise is known at the times at which each group acts.
    whole = sum(np.sum(energy, axis=(0, 1)) for energy in energies)
    second = sum(np.sum(energy**2 / w.count, axis=(0, 1)) for w, energy in zip(windows, energies, strict=True))
    dof = np.minimum(var.dof, whole**2 / np.maximum(second, 1e-300))
    return Scorer(
        columns=columns,
        variance=var,
        kdim=kdim,
        dof=np.maximum(dof - kdim, 1.0),
        own_trace=own,
        windows=windows,
        energies=energies,
    )
