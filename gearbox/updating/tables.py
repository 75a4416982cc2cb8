"""The table ``[updating]`` of a study file as typed values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import msgspec

from discrepancy.problem.tables import read_struct
from gearbox.updating.settings import ObjectiveKind

__all__ = ["ParameterEntry", "UpdatingTable", "read_updating"]


class ParameterEntry(msgspec.Struct, frozen=True):
    """An entry of ``[updating.parameters]``: start value and range, in the unit named."""

    start: float
    min: float
    max: float
    unit: str = ""


class UpdatingTable(msgspec.Struct, frozen=True):
    """``[updating]``: what ``vtsdt update-gearbox`` does; see ``docs/howto/update-a-gearbox.md``."""

    sensor: str
    driving_teeth: int
    speed: str
    load: str
    sensors: list[str] = []
    objective: ObjectiveKind = "similarity"
    lag: Literal["best", "mesh", "held", "none"] = "best"
    rate: float = 10_000.0
    band: list[float] = msgspec.field(default_factory=lambda: [300.0, 1200.0])
    duration: float = 0.5
    orders: list[int] = msgspec.field(default_factory=lambda: [1, 2, 3])
    free_gain: bool = False
    levels: int = 9
    share: float = 0.1
    most: int = 3
    keep: list[str] = []
    points: list[int] = msgspec.field(default_factory=lambda: [25, 30, 35, 40, 45, 50])
    test: int = 20
    surface_orders: list[int] = msgspec.field(default_factory=lambda: [2, 3])
    method: Literal["firefly", "differential_evolution", "direct", "multistart"] = "firefly"
    population: int = 30
    iterations: int = 100
    seed: int = 0
    directions: bool = True
    periodic: bool = True
    periods: int = 24


def read_updating(
    table: Mapping[str, Any], fault: Callable[[str, str], None]
) -> tuple[UpdatingTable, dict[str, ParameterEntry]]:
    """Read the table; every fault is reported by ``fault(where, text)``."""
    rest = {key: value for key, value in table.items() if key != "parameters"}
    table_content = read_struct(UpdatingTable, rest, lambda key, text: fault(f"[updating]{key and ' ' + key}", text))
    entries: dict[str, ParameterEntry] = {}
    parameters = table.get("parameters", {})
    if not isinstance(parameters, dict) or not parameters:
        fault("[updating.parameters]", "is missing or empty: K = { start = 8.6e5, min = 4.3e5, max = 12.9e5 }")
        return table_content, entries
    for name, value in parameters.items():
        where = f'[updating.parameters] "{name}"'
        if not isinstance(value, dict):
            fault(where, f"must be a table such as {{ start = 1.0, min = 0.5, max = 2.0 }}, and is {value!r}")
            continue
        before: list[str] = []
        entry = read_struct(ParameterEntry, value, _fault_reporter(where, before, fault))
        if before:
            continue
        if not entry.min < entry.max:
            fault(where, f"min = {entry.min:g} must be below max = {entry.max:g}")
        elif not entry.min <= entry.start <= entry.max:
            fault(where, f"start = {entry.start:g} lies outside {entry.min:g} to {entry.max:g}")
        entries[name] = entry
    return table_content, entries


def _fault_reporter(where: str, messages: list[str], fault: Callable[[str, str], None]) -> Callable[[str, str], None]:
    def report(key: str, text: str) -> None:
        messages.append(text)
        fault(f"{where}{key and ', ' + key}", text)

    return report
