"""Parts for motion in space: bodies, fixed frames, forces between frames, sensors on frames.

Every force and moment that a part exerts on a frame is in world axes; see the docs page "Motion in space".
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Frame, Input, Option, Output, Parameter, Power
from multibody.declare.rigid_body import RigidBody, World

__all__ = [
    "FixedFrame",
    "FrameForce",
    "FrameSensor",
    "FrameSpring",
    "LineForce",
    "Link",
    "RigidBody",
    "World",
]


class Link(RigidBody):
    """A rigid body with one more frame, ``tip``, to which the next body can be attached."""

    tip = Frame("far end", offset=(0.0, 0.0, 0.0))


class FixedFrame(Component):
    """A frame fixed in the world."""

    tilted = Option(False, "True: the frame has a roll, pitch and yaw")
    x = Parameter(0.0, "m", "place in the world")
    y = Parameter(0.0, "m", "place in the world")
    z = Parameter(0.0, "m", "place in the world")
    roll = Parameter(0.0, "rad", "last turn, about the frame's own x axis", when="tilted")
    pitch = Parameter(0.0, "rad", "second turn, about the y axis between", when="tilted")
    yaw = Parameter(0.0, "rad", "first turn, about the world's z axis", when="tilted")
    frame = Frame("the frame", offset=("x", "y", "z"), angles=("roll", "pitch", "yaw"))


class FrameForce(Component):
    """A force and a moment on a frame, given by signals in world axes or in the frame's own axes."""

    follows = Option(False, "True: the signals are in the frame's axes and turn with it")
    force_x = Input("N", "force on the frame along x", default=0.0)
    force_y = Input("N", "force on the frame along y", default=0.0)
    force_z = Input("N", "force on the frame along z", default=0.0)
    moment_x = Input("N*m", "moment on the frame about x", default=0.0)
    moment_y = Input("N*m", "moment on the frame about y", default=0.0)
    moment_z = Input("N*m", "moment on the frame about z", default=0.0)
    frame = Frame("where it acts")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        if self.follows:
            self.frame.fx = (
                self.frame.r11 * self.force_x + self.frame.r12 * self.force_y + self.frame.r13 * self.force_z
            )
            self.frame.fy = (
                self.frame.r21 * self.force_x + self.frame.r22 * self.force_y + self.frame.r23 * self.force_z
            )
            self.frame.fz = (
                self.frame.r31 * self.force_x + self.frame.r32 * self.force_y + self.frame.r33 * self.force_z
            )
            self.frame.mx = (
                self.frame.r11 * self.moment_x + self.frame.r12 * self.moment_y + self.frame.r13 * self.moment_z
            )
            self.frame.my = (
                self.frame.r21 * self.moment_x + self.frame.r22 * self.moment_y + self.frame.r23 * self.moment_z
            )
            self.frame.mz = (
                self.frame.r31 * self.moment_x + self.frame.r32 * self.moment_y + self.frame.r33 * self.moment_z
            )
        else:
            self.frame.fx = self.force_x
            self.frame.fy = self.force_y
            self.frame.fz = self.force_z
            self.frame.mx = self.moment_x
            self.frame.my = self.moment_y
            self.frame.mz = self.moment_z
        self.power = (
            self.frame.fx * self.frame.vx
            + self.frame.fy * self.frame.vy
            + self.frame.fz * self.frame.vz
            + self.frame.mx * self.frame.wx
            + self.frame.my * self.frame.wy
            + self.frame.mz * self.frame.wz
        )


