"""Columns of a tall matrix, kept pack by pack: what is done with them needs one pack at a time in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array
from multibody.base.memory import ArrayStore

__all__ = ["Columns", "columns_together", "responses_together"]

TOGETHER = 128  # columns that are worked on in one product
#: Bytes of the columns that are worked on in one product, where `TOGETHER` of them are more: chosen so that the dozen
#: arrays of that size that two threads work on stay below a gigabyte.  Results do not depend on the memory that there
#: is, so neither may this number.
PACK_BYTES = 64 << 20
#: The same of responses that are computed together: of a long record, each batch of them may cost a simulation.
RESPONSE_BYTES = 256 << 20


def columns_together(rows: int, most: int = TOGETHER) -> int:
    """Return how many columns of some number of rows are worked on together, at most ``most``."""
    return max(1, min(most, PACK_BYTES // max(1, 8 * rows)))


def responses_together(rows: int, most: int) -> int:
    """Return how many responses of some number of rows are computed together, at most ``most``."""
    return max(1, min(most, RESPONSE_BYTES // max(1, 8 * rows)))


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a tall matrix in packs, some of which are used.

    Parameters
    ----------
    store : ArrayStore
    numbers : tuple of int
        Of the packs in the store, shape (n_rows, …).
    chosen : tuple of ndarray of int
        Columns of each pack that are used.
    rows : int
    """

    store: ArrayStore
    numbers: tuple[int, ...]
    chosen: tuple[np.ndarray, ...]
    rows: int

    @classmethod
    def of(cls, packs: Iterable[Array], rows: int) -> Columns:
        """Keep packs of columns."""
        store = ArrayStore()
        numbers, chosen = [], []
        for pack in packs:
            numbers.append(store.put(pack))
            chosen.append(np.arange(pack.shape[1]))
        return cls(store, tuple(numbers), tuple(chosen), rows)

    @property
    def count(self) -> int:
        """Number of columns that are used."""
        return sum(c.size for c in self.chosen)

    @property
    def spans(self) -> list[slice]:
        """Which of the columns are in each pack."""
        ends = np.cumsum([c.size for c in self.chosen])
        return [slice(int(end) - c.size, int(end)) for end, c in zip(ends, self.chosen, strict=True)]

    def pack(self, number: int) -> Array:
        """Return the used columns of a pack, shape (n_rows, …); they must not be changed."""
        whole, chosen = self.store.get(self.numbers[number]), self.chosen[number]
        return whole if chosen.size == whole.shape[1] else np.ascontiguousarray(whole[:, chosen])

    def packs(self) -> Iterator[tuple[slice, Array]]:
        """Yield every pack with the columns that are in it."""
        for k, span in enumerate(self.spans):
            if span.stop > span.start:
                yield span, self.pack(k)

    def __getitem__(self, columns: slice) -> Array:
        """Return some columns, shape (n_rows, k)."""
        parts = [
            pack[:, max(columns.start - span.start, 0) : columns.stop - span.start]
            for span, pack in self._with(columns)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts or [np.zeros((self.rows, 0))], axis=1)

    def _with(self, columns: slice) -> Iterator[tuple[slice, Array]]:
        for k, span in enumerate(self.spans):
            if span.start < columns.stop and columns.start < span.stop:
                yield span, self.pack(k)

    def only(self, used: np.ndarray) -> Columns:
        """Return the same with some columns alone; ``used`` has a bool for each."""
        chosen = tuple(c[used[span]] for c, span in zip(self.chosen, self.spans, strict=True))
        return Columns(self.store, self.numbers, chosen, self.rows)

    def selected(self, groups: Sequence[slice]) -> Columns:
        """Return some groups of columns, one after another, in packs of their own."""

        def packs() -> Iterator[Array]:
            together, parts = columns_together(self.rows), [np.zeros((self.rows, 0))]
            for own in groups:
                if sum(p.shape[1] for p in parts) + own.stop - own.start > together and len(parts) > 1:
                    yield np.concatenate(parts, axis=1)
                    parts = []
                parts.append(self[own])
            yield np.concatenate(parts, axis=1)

        return Columns.of(packs(), self.rows)

    def transposed_times(self, other: Array) -> Array:
        """Return the product of the transposed matrix with another, shape (n_columns, …)."""
        out = np.empty((self.count, *other.shape[1:]))
        for span, pack in self.packs():
            out[span] = pack.T @ other
        return out

    def gram(self) -> Array:
        """Return the products of all columns with each other, shape (n_columns, n_columns)."""
        out = np.empty((self.count, self.count))
        for span, pack in self.packs():
            for other, columns in self.packs():
                if other.start <= span.start:
                    out[other, span] = columns.T @ pack
                    out[span, other] = out[other, span].T
        return out

    def matrix(self) -> Array:
        """Return all columns at once, shape (n_rows, n_columns)."""
        return np.concatenate([np.zeros((self.rows, 0)), *(pack for _, pack in self.packs())], axis=1)
