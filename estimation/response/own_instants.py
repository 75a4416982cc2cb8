"""Model outputs at the instants at which a channel was sampled, where these are not the record's own grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimation.files.record import OwnSamples

__all__ = ["at_own_instants"]

#: Grid samples from which a model output between them is interpolated: a cubic, whose error falls with the fourth power
#: of the step.
POINTS = 4


@dataclass(frozen=True, eq=False)
class AtOwnInstants:
    """Takes model outputs at a channel's own instants, and repeats each until half-way to the next.

    Measurement and model are repeated alike, so their difference at each instant of the channel counts as often as
    there are grid samples around it, and nothing is compared where nothing was measured.

    Attributes
    ----------
    first : ndarray of int, shape (k,)
        First of the grid samples that each instant is interpolated from.
    weights : ndarray, shape (k, 4)
    nearest : ndarray of int, shape (n,)
        Which of the channel's samples each grid sample repeats.
    """

    first: np.ndarray
    weights: np.ndarray
    nearest: np.ndarray

    @classmethod
    def on(cls, grid: np.ndarray, samples: OwnSamples) -> AtOwnInstants:
        """Return the operator for a grid (even, shape (n,), s) and a channel's samples."""
        step = (grid[-1] - grid[0]) / (len(grid) - 1)
        place = (samples.time - grid[0]) / step
        first = np.clip(np.floor(place).astype(int) - 1, 0, len(grid) - POINTS)
        at = place - first
        weights = np.ones((len(at), POINTS))
        for j in range(POINTS):
            for k in range(POINTS):
                if k != j:
                    weights[:, j] *= (at - k) / (j - k)
        return cls(first, weights, samples.nearest(grid))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return a channel of the model, shape (n, ...), at its own instants, repeated on the grid."""
        taken = sum(
            self.weights[:, j].reshape(-1, *[1] * (values.ndim - 1)) * values[self.first + j] for j in range(POINTS)
        )
        return np.asarray(taken)[self.nearest]


def at_own_instants(grid: np.ndarray, samples: Mapping[int, OwnSamples]) -> dict[int, AtOwnInstants]:
    """Return the operator of each channel that has instants of its own, by its column."""
    return {c: AtOwnInstants.on(grid, own) for c, own in samples.items()}
