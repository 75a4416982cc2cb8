"""Sections of a parameter file checked against dataclasses whose fields carry unit, meaning and bounds."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vtsdt.files.rail_profile import Profile

__all__ = ["ParameterError", "hint", "section"]


class ParameterError(ValueError):
    """A parameter file has faults; the message lists all of them."""

    def __init__(self, source: str, faults: list[str]):
        self.faults = list(dict.fromkeys(faults))
        super().__init__(f"{source} cannot be used:\n" + "\n".join(f"  - {f}" for f in self.faults))


def section(cls: type, given: Mapping[str, Any], key: str, base: Any, faults: list[str]) -> Any:
    """Return an instance of a dataclass from a section of a file; what is wrong goes to ``faults``.

    Fields carry unit, meaning and bounds as metadata; a field without any is a rail's profile.  What is not
    given is taken from ``base`` where there is one.
    """
    values: dict[str, Any] = {}
    fields = {f.name: f for f in dataclasses.fields(cls)}
    faults += [f"[{key}] has no entry '{k}'{hint(k, fields)}" for k in given if k not in fields]
    for name, item in fields.items():
        where = f"[{key}] {name}"
        if name not in given:
            if base is not None:
                values[name] = getattr(base, name)
            elif item.default is dataclasses.MISSING:
                faults.append(f"{where} is missing: {item.metadata['meaning']} in {item.metadata['unit'] or '1'}")
            continue
        if not item.metadata:
            values[name] = _profile(given[name], f"[{key}.{name}]", faults)
        elif size := item.metadata.get("size"):
            row = given[name]
            if not isinstance(row, list) or len(row) != size:
                faults.append(f"{where}: give {size} numbers, [x, y, z]")
                continue
            values[name] = tuple(_value(v, item.metadata, where, faults) for v in row)
        else:
            values[name] = _value(given[name], item.metadata, where, faults)
    missing = [f for f in fields if f not in values and fields[f].default is dataclasses.MISSING]
    return None if missing else cls(**values)


def _value(value: Any, about: Mapping[str, Any], where: str, faults: list[str]) -> float:
    from multibody.base.units import UnitError, quantity

    unit = about["unit"] or "1"
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise TypeError(f"{value!r} is not a number")
        number = float(quantity(value, about["unit"]))
    except (UnitError, TypeError, ValueError) as error:
        faults.append(f"{where}: {error}")
        return float("nan")
    above, least = about.get("above"), about.get("least")
    if not np.isfinite(number):
        faults.append(f"{where} is {number}: give a finite number in {unit}")
    elif above is not None and number <= above:
        faults.append(f"{where} is {number:g} {unit}, it must be above {above:g}: {about['meaning']}")
    elif least is not None and number < least:
        faults.append(f"{where} is {number:g} {unit}, it must be at least {least:g}: {about['meaning']}")
    return number


def _profile(given: Any, where: str, faults: list[str]) -> Profile | None:
    from multibody.base.units import UnitError, convert

    if given is False:  # a file that extends another one says that its rail is straight
        return None
    if not isinstance(given, Mapping) or not {"height", "deviation"} <= set(given):
        faults.append(f"{where} needs 'height' and 'deviation' (two lists of the same length)")
        return None
    faults += [f"{where} has no entry '{k}'" for k in given if k not in ("height", "deviation", "unit")]
    try:
        height = np.array(given["height"], dtype=float)
        deviation = np.array(given["deviation"], dtype=float) * convert(1.0, given.get("unit", "m"), "m")
    except (TypeError, ValueError, UnitError) as error:
        faults.append(f"{where}: {error}")
        return None
    if height.ndim != 1 or height.shape != deviation.shape or height.size < 2:
        faults.append(f"{where} needs at least two points, as many heights as deviations")
    elif not (np.all(np.isfinite(height)) and np.all(np.isfinite(deviation))):
        faults.append(f"{where} has values that are not finite")
    elif not np.all(np.diff(height) > 0):
        k = int(np.argmax(np.diff(height) <= 0)) + 1
        faults.append(f"{where}: heights must increase, but {height[k]:g} m follows {height[k - 1]:g} m")
    else:
        return Profile(tuple(map(float, height)), tuple(map(float, deviation)))
    return None


def hint(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for a misspelt name, or an empty text."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.55)
    return f"; did you mean '{close[0]}'?" if close else ""
