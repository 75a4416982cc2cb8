"""Faults and imperfections of a gear stage: what they are and which parameters bring them about; zero is absence."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from gearbox.files.errors import GearError
from gearbox.stage.model import GearModel
from multibody.base.spelling import nearest

__all__ = ["BEARINGS", "FAULTS", "HEALTHY", "Fault", "FaultKind", "combined", "damageable", "fault"]

BEARINGS = ("input_low", "input_high", "output_low", "output_high")
GEARS = ("input_gear", "output_gear")
SHAFTS = ("input_shaft", "output_shaft")
AnyStage = TypeVar("AnyStage", bound=GearModel)
#: Label of a stage without any fault.
HEALTHY = "healthy"


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault.

    Parameters
    ----------
    label : str
        Name in labelled data, unique.
    kind : str
        Name of the effect, as the catalogue of missing effects has it.
    what : str
        One sentence.
    where : tuple of str
        Places where it can be.
    parameters : tuple of str
        Model parameters that are proportional to the severity, with ``{n}`` for the gear's number and ``{where}`` for
        the place; zero is absence.
    size : float
        Value at severity 1: grave, but the stage still runs.
    unit : str
    tooth : str
        Parameter that takes the number of the tooth, if the fault is one tooth's.
    phase : str
        Parameter that takes the angle at which it lies, if it turns with something.
    usual : float
        Severity with which a virtual rig hides it, or has it from manufacturing; 0 where a rig takes another of its
        kind.
    usual_at : str
        Where a rig hides it unless told otherwise; default: the first place.
    """

    label: str
    kind: str
    what: str
    where: tuple[str, ...]
    parameters: tuple[str, ...]
    size: float
    unit: str
    tooth: str = ""
    phase: str = ""
    usual: float = 0.0
    usual_at: str = ""

    @property
    def places(self) -> tuple[str, ...]:
        """Where it can be, the rig's usual place first."""
        first = self.usual_at or self.where[0]
        return (first, *(w for w in self.where if w != first))


_ROWS = (
    FaultKind("eccentricity", "eccentricity", "The teeth run out of true with their axis.", GEARS,
              ("mesh.eccentricity_{n}",), 50e-6, "m", phase="mesh.high_{n}", usual=0.4, usual_at="output_gear"),
    FaultKind("pitch_error", "pitch_error", "The spacing of the teeth has two waves around the gear.", GEARS,
              ("mesh.lobes_cos_{n}",), 15e-6, "m", usual=0.4, usual_at="output_gear"),
    FaultKind("profile_error", "profile_error", "The flanks have too much material at one end of the path of contact.",
              ("mesh",), ("mesh.profile_slope",), 15e-6, "m"),
    FaultKind("profile_form", "profile_error", "The flanks are fuller at both ends of the path of contact.", ("mesh",),
              ("mesh.profile_form",), 16e-6, "m", usual=0.25),
    FaultKind("misalignment", "misalignment", "The axes are not parallel: the flanks carry at one end of the face.",
              ("mesh",), ("mesh.misalignment",), 1e-3, "rad", usual=0.3),
    FaultKind("wear", "wear", "Material is worn off where the flanks slide.", ("mesh",), ("mesh.wear",), 20e-6, "m",
              usual=0.25),
    FaultKind("mesh_stiffness_variation", "mesh_stiffness_variation", "The stiffness of the teeth varies over a turn.",
              GEARS, ("mesh.variation_{n}",), 0.2, "", usual=0.4, usual_at="output_gear"),
    FaultKind("mesh_backlash", "mesh_backlash", "There is more backlash than there should be.", ("mesh",),
              ("mesh.added_backlash",), 4e-4, "m", usual=0.25),
    FaultKind("tooth_crack", "tooth_defect", "A crack at its root makes one tooth softer.", GEARS,
              ("mesh.crack_{n}",), 0.6, "", tooth="mesh.damaged_{n}", usual=2.0 / 3.0),
    FaultKind("missing_tooth", "tooth_defect", "One tooth is broken off; severity 1 is all of it.", GEARS,
              ("mesh.crack_{n}",), 1.0, "", tooth="mesh.damaged_{n}"),
    FaultKind("chipped_tooth", "tooth_defect", "A piece of one tooth is broken off at the end of the face.", GEARS,
              ("mesh.chip_{n}",), 0.5, "", tooth="mesh.damaged_{n}"),
    FaultKind("spall", "tooth_defect", "One flank has a pit near the pitch line.", GEARS,
              ("mesh.spall_{n}",), 60e-6, "m", tooth="mesh.damaged_{n}"),
    FaultKind("unbalance", "unbalance", "The centre of mass lies off the axis.", SHAFTS,
              ("{where}.unbalance",), 5e-3, "kg*m", phase="{where}.unbalance_angle", usual=0.08),
    FaultKind("bearing_clearance", "bearing_clearance", "A bearing has play.", BEARINGS, ("{where}.clearance",), 30e-6,
              "m", usual=4.0 / 15.0),
    FaultKind("bearing_outer", "bearing_defect", "The outer ring of a bearing has a pit.", BEARINGS,
              ("{where}.outer_pit",), 10e-6, "m", phase="{where}.outer_angle", usual=0.6),
    FaultKind("bearing_inner", "bearing_defect", "The inner ring of a bearing has a pit.", BEARINGS,
              ("{where}.inner_pit",), 10e-6, "m"),
    FaultKind("bearing_element", "bearing_defect", "A rolling element of a bearing has a pit.", BEARINGS,
              ("{where}.element_pit",), 10e-6, "m"),
)  # fmt: skip

