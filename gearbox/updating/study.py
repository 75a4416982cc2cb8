"""A study file for updating a gear stage: the common tables of a study, and ``[updating]``."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from discrepancy.problem.model import load_model
from discrepancy.problem.study_file import StudyFile, read_study
from estimation.signals.preparation import SignalError
from gearbox.signals.recordings import Recording
from gearbox.signals.signal import Processing
from gearbox.updating.errors import UpdatingError
from gearbox.updating.runs import ModelSource
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.tables import ParameterEntry, UpdatingTable, read_updating
from gearbox.updating.virtual import Settings, VibrationModel
from surrogate import DesignSpace

__all__ = ["load_vibration", "read_updating_study"]


#: Beginnings of the names of modules that no simulation depends on.
#: Where the code is that a simulated signal depends on; what only looks at signals or writes reports changes none.
_SIMULATING = ("files", "parts", "stage", "signals/signal.py", "signals/mesh_lines.py", "updating/virtual.py")


@dataclass(frozen=True)
class UpdatingStudy:
    """A study file as it stands, checked as far as that is possible without model and recordings.

    Parameters
    ----------
    file : StudyFile
        The common tables.
    table : UpdatingTable
    parameters : mapping of str to ParameterEntry
    """

    file: StudyFile
    table: UpdatingTable
    parameters: Mapping[str, ParameterEntry]

    def settings(self, **changes: Any) -> UpdatingSettings:
        """Settings of the chain; ``changes`` such as ``seed`` and ``objective`` take the place of the file's."""
        t, entries = self.table, self.parameters
        values: dict[str, Any] = {
            "space": DesignSpace(
                tuple(entries),
                tuple(e.unit for e in entries.values()),
                tuple(e.min for e in entries.values()),
                tuple(e.max for e in entries.values()),
            ),
            "start": {n: e.start for n, e in entries.items()},
            "sensor": t.sensor,
            "sensors": tuple(t.sensors),
            "driving_teeth": t.driving_teeth,
            "objective": t.objective,
            "processing": self.processing(),
            "rule": t.lag,
            "orders": tuple(t.orders),
            "free_gain": t.free_gain,
            "levels": t.levels,
            "share": t.share,
            "most": t.most,
            "keep": tuple(t.keep),
            "points": tuple(t.points),
            "test": t.test,
            "surface_orders": tuple(t.surface_orders),
            "method": t.method,
            "options": {"population": t.population, "iterations": t.iterations} if t.method == "firefly" else {},
            "seed": t.seed,
            "identify": t.directions,
        }
        return UpdatingSettings(**{**values, **{k: v for k, v in changes.items() if v is not None}})

    def processing(self) -> Processing:
        """How signals are prepared."""
        t = self.table
        if len(t.band) != 2:
            raise SignalError(f"band = {t.band} must be two frequencies, such as [300.0, 1200.0]")
        return Processing(rate=t.rate, band=(t.band[0], t.band[1]), duration=t.duration)

    def virtual(self) -> Settings:
        """How the model is run."""
        t = self.table
        return Settings(
            driving_teeth=t.driving_teeth,
            periodic=t.periodic,
            periods=t.periods,
            duration=self.processing().needed + 0.01,
        )

    def source(self) -> ModelSource:
        """Where the model comes from, for other processes too."""
        return ModelSource(load_vibration, str(self.file.path), self.identity())

    def identity(self) -> str:
        """Return a key that changes with the model, its arguments, its code or a file in the study's folder.

        Stored runs of another key are not used.
        """
        model = self.file.model
        content = hashlib.sha256(json.dumps([model.build, model.arguments], sort_keys=True, default=str).encode())
        source = model.build.rpartition(":")[0]
        home = Path(__file__).parents[1]
        places = [home / place for place in _SIMULATING]
        files = [p for place in places for p in (sorted(place.glob("*.py")) if place.is_dir() else [place])]
        if source.endswith(".py"):
            # What a user's file imports or reads (stage, modes) is in its folder; the study itself is in its arguments.
            folder, study = (self.file.path.parent / source).resolve().parent, self.file.path.resolve()
            files += [p for p in sorted(folder.iterdir()) if p.suffix in (".py", ".toml") and p != study]
        for path in files:
            content.update(path.read_bytes())
        return content.hexdigest()[:16]

    def recordings(self) -> tuple[list[Recording], list[Recording]]:
        """Read the recordings; returns those for updating and those that are held back.

        Raises
        ------
        estimation.RecordError
            With one sentence for each fault of a file.
        """
        t = self.table
        sensors = list(dict.fromkeys([t.sensor, *t.sensors]))
        units = {t.speed: "rad/s", t.load: "N*m", **dict.fromkeys(sensors, "m/s**2")}
        records = self.file.read_records(units)
        identify, validate = (
            [Recording.from_record(r, sensors, t.speed, t.load, _plain(r.path)) for r in part]
            for part in (records.identify, records.validate)
        )
        return identify, validate


def _plain(path: Path) -> str:
    """Name of a file without its endings."""
    return path.name.split(".")[0].replace("_", " ")


def read_updating_study(path: str | Path) -> UpdatingStudy:
    """Read and check a study file with a table ``[updating]``.

    Raises
    ------
    StudyError
        With one sentence for each fault, naming table and key.
    """
    file = read_study(path)
    content = tomllib.loads(file.path.read_text(encoding="utf-8-sig"))
    faults: list[str] = []

    def fault(where: str, text: str) -> None:
        faults.append(f"{file.path.name}, {where}: {text}")

    table = content.get("updating")
    if not isinstance(table, dict):
        raise UpdatingError(
            [f"{file.path.name}, [updating]: the table is missing: say what is compared and what may change"]
        )
    table_content, parameters = read_updating(table, fault)
    for key in ("speed", "load"):
        name = getattr(table_content, key)
        if name and name not in file.inputs:
            fault(f"[updating] {key}", f"'{name}' is not in [inputs]: name the column in which it was recorded")
    for name in dict.fromkeys([table_content.sensor, *table_content.sensors]):
        if name and name not in file.outputs:
            fault("[updating] sensor", f"'{name}' is not in [outputs]: name the column in which it was recorded")
    study = UpdatingStudy(file, table_content, parameters)
    if not faults:
        try:
            study.settings()
        except (UpdatingError, SignalError) as error:
            for text in getattr(error, "faults", (str(error),)):
                fault("[updating]", text)
    if faults:
        raise UpdatingError(faults)
    return study


def load_vibration(path: str) -> VibrationModel:
    """Build a study's model and return it as a function from parameters and condition to vibration.

    The builder may return such a function, or anything with a method ``vibration(values, condition, duration)``.

    Raises
    ------
    StudyError
        If it returns neither.
    """
    file = read_study(path)
    built = load_model(file)
    vibration = getattr(built, "vibration", built)
    if not callable(vibration):
        raise UpdatingError(
            [
                f'{file.path.name}, [model] build = "{file.model.build}": returns {type(built).__name__}, which has no '
                "method vibration(values, condition, duration)"
            ]
        )
    return vibration  # type: ignore[no-any-return]
