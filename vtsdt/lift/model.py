"""The lift's components and connections, and which of its motions are free.

González et al. 2020, sections II and III.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

from multibody.library.sensors import SensorChannel
from multibody.library.spatial import RigidBody
from multibody.machine.model import Model, System
from vtsdt.files.parameters import BodyParameters, GuideParameters, LiftParameters, ParameterError
from vtsdt.lift.speed_reference import reference_component
from vtsdt.parts.car import Accelerometer, Car, Hoist
from vtsdt.parts.control import FieldOrientedControl
from vtsdt.parts.guide import GuidingSystem
from vtsdt.parts.machine import GearedPMSM, MachineSupport
from vtsdt.parts.rope import DrivingPulley, Ropes

__all__ = ["LiftModel", "Structure"]

_LATERAL = ("x", "y")
_ROTATIONS = ("roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Which motions of a lift are free, and where its inputs come from.

    Parameters
    ----------
    cabin_lateral, cabin_rotation : bool
        x and y, and the three rotations of the cabin.
    counterweight_lateral, counterweight_rotation : bool
        The same for the counterweight.
    support_vertical, support_inclination : bool
        Motion of the machine's support; inclination needs the vertical motion.
    drive : bool
        False leaves only the cabin and its guides, with the rope's tension as input.
    profile : bool
        True generates the trip's speed reference inside the model; otherwise it is an input.
    sensors : bool
        True adds sensors with a gain and an offset: outputs ``sensor_omega.output`` (encoder),
        ``sensor_i_q.output``, ``sensor_F_c.output``, ``sensor_F_cw.output``.  The accelerometer is always present.
    """

    cabin_lateral: bool = True
    cabin_rotation: bool = True
    counterweight_lateral: bool = True
    counterweight_rotation: bool = True
    support_vertical: bool = True
    support_inclination: bool = True
    drive: bool = True
    profile: bool = False
    sensors: bool = False

    def faults(self) -> list[str]:
        """Return contradictions between the options."""
        if self.drive and self.support_inclination and not self.support_vertical:
            return ["support_inclination needs support_vertical: a support has three, one or no degree of freedom"]
        return []


