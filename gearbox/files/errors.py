"""Errors of the gear package: each lists everything that is wrong."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["GearError"]


class GearError(ValueError):
    """A gear stage cannot be built or run; the message lists all faults.

    Parameters
    ----------
    source : str
        What has the faults, such as a file or a gear pair.
    faults : iterable of str
        One sentence each, saying what to do.
    """

    def __init__(self, source: str, faults: Iterable[str]):
        self.faults = list(dict.fromkeys(faults))
        super().__init__(f"{source} cannot be used:\n" + "\n".join(f"  - {f}" for f in self.faults))
