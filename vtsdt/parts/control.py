"""Field-oriented control of the machine: a speed loop and two current loops (González et al. 2020, Eqs. 15-18)."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, State

__all__ = ["FieldOrientedControl"]


class FieldOrientedControl(Component):
    """Three PI loops y = K_p (u + x), dx/dt = u/T_i (Eq. 18): speed, current across and along the magnet axis.

    The speed loop works on the pulley's speed.  Eq. 15 multiplies by K_T where a torque demand becomes a current
    by division; ``divides=True`` takes the latter: K_pomega then has the unit of a torque per speed.
    """

    divides = Option(False, "True: i_q* = (...)/K_T instead of Eq. 15 as printed")
    K_T = Parameter(None, "N*m/A", "torque constant that the controller knows", min=1e-12)
    K_pomega = Parameter(None, "", "gain of the speed loop, A²·s/(N·m·rad) as printed, N·m·s/rad with divides=True")
    T_iomega = Parameter(None, "s", "integration time of the speed loop", min=1e-9)
    K_pq = Parameter(None, "V/A", "gain of the q current loop")
    T_iq = Parameter(None, "s", "integration time of the q current loop", min=1e-9)
    K_pd = Parameter(None, "V/A", "gain of the d current loop")
    T_id = Parameter(None, "s", "integration time of the d current loop", min=1e-9)
    omega_ref = Input("rad/s", "reference of the pulley's speed")
    omega = Input("rad/s", "speed of the pulley")
    i_d = Input("A", "current along the magnet axis")
    i_q = Input("A", "current across it")
    x_d = State("A", "auxiliary state of the d current loop")
    x_q = State("A", "auxiliary state of the q current loop")
    x_omega = State("rad/s", "auxiliary state of the speed loop")
    i_q_ref = Output("A", "current demanded across the magnet axis")
    V_d = Output("V", "voltage along the magnet axis")
    V_q = Output("V", "voltage across it")

    units_by_option = ("K_pomega",)

    def equations(self):
        error = self.omega_ref - self.omega
        self.der.x_omega = error / self.T_iomega
        if self.divides:
            self.i_q_ref = self.K_pomega * (error + self.x_omega) / self.K_T
        else:
            self.i_q_ref = self.K_T * self.K_pomega * (error + self.x_omega)
        error_q = self.i_q_ref - self.i_q
        self.der.x_q = error_q / self.T_iq
        self.V_q = self.K_pq * (error_q + self.x_q)
        self.der.x_d = -self.i_d / self.T_id
        self.V_d = self.K_pd * (self.x_d - self.i_d)
