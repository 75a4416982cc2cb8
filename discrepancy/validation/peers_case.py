"""What every rival method gets on a case of the virtual axis: the same residual and the same columns as the scan.

None of the rivals can work out by itself how a candidate would change the outputs of a closed loop, or free the
residual of what recalibration explains.  Both are given to them, so that only the decision is compared: what to name,
and when to be silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities

if TYPE_CHECKING:
    from discrepancy.rigs.recording import Case
    from discrepancy.stages.stage import Stage
    from discrepancy.statistics.whitened import WhitenedProblem

__all__ = ["OnColumns", "PeerCase", "Seen", "peer_case", "seen_as"]


@dataclass(frozen=True, eq=False)
class Seen:
    """Residual and candidate columns in one metric, freed of calibration.

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


class OnColumns(Protocol):
    """What a method is given that asks for nothing but columns and residual."""

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """What may be named."""

    @property
    def plain(self) -> Seen:
        """Each output divided by its residual's size."""

    @property
    def white(self) -> Seen:
        """Each output whitened by prediction-error filters."""

    def held_out(self, named: Sequence[int]) -> float:
        """Return the error with the named candidates on records that took no part, as a share of that without."""


@dataclass(frozen=True, eq=False)
class PeerCase:
    """One case as the rivals see it.

    Parameters
    ----------
    case : Case
    stage : Stage
        After recalibration.
    candidates : tuple of Candidate
        With columns on the identification records and then on the validation records.
    plain, white : Seen
        Each output divided by its residual's size; and whitened by prediction-error filters.
    residual, held : Residual
        Of the identification and of the validation records, in the outputs' units.
    sens, sens_held : Sensitivities
    dropped : frozenset of str
        Candidates that these records cannot tell from recalibration.
    """

    case: Case
    stage: Stage
    candidates: tuple[Candidate, ...]
    plain: Seen
    white: Seen
    residual: Residual
    held: Residual
    sens: Sensitivities
    sens_held: Sensitivities
    dropped: frozenset[str]
    _plain: WhitenedProblem

    def held_out(self, named: Sequence[int]) -> float:
        """Return the error on held-out records with the named candidates fitted, as a share of that without.

        Strengths are fitted together on the identification records, calibration moves along, and the start of each
        held-out record is fitted as before.  The share is the geometric mean over the outputs.
        """
        w = self._plain
        best = _best(w)
        chosen = [best[c] for c in named if c in best]
        blocks = [b.copy() for b in self.held.blocks]
        if chosen:
            raw = np.concatenate([w.columns.Z[:, w.columns.groups[g].columns] @ w.columns.R[g] for g in chosen], axis=1)
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


def seen_as(w: WhitenedProblem, candidates: Sequence[Candidate]) -> Seen:
    """Return residual and columns in one metric as the rivals get them, each candidate at the shape that fits best."""
    lay, columns, best = w.projection.layout, w.columns, _best(w)
    data = slice(0, lay.n_data)
    parts, owner = [], []
    for candidate, g in best.items():
        raw = columns.Z[data, columns.groups[g].columns] @ columns.R[g]
        parts.append(raw / np.linalg.norm(raw, axis=0))
        owner += [candidate] * raw.shape[1]
    groups = [
        (g.candidate, g.columns, g.columns.stop - g.columns.start + candidates[g.candidate].n_free_shapes)
        for g in columns.groups
    ]
    X = np.concatenate(parts, axis=1)
    return Seen(w.e[data], X, np.array(owner), lay.left_out(), columns.Z[data], groups, lay.n_channels)


def peer_case(case: Case, stage: Stage) -> PeerCase:
    """Work out what the rivals get, from a recalibrated stage of a study of the case."""
    from discrepancy.effects.catalogue import catalogue
    from discrepancy.sensitivities.candidates import candidate_sensitivities
    from discrepancy.statistics.whitened import fit_whitened, scaled_by_rms

    assert stage.validate is not None
    together = replace(stage.identify, fits=(*stage.identify.fits, *stage.validate.fits))
    facts = stage.linearised_problem().with_calibration(together)
    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs)
    candidates, _ = candidate_sensitivities(facts, entries)
    n = len(stage.identify.fits)
    whole, sens = facts.residual(), facts.sensitivities()
    residual, held = (Residual(part, whole.dt, whole.channels) for part in (whole.blocks[:n], whole.blocks[n:]))
    first, last = (
        Sensitivities(sens.names, sens.blocks[p], sens.prior_std, sens.prior_offset, sens.nuisance[p])
        for p in (slice(0, n), slice(n, None))
    )
    seen = [replace(c, sensitivities=tuple(shape[:n] for shape in c.sensitivities)) for c in candidates]
    plain = scaled_by_rms(residual, first, seen)
    white = fit_whitened(residual, first, seen, 24, 2, 2, plain)
    best = _best(plain)
    dropped = frozenset(c.name for i, c in enumerate(candidates) if i not in best)
    return PeerCase(
        case,
        stage,
        tuple(candidates),
        seen_as(plain, seen),
        seen_as(white, seen),
        residual,
        held,
        first,
        last,
        dropped,
        plain,
    )
