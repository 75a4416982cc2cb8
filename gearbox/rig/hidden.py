"""What a virtual gear rig can have that the model under test lacks: kinds, places, usual sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.rigs.recording import BenchError
from gearbox.stage.faults import BEARINGS, FAULTS, SHAFTS, Fault, FaultKind
from multibody.base.spelling import nearest

__all__ = ["KINDS", "HiddenFault", "choose", "manufacturing"]

#: What a rig can hide, by the name of the effect: of each kind the fault that has a usual severity.
KINDS: dict[str, FaultKind] = {row.kind: row for row in FAULTS.values() if row.usual}


@dataclass(frozen=True)
class HiddenFault:
    """A kind at a place, with a size drawn.

    Parameters
    ----------
    kind : FaultKind
    where : str
    size : float
        In the kind's unit.
    seed : int
        Of what has a pattern or a phase.
    """

    kind: FaultKind
    where: str
    size: float
    seed: int = 0

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind.kind}@{self.where}"

    @property
    def gear(self) -> int:
        """Number of the gear that it belongs to."""
        return 1 if self.where == "input_gear" else 2

    def values(self) -> dict[str, float]:
        """Model parameters by full name that bring it about."""
        if self.kind.kind == "pitch_error":  # a pattern over the teeth in place of two waves
            return {f"mesh.pitch_{self.gear}": self.size}
        rng = np.random.default_rng(self.seed)
        phase, tooth = float(rng.uniform(-np.pi, np.pi)), int(rng.integers(0, 30))
        # the drive begins at an angle that is drawn: what lies on a shaft needs none of its own
        phase = 0.0 if self.where in SHAFTS else phase
        return Fault(
            kind=self.kind, where=self.where, severity=self.size / self.kind.size, tooth=tooth, phase=phase
        ).values()

    def patterns(self, teeth: Sequence[int]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Tables of the model that belong to it: the pitch error over the teeth of a gear, of unit RMS."""
        if self.kind.kind != "pitch_error":
            return {}
        rng = np.random.default_rng(self.seed + 1)
        count = teeth[self.gear - 1]
        # Slow over the gear with some scatter from tooth to tooth, as a generated gear has it.
        k = np.arange(count)
        slow = sum(
            rng.standard_normal() / h * np.cos(2 * np.pi * h * k / count + rng.uniform(0, 2 * np.pi)) for h in (1, 2, 3)
        )
        pattern = slow + 0.4 * rng.standard_normal(count)
        pattern = (pattern - pattern.mean()) / pattern.std()
        return {f"pattern_{self.gear}": (np.arange(count, dtype=float), pattern)}

    def truth(self) -> dict[str, Any]:
        """What ``truth.json`` holds of it."""
        size = {"size": {"value": self.size, "unit": self.kind.unit}}
        what = "The teeth are not evenly spaced." if self.kind.kind == "pitch_error" else self.kind.what
        return {"kind": self.kind.kind, "where": self.where, "what": what, "parameters": size}


def choose(
    wanted: Sequence[str], rng: np.random.Generator, strength: float = 1.0, spread: float = 0.2
) -> list[HiddenFault]:
    """Return what ``KIND`` or ``KIND@WHERE`` name, with sizes drawn around the usual ones.

    Raises
    ------
    BenchError
        With every kind or place that does not exist, and everything asked for twice.
    """
    faults: list[str] = []
    chosen: list[HiddenFault] = []
    for text in wanted:
        kind, at, where = text.strip().partition("@")
        if kind not in KINDS:
            faults.append(f"--hide {text}: there is no effect '{kind}'{nearest(kind, list(KINDS))}; --list shows all")
            continue
        known = KINDS[kind]
        place = where if at else known.places[0]
        if place not in known.places:
            faults.append(f"--hide {text}: {kind} fits {', '.join(known.places)}")
            continue
        if any(other.name == f"{kind}@{place}" for other in chosen):
            faults.append(f"--hide {text}: asked for twice: change its size with --strength instead")
            continue
        size = strength * known.usual * known.size * float(rng.uniform(1.0 - spread, 1.0 + spread))
        chosen.append(HiddenFault(known, place, size, int(rng.integers(2**31))))
    if faults:
        raise BenchError(faults)
    return chosen


#: What every gear stage that was made and assembled has, as shares of the usual sizes.
_USUAL = (
    ("eccentricity@input_gear", 0.5),
    ("eccentricity@output_gear", 0.7),
    ("pitch_error@input_gear", 0.5),
    ("pitch_error@output_gear", 0.6),
    ("profile_error@mesh", 0.6),
    ("misalignment@mesh", 0.4),
    *((f"bearing_clearance@{b}", 0.4) for b in BEARINGS),
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
