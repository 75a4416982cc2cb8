"""A record of a large machine with fewer states: the directions that inputs reach and outputs show.

The filter takes time with the cube of the states, and most states of a large machine are stiff: from one sample to the
next they follow the others.  The directions are those of a balanced truncation (Moore, IEEE Trans. Autom. Control 26,
1981) with the reachability and observability Gramians of the record's transitions, in the mean over its samples
(Verriest and Kailath, IEEE Trans. Autom. Control 28, 1983).  How many are needed is not read off the singular values:
the outputs' response to random inputs is compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discrepancy.innovations.linear_record import LinearRecord

__all__ = ["with_fewer_states"]

#: States that are kept at first, and by how many more each time: a trial costs little beside the filter; chosen.
FEWEST, MORE = 6, 3
#: Share of the states from which fewer are not worth their error: the filter then takes a third of its time; chosen.
MOST_SHARE = 0.7
#: Largest error of the response to any input, over that response, in units of the outputs' noise: a random force is
#: known to a tenth at best.
TOLERANCE = 0.01


def with_fewer_states(record: LinearRecord, noise: np.ndarray) -> LinearRecord:
    """Return a record with as few states as give the same outputs; itself where most are needed.

    Parameters
    ----------
    record : LinearRecord
    noise : ndarray, shape (n_c,)
        White noise of each output, SI: what counts as small.
    """
    n = record.phi.shape[1]
    driven = np.random.default_rng(0).standard_normal((record.time.size, record.gamma0.shape[2]))
    whole = record.response(driven) / noise[:, None]
    size = np.sqrt(np.mean(whole**2, axis=0))  # (n_c, m)
    reach = np.max(size, axis=0)
    if not np.all(np.isfinite(reach)):
        return record
    there, back = _balancing(record, noise, np.where(reach > 0.0, reach, np.inf))
    for count in range(FEWEST, int(MOST_SHARE * n) + 1, MORE):
        fewer = _projected(record, there[:, :count], back[:count])
        with np.errstate(over="ignore", invalid="ignore"):  # too few states may diverge
            error = np.sqrt(np.mean((fewer.response(driven) / noise[:, None] - whole) ** 2, axis=0))
        if np.all(np.max(error, axis=0) <= TOLERANCE * reach):
            return fewer
    return record


def _balancing(record: LinearRecord, noise: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the balanced directions of the states, shape (n, n), most important first, and their inverse.

    Every sample counts alike, whatever the size of the outputs there: where dry friction lets go, a deviation may grow
    for a moment by orders of magnitude.
    """
    n, steps = record.phi.shape[1], len(record.phi)
    driven = np.concatenate([record.gamma0, record.gamma1], axis=2) / np.tile(reach, 2)
    seen = record.c / noise[:, None]
    reached, shown = np.zeros((n, n)), np.zeros((n, n))
    state, value = np.zeros((n, n)), seen[-1].T @ seen[-1]
    for k in range(steps):
        state = record.phi[k] @ state @ record.phi[k].T + driven[k] @ driven[k].T
        reached += state / max(float(np.sum((seen[k + 1] @ state) * seen[k + 1])), 1e-300)
    for k in range(steps - 1, -1, -1):
        shown += value / max(float(np.sum((value @ driven[k]) * driven[k])), 1e-300)
        value = record.phi[k].T @ value @ record.phi[k] + seen[k].T @ seen[k]
    root, other = _root(reached), _root(shown)
    left, singular, right = np.linalg.svd(other.T @ root)
    half = np.sqrt(np.maximum(singular, 1e-300 + 1e-14 * singular[0]))
    return root @ right.T / half, (other @ left / half).T


def _root(gramian: np.ndarray) -> np.ndarray:
    """Return F with F Fᵀ equal to a symmetric matrix without negative eigenvalues but for rounding."""
    size = np.sqrt(np.maximum(np.diag(gramian), 1e-300))
    values, vectors = np.linalg.eigh(gramian / np.outer(size, size))
    root: np.ndarray = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _projected(record: LinearRecord, there: np.ndarray, back: np.ndarray) -> LinearRecord:
    """Return the record in the coordinates z of x = there · z, with z = back · x."""
    return replace(
        record,
        phi=np.ascontiguousarray(back @ record.phi @ there),
        gamma0=np.ascontiguousarray(back @ record.gamma0),
        gamma1=np.ascontiguousarray(back @ record.gamma1),
        c=np.ascontiguousarray(record.c @ there),
    )
