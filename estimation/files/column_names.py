"""Column names taken apart into quantity and unit, and the unit spellings of measurement files."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from multibody.base.units import UnitError, convert, same_dimension

__all__ = ["is_unit", "pint_unit", "read_column_name", "si_unit_of", "to_si"]

# Suffixes are listed, not guessed: 'angle_a' or 'sensor_left' must not become years or litres.  Left the
# ending as it stands in a column name, right the unit as multibody.base.units understands it.
_ATOMS = {
    "m": "m",
    "mm": "mm",
    "cm": "cm",
    "km": "km",
    "um": "um",
    "inch": "inch",
    "ft": "ft",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "h": "hour",
    "rad": "rad",
    "mrad": "mrad",
    "urad": "urad",
    "deg": "deg",
    "rev": "turn",
    "kg": "kg",
    "N": "N",
    "kN": "kN",
    "mN": "mN",
    "MN": "MN",
    "lbf": "lbf",
    "Nm": "N*m",
    "mNm": "mN*m",
    "kNm": "kN*m",
    "uNm": "uN*m",
    "Nmm": "N*mm",
    "Nms": "N*m*s",
    "Ns": "N*s",
    "Pa": "Pa",
    "kPa": "kPa",
    "MPa": "MPa",
    "hPa": "hPa",
    "bar": "bar",
    "mbar": "mbar",
    "W": "W",
    "kW": "kW",
    "mW": "mW",
    "J": "J",
    "kJ": "kJ",
    "mJ": "mJ",
    "V": "V",
    "mV": "mV",
    "kV": "kV",
    "A": "A",
    "mA": "mA",
    "uA": "uA",
    "kA": "kA",
    "ohm": "ohm",
    "Wb": "Wb",
    "mH": "mH",
    "Hz": "Hz",
    "kHz": "kHz",
    "MHz": "MHz",
    "rpm": "rpm",
    "g0": "g_0",
    "K": "K",
    "degC": "degC",
    "degF": "degF",
    "percent": "percent",
    "pct": "percent",
}
# Endings that are words as often as units: taken as a unit only where the caller expects that quantity.
_WORDS = {"min": "min", "g": "g"}
_SHORT_RATES = {
    "m_s",
    "mm_s",
    "km_h",
    "rad_s",
    "deg_s",
    "m_s2",
    "mm_s2",
    "rad_s2",
    "deg_s2",
    "rad_s3",
    "m_s3",
}
_SI_TEXTS = (
    "m",
    "s",
    "kg",
    "N",
    "m/s",
    "m/s**2",
    "rad/s",
    "rad/s**2",
    "V",
    "A",
    "K",
    "Pa",
    "N*m",
    "W",
    "N/m",
    "N*s/m",
    "N*m*s",
    "ohm",
    "kg*m**2",
    "Wb",
    "H",
    "m**3/s",
    "m/s**3",
)
_ANGLES = re.compile(r"rad|deg(?!C|F)|turn|rev|rpm|°(?!\s*[CF])|gon|arcmin|arcsec")
_CYCLES = re.compile(r"Hz|hertz")
_SHARES = re.compile(r"%|percent|pct|ppm|permille")


@dataclass(frozen=True)
class ColumnName:
    """The name of a column, taken apart.

    Attributes
    ----------
    column : str
        The name as in the file.
    quantity : str
        The name without its unit.
    unit : str or None
        The unit in a spelling that :mod:`multibody.base.units` understands; None where the name gives none.
    """

    column: str
    quantity: str
    unit: str | None


def pint_unit(text: str) -> str:
    """Rewrite the unit spellings of measurement files into one that :mod:`multibody.base.units` understands.

    Examples
    --------
    >>> pint_unit("Nm"), pint_unit("m/s2"), pint_unit("°C"), pint_unit("U/min"), pint_unit("-")
    ('N*m', 'm/s**2', 'degC', 'rpm', '')
    """
    unit = text.strip().replace("µ", "u").replace("μ", "u").replace("Ω", "ohm").replace("Ω", "ohm")
    unit = unit.replace("·", "*").replace("⋅", "*").replace("²", "**2").replace("³", "**3").replace("^", "**")
    if unit in ("", "-", "1", "–", "none", "dimensionless"):
        return ""
    if unit in ("U/min", "r/min", "rev/min", "RPM", "1/min", "min**-1"):
        return "rpm"
    if unit in ("%", "pct"):
        return "percent"
    unit = re.sub(r"°\s*([CF])\b", r"deg\1", unit)
    unit = re.sub(r"°", "deg", unit)
    unit = re.sub(r"\brev\b", "turn", unit)
    # pint reads 'Nm' as a nautical mile.
    unit = re.sub(r"\b([mkuM]?N)(m{1,2})(s?)\b", lambda m: f"{m[1]}*{m[2]}" + ("*s" if m[3] else ""), unit)
    unit = re.sub(r"\bNs\b", "N*s", unit)
    return re.sub(r"(?<=[A-Za-z])(\d)\b", r"**\1", unit)


def _ending(words: list[str]) -> str | None:
    """Unit of a run of name pieces such as ``['m', 'per', 's2']``, or None."""
    joined = "_".join(words)
    if joined in _SHORT_RATES:
        top, bottom = words
        return f"{_ATOMS[top]}/{_ATOMS[bottom.rstrip('23')]}" + (f"**{bottom[-1]}" if bottom[-1] in "23" else "")
    if len(words) % 2 == 0 or any(word != "per" for word in words[1::2]):
        return None
    parts: list[str] = []
    for place, word in enumerate(words[::2]):
        base, power = (word[:-1], f"**{word[-1]}") if len(words) > 1 and word[-1:] in ("2", "3") else (word, "")
        atom = _ATOMS.get(base) or (_WORDS.get(base) if len(words) > 1 else None)
        if atom is None:
            return None
        parts.append(f"({atom}){power}" if place and "*" in atom else f"{atom}{power}")
    return "/".join(parts)


def _is_expected(unit: str, expected: str | None) -> bool:
    try:
        return expected is not None and same_dimension(unit, expected)
    except UnitError:
        return False


def _known(unit: str) -> bool:
    try:
        same_dimension(unit, "s")
    except UnitError:
        return False
    return True


def is_unit(text: str) -> bool:
    """Return whether a text is a unit in one of the spellings of measurement files.

    Examples
    --------
    >>> is_unit("m/s²"), is_unit("U/min"), is_unit("Operator")
    (True, True, False)
    """
    return _known(pint_unit(text))


def read_column_name(column: str, expected: str | None = None) -> ColumnName:
    """Take the name of a column apart into quantity and unit.

    Understood are ``F_c [N]``, ``speed (rpm)``, ``F in N``, ``F / N`` and the endings ``_mm``, ``_m_per_s2``,
    ``_rad_s``, ``_degC``, ….  Round brackets may hold a remark (``speed (filtered)``) and are then part of
    the name; square brackets hold a unit or, directly behind the name, an index (``q[0]``).

    Parameters
    ----------
    column : str
        Name as in the file.
    expected : str, optional
        Unit of the quantity that is expected.  It decides about endings that are also words: ``_min`` and ``_g``.

    Raises
    ------
    UnitError
        If square brackets hold something that is not a unit, or ``g`` may be gram or gravity.

    Examples
    --------
    >>> [read_column_name(name).unit for name in ("F_c [N]", "position_ref_m", "angle_a")]
    ['N', 'm', None]
    """
    name = column.strip()
    if match := re.fullmatch(r"(.*?)(\s*)\[([^\[\]]*)\]", name):
        if match[3].strip().isdigit() and not (match[2] and match[3].strip() == "1"):
            return ColumnName(column, name, None)
        unit = pint_unit(match[3])
        if unit == "g":
            unit = _gram_or_gravity(column, expected)
        if not _known(unit):
            raise UnitError(f"unknown unit '[{match[3]}]': write it as in '[N]', '[mm]', '[rad/s]', '[m/s2]'")
        return ColumnName(column, match[1].strip(), unit)
    for pattern in (
        r"(.*?\S)\s*\(([^()]*)\)",
        r"(.*\S)\s+in\s+(\S+)",
        r"(.*\S)\s+/\s+(\S+)",
        r"(\S+)\s+(rpm)",
    ):
        match = re.fullmatch(pattern, name)
        if match and match[2].strip() and _known(pint_unit(match[2])):
            unit = pint_unit(match[2])
            return ColumnName(column, match[1], _gram_or_gravity(column, expected) if unit == "g" else unit)
    name = re.sub(r"\s*\([^()]*\)$", "", name) or name
    words = re.split(r"[_.]", name)
    for length in range(min(5, len(words) - 1), 0, -1):
        if (ending := _ending(words[-length:])) is not None:
            return ColumnName(column, name[: -len("_".join(words[-length:])) - 1], ending)
    if len(words) > 1 and words[-1] in _WORDS:
        for candidate in ("g", "g_0") if words[-1] == "g" else ("min",):
            if _is_expected(candidate, expected):
                return ColumnName(column, "_".join(words[:-1]), candidate)
    return ColumnName(column, name, "rpm" if name == "rpm" else None)


def _gram_or_gravity(column: str, expected: str | None) -> str:
    for candidate in ("g", "g_0"):
        if _is_expected(candidate, expected):
            return candidate
    raise UnitError(f"'g' in '{column}' may be gram or gravity: write 'gram' or 'g_0' (9.80665 m/s2)")


def _unlike(a: str, b: str) -> bool:
    """Return whether two units that pint takes for alike differ in kind: angles, cycles, shares are dimensionless."""
    kinds = (_ANGLES, _CYCLES, _SHARES)
    of_a, of_b = ([bool(kind.search(unit)) for kind in kinds] for unit in (a, b))
    return any(of_a) and any(of_b) and of_a != of_b and not same_dimension(a, "N*m")


def si_unit_of(unit: str) -> str:
    """Return the SI unit of what a unit measures, as a text.

    Examples
    --------
    >>> si_unit_of("mm"), si_unit_of("rpm"), si_unit_of("percent"), si_unit_of("deg"), si_unit_of("kHz")
    ('m', 'rad/s', '', 'rad', 'Hz')
    """
    if same_dimension(unit, ""):
        return "rad" if _ANGLES.search(unit) else ""
    if same_dimension(unit, "Hz") and not _ANGLES.search(unit):
        return "Hz"
    for text in _SI_TEXTS:
        if same_dimension(unit, text):
            return text
    import pint

    return f"{pint.get_application_registry().Quantity(1.0, unit).to_base_units().units:~C}"


def to_si(values: np.ndarray, unit: str, expected: str) -> np.ndarray:
    """Convert measured numbers to the unit that is expected of them.

    Parameters
    ----------
    values : ndarray
        Numbers in ``unit``.
    unit, expected : str
        Measured unit and SI unit.

    Raises
    ------
    UnitError
        If the two measure different quantities.  Unlike in plain dimensional analysis, an angle is not a
        share (``percent``) and a frequency (``Hz``) is not an angular speed: a factor of two pi hides there.
    """
    if same_dimension(unit, expected) and _unlike(unit, expected):
        remedy = "; for turns per second write 'turn/s'" if _CYCLES.search(unit) else ""
        raise UnitError(f"'{unit}' is not a measure of '{expected}'{remedy}")
    return np.asarray(convert(values, unit, expected), dtype=float)
