"""Reading measurement files into records; one error lists all faults of all files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from estimation.files.faults import RecordError
from estimation.files.read_rules import ReadRules
from estimation.files.read_table import READERS, read_table
from estimation.files.record import Record
from estimation.files.record_checks import check_same_scale, constant_inputs_once
from estimation.files.records_from_table import absence_note, records_from_table

__all__ = ["read_record", "read_records"]


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
    records = read_records(
        [path],
        time=time,
        columns=columns,
        units=units,
        measured_units=measured_units,
        rules=rules,
        names=None if name is None else [name],
        may_be_constant=tuple(columns),
    )
    if len(records) != 1:
        raise RecordError([f"{Path(path).name}: holds {len(records)} records: read it with read_records"])
    return records[0]


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
    """Read files into records; one error lists all faults of all files.

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
    trips = [rules.trip] if rules.trip else []
    optional = {columns[key] for key in defaults or {}}
    for path, label in zip(paths, labels, strict=True):
        try:
            table = read_table(path, [time, *columns.values()], trips, optional)
            records += records_from_table(
                table,
                name=label,
                time=time,
                columns=columns,
                units=units or {},
                measured_units=measured_units or {},
                rules=rules,
                defaults=defaults or {},
            )
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
        if records and all(absence_note(columns[key], defaults[key]) in record.log for record in records)
    ]


def _stem(path: Path) -> str:
    return next((path.name[: -len(e)] for e in reversed(READERS) if path.name.lower().endswith(e)), path.stem)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [_stem(path) for path in paths]
    if len(set(stems)) < len(stems):
        stems = [f"{path.parent.name}/{path.name}" for path in paths]
    return stems
