"""Signal blocks: sums and gains, filters, delay, and controllers up to the cascade of a servo axis.

The units of a block's signals are arguments (``Gain(k=2.0, input_unit="rad/s",
output_unit="A")``), so that connections are checked although the blocks serve any signal.
"""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, State, Unit
from multibody.library.laws import saturated

__all__ = [
    "PI",
    "CascadedController",
    "Delay",
    "Derivative",
    "Difference",
    "FirstOrderLag",
    "Gain",
    "Integrator",
    "Limiter",
    "PositionController",
    "Proportional",
    "Sum",
]


class _Block(Component):
    input_unit = Unit("1", "unit of the signal that comes in")
    input = Input("{input_unit}", "signal")


class Gain(_Block):
    """output = k · input"""

    output_unit = Unit("1", "unit of the signal that goes out")
    k = Parameter(1.0, "{output_unit}/{input_unit}", "factor")
    output = Output("{output_unit}", "k · input")

    def equations(self):
        self.output = self.k * self.input


class Sum(Component):
    """output = first + second (+ third), each with a factor of its own."""

    unit = Unit("1", "unit of all signals")
    inputs = Option(2, "how many signals are added", choices=(2, 3))
    first = Input("{unit}", "first signal")
    second = Input("{unit}", "second signal")
    third = Input("{unit}", "third signal", when="inputs >= 3")
    k_1 = Parameter(1.0, "", "factor of the first")
    k_2 = Parameter(1.0, "", "factor of the second")
    k_3 = Parameter(1.0, "", "factor of the third", when="inputs >= 3")
    output = Output("{unit}", "sum")

    def equations(self):
        if self.inputs == 3:
            self.output = self.k_1 * self.first + self.k_2 * self.second + self.k_3 * self.third
        else:
            self.output = self.k_1 * self.first + self.k_2 * self.second


class Difference(Component):
    """output = reference − measured"""

    unit = Unit("1", "unit of all signals")
    reference = Input("{unit}", "what should be")
    measured = Input("{unit}", "what is")
    output = Output("{unit}", "reference − measured")

    def equations(self):
        self.output = self.reference - self.measured


class Limiter(_Block):
    """The input, held between ``lower`` and ``upper``."""

    lower = Parameter(None, "{input_unit}", "least value")
    upper = Parameter(None, "{input_unit}", "largest value")
    output = Output("{input_unit}", "limited signal")

    def equations(self):
        self.output = max(self.lower, min(self.upper, self.input))


class FirstOrderLag(_Block):
    """A first-order low-pass: time_constant · rate of output = input − output."""

    time_constant = Parameter(None, "s", "time to 63 % of a step", min=1e-12)
    output_state = State("{input_unit}", "filtered signal")
    output = Output("{input_unit}", "filtered signal")

    def equations(self):
        self.der.output_state = (self.input - self.output_state) / self.time_constant
        self.output = self.output_state


class Integrator(_Block):
    """rate of output = k · input"""

    k = Parameter(1.0, "", "factor")
    total = State("{input_unit}*s", "integral of the input")
    output = Output("{input_unit}*s", "integral of the input")

    def equations(self):
        self.der.total = self.k * self.input
        self.output = self.total


class Derivative(_Block):
    """The rate of a signal, filtered: output = (input − lagged) / time_constant.

    The rate itself would amplify noise without bound and needs a differentiable input; this is s/(1 +
    time_constant·s).
    """

    time_constant = Parameter(None, "s", "lag of the filter", min=1e-12)
    lagged = State("{input_unit}", "filtered signal")
    output = Output("{input_unit}/s", "filtered rate")

    def equations(self):
        self.output = (self.input - self.lagged) / self.time_constant
        self.der.lagged = self.output


class Delay(_Block):
    """A delay as Padé approximation [order/order] of exp(−delay·s).

    Amplitudes pass unchanged; the phase is within 1° up to ω·delay = 0.6, 1.7, 3.0 and 4.5 for orders 1 to 4.
    Give ``z_1`` the input's start value where that is not zero. (Coefficients: G. H. Golub, C. F. Van Loan,
    Matrix Computations, 4th ed., section 9.3.)
    """

    order = Option(2, "order of the approximation", choices=(1, 2, 3, 4))
    delay = Parameter(None, "s", "by how much the output is late", min=1e-9)
    z_1 = State("{input_unit}", "inner state; equals the input at rest")
    z_2 = State("{input_unit}", "inner state, its rate times the delay", when="order >= 2")
    z_3 = State("{input_unit}", "inner state, second rate times the delay squared", when="order >= 3")
    z_4 = State("{input_unit}", "inner state, third rate times the delay cubed", when="order >= 4")
    output = Output("{input_unit}", "late signal")

    def equations(self):
        if self.order == 1:
            self.der.z_1 = 2.0 * (self.input - self.z_1) / self.delay
            self.output = 2.0 * self.z_1 - self.input
        elif self.order == 2:
            self.der.z_1 = self.z_2 / self.delay
            self.der.z_2 = 12.0 * (self.input - self.z_1 - self.z_2 / 2.0) / self.delay
            self.output = self.input - self.z_2
        elif self.order == 3:
            self.der.z_1 = self.z_2 / self.delay
            self.der.z_2 = self.z_3 / self.delay
            self.der.z_3 = 120.0 * (self.input - self.z_1 - self.z_2 / 2.0 - self.z_3 / 10.0) / self.delay
            self.output = 2.0 * (self.z_1 + self.z_3 / 10.0) - self.input
        else:
            self.der.z_1 = self.z_2 / self.delay
            self.der.z_2 = self.z_3 / self.delay
            self.der.z_3 = self.z_4 / self.delay
            inner = self.z_1 + self.z_2 / 2.0 + self.z_3 * 3.0 / 28.0 + self.z_4 / 84.0
            self.der.z_4 = 1680.0 * (self.input - inner) / self.delay
            self.output = self.input - self.z_2 - self.z_4 / 42.0


