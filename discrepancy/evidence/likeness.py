"""Which candidates change the records as a parameter of the model, or as an effect that it has, changes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.innovations.noise_fit import prior_precision
from discrepancy.statistics.blocks import Candidate, Sensitivities
from discrepancy.statistics.ties import TIE_CORRELATION

__all__ = ["ParameterLikeness", "parameter_likeness"]

#: Standard deviations of its prior that a parameter may have to move to stand for a candidate.  What is further off is
#: something else than the value that was stated with that uncertainty.
PRIOR_DEVIATIONS = 3.0
RIDGE = 1e-10  # of the scaled normal matrix: keeps its inverse finite where parameters are confounded


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterLikeness:
    """Innovations' derivatives by the parameters and by one candidate after another.

    Parameters
    ----------
    names : tuple of str
        Of the parameters.
    columns : ndarray, shape (n_rows, k)
        Of the parameters, free of each record's own unknowns.
    bases : tuple of ndarray or None
        Orthonormal bases of each record's own unknowns.
    prior_std, prior_offset : ndarray, shape (k,)
        Prior standard deviation, and prior mean minus the value of the linearisation.
    """

    names: tuple[str, ...]
    columns: np.ndarray
    bases: tuple[np.ndarray | None, ...]
    prior_std: np.ndarray
    prior_offset: np.ndarray

    def _free(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Return blocks, (n, n_c, k), one below the other and free of each record's own unknowns."""
        return _free_of(blocks, self.bases)

    def owner(self, change: Sequence[np.ndarray]) -> str:
        """Return the parameter of the model that changes the records as a candidate does; empty if there is none.

        Parameters
        ----------
        change : sequence of ndarray, shape (n, n_c)
            What the candidate changes in the innovations at its expected strength.
        """
        z = self._free([c[:, :, None] for c in change])[:, 0]
        size, sizes = float(np.linalg.norm(z)), np.linalg.norm(self.columns, axis=0)
        if not size > 0.0 or not self.names:
            return ""
        along = self.columns.T @ z
        correlation = np.abs(along) / np.maximum(sizes * size, 1e-300)
        moved = np.abs(along) / np.maximum(sizes**2, 1e-300)
        alike = (correlation > TIE_CORRELATION) & (
            np.abs(self.prior_offset) + moved < PRIOR_DEVIATIONS * self.prior_std
        )
        return self.names[int(np.argmax(np.where(alike, correlation, 0.0)))] if np.any(alike) else ""

    def partial_correlation(self, parameters: Sequence[str], columns: Sequence[np.ndarray]) -> float:
        """Return how alike a candidate and an effect of the model are beside everything else that is fitted.

        Parameters
        ----------
        parameters : sequence of str
            Strengths of the effect.
        columns : sequence of ndarray, shape (n, n_c, m)
            The candidate's, as innovations.

        Returns
        -------
        correlation : float
            The smallest canonical one; of one strength each the partial correlation.
        """
        z = self._free(columns)
        own = [self.names.index(n) for n in parameters if n in self.names]
        others = [k for k in range(len(self.names)) if k not in own]
        if not own or z.shape[1] != len(own):
            return 0.0
        f = self.columns[:, others]
        precision = np.diag(prior_precision(self.prior_std[others]))
        normal = f.T @ f + precision
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        normal = normal / np.outer(size, size) + RIDGE * np.eye(len(others))
        both = np.concatenate([self.columns[:, own], z], axis=1)
        along = f.T @ both / size[:, None]
        left = both.T @ both - along.T @ np.linalg.solve(normal, along)
        m = len(own)
        scale = np.sqrt(np.maximum(np.diag(left), 1e-12 * np.maximum(np.diag(both.T @ both), 1e-300)))
        left = left / np.outer(scale, scale)
        a, b = (np.linalg.cholesky(left[s, s] + 1e-9 * np.eye(m)) for s in (slice(m), slice(m, 2 * m)))
        cross = np.linalg.solve(a, np.linalg.solve(b, left[:m, m:].T).T)
        return float(min(1.0, np.linalg.svd(cross, compute_uv=False)[-1]))

    def alike(
        self, effects: Sequence[Effect], candidates: Sequence[Candidate], least: float
    ) -> Mapping[str, frozenset[str]]:
        """Return for every effect of the model the candidates that change the same, at some point of their shapes."""
        out = {}
        for effect in effects:
            strengths = [effect.parameter_name(k) for k in effect.strengths]
            out[str(effect)] = frozenset(
                c.name
                for c in candidates
                if any(self.partial_correlation(strengths, z) >= least for z in c.sensitivities)
            )
        return out


def parameter_likeness(sens: Sensitivities) -> ParameterLikeness:
    """Return the parameters that candidates can be compared with, from their derivatives as innovations."""
    bases: list[np.ndarray | None] = []
    for own in sens.nuisance:
        if own is None or not own.shape[2]:
            bases.append(None)
            continue
        flat = own.reshape(-1, own.shape[2])
        bases.append(np.linalg.qr(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))[0])
    columns = _free_of(sens.blocks, bases)
    return ParameterLikeness(
        names=sens.names, columns=columns, bases=tuple(bases), prior_std=sens.prior_std, prior_offset=sens.prior_offset
    )


def _free_of(blocks: Sequence[np.ndarray], bases: Sequence[np.ndarray | None]) -> np.ndarray:
    rows = []
    for block, q in zip(blocks, bases, strict=True):
        flat = block.reshape(-1, block.shape[2])
        rows.append(flat if q is None else flat - q @ (q.T @ flat))
    return np.concatenate(rows)
