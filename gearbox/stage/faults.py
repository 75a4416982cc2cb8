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


@dataclass(frozen=True, kw_only=True)
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
        Where a rig hides it by default; "": the first place.
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
    FaultKind(
        label="eccentricity",
        kind="eccentricity",
        what="The teeth run out of true with their axis.",
        where=GEARS,
        parameters=("mesh.eccentricity_{n}",),
        size=50e-6,
        unit="m",
        phase="mesh.high_{n}",
        usual=0.4,
        usual_at="output_gear",
    ),
    FaultKind(
        label="pitch_error",
        kind="pitch_error",
        what="The spacing of the teeth has two waves around the gear.",
        where=GEARS,
        parameters=("mesh.lobes_cos_{n}",),
        size=15e-6,
        unit="m",
        usual=0.4,
        usual_at="output_gear",
    ),
    FaultKind(
        label="profile_error",
        kind="profile_error",
        what="The flanks have too much material at one end of the path of contact.",
        where=("mesh",),
        parameters=("mesh.profile_slope",),
        size=15e-6,
        unit="m",
    ),
    FaultKind(
        label="profile_form",
        kind="profile_error",
        what="The flanks are fuller at both ends of the path of contact.",
        where=("mesh",),
        parameters=("mesh.profile_form",),
        size=16e-6,
        unit="m",
        usual=0.25,
    ),
    FaultKind(
        label="misalignment",
        kind="misalignment",
        what="The axes are not parallel: the flanks carry at one end of the face.",
        where=("mesh",),
        parameters=("mesh.misalignment",),
        size=1e-3,
        unit="rad",
        usual=0.3,
    ),
    FaultKind(
        label="wear",
        kind="wear",
        what="Material is worn off where the flanks slide.",
        where=("mesh",),
        parameters=("mesh.wear",),
        size=20e-6,
        unit="m",
        usual=0.25,
    ),
    FaultKind(
        label="mesh_stiffness_variation",
        kind="mesh_stiffness_variation",
        what="The stiffness of the teeth varies over a turn.",
        where=GEARS,
        parameters=("mesh.variation_{n}",),
        size=0.2,
        unit="",
        usual=0.4,
        usual_at="output_gear",
    ),
    FaultKind(
        label="mesh_backlash",
        kind="mesh_backlash",
        what="There is more backlash than there should be.",
        where=("mesh",),
        parameters=("mesh.added_backlash",),
        size=4e-4,
        unit="m",
        usual=0.25,
    ),
    FaultKind(
        label="tooth_crack",
        kind="tooth_defect",
        what="A crack at its root makes one tooth softer.",
        where=GEARS,
        parameters=("mesh.crack_{n}",),
        size=0.6,
        unit="",
        tooth="mesh.damaged_{n}",
        usual=2.0 / 3.0,
    ),
    FaultKind(
        label="missing_tooth",
        kind="tooth_defect",
        what="One tooth is broken off; severity 1 is all of it.",
        where=GEARS,
        parameters=("mesh.crack_{n}",),
        size=1.0,
        unit="",
        tooth="mesh.damaged_{n}",
    ),
    FaultKind(
        label="chipped_tooth",
        kind="tooth_defect",
        what="A piece of one tooth is broken off at the end of the face.",
        where=GEARS,
        parameters=("mesh.chip_{n}",),
        size=0.5,
        unit="",
        tooth="mesh.damaged_{n}",
    ),
    FaultKind(
        label="spall",
        kind="tooth_defect",
        what="One flank has a pit near the pitch line.",
        where=GEARS,
        parameters=("mesh.spall_{n}",),
        size=60e-6,
        unit="m",
        tooth="mesh.damaged_{n}",
    ),
    FaultKind(
        label="unbalance",
        kind="unbalance",
        what="The centre of mass lies off the axis.",
        where=SHAFTS,
        parameters=("{where}.unbalance",),
        size=5e-3,
        unit="kg*m",
        phase="{where}.unbalance_angle",
        usual=0.08,
    ),
    FaultKind(
        label="bearing_clearance",
        kind="bearing_clearance",
        what="A bearing has play.",
        where=BEARINGS,
        parameters=("{where}.clearance",),
        size=30e-6,
        unit="m",
        usual=4.0 / 15.0,
    ),
    FaultKind(
        label="bearing_outer",
        kind="bearing_defect",
        what="The outer ring of a bearing has a pit.",
        where=BEARINGS,
        parameters=("{where}.outer_pit",),
        size=10e-6,
        unit="m",
        phase="{where}.outer_angle",
        usual=0.6,
    ),
    FaultKind(
        label="bearing_inner",
        kind="bearing_defect",
        what="The inner ring of a bearing has a pit.",
        where=BEARINGS,
        parameters=("{where}.inner_pit",),
        size=10e-6,
        unit="m",
    ),
    FaultKind(
        label="bearing_element",
        kind="bearing_defect",
        what="A rolling element of a bearing has a pit.",
        where=BEARINGS,
        parameters=("{where}.element_pit",),
        size=10e-6,
        unit="m",
    ),
)

#: all kinds by label
FAULTS: dict[str, FaultKind] = {row.label: row for row in _ROWS}


@dataclass(frozen=True, kw_only=True)
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

    def sizes(self) -> dict[str, float]:
        """Return the model parameters that grow with the severity, by full name, SI."""
        return {self._named(p): self.severity * self.kind.size for p in self.kind.parameters}

    def values(self) -> dict[str, float]:
        """Return the model parameters that bring it about, by full name, SI."""
        values = self.sizes()
        if self.kind.tooth:
            values[self._named(self.kind.tooth)] = float(self.tooth)
        if self.kind.phase:
            values[self._named(self.kind.phase)] = self.phase
        return values

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
    return Fault(kind=kind, where=where, severity=float(severity), tooth=int(tooth), phase=float(phase))


def _all() -> str:
    return ", ".join(FAULTS)


def combined(faults: Iterable[Fault]) -> dict[str, float]:
    """Return the parameters of several faults together.

    Raises
    ------
    GearError
        If two of them set the same parameter to different values, such as two damaged teeth of one gear.
    """
    values: dict[str, float] = {}
    clashes = []
    for fault in faults:
        for name, value in fault.values().items():
            if name in values and values[name] != value:
                clashes.append(
                    f"'{name}' would be {values[name]:g} and {value:g} at once: {fault} cannot join the others"
                )
            values[name] = value
    if clashes:
        raise GearError("these faults together", clashes)
    return values


def damageable(stage: AnyStage) -> AnyStage:
    """Return the same stage with a structure that can have faults, all of severity zero."""
    if stage.structure.imperfect and stage.structure.bearing_defects:
        return stage
    structure = dataclasses.replace(stage.structure, imperfect=True, bearing_defects=True)
    return type(stage)(stage.parameters, structure, modes=stage.modes, name=stage.name)
