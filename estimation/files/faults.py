"""Faults of a recording, the rows they stand in, and the error that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

__all__ = ["RecordError", "RecordFault", "Rows"]


@dataclass(frozen=True)
class RecordFault:
    """One fault of a recording.

    Attributes
    ----------
    text : str
        Names file, column and row, says what is wrong and what to do.
    severity : {"error", "warning"}
        An error refuses the recording, a warning goes into its log and the report.
    """

    text: str
    severity: Literal["error", "warning"] = "error"


class RecordError(ValueError):
    """Recordings are refused; ``faults`` holds one sentence for each fault of all files."""

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults: tuple[str, ...] = tuple(dict.fromkeys(faults))
        count = len(self.faults)
        head = "" if count == 1 else f"{count} faults in the recordings:\n  - "
        super().__init__(head + "\n  - ".join(self.faults))


@dataclass(frozen=True)
class Rows:
    """Where the rows of a table stand in their file.

    Attributes
    ----------
    numbers : ndarray of int, shape (n,)
        Line (text files) or row (others) of each sample, counted from 1.
    word : str
        ``"line"`` or ``"row"``.
    """

    numbers: np.ndarray
    word: str = "row"

    def say(self, where: np.ndarray, limit: int = 5) -> str:
        """Name the rows where a mask is true, such as ``"lines 3, 7, 8 (3 in all)"``."""
        numbers = self.numbers[np.flatnonzero(where)]
        listed = ", ".join(str(int(number)) for number in numbers[:limit])
        if len(numbers) == 1:
            return f"{self.word} {listed}"
        return f"{self.word}s {listed}{', …' if len(numbers) > limit else ''} ({len(numbers)} in all)"

    def take(self, index: np.ndarray | slice) -> Rows:
        """Keep the rows of an index or mask."""
        return Rows(self.numbers[index], self.word)
