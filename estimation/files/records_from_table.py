"""Records from the table of one file: units, window, missing values, trips, gaps and even sampling."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.files.bounded import SHARE
from estimation.files.column_names import read_column_name, si_unit_of, to_si
from estimation.files.dates import CALENDAR_FROM, calendar_text
from estimation.files.faults import RecordError, Rows
from estimation.files.read_rules import ReadRules
from estimation.files.record import Record, RecordedSignal
from estimation.files.record_checks import (
    GRID_TOLERANCE,
    check_copies,
    check_finite,
    check_time_order,
    check_values,
    gap_steps,
    grid_deviation,
)
from estimation.files.table import FileTable
from multibody.base.memory_of_process import machine_memory
from multibody.base.quantity_text import count_text
from multibody.base.units import UnitError

__all__ = ["absence_note", "records_from_table"]

SHORTEST_PART = 10
"""Rows; a part between two gaps that is shorter is left out."""


def records_from_table(
    table: FileTable,
    *,
    name: str,
    time: str,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    measured_units: Mapping[str, str],
    rules: ReadRules,
    defaults: Mapping[str, float],
    driven: Collection[str] = (),
) -> list[Record]:
    """Return the records of one table, in the order of its rows: several where it holds trips or is cut at gaps.

    Parameters
    ----------
    table : FileTable
        With the columns of time and signals, and the trip column of ``rules`` as a label.
    name : str
        Name of the record; trips and parts are named after it.
    time, columns, units, measured_units, rules, defaults, driven
        As for `estimation.files.read_records.read_records`.

    Raises
    ------
    RecordError
        With one sentence for each fault.
    """
    return _Conversion(
        table=table,
        name=name,
        time=time,
        columns=columns,
        units=units,
        measured_units=measured_units,
        rules=rules,
        defaults=defaults,
        driven=driven,
    ).records()


def absence_note(column: str, value: float) -> str:
    """Return the line in the log of a record whose file lacks a column with a default."""
    return f"{column}: not in the file, taken as {value:g} throughout"


@dataclass(kw_only=True)
class _Conversion:
    """The conversion of one table, with the log, warnings and faults that it collects."""

    table: FileTable
    name: str
    time: str
    columns: Mapping[str, str]
    units: Mapping[str, str]
    measured_units: Mapping[str, str]
    rules: ReadRules
    defaults: Mapping[str, float]
    driven: Collection[str] = ()
    log: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    origin: int | None = None

    @property
    def file(self) -> str:
        return self.table.path.name

    def records(self) -> list[Record]:
        table, trip = self.table, self.rules.trip
        self.log += table.log
        recorded = {key: column for key, column in self.columns.items() if column in table.numbers}
        time, time_unit = self._time(table.numbers[self.time])
        signals = {}
        for key, column in recorded.items():
            values, unit = self._converted(
                table.numbers[column], column, self.units.get(key), self.measured_units.get(key)
            )
            signals[key] = RecordedSignal(
                values=values,
                unit=self.units.get(key, si_unit_of(unit)),
                column=column,
                measured_unit=unit,
                file=self.file,
            )
        rows = table.rows
        if len(time) < 2:
            self.faults.append(
                f"{self.file}: only one row of data ({rows.word} {rows.numbers[0]}): record a longer time, or name a "
                "longer recording"
            )
        self._stop_at_faults()
        inside = self._window(time)
        self._stop_at_faults()
        if not inside.all():
            time, rows = time[inside], rows.take(inside)
            signals = {key: replace(signal, values=signal.values[inside]) for key, signal in signals.items()}
        keep = np.flatnonzero(inside)
        finite = self._finite_rows(time, {k: s.values for k, s in signals.items()}, rows)
        self._stop_at_faults()
        if not finite.all():
            time, rows, keep = time[finite], rows.take(finite), keep[finite]
            signals = {key: replace(signal, values=signal.values[finite]) for key, signal in signals.items()}
        commands = {self.columns[key] for key in self.driven if key in self.columns}
        for signal in signals.values():
            faults = check_values(self.file, signal.column, signal.values, rows, command=signal.column in commands)
            self.warnings += [f.text for f in faults]
        as_written = {
            key: (column, table.numbers[column][keep] if len(keep) < len(inside) else table.numbers[column])
            for key, column in recorded.items()
        }
        in_si = {key: (signal.column, signal.values) for key, signal in signals.items()}
        copies = check_copies(self.file, as_written) + check_copies(self.file, in_si)
        self.faults += dict.fromkeys(fault.text for fault in copies)
        for key, column in self.columns.items():
            if key not in recorded:
                unit = self.units.get(key, "")
                steady = np.full(len(time), float(self.defaults[key]))
                signals[key] = RecordedSignal(
                    values=steady, unit=unit, column=column, measured_unit=unit, file=self.file
                )
                self.log.append(absence_note(column, self.defaults[key]))
        if time_unit not in ("s", ""):
            self.log.append(f"{self.time}: {time_unit} to s")
        parts = []
        labels = table.labels[trip][keep] if trip else None
        for label, part in self._trips(labels, len(time)):
            parts += self._even_parts(label, time[part], signals, part, rows.take(part))
        self._stop_at_faults()
        return [record.warned(*self.warnings) for record in parts]

    def _stop_at_faults(self) -> None:
        if self.faults:
            raise RecordError(self.faults)

    def _time(self, numbers: np.ndarray) -> tuple[np.ndarray, str]:
        """Return the time in s, and its unit in the file; a calendar time is shifted to begin at zero."""
        if self.time in self.table.origins:
            self.origin = self.table.origins[self.time]
            return numbers, "s"
        time, unit = self._converted(numbers, self.time, "s", self.rules.time_unit)
        known = np.flatnonzero(np.isfinite(time))
        if self.faults or not known.size or abs(time[known[0]]) < CALENDAR_FROM:
            return time, unit
        self.origin = round(float(time[known[0]]) * 1e9)
        self.log.append(f"{self.time}: calendar time, shifted to begin at 0, which is {calendar_text(self.origin)}")
        return to_si(numbers - numbers[known[0]], unit, "s"), unit

    def _converted(
        self, numbers: np.ndarray, column: str, expected: str | None, measured: str | None
    ) -> tuple[np.ndarray, str]:
        """Return numbers in the expected unit, and the unit that they had."""
        try:
            stated = self.table.units.get(column)
            if measured is None and stated is not None:
                unit = read_column_name(f"x [{stated}]", expected).unit or ""
                self.log.append(f"{column}: {unit or 'without dimension'}, as the file says")
            elif measured is None:
                named = read_column_name(column, expected).unit
                unit = named or ""
                if named is None:
                    unit = expected or ""
                    taken = (
                        f"taken as {expected or 'without dimension'}" if expected is not None else "taken as they are"
                    )
                    self.log.append(f"{column}: names no unit, numbers {taken}")
            else:
                unit = read_column_name(f"x [{measured}]", expected).unit or ""
                self.log.append(f"{column}: {unit or 'without dimension'}, as the study says")
            target = si_unit_of(unit) if expected is None else expected
            values = to_si(numbers, unit, target)
        except UnitError as error:
            self.faults.append(
                f"{self.file}, column '{column}': {error}"
                + (f"; '{expected}' is expected" if expected and f"'{expected}'" not in str(error) else "")
                + '; name another column or say its unit with unit = "…"'
            )
            return numbers, ""
        if unit != target and column != self.time:
            self.log.append(f"{column}: {unit} to {target or 'a plain number'}")
        return values, unit

    def _window(self, time: np.ndarray) -> np.ndarray:
        """Return which rows are inside the window; rows without a time stamp stay, for a later check to report."""
        start, stop = self.rules.start, self.rules.stop
        # As in Preparation: a stamp that was summed to 0.30000000000000004 is inside stop = 0.3.
        steps = np.abs(np.diff(time))
        steps = steps[np.isfinite(steps)]
        slack = 1e-6 * float(np.median(steps)) if len(steps) else 0.0
        low = -np.inf if start is None else start - slack
        high = np.inf if stop is None else stop + slack
        outside = np.isfinite(time) & ((time < low) | (time > high))
        if outside.any():
            if (~outside).sum() < 2:
                self.faults.append(
                    f"{self.file}: fewer than two rows between start and stop: time in column "
                    f"'{self.time}' runs from {np.nanmin(time):.6g} to {np.nanmax(time):.6g} s: change "
                    "start and stop in [records]"
                )
            self.log.append(
                f"left out {count_text(int(outside.sum()), 'row')} outside the window given by start and stop"
            )
        return ~outside

    def _finite_rows(self, time: np.ndarray, values: Mapping[str, np.ndarray], rows: Rows) -> np.ndarray:
        keep = np.isfinite(time)
        faults = check_finite(self.file, self.time, time, rows)
        for key, column in values.items():
            keep &= np.isfinite(column)
            faults += check_finite(self.file, self.columns[key], column, rows)
        if faults and (not self.rules.drop_nan or keep.sum() < 2):
            self.faults += [fault.text for fault in faults]
        elif faults:
            self.log.append(f"left out {rows.say(~keep)} with missing or infinite values, {1 - keep.mean():.3%} of all")
        return keep

    def _trips(self, labels: np.ndarray | None, count: int) -> list[tuple[str, np.ndarray]]:
        """Return the rows of each run of equal labels; a label that returns later starts another trip."""
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
        self.log.append(f"{count_text(len(trips), 'trip')} after column '{self.rules.trip}'")
        return trips

    def _even_parts(
        self, label: str, time: np.ndarray, signals: Mapping[str, RecordedSignal], index: np.ndarray, rows: Rows
    ) -> list[Record]:
        """Cut one trip at its gaps and resample every part evenly, as far as the rules allow it."""
        file = f"{self.file}{', trip ' + label if label else ''}"
        log, count = list(self.log), len(next(iter(signals.values())).values) if signals else -1
        if self.rules.drop_duplicates and len(time) > 1:
            fresh = np.append(True, np.diff(time) != 0.0)
            if not fresh.all():
                log.append(f"left out {rows.say(~fresh)} with the time stamp of the row before")
                time, index, rows = time[fresh], index[fresh], rows.take(fresh)
        if len(time) < 2:
            self.faults.append(f"{file}: one row only, {rows.word} {rows.numbers[0]}: check the column of trips")
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
        short = [b - a for a, b in itertools.pairwise(bounds) if len(gaps) and b - a < SHORTEST_PART]
        if short:
            self.warnings.append(
                f"{file}: left out {count_text(len(short), 'part')} between gaps "
                f"({count_text(sum(short), 'row')}): too short"
            )
        parts = [(a, b) for a, b in itertools.pairwise(bounds) if not len(gaps) or b - a >= SHORTEST_PART]
        if not parts:
            self.faults.append(f"{file}: every part between two gaps is shorter than {SHORTEST_PART} rows")
        for number, (start, stop) in enumerate(parts, 1):
            inside = slice(start, stop)
            whole = len(index) == count and stop - start == count
            at = slice(None) if whole else index[inside]
            values = {key: replace(s, values=s.values[at]) for key, s in signals.items()}
            name = f"{self.name}{label}" + (f" part {number}" if len(parts) > 1 else "")
            cut = [f"cut at {count_text(len(gaps), 'gap')}"] if len(gaps) else []
            record = Record(
                name=name,
                path=self.table.path,
                time=time[inside],
                signals=values,
                log=(*log, *cut),
                origin=self.origin,
            )
            if (even := self._even(file, record, rows.take(inside))) is not None:
                records.append(even)
        return records

    def _even(self, file: str, record: Record, rows: Rows) -> Record | None:
        deviation = grid_deviation(record.time)
        if self.rules.resample is None:
            if deviation > GRID_TOLERANCE and self.rules.uneven == "own instants":
                return record
            if deviation > GRID_TOLERANCE:
                step = np.diff(record.time)
                worst = int(np.argmax(np.abs(step / np.median(step) - 1.0)))
                self.faults.append(
                    f"{file}, column '{self.time}': irregular sampling, stamps up to "
                    f"{100 * deviation:.3g} % of a step off an even grid (steps {step.min():.4g} to "
                    f"{step.max():.4g} s, the oddest after {rows.word} {rows.numbers[worst]}): allow "
                    f"interpolation with resample = {record.rate:.4g} (Hz) in [records], or compare each output at its "
                    'own instants with uneven = "own instants"'
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
        samples = record.duration * rate
        needed, have = 8.0 * samples * (1 + len(record.signals)), SHARE * machine_memory()
        if needed > have:
            self.faults.append(
                f"{file}: resample = {rate:g} Hz would make {samples:.3g} samples of {record.duration:.3g} s, "
                f"{needed / 1e9:.3g} GB: the file has {record.rate:.4g} Hz, choose a rate near it"
            )
            return None
        even = record.time[0] + np.arange(int(np.floor(record.duration * rate + 1e-9)) + 1) / rate
        signals = {
            key: replace(signal, values=np.interp(even, record.time, signal.values))
            for key, signal in record.signals.items()
        }
        line = f"interpolated linearly from about {record.rate:.4g} Hz to {rate:g} Hz"
        done = replace(record, time=even, signals=signals).noted(line)
        if rate < 0.999 * record.rate:
            done = done.warned(f"{file}: resampled below its own rate of {record.rate:.4g} Hz without a filter")
        return done
