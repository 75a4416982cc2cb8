"""How noisy the residual is where a candidate acts: variance of a score from the residual's own spectrum.

A score is a sum s = Σ zᵀe over all samples. If the whitened residual were perfectly white, its variance would
be ‖z‖². It never is, so the noise is measured in frequency bands: the cross-spectrum S of the channels in
each band, averaged over the band and over all blocks, and the variance of a score is Σ over bands of S
weighted by the energy of z in that band. Bands are as narrow as the data allow while each keeps enough
independent values, after subtracting what the projection has taken out of it.

Everything is a quadratic form in e, V[e] = eᵀ(Σ_bands A)e, so that removing a candidate's own fit from the
residual before measuring the noise (the profile) costs one extra inner product, r = mᵀe with m = A z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.columns import Columns
from discrepancy.statistics.projection import Layout
from multibody.base.memory import ArrayStore
from multibody.base.parallel import parallel_map

MIN_ORDINATES = 5.0
RELATIVE_WIDTH = 0.12


def about_bands(ordinates: int) -> float:
    """Return about how many bands `make_bands` makes of some number of ordinates of all records.

    Up to the frequency at which `RELATIVE_WIDTH` holds `MIN_ORDINATES` each band has that many of them, then their
    widths grow in proportion to the frequency.
    """
    narrow = min(ordinates / MIN_ORDINATES, 1.0 / RELATIVE_WIDTH)
    wide = np.log(max(1.0, ordinates * RELATIVE_WIDTH / MIN_ORDINATES)) / np.log1p(RELATIVE_WIDTH)
    return float(narrow + wide)


@dataclass(frozen=True, kw_only=True)
class Bands:
    """Frequency bands shared by all blocks.

    Attributes
    ----------
    edges : ndarray, shape (n_bands + 1,), Hz
    index : tuple of ndarray
        Band of each Fourier ordinate, per block.
    weight : tuple of ndarray
        1 for zero and Nyquist frequency, 2 for the others, per block.
    count : ndarray, shape (n_bands, n_channels)
        Real degrees of freedom in each band, after the projection.
    """

    layout: Layout
    edges: Array
    index: tuple[np.ndarray, ...]
    weight: tuple[Array, ...]
    count: Array

    @property
    def n(self) -> int:
        """Number of bands."""
        return len(self.edges) - 1

    def spectra(self, stacked: Array, block: int) -> Array:
        """Fourier coefficients of one block, (m, n_channels, n_f), so that Σ weight·|·|² is the energy."""
        x = np.ascontiguousarray(self.layout.view(stacked, block).T)
        out: Array = np.fft.rfft(x, axis=2) / np.sqrt(x.shape[2])
        return out

    def ranges(self, block: int) -> list[tuple[int, slice]]:
        """Return the bands that have ordinates in a block, each with the slice of its ordinates."""
        idx = self.index[block]
        starts = np.flatnonzero(np.concatenate([[True], idx[1:] != idx[:-1]]))
        ends = np.append(starts[1:], idx.size)
        return [(int(idx[a]), slice(int(a), int(z))) for a, z in zip(starts, ends, strict=True)]

    def cross(self, stacked: Array) -> Array:
        """Band cross-energies Σ w x_c conj(x_d), shape (n_bands, n_channels, n_channels, m), complex."""
        blocks = range(len(self.layout.lengths))
        energies = parallel_map(lambda b: self._energies(self.spectra(stacked, b), b), blocks)
        return self._summed(energies, stacked.shape[1])

    def cross_of(self, spectra: Sequence[Array]) -> Array:
        """Return what `cross` does, from the spectra of every block."""
        blocks = range(len(self.layout.lengths))
        return self._summed(parallel_map(lambda b: self._energies(spectra[b], b), blocks), len(spectra[0]))

    def _energies(self, spectra: Array, block: int) -> list[tuple[int, Array]]:
        X = spectra * np.sqrt(self.weight[block])
        return [(k, X[:, :, part] @ X[:, :, part].conj().swapaxes(1, 2)) for k, part in self.ranges(block)]

    def _summed(self, energies: Sequence[list[tuple[int, Array]]], m: int) -> Array:
        C = self.layout.n_channels
        out = np.zeros((self.n, m, C, C), dtype=complex)
        for of_block in energies:
            for k, energy in of_block:
                out[k] += energy
        return np.moveaxis(out, 1, 3)

    def normalised(self, cross: Array) -> Array:
        """Spectral matrices: cross-energies divided by the degrees of freedom (1 for white noise)."""
        root = np.sqrt(self.count)
        out: Array = cross / (root[:, :, None, None] * root[:, None, :, None])
        return out


def make_bands(layout: Layout, dt: float, leverage_basis: list[Array], min_ordinates: float = MIN_ORDINATES) -> Bands:
    """Choose bands so that each keeps enough degrees of freedom after the projection.

    Parameters
    ----------
    layout : Layout
    dt : float
        Sampling interval, s.
    leverage_basis : list of ndarray, shape (n_rows, r)
        Orthonormal directions that the residual has lost.
    min_ordinates : float
        Least number of independent complex ordinates per band and channel.
    """
    C = layout.n_channels
    freqs = [np.fft.rfftfreq(n, dt) for n in layout.lengths]
    weights = []
    for n in layout.lengths:
        w = np.full(n // 2 + 1, 2.0)
        w[0] = 1.0
        if n % 2 == 0:
            w[-1] = 1.0
        weights.append(w)
    free = [np.repeat(w[:, None], C, axis=1) for w in weights]
    for Q in leverage_basis:
        for b in range(len(layout.lengths)):
            x = layout.view(Q, b)
            free[b] = free[b] - weights[b][:, None] * np.sum(np.abs(np.fft.rfft(x, axis=0)) ** 2, axis=2) / x.shape[0]
    all_f = np.concatenate(freqs)
    order = np.argsort(all_f, kind="stable")
    f_sorted = all_f[order]
    free_sorted = np.concatenate(free)[order]
    edges = [0.0]
    acc = np.zeros(C)
    need = 2.0 * min_ordinates
    left = free_sorted.sum(axis=0)
    for i in range(len(f_sorted)):
        acc += free_sorted[i]
        left = left - free_sorted[i]
        last_of_frequency = i + 1 == len(f_sorted) or f_sorted[i + 1] > f_sorted[i]
        wide = f_sorted[i] - edges[-1] >= RELATIVE_WIDTH * edges[-1]
        if last_of_frequency and wide and acc.min() >= need and left.min() >= need and i + 1 < len(f_sorted):
            edges.append(0.5 * (f_sorted[i] + f_sorted[i + 1]))
            acc = np.zeros(C)
    edges.append(float(f_sorted[-1]) * (1 + 1e-9) + 1e-12)
    e = np.array(edges)
    index = tuple(np.clip(np.searchsorted(e, f, side="right") - 1, 0, len(e) - 2) for f in freqs)
    count = np.zeros((len(e) - 1, C))
    for b, idx in enumerate(index):
        np.add.at(count, idx, free[b])
    return Bands(layout=layout, edges=e, index=index, weight=tuple(weights), count=np.maximum(count, 1.0))


@dataclass(frozen=True, kw_only=True)
class ScoreVariance:
    """Everything needed to get λ of every column group for any residual.

    Attributes
    ----------
    weights : ArrayStore
        Energy of each group per band, averaged over its columns: an array (n_groups, n_bands * n_channels²), complex,
        for the groups in each pack of columns.
    functional : Columns
        The vectors m = A z, in the packs of the columns.
    own : list of ndarray, shape (k, k)
        zᵀ A z per group: the part of the band's variance that the group itself takes.
    dof : ndarray, shape (n_groups,)
        Effective degrees of freedom of λ.
    prior_share : ndarray, shape (n_groups,)
        Share of a group's energy that lies in the prior rows, where the variance is known to be one.
    """

    bands: Bands
    weights: ArrayStore
    functional: Columns
    own: list[Array]
    dof: Array
    prior_share: Array


def score_variance(Z: Columns, groups: Sequence[Sequence[slice]], bands: Bands) -> ScoreVariance:
    """Prepare λ for orthonormal column groups.

    Parameters
    ----------
    Z : Columns
        Projected columns; the columns of one group are orthonormal.
    groups : sequence of sequence of slice
        Columns of each group, pack by pack.
    bands : Bands
    """
    lay = bands.layout
    weights = ArrayStore()
    own: list[Array] = []
    dof: list[float] = []
    prior: list[float] = []

    def vectors() -> Iterator[Array]:
        for (span, pack), in_pack in zip(Z.packs(), groups, strict=True):
            local = [slice(cols.start - span.start, cols.stop - span.start) for cols in in_pack]
            M, A, dof_of_pack = _of_pack(pack, local, bands)
            weights.put(np.transpose(A, (0, 1, 3, 2)).reshape(len(local), -1))
            dof.extend(dof_of_pack)
            alone = np.einsum("ij,ij->j", pack, M)
            own.extend(
                pack[:, cols].T @ M[:, cols] if cols.stop - cols.start > 1 else alone[cols, None] for cols in local
            )
            tail = pack[lay.n_data :]
            prior.extend(float(np.sum(tail[:, cols] ** 2)) / (cols.stop - cols.start) for cols in local)
            yield M

    functional = Columns.of(vectors(), Z.rows)
    return ScoreVariance(
        bands=bands, weights=weights, functional=functional, own=own, dof=np.array(dof), prior_share=np.array(prior)
    )


def _of_pack(Z: Array, groups: Sequence[slice], bands: Bands) -> tuple[Array, Array, list[float]]:
    """Return m = A z of some columns, A of their groups, and the degrees of freedom of each group's λ."""
    lay = bands.layout
    C, K = lay.n_channels, bands.n
    root = np.sqrt(bands.count)
    norm = root[:, :, None] * root[:, None, :]
    per_band = bands.count.mean(axis=1)
    blocks = range(len(lay.lengths))
    spectra = parallel_map(lambda b: bands.spectra(Z, b), blocks)
    cross = bands.cross_of(spectra)
    # A[d, c] acts on e_c; averaging over the columns of a group gives λ = tr(V)/k.
    A = np.empty((len(groups), K, C, C), dtype=complex)
    dof = []
    for g, cols in enumerate(groups):
        A[g] = cross[:, :, :, cols].mean(axis=3) / norm
        share = np.einsum("kcc->k", A[g] * norm).real
        dof.append(float(share.sum() ** 2 / max(float(np.sum(share**2 / per_band)), 1e-300)))
    M = np.zeros_like(Z)
    col_group = np.empty(Z.shape[1], dtype=int)
    for g, cols in enumerate(groups):
        col_group[cols] = g
    per_column = A[col_group]

    def of_block(b: int) -> None:
        X, n = spectra[b], lay.lengths[b]
        for k, part in bands.ranges(b):
            X[:, :, part] = per_column[:, k] @ X[:, :, part]
        back = np.fft.irfft(X, n=n, axis=2)
        back *= np.sqrt(n)
        M[lay.rows(b)] = back.T.reshape(-1, Z.shape[1])

    parallel_map(of_block, blocks)
    return M, A, dof