class LineForce(Component):
    """A spring and damper along the line between two frames.

    tension = stiffness · (distance − length) + damping · (rate of the distance).  ``pushes=False`` makes it a
    rope: the tension is never negative, and slack means no force at all.
    """

    pushes = Option(True, "False: it can only pull, as a rope does")
    stiffness = Parameter(None, "N/m", "force per stretch", min=0.0)
    damping = Parameter(0.0, "N*s/m", "force per rate of the distance", min=0.0)
    length = Parameter(0.0, "m", "distance without force", min=0.0)
    a = Frame("first end")
    b = Frame("second end")
    distance = Output("m", "between the two points")
    tension = Output("N", "positive when it pulls the ends together")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        dx = self.b.px - self.a.px
        dy = self.b.py - self.a.py
        dz = self.b.pz - self.a.pz
        self.distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        ex = dx / self.distance
        ey = dy / self.distance
        ez = dz / self.distance
        rate = ex * (self.b.vx - self.a.vx) + ey * (self.b.vy - self.a.vy) + ez * (self.b.vz - self.a.vz)
        stretch = self.distance - self.length
        if self.pushes:
            self.tension = self.stiffness * stretch + self.damping * rate
            self.energy = 0.5 * self.stiffness * stretch**2
            self.loss = self.damping * rate**2
        else:
            if stretch > 0.0:
                self.tension = max(self.stiffness * stretch + self.damping * rate, 0.0)
                self.energy = 0.5 * self.stiffness * stretch**2
                self.loss = (self.tension - self.stiffness * stretch) * rate
            else:
                self.tension = 0.0
                self.energy = 0.0
                self.loss = 0.0
        self.a.fx = self.tension * ex
        self.a.fy = self.tension * ey
        self.a.fz = self.tension * ez
        self.b.fx = -self.tension * ex
        self.b.fy = -self.tension * ey
        self.b.fz = -self.tension * ez


def apart(ax, ay, az, bx, by, bz, r11, r12, r13, r21, r22, r23, r31, r32, r33):
    """Return b − a in the axes of the columns of R."""
    dx = bx - ax
    dy = by - ay
    dz = bz - az
    return (
        r11 * dx + r21 * dy + r31 * dz,
        r12 * dx + r22 * dy + r32 * dz,
        r13 * dx + r23 * dy + r33 * dz,
    )


