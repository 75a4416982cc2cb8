"""The gear stage as a model: two gears on their shafts, teeth in contact, bearings, housing, drive and load.

Digital twin-assisted gearbox dynamic model updating toward fault diagnosis, section 4.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

import gearbox.stage.effects  # noqa: F401 - what a stage may lack joins the catalogue of missing effects
from gearbox.files.errors import GearError
from gearbox.files.geometry import GearPair
from gearbox.files.parameters import StageParameters
from gearbox.parts.bearings import BearingBushing, SeatLoad
from gearbox.parts.housing import housing_component
from gearbox.parts.housing_modes import AXES, SENSORS, ModeSet, clamped_modes
from gearbox.parts.mesh import HelicalMesh
from gearbox.parts.shafts import GearShaft
from gearbox.parts.shipped_housing import box_modes, rigid_box
from multibody.base.spelling import nearest
from multibody.library.rotation import SpeedSource, TorqueSource, TorsionDamper, TorsionSpring
from multibody.machine.model import Model, System

__all__ = ["MOTIONS", "GearModel", "Structure", "line_count", "mesh_values"]

#: The paper's names of the contact parameters, and the model's.
SHORT_NAMES = {"K": "mesh.K", "C_D": "mesh.C_D", "e_F": "mesh.e", "D_P": "mesh.D_P"}

MOTIONS = ("x", "y", "z", "tilt_x", "tilt_y", "spin")
#: penetration for which lines of contact are looked for, m
_DEEPEST = 3e-4


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Which motions of a gear stage are free, and how its teeth are integrated.

    Parameters
    ----------
    input_free, output_free : tuple of str
        Free motions of the two shafts, of x, y, z, tilt_x, tilt_y and spin; the default is all six.  With the spin
        alone the bearings pass the mesh forces on without giving way.
    housing : {"flexible", "rigid", "clamped"}
        By its modes; as a rigid body on its mounts; or bearing seats that stand still.
    slices : int
        0: along the moving line of contact; otherwise the number of fixed slices of the face.
    imperfect : bool
        True: the teeth can have deviations and damage (`gearbox.parts.mesh.HelicalMesh`), all zero at first.
    bearing_defects : bool
        True: the bearings can have pits, all zero at first.
    """

    input_free: tuple[str, ...] = MOTIONS
    output_free: tuple[str, ...] = MOTIONS
    housing: str = "flexible"
    slices: int = 0
    imperfect: bool = False
    bearing_defects: bool = False

    def faults(self) -> list[str]:
        """Return what does not fit together."""
        faults = []
        for name in ("input_free", "output_free"):
            free = getattr(self, name)
            faults += [
                f"{name}: there is no motion '{m}'; take some of {', '.join(MOTIONS)}" for m in free if m not in MOTIONS
            ]
            if "spin" not in free:
                faults.append(f"{name}: the spin must be free, or nothing turns")
        if self.housing not in ("flexible", "rigid", "clamped"):
            faults.append(f"housing is '{self.housing}': take 'flexible', 'rigid' or 'clamped'")
        if not isinstance(self.slices, int) or self.slices < 0:
            faults.append(f"slices is {self.slices!r}: give 0 for the moving line or a whole number of slices")
        return faults

    def lateral(self, gear: int) -> bool:
        """Tell whether a shaft can move otherwise than turn."""
        return set((self.input_free, self.output_free)[gear]) != {"spin"}


