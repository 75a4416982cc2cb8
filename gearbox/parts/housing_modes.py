"""Sets of housing modes: frequencies, damping, shapes at seats, sensors and mounts, in files and from a rigid body."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.errors import GearError

__all__ = ["AXES", "SEATS", "SENSORS", "ModeSet", "clamped_modes", "read_modes", "rigid_modes", "write_modes"]

Array = NDArray[np.float64]
AXES = ("x", "y", "z")
#: Bearing seats: of the input and the output shaft, at the low and the high end of z.
SEATS = ("input_low", "input_high", "output_low", "output_high")
#: Accelerometers, as in the gearbox paper, section 4.
SENSORS = ("input_seat", "output_seat", "base")
PLACES = (*SEATS, *SENSORS)
#: How names of mounts begin.
MOUNT = "mount_"


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeSet:
    """Mass-normalised modes of a housing.

    Parameters
    ----------
    name : str
    frequencies : ndarray, shape (m,), Hz
        Rising.
    damping : ndarray, shape (m,)
        Ratios.
    shapes : mapping of str to ndarray, shape (m, 3), kg^-1/2
        For each bearing seat and sensor the displacement along x, y, z per modal coordinate.
    origin : str
        Where the numbers come from.
    mounts : mapping of str to ndarray, shape (m, 3), kg^-1/2
        The same for each mount, ``mount_…``, if it is to stand on mounts (`on_mounts`).  A free body has six modes of
        frequency zero.

    Raises
    ------
    GearError
        With every size that does not fit and every number that makes no sense.
    """

    name: str
    frequencies: Array
    damping: Array
    shapes: Mapping[str, Array]
    origin: str = ""
    source: str = field(default="", repr=False)
    mounts: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if faults := self._faults():
            raise GearError(self.source or f"the mode set '{self.name}'", faults)

    def _faults(self) -> list[str]:
        faults = []
        count = np.size(self.frequencies)
        if np.ndim(self.frequencies) != 1 or not np.all(np.isfinite(self.frequencies)):
            return ["frequencies must be a list of finite numbers in Hz"]
        if np.any(self.frequencies < 0.0) or (np.any(self.frequencies == 0.0) and not self.mounts):
            faults.append("a frequency is not positive: a body without mounts has rigid motions; give it mounts")
        elif np.any(np.diff(self.frequencies) < 0.0):
            faults.append("frequencies must rise from mode to mode")
        if np.shape(self.damping) != (count,):
            faults.append(f"there are {count} frequencies, but {np.size(self.damping)} damping ratios")
        elif not (np.all(np.isfinite(self.damping)) and np.all((self.damping >= 0.0) & (self.damping < 1.0))):
            faults.append("damping ratios must lie between 0 and 1")
        faults += [f"there is no shape at '{place}'" for place in PLACES if place not in self.shapes]
        faults += [f"'{place}' is neither a seat nor a sensor" for place in self.shapes if place not in PLACES]
        faults += [
            f"'{place}' is no name of a mount: begin it with mount_"
            for place in self.mounts
            if not place.startswith(MOUNT)
        ]
        for place, shape in [(p, self.shapes[p]) for p in PLACES if p in self.shapes] + list(self.mounts.items()):
            if np.shape(shape) != (count, 3):
                faults.append(
                    f"the shape at '{place}' has the size {np.shape(shape)}; {count} modes along x, y and z need "
                    f"({count}, 3)"
                )
            elif not np.all(np.isfinite(shape)):
                faults.append(f"the shape at '{place}' has values that are not finite")
        return faults

    def first(self, count: int) -> ModeSet:
        """Return the lowest modes."""
        shapes, mounts = ({k: v[:count] for k, v in part.items()} for part in (self.shapes, self.mounts))
        return dataclasses.replace(
            self, frequencies=self.frequencies[:count], damping=self.damping[:count], shapes=shapes, mounts=mounts
        )

    def with_damping(self, ratio: float) -> ModeSet:
        """Return the modes with one damping ratio for all."""
        return dataclasses.replace(self, damping=np.full(self.frequencies.size, float(ratio)))

    def scaled(self, *, modulus: float = 1.0, density: float = 1.0) -> ModeSet:
        """Return the modes of the same housing of another material: factors of its elastic modulus and density.

        Frequencies go with √(E/ρ), mass-normalised shapes with 1/√ρ.  Exact where the mounts are as stiff as they
        were in proportion to E.

        Examples
        --------
        >>> modes = rigid_modes(20.0, (0.3, 0.4, 0.5), {k: (0.0, 0.0, 0.0) for k in (*SEATS, *SENSORS)}, 1e8, 0.1)
        >>> bool(np.allclose(modes.scaled(modulus=4.0).frequencies, 2.0 * modes.frequencies))
        True
        """
        faults = [
            f"the factor of the {n} is {v:g}: give a positive number"
            for n, v in (("modulus", modulus), ("density", density))
            if not v > 0.0
        ]
        if faults:
            raise GearError(f"the mode set '{self.name}'", faults)
        shapes, mounts = ({k: v / np.sqrt(density) for k, v in part.items()} for part in (self.shapes, self.mounts))
        return dataclasses.replace(
            self, frequencies=self.frequencies * np.sqrt(modulus / density), shapes=shapes, mounts=mounts
        )

    def on_mounts(self, stiffness: float | Sequence[float], damping: float | Sequence[float] = 0.0) -> ModeSet:
        """Return the modes of the same housing with a spring and a damper to the ground at each of its mounts.

        Stiffness at the mounts joins what holds the housing already: give modes of a free one.  What the modes left out
        would give way is not there, so that mounts stiffer than the housing at their place want many modes.  Dampers
        keep their share of each new mode and no coupling between modes.

        Parameters
        ----------
        stiffness : float or sequence of three float, N/m
            Of one mount, along x, y and z.
        damping : float or sequence of three float, N s/m

        Raises
        ------
        GearError
            If there are no shapes at mounts, or the mounts do not hold the housing.
        """
        k, c = (np.broadcast_to(np.asarray(v, dtype=float), 3) for v in (stiffness, damping))
        faults = [] if self.mounts else ["there are no shapes at mounts: give some, named mount_…"]
        for what, value in (("stiffness", k), ("damping", c)):
            if not (np.all(np.isfinite(value)) and np.all(value >= 0.0)):
                faults.append(f"the {what} of a mount is {value.tolist()}: give numbers of zero or more")
        if faults:
            raise GearError(f"the mode set '{self.name}'", faults)
        omega = 2.0 * np.pi * self.frequencies
        K, C = np.diag(omega**2), np.diag(2.0 * self.damping * omega)
        for shape in self.mounts.values():
            K = K + shape @ (k[:, None] * shape.T)
            C = C + shape @ (c[:, None] * shape.T)
        squares, turn = np.linalg.eigh(K)
        if not squares[0] > 1e-9 * max(squares[-1], 1e-300):
            raise GearError(f"the mode set '{self.name}'", ["on these mounts it can still move freely: add some"])
        new = np.sqrt(squares)
        ratio = np.einsum("ij,ik,kj->j", turn, C, turn) / (2.0 * new)
        shapes, mounts = ({p: turn.T @ v for p, v in part.items()} for part in (self.shapes, self.mounts))
        origin = f"{self.origin}; on {len(self.mounts)} mounts of {k.tolist()} N/m".lstrip("; ")
        return ModeSet(
            name=self.name,
            frequencies=new / (2.0 * np.pi),
            damping=ratio,
            shapes=shapes,
            origin=origin,
            source=self.source,
            mounts=mounts,
        )

    def static_flexibility(self, seat: str, axis: str) -> float:
        """Return how far a seat gives way to a steady unit force along an axis, as far as the modes know, m/N."""
        phi = self.shapes[seat][:, AXES.index(axis)]
        return float(np.sum((phi / (2.0 * np.pi * self.frequencies)) ** 2))

    def __len__(self) -> int:
        return int(self.frequencies.size)

    def __repr__(self) -> str:
        if not len(self):
            return f"ModeSet({self.name!r}: clamped)"
        return f"ModeSet({self.name!r}: {len(self)} modes, {self.frequencies[0]:.4g} to {self.frequencies[-1]:.4g} Hz)"


def read_modes(path: str | Path) -> ModeSet:
    """Read a mode set from a TOML file: ``name``, ``origin``, and one ``[[mode]]`` each.

    A mode has ``frequency`` (Hz), ``damping`` (ratio) and for every seat and sensor its mass-normalised shape
    ``[x, y, z]`` in kg^-1/2, and likewise for mounts, if there are any, under names that begin with ``mount_``; see
    docs, "Housing".

    Raises
    ------
    GearError
        With every missing or surplus entry and every size that does not fit, by mode and key.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    source = f"the mode file '{path}'"
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise GearError(source, [f"is not valid TOML: {error}"]) from None
    rows = content.get("mode")
    faults = [
        f"has no entry '{k}'; it takes name, origin and [[mode]]"
        for k in content
        if k not in ("name", "origin", "mode")
    ]
    if not isinstance(rows, list) or not rows or not all(isinstance(r, dict) for r in rows):
        raise GearError(source, [*faults, "has no modes: give one [[mode]] for each"])
    mounts = [key for key in rows[0] if key.startswith(MOUNT)]
    wanted = {"frequency": 0, "damping": 0, **dict.fromkeys((*PLACES, *mounts), 3)}
    for k, row in enumerate(rows):
        faults += [f"mode {k + 1}: there is no '{key}'" for key in wanted if key not in row]
        faults += [
            f"mode {k + 1}: '{key}' is neither a seat nor a sensor"
            + (", nor a mount of mode 1" if key.startswith(MOUNT) else "")
            for key in row
            if key not in wanted
        ]
        for key, size in wanted.items():
            if key in row and (fault := _entry_fault(row[key], size)):
                faults.append(f"mode {k + 1}: '{key}' {fault}")
    if faults:
        raise GearError(source, faults)
    return ModeSet(
        name=str(content.get("name", path.stem)),
        frequencies=np.array([r["frequency"] for r in rows], dtype=float),
        damping=np.array([r["damping"] for r in rows], dtype=float),
        shapes={p: np.array([r[p] for r in rows], dtype=float) for p in PLACES},
        origin=str(content.get("origin", "")),
        source=source,
        mounts={p: np.array([r[p] for r in rows], dtype=float) for p in mounts},
    )


