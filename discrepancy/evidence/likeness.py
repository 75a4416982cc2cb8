"""Which candidates change the records as a parameter of the model, or as an effect that it has, changes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.innovations.noise_fit import prior_precision
from discrepancy.statistics.blocks import Candidate, Sensitivities
from discrepancy.statistics.ties import TIE_CORRELATION, canonical_correlation

__all__ = ["ParameterLikeness", "parameter_likeness"]

#: Standard deviations of its prior that a parameter may have to move to stand for a candidate.  What is further off is
#: something else than the value that was stated with that uncertainty.
PRIOR_DEVIATIONS = 3.0


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

    def beside(self, parameters: Sequence[str]) -> Callable[[Sequence[np.ndarray]], float]:
        """Return a function that tells how alike a candidate and an effect of the model are beside what else is fitted.

        Parameters
        ----------
        parameters : sequence of str
            Strengths of the effect.

        Returns
        -------
        callable
            Of the candidate's columns, (n, n_c, m) for each record as innovations.  It returns the smallest canonical
            correlation, of one strength each the partial correlation; zero where the numbers of strengths differ.
        """
        own = [self.names.index(n) for n in parameters if n in self.names]
        others = [k for k in range(len(self.names)) if k not in own]
        precision = np.sqrt(prior_precision(self.prior_std[others]))

        def with_priors(columns: np.ndarray) -> np.ndarray:
            return np.concatenate([columns, np.zeros((len(others), columns.shape[1]))])

        fitted = np.linalg.qr(_scaled(np.concatenate([self.columns[:, others], np.diag(precision)])))[0]

        def direction(columns: np.ndarray) -> np.ndarray:
            whole = _scaled(with_priors(columns))
            return np.linalg.qr(whole - fitted @ (fitted.T @ whole))[0]

        effect = direction(self.columns[:, own])

        def correlation(columns: Sequence[np.ndarray]) -> float:
            z = self._free(columns)
            return canonical_correlation(effect, direction(z)) if own and z.shape[1] == len(own) else 0.0

        return correlation

    def alike(
        self, effects: Sequence[Effect], candidates: Sequence[Candidate], least: float
    ) -> Mapping[str, frozenset[str]]:
        """Return for every effect of the model the candidates that change the same, at some point of their shapes."""
        out = {}
        for effect in effects:
            correlation = self.beside([effect.parameter_name(k) for k in effect.strengths])
            out[str(effect)] = frozenset(
                c.name for c in candidates if any(correlation(z) >= least for z in c.sensitivities)
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
        bases.append(np.linalg.qr(_scaled(flat))[0])
    columns = _free_of(sens.blocks, bases)
    return ParameterLikeness(
        names=sens.names, columns=columns, bases=tuple(bases), prior_std=sens.prior_std, prior_offset=sens.prior_offset
    )


def _scaled(columns: np.ndarray) -> np.ndarray:
    """Return columns of unit length; those of zeros as they are."""
    return columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)


def _free_of(blocks: Sequence[np.ndarray], bases: Sequence[np.ndarray | None]) -> np.ndarray:
    rows = []
    for block, q in zip(blocks, bases, strict=True):
        flat = block.reshape(block.shape[0] * block.shape[1], block.shape[2])  # -1 fails without parameters
        rows.append(flat if q is None else flat - q @ (q.T @ flat))
    return np.concatenate(rows)
