"""A case: a model under test, recordings of its rig and the truth; in memory and as a folder of files."""

from __future__ import annotations

import gzip
import io
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.rigs.recording import BenchError, Channel
from estimation.files.record import Record
from estimation.fit.calibrate import UncertainParameter

if TYPE_CHECKING:
    from multibody.machine.model import Model

__all__ = ["Case", "check_folder", "write_case", "write_csv", "write_json"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """A model under test, recordings of its rig, and what was hidden in it.

    Parameters
    ----------
    model : Model
        Under test, at nominal parameters.
    uncertain : tuple of UncertainParameter
        What calibration may move; the true values lie within these priors.
    inputs, outputs : tuple of str
        Recorded model inputs and measured outputs.
    identify, validate : tuple of Record
        Recordings.
    free : tuple of str
        States that start at an unknown value.
    rest : tuple of str
        States that start at zero.
    truth : dict
        What ``truth.json`` holds.
    true_model : Model
        The model with the hidden effects and the true parameters (errors of sensors stand in the truth only).
    channels : tuple of Channel
    offsets : tuple of str
        Outputs whose sensors have an offset of their own in each record.
    """

    model: Model
    uncertain: tuple[UncertainParameter, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    identify: tuple[Record, ...]
    validate: tuple[Record, ...]
    free: tuple[str, ...]
    rest: tuple[str, ...]
    truth: dict[str, Any]
    true_model: Model
    channels: tuple[Channel, ...] = field(default=(), repr=False)
    offsets: tuple[str, ...] = ()

    def problem(self, **options: Any) -> Problem:
        """Return what a `Study` starts from; ``options`` such as ``seed`` and ``include`` go to `Problem`."""
        common: dict[str, Any] = {
            "inputs": self.inputs,
            "outputs": self.outputs,
            "start": dict.fromkeys(self.rest, 0.0),
            "free": self.free,
            "offsets": self.offsets,
        }
        return Problem(
            name=self.model.name,
            model=self.model,
            uncertain=self.uncertain,
            identify=make_experiments(self.model, self.identify, **common),
            validate=make_experiments(self.model, self.validate, **common),
            **options,
        )


def write_case(out: str | os.PathLike[str], case: Case, texts: Mapping[str, str]) -> Path:
    """Write a case into a folder: recordings, the truth, and texts by file name, ``study.toml`` among them.

    Returns
    -------
    Path
        The study file.

    Raises
    ------
    BenchError
        If the folder cannot be made.
    """
    folder = check_folder(out)
    for record in (*case.identify, *case.validate):
        columns = {c.column: _as_read(record.signals[c.signal].values, c) for c in case.channels}
        write_csv(folder / record.path.name, np.asarray(record.time), columns)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    write_json(folder / "truth.json", case.truth)
    return folder / "study.toml"


def _as_read(values: np.ndarray, channel: Channel) -> np.ndarray:
    from multibody.base.units import convert

    return np.asarray(convert(values, channel.unit, channel.measured_unit))


def check_folder(out: str | os.PathLike[str]) -> Path:
    """Return the folder to write into, made if it was not there.

    Raises
    ------
    BenchError
        If it cannot be one.
    """
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise BenchError([f"{folder}: is a file: name a folder to write into"])
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise BenchError([f"{folder}: the folder cannot be made: {reason}: name another with --out"]) from error
    return folder


def write_csv(path: Path, stamps: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Write a record as gzipped CSV; the same numbers give the same bytes."""
    names = ",".join(("time_s", *columns))
    text = io.StringIO()
    table = np.column_stack([stamps, *columns.values()])
    np.savetxt(text, table, delimiter=",", header=names, comments="", fmt=["%.6f", *["%.10g"] * len(columns)])
    with (
        path.open("wb") as raw,
        gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed,
    ):  # no name, no time of writing
        packed.write(text.getvalue().encode("ascii"))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as JSON that a person can read."""
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