class FrameSpring(Component):
    """A bushing: springs and dampers for the six motions of frame b against frame a.

    Displacements are those of b's point in the axes of a, angles are roll, pitch and yaw of b against a
    (R = Rz Ry Rx).  The moment follows from the energy ½ Σ k·angle², exactly at large angles too, up to a
    quarter turn of pitch and half a turn of roll and yaw, where the angles jump.
    """

    stiffness_x = Parameter(0.0, "N/m", "along x of frame a", min=0.0)
    stiffness_y = Parameter(0.0, "N/m", "along y of frame a", min=0.0)
    stiffness_z = Parameter(0.0, "N/m", "along z of frame a", min=0.0)
    stiffness_roll = Parameter(0.0, "N*m/rad", "against roll", min=0.0)
    stiffness_pitch = Parameter(0.0, "N*m/rad", "against pitch", min=0.0)
    stiffness_yaw = Parameter(0.0, "N*m/rad", "against yaw", min=0.0)
    damping_x = Parameter(0.0, "N*s/m", "along x of frame a", min=0.0)
    damping_y = Parameter(0.0, "N*s/m", "along y of frame a", min=0.0)
    damping_z = Parameter(0.0, "N*s/m", "along z of frame a", min=0.0)
    damping_roll = Parameter(0.0, "N*m*s/rad", "against the rate of roll", min=0.0)
    damping_pitch = Parameter(0.0, "N*m*s/rad", "against the rate of pitch", min=0.0)
    damping_yaw = Parameter(0.0, "N*m*s/rad", "against the rate of yaw", min=0.0)
    turns = Option(True, "False: translations only, the moments are left out")
    a = Frame("first frame, in whose axes the springs lie")
    b = Frame("second frame")
    force_x = Output("N", "force on b along x of a")
    force_y = Output("N", "force on b along y of a")
    force_z = Output("N", "force on b along z of a")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        x, y, z = apart(
            self.a.px,
            self.a.py,
            self.a.pz,
            self.b.px,
            self.b.py,
            self.b.pz,
            self.a.r11,
            self.a.r12,
            self.a.r13,
            self.a.r21,
            self.a.r22,
            self.a.r23,
            self.a.r31,
            self.a.r32,
            self.a.r33,
        )
        # velocity of b's point seen from a, which turns
        dx = self.b.px - self.a.px
        dy = self.b.py - self.a.py
        dz = self.b.pz - self.a.pz
        vx, vy, vz = apart(
            self.a.vx + self.a.wy * dz - self.a.wz * dy,
            self.a.vy + self.a.wz * dx - self.a.wx * dz,
            self.a.vz + self.a.wx * dy - self.a.wy * dx,
            self.b.vx,
            self.b.vy,
            self.b.vz,
            self.a.r11,
            self.a.r12,
            self.a.r13,
            self.a.r21,
            self.a.r22,
            self.a.r23,
            self.a.r31,
            self.a.r32,
            self.a.r33,
        )
        self.force_x = -self.stiffness_x * x - self.damping_x * vx
        self.force_y = -self.stiffness_y * y - self.damping_y * vy
        self.force_z = -self.stiffness_z * z - self.damping_z * vz
        self.b.fx = self.a.r11 * self.force_x + self.a.r12 * self.force_y + self.a.r13 * self.force_z
        self.b.fy = self.a.r21 * self.force_x + self.a.r22 * self.force_y + self.a.r23 * self.force_z
        self.b.fz = self.a.r31 * self.force_x + self.a.r32 * self.force_y + self.a.r33 * self.force_z
        self.a.fx = -self.b.fx
        self.a.fy = -self.b.fy
        self.a.fz = -self.b.fz
        if self.turns:
            # rotation of b against a, only the entries that the angles need
            r11 = self.a.r11 * self.b.r11 + self.a.r21 * self.b.r21 + self.a.r31 * self.b.r31
            r21 = self.a.r12 * self.b.r11 + self.a.r22 * self.b.r21 + self.a.r32 * self.b.r31
            r31 = self.a.r13 * self.b.r11 + self.a.r23 * self.b.r21 + self.a.r33 * self.b.r31
            r32 = self.a.r13 * self.b.r12 + self.a.r23 * self.b.r22 + self.a.r33 * self.b.r32
            r33 = self.a.r13 * self.b.r13 + self.a.r23 * self.b.r23 + self.a.r33 * self.b.r33
            level = math.sqrt(r11 * r11 + r21 * r21)
            roll = math.atan2(r32, r33)
            pitch = math.atan2(-r31, level)
            yaw = math.atan2(r21, r11)
            s = r32 / level
            c = r33 / level
            # rates of the angles from the angular velocity of b against a, in the axes of b
            p, q, r = apart(
                self.a.wx,
                self.a.wy,
                self.a.wz,
                self.b.wx,
                self.b.wy,
                self.b.wz,
                self.b.r11,
                self.b.r12,
                self.b.r13,
                self.b.r21,
                self.b.r22,
                self.b.r23,
                self.b.r31,
                self.b.r32,
                self.b.r33,
            )
            yaw_rate = (q * s + r * c) / level
            pitch_rate = q * c - r * s
            roll_rate = p - r31 * yaw_rate
            t_roll = -self.stiffness_roll * roll - self.damping_roll * roll_rate
            t_pitch = -self.stiffness_pitch * pitch - self.damping_pitch * pitch_rate
            t_yaw = -self.stiffness_yaw * yaw - self.damping_yaw * yaw_rate
            # moment that does t·rate on every motion: axes of b, then the world
            turn = (t_yaw - r31 * t_roll) / level
            m2 = t_pitch * c + turn * s
            m3 = -t_pitch * s + turn * c
            self.b.mx = self.b.r11 * t_roll + self.b.r12 * m2 + self.b.r13 * m3
            self.b.my = self.b.r21 * t_roll + self.b.r22 * m2 + self.b.r23 * m3
            self.b.mz = self.b.r31 * t_roll + self.b.r32 * m2 + self.b.r33 * m3
            # the force acts at b; a is one arm away from it
            self.a.mx = -self.b.mx - (dy * self.b.fz - dz * self.b.fy)
            self.a.my = -self.b.my - (dz * self.b.fx - dx * self.b.fz)
            self.a.mz = -self.b.mz - (dx * self.b.fy - dy * self.b.fx)
            twisting = 0.5 * (
                self.stiffness_roll * roll**2 + self.stiffness_pitch * pitch**2 + self.stiffness_yaw * yaw**2
            )
            rubbing = (
                self.damping_roll * roll_rate**2 + self.damping_pitch * pitch_rate**2 + self.damping_yaw * yaw_rate**2
            )
        else:
            self.a.mx = -(dy * self.b.fz - dz * self.b.fy)
            self.a.my = -(dz * self.b.fx - dx * self.b.fz)
            self.a.mz = -(dx * self.b.fy - dy * self.b.fx)
            twisting = 0.0
            rubbing = 0.0
        self.energy = 0.5 * (self.stiffness_x * x**2 + self.stiffness_y * y**2 + self.stiffness_z * z**2) + twisting
        self.loss = self.damping_x * vx**2 + self.damping_y * vy**2 + self.damping_z * vz**2 + rubbing


