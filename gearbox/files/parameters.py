"""The numbers of a gear stage: read from a TOML file, checked all at once, SI inside."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from gearbox.files.errors import GearError
from gearbox.files.geometry import GearPair
from multibody.base.parameter_file import load_parameters, number

__all__ = [
    "PAPER",
    "StageParameters",
    "hertz_stiffness",
]

#: The parameter file of the paper's gear stage.
PAPER = Path(__file__).with_name("data") / "paper.toml"


def hertz_stiffness(radius_1: float, radius_2: float, modulus: float, poisson: float) -> float:
    """Return K = 4/3·√r_e·E_e of two bodies of the same material, in N/m^1.5.

    Digital twin-assisted gearbox updating, Eqs. 15 to 17.

    Parameters
    ----------
    radius_1, radius_2 : float, m
        Equivalent radii; the paper takes about the pitch radii.
    modulus : float, Pa
        Elastic modulus of both.
    poisson : float
        Poisson's ratio of both.

    Examples
    --------
    >>> K = hertz_stiffness(57.473e-3, 79.025e-3, 210e9, 0.29)
    >>> round(K * 1e-3**1.5 / 1e5, 3)  # 1e5 N/mm^1.5; the paper has 8.6
    8.817
    """
    radius = radius_1 * radius_2 / (radius_1 + radius_2)
    return 4.0 / 3.0 * math.sqrt(radius) * 0.5 * modulus / (1.0 - poisson**2)


@dataclass(frozen=True, kw_only=True)
class GearParameters:
    """The pair of gears; see `gearbox.files.geometry.GearPair`."""

    teeth_1: float = number("", "teeth of the driving gear", least=1.0)
    teeth_2: float = number("", "teeth of the driven gear", least=1.0)
    module: float = number("m", "normal module", above=0.0)
    width: float = number("m", "face width", above=0.0)
    pressure_angle: float = number("rad", "normal pressure angle", above=0.0, default=math.radians(20.0))
    helix_angle: float = number("rad", "helix angle of the driving gear", default=0.0)
    shift_1: float = number("", "profile shift coefficient of the driving gear", default=0.0)
    shift_2: float = number("", "profile shift coefficient of the driven gear", default=0.0)
    centre_distance: float = number("m", "centre distance; 0: without backlash by itself", least=0.0, default=0.0)
    backlash: float = number("m", "circumferential backlash from thinner teeth", least=0.0, default=0.0)
    addendum: float = number("", "addendum of the basic rack in modules", above=0.0, default=1.0)
    dedendum: float = number("", "dedendum of the basic rack in modules", above=0.0, default=1.25)
    relief_1: float = number("m", "tip relief of the driving gear", least=0.0, default=0.0)
    relief_2: float = number("m", "tip relief of the driven gear", least=0.0, default=0.0)
    relief_length_1: float = number("m", "length of the relief along the line of action", above=0.0, default=3e-3)
    relief_length_2: float = number("m", "length of the relief along the line of action", above=0.0, default=3e-3)

    def pair(self) -> GearPair:
        """Return the geometry.

        Raises
        ------
        GearError
            If these gears cannot run together.
        """
        given: dict[str, Any] = dataclasses.asdict(self)
        given["centre_distance"] = given["centre_distance"] or None
        for name in ("teeth_1", "teeth_2"):
            if given[name] == int(given[name]):
                given[name] = int(given[name])
        return GearPair(**given)


@dataclass(frozen=True)
class MaterialParameters:
    """Material of the gears and shafts."""

    density: float = number("kg/m**3", "density", above=0.0)
    modulus: float = number("Pa", "elastic modulus", above=0.0)
    poisson: float = number("", "Poisson's ratio", least=0.0)


@dataclass(frozen=True, kw_only=True)
class ContactParameters:
    """Contact of the teeth, Table 2."""

    K: float = number("", "force in N that a full-face pair carries when pressed in by 1 mm (N/mm^e)", above=0.0)
    e: float = number("", "force exponent", least=1.0)
    C_D: float = number("N*s/m", "largest contact damping of a full-face pair", least=0.0)
    D_P: float = number("m", "penetration at which damping is full", above=0.0)
    mu_s: float = number("", "static friction coefficient", least=0.0)
    v_s: float = number("m/s", "static transition speed", above=0.0)
    mu_d: float = number("", "dynamic friction coefficient", least=0.0)
    v_d: float = number("m/s", "dynamic transition speed", above=0.0)


@dataclass(frozen=True, kw_only=True)
class ShaftParameters:
    """A shaft, its gear in the middle between two bearings."""

    diameter: float = number("m", "diameter of the shaft", above=0.0)
    length: float = number("m", "length of the shaft", above=0.0)
    seat: float = number("m", "bearings at z = ±seat from the middle of the gear", above=0.0)
    drag: float = number("N*m*s/rad", "viscous resistance against turning", least=0.0, default=0.0)
    unbalance: float = number("kg*m", "mass times distance from the axis", least=0.0, default=0.0)


@dataclass(frozen=True, kw_only=True)
class BearingParameters:
    """The four bearings, all alike."""

    stiffness_radial: float = number("N/m", "radial stiffness", above=0.0)
    stiffness_axial: float = number("N/m", "axial stiffness", above=0.0)
    damping_radial: float = number("N*s/m", "radial damping", least=0.0)
    damping_axial: float = number("N*s/m", "axial damping", least=0.0)
    clearance: float = number("m", "radial clearance from the middle to one side", least=0.0, default=0.0)
    elements: float = number("", "rolling elements", least=3.0, whole=True, default=9.0)
    ratio: float = number("", "element diameter over pitch diameter, times cos(contact angle)", above=0.0, default=0.2)


@dataclass(frozen=True)
class DriveParameters:
    """How the input is driven; an infinite stiffness turns the input shaft itself."""

    stiffness: float = number("N*m/rad", "torsional stiffness of the coupling (inf: rigid)", above=0.0, infinite=True)
    damping: float = number("N*m*s/rad", "damping of the coupling", least=0.0)
    lag: float = number("s", "time constant with which the speed follows its reference", above=0.0, default=1e-3)


@dataclass(frozen=True, kw_only=True)
class StageParameters:
    """All numbers of a gear stage except the housing's modes; see the classes of its parts.

    Examples
    --------
    >>> StageParameters.paper().contact.K
    860000.0
    """

    name: str
    gears: GearParameters
    material: MaterialParameters
    contact: ContactParameters
    input_shaft: ShaftParameters
    output_shaft: ShaftParameters
    bearings: BearingParameters
    drive: DriveParameters

    @staticmethod
    def paper() -> StageParameters:
        """Return the stage of digital twin-assisted gearbox updating; what it does not publish is chosen."""
        return _paper()

    @staticmethod
    def load(path: str | Path) -> StageParameters:
        """Read a stage from a TOML file; with ``extends = "paper"`` it names only what differs from the paper's.

        Raises
        ------
        GearError
            With every unknown, missing or impossible entry.
        FileNotFoundError
            If there is no such file.
        """
        return load_parameters(StageParameters, path, "gear stage", {"paper": StageParameters.paper}, GearError)

    def replaced(self, part: str, **changes: float) -> StageParameters:
        """Return the stage with values of one part replaced, such as ``replaced("contact", K=7e5)``."""
        return dataclasses.replace(self, **{part: dataclasses.replace(getattr(self, part), **changes)})

    def body(self, gear: int) -> tuple[float, float, float]:
        """Return mass (kg), moment of inertia about the axis and about a diameter (kg m²) of gear 0 or 1 on its shaft.

        The gear is a disc of the pitch diameter; density enters here.
        """
        shaft = (self.input_shaft, self.output_shaft)[gear]
        rho, width = self.material.density, self.gears.width
        radius, inner = self.gears.pair().pitch_radii[gear], 0.5 * shaft.diameter
        rings = [(radius**2 - inner**2, radius**2 + inner**2, width), (inner**2, inner**2, shaft.length)]
        mass = J = J_t = 0.0
        for area, square, length in rings:
            m = rho * math.pi * area * length
            mass, J, J_t = mass + m, J + 0.5 * m * square, J_t + m * (square / 4.0 + length**2 / 12.0)
        return mass, J, J_t

    def faults(self) -> list[str]:
        """Return what does not fit together, each naming the section."""
        faults = []
        try:
            pair = self.gears.pair()
        except GearError as error:
            return [f"[gears] {fault}" for fault in error.faults]
        for key, radius in (("input_shaft", pair.root_radii[0]), ("output_shaft", pair.root_radii[1])):
            shaft: ShaftParameters = getattr(self, key)
            if shaft.diameter >= 2.0 * radius:
                faults.append(
                    f"[{key}] the diameter {shaft.diameter * 1e3:g} mm is not below the root diameter of its gear, "
                    f"{2e3 * radius:.4g} mm (are the units right?)"
                )
            if 2.0 * shaft.seat <= self.gears.width:
                faults.append(f"[{key}] the bearings at ±{shaft.seat * 1e3:g} mm stand inside the gear: enlarge seat")
        if self.material.poisson >= 0.5:
            faults.append(f"[material] poisson is {self.material.poisson:g}, it must be below 0.5")
        if self.contact.v_d <= self.contact.v_s:
            faults.append(f"[contact] v_d ({self.contact.v_d:g} m/s) must be above v_s ({self.contact.v_s:g} m/s)")
        if self.bearings.ratio >= 0.9:
            faults.append(f"[bearings] ratio is {self.bearings.ratio:g}, it must be below 0.9")
        return faults


@lru_cache(maxsize=1)
def _paper() -> StageParameters:
    return StageParameters.load(PAPER)
