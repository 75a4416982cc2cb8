"""Free a residual, and the candidates, of everything that recalibration could explain.

WhitenedProblem arrays are stacked into tall matrices whose rows run over block, time and channel. Priors on the
uncertain parameters are extra rows, so that a projection with priors is the same as augmented least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from discrepancy.statistics.blocks import Array, Sensitivities
from discrepancy.statistics.whitening import Whitener
from multibody.base.parallel import parallel_map

RANK_TOLERANCE = 1e-9
FEW_BLOCKS = 3  # blocks from which on whole ones are left out in turn


@dataclass(frozen=True)
class Layout:
    """Where each block sits in a stacked matrix: ``lengths[b] * n_channels`` rows from ``starts[b]``."""

    lengths: tuple[int, ...]
    n_channels: int
    n_prior: int = 0

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """First row of each block."""
        return tuple(int(v) for v in np.concatenate([[0], np.cumsum(self.lengths)[:-1]]) * self.n_channels)

    @property
    def n_data(self) -> int:
        """Rows that are observations."""
        return sum(self.lengths) * self.n_channels

    @property
    def n_rows(self) -> int:
        """All rows, priors included."""
        return self.n_data + self.n_prior

    def rows(self, block: int) -> slice:
        """Rows of one block."""
        s = self.starts[block]
        return slice(s, s + self.lengths[block] * self.n_channels)

    def view(self, stacked: Array, block: int) -> Array:
        """Block of a stacked matrix as (n_t, n_channels, …)."""
        part = stacked[self.rows(block)]
        return part.reshape(self.lengths[block], self.n_channels, *stacked.shape[1:])

    def left_out(self) -> list[slice]:
        """Return the rows that are left out in turn: those of a block, or of its quarters where there are few blocks.

        Whole records, because what disturbs a machine goes on from one part of a record into the next.
        """
        parts = 1 if len(self.lengths) >= FEW_BLOCKS else 4
        spans = []
        for start, length in zip(self.starts, self.lengths, strict=True):
            edges = start + self.n_channels * np.linspace(0, length, parts + 1).astype(int)
            spans += [slice(int(a), int(b)) for a, b in pairwise(edges)]
        return spans

    def stack(self, whitener: Whitener, blocks: Sequence[Array], prior: Array | None = None) -> Array:
        """Whiten block by block and stack; ``prior`` fills the last rows (zeros by default)."""
        tail = blocks[0].shape[2:]
        out = np.zeros((self.n_rows, *tail))

        def of_block(b: int) -> None:
            out[self.rows(b)] = whitener.apply(blocks[b]).reshape(blocks[b].shape[0] * blocks[b].shape[1], *tail)

        parallel_map(of_block, range(len(blocks)))
        if prior is not None and self.n_prior:
            out[self.n_data :] = prior
        return out


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Orthonormal basis of what calibration can absorb, in the whitened metric.

    Attributes
    ----------
    basis : ndarray, shape (n_rows, r)
        Directions of the uncertain parameters (priors included).
    local : tuple of ndarray or None, shape (n_t * n_channels, q)
        Directions of each block's own nuisance parameters.
    names : tuple of str
        Uncertain parameters.
    not_excited : tuple of str
        Parameters whose sensitivity is zero in these records.
    solve : ndarray, shape (n_theta, r)
        Maps basis coordinates to parameter changes.
    """

    layout: Layout
    basis: Array
    local: tuple[Array | None, ...]
    names: tuple[str, ...]
    not_excited: tuple[str, ...]
    solve: Array
    whitener: Whitener = field(repr=False)

    @property
    def n_directions(self) -> int:
        """Number of directions taken out of the residual."""
        return self.basis.shape[1] + sum(q.shape[1] for q in self.local if q is not None)

    def remove(self, stacked: Array) -> Array:
        """(I − P) applied in place to a stacked vector or matrix, which is returned."""
        self.take_out(stacked)
        return stacked

    def take_out(self, stacked: Array) -> Array:
        """(I − P) applied in place; return the parameter changes that stand for what was removed, (n_theta, …)."""
        self.remove_local(stacked)
        inside = self.basis.T @ stacked
        if self.basis.shape[1]:
            stacked -= self.basis @ inside
        out: Array = self.solve @ inside
        return out

    def remove_local(self, stacked: Array) -> Array:
        """Remove each block's nuisance directions, in place."""
        for b, q in enumerate(self.local):
            if q is not None:
                rows = self.layout.rows(b)
                stacked[rows] -= q @ (q.T @ stacked[rows])
        return stacked

    def parameters(self, stacked: Array) -> Array:
        """Least-squares change of the parameters for a stacked vector or matrix, shape (n_theta, …)."""
        out: Array = self.solve @ (self.basis.T @ stacked)
        return out


def project(whitener: Whitener, sens: Sensitivities, layout: Layout) -> Projection:
    """Basis of the calibration space for whitened arrays.

    Parameters
    ----------
    whitener : Whitener
        Applied to the sensitivities as to everything else.
    sens : Sensitivities
        Sensitivities, priors and nuisance directions.
    layout : Layout
        Must hold one prior row for each parameter that has a prior.
    """
    p = len(sens.names)
    has_prior = np.isfinite(sens.prior_std)
    prior = np.zeros((layout.n_prior, p))
    prior[np.arange(layout.n_prior), np.flatnonzero(has_prior)] = 1.0 / sens.prior_std[has_prior]
    F = layout.stack(whitener, sens.blocks, prior)
    strength = np.linalg.norm(F[: layout.n_data], axis=0)
    dead = tuple(n for n, s in zip(sens.names, strength, strict=True) if s == 0.0)
    local: list[Array | None] = []
    for nuisance in sens.nuisance:
        if nuisance is None or nuisance.shape[2] == 0:
            local.append(None)
            continue
        N = whitener.apply(nuisance).reshape(-1, nuisance.shape[2])
        norms = np.linalg.norm(N, axis=0)
        N = N[:, norms > 0] / norms[norms > 0]
        u, s, _ = np.linalg.svd(N, full_matrices=False)
        local.append(u[:, s > RANK_TOLERANCE * s[0]] if s.size else None)
    shell = Projection(
        layout=layout,
        basis=np.zeros((layout.n_rows, 0)),
        local=tuple(local),
        names=sens.names,
        not_excited=dead,
        solve=np.zeros((p, 0)),
        whitener=whitener,
    )
    if p == 0:
        return shell
    shell.remove_local(F)
    scale = np.linalg.norm(F, axis=0)
    scale[scale == 0] = 1.0
    q, r = np.linalg.qr(F / scale)
    u, s, vt = np.linalg.svd(r)
    keep = s > RANK_TOLERANCE * s[0] if s[0] > 0 else np.zeros(len(s), dtype=bool)
    solve = (vt.T[:, keep] / s[keep]) / scale[:, None]
    return Projection(
        layout=layout,
        basis=q @ u[:, keep],
        local=tuple(local),
        names=sens.names,
        not_excited=dead,
        solve=solve,
        whitener=whitener,
    )