class GearModel(Model):
    """A gear stage on the modelling core: its components, connections, inputs and outputs.

    Inputs are ``speed`` (rad/s, of the drive) and ``torque`` (N m, load on the output shaft, positive against its
    turning).  Outputs are the accelerometers ``a_<sensor>_<axis>`` with the sensors input_seat, output_seat and base,
    ``mesh_force``, ``back_force``, ``transmission_error``, ``drive_torque``, ``speed_1``, ``speed_2``.

    Users take `gearbox.GearStage`, which describes the parameters and adds the analyses.
    """

    def __init__(
        self,
        parameters: StageParameters | None = None,
        structure: Structure | None = None,
        *,
        modes: ModeSet | None = None,
        name: str | None = None,
    ):
        self.parameters = parameters if parameters is not None else StageParameters.paper()
        self.structure = structure if structure is not None else Structure()
        super().__init__(name or self.parameters.name)
        faults = [*self.parameters.faults(), *self.structure.faults()]
        if faults:
            raise GearError(f"the gear stage '{self.name}'", faults)
        self.modes = modes if modes is not None else _default_modes(self.structure.housing)
        self.pair: GearPair = self.parameters.gears.pair()
        self._assemble()

    @classmethod
    def paper(cls, *, modes: ModeSet | None = None, name: str | None = None, **structure: Any) -> Self:
        """Return the paper's stage; keywords are those of `Structure`."""
        return cls(None, Structure(**structure), modes=modes, name=name)

    @classmethod
    def torsional(cls, parameters: StageParameters | None = None, **structure: Any) -> Self:
        """Return the stage whose shafts only turn."""
        return cls(parameters, Structure(**{"input_free": ("spin",), "output_free": ("spin",), **structure}))

    # ---------------------------------------------------------------- putting it together

    def _assemble(self) -> None:
        p, s = self.parameters, self.structure
        for gear, (side, shaft, free) in enumerate(
            (("input", p.input_shaft, s.input_free), ("output", p.output_shaft, s.output_free))
        ):
            mass, J, J_t = p.body(gear)
            flags = {f"{motion}_free": motion in free for motion in MOTIONS}
            self.add(
                f"{side}_shaft", GearShaft(mass=mass, J=J, J_t=J_t, drag=shaft.drag, unbalance=shaft.unbalance, **flags)
            )
        mesh = self.add(
            "mesh", HelicalMesh(slices=s.slices, imperfect=s.imperfect, lines=line_count(self.pair), **mesh_values(p))
        )
        for number, side in ((1, "input"), (2, "output")):
            for motion in MOTIONS:
                self.connect(f"{side}_shaft.{motion}", getattr(mesh, f"{motion}_{number}"))
        self.add("housing", housing_component(self.modes))
        for gear, side in enumerate(("input", "output")):
            self._bearings(gear, side)
        self._drive()
        self._name_signals()

    def _bearings(self, gear: int, side: str) -> None:
        p, s = self.parameters, self.structure
        seat = (p.input_shaft, p.output_shaft)[gear].seat
        if not s.lateral(gear):
            sign = -1.0 if gear == 0 else 1.0
            load = self.add(f"{side}_seats", SeatLoad(low=-seat, high=seat, sign=sign, moment_sign=-sign))
            for axis in AXES:
                self.connect(f"mesh.force_{axis}", getattr(load, f"force_{axis}"))
                for end in ("low", "high"):
                    self.connect(getattr(load, f"{end}_{axis}"), f"housing.{side}_{end}_{axis}")
            self.connect("mesh.moment_x", load.moment_x)
            self.connect(f"mesh.moment_y_{gear + 1}", load.moment_y)
            return
        b = p.bearings
        for end, place in (("low", -seat), ("high", seat)):
            values = {k: getattr(b, k) for k in ("stiffness_radial", "damping_radial", "clearance")}
            if end == "low":  # the low bearing is the fixed one, the high one floats along the axis
                values |= {"stiffness_axial": b.stiffness_axial, "damping_axial": b.damping_axial}
            if s.bearing_defects:
                values |= {"elements": b.elements, "ratio": b.ratio}
            part = self.add(f"{side}_{end}", BearingBushing(place=place, defects=s.bearing_defects, **values))
            for motion in MOTIONS[: 6 if s.bearing_defects else 5]:
                self.connect(f"{side}_shaft.{motion}", getattr(part, motion))
            for axis in AXES:
                self.connect(getattr(part, f"seat_{axis}"), f"housing.{side}_{end}_{axis}")

    def _drive(self) -> None:
        d = self.parameters.drive
        source = self.add("drive", SpeedSource(time_constant=d.lag))
        if np.isinf(d.stiffness):
            self.connect(source.flange, "input_shaft.spin")
        else:
            spring = self.add("coupling", TorsionSpring(stiffness=d.stiffness))
            damper = self.add("coupling_damping", TorsionDamper(damping=d.damping))
            self.connect(source.flange, spring.a, damper.a)
            self.connect("input_shaft.spin", spring.b, damper.b)
        load = self.add("load", TorqueSource())
        self.connect(load.flange, "output_shaft.spin")
        self.input("speed", source.reference)
        self.input("torque", load.torque)

    def _name_signals(self) -> None:
        for sensor in SENSORS:
            for axis in AXES:
                self.output(f"a_{sensor}_{axis}", f"housing.a_{sensor}_{axis}")
        spin_1 = "drive.speed" if np.isinf(self.parameters.drive.stiffness) else "input_shaft.spin_speed"
        names = {
            "mesh_force": "mesh.force",
            "back_force": "mesh.back_force",
            "drive_torque": "drive.torque",
            "transmission_error": "mesh.transmission_error",
            "speed_1": spin_1,
            "speed_2": "output_shaft.spin_speed",
        }
        for name, source in names.items():
            self.output(name, source)
        self.feature("tooth of the driving gear", 2.0 * np.pi / self.pair.teeth_1, "speed_1")

    @cached_property
    def system(self) -> System:
        """The compiled stage with the outputs that it names."""
        return self.build(outputs=list(self.outputs))

    def values(self, **changes: float) -> dict[str, float]:
        """Return parameters of the model by full name for changes of physical ones.

        Parameters
        ----------
        **changes : float
            ``K``, ``C_D``, ``e_F``, ``D_P``, ``E``, ``rho`` in SI (K in N at 1 mm), or full names.  A density changes
            masses and inertias of both shafts; an elastic modulus changes K in proportion (Eqs. 15 and 17), unless K
            is given.

        Raises
        ------
        GearError
            With every name that is unknown and every number that is not finite.
        """
        known = {f"{n}.{p}" for n, c in self.components.items() for p in c.values}
        values: dict[str, float] = {}
        faults = []
        for name, value in changes.items():
            if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
                faults.append(f"{name} is {value!r}: give a finite number")
            elif name in SHORT_NAMES:
                values[SHORT_NAMES[name]] = float(value)
            elif name in known:
                values[name] = float(value)
            elif name not in ("E", "rho"):
                faults.append(f"there is no parameter '{name}'{nearest(name, [*SHORT_NAMES, 'E', 'rho', *known])}")
            elif not float(value) > 0.0:
                faults.append(f"{name} is {value:g}: give a positive number")
        if faults:
            raise GearError(f"the parameters of '{self.name}'", faults)
        if "E" in changes:
            ratio = float(changes["E"]) / self.parameters.material.modulus
            values.setdefault("mesh.K", self.parameters.contact.K * ratio)
        if "rho" in changes:
            other = self.parameters.replaced("material", density=float(changes["rho"]))
            for gear, side in enumerate(("input_shaft", "output_shaft")):
                for name, value in zip(("mass", "J", "J_t"), other.body(gear), strict=True):
                    values.setdefault(f"{side}.{name}", value)
        return values


