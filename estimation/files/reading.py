"""Reading files into records: units, trips, gaps and checks, all faults of all files at once."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from estimation.files.checks import (
    GRID_TOLERANCE,
    RecordError,
    Rows,
    check_copies,
    check_finite,
    check_same_scale,
    check_time_order,
    check_values,
    constant_inputs_once,
    gap_steps,
    grid_deviation,
)
from estimation.files.columns import read_column_name, si_unit_of, to_si
from estimation.files.readers import FORMATS, read_table
from estimation.files.record import ReadRules, Record, Signal
from multibody.base.units import UnitError

__all__ = ["ReadRules", "Record", "Signal", "read_record", "read_records"]

_SHORTEST_PART = 10
"""Rows; a stretch between two gaps that is shorter is left out."""


def read_record(
    path: str | Path,
    *,
    time: str,
    columns: Mapping[str, str],
    units: Mapping[str, str] | None = None,
    measured_units: Mapping[str, str] | None = None,
    rules: ReadRules | None = None,
    name: str | None = None,
) -> Record:
    """Read one file as one record.

    Parameters are those of :func:`read_records`.

    Raises
    ------
    RecordError
        If the file has faults, or holds more than one record (trips, or parts between gaps).
    """
    found = read_records(
        [path],
        time=time,
        columns=columns,
        units=units,
        measured_units=measured_units,
        rules=rules,
        names=None if name is None else [name],
        may_be_constant=tuple(columns),
    )
    if len(found) != 1:
        raise RecordError([f"{Path(path).name}: holds {len(found)} records: read it with read_records"])
    return found[0]


def read_records(
    paths: Sequence[str | Path],
    *,
    time: str,
    columns: Mapping[str, str],
    units: Mapping[str, str] | None = None,
    measured_units: Mapping[str, str] | None = None,
    rules: ReadRules | None = None,
    names: Sequence[str] | None = None,
    may_be_constant: Collection[str] = (),
    defaults: Mapping[str, float] | None = None,
) -> tuple[Record, ...]:
    """Read files into records, and tell all faults of all files at once.

    Parameters
    ----------
    paths : sequence of str or Path
        CSV, Parquet or MATLAB files.
    time : str
        Name of the time column, in any unit of time.
    columns : mapping of str to str
        Signal name to column name.
    units : mapping of str to str, optional
        Signal name to the SI unit that is expected.  A column that measures something else is refused; a
        column that says no unit is taken in this one, which the log notes.
    measured_units : mapping of str to str, optional
        Signal name to the unit of the numbers in the file, where the column's name does not say it or is
        wrong.
    rules : ReadRules, optional
        What may be done to the recordings; by default nothing.
    names : sequence of str, optional
        Names of the files' records; by default the file names without their endings.
    may_be_constant : collection of str
        Signals that may stand still in every record, such as inputs.
    defaults : mapping of str to float, optional
        Signal name to the constant value, in the expected unit, that it has in files without its column. At
        least one file must have the column, so that a misspelt name is not taken for an absence.

    Returns
    -------
    tuple of Record
        In the order of the files, trips in the order of the file.

    Raises
    ------
    RecordError
        With one sentence for each fault of all files.
    """
    rules = rules or ReadRules()
    records: list[Record] = []
    faults: list[str] = []
    labels = list(names) if names is not None else _unique_names([Path(path) for path in paths])
    for path, label in zip(paths, labels, strict=True):
        try:
            records += _File(
                Path(path), label, time, columns, units or {}, measured_units or {}, rules, defaults or {}
            ).read()
        except RecordError as error:
            faults += error.faults
    if not faults:
        faults += _never_recorded(records, columns, defaults or {})
    common = check_same_scale(records, may_be_constant)
    faults += [fault.text for fault in common if fault.severity == "error"]
    if faults:
        raise RecordError(faults)
    records = [record.warned(*(fault.text for fault in common)) for record in records]
    return constant_inputs_once(records, may_be_constant)


def _never_recorded(records: Sequence[Record], columns: Mapping[str, str], defaults: Mapping[str, float]) -> list[str]:
    """Find columns with a default that no file has."""
    return [
        f"no recording has the column '{columns[key]}': name one that exists, or leave '{key}' out"
        for key in defaults
        if records and all(_absent(columns[key], defaults[key]) in each.log for each in records)
    ]


def _absent(column: str, value: float) -> str:
    return f"{column}: not in the file, taken as {value:g} throughout"


def _stem(path: Path) -> str:
    return next((path.name[: -len(e)] for e in reversed(FORMATS) if path.name.lower().endswith(e)), path.stem)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [_stem(path) for path in paths]
    if len(set(stems)) < len(stems):
        stems = [f"{path.parent.name}/{path.name}" for path in paths]
    return stems


@dataclass
class _File:
    """The way of one file from the disk to its records."""

    path: Path
    name: str
    time: str
    columns: Mapping[str, str]
    units: Mapping[str, str]
    measured: Mapping[str, str]
    rules: ReadRules
    defaults: Mapping[str, float] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def read(self) -> list[Record]:
        file, trip = self.path.name, self.rules.trip
        optional = {self.columns[key] for key in self.defaults}
        table = read_table(self.path, [self.time, *self.columns.values()], [trip] if trip else [], optional)
        self.log += table.log
        recorded = {key: column for key, column in self.columns.items() if column in table.numbers}
        time, time_unit = self._converted(table.numbers[self.time], self.time, "s", self.rules.time_unit)
        signals = {}
        for key, column in recorded.items():
            values, unit = self._converted(
                table.numbers[column], column, self.units.get(key), self.measured.get(key)
            )
            signals[key] = Signal(values, self.units.get(key, si_unit_of(unit)), column, unit)
        rows = table.rows
        if len(time) < 2:
            self.faults.append(
                f"{file}: only one row of data ({rows.word} {rows.numbers[0]}): record a longer time"
            )
        self._stop_at_faults()
        inside = self._window(time)
        self._stop_at_faults()
        keep = np.flatnonzero(inside)
        keep = keep[
            self._finite_rows(time[keep], {k: s.values[keep] for k, s in signals.items()}, rows.take(keep))
        ]
        self._stop_at_faults()
        rows, time = rows.take(keep), time[keep]
        signals = {key: replace(each, values=each.values[keep]) for key, each in signals.items()}
        for each in signals.values():
            self.warnings += [f.text for f in check_values(file, each.column, each.values, rows)]
        as_written = {key: (column, table.numbers[column][keep]) for key, column in recorded.items()}
        in_si = {key: (each.column, each.values) for key, each in signals.items()}
        copies = check_copies(file, as_written) + check_copies(file, in_si)
        self.faults += dict.fromkeys(fault.text for fault in copies)
        for key, column in self.columns.items():
            if key not in recorded:
                unit = self.units.get(key, "")
                signals[key] = Signal(np.full(len(time), float(self.defaults[key])), unit, column, unit)
                self.log.append(_absent(column, self.defaults[key]))
        if time_unit != "s":
            self.log.append(f"{self.time}: {time_unit} to s")
        parts = []
        labels = table.labels[trip][keep] if trip else None
        for label, part in self._trips(labels, len(time)):
            parts += self._even_parts(label, time[part], signals, part, rows.take(part))
        self._stop_at_faults()
        return [each.warned(*self.warnings) for each in parts]

    def _stop_at_faults(self) -> None:
        if self.faults:
            raise RecordError(self.faults)

    def _converted(
        self, numbers: np.ndarray, column: str, expected: str | None, measured: str | None
    ) -> tuple[np.ndarray, str]:
        """Numbers in the expected unit, and the unit that they had."""
        file = self.path.name
        try:
            if measured is None:
                unit = read_column_name(column, expected).unit
                if unit is None:
                    unit = expected or ""
                    taken = (
                        f"taken as {expected or 'without dimension'}"
                        if expected is not None
                        else "taken as they are"
                    )
                    self.log.append(f"{column}: names no unit, numbers {taken}")
            else:
                unit = read_column_name(f"x [{measured}]", expected).unit or ""
                self.log.append(f"{column}: {unit or 'without dimension'}, as the study says")
            target = si_unit_of(unit) if expected is None else expected
            values = to_si(numbers, unit, target)
        except UnitError as error:
            self.faults.append(
                f"{file}, column '{column}': {error}"
                + (f"; '{expected}' is asked for" if expected and f"'{expected}'" not in str(error) else "")
                + '; name another column or say its unit with unit = "…"'
            )
            return numbers, ""
        if unit != target and column != self.time:
            self.log.append(f"{column}: {unit} to {target or 'a plain number'}")
        return values, unit

    def _window(self, time: np.ndarray) -> np.ndarray:
        """Rows inside the window; rows without a time stamp stay, so that they are told."""
        start, stop = self.rules.start, self.rules.stop
        # As in Preparation: a stamp that was summed to 0.30000000000000004 is inside stop = 0.3.
        steps = np.abs(np.diff(time))
        steps = steps[np.isfinite(steps)]
        slack = 1e-6 * float(np.median(steps)) if len(steps) else 0.0
        low = -np.inf if start is None else start - slack
        high = np.inf if stop is None else stop + slack
        outside = (time < low) | (time > high)
        if outside.any():
            if (~outside).sum() < 2:
                self.faults.append(
                    f"{self.path.name}: fewer than two rows between start and stop: time in column "
                    f"'{self.time}' runs from {np.nanmin(time):.6g} to {np.nanmax(time):.6g} s: change "
                    "start and stop in [records]"
                )
            self.log.append(f"left out {int(outside.sum())} rows outside the window given by start and stop")
        return ~outside

    def _finite_rows(self, time: np.ndarray, values: Mapping[str, np.ndarray], rows: Rows) -> np.ndarray:
        file = self.path.name
        keep = np.isfinite(time)
        faults = check_finite(file, self.time, time, rows)
        for key, each in values.items():
            keep &= np.isfinite(each)
            faults += check_finite(file, self.columns[key], each, rows)
        if faults and (not self.rules.drop_nan or keep.sum() < 2):
            self.faults += [fault.text for fault in faults]
        elif faults:
            self.log.append(
                f"left out {rows.say(~keep)} with missing or infinite values, {1 - keep.mean():.3%} of all"
            )
        return keep

    def _trips(self, labels: np.ndarray | None, count: int) -> list[tuple[str, np.ndarray]]:
        """Runs of equal labels; a label that returns later starts a further trip."""
        if labels is None:
            return [("", np.arange(count))]
        starts = np.concatenate(([0], np.flatnonzero(labels[1:] != labels[:-1]) + 1, [count]))
        seen: dict[str, int] = {}
        trips = []
        for start, stop in itertools.pairwise(starts):
            label = str(labels[start])
            seen[label] = seen.get(label, 0) + 1
            again = "" if seen[label] == 1 else f", {seen[label]}"
            trips.append((f"[{label}{again}]", np.arange(start, stop)))
        self.log.append(f"{len(trips)} trips after column '{self.rules.trip}'")
        return trips

    def _even_parts(
        self, label: str, time: np.ndarray, signals: Mapping[str, Signal], index: np.ndarray, rows: Rows
    ) -> list[Record]:
        """Cut one trip at its gaps and bring every part to even sampling, as far as the rules allow it."""
        file = f"{self.path.name}{', trip ' + label if label else ''}"
        log = list(self.log)
        if self.rules.drop_duplicates and len(time) > 1:
            fresh = np.append(True, np.diff(time) != 0.0)
            if not fresh.all():
                log.append(f"left out {rows.say(~fresh)} with the time stamp of the row before")
                time, index, rows = time[fresh], index[fresh], rows.take(fresh)
        if len(time) < 2:
            self.faults.append(
                f"{file}: one row only, {rows.word} {rows.numbers[0]}: check the column of trips"
            )
            return []
        if wrong := check_time_order(file, self.time, time, rows):
            self.faults += [fault.text for fault in wrong]
            return []
        gaps = np.flatnonzero(gap_steps(time, self.rules.longest_gap))
        if len(gaps) and self.rules.gaps == "refuse":
            worst = gaps[np.argmax(np.diff(time)[gaps])]
            where = np.isin(np.arange(len(time)), gaps)
            self.faults.append(
                f"{file}, column '{self.time}': gaps after {rows.say(where)}, the longest "
                f"{np.diff(time)[worst]:.4g} s after {rows.word} {rows.numbers[worst]} (usual step "
                f"{np.median(np.diff(time)):.4g} s): cut the file "
                'there with gaps = "split", or bridge them with longest_gap = … (s) and resample = … (Hz) '
                "in [records]"
            )
            return []
        records: list[Record] = []
        bounds = np.concatenate(([0], gaps + 1, [len(time)]))
        short = [b - a for a, b in itertools.pairwise(bounds) if len(gaps) and b - a < _SHORTEST_PART]
        if short:
            self.warnings.append(
                f"{file}: left out {len(short)} parts between gaps ({sum(short)} rows): too short"
            )
        parts = [(a, b) for a, b in itertools.pairwise(bounds) if not len(gaps) or b - a >= _SHORTEST_PART]
        if not parts:
            self.faults.append(f"{file}: every part between two gaps is shorter than {_SHORTEST_PART} rows")
        for number, (start, stop) in enumerate(parts, 1):
            inside = slice(start, stop)
            values = {key: replace(each, values=each.values[index[inside]]) for key, each in signals.items()}
            name = f"{self.name}{label}" + (f" part {number}" if len(parts) > 1 else "")
            cut = [f"cut at {len(gaps)} gaps"] if len(gaps) else []
            record = Record(name, self.path, time[inside], values, (*log, *cut))
            if (even := self._even(file, record, rows.take(inside))) is not None:
                records.append(even)
        return records

    def _even(self, file: str, record: Record, rows: Rows) -> Record | None:
        deviation = grid_deviation(record.time)
        if self.rules.resample is None:
            if deviation > GRID_TOLERANCE:
                step = np.diff(record.time)
                worst = int(np.argmax(np.abs(step / np.median(step) - 1.0)))
                self.faults.append(
                    f"{file}, column '{self.time}': irregular sampling, stamps up to "
                    f"{100 * deviation:.3g} % of a step off an even grid (steps {step.min():.4g} to "
                    f"{step.max():.4g} s, the oddest after {rows.word} {rows.numbers[worst]}): allow "
                    f"interpolation with resample = {record.rate:.4g} (Hz) in [records]"
                )
                return None
            jitter = f"time stamps up to {100 * deviation:.2g} % of a step off an even grid"
            return record.noted(jitter) if deviation > 1e-3 else record
        rate = self.rules.resample
        if rate < 0.5 * record.rate:
            self.faults.append(
                f"{file}: resample = {rate:g} Hz is below half the rate of the file ({record.rate:.4g} "
                "Hz) and would fold vibration into low frequencies: resample at the file's rate and use "
                "decimate"
            )
            return None
        if deviation < 1e-6 and abs(record.rate / rate - 1.0) < 1e-9:
            return record
        even = record.time[0] + np.arange(int(np.floor(record.duration * rate + 1e-9)) + 1) / rate
        signals = {
            key: replace(each, values=np.interp(even, record.time, each.values))
            for key, each in record.signals.items()
        }
        line = f"interpolated linearly from about {record.rate:.4g} Hz to {rate:g} Hz"
        done = replace(record, time=even, signals=signals).noted(line)
        if rate < 0.999 * record.rate:
            done = done.warned(
                f"{file}: resampled below its own rate of {record.rate:.4g} Hz without a filter"
            )
        return done
