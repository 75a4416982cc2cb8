"""What the other methods get on a case of a virtual machine: the scan's own residual and sensitivities.

None of them computes how a candidate changes the outputs of a closed loop, or removes from the residual what
recalibration explains.  Both are computed for them, so that only the decision is compared: what to name, and when to
name nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from discrepancy.statistics.whitened import WhitenedProblem

__all__ = ["PeerCase", "RegressionCase", "RegressionData", "peer_case", "regression_data"]


@dataclass(frozen=True, eq=False, kw_only=True)
class RegressionData:
    """A regression: residual and sensitivities of the candidates in one metric, with calibration projected out.

    Parameters
    ----------
    e : ndarray, shape (n,)
        Residual.
    X : ndarray, shape (n, p)
        One column for each strength of each candidate, at its best shape, scaled to length one.
    owner : ndarray of int, shape (p,)
        Candidate of each column.
    trips : list of slice
        Rows of each record, or of its quarters where there are fewer than three.
    Z : ndarray, shape (n, q)
        Orthonormal columns of every candidate at every shape.
    groups : list of (candidate, slice into Z, number of free numbers)
    n_channels : int
    """

    e: Array
    X: Array
    owner: Array
    trips: list[slice]
    Z: Array
    groups: list[tuple[int, slice, int]]
    n_channels: int


class RegressionCase(Protocol):
    """What a regression method needs: candidates, and residual and sensitivities as arrays."""

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Effects that can be named."""

    @property
    def plain(self) -> RegressionData:
        """Each output divided by its residual's size."""

    @property
    def white(self) -> RegressionData:
        """Each output whitened by prediction-error filters."""

    def held_out(self, named: Sequence[int]) -> float:
        """Return the error with the named candidates on held-out records, as a share of that without."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PeerCase:
    """One case as the other methods see it.

    Parameters
    ----------
    stage : Stage
        After recalibration.
    candidates : tuple of Candidate
        With sensitivities on the identification records, then on the validation records.
    plain, white : RegressionData
        Each output divided by its residual's size; and whitened by prediction-error filters.
    residual, held : Residual
        Of the identification and of the validation records, in the outputs' units.
    sens, sens_held : Sensitivities
    dropped : frozenset of str
        Candidates that these records cannot distinguish from recalibration.
    """

    stage: Stage
    candidates: tuple[Candidate, ...]
    plain: RegressionData
    white: RegressionData
    residual: Residual
    held: Residual
    sens: Sensitivities
    sens_held: Sensitivities
    dropped: frozenset[str]
    _plain: WhitenedProblem

    def held_out(self, named: Sequence[int]) -> float:
        """Return the error on held-out records with the named candidates fitted, as a share of that without.

        Strengths are fitted together on the identification records, calibration adjusts, and the initial state
        of each held-out record is fitted as before.  The share is the geometric mean over the outputs.
        """
        w = self._plain
        best = _best(w)
        chosen = [best[c] for c in named if c in best]
        blocks = [b.copy() for b in self.held.blocks]
        if chosen:
            raw = np.concatenate([w.columns.Z[w.columns.groups[g].columns] @ w.columns.R[g] for g in chosen], axis=1)
            amplitude = np.linalg.lstsq(raw, w.e, rcond=1e-10)[0]
            at, n = 0, len(self.residual.blocks)
            for g in chosen:
                group = w.columns.groups[g]
                k = group.columns.stop - group.columns.start
                a = amplitude[at : at + k]
                at += k
                theta = -w.columns.imitation[g] @ a
                columns = self.candidates[group.candidate].sensitivities[group.shape][n:]
                for b, block in enumerate(blocks):
                    block -= columns[b] @ a + self.sens_held.blocks[b] @ theta
        before, after = (self._sizes(x) for x in (self.held.blocks, blocks))
        return float(np.exp(np.mean(np.log(after / before))))

    def _sizes(self, blocks: Sequence[Array]) -> Array:
        scale = np.array([self.stage.noise[c] for c in self.held.channels])
        left = []
        for block, own in zip(blocks, self.sens_held.nuisance, strict=True):
            r = block / scale
            if own is not None:
                q, _ = np.linalg.qr((own / scale[:, None]).reshape(r.size, -1))
                flat = r.reshape(-1)
                r = (flat - q @ (q.T @ flat)).reshape(r.shape)
            left.append(r)
        out: Array = np.sqrt(np.mean(np.concatenate(left) ** 2, axis=0))
        return out


def _best(w: WhitenedProblem) -> dict[int, int]:
    from discrepancy.statistics.whitened import best_groups

    if w.scorer is None:
        return {}
    return best_groups(w.scorer, w.scorer(w.e[:, None]))


def regression_data(w: WhitenedProblem, candidates: Sequence[Candidate]) -> RegressionData:
    """Return the regression in one metric, each candidate at the shape that fits best."""
    lay, columns, best = w.projection.layout, w.columns, _best(w)
    data = slice(0, lay.n_data)
    parts, owner = [], []
    for candidate, g in best.items():
        raw = columns.Z[columns.groups[g].columns][data] @ columns.R[g]
        parts.append(raw / np.linalg.norm(raw, axis=0))
        owner += [candidate] * raw.shape[1]
    groups = [
        (g.candidate, g.columns, g.columns.stop - g.columns.start + candidates[g.candidate].n_free_shapes)
        for g in columns.groups
    ]
    X = np.concatenate(parts, axis=1)
    return RegressionData(
        e=w.e[data],
        X=X,
        owner=np.array(owner),
        trips=lay.left_out(),
        Z=columns.Z.matrix()[data],
        groups=groups,
        n_channels=lay.n_channels,
    )


def peer_case(stage: Stage) -> PeerCase:
    """Return what the other methods get, from the recalibrated stage of a study."""
    from discrepancy.effects.catalogue import catalogue
    from discrepancy.sensitivities.candidates import candidate_sensitivities
    from discrepancy.statistics.whitened import fit_whitened, scaled_by_rms

    assert stage.validate is not None
    together = replace(stage.identify, fits=(*stage.identify.fits, *stage.validate.fits))
    linearised = stage.linearised_problem().with_calibration(together)
    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs)
    candidates, _ = candidate_sensitivities(linearised, entries)
    n = len(stage.identify.fits)
    whole, sens = linearised.residual(), linearised.sensitivities()
    residual, held = (Residual(part, whole.dt, whole.channels) for part in (whole.blocks[:n], whole.blocks[n:]))
    first, last = (
        Sensitivities(
            names=sens.names,
            blocks=sens.blocks[p],
            prior_std=sens.prior_std,
            prior_offset=sens.prior_offset,
            nuisance=sens.nuisance[p],
        )
        for p in (slice(0, n), slice(n, None))
    )
    seen = [replace(c, sensitivities=tuple(tuple(shape)[:n] for shape in c.sensitivities)) for c in candidates]
    plain = scaled_by_rms(residual, first, seen)
    white = fit_whitened(residual, first, seen, 24, 2, 2, plain)
    best = _best(plain)
    dropped = frozenset(c.name for i, c in enumerate(candidates) if i not in best)
    return PeerCase(
        stage=stage,
        candidates=tuple(candidates),
        plain=regression_data(plain, seen),
        white=regression_data(white, seen),
        residual=residual,
        held=held,
        sens=first,
        sens_held=last,
        dropped=dropped,
        _plain=plain,
    )