class LiftModel(Model):
    """A lift assembled from its components; `vtsdt.lift.lift.Lift` adds its trips.

    Parameters
    ----------
    parameters : LiftParameters, optional
        Default: the shipped bench.
    structure : Structure, optional
        Default: all motions free.
    start : float, m
        Height of the cabin at which the pulley's angle is zero.
    payload : tuple of four float, optional
        Mass (kg) and position (x, y, z in m, from the middle of the floor) of a load.
    name : str

    Raises
    ------
    ParameterError
        If parts do not fit together: rails shorter than the travel, clearance larger than the gap, …
    """

    def __init__(
        self,
        parameters: LiftParameters | None = None,
        structure: Structure | None = None,
        *,
        start: float = 0.0,
        payload: tuple[float, float, float, float] | None = None,
        name: str | None = None,
    ):
        self.parameters = parameters if parameters is not None else LiftParameters.bench()
        self.structure = structure if structure is not None else Structure()
        self.start = float(start)
        self.payload = payload
        super().__init__(name or self.parameters.name)
        faults = [*self.parameters.faults(), *self.structure.faults()]
        travel = self.parameters.hoistway.travel
        if not 0.0 <= self.start <= travel:
            faults.append(f"start is {self.start:g} m, outside the hoistway from 0 to {travel:g} m")
        if faults:
            raise ParameterError(f"lift '{self.name}'", faults)
        self._assemble()

    def _assemble(self) -> None:
        s, p = self.structure, self.parameters
        self._body("cabin", p.cabin, s.cabin_lateral, s.cabin_rotation, self.start)
        if s.drive:
            top = p.hoistway.travel - self.start
            self._body("counterweight", p.counterweight, s.counterweight_lateral, s.counterweight_rotation, top)
            self._machine()
        self._guide("cabin", p.cabin_guide, p.cabin, s.cabin_lateral or s.cabin_rotation, "friction_c")
        if s.drive:
            lateral = s.counterweight_lateral or s.counterweight_rotation
            self._guide("counterweight", p.counterweight_guide, p.counterweight, lateral, "friction_cw")
        else:
            hoist = self.add("rope", Hoist(height=self.rim_heights[0]))
            self.connect(hoist.hitch, "cabin.hitch")
            self.input("F_c", hoist.tension)
        accelerometer = self.add("accelerometer", Accelerometer())
        self.connect(accelerometer.frame, "cabin.accelerometer")
        if s.sensors and s.drive:
            chains = {
                "omega": ("machine.omega", "rad/s"),
                "i_q": ("machine.i_q_measured", "A"),
                "F_c": ("ropes.F_c", "N"),
                "F_cw": ("ropes.F_cw", "N"),
            }
            for name, (source, unit) in chains.items():
                chain = self.add(f"sensor_{name}", SensorChannel(unit=unit))
                self.connect(source, chain.input)
        if self.payload is not None:
            mass, x, y, z = self.payload
            locked = dict.fromkeys((*_LATERAL, "z", *_ROTATIONS), False)
            load = self.add("payload", RigidBody(mass=mass, com_x=x, com_y=y, com_z=z, **locked))
            self.connect(load.parent, "cabin.floor")
        self._name_signals()

    def _body(self, name: str, body: BodyParameters, lateral: bool, rotation: bool, height: float) -> None:
        x, y, z = body.com
        i_xx, i_yy, i_zz = body.inertia
        free = {**dict.fromkeys(_LATERAL, lateral), **dict.fromkeys(_ROTATIONS, rotation)}
        self.add(
            name,
            Car(
                mass=body.mass,
                com_x=x,
                com_y=y,
                com_z=z,
                I_xx=i_xx,
                I_yy=i_yy,
                I_zz=i_zz,
                hitch_z=body.hitch,
                shoe_x=body.shoe_x,
                shoe_low=body.shoe_low,
                shoe_high=body.shoe_high,
                z_start=height,
                **free,
            ),
        )

    def _guide(self, side: str, guide: GuideParameters, body: BodyParameters, lateral: bool, friction: str) -> None:
        name = f"{side}_guide"
        if not lateral:
            part = self.add(name, GuidingSystem(lateral=False, right_curved=False))
            self.connect(part.body, f"{side}.com")
            self.input(friction, part.given_friction)
            return
        given = guide.profiles()
        bent_y = "left_y" in given or "right_y" in given
        tables = {n: (p.height, p.deviation) for n, p in given.items()}
        if bent_y:
            straight = ((self.parameters.hoistway.rail_bottom, self.parameters.hoistway.rail_top), (0.0, 0.0))
            tables = {"left_y": straight, "right_y": straight, **tables}
        values = {k: getattr(guide, k) for k in ("stiffness", "damping", "clearance", "mu", "v_s", "ramp")}
        part = self.add(
            name,
            GuidingSystem(
                left_curved="left_x" in given,
                right_curved="right_x" in given,
                y_curved=bent_y,
                half_gauge=body.shoe_x,
                **values,
                **tables,
            ),
        )
        for place in ("left_low", "left_high", "right_low", "right_high"):
            self.connect(getattr(part, place), f"{side}.{place}")

    def _machine(self) -> None:
        p, s = self.parameters, self.structure
        values = dataclasses.asdict
        h_c, h_cw = self.rim_heights
        pulley = self.add("pulley", DrivingPulley(J_p=p.pulley.J_p))
        ropes = Ropes(
            **{
                **values(p.ropes),
                "R_p": p.pulley.R_p,
                "L_0_c": p.ropes.L_0_c - self.start,
                "L_0_cw": p.ropes.L_0_cw + self.start,
                "H_c": h_c,
                "H_cw": h_cw,
            }
        )
        rim, tilt = self.ground, self.ground
        if s.support_vertical:
            given = values(p.support)
            if not s.support_inclination:
                given = {k: given[k] for k in ("mass", "stiffness", "damping")}
            support = self.add("support", MachineSupport(inclination=s.support_inclination, **given))
            rim = support.rim
            tilt = support.tilt_B if s.support_inclination else tilt
        machine = self.add("machine", GearedPMSM(**values(p.motor)))
        control = self.add("control", FieldOrientedControl(**values(p.control)))
        rope = self.add("ropes", ropes)
        self.connect(pulley.axis, rope.axis, machine.flange)
        self.connect(tilt, pulley.support, machine.stator)
        self.connect(rope.rim, rim)
        self.connect(rope.cabin, "cabin.hitch")
        self.connect(rope.counterweight, "counterweight.hitch")
        for signal in ("V_d", "V_q"):
            self.connect(getattr(control, signal), getattr(machine, signal))
        self.connect(machine.omega, control.omega)
        self.connect("machine.i_d_measured", control.i_d)
        self.connect("machine.i_q_measured", control.i_q)
        if s.profile:
            source = self.add("reference", reference_component(self.parameters, self.start))
            self.connect(source.velocity, control.omega_ref)
        else:
            self.input("omega_ref", control.omega_ref)
        self.input("tau_L", pulley.loss_torque, default=0.0)

    @property
    def rim_heights(self) -> tuple[float, float]:
        """Heights of the rim above the zeros of the cabin's and the counterweight's height, m."""
        p = self.parameters
        return p.ropes.L_0_c + p.cabin.hitch, p.ropes.L_0_cw + p.counterweight.hitch + p.hoistway.travel

    def _name_signals(self) -> None:
        s = self.structure
        names = {
            "z_c": "cabin.z",
            "v_c": "cabin.v_z",
            "zdd_c": "cabin.a_z",
            "fric_c": "cabin_guide.friction",
            "a_c": "accelerometer.reading",
        }
        if s.cabin_lateral or s.cabin_rotation:
            names["Nsum_c"] = "cabin_guide.normal"
        if s.drive:
            names |= {
                "omega": "pulley.speed",
                "phi": "pulley.angle",
                "i_q": "machine.i_q",
                "i_d": "machine.i_d",
                "V_q": "control.V_q",
                "V_d": "control.V_d",
                "tau_e": "machine.torque",
                "F_c": "ropes.F_c",
                "F_cw": "ropes.F_cw",
                "z_cw": "counterweight.z",
                "zdd_cw": "counterweight.a_z",
                "fric_cw": "counterweight_guide.friction",
            }
            if s.counterweight_lateral or s.counterweight_rotation:
                names["Nsum_cw"] = "counterweight_guide.normal"
            if s.support_vertical:
                names["z_m"] = "support.plate_position" if s.support_inclination else "support.position"
            if s.support_inclination:
                names |= {"phi_A": "support.tilt_A_angle", "phi_B": "support.tilt_B_angle"}
        for name, source in names.items():
            self.output(name, source)
        for body in ("cabin", "counterweight"):
            guide = self.components.get(f"{body}_guide")
            for table in guide.tables if guide is not None else ():
                self.feature(f"points of {body}_guide.{table}", f"{body}_guide.{table}", f"{body}.v_z")

    @cached_property
    def system(self) -> System:
        """The compiled lift."""
        return self.build()
