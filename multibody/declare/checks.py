"""Faults in the declarations of a component class: names, units, bounds, references of ports."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any

from multibody.base.spelling import nearest
from multibody.base.units import UnitError, convert, same_dimension, si_factor
from multibody.declare.component import Component
from multibody.declare.declarations import Output, Parameter, Port, Power, Rotation, State, Table

__all__ = ["declaration_faults", "name_fault"]

_RESERVED = frozenset(vars(Component)) | frozenset(
    ("der", "zero", "time", "values", "tables", "options", "starts", "faults", "units", "declarations", "assemble")
)
_COHERENT = frozenset(
    [
        "m",
        "kg",
        "s",
        "A",
        "K",
        "rad",
        "N",
        "J",
        "W",
        "V",
        "C",
        "F",
        "H",
        "ohm",
        "S",
        "T",
        "Wb",
        "Pa",
        "Hz",
        "mol",
        "cd",
    ]
)


def name_fault(name: str) -> str | None:
    """Return what is wrong with a name, or None; ``variable`` relies on these rules."""
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        return "use letters, digits and underscores, with a letter first"
    if name.endswith("_") or "__" in name:
        return "use no underscore at the end and no two in a row"
    return None


def declaration_faults(component: Component) -> list[str]:
    """Return everything that is wrong with the declarations of a component."""
    faults: list[str] = []
    for name, item in component.declarations.items():
        if (why := name_fault(name)) is not None:
            faults.append(f"'{name}' cannot be the name of a {type(item).__name__}: {why}")
        elif name in _RESERVED:
            what = type(item).__name__
            faults.append(f"'{name}' is reserved in every component: give the {what} another name")
        for unit in (getattr(item, key, None) for key in ("unit", "x_unit")):
            if unit is not None and "{" not in unit and (fault := _unit_fault(unit)):
                faults.append(f"{type(item).__name__} '{name}': {fault}")
        if isinstance(item, Parameter):
            faults += _parameter_faults(item)
        elif isinstance(item, Table) and item.interpolation not in ("linear", "cubic"):
            faults.append(f"table '{name}': interpolation '{item.interpolation}' is unknown: take 'linear' or 'cubic'")
        elif isinstance(item, Power) and item.kind not in ("loss", "supply"):
            faults.append(f"power '{name}': kind '{item.kind}' is unknown: take 'loss' or 'supply'")
        elif isinstance(item, Port):
            faults += _port_faults(component, item)
    return faults + _names_of_motion(component) + _feature_faults(component)


@lru_cache(maxsize=512)
def _unit_fault(unit: str) -> str | None:
    words = re.split(r"\*\*-?\d+|[*/()\s]+", unit)
    if all(word in _COHERENT or word in ("", "1") for word in words):
        return None  # plain products of SI units need no pint, which is slow to import
    try:
        base = next((u for u in sorted(_COHERENT) if same_dimension(unit, u)), None)
        factor = convert(1.0, unit, base) if base else si_factor(unit)
    except UnitError as error:
        return str(error)
    if not math.isclose(factor, 1.0, rel_tol=1e-12):
        return f"unit '{unit}' is not SI: declare it in SI units, values may be given in any unit"
    return None


def _parameter_faults(item: Parameter) -> list[str]:
    numbers = {"default": item.default, "min": item.min, "max": item.max}
    faults = [
        f"parameter '{item.name}': {what} is {value!r}, not a number: give one"
        for what, value in numbers.items()
        if value is not None and not isinstance(value, int | float)
    ]
    if not faults and item.min is not None and item.max is not None and item.min > item.max:
        faults.append(f"parameter '{item.name}': min {item.min:g} is above max {item.max:g}")
    return faults


def _port_faults(component: Component, item: Port) -> list[str]:
    inertia = getattr(item, "inertia", None)
    if inertia is None:
        return []
    parameters = component.of_kind((Parameter, Output))  # type: ignore[arg-type]
    if inertia not in parameters:
        hint = nearest(inertia, parameters)
        return [f"port '{item.name}': inertia='{inertia}' is not a declared parameter{hint}"]
    unit = "kg*m**2" if isinstance(item, Rotation) else "kg"
    declared = parameters[inertia].unit
    if declared != unit and (_unit_fault(declared) or not same_dimension(declared or "1", unit)):
        return [f"port '{item.name}': its inertia '{inertia}' is in {declared or '1'}, it has to be in {unit}"]
    return []


def _names_of_motion(component: Component) -> list[str]:
    """Return the faults of declared names that the motion of an inertial port has as well."""
    inertial = [p for p in component.of_kind(Port).values() if getattr(p, "inertia", None)]
    taken = {"kinetic_energy"} if inertial else set()
    for port in inertial:
        prefix = "" if len(inertial) == 1 else f"{port.name}_"
        taken |= {prefix + what for what in (port.potential, port.rate, "acceleration")}
    named: dict[str, Any] = component.of_kind((Output, State, Parameter))  # type: ignore[arg-type]
    return [
        f"{type(item).__name__} '{name}' has the name of a quantity of the port with inertia: rename it"
        for name, item in named.items()
        if name in taken
    ]


def _feature_faults(component: Component) -> list[str]:
    widths = [*component.of_kind(Parameter), *component.of_kind(Table), *component.of_kind(Output)]
    speeds = ["time", *component.of_kind(Output)]
    faults = []
    for width, speed in component.features.items():
        if width in component.__class__.declarations and width not in component.declarations:
            continue  # left out by an option
        if width not in widths:
            faults.append(f"features: '{width}' is no parameter, table or output{nearest(width, widths)}")
        if speed not in speeds and speed not in component.__class__.declarations:
            faults.append(f"features: '{speed}' is no output{nearest(speed, speeds)}")
    return faults
