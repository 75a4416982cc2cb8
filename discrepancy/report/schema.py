"""The check that a dict is a ``diagnosis.json`` of schema 1, for scripts that read one and for tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["SCHEMA", "VERDICTS", "check_diagnosis"]

SCHEMA = 1
VERDICTS = ("nothing missing", "effect found", "unknown effect", "ambiguous", "partly explained")
WHERE_LISTS = ("signals", "regimes", "frequencies", "connections")

_Test = Callable[[Any], bool]


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number_or_none(value: Any) -> bool:
    return value is None or _number(value)


def _text(value: Any) -> bool:
    return isinstance(value, str)


_TOP: dict[str, tuple[_Test, str]] = {
    "schema": (lambda v: v == SCHEMA, f"the number {SCHEMA}"),
    "verdict": (lambda v: v in VERDICTS, "one of " + ", ".join(f"'{v}'" for v in VERDICTS)),
    "effects": (lambda v: isinstance(v, list), "a list"),
    "stages": (lambda v: isinstance(v, list) and len(v) > 0, "a list with at least one stage"),
    "where_it_fails": (lambda v: isinstance(v, Mapping), "an object"),
    "noise_floor": (
        lambda v: isinstance(v, Mapping) and all(_number(x) for x in v.values()),
        "numbers by output",
    ),
    "explained": (_number, "a number"),
    "refused": (lambda v: isinstance(v, list), "a list"),
}
_EFFECT: dict[str, tuple[_Test, str]] = {
    "kind": (_text, "text"),
    "where": (_text, "text"),
    "parameters": (lambda v: isinstance(v, Mapping), "an object"),
    "p_value": (lambda v: v is None or (_number(v) and 0.0 <= v <= 1.0), "a number from 0 to 1"),
    "delta_bic": (_number_or_none, "a number"),
    "indistinguishable_from": (lambda v: isinstance(v, list), "a list"),
    "runners_up": (lambda v: isinstance(v, list), "a list"),
}
_RIVAL: dict[str, tuple[_Test, str]] = {
    "kind": (_text, "text"),
    "where": (_text, "text"),
    "delta_bic": (_number_or_none, "a number"),
}
_REFUSED: dict[str, tuple[_Test, str]] = {
    "kind": (_text, "text"),
    "where": (_text, "text"),
    "why": (_text, "text"),
}
_PARAMETER: dict[str, tuple[_Test, str]] = {
    "value": (lambda v: _number_or_none(v) or _text(v), "a number"),
    "std": (_number_or_none, "a number or null"),
    "unit": (_text, "text"),
}
_SIGNAL: dict[str, tuple[_Test, str]] = {
    "rmse": (_number, "a number"),
    "nrmse": (_number_or_none, "a number"),
    "pearson": (_number_or_none, "a number"),
}


def check_diagnosis(diagnosis: Any) -> list[str]:
    """Return every fault of a diagnosis; empty if it has the form of schema 1.

    Examples
    --------
    >>> check_diagnosis({"schema": 2})[0]
    'schema must be the number 1, it is 2'
    """
    if not isinstance(diagnosis, Mapping):
        return [f"a diagnosis must be an object, it is {type(diagnosis).__name__}"]
    faults = _fields(diagnosis, _TOP, "")
    for k, effect in enumerate(_items(diagnosis, "effects")):
        at = f"effects[{k}]."
        faults += _fields(effect, _EFFECT, at)
        for name in ("indistinguishable_from", "runners_up"):
            for j, rival in enumerate(_items(effect, name)):
                faults += _fields(rival, _RIVAL, f"{at}{name}[{j}].")
        parameters = effect.get("parameters") if isinstance(effect, Mapping) else None
        for name, entry in parameters.items() if isinstance(parameters, Mapping) else ():
            if name != "curve":
                faults += _fields(entry, _PARAMETER, f"{at}parameters.{name}.")
    for k, stage in enumerate(_items(diagnosis, "stages")):
        faults += _stage_faults(stage, f"stages[{k}].")
    where = diagnosis.get("where_it_fails")
    if isinstance(where, Mapping):
        faults += [
            f"where_it_fails.{name} must be a list, it is {where.get(name)!r}"
            for name in WHERE_LISTS
            if not isinstance(where.get(name), list)
        ]
    for k, entry in enumerate(_items(diagnosis, "refused")):
        faults += _fields(entry, _REFUSED, f"refused[{k}].")
    if diagnosis.get("verdict") in ("effect found", "ambiguous", "partly explained") and not diagnosis.get("effects"):
        faults.append(f"the verdict '{diagnosis['verdict']}' needs an effect, and there is none")
    if diagnosis.get("verdict") == "nothing missing" and diagnosis.get("effects"):
        faults.append("the verdict 'nothing missing' contradicts the effects")
    return faults


def _items(diagnosis: Any, name: str) -> list[Any]:
    items = diagnosis.get(name) if isinstance(diagnosis, Mapping) else None
    return items if isinstance(items, list) else []


def _fields(entry: Any, wanted: Mapping[str, tuple[_Test, str]], at: str) -> list[str]:
    if not isinstance(entry, Mapping):
        return [f"{at.rstrip('.')} must be an object, it is {entry!r}"]
    faults = []
    for name, (good, expected) in wanted.items():
        if name not in entry:
            faults.append(f"{at}{name} is missing: it must be {expected}")
        elif not good(entry[name]):
            faults.append(f"{at}{name} must be {expected}, it is {entry[name]!r}")
    return faults


def _stage_faults(stage: Any, at: str) -> list[str]:
    faults = _fields(stage, {"name": (_text, "text")}, at)
    for part in ("identify", "validate"):
        outputs = stage.get(part) if isinstance(stage, Mapping) else None
        if not isinstance(outputs, Mapping):
            faults.append(f"{at}{part} must be an object, it is {outputs!r}")
            continue
        for output, figures in outputs.items():
            faults += _fields(figures, _SIGNAL, f"{at}{part}.{output}.")
    return faults
