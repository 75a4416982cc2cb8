"""Suspension ropes whose stiffness and mass vary with length, and the driving pulley.

González et al. 2020, Eqs. 5-11.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Frame, Input, Output, Parameter, Power, Rotation, Translation

__all__ = ["DrivingPulley", "Ropes", "rope"]


def rope(x, y, z, v_x, v_y, v_z, top, v_top, length, length_rate, stretch_stiffness, damping):
    """Return the force (x, y, z) of a rope on the body that hangs on it, tension, energy and heat.

    The rope runs straight from (x, y, z) to (0, 0, top).  Its tension is EA/L times the stretch plus d/L times
    the rate of it, never negative.
    """
    dx = -x
    dy = -y
    dz = top - z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    e_x = dx / distance
    e_y = dy / distance
    e_z = dz / distance
    stretch = distance - length
    rate = e_z * (v_top - v_z) - e_x * v_x - e_y * v_y - length_rate
    if stretch > 0.0:
        elastic = stretch_stiffness / length * stretch
        tension = max(elastic + damping / length * rate, 0.0)
        energy = 0.5 * elastic * stretch
        heat = (tension - elastic) * rate
    else:
        tension = 0.0
        energy = 0.0
        heat = 0.0
    return tension * e_x, tension * e_y, tension * e_z, tension, energy, heat


class Ropes(Component):
    """The suspension ropes from the cabin over the driving pulley to the counterweight.

    Two springs, one for each side, whose free lengths change as the pulley turns (Eqs. 5-10); a positive angle
    pays out rope on the cabin's side.  Each rope's upper end stands above the origin of its body's axis, at the
    height of the rim.  The pulley carries the tension and the weight of the rope that hangs on each side; the
    ropes' own inertia turns with the pulley.
    """

    EA = Parameter(None, "N", "longitudinal stiffness of one rope", min=0.0)
    n = Parameter(1.0, "", "number of ropes side by side", min=1.0)
    damping = Parameter(0.0, "N*s", "damping d of all ropes; the damper of a length L has d/L", min=0.0)
    lambda_m = Parameter(0.0, "kg/m", "longitudinal density of all ropes", min=0.0)
    R_p = Parameter(None, "m", "radius of the pulley", min=1e-6)
    L_0_c = Parameter(None, "m", "free length on the cabin's side at angle 0", min=1e-6)
    L_0_cw = Parameter(None, "m", "free length on the counterweight's side at angle 0", min=1e-6)
    H_c = Parameter(None, "m", "height of the rim above the zero of the cabin's height")
    H_cw = Parameter(None, "m", "height of the rim above the zero of the counterweight's height")

    cabin = Frame("hitch of the cabin")
    counterweight = Frame("hitch of the counterweight")
    axis = Rotation("pulley", inertia="rope_inertia")
    rim = Translation("vertical motion of the rim with the machine's support")

    rope_inertia = Output("kg*m**2", "inertia of the rope on the pulley, lambda_m (L_0_c + L_0_cw) R_p**2")
    L_c = Output("m", "free length on the cabin's side (Eq. 5)")
    L_cw = Output("m", "free length on the counterweight's side (Eq. 6)")
    K_c = Output("N/m", "stiffness on the cabin's side (Eq. 7)")
    K_cw = Output("N/m", "stiffness on the counterweight's side (Eq. 8)")
    m_c = Output("kg", "rope mass on the cabin's side (Eq. 9)")
    m_cw = Output("kg", "rope mass on the counterweight's side (Eq. 10)")
    F_c = Output("N", "tension at the cabin")
    F_cw = Output("N", "tension at the counterweight")
    F_c_pulley = Output("N", "pull of the cabin's side at the pulley")
    F_cw_pulley = Output("N", "pull of the counterweight's side at the pulley")
    energy = Energy(meaning="energy of the stretched ropes")
    weight_energy = Energy(meaning="potential energy of the ropes' mass, below the rim")
    loss = Power(kind="loss")
    carried = Power(kind="supply", meaning="energy of stretched rope that comes over the pulley")

    def equations(self):
        self.rope_inertia = self.lambda_m * (self.L_0_c + self.L_0_cw) * self.R_p**2
        paid_out = self.R_p * self.axis.angle
        rate = self.R_p * self.axis.speed
        self.L_c = self.L_0_c + paid_out
        self.L_cw = self.L_0_cw - paid_out
        stiffness = self.EA * self.n
        self.K_c = stiffness / self.L_c
        self.K_cw = stiffness / self.L_cw
        self.m_c = self.lambda_m * self.L_c
        self.m_cw = self.lambda_m * self.L_cw
        self.cabin.fx, self.cabin.fy, self.cabin.fz, self.F_c, e_c, heat_c = rope(
            self.cabin.px,
            self.cabin.py,
            self.cabin.pz,
            self.cabin.vx,
            self.cabin.vy,
            self.cabin.vz,
            self.H_c + self.rim.position,
            self.rim.velocity,
            self.L_c,
            rate,
            stiffness,
            self.damping,
        )
        self.counterweight.fx, self.counterweight.fy, self.counterweight.fz, self.F_cw, e_cw, heat_cw = rope(
            self.counterweight.px,
            self.counterweight.py,
            self.counterweight.pz,
            self.counterweight.vx,
            self.counterweight.vy,
            self.counterweight.vz,
            self.H_cw + self.rim.position,
            self.rim.velocity,
            self.L_cw,
            -rate,
            stiffness,
            self.damping,
        )
        fall = -self.cabin.gz
        self.F_c_pulley = self.F_c + self.m_c * fall
        self.F_cw_pulley = self.F_cw + self.m_cw * fall
        self.axis.torque = self.R_p * (self.F_c_pulley - self.F_cw_pulley)
        # of a slightly inclined rope only the vertical component acts on the support
        self.rim.force = -(self.cabin.fz + self.counterweight.fz + (self.m_c + self.m_cw) * fall)
        self.energy = e_c + e_cw
        self.weight_energy = fall * (
            self.m_c * (self.rim.position - 0.5 * self.L_c) + self.m_cw * (self.rim.position - 0.5 * self.L_cw)
        )
        self.loss = heat_c + heat_cw
        self.carried = (e_cw / self.L_cw - e_c / self.L_c) * rate


class DrivingPulley(Component):
    """The pulley with all that turns with it; friction losses of the gear come as a torque (Eq. 11).

    J_p times the angular acceleration = R_p (F_c - F_cw) + tau_e + tau_L; the tensions come from `Ropes`, tau_e
    from the machine.  tau_L is positive in the direction of positive angle, as in Eq. 11: a loss has the sign
    opposite to the speed.  Its reaction acts on the machine's support.
    """

    J_p = Parameter(None, "kg*m**2", "inertia of pulley, gear and rotor about the pulley's axis", min=1e-9)
    loss_torque = Input("N*m", "loss torque tau_L on the pulley", default=0.0)
    axis = Rotation("pulley", inertia="J_p")
    support = Rotation("inclination of the support about the same axis")
    loss = Power(kind="loss", meaning="power lost in the gear")

    def equations(self):
        self.axis.torque = self.loss_torque
        self.support.torque = -self.loss_torque
        self.loss = -self.loss_torque * (self.axis.speed - self.support.speed)
