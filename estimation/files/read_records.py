"""Reading measurement files into records; one error lists all faults of all files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path

from estimation.files.combine import combine
from estimation.files.faults import RecordError
from estimation.files.read_rules import ReadRules
from estimation.files.read_table import OWN_TIMES, READERS, read_table
from estimation.files.record import Record
from estimation.files.record_checks import GRID_TOLERANCE, check_same_scale, constant_inputs_once, grid_deviation
from estimation.files.records_from_table import absence_note, records_from_table
from estimation.files.table import FileTable, TableRequest
from estimation.files.time_bases import OWN_TIME, tables_by_time
from multibody.base.spelling import nearest_or_choices

__all__ = ["read_record", "read_records"]


def read_record(
    path: str | Path | Sequence[str | Path],
    *,
    time: str | Mapping[str, str] = "",
    columns: Mapping[str, str],
    units: Mapping[str, str] | None = None,
    measured_units: Mapping[str, str] | None = None,
    rules: ReadRules | None = None,
    name: str | None = None,
    driven: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    clocks: Mapping[str, float] | None = None,
) -> Record:
    """Read one file, or the files of several loggers, as one record.

    Parameters are those of :func:`read_records`.

    Raises
    ------
    RecordError
        If the file has faults, or holds more than one record (trips, or parts between gaps).
    """
    records = read_records(
        [path],
        time=time,
        columns=columns,
        units=units,
        measured_units=measured_units,
        rules=rules,
        names=None if name is None else [name],
        may_be_constant=tuple(columns),
        driven=driven,
        files=files,
        clocks=clocks,
    )
    if len(records) != 1:
        first = path if isinstance(path, str | Path) else path[0]
        raise RecordError([f"{Path(first).name}: holds {len(records)} records: read it with read_records"])
    return records[0]


def read_records(
    paths: Sequence[str | Path | Sequence[str | Path]],
    *,
    time: str | Mapping[str, str] = "",
    columns: Mapping[str, str],
    units: Mapping[str, str] | None = None,
    measured_units: Mapping[str, str] | None = None,
    rules: ReadRules | None = None,
    names: Sequence[str] | None = None,
    may_be_constant: Collection[str] = (),
    defaults: Mapping[str, float] | None = None,
    driven: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    clocks: Mapping[str, float] | None = None,
    record_clocks: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[Record, ...]:
    """Read files into records; one error lists all faults of all files.

    Parameters
    ----------
    paths : sequence of (str or Path, or a sequence of these)
        Measurement files; several in an inner sequence are the loggers of one record.
    time : str or mapping of str to str
        Name of the time column, in any unit of time, or its name for each pattern of file names.  Formats whose
        channels have times of their own need none.
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
    driven : mapping of str to {"linear", "hold"}, optional
        Signals that drive a model, and what they do between samples: with a rate of their own they are interpolated
        onto the record's grid, while others keep their own instants.
    files : mapping of str to str, optional
        Signal name to the pattern of the file names that its column stands in, where several loggers of a record have
        a column of that name.
    clocks : mapping of str to float, optional, s
        Pattern of file names to what is added to their time.
    record_clocks : mapping of str to mapping of str to float, optional, s
        Name of a record to what is added besides in this record alone, for patterns of ``clocks``.

    Returns
    -------
    tuple of Record
        In the order of the files, trips in the order of the file.

    Raises
    ------
    RecordError
        With one sentence for each fault of all files.
    """
    sources = [(Path(each),) if isinstance(each, str | Path) else tuple(Path(p) for p in each) for each in paths]
    labels = list(names) if names is not None else _unique_names([source[0] for source in sources])
    reading = _Reading(
        time={"*": time} if isinstance(time, str) else dict(time),
        columns=columns,
        units=units or {},
        measured_units=measured_units or {},
        rules=rules or ReadRules(),
        defaults=defaults or {},
        driven=driven or {},
        files=files or {},
        clocks=clocks or {},
        record_clocks=record_clocks or {},
    )
    records: list[Record] = []
    faults: list[str] = []
    for source, label in zip(sources, labels, strict=True):
        try:
            records += reading.records(source, label)
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


@dataclass(frozen=True, kw_only=True)
class _Reading:
    """How every source is read: the arguments of `read_records`."""

    time: Mapping[str, str]
    columns: Mapping[str, str]
    units: Mapping[str, str]
    measured_units: Mapping[str, str]
    rules: ReadRules
    defaults: Mapping[str, float]
    driven: Mapping[str, str]
    files: Mapping[str, str]
    clocks: Mapping[str, float]
    record_clocks: Mapping[str, Mapping[str, float]]

    def records(self, source: Sequence[Path], label: str) -> list[Record]:
        """Return the records of one source: a file, or the files of several loggers."""
        tables = self._tables(source)
        several = len(tables) > 1
        # Parts need not be even: only the grid of the fastest must.
        rules = replace(self.rules, uneven="own instants", resample=None) if several else self.rules
        parts = []
        for table, time, columns in tables:
            made = records_from_table(
                table,
                name=label,
                time=time,
                columns=columns,
                units=self.units,
                measured_units=self.measured_units,
                rules=rules,
                defaults=self.defaults,
                driven=self.driven,
            )
            parts.append(made)
        if not several:
            uneven = [grid_deviation(r.time) > GRID_TOLERANCE for r in parts[0]]
            return [
                combine([r], r.name, self.driven, self._offsets(source, r.name)) if bad else r
                for r, bad in zip(parts[0], uneven, strict=True)
            ]
        if len({tuple(r.name for r in made) for made in parts}) > 1:
            listed = "; ".join(
                f"{t.path.name} ({', '.join(c.values())}): {len(made)}"
                for (t, _, c), made in zip(tables, parts, strict=True)
            )
            raise RecordError(
                [f"{label}: its parts are cut into different numbers of records: {listed}: cut the files themselves"]
            )
        return [
            combine(same, same[0].name, self.driven, self._offsets(source, same[0].name))
            for same in zip(*parts, strict=True)
        ]

    def _offsets(self, source: Sequence[Path], record: str) -> dict[str, float]:
        """Return what is added to the time of each file of a record."""
        besides = self.record_clocks.get(record, {})
        return {
            p.name: offset + besides.get(pattern, 0.0)
            for p in source
            for pattern, offset in self.clocks.items()
            if fnmatch(p.name, pattern)
        }

    def _tables(self, source: Sequence[Path]) -> list[tuple[FileTable, str, dict[str, str]]]:
        """Return the table of each time base of a source, its time column, and its signals."""
        faults: list[str] = []
        read: list[tuple[FileTable, str]] = []
        trips = (self.rules.trip,) if self.rules.trip else ()
        optional = {self.columns[key] for key in self.defaults}
        for path in source:
            time = next((t for pattern, t in self.time.items() if fnmatch(path.name, pattern)), "")
            own = path.name.lower().endswith(OWN_TIMES)
            if not time and not own:
                faults.append(f'{path.name}: which column is the time? Say time = "…" in [records]')
                continue
            wanted = [c for key, c in self.columns.items() if fnmatch(path.name, self.files.get(key, "*"))]
            request = TableRequest(
                columns=tuple(dict.fromkeys([*([time] if time else []), *wanted])),
                labels=trips,
                optional=frozenset(wanted if len(source) > 1 else optional),
                skip_rows=self.rules.skip_rows,
                time_format=self.rules.time_format,
                time_zone=self.rules.time_zone,
                time=time,
            )
            try:
                read.append((read_table(path, request), time))
            except RecordError as error:
                faults += error.faults
        if faults:
            raise RecordError(faults)
        place: dict[str, int] = {}
        for key, column in self.columns.items():
            having = [
                k
                for k, (table, _) in enumerate(read)
                if column in table.numbers and fnmatch(table.path.name, self.files.get(key, "*"))
            ]
            if len(having) > 1:
                names = [read[k][0].path.name for k in having]
                faults.append(
                    f"column '{column}' stands in {', '.join(names)}: say which is meant with file = \"{names[0]}\" "
                    f"beside column, for '{key}'"
                )
            elif not having and key not in self.defaults:
                every = [name for table, _ in read for name in table.names]
                listed = ", ".join(table.path.name for table, _ in read)
                faults.append(f"{listed}: there is no column '{column}'{nearest_or_choices(column, every)}")
            place[key] = having[0] if having else 0
        if faults:
            raise RecordError(faults)
        tables: list[tuple[FileTable, str, dict[str, str]]] = []
        for k, (table, time) in enumerate(read):
            own_signals = {key: c for key, c in self.columns.items() if place[key] == k}
            for n, part in enumerate(tables_by_time(table, time, list(own_signals.values()))):
                columns = {
                    key: c for key, c in own_signals.items() if c in part.numbers or (n == 0 and c not in table.numbers)
                }
                if columns:
                    tables.append((part, time or OWN_TIME, columns))
        return tables


def _never_recorded(records: Sequence[Record], columns: Mapping[str, str], defaults: Mapping[str, float]) -> list[str]:
    """Find columns with a default that no file has."""
    return [
        f"no recording has the column '{columns[key]}': name one that exists, or leave '{key}' out"
        for key in defaults
        if records and all(absence_note(columns[key], defaults[key]) in record.log for record in records)
    ]


def _stem(path: Path) -> str:
    return next((path.name[: -len(e)] for e in reversed(READERS) if path.name.lower().endswith(e)), path.stem)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [_stem(path) for path in paths]
    if len(set(stems)) < len(stems):
        stems = [f"{path.parent.name}/{path.name}" for path in paths]
    return stems
