"""Every component of the library: documented, with units, and consistent however it is evaluated."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest

import multibody.library as library
from multibody import Model
from multibody.base.units import same_dimension
from multibody.declare.component import Component
from multibody.declare.declarations import Declaration, Option, Port

COMPONENTS = {
    name: cls
    for name in library.__all__
    if inspect.isclass(cls := getattr(library, name)) and issubclass(cls, Component)
}
BASES = {"Sliding", "Turning", "Leaky", "WarmBody"}  # what subclasses share, without equations of their own


def _body(model, name, **values):
    return model.add(name, library.Mass(m=1.3, **values)).flange


def _rotor(model, name, **values):
    return model.add(name, library.Inertia(J=0.2, **values)).flange


def translation(m):
    """Two masses that vibrate against each other, a stop, play, ropes, weights, and sources of motion."""
    a, b = _body(m, "t.a", position=0.02, velocity=0.3), _body(m, "t.b", position=0.05, velocity=-0.2)
    for name, part in {
        "t.spring": library.Spring(stiffness=300.0, length=0.02),
        "t.damper": library.Damper(damping=0.7),
        "t.pair": library.SpringDamper(stiffness=40.0, damping=0.2),
        "t.play": library.Backlash(gap=0.02, stiffness=500.0, damping=2.0),
        "t.stop": library.EndStop(stiffness=800.0, damping=5.0, limit=0.03),
        "t.rope": library.RopeSegment(EA=60.0, length=0.02, damping=1.0),
    }.items():
        part = m.add(name, part)
        m.connect(part.a, a)
        m.connect(part.b, b)
    lift = m.add("t.lift", library.InclinedMass(m=2.0, incline=0.4, position=0.1)).flange
    weight = m.add("t.weight", library.Weight(m=0.3, incline=0.2))
    m.connect(weight.flange, lift)
    m.connect(m.add("t.hang", library.Spring(stiffness=250.0)).a, m.ground)
    m.connect("t.hang.b", lift)
    rope = m.add("t.wound", library.WoundRope(EA=100.0, damping=0.5))
    m.connect(rope.a, m.ground)
    m.connect(rope.b, lift)
    length = m.add("t.length", library.Ramp(unit="m", offset=0.05, height=0.05, duration=2.0))
    rate = m.add("t.rate", library.Constant(unit="m/s", value=0.025))
    m.connect(length.output, rope.length)
    m.connect(rate.output, rope.length_rate)
    move = m.add(
        "t.move", library.SCurveProfile(position_unit="m", distance=0.1, v_max=0.5, a_max=4.0, j_max=80.0, start=0.1)
    )
    driven = m.add("t.driven", library.PositionSource())
    for name in ("position", "velocity", "acceleration"):
        m.connect(f"t.move.{name}", f"t.driven.{name}")
    m.connect(driven.flange, _body(m, "t.carried"))
    m.connect(m.add("t.follow", library.Spring(stiffness=100.0)).a, driven.flange)
    m.connect("t.follow.b", _body(m, "t.follower"))
    pace = m.add("t.pace", library.VelocitySource(time_constant=0.05))
    m.connect(m.add("t.speed", library.Constant(unit="m/s", value=0.3)).output, pace.reference)
    m.connect(pace.flange, m.add("t.drag", library.Damper(damping=3.0)).a)
    m.connect("t.drag.b", "t.follower.flange")
    m.connect(move.acceleration, m.add("t.force", library.Gain(k=0.5, input_unit="m/s**2", output_unit="N")).input)
    m.connect(m.add("t.push", library.ForceSource()).force, "t.force.output")
    m.connect("t.push.flange", a)


def rotation(m):
    """Two rotors with everything that can stand between them, a pendulum, and sources of motion."""
    a, b = _rotor(m, "r.a", angle=0.1, speed=2.0), _rotor(m, "r.b", angle=-0.1, speed=-1.0)
    for name, part in {
        "r.spring": library.TorsionSpring(stiffness=5.0),
        "r.damper": library.TorsionDamper(damping=0.02),
        "r.play": library.RotaryBacklash(gap=0.1, stiffness=20.0, damping=0.3),
        "r.stop": library.RotaryEndStop(stiffness=15.0, damping=0.2, limit=-0.2, side="lower"),
    }.items():
        part = m.add(name, part)
        m.connect(part.a, a)
        m.connect(part.b, b)
    swing = m.add("r.swing", library.Pendulum(J=0.1, m=1.0, arm=0.2, angle=1.0))
    weight = m.add("r.weight", library.UnbalancedWeight(m=0.1, arm=0.2, phase=0.3))
    m.connect(weight.flange, swing.flange)
    move = m.add("r.move", library.TrapezoidalProfile(distance=2.0, v_max=4.0, a_max=20.0, start=0.05))
    driven = m.add("r.driven", library.AngleSource())
    m.connect(move.position, driven.angle)
    m.connect(move.velocity, driven.speed)
    m.connect(move.acceleration, driven.acceleration)
    m.connect(driven.flange, m.add("r.drag", library.TorsionDamper(damping=0.1)).a)
    m.connect("r.drag.b", a)
    pace = m.add("r.pace", library.SpeedSource(time_constant=0.1))
    m.connect(
        m.add(
            "r.table", library.TableReference(unit="rad/s", points=([0.0, 0.3, 0.6, 1.0], [0.0, 2.0, -1.0, 0.0]))
        ).output,
        pace.reference,
    )
    m.connect(pace.flange, m.add("r.link", library.TorsionSpring(stiffness=3.0)).a)
    m.connect("r.link.b", swing.flange)
    twist = m.add("r.twist", library.TorqueSource())
    wave = library.Sine(unit="N*m", amplitude=0.5, frequency=2.0, phase=0.3)
    m.connect(m.add("r.sine", wave).output, twist.torque)
    m.connect(twist.flange, b)


def friction(m):
    """Each law between the ground and a mass (rotor) of its own, which coasts."""
    laws = {
        "ViscousFriction": {"viscous": 0.4},
        "CoulombFriction": {"coulomb": 0.5, "v_s": 0.05},
        "DahlFriction": {"coulomb": 0.5, "x_s": 0.03},
        "LuGreFriction": {"coulomb": 0.5, "x_s": 0.03, "t_s": 0.02, "breakaway": 1.4, "v_stribeck": 0.2},
        "AsymmetricFriction": {
            "coulomb_forward": 0.5,
            "coulomb_backward": 0.3,
            "viscous_forward": 0.1,
            "viscous_backward": 0.2,
            "v_s": 0.05,
        },
        "StribeckFriction": {
            "coulomb": 0.3,
            "static": 0.5,
            "v_stribeck": 0.2,
            "viscous": 0.1,
            "v_s": 0.05,
            "exponent": 1.7,
        },
        "LoadDependentFriction": {"mu": 0.1, "coulomb": 0.05, "v_s": 0.05},
        "QuadraticDrag": {"quadratic": 0.6},
    }
    load = m.add("f.load", library.Sine(unit="N", amplitude=4.0, frequency=1.5)).output
    for k, (name, values) in enumerate(laws.items()):
        radius = {"radius": 0.3} if name == "LoadDependentFriction" else {}
        part = m.add(f"f.s{k}", getattr(library, name)(**values))
        turning = m.add(f"f.r{k}", getattr(library, f"Rotary{name}")(**values, **radius))
        m.connect(part.a, m.ground)
        m.connect(turning.a, m.ground)
        m.connect(part.b, _body(m, f"f.m{k}", velocity=0.8))
        m.connect(turning.b, _rotor(m, f"f.j{k}", speed=-1.5))
        if name == "LoadDependentFriction":
            m.connect(load, part.load, turning.load)


def transmissions(m):
    """Rotors and masses joined by ideal and lossy transmissions, driven back and forth."""
    torque = m.add("x.sine", library.Sine(unit="N*m", amplitude=2.0, frequency=1.0)).output
    for k, (part, other) in enumerate(
        (
            (library.Gear(ratio=3.0), _rotor),
            (library.Gear(ratio=-2.0, efficiency=0.8, v_s=0.5), _rotor),
            (library.Screw(lead=0.5), _body),
            (library.Screw(lead=0.5, efficiency=0.7, v_s=0.1), _body),
            (library.Rack(radius=0.1), _body),
            (library.Rack(radius=0.1, efficiency=0.9, v_s=0.1), _body),
            (library.SlippingGear(ratio=3.0, creep=0.5, v_s=0.2), _rotor),
            (library.SlippingRack(radius=0.1, creep=0.3, v_s=0.2), _body),
            (library.RigidShaft(offset=0.2), _rotor),
            (library.TorqueSensor(), _rotor),
            (library.Crank(radius=0.1, rod=0.3), _body),
        )
    ):
        drive = m.add(f"x.drive{k}", library.TorqueSource())
        m.connect(torque, drive.torque)
        part = m.add(f"x.part{k}", part)
        m.connect(drive.flange, _rotor(m, f"x.in{k}", speed=1.0), part.a)
        m.connect(part.b, other(m, f"x.out{k}"))
    for k, part in enumerate((library.RigidLink(length=0.2), library.ForceSensor())):
        part = m.add(f"x.rigid{k}", part)
        m.connect(part.a, _body(m, f"x.left{k}", velocity=0.5))
        m.connect(part.b, _body(m, f"x.right{k}"))
        m.connect(m.add(f"x.tie{k}", library.Spring(stiffness=30.0)).a, m.ground)
        m.connect(f"x.tie{k}.b", part.b)


def electrical(m):
    """Circuits with every part, and the three motors; motors and inverter lose voltage against the current."""
    source = m.add("e.source", library.VoltageSource())
    m.connect(m.add("e.step", library.Step(unit="V", height=5.0, start=0.1)).output, source.voltage)
    m.connect(source.n, m.ground)
    meter = m.add("e.meter", library.CurrentSensor())
    m.connect(source.p, m.add("e.R", library.Resistor(R=0.5)).p)
    m.connect("e.R.n", meter.p)
    m.connect(meter.n, m.add("e.L", library.Inductor(L=0.05, current=0.2)).p)
    m.connect("e.L.n", m.add("e.C", library.Capacitor(C=0.02)).p, m.add("e.volt", library.VoltageSensor()).p)
    m.connect("e.C.n", m.ground, "e.volt.n")
    constant = m.add("e.i", library.Constant(unit="A", value=0.3))
    m.connect(m.add("e.feed", library.CurrentSource()).current, constant.output)
    m.connect("e.feed.p", "e.C.p")
    m.connect("e.feed.n", m.ground)
    for k, inductive in enumerate((True, False)):
        values = {"R": 1.0, "k_t": 0.2, "inductive": inductive, "brush_drop": 0.3, "i_brush": 0.4}
        values |= {"L": 0.02} if inductive else {}
        motor = m.add(f"e.motor{k}", library.DCMotor(**values))
        m.connect(source.p, motor.p)
        m.connect(motor.n, m.ground)
        m.connect(motor.flange, _rotor(m, f"e.rotor{k}"))
        drive = m.add(f"e.drive{k}", library.DCMotorDrive(**values))
        m.connect("e.step.output", drive.voltage)
        m.connect(drive.flange, _rotor(m, f"e.shaft{k}"))
    servo = m.add(
        "e.pmsm",
        library.PMSM(R=0.5, L_d=0.01, L_q=0.015, psi=0.05, pole_pairs=3.0, i_d=0.3, dead_time_drop=0.2, i_dead=0.1),
    )
    m.connect(m.add("e.vq", library.Constant(unit="V", value=3.0)).output, servo.V_q)
    m.connect(m.add("e.vd", library.Constant(unit="V", value=-0.5)).output, servo.V_d)
    m.connect(servo.flange, _rotor(m, "e.spindle"))


def control(m):
    """A servo axis in cascade control with every sensor and signal block on it."""
    move = m.add("c.move", library.SCurveProfile(distance=1.0, v_max=3.0, a_max=30.0, j_max=600.0)).position
    servo = m.add(
        "c.servo",
        library.CascadedController(
            k_position=10.0, k_speed=1.0, k_i=2.0, k_current=4.0, k_i_current=100.0, limit=5.0, limit_voltage=24.0
        ),
    )
    motor = m.add("c.motor", library.DCMotorDrive(R=0.6, L=0.01, k_t=0.1))
    rotor = m.add("c.rotor", library.Inertia(J=0.01)).flange
    m.connect(motor.flange, rotor)
    m.connect(m.add("c.angle", library.AngleSensor()).flange, rotor)
    m.connect(m.add("c.speed", library.SpeedSensor()).flange, rotor)
    m.connect(move, servo.reference)
    read = m.add("c.read", library.SensorChannel(unit="rad", gain=1.01, offset=0.001, lagging=True))
    m.connect(read.input, "c.angle.angle")
    m.connect("c.read.output", servo.position)
    m.connect("c.speed.speed", servo.speed)
    m.connect(motor.i, servo.current)
    m.connect(servo.voltage, motor.voltage)
    cart = _body(m, "c.cart")
    for name, sensor in {"x": "PositionSensor", "v": "VelocitySensor", "w": "AccelerationSensor"}.items():
        m.connect(m.add(f"c.{name}", getattr(library, sensor)()).flange, cart)
    axis = m.add(
        "c.axis",
        library.PositionController(
            position_unit="m", output_unit="N", k_position=5.0, k_speed=8.0, k_i=3.0, limit=20.0, feedforward=True
        ),
    )
    m.connect(
        m.add("c.target", library.TrapezoidalProfile(position_unit="m", distance=0.2, v_max=0.5, a_max=3.0)).position,
        axis.reference,
    )
    m.connect("c.target.velocity", axis.reference_speed)
    m.connect("c.x.position", axis.position)
    m.connect("c.v.velocity", axis.speed)
    m.connect(axis.output, m.add("c.force", library.ForceSource()).force)
    m.connect("c.force.flange", cart)
    speed = "c.speed.speed"
    blocks = {
        "Difference": library.Difference(unit="rad/s"),
        "Proportional": library.Proportional(k_p=2.0, input_unit="rad/s"),
        "PI": library.PI(k_p=1.0, k_i=2.0, input_unit="rad/s"),
        "PI_limited": library.PI(k_p=1.0, k_i=2.0, input_unit="rad/s", limited=True, limit=0.5),
    }
    wanted = m.add("c.wanted", library.Constant(unit="rad/s", value=1.0)).output
    for name, block in blocks.items():
        block = m.add(f"c.{name}", block)
        m.connect(wanted, block.reference)
        m.connect(speed, block.measured)
    singles = {
        "Limiter": library.Limiter(lower=-1.0, upper=2.0, input_unit="rad/s"),
        "Lag": library.FirstOrderLag(time_constant=0.05, input_unit="rad/s"),
        "Integrator": library.Integrator(k=2.0, input_unit="rad/s"),
        "Derivative": library.Derivative(time_constant=0.05, input_unit="rad/s"),
        **{f"Delay{k}": library.Delay(delay=0.03, order=k, input_unit="rad/s") for k in (1, 2, 3, 4)},
        "plain": library.SensorChannel(unit="rad/s", gain=0.9),
    }
    for name, block in singles.items():
        m.connect(speed, m.add(f"c.{name}", block).input)
    for k, inputs in enumerate((2, 3)):
        total = m.add(f"c.sum{k}", library.Sum(unit="rad/s", inputs=inputs, k_2=-0.5))
        m.connect(speed, total.first, *([total.third] if inputs == 3 else []))
        m.connect("c.Lag.output", total.second)


def fluid(m):
    """A pump, tanks, pipes and a valve; a cylinder with a leaking piston between two volumes."""
    pump = m.add("h.pump", library.FlowSource(leak=1e-3))
    m.connect(m.add("h.rate", library.Sine(unit="m**3/s", amplitude=0.3, frequency=1.0)).output, pump.flow)
    values = {"density": 1.0, "gravity": 2.0, "p_s": 0.3}
    upper = m.add("h.upper", library.Tank(area=1.0, level=1.0, leak=0.02, leak_turbulent=0.1, **values))
    lower = m.add("h.lower", library.Tank(area=2.0, level=0.5, **values))
    meter = m.add("h.meter", library.FlowSensor())
    pipe = m.add("h.pipe", library.Pipe(resistance=2.0, quadratic_loss=3.0))
    long = m.add("h.long", library.Pipe(resistance=2.0, quadratic_loss=1.0, inertial=True, inertance=0.5))
    m.connect(pump.a, m.ground)
    m.connect(pump.b, upper.port, meter.a, m.add("h.gauge", library.PressureSensor()).port)
    m.connect(meter.b, pipe.a, long.a)
    m.connect(pipe.b, lower.port, long.b)
    valve = m.add("h.valve", library.Orifice(area=0.3, density=1.0, p_s=0.3, controlled=True))
    m.connect(m.add("h.lift", library.Ramp(unit="1", height=1.0, duration=1.0)).output, valve.opening)
    m.connect(valve.a, lower.port)
    m.connect(valve.b, m.ground)
    supply = m.add("h.supply", library.PressureSource())
    m.connect(m.add("h.p", library.Constant(unit="Pa", value=3.0)).output, supply.pressure)
    cylinder = m.add("h.cylinder", library.Cylinder(area_a=0.5, area_b=0.4, leak=0.01, leak_turbulent=0.02, p_s=0.3))
    for side, ends in (("a", supply.port), ("b", m.ground)):
        nozzle = m.add(f"h.nozzle_{side}", library.Orifice(area=0.2, density=1.0, p_s=0.3))
        volume = m.add(f"h.volume_{side}", library.Volume(capacity=0.05, pressure=0.5, leak=1e-3, p_s=0.3))
        m.connect(nozzle.a, ends)
        m.connect(nozzle.b, volume.port, f"h.cylinder.{side}")
    m.connect(cylinder.piston, _body(m, "h.rod", velocity=0.2))


def thermal(m):
    """A heated body between surroundings, a surface that radiates, and a bath of given temperature."""
    body = m.add("w.body", library.HeatCapacity(capacity=5.0, temperature=310.0, loss_conductance=0.2, radiation=1e-9))
    skin = m.add(
        "w.skin", library.HeatCapacity(capacity=2.0, temperature=300.0, loss_conductance=0.1, recorded_ambient=True)
    )
    heater = m.add("w.heater", library.HeatSource())
    m.connect(m.add("w.power", library.Sine(unit="W", amplitude=20.0, frequency=1.0)).output, heater.heat)
    hall = m.add("w.hall", library.FixedTemperature())
    bath = m.add("w.bath", library.TemperatureSource())
    record = m.add("w.record", library.RecordedTemperature())
    m.connect(m.add("w.level", library.Constant(unit="K", value=285.0)).output, record.recorded)
    m.connect(record.temperature, bath.temperature, skin.surroundings)
    m.connect(heater.port, body.port, m.add("w.gauge", library.TemperatureSensor()).port)
    for name, part, a, b in (
        ("outer", library.ThermalConductance(conductance=2.5), None, skin.port),  # a node without capacity before it
        ("inner", library.ThermalConductance(conductance=1.5), body.port, "w.outer.a"),
        ("glow", library.ThermalRadiation(radiation=2e-9), skin.port, hall.port),
        ("wet", library.ThermalConductance(conductance=0.7), skin.port, bath.port),
    ):
        part = m.add(f"w.{name}", part)
        m.connect(part.b, b)
        if a is not None:
            m.connect(part.a, a)


FAMILIES = (translation, rotation, friction, transmissions, electrical, fluid, thermal, control)


def model_of(family) -> Model:
    model = Model(family.__name__)
    family(model)
    return model


@pytest.fixture(scope="module", params=FAMILIES, ids=lambda f: f.__name__)
def machine(request):
    return model_of(request.param).build(energy=True)


@pytest.fixture(scope="module")
def points(machine):
    """Random states about the start, at times when the sources act."""
    rng = np.random.default_rng(7)
    n = machine.start.size
    return [(t, machine.start + 0.05 * rng.standard_normal(n)) for t in (0.0213, 0.317, 0.731)]


def test_machines_have_every_component():
    used = {type(c).__name__ for family in FAMILIES for c in model_of(family).components.values()}
    assert set(COMPONENTS) - BASES <= used


@pytest.mark.parametrize("name", sorted(COMPONENTS))
def test_component_documents_itself(name):
    cls = COMPONENTS[name]
    assert len((cls.__doc__ or "").strip()) > 15
    for item in cls.declarations.values():
        assert isinstance(item, Declaration)
        if isinstance(item, Port | Option):
            assert item.meaning
            continue
        assert item.meaning, item.name
        if hasattr(item, "unit"):
            plain = re.sub(r"\{\w+\}", "m", item.unit)
            assert same_dimension(plain or "1", plain or "1")  # raises on an unknown unit


def test_plain_python_equals_compiled(machine, points):
    plain = machine.model.build(energy=True, compiled=False)
    for t, x in points:
        # the same operations, rounded in another order (fused multiply-add, libm): a few units in the last
        # place of terms that cancel
        np.testing.assert_allclose(plain.rhs(t, x), machine.rhs(t, x), rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(plain.outputs_at(t, x), machine.outputs_at(t, x), rtol=1e-10, atol=1e-10)


def _differences(f, x, scale):
    """Central differences at two steps, extrapolated; and their disagreement as a measure of their error."""
    columns, doubt = [], []
    for k in range(x.size):
        estimates = []
        for h in (scale[k], 0.5 * scale[k]):
            up, down = x.copy(), x.copy()
            up[k] += h
            down[k] -= h
            estimates.append((f(up) - f(down)) / (2.0 * h))
        columns.append((4.0 * estimates[1] - estimates[0]) / 3.0)
        doubt.append(abs(estimates[1] - estimates[0]))
    return np.array(columns).T, np.array(doubt).T


@pytest.mark.parametrize("of", ["rhs", "outputs"])
@pytest.mark.parametrize("wrt", ["x", "p"])
def test_jacobian_agrees_with_differences(machine, points, of, wrt):
    call = machine.rhs if of == "rhs" else machine.outputs_at
    for t, x in points:
        p = machine.p
        exact = machine.jacobian(wrt, t, x, None, p, of=of)
        names = machine.state_names if wrt == "x" else machine.parameter_names
        moved = np.array([".x[" in name for name in names])  # where a table has its points is fixed
        if wrt == "x":
            numeric, doubt = _differences(lambda v, t=t, p=p: call(t, v, None, p), x, np.full(x.size, 1e-4))
        else:
            step = 1e-4 * np.maximum(abs(p), 1e-2)
            numeric, doubt = _differences(lambda v, t=t, x=x: call(t, x, None, v), p, step)
        size = np.maximum(1.0, abs(exact))
        wrong = (abs(exact - numeric) > 1e-6 * size + doubt) & ~moved
        rows = machine.state_names if of == "rhs" else machine.output_names
        assert not [(rows[i], names[j]) for i, j in np.argwhere(wrong)]
        # differences that cannot tell (a corner within the step) must stay rare
        assert np.mean(doubt > 1e-4 * size) < 0.01


def test_energy_balance(machine):
    run = machine.simulate(1.0, rtol=1e-10, atol=1e-12)
    stored, lost, supplied = run["energy.stored"], run["energy.lost"], run["energy.supplied"]
    turned_over = np.max(abs(lost)) + np.max(abs(supplied))
    defect = stored - stored[0] + lost - supplied
    assert np.max(abs(defect)) < 1e-6 * turned_over
    assert np.all(np.diff(lost) > -1e-9 * turned_over)  # nothing gives heat back
