"""The settings of ``vtsdt what-if``: a TOML file, recordings, or both."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from multibody.base.parameter_file import ParameterError
from multibody.base.spelling import nearest
from vtsdt.whatif.compare import COLUMNS
from vtsdt.whatif.study import Uncertainty, default_uncertainties, uncertainties_from

__all__ = ["Settings", "read_settings"]

_TABLES: dict[str, tuple[str, ...]] = {
    "lift": ("parameters",),
    "profile": ("file",),
    "trips": ("files", "time", "columns"),
    "actions": ("threshold_mm", "lubrication", "direction"),
    "threshold": ("fraction",),
    "study": ("samples", "seed"),
    "use": ("trips_per_day", "price_per_kWh", "currency"),
    "uncertain": (),
    "configuration": ("name", "profile", "trips"),
}


@dataclass(frozen=True)
class ConfigurationFiles:
    """Files of one configuration of the guides."""

    name: str
    profile: Path
    trips: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a what-if study.

    Parameters
    ----------
    lift, profile : Path or None
        Parameter file of the lift and estimated profile; default: the shipped bench and its own rail.
    trips : tuple of Path
        Measured trips, for comparing and for ride comfort.
    time : str
        Column of the time.
    columns : mapping of str to str
        Quantity to column, where a recording has other columns than the virtual lift.
    threshold : float, m
    lubrication : float
    direction : str
    fraction : float
        Share of the configurations that are to be below the threshold.
    configurations : tuple of ConfigurationFiles
        From which the threshold follows, in place of ``threshold``.
    uncertainties : tuple of Uncertainty
    samples, seed : int
    trips_per_day, price, currency
        For savings in a year; left out for zero trips.
    """

    lift: Path | None = None
    profile: Path | None = None
    trips: tuple[Path, ...] = ()
    time: str = "time_s"
    columns: Mapping[str, str] = field(default_factory=dict)
    threshold: float = 2.3e-3
    lubrication: float = 0.9
    direction: str = "up"
    fraction: float = 0.7
    configurations: tuple[ConfigurationFiles, ...] = ()
    uncertainties: tuple[Uncertainty, ...] = field(default_factory=default_uncertainties)
    samples: int = 40
    seed: int = 0
    trips_per_day: float = 0.0
    price: float = 0.0
    currency: str = "EUR"

    def with_options(self, **options: Any) -> Settings:
        """Return the settings with the given options replaced (those that are not None)."""
        return replace(self, **{k: v for k, v in options.items() if v is not None})


def read_settings(path: str | Path) -> Settings:
    """Read a settings file; its paths are relative to it.

    Raises
    ------
    ParameterError
        With every unknown table and key, every value of the wrong kind and every missing file.
    """
    path = Path(path)
    if not path.is_file():
        raise ParameterError(f"'{path}'", ["there is no such settings file"])
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"'{path}'", [f"is not valid TOML: {error}"]) from None
    reader = _Reader(path.parent, content)
    settings = reader.read()
    if reader.faults:
        raise ParameterError(f"'{path}'", reader.faults)
    return settings