#: all kinds by label
FAULTS: dict[str, FaultKind] = {row.label: row for row in _ROWS}


@dataclass(frozen=True)
class Fault:
    """A kind of fault at a place, with its severity.

    Parameters
    ----------
    kind : FaultKind
    where : str
    severity : float
        0 is absence, 1 a grave fault; larger is possible where the parameters allow it.
    tooth : int
        Which tooth, where the fault is one tooth's.
    phase : float, rad
        Where it lies around the shaft or ring.
    """

    kind: FaultKind
    where: str
    severity: float
    tooth: int = 0
    phase: float = 0.0

    def _named(self, pattern: str) -> str:
        number = {"input_gear": "1", "output_gear": "2"}.get(self.where, "")
        return pattern.format(n=number, where=self.where)

    def values(self) -> dict[str, float]:
        """Return the model parameters that bring it about, by full name, SI."""
        found = {self._named(p): self.severity * self.kind.size for p in self.kind.parameters}
        if self.kind.tooth:
            found[self._named(self.kind.tooth)] = float(self.tooth)
        if self.kind.phase:
            found[self._named(self.kind.phase)] = self.phase
        return found

    def __str__(self) -> str:
        return f"{self.kind.label}@{self.where} at severity {self.severity:g}"


def fault(label: str, where: str = "", severity: float = 1.0, *, tooth: int = 0, phase: float = 0.0) -> Fault:
    """Return a fault by its label.

    Parameters
    ----------
    label : str
        One of `FAULTS`.
    where : str
        Default: the first place of the kind.
    severity : float
        Not negative.
    tooth : int
    phase : float, rad

    Raises
    ------
    GearError
        If there is no such kind, it cannot be there, or a number makes no sense.

    Examples
    --------
    >>> fault("eccentricity", "output_gear", 0.4).values()
    {'mesh.eccentricity_2': 2e-05, 'mesh.high_2': 0.0}
    """
    if label not in FAULTS:
        hint = nearest(label, FAULTS)
        raise GearError(f"the fault '{label}'", [f"there is no such kind{hint}: take one of {_all()}"])
    kind = FAULTS[label]
    where = where or kind.where[0]
    faults = []
    if where not in kind.where:
        faults.append(f"it cannot be at '{where}': take {', '.join(kind.where)}")
    if not (np.isfinite(severity) and severity >= 0.0):
        faults.append(f"its severity is {severity}: give zero or a positive number")
    if kind.unit == "" and np.isfinite(severity) and severity * kind.size > 1.0:
        faults.append(f"its severity is {severity:g}: more than {1.0 / kind.size:g} would leave less than nothing")
    if not np.isfinite(phase):
        faults.append(f"its phase is {phase}: give an angle in rad")
    if faults:
        raise GearError(f"the fault '{label}'", faults)
    return Fault(kind, where, float(severity), int(tooth), float(phase))


def _all() -> str:
    return ", ".join(FAULTS)


def combined(faults: Iterable[Fault]) -> dict[str, float]:
    """Return the parameters of several faults together.

    Raises
    ------
    GearError
        If two of them set the same parameter to different values, such as two damaged teeth of one gear.
    """
    found: dict[str, float] = {}
    clashes = []
    for each in faults:
        for name, value in each.values().items():
            if name in found and found[name] != value:
                clashes.append(
                    f"'{name}' would be {found[name]:g} and {value:g} at once: {each} cannot join the others"
                )
            found[name] = value
    if clashes:
        raise GearError("these faults together", clashes)
    return found


def damageable(stage: AnyStage) -> AnyStage:
    """Return the same stage with a structure that can have faults, all of severity zero."""
    if stage.structure.imperfect and stage.structure.bearing_defects:
        return stage
    structure = dataclasses.replace(stage.structure, imperfect=True, bearing_defects=True)
    return type(stage)(stage.parameters, structure, modes=stage.modes, name=stage.name)
