"""What the columns of a recording are: the time, and which input or output of a model each is, by unit and name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from discrepancy.problem.study_file import StudyError
from discrepancy.starters.kinds import Place
from estimation.files.column_names import pint_unit, read_column_name, to_si
from estimation.files.faults import RecordError
from estimation.files.read_table import OWN_TIMES, read_table
from estimation.files.table import FileTable, TableRequest
from multibody.base.spelling import nearest_or_choices
from multibody.base.units import UnitError

__all__ = ["DataColumn", "DataColumns", "Matched", "match_places", "read_columns"]

#: Words of a column that holds what should be, not what is.
_COMMAND = {"ref", "reference", "cmd", "command", "set", "setpoint", "soll", "demand", "desired", "target", "sp"}
_TIME = {"time", "t", "zeit", "timestamp", "temps", "seconds", "sec", "date", "datetime", "clock"}
_TRIP = {"trip", "run", "segment", "cycle", "experiment", "setpoint_file", "trial"}
#: Words for what a quantity is called, by its SI unit.
_QUANTITY = {
    "m": {"position", "pos", "x", "y", "z", "s", "travel", "displacement", "way", "height", "level", "weg", "stroke"},
    "m/s": {"velocity", "speed", "v", "vel"},
    "m/s**2": {"acceleration", "acc", "accel", "a"},
    "rad": {"angle", "theta", "phi", "position", "pos", "winkel", "alpha", "q"},
    "rad/s": {"speed", "omega", "velocity", "rpm", "drehzahl", "rate", "w"},
    "N": {"force", "kraft", "pull", "tension", "load", "f"},
    "N*m": {"torque", "moment", "tau", "drehmoment", "m"},
    "V": {"voltage", "volt", "u", "spannung"},
    "A": {"current", "i", "amps", "strom"},
    "K": {"temperature", "temp", "t", "temperatur"},
    "W": {"power", "heat", "p", "leistung"},
    "m**3/s": {"flow", "q", "pump"},
    "Pa": {"pressure", "p", "druck"},
}


@dataclass(frozen=True)
class DataColumn:
    """A column of the recordings.

    Parameters
    ----------
    name : str
    unit : str or None
        As its name or the file states it.
    """

    name: str
    unit: str | None

    @property
    def words(self) -> set[str]:
        """The words of its name without the unit, in lower case."""
        try:
            bare = read_column_name(self.name).quantity if self.unit is not None else self.name
        except UnitError:
            bare = self.name
        parts = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", bare)
        words = {w for w in re.split(r"[^A-Za-z0-9äöüÄÖÜ]+", parts.lower()) if w}
        return words | {w.rstrip("0123456789") for w in words} | set(re.findall(r"\d+", parts)) - {""}

    @property
    def is_command(self) -> bool:
        """Whether it holds what should be."""
        return bool(self.words & _COMMAND)


@dataclass(frozen=True, kw_only=True)
class DataColumns:
    """What the recordings hold.

    Parameters
    ----------
    files : tuple of Path
    time : str
        The time column; empty where each channel has times of its own.
    trip : str
        The column that changes from trip to trip, or an empty text.
    columns : tuple of DataColumn
        All others.
    """

    files: tuple[Path, ...]
    time: str
    trip: str
    columns: tuple[DataColumn, ...]


@dataclass(frozen=True)
class Matched:
    """A column that was taken for an input or output.

    Parameters
    ----------
    column : DataColumn
    why : str
        In words: by unit and name, or by its unit alone.
    """

    column: DataColumn
    why: str


def read_columns(files: Sequence[Path], time: str | None = None) -> DataColumns:
    """Read the names and units of the columns, and find the time.

    Parameters
    ----------
    files : sequence of Path
    time : str, optional
        The time column, where it is known.

    Raises
    ------
    RecordError
        If a file cannot be read, lacks a column that the first has, or none holds a time.
    """
    tables = [read_table(path, TableRequest()) for path in files]
    first, faults = tables[0], []
    for other in tables[1:]:
        if missing := [name for name in first.names if name not in other.names]:
            faults.append(
                f"{other.path.name}: lacks the column{'s' if len(missing) > 1 else ''} {_listed(missing)} of "
                f"{first.path.name}: name recordings of one logger only"
            )
    if faults:
        raise RecordError(faults)
    columns = tuple(DataColumn(name, _unit(name, first)) for name in first.names if name)
    time_column = _time_column(first, columns, time)
    trip = next((c.name for c in columns if c.unit is None and c.words & _TRIP and c.name != time_column), "")
    return DataColumns(
        files=tuple(files),
        time=time_column,
        trip=trip,
        columns=tuple(c for c in columns if c.name not in (time_column, trip)),
    )


def _unit(name: str, table: FileTable) -> str | None:
    if name in table.units:
        return pint_unit(table.units[name])
    try:
        return read_column_name(name).unit
    except UnitError:
        return None


def _time_column(table: FileTable, columns: Sequence[DataColumn], given: str | None) -> str:
    names = [c.name for c in columns]
    if given is not None:
        if given not in names:
            raise RecordError([f"{table.path.name}: there is no column '{given}'{nearest_or_choices(given, names)}"])
        return given
    if table.path.name.lower().endswith(OWN_TIMES):
        return ""
    seconds = [c for c in columns if c.unit is not None and measures(c.unit, "s")]
    named = [c for c in columns if c.unit is None and c.words & _TIME]
    for c in [*(c for c in seconds if c.words & _TIME), *named, *seconds]:
        try:
            values = read_table(table.path, TableRequest(columns=(c.name,), time=c.name)).numbers[c.name]
        except RecordError:
            continue
        values = values[np.isfinite(values)]
        # trips in one file start their clocks anew
        if values.size > 1 and np.mean(np.diff(values) > 0.0) > 0.9:
            return c.name
    raise RecordError(
        [
            f"{table.path.name}: no column looks like a time (a name such as 'time_s', numbers that grow): say "
            f"--time COLUMN; there are {_listed(names)}"
        ]
    )


def measures(unit: str, expected: str) -> bool:
    """Return whether a unit measures the quantity of an SI unit."""
    try:
        to_si(np.zeros(1), unit, expected)
    except UnitError:
        return False
    return True


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def _naming(place: Place, column: DataColumn) -> int:
    """Return how many words of a column's name speak for a place."""
    return len(column.words & {*place.words, place.name.rpartition(".")[0].lower()})


