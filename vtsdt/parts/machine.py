"""The driving machine: its support on four mounts, and the permanent-magnet motor behind a gear.

González et al. 2020, Fig. 4 and Eqs. 12-14.
"""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Option, Output, Parameter, Power, Rotation, State, Translation

__all__ = ["GearedPMSM", "MachineSupport", "mount"]


def mount(x, y, z, phi_A, phi_B, v_z, w_A, w_B, k, d):
    """Return force, moments about x and y, energy and heat of a mount at (x, y) under a slightly tilted plate."""
    low = z + y * phi_A - x * phi_B
    rate = v_z + y * w_A - x * w_B
    force = -k * low - d * rate
    return force, y * force, -x * force, 0.5 * k * low * low, d * rate * rate


class MachineSupport(Component):
    """The frame that carries machine and pulley, on four spring-dampers: three, one or no degree of freedom.

    z_m up, phi_A about x, phi_B about y; the two inclinations are small and linearised.  The mounts stand at
    (+-mount_x, +-mount_y).  The rim, where both ropes pull, is at x = ``arm``: its height is
    z_m - arm phi_B.  Without inclination the plate moves up and down only; a support without any freedom is
    left out of the model.
    """

    inclination = Option(True, "True: the plate tilts about both horizontal axes")
    mass = Parameter(None, "kg", "mass of support and machine", min=1e-9)
    J_A = Parameter(None, "kg*m**2", "inertia about x", min=1e-12, when="inclination")
    J_B = Parameter(None, "kg*m**2", "inertia about y", min=1e-12, when="inclination")
    stiffness = Parameter(None, "N/m", "stiffness of one mount", min=0.0)
    damping = Parameter(0.0, "N*s/m", "damping of one mount", min=0.0)
    mount_x = Parameter(0.0, "m", "distance of the mounts from the middle along x", min=0.0, when="inclination")
    mount_y = Parameter(0.0, "m", "distance of the mounts from the middle along y", min=0.0, when="inclination")
    arm = Parameter(0.0, "m", "x at which both ropes pull", when="inclination")
    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")

    plate = Translation("vertical motion z_m", inertia="mass")
    tilt_A = Rotation("inclination phi_A about x", inertia="J_A", when="inclination")
    tilt_B = Rotation("inclination phi_B about y", inertia="J_B", when="inclination")
    rim = Translation("vertical motion of the rim")

    state_order = (
        "plate_position",
        "tilt_A_angle",
        "tilt_B_angle",
        "plate_velocity",
        "tilt_A_speed",
        "tilt_B_speed",
    )

    energy = Energy(meaning="energy of the mounts")
    weight_energy = Energy(meaning="potential energy of the support")
    loss = Power(kind="loss")

    def coupling(self):
        if self.inclination:
            self.rim.position = self.plate.position - self.arm * self.tilt_B.angle
        else:
            self.rim.position = self.plate.position

    def equations(self):
        z = self.plate.position
        v = self.plate.velocity
        if self.inclination:
            a = self.tilt_A.angle
            b = self.tilt_B.angle
            w_a = self.tilt_A.speed
            w_b = self.tilt_B.speed
            f_1, a_1, b_1, e_1, h_1 = mount(
                self.mount_x, self.mount_y, z, a, b, v, w_a, w_b, self.stiffness, self.damping
            )
            f_2, a_2, b_2, e_2, h_2 = mount(
                self.mount_x, -self.mount_y, z, a, b, v, w_a, w_b, self.stiffness, self.damping
            )
            f_3, a_3, b_3, e_3, h_3 = mount(
                -self.mount_x, self.mount_y, z, a, b, v, w_a, w_b, self.stiffness, self.damping
            )
            f_4, a_4, b_4, e_4, h_4 = mount(
                -self.mount_x, -self.mount_y, z, a, b, v, w_a, w_b, self.stiffness, self.damping
            )
            self.plate.force = f_1 + f_2 + f_3 + f_4 - self.mass * self.g
            self.tilt_A.torque = a_1 + a_2 + a_3 + a_4
            self.tilt_B.torque = b_1 + b_2 + b_3 + b_4
            self.energy = e_1 + e_2 + e_3 + e_4
            self.loss = h_1 + h_2 + h_3 + h_4
        else:
            self.plate.force = -4.0 * (self.stiffness * z + self.damping * v) - self.mass * self.g
            self.energy = 2.0 * self.stiffness * z * z
            self.loss = 4.0 * self.damping * v * v
        self.weight_energy = self.mass * self.g * z


