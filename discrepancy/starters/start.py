"""Starting a study: a folder with a model, a study file and records to hold out, from recordings and a machine."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from discrepancy.problem.paths import find_files
from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.starters.columns import DataColumns, Matched, match_places, read_columns
from discrepancy.starters.kinds import KINDS, Drive, MachineKind, Place
from discrepancy.starters.start_values import find_values
from estimation.files.column_names import read_column_name
from estimation.files.read_table import READERS, read_table
from estimation.files.table import TableRequest
from multibody.base.progress import silent
from multibody.base.spelling import nearest_or_choices
from multibody.base.units import UnitError

__all__ = ["StartedStudy", "start_study"]

#: Share of one file, from its end, that is held out; of several files every third one is.
HELD_OUT = 1.0 / 3.0
#: An input is taken for a staircase where this share of its changes stands between samples without one; chosen.
ISOLATED = 0.8
#: What is assumed of a parameter of an FMU: known to this share of its value.
FMU_SHARE = 0.1
#: More parameters of an FMU than this are left exact: nobody could tell them apart.
FMU_PARAMETERS = 12


@dataclass(frozen=True, kw_only=True)
class StartedStudy:
    """A study that was written.

    Parameters
    ----------
    path : Path
        The study file.
    assumed : tuple of str
        One sentence for everything that was assumed.
    """

    path: Path
    assumed: tuple[str, ...]


@dataclass(kw_only=True)
class _Draft:
    """A study while it is put together."""

    folder: Path
    data: DataColumns
    inputs: dict[str, Matched]
    outputs: dict[str, Matched]
    kind: MachineKind | None = None
    drive: Drive | None = None
    fmu: Path | None = None
    unknown: tuple[str, ...] = ()
    unshown: tuple[str, ...] = ()
    values: dict[str, float] = field(default_factory=dict)
    priors: dict[str, float] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    #: Column's name in the records that the study reads, where it is not that of the data.
    renamed: dict[str, str] = field(default_factory=dict)
    identify: list[str] = field(default_factory=list)
    validate: list[str] = field(default_factory=list)
    held: set[str] = field(default_factory=set)

    @property
    def path(self) -> Path:
        return self.folder / "study.toml"

    def relative(self, path: Path) -> str:
        return Path(os.path.relpath(path, self.folder.absolute())).as_posix()

    def tell_columns(self) -> None:
        """Write down which column was taken for what, and which for nothing."""
        for name, matched in (*self.inputs.items(), *self.outputs.items()):
            self.assumed.append(f"column '{matched.column.name}' is '{name}' ({matched.why})")
        taken = {m.column.name for m in (*self.inputs.values(), *self.outputs.values())}
        for column in self.data.columns:
            if column.name not in taken:
                why = "holds what should be; the model has no controller" if column.is_command else "no place for it"
                self.assumed.append(f"column '{column.name}' is not used: {why}")

    def write(self) -> None:
        """Write the model and the study file."""
        if self.fmu is not None:
            shutil.copyfile(self.fmu, self.folder / self.fmu.name)
        elif self.kind is not None and self.drive is not None:
            text = self.kind.model_text(self.drive, self.values)
            (self.folder / "model.py").write_text(text, encoding="utf-8")
        self.path.write_text(self._text(), encoding="utf-8")

    def _text(self) -> str:
        what = self.kind.what if self.kind is not None else f"The unit {self.fmu.name if self.fmu else ''}"
        lines = [f"# {what}.  What was assumed:", *(f"# - {text}" for text in self.assumed), "", "[model]"]
        lines.append(
            'build = "model.py:build"'
            if self.kind is not None
            else f"fmu = {_quoted(self.fmu.name if self.fmu else '')}"
        )
        lines += ["", "[uncertain]"]
        for name in self.unknown:
            if name in self.unshown:
                lines.append(f"# {_quoted(name)}: not shown by these records")
            else:
                lines.append(f"{_quoted(name)} = {{ min = 0.0 }}")
        lines += [f"{_quoted(name)} = {{ std = {std:.4g} }}" for name, std in self.priors.items()]
        for table, matched in (("inputs", self.inputs), ("outputs", self.outputs)):
            if matched:
                lines += ["", f"[{table}]", *(f"{_quoted(n)} = {self._column(n, m)}" for n, m in matched.items())]
        lines += ["", "[records]"]
        if self.data.time:
            lines.append(f"time = {_quoted(self.renamed.get(self.data.time, self.data.time))}")
        if self.data.trip:
            lines.append(f"trip = {_quoted(self.data.trip)}")
        for key, files in (("identify", self.identify), ("validate", self.validate)):
            if files:
                lines.append(f"{key} = [{', '.join(_quoted(f) for f in files)}]")
        return "\n".join(lines) + "\n"

    def _column(self, name: str, matched: Matched) -> str:
        column = _quoted(self.renamed.get(matched.column.name, matched.column.name))
        return f'{{ column = {column}, interpolation = "hold" }}' if name in self.held else column


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def start_study(
    data: Sequence[str | Path],
    folder: str | Path,
    *,
    machine: str | None = None,
    fmu: str | Path | None = None,
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    progress: Callable[[str], None] = silent,
) -> StartedStudy:
    """Write a study into a folder, ready to run.

    Parameters
    ----------
    data : sequence of str or Path
        Recordings: files, patterns, or folders of them.
    folder : str or Path
        Made if it is not there; must not hold a study.
    machine : str, optional
        A key of `discrepancy.starters.kinds.KINDS`.
    fmu : str or Path, optional
        In its place: an FMU.
    columns : mapping of str to str, optional
        Columns of model inputs and outputs, where names and units do not tell.
    time : str, optional
        The time column, where it does not tell.
    progress : callable
        Takes a line of text for each step.

    Raises
    ------
    StudyError, RecordError
        With what is missing and what to do.
    """
    folder, columns = Path(folder), dict(columns or {})
    if bool(machine) == bool(fmu):
        raise StudyError([f"say which machine it is, --machine KIND or --fmu FILE{nearest_or_choices('', KINDS)}"])
    if machine and machine not in KINDS:
        raise StudyError([f"--machine {machine}: there is no such kind{nearest_or_choices(machine, KINDS)}"])
    if (folder / "study.toml").exists():
        raise StudyError([f"{folder}: there is a study in it already: name another folder with --out"])
    files = _files(data)
    progress("read the columns")
    data_columns = read_columns(files, time)
    draft = (
        _of_fmu(Path(fmu), data_columns, columns, folder)
        if fmu
        else _of_machine(KINDS[machine or ""], data_columns, columns, folder)
    )
    folder.mkdir(parents=True, exist_ok=True)
    _records(draft)
    draft.write()
    if draft.kind is not None and draft.unknown:
        found_values = find_values(replace(read_problem(draft.path), validate=()), progress)
        draft.values = found_values.values
        draft.unshown = found_values.unshown
        draft.assumed += [
            f"'{name}': these records cannot show it beside the other parameters; it stays {draft.values[name]:.4g} in "
            "model.py, state yours there"
            for name in found_values.unshown
        ]
        if shown := [n for n in draft.unknown if n not in draft.unshown]:
            draft.assumed.append(f"{', '.join(shown)}: fitted to the records for identification, nothing else is known")
        draft.write()
    return StartedStudy(path=draft.path, assumed=tuple(draft.assumed))


def _files(data: Sequence[str | Path]) -> tuple[Path, ...]:
    """Return the recordings behind files, patterns and folders."""
    paths: list[Path] = []
    faults: list[str] = []
    for entry in data:
        place = Path(entry)
        if place.is_dir():
            inside = sorted(p for p in place.iterdir() if p.is_file() and p.name.lower().endswith(tuple(READERS)))
            if not inside:
                faults.append(f"{entry}: the folder has no recording: files end in {', '.join(READERS)}")
            paths += inside
            continue
        matches = find_files(Path.cwd(), [str(entry)])
        faults += matches.faults
        paths += matches.paths
    if faults:
        raise StudyError(faults)
    return tuple(dict.fromkeys(path.absolute() for path in paths))


def _of_machine(kind: MachineKind, data: DataColumns, given: Mapping[str, str], folder: Path) -> _Draft:
    """Choose how the machine was driven by what was recorded, and give every column a place."""
    driving = {p.name for drive in kind.drives for p in drive.inputs}
    every = driving | {p.name for drive in kind.drives for p in drive.outputs} | {p.name for p in kind.outputs}
    _refuse_unknown(given, every, kind.name)
    # a reference that was recorded drives the machine; without one, a measured motion may do so in the end
    for references_only in (True, False):
        for drive in kind.drives:
            names = {p.name for p in drive.inputs}
            asked = {n: c for n, c in given.items() if n in names}
            if not names >= {n for n in given if n in driving - {p.name for p in drive.outputs}}:
                continue  # the user named a column that drives it in another way
            strict = references_only and drive.commanded and not asked
            columns = [c for c in data.columns if c.is_command] if strict else data.columns
            inputs = match_places(drive.inputs, columns, asked, commands=True)
            if len(inputs) < len(names):
                continue
            taken = {m.column.name for m in inputs.values()}
            left = [c for c in data.columns if c.name not in taken]
            places = (*drive.outputs, *kind.outputs)
            shown = {n: c for n, c in given.items() if n in {p.name for p in places}}
            outputs = match_places(places, left, shown, commands=False)
            if outputs:
                return _drafted(kind, drive, data, inputs, outputs, folder)
    ways = "; or ".join(
        " and ".join(f"'{p.name}' ({p.unit})" for p in drive.inputs) or "nothing" for drive in kind.drives
    )
    listed = ", ".join(f"'{p.name}' ({p.unit})" for p in kind.outputs)
    raise StudyError(
        [
            f"{data.files[0].name}: lacks a column that drives a {kind.name}, or another that shows what it does. What "
            f"may drive it: {ways}. What may be measured: {listed}. The columns are {_columns(data)}. Write units into "
            "the names, such as 'torque_Nm', or say --column NAME=COLUMN"
        ]
    )


def _refuse_unknown(given: Mapping[str, str], known: Collection[str], what: str) -> None:
    if wrong := [name for name in given if name not in known]:
        raise StudyError(
            [f"--column {n}: '{what}' has no such input or output{nearest_or_choices(n, known)}" for n in wrong]
        )


def _columns(data: DataColumns) -> str:
    return ", ".join(f"'{c.name}' ({c.unit if c.unit is not None else 'no unit'})" for c in data.columns)


def _drafted(
    kind: MachineKind,
    drive: Drive,
    data: DataColumns,
    inputs: dict[str, Matched],
    outputs: dict[str, Matched],
    folder: Path,
) -> _Draft:
    unknown = []
    for each in (*drive.unknown, *kind.unknown):
        enough = all if each.together else any
        if not each.shown_by or enough(name in outputs for name in each.shown_by):
            unknown.append(each.name)
    draft = _Draft(
        folder=folder,
        data=data,
        kind=kind,
        drive=drive,
        inputs=inputs,
        outputs=outputs,
        unknown=tuple(dict.fromkeys(unknown)),
    )
    draft.assumed.append(f"it is driven by {drive.what}")
    draft.tell_columns()
    draft.assumed += [
        f"a typical value was taken, put yours into model.py: {fixed}" for fixed in (drive.fixed, kind.fixed) if fixed
    ]
    return draft


def _of_fmu(fmu: Path, data: DataColumns, given: Mapping[str, str], folder: Path) -> _Draft:
    """Give every column a place among the inputs and outputs of a unit."""
    from multibody.fmi.errors import FmuError
    from multibody.fmi.foreign_description import read_unit

    try:
        unit = read_unit(fmu)
    except FmuError as error:
        raise StudyError([f"--fmu {fmu}: {error}"]) from error
    into = [Place(v.name, v.unit, _words(v.name)) for v in unit.inputs]
    out = [Place(v.name, v.unit, _words(v.name)) for v in (*unit.outputs, *unit.states)]
    known = {p.name for p in (*into, *out)}
    _refuse_unknown(given, known, unit.name)
    inputs = match_places(
        into, data.columns, {n: c for n, c in given.items() if n in {p.name for p in into}}, commands=True
    )
    taken = {m.column.name for m in inputs.values()}
    left = [c for c in data.columns if c.name not in taken]
    outputs = match_places(out, left, {n: c for n, c in given.items() if n not in inputs}, commands=False)
    if not outputs:
        listed = ", ".join(f"'{p.name}' ({p.unit})" for p in out)
        raise StudyError(
            [
                f"{data.files[0].name}: no column is an output of the unit: it has {listed}; the columns are "
                f"{_columns(data)}. Write units into the names, or say --column NAME=COLUMN"
            ]
        )
    draft = _Draft(folder=folder, data=data, fmu=fmu, inputs=inputs, outputs=outputs)
    draft.tell_columns()
    draft.assumed += [f"input '{p.name}' has no column and keeps its start value" for p in into if p.name not in inputs]
    moving = [v for v in unit.parameters if v.start != 0.0]
    if len(moving) <= FMU_PARAMETERS:
        draft.priors = {v.name: FMU_SHARE * abs(v.start) for v in moving}
        draft.assumed.append(
            f"each parameter of the unit is known to {100 * FMU_SHARE:.0f} %: change std where you know better"
        )
    else:
        draft.assumed.append(
            f"the unit has {len(moving)} parameters, and all are taken as exact: name the uncertain ones"
        )
    draft.assumed.append(
        "[connections] is left out: effects can be found on inputs and sensors only, until you name places"
    )
    return draft


def _words(name: str) -> tuple[str, ...]:
    return tuple(word for word in re.split(r"[^a-z0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()) if word)


def _records(draft: _Draft) -> None:
    """Decide which records are held out, and cut a single file in two."""
    files = draft.data.files
    used = {m.column.name: m for m in (*draft.inputs.values(), *draft.outputs.values())}
    for name, matched in draft.inputs.items():
        if _is_staircase(files[0], matched.column.name, draft.data.time):
            draft.held.add(name)
            draft.assumed.append(f"input '{name}' keeps its value until the next sample: its column is a staircase")
    if len(files) > 1:
        held_out = files[2::3] or files[1:]
        draft.identify = [draft.relative(path) for path in files if path not in held_out]
        draft.validate = [draft.relative(path) for path in held_out]
        draft.assumed.append(f"held out, used for nothing but to confirm: {', '.join(p.name for p in held_out)}")
        return
    source, time, trip = files[0], draft.data.time, draft.data.trip
    if not time:
        draft.identify = [draft.relative(source)]
        draft.assumed.append("nothing is held out, so nothing can be confirmed: name a second recording in validate")
        return
    request = TableRequest(columns=(time, *used), labels=(trip,) if trip else (), time=time)
    table = read_table(source, request)
    rows = len(table.numbers[time])
    cut = int(rows * (1.0 - HELD_OUT))
    if trip:
        starts = 1 + np.flatnonzero(table.labels[trip][1:] != table.labels[trip][:-1])
        if starts.size:
            cut = int(starts[np.argmin(np.abs(starts - cut))])
    draft.renamed = {n: _with_unit(n, table.units) for n in (time, *used)}
    folder = draft.folder / "records"
    folder.mkdir(exist_ok=True)
    for file, part in (("fit.csv", slice(0, cut)), ("held_out.csv", slice(cut, rows))):
        columns = {draft.renamed[n]: table.numbers[n][part] for n in (time, *used)}
        if trip:
            columns[trip] = table.labels[trip][part]
        _write_csv(folder / file, columns)
    draft.identify, draft.validate = ["records/fit.csv"], ["records/held_out.csv"]
    draft.assumed.append(
        f"{source.name} is one recording: its first {cut} rows are fitted, the other {rows - cut} held out (copies "
        "in records/)"
    )


def _with_unit(name: str, units: Mapping[str, str]) -> str:
    """Return a column's name with the unit that the file states elsewhere."""
    if name not in units:
        return name
    try:
        stated = read_column_name(name).unit
    except UnitError:
        stated = None
    return name if stated is not None else f"{name} [{units[name]}]"


def _write_csv(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    import pandas as pd

    pd.DataFrame(dict(columns)).to_csv(path, index=False)


def _is_staircase(file: Path, column: str, time: str) -> bool:
    """Return whether a column keeps its value over several samples each time."""
    values = read_table(file, TableRequest(columns=(column,), time=time)).numbers[column]
    moved = np.diff(values[np.isfinite(values)]) != 0.0
    if moved.size < 3 or not moved.any():
        return False
    beside = np.pad(moved, 1)
    alone = moved & ~beside[:-2] & ~beside[2:]
    return bool(alone.sum() > ISOLATED * moved.sum())
