"""The estimated deviation of a guide rail over height, as a small table in CSV or JSON.

Columns ``height_m``, ``delta_mm`` and, where it is known, ``spread_mm``: output of `vtsdt align` and input of
`vtsdt what-if`.  The deviation is the equivalent one of González et al. 2020, section IV-B: the right rail
towards the cabin, the left rail straight.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.parameter_file import ParameterError
from vtsdt.files.rail_profile import RailProfile

if TYPE_CHECKING:
    import pandas

__all__ = ["ProfileTable"]

_NAMES = ("height_m", "delta_mm", "spread_mm")
JOIN = 0.03  # m: ranges closer to each other are joined


@dataclass(frozen=True, eq=False)
class ProfileTable:
    """A rail's deviation over height and its standard deviation.

    Parameters
    ----------
    height : ndarray, shape (n,), m
        Increasing.
    delta : ndarray, shape (n,), m
    spread : ndarray, shape (n,), m
        Standard deviation of ``delta``; zero where it is not known.

    Examples
    --------
    >>> table = ProfileTable(np.array([0.0, 1.0]), np.array([2e-3, 1e-3]), np.zeros(2))
    >>> print(table.to_csv().strip())
    height_m,delta_mm,spread_mm
    0,2,0
    1,1,0
    """

    height: np.ndarray
    delta: np.ndarray
    spread: np.ndarray

    @staticmethod
    def of(profile: RailProfile, spread: float = 0.0) -> ProfileTable:
        """Return the table of a profile with the same standard deviation everywhere."""
        height = np.array(profile.height)
        return ProfileTable(height, np.array(profile.deviation), np.full(height.size, float(spread)))

    @property
    def profile(self) -> RailProfile:
        """The deviation as a profile."""
        return RailProfile(tuple(map(float, self.height)), tuple(map(float, self.delta)))

    @staticmethod
    def load(path: str | Path) -> ProfileTable:
        """Read a table from a CSV or JSON file.

        JSON holds lists by name, alone or under ``"profile"``.

        Raises
        ------
        ParameterError
            With every fault of the table, by file, column and row.
        """
        path = Path(path)
        if not path.is_file():
            raise ParameterError(f"'{path}'", ["there is no such file: give the profile that `vtsdt align` wrote"])
        text = path.read_text(encoding="utf-8-sig")
        try:
            columns = _from_json(text) if path.suffix == ".json" else _from_csv(text)
        except ValueError as error:
            raise ParameterError(f"'{path}'", [f"cannot be read: {error}"]) from None
        return _checked(columns, f"'{path}'")

    def to_frame(self) -> pandas.DataFrame:
        """Return the table with units in its columns' names."""
        import pandas

        return pandas.DataFrame(dict(zip(_NAMES, self._columns(), strict=True)))

    def to_csv(self) -> str:
        """Return the table as CSV."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(_NAMES)
        writer.writerows([f"{v:.10g}" for v in row] for row in zip(*self._columns(), strict=True))
        return out.getvalue()

    def to_json(self) -> dict[str, list[float]]:
        """Return the table as lists by name."""
        return {n: [float(f"{v:.10g}") for v in c] for n, c in zip(_NAMES, self._columns(), strict=True)}

    def save(self, path: str | Path) -> None:
        """Write the table as CSV, or as JSON where the name ends so."""
        path = Path(path)
        text = json.dumps(self.to_json(), indent=1) + "\n" if path.suffix == ".json" else self.to_csv()
        path.write_text(text, encoding="utf-8")

    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.height, 1e3 * self.delta, 1e3 * self.spread

    def beyond(self, threshold: float) -> list[tuple[float, float]]:
        """Return the ranges of height, m, in which the deviation is larger than a threshold, m.

        Ranges less than 30 mm apart are joined, because so short a dip is straightened with them.
        """
        fine = np.unique(np.concatenate([self.height, np.linspace(self.height[0], self.height[-1], 2001)]))
        profile = self.profile
        above = np.array([profile.at(h) for h in fine]) > threshold
        edges = np.flatnonzero(np.diff(above.astype(int)))
        begins = [0] * bool(above[0]) + [int(k) + 1 for k in edges if not above[k]]
        ends = [int(k) for k in edges if above[k]] + [fine.size - 1] * bool(above[-1])
        ranges: list[tuple[float, float]] = []
        for a, b in zip(begins, ends, strict=True):
            low, high = float(fine[a]), float(fine[b])
            if ranges and low - ranges[-1][1] < JOIN:
                low = ranges.pop()[0]
            ranges.append((low, high))
        return ranges


def _from_json(text: str) -> dict[str, list[Any]]:
    content = json.loads(text)
    if isinstance(content, dict) and isinstance(content.get("profile"), dict):
        content = content["profile"]
    if not isinstance(content, dict):
        raise ValueError("it must hold lists by name: height_m, delta_mm and, if known, spread_mm")
    return content


def _from_csv(text: str) -> dict[str, list[Any]]:
    rows = [r for r in csv.reader(io.StringIO(text)) if r and not r[0].lstrip().startswith("#")]
    if not rows:
        raise ValueError("it is empty")
    return {name.strip(): [r[k] if k < len(r) else "" for r in rows[1:]] for k, name in enumerate(rows[0])}


def _checked(columns: dict[str, list[Any]], source: str) -> ProfileTable:
    faults = [f"column '{n}' is missing: give {', '.join(_NAMES)}" for n in _NAMES[:2] if n not in columns]
    if faults:
        raise ParameterError(source, faults)
    arrays: dict[str, np.ndarray] = {}
    for name in (n for n in _NAMES if n in columns):
        values = []
        for row, cell in enumerate(columns[name], 1):
            try:
                number = float(cell)
            except (TypeError, ValueError):
                number = float("nan")
            if not np.isfinite(number):
                faults.append(f"column '{name}', row {row}: {cell!r} is not a finite number")
            values.append(number)
        arrays[name] = np.array(values)
    sizes = {v.size for v in arrays.values()}
    if not faults:
        height = arrays["height_m"]
        if len(sizes) != 1 or height.size < 2:
            faults.append("needs at least two rows, as many heights as deviations")
        elif not np.all(np.diff(height) > 0):
            k = int(np.argmax(np.diff(height) <= 0)) + 1
            faults.append(f"heights must increase, but {height[k]:g} m follows {height[k - 1]:g} m in row {k + 1}")
        elif np.any(arrays.get("spread_mm", np.zeros(1)) < 0):
            faults.append("column 'spread_mm': a standard deviation cannot be negative")
        elif np.abs(arrays["delta_mm"]).max() > 100.0:
            faults.append(
                f"column 'delta_mm': {np.abs(arrays['delta_mm']).max():g} mm is no deviation of a rail: use mm"
            )
    if faults:
        raise ParameterError(source, faults)
    spread = arrays.get("spread_mm", np.zeros_like(arrays["height_m"]))
    return ProfileTable(arrays["height_m"], 1e-3 * arrays["delta_mm"], 1e-3 * spread)