def _score(place: Place, column: DataColumn) -> float:
    """Return how much speaks for a column; minus infinity where it cannot be what is looked for."""
    quantity = len(column.words & _QUANTITY.get(place.unit, set()))
    named = _naming(place, column)
    if column.unit is None:
        return quantity + 2.0 * named if quantity else -np.inf
    if not measures(column.unit, place.unit):
        return -np.inf
    return 2.0 + 0.5 * min(quantity, 1) + 2.0 * named


def match_places(
    places: Sequence[Place], columns: Sequence[DataColumn], given: Mapping[str, str], *, commands: bool
) -> dict[str, Matched]:
    """Find a column for each place, as far as there are any; what speaks for all of them together decides.

    Parameters
    ----------
    places : sequence of Place
    columns : sequence of DataColumn
    given : mapping of str to str
        Columns that the user named, by place.
    commands : bool
        Whether a column that holds what should be may be taken.

    Raises
    ------
    StudyError
        If a given column is not there or measures something else.
    """
    from scipy.optimize import linear_sum_assignment

    by_name = {c.name: c for c in columns}
    matched, faults = {}, []
    for place in places:
        if place.name not in given:
            continue
        named = given[place.name]
        column = by_name.get(named)
        if column is None:
            faults.append(f"--column {place.name}={named}: there is no such column{nearest_or_choices(named, by_name)}")
        elif column.unit is not None and not measures(column.unit, place.unit):
            faults.append(
                f"--column {place.name}={named}: is in '{column.unit}', and '{place.name}' is in '{place.unit}'"
            )
        else:
            matched[place.name] = Matched(column, "as you said")
    if faults:
        raise StudyError(faults)
    taken = set(given.values())
    left = [p for p in places if p.name not in matched]
    free = [c for c in columns if c.name not in taken and (commands or not c.is_command)]
    if not left or not free:
        return matched
    # Among equals the earlier place and the earlier column go together.
    score = np.array(
        [[_score(p, c) - 1e-3 * k - 1e-4 * abs(k - j) for j, c in enumerate(free)] for k, p in enumerate(left)]
    )
    # Where no column speaks for a place, it stays empty: a row of its own costs nothing.
    padded = np.hstack([np.where(np.isfinite(score), score, -1e6), np.zeros((len(left), len(left)))])
    rows, picked = linear_sum_assignment(padded, maximize=True)
    for k, j in zip(rows, picked, strict=True):
        if j < len(free) and np.isfinite(score[k, j]) and score[k, j] > 0.0:
            place, column = left[k], free[j]
            if column.unit is None:
                why = f"by its name, taken to be in {place.unit}"
            else:
                why = "by unit and name" if _naming(place, column) else "by its unit alone"
            matched[place.name] = Matched(column, why)
    return matched
