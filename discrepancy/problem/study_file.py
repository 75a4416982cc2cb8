"""The study file: which model is compared with which recordings, and what may be changed for that."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discrepancy.problem.paths import find_files, held_out_faults
from discrepancy.problem.start_states import expression_fault
from discrepancy.problem.tables import (
    BY_RECORD,
    FEWEST_ROWS,
    CandidatesTable,
    ClockTable,
    Column,
    ConnectionTable,
    InitialTable,
    ModelTable,
    OffsetsTable,
    RecordsTable,
    StartValue,
    StudyTable,
    Uncertain,
    flatten,
    read_struct,
)
from estimation.response.experiment import FittedClock
from estimation.signals.preparation import Preparation, SignalError
from multibody.base.missing_file import why_no_file
from multibody.base.spelling import nearest_or_choices

if TYPE_CHECKING:
    from estimation.files.read_rules import ReadRules
    from estimation.files.record import Record

__all__ = ["StudyError", "StudyFile", "read_study"]

_TABLES = (
    "model",
    "uncertain",
    "inputs",
    "outputs",
    "records",
    "candidates",
    "study",
    "initial",
    "offsets",
    "connections",
    "clocks",
)
#: A start value beyond this is none: no machine is there in any unit.
LARGEST_START = 1e100
#: Tables that another command reads from the same file, and checks itself.
_OF_OTHERS = ("updating", "follow", "alarms")


class StudyError(ValueError):
    """A study is refused; ``faults`` holds one sentence for each fault."""

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults: tuple[str, ...] = tuple(dict.fromkeys(faults))
        count = len(self.faults)
        head = "" if count == 1 else f"{count} faults in the study:\n  - "
        super().__init__(head + "\n  - ".join(self.faults))


@dataclass(frozen=True)
class StudyRecords:
    """The records of a study.

    Attributes
    ----------
    identify : tuple of Record
        For fitting and choosing.
    validate : tuple of Record
        Never used for either.
    """

    identify: tuple[Record, ...]
    validate: tuple[Record, ...]


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """The content of a study file, checked as far as that is possible without the model.

    Attributes
    ----------
    path : Path
        The study file.
    model : ModelTable
        Where the model comes from.
    uncertain : mapping of str to Uncertain
        Parameters that calibration may move.
    inputs, outputs : mapping of str to Column
        Model input or output to measured column.
    records : RecordsTable
        How recordings are read and prepared.
    identify, validate : tuple of Path
        The recordings' files, patterns resolved, in a stable order.
    candidates, study, initial, offsets
        The tables of these names.
    warnings : tuple of str
        What is allowed but weakens the result.
    connections : mapping of str to ConnectionTable
        Where an FMU can take forces.
    joined : tuple of tuple of Path
        Files that make one record together; each is in ``identify`` or ``validate`` too.
    clocks : mapping of str to ClockTable
        Pattern of file names to their clock.
    """

    path: Path
    model: ModelTable
    uncertain: Mapping[str, Uncertain]
    inputs: Mapping[str, Column]
    outputs: Mapping[str, Column]
    records: RecordsTable
    identify: tuple[Path, ...]
    validate: tuple[Path, ...]
    candidates: CandidatesTable
    study: StudyTable
    initial: InitialTable
    offsets: OffsetsTable
    warnings: tuple[str, ...] = field(default=())
    connections: Mapping[str, ConnectionTable] = field(default_factory=dict)
    joined: tuple[tuple[Path, ...], ...] = ()
    clocks: Mapping[str, ClockTable] = field(default_factory=dict)

    @property
    def preparation(self) -> Preparation:
        """What is done to record and model alike before they are compared."""
        table = self.records
        return Preparation(
            start=table.start, stop=table.stop, low_pass_hz=table.low_pass_hz, decimate=table.decimate, edge=table.edge
        )

    @property
    def rules(self) -> ReadRules:
        """What the study allows to be done to its recordings."""
        from estimation.files.read_rules import ReadRules

        table = self.records
        return ReadRules(
            trip=table.trip,
            drop_nan=table.drop_nan,
            drop_duplicates=table.drop_duplicates,
            resample=table.resample,
            gaps=table.gaps,
            longest_gap=table.longest_gap,
            time_unit=table.time_unit,
            start=table.start,
            stop=table.stop,
            uneven=table.uneven,
            skip_rows=table.skip_rows,
            time_format=table.time_format,
            time_zone=table.time_zone,
        )

    def fitted_clocks(
        self, record: Record, offsets: Mapping[str, Mapping[str, float]] | None = None
    ) -> tuple[FittedClock, ...]:
        """Return the loggers of a record whose clocks are fitted.

        Parameters
        ----------
        record : Record
        offsets : mapping, optional
            What was given to `read_records`.

        Raises
        ------
        StudyError
            If inputs come from such a logger: its clock is then the one that the others are compared with.
        """
        besides = (offsets or {}).get(record.name, {})
        clocks, faults = [], []
        for pattern, clock in self.clocks.items():
            mine = [n for n, s in record.signals.items() if clock.fit and fnmatch(s.file, pattern)]
            if driving := [n for n in mine if n in self.inputs]:
                faults.append(
                    f'{self.path.name}, [clocks] "{pattern}": the inputs {", ".join(driving)} come from this logger: '
                    "give the pattern of the other loggers, whose clocks can be fitted"
                )
            elif mine:
                clocks.append(FittedClock(pattern, tuple(mine), clock.offset + besides.get(pattern, 0.0)))
        if faults:
            raise StudyError(faults)
        return tuple(clocks)

    def read_records(
        self, units: Mapping[str, str] | None = None, offsets: Mapping[str, Mapping[str, float]] | None = None
    ) -> StudyRecords:
        """Read all recordings; one error lists the faults of all files.

        Parameters
        ----------
        units : mapping of str to str, optional
            Model input or output to its SI unit.  A column that measures something else is refused.
        offsets : mapping of str to mapping of str to float, optional, s
            Name of a record to what is added to the time of its loggers besides `clocks`, by pattern.

        Raises
        ------
        estimation.RecordError
            With one sentence for each fault.
        """
        from estimation.files.read_records import read_records

        signals = {**self.inputs, **self.outputs}
        first = {files[0]: files for files in self.joined}
        others = {path for files in self.joined for path in files[1:]}
        records = read_records(
            [first.get(path, path) for path in (*self.identify, *self.validate) if path not in others],
            time=self.records.time,
            columns={name: each.column for name, each in signals.items()},
            units=None if units is None else {name: units[name] for name in signals if name in units},
            measured_units={name: each.unit for name, each in signals.items() if each.unit is not None},
            rules=self.rules,
            may_be_constant=tuple(self.inputs),
            defaults={name: each.default for name, each in self.inputs.items() if each.default is not None},
            driven={name: each.interpolation for name, each in self.inputs.items()},
            files={name: each.file for name, each in signals.items()},
            clocks={pattern: clock.offset for pattern, clock in self.clocks.items()},
            record_clocks=offsets,
        )
        held_out = set(self.validate)
        return StudyRecords(
            tuple(record for record in records if record.path not in held_out),
            tuple(record for record in records if record.path in held_out),
        )


def read_study(path: str | Path) -> StudyFile:
    """Read and check a study file.

    Parameters
    ----------
    path : str or Path
        A TOML file as described in ``docs/reference/study-file.md``.

    Raises
    ------
    StudyError
        With one sentence for each fault, naming table and key.
    """
    path = Path(path)
    if why := why_no_file(path, ending=".toml", what="study file"):
        raise StudyError([f"{path}: {why}"])
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        hint = "; names with dots and texts need quotes, true and false are lower case"
        raise StudyError([f"{path.name}: is not valid TOML: {error}{hint}"]) from error
    except UnicodeDecodeError as error:
        raise StudyError([f"{path.name}: is not UTF-8 text: save it as UTF-8"]) from error
    except OSError as error:
        raise StudyError([f"{path.name}: cannot be read: {error.strerror or error}"]) from error
    return _Reader(path.absolute(), content).read()


class _Reader:
    """Collects the faults of one study file while its tables are read."""

    def __init__(self, path: Path, content: Mapping[str, Any]) -> None:
        self.path, self.content = path, content
        self.faults: list[str] = []
        self.warnings: list[str] = []
        self.joined: list[tuple[Path, ...]] = []

    def fault(self, where: str, text: str) -> None:
        self.faults.append(f"{self.path.name}, {where}: {text}")

    def fault_at(self, where: str) -> Callable[[str, str], None]:
        return lambda key, text: self.fault(f"{where}{key and ', ' + key}", text)

    def table(self, name: str, required: str = "") -> dict[str, Any]:
        value = self.content.get(name)
        if value is None:
            if required:
                self.fault(f"[{name}]", f"the table is missing: {required}")
            return {}
        if not isinstance(value, dict):
            self.fault(f"[{name}]", f"must be a table, and is {value!r}")
            return {}
        return value

    def read(self) -> StudyFile:
        for name in self.content:
            if name not in (*_TABLES, *_OF_OTHERS):
                self.fault(f"[{name}]", f"there is no such table{nearest_or_choices(name, _TABLES)}")
        model = self.struct(ModelTable, "model", 'say where the model comes from: build = "file.py:name"')
        uncertain = self.named("uncertain", Uncertain)
        inputs = self.named("inputs", Column)
        outputs = self.named("outputs", Column, 'say what was measured: "model.output" = "column"')
        records = self.struct(RecordsTable, "records", 'say time = "…" and identify = ["…"]')
        candidates = self.struct(CandidatesTable, "candidates")
        study = self.struct(StudyTable, "study")
        offsets = self.struct(OffsetsTable, "offsets")
        connections = self.connections()
        clocks = self.clocks()
        initial = self.initial()
        self.check_model(model, connections)
        self.check_uncertain(uncertain)
        self.check_columns(inputs, outputs, records)
        if "outputs" in self.content and not outputs and not self.faults:
            self.fault("[outputs]", "is empty: name at least one measured output")
        for name in offsets.outputs if offsets else []:
            if name not in outputs:
                self.fault("[offsets] outputs", f"there is no output '{name}'{nearest_or_choices(name, outputs)}")
        self.check_once("[offsets] outputs", offsets.outputs if offsets else [])
        if study:
            self.check_study(study)
        if candidates and not candidates.include:
            self.fault("[candidates] include", 'is empty, nothing could be found: use ["*"] or leave it out')
        identify: tuple[Path, ...] = ()
        validate: tuple[Path, ...] = ()
        if records:
            self.check_records(records)
            identify = self.files("identify", records.identify)
            validate = self.files("validate", records.validate)
            self.check_time(records, (*identify, *validate))
            self.check_clocks(clocks, (*identify, *validate))
            for text in held_out_faults(identify, validate):
                self.fault("[records] validate", text)
            if identify and not records.validate:
                self.warnings.append("[records] validate: nothing is held out, no finding can be confirmed")
        if self.faults or model is None or records is None or candidates is None or study is None:
            raise StudyError(self.faults)
        return StudyFile(
            path=self.path,
            model=model,
            uncertain=uncertain,
            inputs=inputs,
            outputs=outputs,
            records=records,
            identify=identify,
            validate=validate,
            candidates=candidates,
            study=study,
            initial=initial,
            offsets=offsets or OffsetsTable(),
            warnings=tuple(self.warnings),
            connections=connections,
            joined=tuple(self.joined),
            clocks=clocks,
        )

    def struct(self, kind: type[Any], name: str, required: str = "") -> Any:
        table = self.table(name, required)
        if required and not table:
            if name in self.content:
                self.fault(f"[{name}]", f"is empty: {required}")
            return None
        return read_struct(kind, table, lambda key, text: self.fault(f"[{name}]{key and ' ' + key}", text))

    def named(self, name: str, kind: type[Any], required: str = "") -> dict[str, Any]:
        entries: dict[str, Any] = {}
        for key, value in flatten(self.table(name, required), kind, self.twice(name)).items():
            where = f'[{name}] "{key}"'
            if kind is Column and isinstance(value, str):
                value = {"column": value}
            if not isinstance(value, dict):
                example = '{ column = "…" }' if kind is Column else "{ std = 5.0 }"
                self.fault(where, f"must be a table such as {example}, and is {value!r}")
                continue
            entries[key] = read_struct(kind, value, self.fault_at(where))
        return entries

    def twice(self, table: str) -> Callable[[str], None]:
        return lambda name: self.fault(
            f'[{table}] "{name}"', "is given twice, once in quotes and once without: keep one of the two"
        )

    def connections(self) -> dict[str, ConnectionTable]:
        entries = {}
        for key, value in self.table("connections").items():
            where = f'[connections] "{key}"'
            if not isinstance(value, dict):
                self.fault(
                    where, f'must be a table such as {{ force = "F", motion = "s", rate = "v" }}, and is {value!r}'
                )
                continue
            entries[key] = read_struct(ConnectionTable, value, self.fault_at(where))
        return entries

    def clocks(self) -> dict[str, ClockTable]:
        entries = {}
        for key, value in self.table("clocks").items():
            where = f'[clocks] "{key}"'
            if not isinstance(value, dict):
                self.fault(where, f"must be a table such as {{ offset = 0.5 }} or {{ fit = true }}, and is {value!r}")
                continue
            entries[key] = read_struct(ClockTable, value, self.fault_at(where))
        return entries

    def initial(self) -> InitialTable:
        table = dict(self.table("initial"))
        free = table.pop("free", [])
        if not isinstance(free, list) or not all(isinstance(name, str) for name in free):
            self.fault("[initial] free", 'must be a list of states, such as ["carriage.position"]')
            free = []
        self.check_once("[initial] free", free)
        values: dict[str, StartValue] = {}
        free = list(free)
        for name, value in flatten(table, None, self.twice("initial")).items():
            if value == "free":
                free.append(name)
            elif isinstance(value, dict) and isinstance(value.get(BY_RECORD), dict) and value[BY_RECORD]:
                each = {k: self.start(f'[initial] "{name}" {k}', v) for k, v in value[BY_RECORD].items()}
                values[name] = {k: v for k, v in each.items() if v is not None}
            elif (start := self.start(f'[initial] "{name}"', value)) is not None:
                values[name] = start
        return InitialTable(values, tuple(dict.fromkeys(free)))

    def start(self, where: str, value: Any) -> float | str | None:
        """Return a start value, or None after telling what is wrong with it."""
        if isinstance(value, str) and value.strip():
            signals = (*self.names("inputs"), *self.names("outputs"))
            if value not in ("measured", "equilibrium") and (text := expression_fault(value, signals)):
                self.fault(where, text)
                return None
            return value
        if isinstance(value, int | float) and not isinstance(value, bool):
            if abs(value) < LARGEST_START:
                return float(value)
            self.fault(where, f"is {value}: must be finite, a start value in SI")
            return None
        self.fault(
            where, f'must be a number in SI, "free", "measured", "equilibrium" or an expression, and is {value!r}'
        )
        return None

    def check_once(self, where: str, names: Sequence[str]) -> None:
        for name in dict.fromkeys(n for n in names if names.count(n) > 1):
            self.fault(where, f"'{name}' is named more than once: keep one, and name the other that was meant")

    def names(self, table: str) -> tuple[str, ...]:
        """Return the names in a table of columns."""
        content = self.content.get(table)
        return tuple(flatten(content, Column)) if isinstance(content, dict) else ()

    def check_model(self, model: ModelTable | None, connections: Mapping[str, ConnectionTable]) -> None:
        if model is None:
            return
        if bool(model.build) == bool(model.fmu):
            both = "names two models" if model.build else "names no model"
            self.fault("[model]", f'{both}: say build = "file.py:name" or fmu = "plant.fmu"')
        if connections and not model.fmu:
            self.fault(
                "[connections]", "is for an FMU: a model of components has its connections itself; remove the table"
            )
        if model.fmu:
            self.check_fmu(model)
        if not model.build:
            return
        source, _, name = model.build.rpartition(":")
        if not source or not name.isidentifier():
            self.fault("[model] build", f'\'{model.build}\' must be "file.py:name" or "package.module:name"')
        elif source.endswith(".py") and not (self.path.parent / source).is_file():
            folder = (self.path.parent / source).parent
            siblings = sorted(p.name for p in folder.glob("*.py")) if folder.is_dir() else []
            hint = nearest_or_choices(Path(source).name, siblings) if siblings else ""
            self.fault("[model] build", f"there is no file '{source}' beside the study{hint}: name one that is there")
        elif not source.endswith(".py") and not all(part.isidentifier() for part in source.split(".")):
            self.fault(
                "[model] build",
                f"'{source}' is neither a file ending in .py nor a module's name: write \"file.py:name\"",
            )

    def check_fmu(self, model: ModelTable) -> None:
        if model.arguments:
            self.fault("[model] arguments", "are for build: an FMU has parameters, name them in [uncertain]")
        if not (self.path.parent / model.fmu).is_file():
            folder = (self.path.parent / model.fmu).parent
            siblings = sorted(p.name for p in folder.glob("*.fmu")) if folder.is_dir() else []
            hint = nearest_or_choices(Path(model.fmu).name, siblings)
            self.fault("[model] fmu", f"there is no file '{model.fmu}' beside the study{hint}")

    def check_uncertain(self, uncertain: Mapping[str, Uncertain]) -> None:
        for name, entry in uncertain.items():
            where = f'[uncertain] "{name}"'
            if entry.std is not None and not entry.std > 0.0:
                self.fault(f"{where}, std", "must be above zero: leave an exact parameter out of [uncertain]")
            low, high = entry.min, entry.max
            if low is not None and high is not None and not low < high:
                self.fault(where, f"min = {low:g} must be below max = {high:g}")
            elif entry.value is not None and not (
                (low is None or low <= entry.value) and (high is None or entry.value <= high)
            ):
                self.fault(where, f"value = {entry.value:g} lies outside min and max: choose it between them")

    def check_columns(
        self, inputs: Mapping[str, Column], outputs: Mapping[str, Column], records: RecordsTable | None
    ) -> None:
        for table, entries in (("inputs", inputs), ("outputs", outputs)):
            for name, column in entries.items():
                where = f'[{table}] "{name}"'
                if column.noise is not None and not column.noise > 0.0:
                    self.fault(f"{where}, noise", "must be above zero: leave it out to have it estimated")
                times = records.time if records is not None else ""
                if column.column and column.column in ([times] if isinstance(times, str) else times.values()):
                    self.fault(where, f"column '{column.column}' is the time column: name another one")
        by_column: dict[str, str] = {}
        for name, column in outputs.items():
            if column.default is not None:
                self.fault(
                    f'[outputs] "{name}", default', "is for inputs: what was not measured is no output; remove it"
                )
            if column.interpolation != "linear":
                self.fault(
                    f'[outputs] "{name}", interpolation',
                    "is for inputs: outputs are compared sample by sample; remove it",
                )
            if column.column and column.column in by_column:
                other = by_column[column.column]
                self.fault(
                    f'[outputs] "{name}"',
                    f"column '{column.column}' is used for '{other}' already: name the one of this output",
                )
            by_column[column.column] = name
        for name, column in inputs.items():
            if name in outputs:
                self.fault(f'[inputs] "{name}"', "is an output as well: name it in one of the two tables")
            elif column.column and column.column in by_column:
                self.fault(
                    f'[inputs] "{name}"',
                    f"column '{column.column}' is also the output '{by_column[column.column]}', which would be "
                    "compared with itself: drive the model with another column or leave the output out",
                )

    def check_study(self, study: StudyTable) -> None:
        if not 0.0 < study.level < 0.5:
            self.fault("[study] level", f"{study.level:g} must lie between 0 and 0.5, such as 0.02")
        if study.max_effects < 0:
            self.fault("[study] max_effects", "must not be negative")
        if study.most_rows < FEWEST_ROWS:
            self.fault("[study] most_rows", f"is {study.most_rows}, and must be at least {FEWEST_ROWS}")
        if not study.time_limit > 0.0:
            self.fault(
                "[study] time_limit", f"is {study.time_limit:g}, and must be positive: seconds of processor time"
            )
        if study.seed < 0:
            self.fault("[study] seed", "must not be negative")

    def check_time(self, records: RecordsTable, files: Sequence[Path]) -> None:
        """Ask for the time column where a file's channels have no times of their own."""
        from estimation.files.read_table import OWN_TIMES

        patterns = {"*": records.time} if isinstance(records.time, str) else records.time
        for path in files:
            named = any(column and fnmatch(path.name, pattern) for pattern, column in patterns.items())
            if not named and not path.name.lower().endswith(OWN_TIMES):
                missing = "the key 'time' is missing" if not records.time else f"time: no column for '{path.name}'"
                self.fault("[records]", f"{missing}: name the time column")
                return

    def check_clocks(self, clocks: Mapping[str, ClockTable], files: Sequence[Path]) -> None:
        """Refuse a pattern that no recording fits: its clock would stay as it is without a word."""
        names = list(dict.fromkeys(path.name for path in files))
        for pattern in clocks:
            if names and not any(fnmatch(name, pattern) for name in names):
                hint = nearest_or_choices(pattern, names)
                self.fault(f'[clocks] "{pattern}"', f"fits the name of no recording{hint}")

    def check_dates(self, records: RecordsTable) -> None:
        """Check how times are written, also where no recording of today needs it."""
        from estimation.files.dates import format_fault, zone_fault

        if records.time_format is not None and (text := format_fault(records.time_format)):
            self.fault("[records] time_format", text)
        if records.time_zone is not None and (text := zone_fault(records.time_zone)):
            self.fault("[records] time_zone", text)
        if records.time_unit is not None:
            from multibody.base.units import UnitError, same_dimension

            try:
                wrong = "" if same_dimension(records.time_unit, "s") else f"'{records.time_unit}' is no unit of time"
            except UnitError as error:
                wrong = str(error)
            if wrong:
                self.fault("[records] time_unit", f'{wrong}; name one such as "s", "ms" or "h"')

    def check_records(self, records: RecordsTable) -> None:
        self.check_dates(records)
        if records.skip_rows < 0:
            self.fault("[records] skip_rows", f"is {records.skip_rows}, and must not be negative")
        for key in ("resample", "longest_gap"):
            value = getattr(records, key)
            if value is not None and not value > 0.0:
                self.fault(f"[records] {key}", "must be above zero")
        try:
            Preparation(
                start=records.start,
                stop=records.stop,
                low_pass_hz=records.low_pass_hz,
                decimate=records.decimate,
                edge=records.edge,
            )
        except SignalError as error:
            self.fault("[records]", str(error))

    def files(self, key: str, patterns: str | list[str | list[str]]) -> tuple[Path, ...]:
        if key == "identify" and self.table("records").get("identify") == []:
            self.fault("[records] identify", "is empty: name at least one recording")
        paths: list[Path] = []
        for entry in [patterns] if isinstance(patterns, str) else patterns:
            if isinstance(entry, str):
                paths += self.found(key, [entry])
                continue
            loggers = [self.found(key, [pattern]) for pattern in entry]
            counts = {len(matched) for matched in loggers}
            if 0 in counts:
                continue
            if len(counts) > 1:
                listed = ", ".join(f"'{p}' {len(matched)}" for p, matched in zip(entry, loggers, strict=True))
                self.fault(f"[records] {key}", f"patterns of the files of one record match different numbers: {listed}")
                continue
            self.joined += list(zip(*loggers, strict=True))
            paths += [path for together in zip(*loggers, strict=True) for path in together]
        twice = [path.name for path in dict.fromkeys(paths) if paths.count(path) > 1]
        self.warnings += [f"[records] {key}: '{name}' is named twice and read once" for name in twice]
        return tuple(dict.fromkeys(paths))

    def found(self, key: str, patterns: list[str]) -> tuple[Path, ...]:
        files = find_files(self.path.parent, patterns)
        for text in files.faults:
            self.fault(f"[records] {key}", text)
        self.warnings += [f"[records] {key}: {text}" for text in files.warnings]
        return files.paths
