"""A rotary pendulum that a controller balances: an arm on a motor, a pendulum hinged at its end, viscous friction only.

The controller is known exactly, so that the machine runs from its references and the added voltage alone.
"""

from multibody import Component, Input, Model, Output, Parameter, State
from multibody.library import AngleSensor, FirstOrderLag, Gain, RotaryViscousFriction, TorqueSource
from multibody.library.spatial import Link

MASS, LENGTH, REACH = 0.024, 0.129, 0.085  # kg, m, m: the pendulum, and the arm up to its hinge (manufacturer)


class Balance(Component):
    """The controller: proportional and filtered derivative parts of both angles, an added voltage, a limit.

    voltage = −6 e_1 − 1.8 ė_1 − 30 e_2 − 2.5 ė_2 + added, with e the reference less the angle.
    """

    k_arm = Parameter(-6.0, "V/rad", "voltage for an error of the arm")
    k_arm_rate = Parameter(-1.8, "V*s/rad", "voltage for the rate of that")
    k_pendulum = Parameter(-30.0, "V/rad", "voltage for an error of the pendulum")
    k_pendulum_rate = Parameter(-2.5, "V*s/rad", "voltage for the rate of that")
    filter = Parameter(0.02, "s", "lag of the filters of the rates", min=1e-6)
    limit = Parameter(10.0, "V", "largest voltage", min=0.0)
    arm_reference = Input("rad", "where the arm should be")
    pendulum_reference = Input("rad", "where the pendulum should be")
    added = Input("V", "voltage added to what the controller asks for")
    arm = Input("rad", "where the arm is")
    pendulum = Input("rad", "where the pendulum is")
    arm_lagged = State("rad", "filtered error of the arm")
    pendulum_lagged = State("rad", "filtered error of the pendulum")
    voltage = Output("V", "what is sent to the amplifier")

    def equations(self):
        e_arm = self.arm_reference - self.arm
        e_pendulum = self.pendulum_reference - self.pendulum
        self.der.arm_lagged = (e_arm - self.arm_lagged) / self.filter
        self.der.pendulum_lagged = (e_pendulum - self.pendulum_lagged) / self.filter
        of_arm = self.k_arm * e_arm + self.k_arm_rate * (e_arm - self.arm_lagged) / self.filter
        of_pendulum = (
            self.k_pendulum * e_pendulum + self.k_pendulum_rate * (e_pendulum - self.pendulum_lagged) / self.filter
        )
        self.voltage = max(-self.limit, min(self.limit, of_arm + of_pendulum + self.added))


def build(torque_per_volt: float = 0.01) -> Model:
    """Return the machine; ``torque_per_volt`` is the motor's at standstill, in N*m/V."""
    qube = Model("quanser_qube")
    turning = {each: False for each in ("x", "y", "z")}
    # The motor's back-EMF acts as viscous friction, and is part of the bearing's.
    arm = qube.add(
        "arm", Link(mass=0.095, I_xx=5e-4, I_yy=5e-4, I_zz=2.5e-4, tip_x=-REACH, roll=False, pitch=False, **turning)
    )
    about_centre = MASS * LENGTH**2 / 12.0
    pendulum = qube.add(
        "pendulum",
        Link(mass=MASS, com_z=LENGTH / 2.0, I_xx=about_centre, I_yy=about_centre, pitch=False, yaw=False, **turning),
    )
    bearing = qube.add("bearing", RotaryViscousFriction(viscous=5e-4))
    hinge = qube.add("hinge", RotaryViscousFriction(viscous=5e-5))
    balance = qube.add("balance", Balance())
    hold = qube.add("hold", FirstOrderLag(time_constant=1.5e-3, input_unit="V"))
    motor = qube.add("motor", Gain(k=torque_per_volt, input_unit="V", output_unit="N*m"))
    drive = qube.add("drive", TorqueSource())
    of_arm, of_pendulum = qube.add("arm_encoder", AngleSensor()), qube.add("pendulum_encoder", AngleSensor())
    qube.connect(pendulum.parent, arm.tip)
    qube.connect(arm.yaw_axis, drive.flange, bearing.b, of_arm.flange)
    qube.connect(pendulum.roll_axis, hinge.b, of_pendulum.flange)
    qube.connect(bearing.a, qube.ground)
    qube.connect(hinge.a, qube.ground)  # a flange on a joint's axis acts between its two bodies
    qube.connect(of_arm.angle, balance.arm)
    qube.connect(of_pendulum.angle, balance.pendulum)
    qube.connect(balance.voltage, hold.input)
    qube.connect(hold.output, motor.input)
    qube.connect(motor.output, drive.torque)
    qube.input("reference.arm", balance.arm_reference)
    qube.input("reference.pendulum", balance.pendulum_reference)
    qube.input("added.voltage", balance.added)
    return qube