class FrameSensor(Component):
    """What can be measured at a frame: position, attitude, speeds, and the reading of an accelerometer.

    The accelerometer shows acceleration minus gravity in the frame's own axes, so that tilt shows; with
    ``remove_gravity=True`` the gravity of an upright sensor is subtracted, as in a calibrated one.
    """

    remove_gravity = Option(False, "True: an upright accelerometer at rest shows zero")
    frame = Frame("where it sits")
    x = Output("m", "position in the world")
    y = Output("m", "position in the world")
    z = Output("m", "position in the world")
    roll = Output("rad", "attitude, R = Rz(yaw) Ry(pitch) Rx(roll)")
    pitch = Output("rad", "attitude")
    yaw = Output("rad", "attitude")
    v_x = Output("m/s", "velocity, world axes")
    v_y = Output("m/s", "velocity, world axes")
    v_z = Output("m/s", "velocity, world axes")
    w_x = Output("rad/s", "angular velocity, own axes, as a gyroscope shows it")
    w_y = Output("rad/s", "angular velocity, own axes")
    w_z = Output("rad/s", "angular velocity, own axes")
    a_x = Output("m/s**2", "acceleration, world axes")
    a_y = Output("m/s**2", "acceleration, world axes")
    a_z = Output("m/s**2", "acceleration, world axes")
    felt_x = Output("m/s**2", "accelerometer along its own x")
    felt_y = Output("m/s**2", "accelerometer along its own y")
    felt_z = Output("m/s**2", "accelerometer along its own z")

    def equations(self):
        self.x = self.frame.px
        self.y = self.frame.py
        self.z = self.frame.pz
        self.roll = math.atan2(self.frame.r32, self.frame.r33)
        self.pitch = math.atan2(-self.frame.r31, math.sqrt(self.frame.r11**2 + self.frame.r21**2))
        self.yaw = math.atan2(self.frame.r21, self.frame.r11)
        self.v_x = self.frame.vx
        self.v_y = self.frame.vy
        self.v_z = self.frame.vz
        self.w_x = self.frame.r11 * self.frame.wx + self.frame.r21 * self.frame.wy + self.frame.r31 * self.frame.wz
        self.w_y = self.frame.r12 * self.frame.wx + self.frame.r22 * self.frame.wy + self.frame.r32 * self.frame.wz
        self.w_z = self.frame.r13 * self.frame.wx + self.frame.r23 * self.frame.wy + self.frame.r33 * self.frame.wz
        self.a_x = self.frame.ax
        self.a_y = self.frame.ay
        self.a_z = self.frame.az
        fx = self.frame.ax - self.frame.gx
        fy = self.frame.ay - self.frame.gy
        fz = self.frame.az - self.frame.gz
        felt_x = self.frame.r11 * fx + self.frame.r21 * fy + self.frame.r31 * fz
        felt_y = self.frame.r12 * fx + self.frame.r22 * fy + self.frame.r32 * fz
        felt_z = self.frame.r13 * fx + self.frame.r23 * fy + self.frame.r33 * fz
        if self.remove_gravity:
            self.felt_x = felt_x + self.frame.gx
            self.felt_y = felt_y + self.frame.gy
            self.felt_z = felt_z + self.frame.gz
        else:
            self.felt_x = felt_x
            self.felt_y = felt_y
            self.felt_z = felt_z
