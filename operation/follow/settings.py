"""The tables ``[follow]`` and ``[alarms]`` of a study file."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import msgspec

from discrepancy.problem.study_file import StudyError
from discrepancy.problem.tables import flatten, read_struct

__all__ = ["AlarmRule", "Alarms", "FollowSettings", "read_settings"]

YEAR = 365.25 * 86400.0


class AlarmRule(msgspec.Struct, frozen=True):
    """An entry of ``[alarms.rules]``: a limit of a quantity, or a state, that is worth a notification.

    ``probability`` is how sure it must be that the quantity is beyond the limit.
    """

    quantity: str = ""
    above: float | None = None
    below: float | None = None
    probability: float = 0.95
    state: Literal["", "drifting", "something new", "no data"] = ""


class _FollowTable(msgspec.Struct, frozen=True):
    machine: str = ""
    false_alarms: float = 0.2
    records_per_year: float | None = None
    drift: dict[str, Any] = {}
    fleet_prior: bool = False
    conditions: list[str] = []
    virtual: list[str] = []
    silent_hours: float | None = None
    keep_series_days: float | None = None
    keep_records_days: float | None = None
    checks: bool = True
    search: bool = True
    stamp: str = ""


@dataclass(frozen=True, kw_only=True)
class Alarms:
    """What is worth a notification, and how it is delivered.

    Parameters
    ----------
    rules : mapping of str to AlarmRule
    changes : bool
        Whether every change is an alarm.
    command : tuple of str
        A program and its arguments; it is run without a shell and reads the alarm as JSON.
    webhook : str
        An address to which the alarm is sent as JSON.
    """

    rules: Mapping[str, AlarmRule] = field(default_factory=dict)
    changes: bool = True
    command: tuple[str, ...] = ()
    webhook: str = ""


@dataclass(frozen=True, kw_only=True)
class FollowSettings:
    """How a machine is followed.

    Parameters
    ----------
    machine : str
        Its name in the store; default: the study's.
    false_alarms : float
        Per machine and year, over all quantities together.
    records_per_year : float or None
        For that rate; None: from the median time between records.
    drift : mapping of str to float
        By how much a parameter may move by itself: standard deviation after a year, SI; a parameter that is not named
        may move by its prior deviation.
    fleet_prior : bool
        Whether the priors of its parameters are what the other machines of its store say.
    conditions : tuple of str
        Recorded signals whose mean over a record may explain a change, such as a load or a temperature.
    virtual : tuple of str
        Outputs that are not measured and are computed for every record.
    silent : float or None, s
        Time without a record after which there is no data; None: five times the usual one.
    keep_series, keep_records : float or None, s
        Age after which signals, and records, are forgotten.
    checks : bool
        Whether every record gets the predictive checks of a diagnosis.
    search : bool
        Whether the search for missing effects is called when the model has stopped being right.
    stamp : str
        Format of the time in a file's name, as of `time.strftime`, UTC; empty: the file's own time.
    alarms : Alarms
    """

    machine: str = "machine"
    false_alarms: float = 0.2
    records_per_year: float | None = None
    drift: Mapping[str, float] = field(default_factory=dict)
    fleet_prior: bool = False
    conditions: tuple[str, ...] = ()
    virtual: tuple[str, ...] = ()
    silent: float | None = None
    keep_series: float | None = None
    keep_records: float | None = None
    checks: bool = True
    search: bool = True
    stamp: str = ""
    alarms: Alarms = field(default_factory=Alarms)

    def with_drift_of(self, priors: Mapping[str, tuple[float, float]]) -> FollowSettings:
        """Return settings that keep the usual drifts of some priors, whatever priors are used later."""
        usual = {name: std for name, (_, std) in priors.items() if math.isfinite(std)}
        return replace(self, drift={**usual, **self.drift})


def read_settings(path: str | Path) -> FollowSettings:
    """Read ``[follow]`` and ``[alarms]`` of a study file; both are optional.

    Raises
    ------
    StudyError
        With every fault.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise StudyError([f"{path.name}: cannot be read: {error}"]) from error
    faults: list[str] = []

    def fault(where: str, text: str) -> None:
        faults.append(f"{path.name}, {where}: {text}")

    def table(name: str) -> dict[str, Any]:
        value = content.get(name, {})
        if isinstance(value, dict):
            return value
        fault(f"[{name}]", f"must be a table, and is {value!r}")
        return {}

    given = read_struct(_FollowTable, table("follow"), lambda key, text: fault(f"[follow]{key and ' ' + key}", text))
    drift = _numbers(given.drift, fault)
    for key in ("false_alarms", "records_per_year", "silent_hours", "keep_series_days", "keep_records_days"):
        value = getattr(given, key)
        if value is not None and not 0.0 < value < float("inf"):
            fault(f"[follow] {key}", f"is {value}: give a number above zero")
    alarms = _alarms(table("alarms"), fault)
    if faults:
        raise StudyError(faults)
    name = path.stem if path.stem != "study" else path.absolute().parent.name
    return FollowSettings(
        machine=given.machine or name,
        false_alarms=given.false_alarms,
        records_per_year=given.records_per_year,
        drift=drift,
        fleet_prior=given.fleet_prior,
        conditions=tuple(given.conditions),
        virtual=tuple(given.virtual),
        silent=_times(given.silent_hours, 3600.0),
        keep_series=_times(given.keep_series_days, 86400.0),
        keep_records=_times(given.keep_records_days, 86400.0),
        checks=given.checks,
        search=given.search,
        stamp=given.stamp,
        alarms=alarms,
    )


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit


