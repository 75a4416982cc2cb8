"""Trips for the alignment sensor: reading, checks for usual faults of recordings, low-pass, offsets."""

from __future__ import annotations

import gzip
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from estimation.files.column_names import read_column_name
from estimation.files.read_rules import ReadRules
from estimation.files.record import Record, RecordedSignal
from estimation.files.shared_rows import shared_rows
from estimation.signals.preparation import low_pass
from multibody.base.gravity import STANDARD_GRAVITY
from multibody.base.units import UnitError
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.trip_records import read_without_study

__all__ = ["ROLES", "AlignmentError", "Trip", "find_columns", "prepare", "read_trips"]

#: What is measured, in which unit, and usual names of its column.
ROLES: dict[str, tuple[str, tuple[str, ...]]] = {
    "tension": ("N", ("tension_c", "F_c", "cabin_tension", "tension", "rope_tension")),
    "height": ("m", ("cabin_height", "z_c", "height", "cabin_position", "position", "z")),
    "acceleration": ("m/s**2", ("cabin_acceleration", "zdd_c", "a_c", "acceleration")),
    "payload": ("kg", ("payload", "load")),
}
_TIME = ("time", "t")
#: Travel below which a trip carries no information, m.
LEAST_TRAVEL = 0.2
#: Sampling rate below which the contacts cannot be followed, Hz.
LEAST_RATE = 200.0
_SLOW = 5.0  # Hz, for comparing height and acceleration


class AlignmentError(ValueError):
    """Trips cannot be used; ``faults`` lists every fault of every trip."""

    def __init__(self, faults: Sequence[str]):
        self.faults = tuple(dict.fromkeys(faults))
        super().__init__("the trips cannot be used:\n" + "\n".join(f"  - {fault}" for fault in self.faults))


@dataclass(frozen=True, eq=False, kw_only=True)
class Trip:
    """One trip, ready for the filter: all signals low-passed alike, without the accelerometer's offset.

    Parameters
    ----------
    name : str
    time, tension, height, acceleration : ndarray, shape (n,), s, N, m, m/s²
    payload : float, kg
    offset : float, m/s²
        Subtracted from the accelerometer's reading.
    notes : tuple of str
        Assumptions and oddities.
    """

    name: str
    time: np.ndarray
    tension: np.ndarray
    height: np.ndarray
    acceleration: np.ndarray
    payload: float = 0.0
    offset: float = 0.0
    notes: tuple[str, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike,
        tension: ArrayLike,
        height: ArrayLike,
        acceleration: ArrayLike,
        *,
        payload: float = 0.0,
        name: str = "trip",
    ) -> Trip:
        """Return a trip from arrays in s, N, m and m/s², as they were recorded.

        Raises
        ------
        AlignmentError
            With every array that is not finite or has another length than the time, and a time that does not rise.
        """
        given = {"tension": tension, "height": height, "acceleration": acceleration}
        values = {n: np.asarray(v, dtype=float) for n, v in given.items()}
        t = np.asarray(time, dtype=float)
        faults = [
            f"{name}: {n} has shape {v.shape}, the time {t.shape}" for n, v in values.items() if v.shape != t.shape
        ]
        faults += [f"{name}: {n} is not finite everywhere" for n, v in values.items() if not np.isfinite(v).all()]
        if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0):
            faults.append(f"{name}: the time must be one row that rises")
        if faults:
            raise AlignmentError(faults)
        signals = {
            n: RecordedSignal(values=v, unit=ROLES[n][0], column=n, measured_unit=ROLES[n][0])
            for n, v in values.items()
        }
        trip = prepare(Record(name=name, path=Path(name), time=t, signals=signals))
        return replace(trip, payload=payload)

    @cached_property
    def speed(self) -> np.ndarray:
        """Derivative of the height below 5 Hz, shape (n,), m/s."""
        return np.gradient(low_pass(self.time, self.height, _SLOW), self.time)

    @property
    def direction(self) -> int:
        """1 for a trip that ends higher than it began, -1 for one that ends lower."""
        return 1 if self.height[-1] >= self.height[0] else -1