class _Loop(Component):
    input_unit = Unit("1", "unit of what is controlled")
    output_unit = Unit("1", "unit of what the controller gives")
    reference = Input("{input_unit}", "what should be")
    measured = Input("{input_unit}", "what is")
    output = Output("{output_unit}", "what the controller gives")


class Proportional(_Loop):
    """output = k_p · (reference − measured)"""

    k_p = Parameter(None, "{output_unit}/{input_unit}", "gain")

    def equations(self):
        self.output = self.k_p * (self.reference - self.measured)


class PI(_Loop):
    """output = k_p · error + k_i · ∫ error dt, with error = reference − measured.

    With ``limited=True`` the output stays within ±limit, and the integral is drawn back within
    ``tracking_time`` while the limit holds (back-calculation; K. J. Åström, T. Hägglund: Advanced PID
    Control, ISA 2006, section 3.5).
    """

    limited = Option(False, "whether the output is limited, with anti-windup")
    k_p = Parameter(None, "{output_unit}/{input_unit}", "proportional gain")
    k_i = Parameter(None, "{output_unit}/({input_unit}*s)", "integral gain")
    limit = Parameter(None, "{output_unit}", "largest output", min=0.0, when="limited")
    tracking_time = Parameter(0.05, "s", "time to draw the integral back", min=1e-9, when="limited")
    integral = State("{output_unit}", "integral part of the output")

    def equations(self):
        error = self.reference - self.measured
        raw = self.k_p * error + self.integral
        if self.limited:
            self.output = saturated(raw, self.limit)
            self.der.integral = self.k_i * error + (self.output - raw) / self.tracking_time
        else:
            self.output = raw
            self.der.integral = self.k_i * error


class PositionController(Component):
    """Position and speed loop of a servo axis: a proportional position loop around a PI speed loop.

    speed_reference = k_position · (reference − position) (+ feedforward);
    output = k_speed · (speed_reference − speed) + integral, within ±limit.
    """

    position_unit = Unit("rad", "unit of the position: rad or m")
    output_unit = Unit("A", "unit of what the controller gives")
    feedforward = Option(False, "whether the speed of the reference is a signal of its own")
    k_position = Parameter(None, "1/s", "gain of the position loop", min=0.0)
    k_speed = Parameter(None, "{output_unit}*s/{position_unit}", "gain of the speed loop")
    k_i = Parameter(0.0, "{output_unit}/{position_unit}", "integral gain of the speed loop")
    limit = Parameter(1e6, "{output_unit}", "largest output", min=0.0)
    tracking_time = Parameter(0.05, "s", "time in which the integral follows a limit", min=1e-9)
    reference = Input("{position_unit}", "where it should be")
    reference_speed = Input("{position_unit}/s", "how fast it should be", when="feedforward")
    position = Input("{position_unit}", "where it is")
    speed = Input("{position_unit}/s", "how fast it is")
    integral = State("{output_unit}", "integral part of the output")
    speed_reference = Output("{position_unit}/s", "reference of the speed loop")
    output = Output("{output_unit}", "what the controller gives")

    def equations(self):
        if self.feedforward:
            self.speed_reference = self.k_position * (self.reference - self.position) + self.reference_speed
        else:
            self.speed_reference = self.k_position * (self.reference - self.position)
        error = self.speed_reference - self.speed
        raw = self.k_speed * error + self.integral
        self.output = saturated(raw, self.limit)
        self.der.integral = self.k_i * error + (self.output - raw) / self.tracking_time


class CascadedController(PositionController):
    """Position, speed and current loop of a servo drive: `PositionController` over a PI current loop.

    ``output`` is the reference of the current, ``voltage`` the voltage on the motor, within ±limit_voltage.
    """

    k_current = Parameter(None, "V/A", "gain of the current loop")
    k_i_current = Parameter(0.0, "V/(A*s)", "integral gain of the current loop")
    limit_voltage = Parameter(1e6, "V", "largest voltage", min=0.0)
    current = Input("A", "current of the motor")
    integral_current = State("V", "integral part of the voltage")
    voltage = Output("V", "voltage for the motor")
    output_unit = None  # type: ignore[assignment]
    k_speed = Parameter(None, "A*s/{position_unit}", "gain of the speed loop")
    k_i = Parameter(0.0, "A/{position_unit}", "integral gain of the speed loop")
    limit = Parameter(1e6, "A", "largest current", min=0.0)
    integral = State("A", "integral part of the current")
    output = Output("A", "reference of the current")

    def equations(self):
        super().equations()
        error_current = self.output - self.current
        wanted = self.k_current * error_current + self.integral_current
        self.voltage = saturated(wanted, self.limit_voltage)
        tracking = (self.voltage - wanted) / self.tracking_time
        self.der.integral_current = self.k_i_current * error_current + tracking
