"""The errors of the filters."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["FilterDivergence", "FilterError"]


class FilterError(ValueError):
    """A filter cannot be set up; the message has every fault.

    Parameters
    ----------
    subject : str
        What is wrong.
    faults : iterable of str
        One sentence each, with the remedy.
    """

    def __init__(self, subject: str, faults: Iterable[str]):
        self.faults = tuple(faults)
        super().__init__(f"{subject}:\n" + "\n".join(f"  - {fault}" for fault in self.faults))


class FilterDivergence(RuntimeError):
    """A filter has lost the machine; the message says when, where and what to try."""
