"""The tables of a study file as typed values, and how a TOML table becomes one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import msgspec

from multibody.base.spelling import nearest_or_choices

__all__ = [
    "BY_RECORD",
    "FEWEST_ROWS",
    "MOST_ROWS",
    "TIME_LIMIT",
    "CandidatesTable",
    "ClockTable",
    "Column",
    "ConnectionTable",
    "InitialTable",
    "ModelTable",
    "OffsetsTable",
    "RecordsTable",
    "StartValue",
    "StudyTable",
    "Uncertain",
    "flatten",
    "read_struct",
]

T = TypeVar("T", bound=msgspec.Struct)
#: Key of an entry of ``[initial]`` that differs from record to record.
BY_RECORD = "record"
#: Rows of a record that are used where nothing is said; of a longer one, sections.  Chosen: a machine of two states is
#: then diagnosed within two minutes on two processors, and each section has more than ten thousand rows.
MOST_ROWS = 100_000
#: Fewer would leave sections too short for a machine to show what it does.
FEWEST_ROWS = 10_000
#: Processor time of a search after which nothing further is tried, in s.  Chosen: with what comes before and after the
#: search, the answer is there within some minutes.
TIME_LIMIT = 180.0


class ModelTable(msgspec.Struct, frozen=True):
    """``[model]``: the callable that builds the model and its keyword arguments, or an FMU of another tool."""

    build: str = ""
    arguments: dict[str, Any] = {}
    fmu: str = ""


class ConnectionTable(msgspec.Struct, frozen=True):
    """An entry of ``[connections]``: an FMU's force input, and the outputs that are its motion along this force."""

    force: str
    motion: str
    rate: str


class Uncertain(msgspec.Struct, frozen=True):
    """An entry of ``[uncertain]``: start value, prior standard deviation and bounds, in SI."""

    value: float | None = None
    std: float | None = None
    min: float | None = None
    max: float | None = None


class Column(msgspec.Struct, frozen=True):
    """An entry of ``[inputs]`` or ``[outputs]``.

    ``unit`` is that of the numbers in the file, ``noise`` a standard deviation in SI, ``default`` the value in
    SI that an input has in recordings without the column, ``interpolation`` what an input does between samples,
    ``file`` the pattern of the file names in which the column stands, where several files of a record have it.
    """

    column: str
    noise: float | None = None
    unit: str | None = None
    default: float | None = None
    interpolation: Literal["linear", "hold"] = "linear"
    file: str = "*"


class RecordsTable(msgspec.Struct, frozen=True):
    """``[records]``: the files, how they are read (see :class:`estimation.ReadRules`) and prepared.

    A list inside ``identify`` or ``validate`` names the files of several loggers that make one record.
    """

    identify: list[str | list[str]] | str
    time: str | dict[str, str] = ""
    validate: list[str | list[str]] | str = []
    start: float | None = None
    stop: float | None = None
    low_pass_hz: float | None = None
    decimate: int = 1
    edge: float | None = None
    resample: float | None = None
    trip: str | None = None
    drop_nan: bool = False
    drop_duplicates: bool = False
    gaps: Literal["refuse", "split"] = "refuse"
    longest_gap: float | None = None
    time_unit: str | None = None
    time_format: str | None = None
    time_zone: str | None = None
    skip_rows: int = 0
    uneven: Literal["refuse", "own instants"] = "refuse"


class ClockTable(msgspec.Struct, frozen=True):
    """An entry of ``[clocks]``: the clock of the files of a pattern.

    ``offset`` is added to their time, in s; with ``fit`` a further constant is estimated for each record.
    """

    offset: float = 0.0
    fit: bool = False


class CandidatesTable(msgspec.Struct, frozen=True):
    """``[candidates]``: shell patterns over ``kind`` or ``kind@where``."""

    include: list[str] = msgspec.field(default_factory=lambda: ["*"])
    exclude: list[str] = []


class StudyTable(msgspec.Struct, frozen=True):
    """``[study]``: how the search is run.

    ``level`` is the chance, over all candidates of a step together, of naming an effect that is not there.  ``search``
    compares models step by step by the significance of effects, or whole models by their marginal likelihood; "auto"
    does the latter where whole records of a small machine are simulated.  Of records of more than ``most_rows`` rows,
    sections are used.  After ``time_limit`` seconds of processor time a search tries nothing further.
    """

    residual: Literal["auto", "simulation", "prediction", "inverse"] = "auto"
    inputs: Literal["auto", "as recorded"] = "auto"
    seed: int = 0
    max_effects: int = 6
    level: float = 0.02
    search: Literal["auto", "significance", "evidence"] = "auto"
    most_rows: int = MOST_ROWS
    time_limit: float = TIME_LIMIT