def _default_modes(housing: str) -> ModeSet:
    if housing == "clamped":
        return clamped_modes()
    return rigid_box() if housing == "rigid" else box_modes()


def line_count(pair: GearPair) -> int:
    """Return how many lines of contact can be at work at a time."""
    slant = pair.width * abs(np.tan(pair.base_helix_angle))
    span = pair.path_end - pair.path_start + 2.0 * pair.reach(_DEEPEST) + slant
    return int(np.floor(span / pair.base_pitch)) + 1


def mesh_values(parameters: StageParameters) -> dict[str, float]:
    """Return the values of a `HelicalMesh` for a stage."""
    pair, c = parameters.gears.pair(), parameters.contact
    cos_b = float(np.cos(pair.base_helix_angle))
    (square_1, cube_1), (square_2, cube_2) = pair.gap_coefficients(0), pair.gap_coefficients(1)
    thinner = pair.backlash / 2.0 if pair.backlash else 0.0
    return {
        "teeth_1": float(pair.teeth_1),
        "teeth_2": float(pair.teeth_2),
        "base_1": pair.base_radii[0],
        "base_2": pair.base_radii[1],
        "alpha": pair.working_pressure_angle,
        "beta_b": pair.base_helix_angle,
        "width": pair.width,
        "base_pitch": pair.base_pitch,
        "edge_1": pair.path_end,
        "edge_2": -pair.path_start,
        "square_1": square_1 * cos_b,
        "cube_1": cube_1 * cos_b,
        "square_2": square_2 * cos_b,
        "cube_2": cube_2 * cos_b,
        "reach": pair.reach(_DEEPEST),
        "relief_1": pair.relief_1,
        "relief_2": pair.relief_2,
        "relief_length_1": pair.relief_length_1,
        "relief_length_2": pair.relief_length_2,
        "thickness": pair.tooth_thicknesses[0] - thinner,
        "backlash": pair.normal_backlash,
        "K": c.K,
        "e": c.e,
        "C_D": c.C_D,
        "D_P": c.D_P,
        "mu_s": c.mu_s,
        "v_s": c.v_s,
        "mu_d": c.mu_d,
        "v_d": c.v_d,
    }