def _header(path: Path) -> list[str]:
    if not path.is_file() or not re.search(r"\.csv(\.gz)?$", path.name.lower()):
        return []
    try:
        with gzip.open(path, "rb") if path.name.lower().endswith(".gz") else path.open("rb") as stream:
            line = stream.readline().decode("utf-8-sig", errors="replace")
    except OSError:
        return []
    return [cell.strip().strip('"') for cell in re.split(r"[,;\t]", line.rstrip("\r\n"))]


def find_columns(path: str | Path, given: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the column of each role and of the time, found by their usual names with or without a unit.

    Parameters
    ----------
    path : path
        A CSV file; for other kinds ``given`` must name all columns.
    given : mapping of str to str, optional
        Known columns by role (``time``, ``tension``, ``height``, ``acceleration``, ``payload``).

    Raises
    ------
    AlignmentError
        With every role for which there is no column.
    """
    path, columns, faults = Path(path), dict(given or {}), []
    names = _header(path)
    roles = {"time": ("s", _TIME), **ROLES}
    for role, (unit, usual) in roles.items():
        if role in columns:
            continue
        matches: dict[str, str] = {}
        for name in names:
            try:
                quantity = read_column_name(name, unit).quantity
            except UnitError:
                quantity = name
            if quantity in usual or name in usual:
                matches.setdefault(quantity if quantity in usual else name, name)
        best = next((matches[u] for u in usual if u in matches), None)
        if best is not None:
            columns[role] = best
        elif role != "payload" and names:
            faults.append(
                f"{path.name}: no column looks like the {role} (usual names: {', '.join(usual)}, with their unit): "
                f"name it with --{role} COLUMN; there are {', '.join(names)}"
            )
        elif role != "payload" and path.exists():
            faults.append(f"{path.name}: name the column of the {role} with --{role} COLUMN")
    if faults:
        raise AlignmentError(faults)
    return columns


def read_trips(
    paths: Sequence[str | Path],
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    parameters: LiftParameters | None = None,
    low_pass_hz: float = 60.0,
    start: float | None = None,
    stop: float | None = None,
) -> list[Trip]:
    """Read recordings of trips and prepare them.

    Parameters
    ----------
    paths : sequence of path
        One trip each.
    columns : mapping of str to str, optional
        Columns by role; see `find_columns`.
    units : mapping of str to str, optional
        Units by role, where the column's name has none or a wrong one.
    parameters : LiftParameters, optional
        Default: the shipped bench.
    low_pass_hz : float, Hz
        For all signals alike (González et al. 2020: 60 Hz; the model does not hold above it).
    start, stop : float, s, optional
        Window.

    Raises
    ------
    AlignmentError, RecordError
        With every fault of every trip.
    """
    if not paths:
        raise AlignmentError(["no trips were given: name their files"])
    wanted = find_columns(paths[0], columns)
    time = wanted.pop("time", "time_s")
    records = read_without_study(
        list(paths),
        time=time,
        columns=wanted,
        units={r: ROLES[r][0] for r in wanted},
        measured_units=units,
        rules=ReadRules(start=start, stop=stop),
        may_be_constant=tuple(wanted),
        defaults={"payload": 0.0} if "payload" in wanted and not (columns or {}).get("payload") else None,
    )
    given = parameters if parameters is not None else LiftParameters.bench()
    faults = [fault for record in records for fault in _faults(record, given)]
    for same in shared_rows(records, ("tension", "acceleration")):
        first, second = (records[k].path.name for k in (same.first, same.second))
        faults.append(
            f"{second}: from {same.start:.6g} to {same.stop:.6g} s it holds what {first} holds ({same.rows} rows), so "
            "that one trip would count twice: name one of the two"
        )
    if faults:
        raise AlignmentError(faults)
    return [prepare(record, low_pass_hz) for record in records]


def prepare(record: Record, low_pass_hz: float = 60.0) -> Trip:
    """Return a record as a trip: zero-phase low-pass, accelerometer without its offset.

    A trip from rest to rest has no mean acceleration; the mean reading, less the change of speed that the heights
    show over the duration, is the offset.
    """
    time = np.asarray(record.time)
    names = ("tension", "height", "acceleration")
    cutoff = min(low_pass_hz, 0.4 * record.rate)
    tension, height, acceleration = (low_pass(time, record.signals[n].values, cutoff) for n in names)
    offset = float(acceleration.mean() - _speed_change(time, height) / record.duration)
    payload = float(np.median(record.signals["payload"].values)) if "payload" in record.signals else 0.0
    notes = [w for w in record.warnings if "constant at" not in w or "payload" not in w]
    if cutoff < low_pass_hz:
        notes.append(f"{record.name}: low-passed at {cutoff:g} Hz, because its rate is {record.rate:.4g} Hz")
    return Trip(
        name=record.name,
        time=time,
        tension=tension,
        height=height,
        acceleration=acceleration - offset,
        payload=payload,
        offset=offset,
        notes=tuple(notes),
    )


def _speed_change(time: np.ndarray, height: np.ndarray) -> float:
    """Speed at the end less speed at the beginning, from straight lines through the first and last 0.1 s."""
    count = max(3, int(0.1 / np.median(np.diff(time))))
    ends = [np.polyfit(time[part], height[part], 1)[0] for part in (slice(None, count), slice(-count, None))]
    return float(ends[1] - ends[0])


# -------------------------------------------------------------------- usual faults of recordings


def _faults(record: Record, lift: LiftParameters) -> Iterator[str]:
    name, values = record.name, {role: s.values for role, s in record.signals.items()}
    columns = {role: s.column for role, s in record.signals.items()}
    if record.rate < LEAST_RATE:
        yield (
            f"{name}: sampled at {record.rate:.4g} Hz; at least {LEAST_RATE:g} Hz are needed to follow the contacts "
            "(the paper has 1000 Hz)"
        )
        return
    for role in ("tension", "acceleration"):
        clipped = [w for w in record.warnings if "looks clipped" in w and f"'{columns[role]}'" in w]
        yield from (f"{name}: the {role} is clipped, so its peaks are lost ({w})" for w in clipped)
    swapped = _swapped(values, lift)
    if swapped is not None:
        a, b = swapped
        yield (
            f"{name}: the {a} (column '{columns[a]}') and the {b} (column '{columns[b]}') look swapped: exchange the "
            f"columns with --{a} {columns[b]} --{b} {columns[a]}"
        )
        return
    moved = float(np.ptp(values["height"]))
    if moved < LEAST_TRAVEL:
        yield (
            f"{name}: the cabin never moves (column '{columns['height']}' changes by {1e3 * moved:.3g} mm): friction "
            f"shows the guides only while it slides; record a trip of {LEAST_TRAVEL:g} m or more, and check the unit"
        )
        return
    if moved > 1.5 * lift.hoistway.travel:
        yield (
            f"{name}: the cabin travels {moved:.4g} m, the hoistway has {lift.hoistway.travel:g} m: is the unit of "
            f"column '{columns['height']}' right?"
        )
        return
    yield from _tension_faults(name, columns["tension"], values, lift)
    yield from _acceleration_faults(name, columns, np.asarray(record.time), values)


def _weight(values: Mapping[str, np.ndarray], lift: LiftParameters) -> float:
    load = float(np.median(values["payload"])) if "payload" in values else 0.0
    return (lift.cabin.mass + load) * STANDARD_GRAVITY


def _is_tension(x: np.ndarray, weight: float) -> bool:
    return bool(0.5 * weight < float(np.median(x)) < 2.0 * weight)


def _is_height(x: np.ndarray, travel: float) -> bool:
    steps = np.abs(np.diff(x))
    smooth = bool(np.ptp(x) > 0.0 and np.median(steps) < 0.02 * np.ptp(x))
    # A height crosses its mid-range a few times; an acceleration crosses its median again and again.
    crossings = np.count_nonzero(np.diff(np.sign(x - 0.5 * (x.max() + x.min()))) != 0)
    return bool(smooth and LEAST_TRAVEL < np.ptp(x) < 1.5 * travel and crossings < 10)


def _is_acceleration(x: np.ndarray) -> bool:
    crossings = np.count_nonzero(np.diff(np.sign(x - np.median(x))) != 0)
    return bool(abs(np.median(x)) < 0.5 and np.std(x) < 5.0 and crossings >= 10)


def _swapped(values: Mapping[str, np.ndarray], lift: LiftParameters) -> tuple[str, str] | None:
    """Return two roles whose columns fit each other's role and not their own."""
    weight, travel = _weight(values, lift), lift.hoistway.travel
    fits = {
        "tension": lambda x: _is_tension(x, weight),
        "height": lambda x: _is_height(x, travel),
        "acceleration": _is_acceleration,
    }
    for a, b in itertools.combinations(fits, 2):
        own = fits[a](values[a]) and fits[b](values[b])
        if not own and fits[a](values[b]) and fits[b](values[a]):
            return a, b
    return None


def _tension_faults(name: str, column: str, values: Mapping[str, np.ndarray], lift: LiftParameters) -> Iterator[str]:
    tension, weight = float(np.median(values["tension"])), _weight(values, lift)
    ratio = tension / weight
    if 0.85 < ratio < 1.15:
        return
    text = f"{name}: the tension (column '{column}') is about {tension:.4g} N, the cabin weighs {weight:.4g} N"
    if 0.85 < ratio * STANDARD_GRAVITY < 1.15:
        yield f"{text}: the numbers look like kg; give --tension-unit kgf, or convert them"
    elif 0.85 < ratio * 1e3 < 1.15:
        yield f"{text}: the numbers look like kN; give --tension-unit kN"
    elif 0.85 < -ratio < 1.15:
        yield f"{text}: its sign is reversed; a pull is positive"
    else:
        yield f"{text}: check its unit and zero, the cabin's mass in the parameters, and the payload"


def _acceleration_faults(
    name: str, columns: Mapping[str, str], time: np.ndarray, values: Mapping[str, np.ndarray]
) -> Iterator[str]:
    """Compare the acceleration with the second derivative of the height, both low-passed."""
    column, a = columns["acceleration"], values["acceleration"]
    middle = float(np.median(a))
    if 0.8 * STANDARD_GRAVITY < abs(middle) < 1.2 * STANDARD_GRAVITY:
        yield (
            f"{name}: the acceleration (column '{column}') contains gravity (its median is {middle:.3g} m/s²): "
            "subtract 9.81 m/s²; an upward acceleration is positive"
        )
        return
    step = float(np.median(np.diff(time)))
    slow = low_pass(time, np.column_stack([values["height"], a]), _SLOW)
    by_height = np.gradient(np.gradient(slow[:, 0], step), step)
    inner = slice(int(0.2 / step), -int(0.2 / step))
    x, y = by_height[inner] - by_height[inner].mean(), slow[inner, 1] - slow[inner, 1].mean()
    correlation = float(x @ y / max(np.sqrt((x @ x) * (y @ y)), 1e-300))
    gain = float(x @ y / max(x @ x, 1e-300))
    text = f"{name}: acceleration (column '{column}') and height (column '{columns['height']}')"
    if correlation < -0.5:
        yield f"{text} have opposite signs: reverse one, or use the height of the cabin and not of the counterweight"
    elif correlation < 0.5:
        yield (
            f"{text} do not match (correlation of the accelerations below {_SLOW:g} Hz: {correlation:.2f}): "
            "another axis, another trip, or different clocks"
        )
    elif 0.8 < gain * STANDARD_GRAVITY < 1.25:
        yield f"{text} differ by a factor of {gain:.3g}: the acceleration looks like g; give --acceleration-unit g_0"
    elif not 0.7 < gain < 1.4:
        yield f"{text} differ by a factor of {gain:.3g}: check the units of both"