def _entry_fault(value: Any, size: int) -> str:
    def number(v: Any) -> bool:
        return isinstance(v, int | float) and not isinstance(v, bool)

    if size == 0:
        return "" if number(value) else f"is {value!r}: give a number"
    if not isinstance(value, list) or len(value) != size:
        given = f"has {len(value)} values" if isinstance(value, list) else "is no list"
        return f"{given}: give {size}, [x, y, z]"
    return "" if all(map(number, value)) else "has an entry that is not a number"


def write_modes(modes: ModeSet, path: str | Path) -> Path:
    """Write a mode set as the file that `read_modes` reads, and return the path."""
    path = Path(path)
    lines = [f"name = {_text(modes.name)}", f"origin = {_text(modes.origin)}"]
    for k in range(len(modes)):
        lines += ["", "[[mode]]", f"frequency = {modes.frequencies[k]:.6g}", f"damping = {modes.damping[k]:.6g}"]
        for place, shape in [(p, modes.shapes[p]) for p in PLACES] + list(modes.mounts.items()):
            x, y, z = shape[k]
            lines.append(f"{place} = [{x:.6g}, {y:.6g}, {z:.6g}]")
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace("[-0,", "[0,"), encoding="utf-8")
    return path


def _text(value: str) -> str:
    import json

    return json.dumps(value, ensure_ascii=False)


