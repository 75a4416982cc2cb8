"""Numbers with their units as text, written as engineers write them.

The counterpart of `multibody.base.units`, which reads units; nothing here needs pint.
"""

from __future__ import annotations

import math
import re

__all__ = [
    "bare_unit",
    "count_text",
    "number_text",
    "quantity_text",
    "readable_scale",
    "two_quantities_text",
    "unit_text",
]

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXED = ("m", "N", "N*m", "s", "V", "A", "W", "J", "Pa", "m/s", "rad", "rad/s")


def count_text(count: int, noun: str) -> str:
    """Return a number of things, with the noun in the plural unless there is one.

    Parameters
    ----------
    count : int
    noun : str
        In the singular; its plural ends in "s".

    Examples
    --------
    >>> count_text(1, "record"), count_text(12, "record")
    ('1 record', '12 records')
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"


def unit_text(unit: str) -> str:
    """Return a unit as engineers write it.

    Examples
    --------
    >>> unit_text("N*s/m"), unit_text("kg*m**2"), unit_text("(N*m)/(rad/s)"), unit_text("W/K**4")
    ('N·s/m', 'kg·m²', 'N·m/(rad/s)', 'W/K⁴')
    """
    return re.sub(r"\*\*(-?\d+)", lambda power: power[1].translate(_RAISED), bare_unit(unit)).replace("*", "·")


def bare_unit(unit: str) -> str:
    """Return a unit without brackets that it does not need."""
    inside, closed, rest = unit[1:].partition(")")
    if not unit.startswith("(") or not closed or "(" in inside or ("/" in inside and rest):
        return unit
    return inside + rest


def readable_scale(size: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit with which a size reads well, such as (1e-6, "µm").

    Examples
    --------
    >>> readable_scale(2e-5, "m"), readable_scale(20.0, "N"), readable_scale(2e-5, "kg")
    ((1e-06, 'µm'), (1.0, 'N'), (1.0, 'kg'))
    """
    unit = bare_unit(unit)
    if unit not in _PREFIXED or size == 0.0 or not math.isfinite(size) or 0.1 <= size < 1e4:
        return 1.0, unit_text(unit)
    for factor, prefix in _PREFIXES:
        if size >= 0.9995 * factor:
            return factor, prefix + unit_text(unit)
    return 1.0, unit_text(unit)


def number_text(value: float, digits: int) -> str:
    """Return a number with that many significant digits, with a power of ten where it is very large or small.

    Examples
    --------
    >>> number_text(9.996, 3), number_text(-0.000012, 2), number_text(1234.5, 2)
    ('10.0', '−1.2·10⁻⁵', '1200')
    """
    if value == 0.0:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    # Rounding may add a digit in front, as from 9.99 to 10.0.
    value = round(value, places)
    places = digits - 1 - math.floor(math.log10(abs(value)))
    if not 1e-4 <= abs(value) < 1e7 and value != 0.0:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}".replace("-", "−")
    return f"{value:.{max(0, places)}f}".replace("-", "−")


def quantity_text(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a value with its unit, with a prefix where that reads better.

    Examples
    --------
    >>> quantity_text(1.23e-5, "m"), quantity_text(12.04, "N"), quantity_text(240.4, "N*s/m"), quantity_text(None)
    ('12.3 µm', '12.0 N', '240 N·s/m', 'not known')
    """
    if value is None or not math.isfinite(value):
        return "not known"
    factor, text = readable_scale(abs(value), unit)
    return f"{number_text(value / factor, digits)} {text}".rstrip()


def two_quantities_text(first: float, second: float, unit: str, digits: int = 3) -> tuple[str, str]:
    """Return two values to be compared, both with the same prefix unless one is more than a thousand times the other.

    Examples
    --------
    >>> two_quantities_text(0.192, 0.0999, "rad/s"), two_quantities_text(0.2, 2e-5, "m")
    (('192 mrad/s', '99.9 mrad/s'), ('0.200 m', '20.0 µm'))
    """
    small, large = sorted((abs(first), abs(second)))
    if not (small > 0.0 and large < 1e3 * small):
        return quantity_text(first, unit, digits), quantity_text(second, unit, digits)
    factor, text = readable_scale(small, unit)
    one, other = (f"{number_text(value / factor, digits)} {text}".rstrip() for value in (first, second))
    return one, other
