"""How sure the parameters of a model are: by its likelihood, and by how its scores vary from block to block.

A likelihood is as sure as it claims where the model is right.  Where it is not, parts of the records disagree by more:
the derivative of the likelihood by a parameter varies more from block to block than it says.  The sandwich of the two
gives the standard errors.

Sources: White (1982), Econometrica 50, 1 (misspecified models, the sandwich); Pauli, Racugno and Ventura (2011),
Statistica Sinica 21, 149 (ratios of such likelihoods, scaled by the two variances).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import record_columns
from discrepancy.evidence.predictive import what_is_known, whitened_blocks
from discrepancy.innovations.noise_fit import prior_precision
from discrepancy.stages.stage import Stage
from estimation.fit.intervals import block_sandwich

__all__ = ["ParameterErrors", "errors_of_blocks", "parameter_errors", "with_errors_of_likelihood"]

#: Blocks that all records together are cut into, about: a variance is then known to a seventh.  Innovations remember
#: little, so a block may be short.
BLOCKS = 100


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterErrors:
    """Covariances of the parameters of a model about their likeliest values.

    Parameters
    ----------
    names : tuple of str
    promised, found : ndarray, shape (k, k)
        By the likelihood, if the model is right, and by the sandwich.
    degrees : int
        Degrees of freedom of the latter (Student's t).
    """

    names: tuple[str, ...]
    promised: np.ndarray
    found: np.ndarray
    degrees: int

    @property
    def std(self) -> dict[str, float]:
        """Standard error of each parameter."""
        return dict(zip(self.names, np.sqrt(np.maximum(np.diag(self.found), 0.0)).tolist(), strict=True))

    def share_that_holds(self, values: Mapping[str, float]) -> float:
        """Return the share of a gain in log likelihood by some parameters that holds, at most one.

        It is half the square of their distance from zero in standard errors, so it is the ratio of these squares.

        Parameters
        ----------
        values : mapping of str to float
            The parameters, as far from zero as they were found.
        """
        own = [k for k, name in enumerate(self.names) if name in values]
        v = np.array([values[self.names[k]] for k in own])
        if not np.any(v):
            return 1.0

        def distance(covariance: np.ndarray) -> float:
            size = np.sqrt(np.diag(covariance)[own])
            scaled = covariance[np.ix_(own, own)] / np.outer(size, size)
            return float((v / size) @ np.linalg.pinv(scaled, hermitian=True) @ (v / size))

        promised = distance(self.promised)
        return min(distance(self.found) / promised, 1.0) if promised > 0.0 else 1.0


def parameter_errors(likelihood: StageLikelihood) -> ParameterErrors:
    """Return the covariances of the parameters of a fitted model, the shapes of laws among them.

    Parameters
    ----------
    likelihood : StageLikelihood
    """
    held = likelihood.stage.identify.at_bound
    columns, std, offset = record_columns(likelihood.linearised, likelihood.noise.records, held)
    blocks, _ = whitened_blocks(columns, likelihood.noise.model, max(1, -(-BLOCKS // len(columns))))
    names = tuple(n for n in likelihood.linearised.sensitivities().names if n not in held)
    return errors_of_blocks(names, blocks, std, offset)


def errors_of_blocks(
    names: tuple[str, ...], blocks: Sequence[tuple[np.ndarray, np.ndarray]], std: np.ndarray, offset: np.ndarray
) -> ParameterErrors:
    """Return the same of residual and columns of every block, both as innovations.

    Parameters
    ----------
    names : tuple of str
    blocks : sequence of (ndarray, ndarray), shapes (n,) and (n, k)
    std, offset : ndarray, shape (k,)
        Priors of the parameters: deviation, and how far from the linearisation's value.
    """
    known = what_is_known(blocks, std, offset)
    left = [e - f @ known.change for e, f in blocks]
    sandwich = block_sandwich([f for _, f in blocks], left, np.diag(prior_precision(std)))
    return ParameterErrors(
        names=names,
        promised=np.linalg.inv(known.normal) / np.outer(known.size, known.size),
        found=sandwich.covariance,
        degrees=int(sandwich.dof),
    )


def with_errors_of_likelihood(stage: Stage, errors: ParameterErrors) -> Stage:
    """Return a stage at the parameters of largest likelihood with their standard errors.

    Those of a calibration by least squares take all that is random for errors of one kind.
    """
    identify = stage.identify
    std = np.array([errors.std.get(p.name, np.inf) for p in identify.parameters])
    return replace(stage, identify=replace(identify, std=std, degrees=errors.degrees))
