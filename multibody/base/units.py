"""Conversion of quantities to SI numbers.

Inside the package every number is SI.  Pint is imported only where a unit has to be converted, because its import takes
a noticeable part of the start-up time.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

__all__ = ["UnitError", "base_exponents", "convert", "quantity", "same_dimension", "si_factor"]


#: Conversions that most files need; without them every start would wait for pint to read its definitions.
_USUAL = {
    ("mm", "m"): 1e-3,
    ("cm", "m"): 1e-2,
    ("km", "m"): 1e3,
    ("um", "m"): 1e-6,
    ("µm", "m"): 1e-6,
    ("ms", "s"): 1e-3,
    ("min", "s"): 60.0,
    ("h", "s"): 3600.0,
    ("kN", "N"): 1e3,
    ("kHz", "Hz"): 1e3,
    ("mA", "A"): 1e-3,
    ("mV", "V"): 1e-3,
    ("g", "kg"): 1e-3,
    ("t", "kg"): 1e3,
    ("bar", "Pa"): 1e5,
    ("MPa", "Pa"): 1e6,
    ("GPa", "Pa"): 1e9,
}


_BASE = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
    "radian": "rad",
}


#: Characters of the longest unit that is read; 'kg*m**2/(s**3*A**2*K*mol)' has 25.
LONGEST_UNIT = 80
#: Powers that a text can ask for and a unit does not have: of a number, of a power, or of two digits or more.
#: pint works such a power out, which for 9**9**9 takes hours.
_COSTLY = re.compile(
    r"(?<![A-Za-z_])\d[\d.]*\)*\s*\*\*|\*\*\s*\(*\s*[-+]?\s*\d+(\.\d*)?\)*\s*\*\*|\*\*\s*\(*\s*[-+]?\s*\d{2,}"
)


class UnitError(ValueError):
    """A unit is unknown, or measures another quantity than the required one."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    try:
        registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    except Exception as error:  # pint says of any, also of a lack of memory, that its definitions are wrong
        raise RuntimeError(f"the definitions of units cannot be read ({error}): install pint again") from error
    if "percent" not in registry:  # newer versions of pint know it
        registry.define("percent = 0.01 = %")
    return registry


@lru_cache(maxsize=512)
def _unit(text: str) -> Any:
    cleaned = text.strip().replace("·", "*").replace("²", "**2").replace("³", "**3").replace("^", "**")
    if cleaned in ("", "1", "-"):
        cleaned = "dimensionless"
    example = "'N', 'mm', 'rad/s', 'N*m', 'm/s**2'"
    if len(cleaned) > LONGEST_UNIT or _COSTLY.search(cleaned):
        shown = text if len(text) <= LONGEST_UNIT else f"{text[:LONGEST_UNIT]}…"
        raise UnitError(f"unknown unit '{shown}': write it as in {example}")
    registry = _registry()
    try:
        return registry.parse_units(cleaned)
    except MemoryError:
        raise
    except Exception as error:
        raise UnitError(f"unknown unit '{text}': write it as in {example}") from error


@lru_cache(maxsize=512)
def _line(source: str, target: str) -> tuple[float, float]:
    """Slope and intercept of the conversion from one unit to another."""
    if (source, target) in _USUAL:
        return _USUAL[source, target], 0.0
    a, b = _unit(source), _unit(target)
    if a.dimensionality != b.dimensionality:
        raise UnitError(
            f"'{source}' cannot be converted to '{target}': they measure different quantities, so give a unit that can"
        )
    q = _registry().Quantity
    zero = float(q(0.0, a).to(b).magnitude)
    return float(q(1.0, a).to(b).magnitude) - zero, zero


def convert(value: Any, source: str, target: str) -> Any:
    """Convert a number or array from one unit to another.

    Parameters
    ----------
    value : float or ndarray
        Number(s) in the unit ``source``.
    source, target : str
        Units, such as ``"mm"`` and ``"m"``; the empty string is dimensionless.

    Raises
    ------
    UnitError
        If a unit is unknown or the two measure different quantities.

    Examples
    --------
    >>> round(convert(2.5, "mm", "m"), 6)
    0.0025
    """
    if source == target:
        return value
    slope, zero = _line(source, target)
    return value * slope + zero


def same_dimension(a: str, b: str) -> bool:
    """Tell whether two units measure the same quantity.

    Examples
    --------
    >>> same_dimension("N*m", "J"), same_dimension("kg", "N")
    (True, False)
    """
    return a == b or bool(_unit(a).dimensionality == _unit(b).dimensionality)


def si_factor(unit: str) -> float:
    """Return how many SI base units a unit is.

    Raises
    ------
    UnitError
        If the unit is unknown.

    Examples
    --------
    >>> si_factor("mm/s")
    0.001
    """
    return float(_registry().Quantity(1.0, _unit(unit)).to_base_units().magnitude)


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units (and of rad) in a unit.

    Raises
    ------
    UnitError
        If the unit is unknown, or an exponent is broken.

    Examples
    --------
    >>> base_exponents("N*m/rad")
    {'kg': 1, 'm': 2, 's': -2, 'rad': -1}
    """
    base = dict(_registry().Quantity(1.0, _unit(unit)).to_base_units().unit_items())
    exponents = {symbol: base.get(name, 0) for name, symbol in _BASE.items()}
    if any(power != int(power) for power in exponents.values()):
        raise UnitError(f"'{unit}' has a broken power of a base unit")
    return {symbol: int(power) for symbol, power in exponents.items() if power}


def quantity(value: Any, unit: str) -> float:
    """Return a number in ``unit`` from a number, a text such as ``"95 kg"``, or a pint quantity.

    Raises
    ------
    UnitError
        If the text is not a number with a unit, or the unit measures something else.

    Examples
    --------
    >>> quantity("3 mm", "m")
    0.003
    >>> quantity(3.0, "m")
    3.0
    """
    if isinstance(value, str):
        text = value.strip()
        for cut in range(len(text), 0, -1):
            try:
                number = float(text[:cut])
            except ValueError:
                continue
            return float(convert(number, text[cut:].strip(), unit)) if text[cut:].strip() else number
        raise UnitError(f"'{value}' is not a number with a unit: give one such as '3.2 {unit}'")
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        return float(convert(float(value.magnitude), f"{value.units}", unit))
    return float(value)