class _Reader:
    """Collects the faults of a settings file while it is read."""

    def __init__(self, folder: Path, content: Mapping[str, Any]) -> None:
        self.folder, self.content, self.faults = folder, content, list[str]()

    def table(self, name: str) -> Mapping[str, Any]:
        value = self.content.get(name, {})
        if not isinstance(value, Mapping):
            self.faults.append(f"[{name}] must be a table")
            return {}
        known = _TABLES[name]
        if known:
            self.faults += [f"[{name}] has no entry '{k}'{nearest(k, known)}" for k in value if k not in known]
        return value

    def number(self, table: str, key: str, default: float, low: float, high: float) -> float:
        value = self.table(table).get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            self.faults.append(f"[{table}] {key} is {value!r}: give a number from {low:g} to {high:g}")
            return default
        return float(value)

    def file(self, where: str, given: Any) -> Path | None:
        if not isinstance(given, str):
            self.faults.append(f"{where} must be a path in quotes, and is {given!r}")
            return None
        path = self.folder / given
        if not path.is_file():
            self.faults.append(f"{where}: there is no file '{given}' in the folder of the settings")
        return path

    def files(self, where: str, given: Any) -> tuple[Path, ...]:
        patterns = [given] if isinstance(given, str) else given
        if not isinstance(patterns, Sequence) or not all(isinstance(p, str) for p in patterns):
            self.faults.append(f"{where} must be a list of paths in quotes")
            return ()
        paths: list[Path] = []
        for pattern in patterns:
            matched = sorted(self.folder.glob(pattern)) if not Path(pattern).is_absolute() else [Path(pattern)]
            matched = [m for m in matched if m.is_file()]
            if not matched:
                self.faults.append(f"{where}: no file matches '{pattern}'")
            paths += matched
        return tuple(dict.fromkeys(paths))

    def read(self) -> Settings:
        self.faults += [f"there is no table [{k}]{nearest(k, _TABLES)}" for k in self.content if k not in _TABLES]
        lift, profile, trips, actions = (self.table(n) for n in ("lift", "profile", "trips", "actions"))
        direction = actions.get("direction", "up")
        if direction not in ("up", "down"):
            self.faults.append(f"[actions] direction is {direction!r}: give 'up' or 'down'")
        columns = trips.get("columns", {})
        if not isinstance(columns, Mapping):
            self.faults.append('[trips.columns] must be a table: quantity = "column"')
            columns = {}
        else:
            self.faults += [
                f"[trips.columns] has no quantity '{k}'{nearest(k, COLUMNS)}" for k in columns if k not in COLUMNS
            ]
        try:
            known = "uncertain" in self.content
            uncertainties = uncertainties_from(self.table("uncertain")) if known else default_uncertainties()
        except (KeyError, TypeError, ValueError) as error:
            self.faults.append(
                f'[uncertain]: {error}: give a share, "*.mu" = 0.1, or {{ std = 0.03, relative = false }}'
            )
            uncertainties = default_uncertainties()
        return Settings(
            lift=self.file("[lift] parameters", lift["parameters"]) if "parameters" in lift else None,
            profile=self.file("[profile] file", profile["file"]) if "file" in profile else None,
            trips=self.files("[trips] files", trips["files"]) if "files" in trips else (),
            time=str(trips.get("time", "time_s")),
            columns=dict(columns),
            threshold=1e-3 * self.number("actions", "threshold_mm", 2.3, 0.01, 50.0),
            lubrication=self.number("actions", "lubrication", 0.9, 0.01, 1.5),
            direction=str(direction),
            fraction=self.number("threshold", "fraction", 0.7, 0.01, 0.99),
            configurations=self.configurations(),
            uncertainties=uncertainties,
            samples=int(self.number("study", "samples", 40, 0, 100000)),
            seed=int(self.number("study", "seed", 0, 0, 2**31)),
            trips_per_day=self.number("use", "trips_per_day", 0.0, 0.0, 1e5),
            price=self.number("use", "price_per_kWh", 0.0, 0.0, 1e3),
            currency=str(self.table("use").get("currency", "EUR")),
        )

    def configurations(self) -> tuple[ConfigurationFiles, ...]:
        given = self.content.get("configuration", [])
        if not isinstance(given, list):
            self.faults.append("write each configuration as [[configuration]]")
            return ()
        configurations = []
        for k, table in enumerate(given, 1):
            where = f"[[configuration]] {k}"
            self.faults += [f"{where} has no entry '{n}'" for n in table if n not in _TABLES["configuration"]]
            missing = [n for n in ("profile", "trips") if n not in table]
            self.faults += [f"{where}: '{n}' is missing" for n in missing]
            if missing:
                continue
            profile = self.file(f"{where} profile", table["profile"])
            trips = self.files(f"{where} trips", table["trips"])
            if profile is not None:
                configurations.append(ConfigurationFiles(str(table.get("name", f"{k}")), profile, trips))
        return tuple(configurations)