class GearedPMSM(Component):
    """A permanent-magnet synchronous machine in d-q coordinates behind an ideal gear (Eqs. 12-14).

    Speeds and torques of the flange are the slow side's; ``pole_pairs``, ``K_T`` and the rest are the motor's
    own.  Amplitude-invariant coordinates: the electrical power is 3/2 (V_d i_d + V_q i_q), and a machine
    without iron losses has K_T = 3/2 pole_pairs psi.  Eq. 14 is stated as printed, tau = K_T i_q; what another
    K_T or L_d != L_q leaves over of the power is counted as lost in ``conversion_loss``.
    """

    R = Parameter(None, "ohm", "resistance of one phase", min=0.0)
    L_d = Parameter(None, "H", "inductance along the magnet axis", min=1e-15)
    L_q = Parameter(None, "H", "inductance across it", min=1e-15)
    psi = Parameter(None, "Wb", "flux linkage of the magnets")
    pole_pairs = Parameter(1.0, "", "pole pairs of the motor", min=1.0)
    K_T = Parameter(None, "N*m/A", "torque constant of the motor")
    gear = Parameter(1.0, "", "turns of the motor for one turn of the pulley", min=1e-9)
    V_d = Input("V", "voltage along the magnet axis")
    V_q = Input("V", "voltage across it")
    i_d = State("A", "current along the magnet axis")
    i_q = State("A", "current across it")
    omega = Output("rad/s", "speed of the pulley, as an encoder on the motor shows it")
    i_d_measured = Output("A", "current along the magnet axis, for the controller")
    i_q_measured = Output("A", "current across it, for the controller")
    torque = Output("N*m", "torque on the pulley")
    flange = Rotation("pulley")
    stator = Rotation("inclination of the support about the same axis")
    energy = Energy()
    loss = Power(kind="loss", meaning="power lost in the winding")
    conversion_loss = Power(kind="loss", meaning="electrical power that becomes neither torque nor heat of the winding")
    power = Power(kind="supply", meaning="electrical power brought in")
    stator_work = Power(kind="supply", meaning="work of the torque's reaction on the support")

    def equations(self):
        self.omega = self.flange.speed
        self.i_d_measured = self.i_d
        self.i_q_measured = self.i_q
        electrical = self.pole_pairs * self.gear * self.flange.speed
        self.der.i_d = (self.V_d - self.R * self.i_d + electrical * self.L_q * self.i_q) / self.L_d
        self.der.i_q = (self.V_q - self.R * self.i_q - electrical * (self.L_d * self.i_d + self.psi)) / self.L_q
        self.torque = self.gear * self.K_T * self.i_q
        self.flange.torque = self.torque
        self.stator.torque = -self.torque
        self.energy = 0.75 * (self.L_d * self.i_d**2 + self.L_q * self.i_q**2)
        self.loss = 1.5 * self.R * (self.i_d**2 + self.i_q**2)
        converted = 1.5 * electrical * (self.psi + (self.L_d - self.L_q) * self.i_d) * self.i_q
        self.conversion_loss = converted - self.torque * self.flange.speed
        self.power = 1.5 * (self.V_d * self.i_d + self.V_q * self.i_q)
        # Eqs. 12 and 13 take the pulley's speed against the ground, so this power has no other source
        self.stator_work = -self.torque * self.stator.speed
