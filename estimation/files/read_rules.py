"""What a study allows to be done to its recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["ReadRules"]


@dataclass(frozen=True, kw_only=True)
class ReadRules:
    """What a study allows to be done to its recordings; by default nothing.

    Attributes
    ----------
    trip : str, optional
        Column that changes from one trip to the next; each trip becomes a record.
    drop_nan : bool
        Leave out rows in which an asked column is empty, NaN or infinite.
    drop_duplicates : bool
        Of rows with the same time stamp keep the first.
    resample : float, optional, Hz
        Interpolate linearly onto an even grid of this rate.
    gaps : {"refuse", "split"}
        What to do with gaps: refuse the file, or make each uninterrupted part a record.
    longest_gap : float, optional, s
        Longest step that is not yet a gap; default is five median steps.
    time_unit : str, optional
        Unit of the time column, where its name does not say it and it is not seconds.
    start, stop : float, optional, s
        Rows outside this window of the file's own time are left out before anything is checked.
    uneven : {"refuse", "own instants"}
        What to do with time stamps that jitter: refuse the file, or compare each output at its own instants and
        interpolate only the inputs.
    skip_rows : int
        Lines above the header of a text file or sheet, where its place is not recognised.
    time_format : str, optional
        How dates are written, such as ``"%d/%m/%Y %H:%M:%S"``.
    time_zone : str, optional
        Time zone of dates that state none, such as ``"Europe/Berlin"``; default UTC.
    """

    trip: str | None = None
    drop_nan: bool = False
    drop_duplicates: bool = False
    resample: float | None = None
    gaps: Literal["refuse", "split"] = "refuse"
    longest_gap: float | None = None
    time_unit: str | None = None
    start: float | None = None
    stop: float | None = None
    uneven: Literal["refuse", "own instants"] = "refuse"
    skip_rows: int = 0
    time_format: str | None = None
    time_zone: str | None = None
