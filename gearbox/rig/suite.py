"""The virtual gear rig with encoders as the suites run it; what is hidden has the rig's usual size.

A scan for the smallest visible strength would cost as much again as the search itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from gearbox.rig.encoders import CYCLES, KINDS, make_encoders
from gearbox.rig.hidden import KINDS as HIDDEN
from gearbox.rig.hidden import HiddenFault
from gearbox.rig.rig import TEETH, GearRig

if TYPE_CHECKING:
    from discrepancy.problem.problem import Problem

__all__ = ["SCALED", "TRIALS", "UNKNOWN", "case", "names", "sizes"]

#: The rig hides no force that is of no kind.
UNKNOWN = ""
#: Seeds of a suite by default: a trial is some minutes of processor time.
TRIALS = 3
#: Effects are hidden at their usual size, not at a multiple of the smallest visible one.
SCALED = False
#: Where the model under test has what the rig has there.
PLACES = {"mesh.gear_1": "input_gear", "mesh.gear_2": "output_gear", "mesh": "mesh"}


@dataclass(frozen=True)
class GearCase:
    """Recordings of the rig with something hidden, as a study takes them.

    Parameters
    ----------
    seed : int
    hidden : tuple of str
        ``kind@where``, by the names of the model under test.
    """

    seed: int
    hidden: tuple[str, ...] = ()

    @property
    def truth(self) -> dict[str, Any]:
        """What was hidden, by the names of the model under test."""
        return {"effects": sizes(self.seed, self.hidden)}

    def problem(self, seed: int = 0) -> Problem:
        """Make the recordings and read them back as anybody's."""
        from discrepancy.problem.problem import read_problem

        with TemporaryDirectory() as folder:
            path = make_encoders(Path(folder), [_on_rig(name) for name in self.hidden], rig=GearRig(seed=self.seed))
            return read_problem(path, seed=seed)


def _on_rig(name: str) -> str:
    """Return ``kind@where`` by the rig's name of the place."""
    kind, _, where = name.partition("@")
    return f"{kind}@{PLACES.get(where, where)}"


def _parameters(fault: HiddenFault) -> dict[str, dict[str, float]]:
    """Return the size as the strengths of the catalogue's kind have it, where the gears stand as a record begins."""
    from gearbox.stage.effects import GEAR_KINDS

    kind = next(k for k in GEAR_KINDS if k.name == fault.kind.kind)
    if kind.name == "pitch_error":
        values = _lobes(fault)
    elif kind.name == "eccentricity":
        high = fault.values()[fault.kind.phase.format(n=fault.gear)]
        turned = _turned(fault) if fault.gear == 1 else -_turned(fault)  # the gears turn against each other
        values = _pair("runout_x", "runout_y", fault.size * np.exp(1j * (high + turned)))
    elif kind.name == "mesh_stiffness_variation":
        values = _pair("variation", "variation_sin", fault.size * np.exp(-1j * _turned(fault)))
    else:
        named = fault.kind.parameters[0].partition(".")[2]
        first = named if named in kind.strengths else kind.strengths[0]
        values = {name: fault.size if name == first else 0.0 for name in kind.strengths}
    return {name: {"value": value} for name, value in values.items()}


def _turned(fault: HiddenFault) -> float:
    """Return the angle that a gear turns through before a record begins, which the model under test does not do."""
    return 2.0 * np.pi * CYCLES / TEETH[fault.gear - 1]


def _pair(first: str, second: str, value: complex) -> dict[str, float]:
    return {first: float(value.real), second: float(value.imag)}


def _lobes(fault: HiddenFault) -> dict[str, float]:
    """Return the two, three and four waves of the rig's pattern of pitch errors: what the catalogue's kind can have.

    Its first wave is an eccentricity, and its finer ones are of no kind.
    """
    (teeth, pattern), *_ = fault.patterns(TEETH).values()
    lobes: dict[str, float] = {}
    for waves, ending in ((2, ""), (3, "3"), (4, "4")):
        part = 2.0 * fault.size * np.mean(pattern * np.exp(2j * np.pi * waves * teeth / teeth.size))
        lobes |= _pair(f"lobes{ending}_cos", f"lobes{ending}_sin", part * np.exp(-1j * waves * _turned(fault)))
    return lobes


def case(seed: int, hidden: Sequence[str] = (), **settings: Any) -> GearCase:
    """Return recordings of the stage with something hidden, and the model under test."""
    if settings:
        raise TypeError(f"the gear rig takes no {', '.join(settings)}")
    return GearCase(seed, tuple(hidden))


def sizes(seed: int, hidden: Sequence[str]) -> list[dict[str, Any]]:
    """Return the effects as they are hidden at their usual size; nothing is simulated for it."""
    faults = GearRig(seed=seed).faults_of([_on_rig(name) for name in hidden])
    rows = []
    for name, fault in zip(hidden, faults, strict=False):
        kind, _, where = name.partition("@")
        rows.append({"kind": kind, "where": where, "parameters": _parameters(fault)})
    return rows


def names() -> list[str]:
    """Return everything that can be hidden and that encoders can show, as ``kind@where`` of the model under test."""
    on_rig = {place: where for where, place in PLACES.items()}
    return [f"{kind}@{on_rig[p]}" for kind in KINDS if kind in HIDDEN for p in HIDDEN[kind].places if p in on_rig]
