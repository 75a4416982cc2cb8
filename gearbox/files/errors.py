"""The error of this package."""

from __future__ import annotations

from multibody.base.parameter_file import ParameterError

__all__ = ["GearError"]


class GearError(ParameterError):
    """A gear stage cannot be built or run, or a recording not used; the message lists all faults.

    Parameters
    ----------
    source : str
        What has the faults, such as a file or a gear pair.
    faults : iterable of str
        One sentence each, saying what to do.
    """
