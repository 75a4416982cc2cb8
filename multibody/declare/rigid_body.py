"""The rigid body as a component: its parameters, which of its six motions are free, its frames and axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from multibody.declare.component import Component
from multibody.declare.declarations import Frame, Option, Parameter, Rotation, State, Translation

__all__ = ["ANGLES", "COORDINATES", "LENGTHS", "RigidBody", "World"]

LENGTHS = ("x", "y", "z")
ANGLES = ("roll", "pitch", "yaw")
COORDINATES = (*LENGTHS, *ANGLES)

_COORDINATE_STARTS = {
    f"{name}_start": State("m" if name in LENGTHS else "rad", f"{name} at the start, or where it is locked")
    for name in COORDINATES
}
_SPEED_STARTS = {
    f"{speed}_start": State(unit, f"{speed} at the start")
    for unit, speeds in (
        ("m/s", [f"v_{axis}" for axis in LENGTHS]),
        ("rad/s", [f"w_{axis}" for axis in LENGTHS]),
        ("rad/s", [f"{angle}_rate" for angle in ANGLES]),
    )
    for speed in speeds
}


class World(Component):
    """The gravity of a model, which has at most one World.

    Without it gravity is (0, 0, -9.80665) m/s².
    """

    gravity_x = Parameter(0.0, "m/s**2", "acceleration of free fall along x")
    gravity_y = Parameter(0.0, "m/s**2", "acceleration of free fall along y")
    gravity_z = Parameter(-9.80665, "m/s**2", "acceleration of free fall along z (up)")


class RigidBody(Component):
    """A rigid body with six Boolean degrees of freedom relative to a parent frame (the ground by default).

    Eqs. 1 and 2 of González et al. 2020, with exact rotations R = Rz(yaw) Ry(pitch) Rx(roll).  A motion set
    to False is locked and leaves the state vector; it stays at ``<name>_start``.  One free rotation on a
    frame of another body is a revolute joint, one free translation a prismatic one.

    States: ``x``, ``y``, ``z``, ``roll``, ``pitch``, ``yaw`` of the free motions, then their speeds: ``v_x``,
    ``v_y``, ``v_z`` along the axes of the parent frame; with all three rotations free ``w_x``, ``w_y``,
    ``w_z``, the angular velocity relative to the parent frame in body axes, else the rates ``roll_rate``,
    ``pitch_rate``, ``yaw_rate`` of the free angles.  Start values are given as ``z_start``, ``v_z_start``,
    ``roll_start``, …

    Subclasses add frames: ``hitch = Frame("rope hitch", offset=(0.0, 0.0, 0.62))``.

    Examples
    --------
    >>> from multibody import Model
    >>> model = Model("lift car")
    >>> cabin = model.add("cabin", RigidBody(mass=32.0, x=False, y=False, roll=False, pitch=False, yaw=False))
    >>> model.build().state_names
    ('cabin.z', 'cabin.v_z')
    """

    mass = Parameter(None, "kg", "mass", min=0.0)
    com_x = Parameter(0.0, "m", "centre of mass from the origin, body axis x")
    com_y = Parameter(0.0, "m", "centre of mass from the origin, body axis y")
    com_z = Parameter(0.0, "m", "centre of mass from the origin, body axis z")
    I_xx = Parameter(0.0, "kg*m**2", "inertia tensor about the centre of mass, body axes", min=0.0)
    I_yy = Parameter(0.0, "kg*m**2", "inertia tensor about the centre of mass, body axes", min=0.0)
    I_zz = Parameter(0.0, "kg*m**2", "inertia tensor about the centre of mass, body axes", min=0.0)
    I_xy = Parameter(0.0, "kg*m**2", "entry of the inertia tensor, -integral of x y dm")
    I_xz = Parameter(0.0, "kg*m**2", "entry of the inertia tensor, -integral of x z dm")
    I_yz = Parameter(0.0, "kg*m**2", "entry of the inertia tensor, -integral of y z dm")

    x = Option(True, "True: free to move along x of the parent frame")
    y = Option(True, "True: free to move along y of the parent frame")
    z = Option(True, "True: free to move along z of the parent frame")
    roll = Option(True, "True: free to turn about its own x axis")
    pitch = Option(True, "True: free to turn about the y axis between")
    yaw = Option(True, "True: free to turn about z of the parent frame")
    reactions = Option(False, "True: show force and moment from the parent frame as joint_force_x, …")

    parent = Frame("frame that the body is attached to; the ground when not connected", parent=True)
    origin = Frame("the body's own frame", offset=(None, None, None))
    com = Frame("centre of mass", offset=("com_x", "com_y", "com_z"))

    x_axis = Translation("motion along x of the parent frame", coordinate="x", when="x")
    y_axis = Translation("motion along y of the parent frame", coordinate="y", when="y")
    z_axis = Translation("motion along z of the parent frame", coordinate="z", when="z")
    roll_axis = Rotation("turn about its own x axis", coordinate="roll", when="roll")
    pitch_axis = Rotation("turn about the y axis between", coordinate="pitch", when="pitch")
    yaw_axis = Rotation("turn about z of the parent frame", coordinate="yaw", when="yaw")

    def __init__(self, **given: Any):
        super().__init__(**given)
        if not self.faults:
            self.faults += self._inertia_faults()

    def _decide_declarations(self) -> None:
        super()._decide_declarations()
        if self.body_rates:  # the speeds are no rates of angles, so a torque on an angle has nothing to act on
            self.declarations = {
                n: d for n, d in self.declarations.items() if not (isinstance(d, Rotation) and d.coordinate)
            }

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free motions, in the order x, y, z, roll, pitch, yaw."""
        return tuple(name for name in COORDINATES if self.options.get(name, True))

    @property
    def body_rates(self) -> bool:
        """True when the speeds of rotation are the angular velocity in body axes (three rotations free)."""
        return all(self.options.get(name, True) for name in ANGLES)

    def speed_name(self, coordinate: str) -> str:
        """Return the name of the speed that belongs to a coordinate, such as ``"v_z"``."""
        if coordinate in LENGTHS:
            return f"v_{coordinate}"
        return f"w_{LENGTHS[ANGLES.index(coordinate)]}" if self.body_rates else f"{coordinate}_rate"

    def start_declarations(self) -> dict[str, State]:
        """Return start values of the coordinates (all six) and of the free speeds."""
        speeds = {f"{s}_start": _SPEED_STARTS[f"{s}_start"] for s in map(self.speed_name, self.free)}
        return {**super().start_declarations(), **_COORDINATE_STARTS, **speeds}

    @classmethod
    def possible_starts(cls) -> dict[str, State]:
        """Return start values of the coordinates and of every speed that some choice of free motions has."""
        return {**super().possible_starts(), **_COORDINATE_STARTS, **_SPEED_STARTS}

    def coordinate_states(self, coordinate: str) -> tuple[tuple[str, float], tuple[str, float]]:
        """Return names and start values of a coordinate and its speed."""
        speed = self.speed_name(coordinate)
        return (coordinate, self.starts[f"{coordinate}_start"]), (speed, self.starts[f"{speed}_start"])

    def _inertia_faults(self) -> list[str]:
        v = self.values
        entries = [[v[f"I_{''.join(sorted(a + b))}"] for b in LENGTHS] for a in LENGTHS]
        fault = inertia_fault(np.array(entries))
        faults = [fault] if fault else []
        if self.free and v["mass"] <= 0.0:
            faults.append(f"parameter 'mass' is {v['mass']:g} kg, but {', '.join(self.free)} can move: give it a mass")
        if self.body_rates and abs(abs(self.starts["pitch_start"]) - math.pi / 2) < 1e-3:
            faults.append("'pitch_start' is a quarter turn, where roll and yaw are the same: turn its parent frame")
        return faults


def inertia_fault(tensor: np.ndarray) -> str | None:
    """Return what is wrong with an inertia tensor about the centre of mass, or None.

    A tensor of zeros is a point mass and is accepted.
    """
    principal = np.linalg.eigvalsh(tensor)
    slack = 1e-9 * max(float(np.abs(principal).max()), 0.0)
    moments = ", ".join(f"{value:.4g}" for value in principal)
    if principal[0] < -slack:
        return (
            f"the inertia tensor is not positive definite (principal moments {moments} kg m²); "
            "check the signs of I_xy, I_xz, I_yz"
        )
    if principal[2] > principal[0] + principal[1] + slack:
        return (
            f"the inertia tensor breaks the triangle inequality (principal moments {moments} kg m²: "
            "the largest exceeds the sum of the others); check units, and that it is about the centre of mass"
        )
    return None