def _numbers(given: Mapping[str, Any], fault: Callable[[str, str], None]) -> dict[str, float]:
    """Return the drifts, of names with dots in quotes or without."""
    out: dict[str, float] = {}

    def walk(prefix: str, entries: Mapping[str, Any]) -> None:
        for key, value in entries.items():
            if isinstance(value, Mapping):
                walk(f"{prefix}{key}.", value)
            elif isinstance(value, int | float) and not isinstance(value, bool) and value >= 0.0:
                out[prefix + key] = float(value)
            else:
                fault(f'[follow] drift "{prefix}{key}"', f"is {value!r}: give a standard deviation after a year, SI")

    walk("", given)
    return out


def _within(fault: Callable[[str, str], None], where: str) -> Callable[[str, str], None]:
    return lambda key, text: fault(f"{where} {key}".rstrip(), text)


def _alarms(table: Mapping[str, Any], fault: Callable[[str, str], None]) -> Alarms:
    known = ("rules", "changes", "command", "webhook")
    for key in table:
        if key not in known:
            from multibody.base.spelling import nearest_or_choices

            fault(f"[alarms] {key}", f"there is no such key{nearest_or_choices(key, known)}")
    command = table.get("command", [])
    if not (isinstance(command, list) and all(isinstance(word, str) for word in command)):
        fault("[alarms] command", f'is {command!r}: give program and arguments as a list, ["/usr/bin/notify", "-v"]')
        command = []
    webhook = table.get("webhook", "")
    if webhook and (not isinstance(webhook, str) or urlsplit(webhook).scheme not in ("http", "https")):
        fault("[alarms] webhook", f"is {webhook!r}: give an address that begins with https://")
        webhook = ""
    changes = table.get("changes", True)
    if not isinstance(changes, bool):
        fault("[alarms] changes", f"is {changes!r}: write true or false")
    rules: dict[str, AlarmRule] = {}
    given = table.get("rules", {})
    if not isinstance(given, dict):
        fault("[alarms.rules]", f"must be a table, and is {given!r}")
        given = {}

    def twice(name: str) -> None:
        fault(f'[alarms.rules] "{name}"', "is given twice, quoted and bare: keep one of the two")

    for name, entry in flatten(given, AlarmRule, twice).items():
        where = f'[alarms.rules] "{name}"'
        if not isinstance(entry, dict):
            fault(where, f'must be a table such as {{ quantity = "…", above = 1.0 }}, and is {entry!r}')
            continue
        rule = read_struct(AlarmRule, entry, _within(fault, where))
        limits = (rule.above is not None) + (rule.below is not None)
        if bool(rule.state) == bool(rule.quantity) or (rule.quantity and limits != 1):
            fault(where, "give a quantity with either above or below, or a state")
        if not 0.5 <= rule.probability < 1.0:
            fault(where, f"probability is {rule.probability}: give 0.5 to below 1")
        rules[name] = rule
    return Alarms(rules=rules, changes=bool(changes), command=tuple(command), webhook=str(webhook))
