"""Parameter files: TOML sections checked against dataclasses whose fields carry unit, meaning and bounds."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeVar, get_type_hints

from multibody.base.spelling import nearest
from multibody.base.units import UnitError, quantity

__all__ = ["ParameterError", "load_parameters", "number"]


class ParameterError(ValueError):
    """Parameters cannot be used; the message lists all faults.

    Parameters
    ----------
    source : str
        What has the faults, such as a file.
    faults : iterable of str
        One sentence each, naming section and key, and the remedy.
    """

    def __init__(self, source: str, faults: Iterable[str]):
        self.faults = list(dict.fromkeys(faults))
        super().__init__(f"{source} cannot be used:\n" + "\n".join(f"  - {f}" for f in self.faults))


class ParameterSet(Protocol):
    """A dataclass with a name, a dataclass for each section, and a check of how the sections fit together."""

    @property
    def name(self) -> str:
        """Name of the set."""

    def faults(self) -> list[str]:
        """Return the contradictions between sections, each naming its section."""


Parameters = TypeVar("Parameters", bound=ParameterSet)


def number(
    unit: str,
    meaning: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    whole: bool = False,
    size: int | None = None,
    infinite: bool = False,
    default: float | None = None,
) -> Any:
    """Return a dataclass field for a number in SI, or for a list of ``size`` numbers.

    Parameters
    ----------
    unit : str
        SI unit; "" is dimensionless.
    meaning : str
        What the number is, as error messages print it.
    above, least, most : float, optional
        Bounds: the number is larger than ``above``, at least ``least`` and at most ``most``.
    whole : bool
        Whether it counts something.
    size : int, optional
        Length of the list; default: one number.
    infinite : bool
        Whether infinity is allowed.
    default : float, optional
        Value where the file gives none; default: the file must give one.
    """
    data = {"unit": unit, "meaning": meaning, "above": above, "least": least, "most": most, "whole": whole}
    data |= {"size": size, "infinite": infinite}
    return dataclasses.field(metadata=data) if default is None else dataclasses.field(default=default, metadata=data)


def load_parameters(
    cls: Callable[..., Parameters],
    path: str | Path,
    kind: str,
    bases: Mapping[str, Callable[[], Parameters]],
    error: type[ParameterError] = ParameterError,
) -> Parameters:
    """Read a TOML file into a set of parameters.

    Parameters
    ----------
    cls : type of ParameterSet
        Dataclass with the fields ``name`` and one dataclass for each section.
    path : str or Path
    kind : str
        What the file describes, such as ``"lift"``.
    bases : dict
        Shipped sets by name: a file that ``extends`` one of them gives only what differs.
    error : type
        Class of the error.

    Raises
    ------
    ParameterError
        With every unknown, missing or impossible entry.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise error(f"'{path}'", [f"is not valid TOML: {fault}"]) from None
    faults: list[str] = []
    extends = content.pop("extends", None)
    if extends is not None and extends not in list(bases):
        faults.append(f"extends = {extends!r}: only " + " or ".join(f'"{b}"' for b in bases) + " can be extended")
        extends = None
    base = bases[extends]() if extends is not None else None
    name = content.pop("name", base.name if base else kind)
    if not isinstance(name, str):
        faults.append("name must be a text")
    sections = {key: part for key, part in get_type_hints(cls).items() if key != "name"}
    faults += [f"[{k}] is not a section of a {kind}{nearest(k, sections)}" for k in content if k not in sections]
    parts: dict[str, Any] = {}
    for key, part in sections.items():
        given = content.get(key, {})
        if isinstance(given, Mapping):
            parts[key] = _section(part, given, key, getattr(base, key) if base else None, faults)
        else:
            faults.append(f"'{key}' must be a section: [{key}]")
    if faults:
        raise error(f"'{path}'", faults)
    parameters = cls(name=name, **parts)
    if contradictions := parameters.faults():
        raise error(f"'{path}'", contradictions)
    return parameters


def _section(cls: type, given: Mapping[str, Any], key: str, base: Any, faults: list[str]) -> Any:
    """Return the dataclass of a section, or None where it cannot be made; what is wrong is added to ``faults``.

    A field made by `number` is read here; any other has a function ``read(given, where, faults)`` in its metadata.
    """
    values: dict[str, Any] = {}
    fields = {f.name: f for f in dataclasses.fields(cls)}
    faults += [f"[{key}] has no entry '{k}'{nearest(k, fields)}" for k in given if k not in fields]
    for name, item in fields.items():
        about, where = item.metadata, f"[{key}] {name}"
        if name not in given:
            if base is not None:
                values[name] = getattr(base, name)
            elif item.default is dataclasses.MISSING:
                faults.append(f"{where} is missing: {about['meaning']} in {about['unit'] or '1'}")
        elif "read" in about:
            values[name] = about["read"](given[name], f"[{key}.{name}]", faults)
        elif size := about["size"]:
            row = given[name]
            if not isinstance(row, list) or len(row) != size:
                faults.append(f"{where}: give {size} numbers, [x, y, z]")
                continue
            values[name] = tuple(_number(v, about, where, faults) for v in row)
        else:
            values[name] = _number(given[name], about, where, faults)
    missing = [f for f in fields if f not in values and fields[f].default is dataclasses.MISSING]
    return None if missing else cls(**values)


def _number(given: Any, about: Mapping[str, Any], where: str, faults: list[str]) -> float:
    try:
        if isinstance(given, bool) or not isinstance(given, int | float | str):
            raise TypeError(f"{given!r} is not a number")
        value = float(quantity(given, about["unit"]))
    except (UnitError, TypeError, ValueError) as error:
        faults.append(f"{where}: {error}")
        return math.nan
    above, least, unit = about["above"], about["least"], f" {about['unit']}" if about["unit"] else ""
    if math.isnan(value) or (math.isinf(value) and not about["infinite"]):
        faults.append(f"{where} is {value}: give a finite number in {about['unit'] or '1'}")
    elif above is not None and value <= above:
        faults.append(f"{where} is {value:g}{unit}, it must be above {above:g}: {about['meaning']}")
    elif least is not None and value < least:
        faults.append(f"{where} is {value:g}{unit}, it must be at least {least:g}: {about['meaning']}")
    elif about["most"] is not None and value > about["most"]:
        faults.append(f"{where} is {value:g}{unit}, it must be at most {about['most']:g}: {about['meaning']}")
    elif about["whole"] and not value.is_integer():
        faults.append(f"{where} is {value:g}{unit}, it must be a whole number: {about['meaning']}")
    return value