def clamped_modes() -> ModeSet:
    """Return the set without modes: seats that stand still."""
    none = np.empty(0)
    return ModeSet(
        name="clamped", frequencies=none, damping=none, shapes={p: np.empty((0, 3)) for p in PLACES}, origin="no motion"
    )


def rigid_modes(
    mass: float,
    inertia: Sequence[float],
    places: Mapping[str, Sequence[float]],
    stiffness: float,
    span: float,
    *,
    damping: float = 0.02,
    name: str = "rigid",
) -> ModeSet:
    """Return the six modes of a rigid housing on four equal mounts.

    Parameters
    ----------
    mass : float, kg
    inertia : sequence of three float, kg m²
        Principal, about the centre of mass, about x, y and z.
    places : mapping of str to (x, y, z), m
        Seats and sensors, from the centre of mass.
    stiffness : float, N/m
        Of one mount, the same along x, y and z.
    span : float, m
        Mounts stand at x = ±span, z = ±span, and at the height of the lowest place.
    damping : float
        Ratio of all six.

    Raises
    ------
    GearError
        If a number is not positive or a place is missing.
    """
    numbers = {"mass": mass, "stiffness": stiffness, "span": span}
    numbers |= dict(zip(("I_x", "I_y", "I_z"), inertia, strict=True))
    faults = [f"{n} is {v:g}: give a positive number" for n, v in numbers.items() if not v > 0.0]
    faults += [f"there is no place '{p}'" for p in PLACES if p not in places]
    if faults:
        raise GearError(f"the rigid housing '{name}'", faults)
    low = min(float(p[1]) for p in places.values())
    mounts = [np.array([sx * span, low, sz * span]) for sx in (-1, 1) for sz in (-1, 1)]
    root = 1.0 / np.sqrt(np.array([mass, mass, mass, *inertia], dtype=float))
    K = sum(stiffness * _motion(m).T @ _motion(m) for m in mounts)
    values, vectors = np.linalg.eigh(root[:, None] * K * root)
    shapes = {p: (_motion(np.asarray(places[p], dtype=float)) @ (root[:, None] * vectors)).T for p in PLACES}
    frequencies = np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)
    return ModeSet(
        name=name,
        frequencies=frequencies,
        damping=np.full(6, damping),
        shapes=shapes,
        origin="rigid body on four mounts",
    )


def _motion(place: Array) -> Array:
    """Displacement of a point by small motions and rotations of its body, shape (3, 6)."""
    x, y, z = place
    turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.hstack([np.eye(3), turn])
