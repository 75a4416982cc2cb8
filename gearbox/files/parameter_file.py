"""Sections of a parameter file checked against dataclasses whose fields carry unit, meaning and bounds."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["hint", "number", "section"]


def number(
    unit: str, meaning: str, *, above: float | None = None, least: float | None = None, default: float | None = None
) -> Any:
    """Return a dataclass field for a number in SI, with its bounds."""
    data = {"unit": unit, "meaning": meaning, "above": above, "least": least}
    return dataclasses.field(metadata=data) if default is None else dataclasses.field(default=default, metadata=data)


def hint(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for a misspelt name, or an empty text."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.55)
    return f"; did you mean '{close[0]}'?" if close else ""


def section(cls: type, given: Mapping[str, Any], key: str, base: Any, faults: list[str]) -> Any:
    """Return an instance of a dataclass from a section of a file; what is wrong goes to ``faults``.

    What is not given is taken from ``base`` where there is one.
    """
    fields = {f.name: f for f in dataclasses.fields(cls)}
    faults += [f"[{key}] has no entry '{k}'{hint(k, fields)}" for k in given if k not in fields]
    values: dict[str, Any] = {}
    for name, item in fields.items():
        where = f"[{key}] {name}"
        if name in given:
            values[name] = _value(given[name], item.metadata, where, faults)
        elif base is not None:
            values[name] = getattr(base, name)
        elif item.default is dataclasses.MISSING:
            faults.append(f"{where} is missing: {item.metadata['meaning']} in {item.metadata['unit'] or '1'}")
    missing = [f for f in fields if f not in values and fields[f].default is dataclasses.MISSING]
    return None if missing else cls(**values)


def _value(value: Any, about: Mapping[str, Any], where: str, faults: list[str]) -> float:
    from multibody.base.units import UnitError, quantity

    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise TypeError(f"{value!r} is not a number")
        found = float(quantity(value, about["unit"]))
    except (UnitError, TypeError, ValueError) as error:
        faults.append(f"{where}: {error}")
        return math.nan
    above, least, unit = about.get("above"), about.get("least"), f" {about['unit']}" if about["unit"] else ""
    if math.isnan(found):
        faults.append(f"{where} is not a number: give a value in {about['unit'] or '1'}")
    elif above is not None and found <= above:
        faults.append(f"{where} is {found:g}{unit}, it must be above {above:g}: {about['meaning']}")
    elif least is not None and found < least:
        faults.append(f"{where} is {found:g}{unit}, it must be at least {least:g}: {about['meaning']}")
    return found
