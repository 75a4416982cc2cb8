"""A measured record: named signals in SI over time, with a log of everything that was done to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from estimation.files.faults import RecordError
from multibody.base.quantity_text import count_text, unit_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["OwnSamples", "Record", "RecordedSignal"]

MOST_LISTED = 12  # signals in a notebook's table
MOST_DRAWN = 3  # and in its figure


@dataclass(frozen=True, eq=False)
class OwnSamples:
    """The samples of a channel at its own instants, which are not those of the record.

    Attributes
    ----------
    time : ndarray, shape (k,), s
        Strictly increasing, within the record.
    values : ndarray, shape (k,)
        In the channel's unit.
    """

    time: np.ndarray
    values: np.ndarray

    def nearest(self, time: np.ndarray) -> np.ndarray:
        """Return which of the channel's samples is nearest to each of some times, shape of ``time``."""
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        return np.searchsorted(middle, time, side="right")


@dataclass(frozen=True, kw_only=True)
class RecordedSignal:
    """One measured channel.

    Attributes
    ----------
    values : ndarray, shape (n,), in ``unit``
    unit : str
        SI unit; empty for numbers without dimension, or where nobody said the unit.
    column : str
        Name of the column in the file.
    measured_unit : str
        Unit of the numbers in the file.
    file : str
        Name of the file, where a record has several.
    own : OwnSamples, optional
        Where the channel was sampled at instants of its own: these samples.  ``values`` then has the nearest of them at
        each instant of the record.
    """

    values: np.ndarray
    unit: str
    column: str
    measured_unit: str
    file: str = ""
    own: OwnSamples | None = None

    @property
    def samples(self) -> np.ndarray:
        """What was measured, each sample once."""
        return self.values if self.own is None else self.own.values


@dataclass(frozen=True, kw_only=True)
class Record:
    """One recording, or one trip or uninterrupted part of it.

    Attributes
    ----------
    name : str
        Unique within a study: file name without its ending, with the trip in brackets.
    path : Path
        The file.
    time : ndarray, shape (n,), s
        Time stamps, strictly increasing, even within a tenth of a step.
    signals : mapping of str to RecordedSignal
    log : tuple of str
        Everything that was assumed of the file or done to it, warnings included.
    warnings : tuple of str
        What looks wrong but does not refuse the record.
    origin : int, optional
        Calendar time of time zero, ns since 1970 (UTC), where the file states it.

    Raises
    ------
    RecordError
        If the arrays do not have the same length.
    """

    name: str
    path: Path
    time: np.ndarray
    signals: Mapping[str, RecordedSignal]
    log: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    origin: int | None = None

    def __post_init__(self) -> None:
        time = np.array(self.time, dtype=float)
        time.setflags(write=False)
        signals = {}
        for key, signal in self.signals.items():
            values = np.array(signal.values, dtype=float)
            if values.shape != time.shape:
                raise RecordError([f"{self.name}: '{key}' has {len(values)} values for {len(time)} time stamps"])
            values.setflags(write=False)
            signals[key] = replace(signal, values=values)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "signals", MappingProxyType(signals))

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        rows = [(key, unit_text(s.unit) or "1", s.column) for key, s in self.signals.items()]
        if len(rows) > MOST_LISTED + 1:  # a line that stands for one signal is no shorter than the signal
            rows = [*rows[:MOST_LISTED], (f"and {len(rows) - MOST_LISTED} more", "", "")]
        drawn = list(self.signals.items())[:MOST_DRAWN]
        panels = [(f"{key} [{unit_text(s.unit) or '1'}]", {key: s.values}) for key, s in drawn]
        text = f"{len(self.time)} samples over {self.duration:.4g} s at {self.rate:.5g} Hz, from {self.path.name}."
        if len(drawn) < len(self.signals):
            text += f" Drawn are the first {len(drawn)} of {len(self.signals)} signals."
        if self.warnings:
            text += f" {count_text(len(self.warnings), 'warning')}: {'; '.join(self.warnings)}"
        figure = small_figure(self.time, panels) if panels else None
        header = ("signal", "unit", "column")
        return notebook_view(f"Record '{self.name}'", rows, header=header, text=text, figure=figure)

    @property
    def rate(self) -> float:
        """Mean sampling rate, Hz."""
        return (len(self.time) - 1) / self.duration

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    def values(self, *names: str) -> np.ndarray:
        """Return signals as columns, shape (n, len(names))."""
        return np.column_stack([self.signals[name].values for name in names])

    def noted(self, *lines: str) -> Record:
        """Return the record with lines added to its log."""
        return replace(self, log=(*self.log, *lines))

    def warned(self, *lines: str) -> Record:
        """Return the record with warnings added; they go to the log as well."""
        fresh = [line for line in lines if line not in self.warnings]
        log = (*self.log, *(f"warning: {line}" for line in fresh))
        return replace(self, log=log, warnings=(*self.warnings, *fresh))

    def frame(self) -> pd.DataFrame:
        """Return a DataFrame with the time in seconds as index and one column for each signal, in SI."""
        import pandas as pd

        index = pd.Index(self.time, name="time [s]")
        return pd.DataFrame({f"{key} [{s.unit or '-'}]": s.values for key, s in self.signals.items()}, index=index)
