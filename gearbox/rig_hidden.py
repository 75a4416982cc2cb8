"""What a virtual gear rig can have that the model under test lacks: kinds, places, usual sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.bench import BenchError
from multibody.component import nearest

__all__ = ["KINDS", "HiddenFault", "choose", "manufacturing"]

_SIDES = {"input_gear": 1, "output_gear": 2}
_SHAFTS = {"input_shaft": 0, "output_shaft": 1}
_BEARINGS = ("input_low", "input_high", "output_low", "output_high")


@dataclass(frozen=True)
class Kind:
    """A kind of deviation or fault.

    Parameters
    ----------
    name, what : str
    where : tuple of str
        Places it fits, the usual one first.
    size : float
        Usual size, in ``unit``.
    unit : str
    """

    name: str
    what: str
    where: tuple[str, ...]
    size: float
    unit: str


KINDS: dict[str, Kind] = {
    k.name: k
    for k in (
        Kind("eccentricity", "the teeth run out of true with their axis", ("output_gear", "input_gear"), 20e-6, "m"),
        Kind("pitch_error", "the teeth are not evenly spaced", ("output_gear", "input_gear"), 6e-6, "m"),
        Kind("tooth_defect", "one tooth is soft by a crack at its root", ("input_gear", "output_gear"), 0.4, ""),
        Kind("mesh_stiffness_variation", "the contact stiffness varies over a turn",
             ("output_gear", "input_gear"), 0.08, ""),
        Kind("misalignment", "the flanks are not parallel", ("mesh",), 3e-4, "rad"),
        Kind("profile_error", "the flanks are fuller at the ends of the path", ("mesh",), 4e-6, "m"),
        Kind("wear", "material is worn off where the teeth slide", ("mesh",), 5e-6, "m"),
        Kind("unbalance", "the centre of mass lies off the axis", tuple(_SHAFTS), 4e-4, "kg*m"),
        Kind("bearing_clearance", "a bearing has play", _BEARINGS, 8e-6, "m"),
        Kind("bearing_defect", "the outer ring of a bearing has a pit", _BEARINGS, 6e-6, "m"),
        Kind("mesh_backlash", "the backlash is larger than the model's", ("mesh",), 1e-4, "m"),
    )
}  # fmt: skip


@dataclass(frozen=True)
class HiddenFault:
    """A kind at a place, with a size drawn.

    Parameters
    ----------
    kind : Kind
    where : str
    size : float
        In the kind's unit.
    seed : int
        Of what has a pattern or a phase.
    """

    kind: Kind
    where: str
    size: float
    seed: int = 0

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind.name}@{self.where}"

    def values(self) -> dict[str, float]:
        """Model parameters by full name that bring it about."""
        rng = np.random.default_rng(self.seed)
        phase = float(rng.uniform(-np.pi, np.pi))
        n = _SIDES.get(self.where, 0)
        bearing = {f"{self.where}.{key}": value for key, value in (("clearance", self.size),)}
        table: dict[str, dict[str, float]] = {
            "eccentricity": {f"mesh.eccentricity_{n}": self.size, f"mesh.high_{n}": phase},
            "pitch_error": {f"mesh.pitch_{n}": self.size},
            "tooth_defect": {f"mesh.crack_{n}": self.size, f"mesh.damaged_{n}": float(rng.integers(0, 30))},
            "mesh_stiffness_variation": {f"mesh.variation_{n}": self.size},
            "misalignment": {"mesh.misalignment": self.size},
            "profile_error": {"mesh.profile_form": self.size},
            "wear": {"mesh.wear": self.size},
            "unbalance": {f"{self.where}.unbalance": self.size},
            "bearing_clearance": bearing,
            "bearing_defect": {f"{self.where}.outer_pit": self.size, f"{self.where}.outer_angle": phase},
        }
        return table.get(self.kind.name, {})

    def patterns(self, teeth: Sequence[int]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Tables of the model that belong to it: the pitch error over the teeth of a gear, of unit RMS."""
        if self.kind.name != "pitch_error":
            return {}
        n = _SIDES[self.where]
        rng = np.random.default_rng(self.seed + 1)
        count = teeth[n - 1]
        # Slow over the gear with some scatter from tooth to tooth, as a generated gear has it.
        k = np.arange(count)
        slow = sum(
            rng.standard_normal() / h * np.cos(2 * np.pi * h * k / count + rng.uniform(0, 2 * np.pi)) for h in (1, 2, 3)
        )
        pattern = slow + 0.4 * rng.standard_normal(count)
        pattern = (pattern - pattern.mean()) / pattern.std()
        return {f"pattern_{n}": (np.arange(count, dtype=float), pattern)}

    def truth(self) -> dict[str, Any]:
        """What ``truth.json`` holds of it."""
        size = {"size": {"value": self.size, "unit": self.kind.unit}}
        return {"kind": self.kind.name, "where": self.where, "what": self.kind.what, "parameters": size}


def choose(
    asked: Sequence[str], rng: np.random.Generator, strength: float = 1.0, spread: float = 0.2
) -> list[HiddenFault]:
    """Return what ``KIND`` or ``KIND@WHERE`` name, with sizes drawn around the usual ones.

    Raises
    ------
    BenchError
        With every kind or place that does not exist, and everything asked for twice.
    """
    faults: list[str] = []
    found: list[HiddenFault] = []
    for text in asked:
        kind, at, where = text.strip().partition("@")
        if kind not in KINDS:
            faults.append(f"--hide {text}: there is no effect '{kind}'{nearest(kind, list(KINDS))}; --list shows all")
            continue
        known = KINDS[kind]
        place = where if at else known.where[0]
        if place not in known.where:
            faults.append(f"--hide {text}: {kind} fits {', '.join(known.where)}")
            continue
        if any(each.name == f"{kind}@{place}" for each in found):
            faults.append(f"--hide {text}: asked for twice: change its size with --strength instead")
            continue
        size = strength * known.size * float(rng.uniform(1.0 - spread, 1.0 + spread))
        found.append(HiddenFault(known, place, size, int(rng.integers(2**31))))
    if faults:
        raise BenchError(faults)
    return found


#: What every gear stage that was made and assembled has, as shares of the usual sizes.
_USUAL = (
    ("eccentricity@input_gear", 0.5),
    ("eccentricity@output_gear", 0.7),
    ("pitch_error@input_gear", 0.5),
    ("pitch_error@output_gear", 0.6),
    ("profile_error@mesh", 0.6),
    ("misalignment@mesh", 0.4),
    *((f"bearing_clearance@{b}", 0.4) for b in _BEARINGS),
    ("unbalance@input_shaft", 0.5),
    ("unbalance@output_shaft", 0.5),
)


def manufacturing(rng: np.random.Generator, factor: float = 1.0, spread: float = 0.3) -> list[HiddenFault]:
    """Errors of manufacturing and assembly that every real stage has, ``factor`` times their usual size."""
    if not (np.isfinite(factor) and factor >= 0.0):
        raise BenchError([f"--manufacturing {factor}: give a factor of zero or more"])
    if factor == 0.0:
        return []
    return [choose([name], rng, share * factor, spread)[0] for name, share in _USUAL]