class OffsetsTable(msgspec.Struct, frozen=True):
    """``[offsets]``: outputs whose sensor may have another constant offset in every record."""

    outputs: list[str] = []


#: A number in SI; "measured", "equilibrium" or an expression of measured signals; or these by pattern of records.
StartValue = float | str | Mapping[str, "float | str"]


@dataclass(frozen=True)
class InitialTable:
    """``[initial]``: start values of states.

    Attributes
    ----------
    values : mapping of str to StartValue
        "measured" takes the first sample of the output with the state's name, an expression the first samples of the
        signals that it names, "equilibrium" the value at which the machine is at rest.
    free : tuple of str
        States whose start value is fitted for every record.
    """

    values: Mapping[str, StartValue] = field(default_factory=dict)
    free: tuple[str, ...] = ()


_WORDS: dict[Any, str] = {
    str: "a text in quotes",
    float | None: "a number",
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    list[str]: 'a list of texts, such as ["a", "b"]',
    list[str | list[str]] | str: 'a list of texts, such as ["a.csv"], or of lists of the files of one record',
    str | dict[str, str]: 'a text in quotes, or a table such as { "*_temp.csv" = "t [ms]", "*" = "time_s" }',
    str | None: "a text in quotes",
    dict[str, Any]: "a table, such as { travel = 0.25 }",
}


def _in_words(kind: Any) -> str:
    if kind in _WORDS:
        return _WORDS[kind]
    return "one of " + ", ".join(f'"{value}"' for value in kind.__args__)


def read_struct(kind: type[T], table: Mapping[str, Any], fault: Callable[[str, str], None]) -> T:
    """Make a struct from a TOML table.

    Parameters
    ----------
    kind : type
        A msgspec Struct.
    table : mapping
    fault : callable
        Called with key and text of every fault; the key is empty for the whole table.

    Returns
    -------
    Struct
        With defaults, or empty texts and lists, where there were faults: the rest can still be checked.
    """
    fields = {declared.name: declared for declared in msgspec.structs.fields(kind)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in fields:
            fault("", f"there is no key '{key}'{nearest_or_choices(key, fields)}")
            continue
        wanted = fields[key].type
        try:
            good = msgspec.convert(value, wanted)
        except msgspec.ValidationError:
            hint = nearest_or_choices(value, wanted.__args__) if isinstance(value, str) and wanted not in _WORDS else ""
            fault(key, f"must be {_in_words(wanted)}, and is {value!r}{hint}")
            continue
        if isinstance(good, float) and not math.isfinite(good):
            fault(key, f"must be finite, and is {value!r}: leave it out where there is no limit")
        elif isinstance(good, str) and not good.strip() and key != "unit":
            fault(key, "must not be empty")
        else:
            values[key] = good
    for key, declared in fields.items():
        if declared.required and key not in values:
            values[key] = "" if declared.type is str else []
            if key not in table:
                fault("", f"the key '{key}' is missing: add it")
    return kind(**values)


def flatten(table: Mapping[str, Any], kind: type | None, twice: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Undo the nesting of names whose dots were not quoted: ``mass.m = { std = 5.0 }``.

    Parameters
    ----------
    table : mapping
        A table of names.
    kind : type or None
        The struct that an entry makes; None where entries are plain values.
    twice : callable, optional
        Called with every name that is given twice, quoted and bare.
    """
    keys = [entry.name for entry in msgspec.structs.fields(kind)] if kind else []
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if isinstance(value, dict) and value and not _is_entry(value, keys) and set(value) != {BY_RECORD}:
            new = {f"{name}.{rest}": entry for rest, entry in flatten(value, kind, twice).items()}
        else:
            new = {name: value}
        if twice is not None:
            for each in new.keys() & flat.keys():
                twice(each)
        flat.update(new)
    return flat


def _is_entry(value: Mapping[str, Any], keys: list[str]) -> bool:
    """Tell an entry, perhaps with a misspelt key, from a further level of names."""
    if not keys:
        return False
    for key, inner in value.items():
        if not isinstance(inner, dict) and (key in keys or nearest_or_choices(key, keys).startswith("; nearest")):
            return True
    return not any(isinstance(inner, dict) for inner in value.values()) and "column" not in keys
