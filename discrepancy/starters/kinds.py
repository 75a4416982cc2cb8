"""The kinds of machines that a study can be started from: parts, what may drive them, what may be measured.

A kind is the text of a model of the library.  How it is driven depends on what was recorded: the same screw moves by a
torque, by a current, by a voltage or by a speed that is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["KINDS", "Drive", "MachineKind", "Place", "Unknown"]


@dataclass(frozen=True)
class Place:
    """An input or output of a model for which a column is looked for.

    Parameters
    ----------
    name : str
        Of the model's input or output.
    unit : str
        SI.
    words : tuple of str
        Words in a column's name that speak for it.
    """

    name: str
    unit: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unknown:
    """A parameter that nobody knows from a recording alone, and that a fit is to find.

    Parameters
    ----------
    name : str
    shown_by : tuple of str
        Outputs without any of which no record can show it; empty: all show it.
    together : bool
        Whether all of ``shown_by`` are needed.
    """

    name: str
    shown_by: tuple[str, ...] = ()
    together: bool = False


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A way in which a machine is driven.

    Parameters
    ----------
    what : str
        In words, for the study's head.
    inputs : tuple of Place
    outputs : tuple of Place
        What this way of driving lets one measure besides.
    unknown : tuple of Unknown
    imports : tuple of str
        From `multibody.library`.
    lines : tuple of str
        Of the function ``build``; they define ``motor``, whose flange drives the machine.
    last : tuple of str
        Lines that come after those of the parts.
    fixed : str
        What the model states that a record of this way of driving cannot show, to be put right by hand.
    commanded : bool
        Whether the column must be a reference and not a measurement, where there is another way.
    """

    what: str
    inputs: tuple[Place, ...] = ()
    outputs: tuple[Place, ...] = ()
    unknown: tuple[Unknown, ...] = ()
    imports: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    last: tuple[str, ...] = ()
    fixed: str = ""
    commanded: bool = False


@dataclass(frozen=True, kw_only=True)
class MachineKind:
    """A kind of machine.

    Parameters
    ----------
    name : str
        As ``--machine`` takes it.
    what : str
        One sentence.
    drives : tuple of Drive
        In the order in which they are taken.
    outputs : tuple of Place
    unknown : tuple of Unknown
    imports : tuple of str
    lines : tuple of str
        Of the function ``build``, after those of the drive.
    classes : str
        Components of the model's own.
    fixed : str
        What the model states that no such recording can show, to be put right by hand.
    own_imports : tuple of str
        What ``classes`` takes from `multibody`.
    """

    name: str
    what: str
    drives: tuple[Drive, ...]
    outputs: tuple[Place, ...]
    unknown: tuple[Unknown, ...]
    imports: tuple[str, ...]
    lines: tuple[str, ...]
    classes: str = ""
    fixed: str = ""
    own_imports: tuple[str, ...] = ()

    def model_text(self, drive: Drive, values: Mapping[str, float] | None = None) -> str:
        """Return the text of ``model.py`` for a way of driving, with other values of some parameters."""
        from_multibody = ", ".join(sorted({"Model", *self.own_imports}))
        library = sorted({*self.imports, *drive.imports})
        listed = ", ".join(library)
        if len(listed) > 80:
            listed = "(\n    " + ",\n    ".join(library) + ",\n)"
        head = f"{self.what}, driven by {drive.what}" if drive.inputs else self.what
        body = "\n".join(f"    {line}" for line in (*drive.lines, *self.lines, *drive.last))
        for name, value in (values or {}).items():
            part, _, parameter = name.partition(".")
            given = re.compile(rf'(model\.add\("{part}", .*\b{parameter}=)[-+.\de]+')
            body = given.sub(lambda match, value=value: f"{match[1]}{value:.4g}", body)  # type: ignore[misc]
        classes = f"\n\n{self.classes.strip()}\n" if self.classes else ""
        return (
            f'"""{head}."""\n\nfrom multibody import {from_multibody}\n'
            f"from multibody.library import {listed}\n{classes}\n\n"
            f'def build() -> Model:\n    """Return the machine, in SI."""\n'
            f'    model = Model("{self.name.replace("-", "_")}")\n{body}\n    return model\n'
        )


_MOTOR = ("motor", "drive", "m", "mot")
_ROTOR = ("motor", "rotor", "mot", "m", "encoder", "shaft", "input")
_LOAD = ("load", "output", "arm", "l", "wheel", "table", "link", "turntable")
_SLIDE = ("carriage", "slide", "nut", "table", "cart", "stage", "load", "scale")
_ACROSS = (Place("rotor.angle", "rad", _ROTOR), Place("rotor.speed", "rad/s", _ROTOR))

#: Ways of driving a shaft.  A reference comes first: a machine under a controller follows it whatever it takes, and
#: what it takes is measured.
SPEED = Drive(
    what="a speed that its controller keeps",
    inputs=(Place("motor.speed_reference", "rad/s", _MOTOR),),
    outputs=(Place("motor.torque", "N*m", _MOTOR),),
    imports=("SpeedSource",),
    lines=(
        'motor = model.add("motor", SpeedSource(time_constant=5e-3))',
        'model.input("motor.speed_reference", motor.reference)',
    ),
    commanded=True,
)
VOLTAGE = Drive(
    what="the voltage on its motor",
    inputs=(Place("motor.voltage", "V", _MOTOR),),
    outputs=(Place("motor.i", "A", _MOTOR),),
    unknown=(Unknown("motor.R"), Unknown("motor.k_t", ("motor.i",))),
    imports=("DCMotorDrive",),
    lines=(
        'motor = model.add("motor", DCMotorDrive(R=1.0, k_t=0.05, inductive=False))',
        'model.input("motor.voltage", motor.voltage)',
    ),
)
TORQUE = Drive(
    what="the torque of its motor",
    inputs=(Place("motor.torque", "N*m", _MOTOR),),
    imports=("TorqueSource",),
    lines=('motor = model.add("motor", TorqueSource())', 'model.input("motor.torque", motor.torque)'),
)
CURRENT = Drive(
    what="the current of its motor",
    inputs=(Place("motor.current", "A", _MOTOR),),
    imports=("Gain", "TorqueSource"),
    lines=(
        'motor = model.add("motor", TorqueSource())',
        'constant = model.add("constant", Gain(k=0.1, input_unit="A", output_unit="N*m"))  # torque per current',
        "model.connect(constant.output, motor.torque)",
        'model.input("motor.current", constant.input)',
    ),
)
SHAFT = (SPEED, VOLTAGE, TORQUE, CURRENT)
FORCE = Drive(
    what="a force",
    inputs=(Place("push.force", "N", ("force", "actuator", "push", "shaker")),),
    imports=("ForceSource",),
    lines=('push = model.add("push", ForceSource())', 'model.input("push.force", push.force)'),
)

_ROAD = '''
class Tyre(Component):
    """A tyre on a road whose height is a signal: force = stiffness · (road − wheel)."""

    stiffness = Parameter(None, "N/m", "force per compression", min=0.0)
    road = Input("m", "height of the road")
    wheel = Translation("hub")
    power = Power(kind="supply", meaning="power that the road brings in, and that the tyre gives back")

    def equations(self):
        self.wheel.force = self.stiffness * (self.road - self.wheel.position)
        self.power = self.wheel.force * self.wheel.velocity
'''

_KINDS = (
    MachineKind(
        name="screw-drive",
        what="A motor moves a carriage through a screw",
        drives=SHAFT,
        outputs=(
            Place("carriage.position", "m", _SLIDE),
            Place("carriage.velocity", "m/s", _SLIDE),
            Place("carriage.acceleration", "m/s**2", _SLIDE),
            *_ACROSS,
        ),
        unknown=(
            Unknown("carriage.m"),
            Unknown("guide.viscous"),
            Unknown("screw.lead", ("rotor.angle", "carriage.position"), together=True),
        ),
        imports=("Inertia", "Mass", "Screw", "ViscousFriction"),
        lines=(
            'rotor = model.add("rotor", Inertia(J=1e-5))',
            'screw = model.add("screw", Screw(lead=0.01))',
            'carriage = model.add("carriage", Mass(m=20.0))',
            'guide = model.add("guide", ViscousFriction(viscous=50.0))',
            "model.connect(motor.flange, rotor.flange, screw.a)",
            "model.connect(screw.b, carriage.flange, guide.b)",
            "model.connect(guide.a, model.ground)",
        ),
        fixed="rotor.J (1e-5 kg*m2) acts as mass of the carriage, too; screw.lead (0.01 m) unless angle and position "
        "are both measured",
    ),
    MachineKind(
        name="belt-drive",
        what="A motor moves a slide through an elastic belt",
        drives=SHAFT,
        outputs=(
            Place("slide.position", "m", _SLIDE),
            Place("slide.velocity", "m/s", _SLIDE),
            Place("slide.acceleration", "m/s**2", _SLIDE),
            Place("belt.tension", "N", ("belt", "tension", "pull", "force")),
            *_ACROSS,
        ),
        unknown=(
            Unknown("slide.m"),
            Unknown("guide.viscous"),
            Unknown("belt.stiffness"),
            Unknown("belt.damping"),
            Unknown("rotor.J", ("rotor.angle", "rotor.speed", "motor.torque", "motor.i")),
        ),
        imports=("Inertia", "Mass", "Rack", "SpringDamper", "ViscousFriction"),
        lines=(
            'rotor = model.add("rotor", Inertia(J=1e-3))',
            'pulley = model.add("pulley", Rack(radius=0.02))',
            'belt = model.add("belt", SpringDamper(stiffness=5e4, damping=100.0))',
            'slide = model.add("slide", Mass(m=10.0))',
            'guide = model.add("guide", ViscousFriction(viscous=30.0))',
            "model.connect(motor.flange, rotor.flange, pulley.a)",
            "model.connect(pulley.b, belt.b)",
            "model.connect(belt.a, slide.flange, guide.b)",
            "model.connect(guide.a, model.ground)",
        ),
        fixed="pulley.radius (0.02 m)",
    ),
    MachineKind(
        name="gearbox",
        what="A motor turns a load through a gear",
        drives=SHAFT,
        outputs=(Place("load.angle", "rad", _LOAD), Place("load.speed", "rad/s", _LOAD), *_ACROSS),
        unknown=(
            Unknown("load.J"),
            Unknown("bearing.viscous"),
            Unknown("gear.ratio", ("rotor.speed", "load.speed"), together=True),
            Unknown("gear.ratio", ("rotor.angle", "load.angle"), together=True),
            Unknown("gear.ratio", ("rotor.speed", "load.angle"), together=True),
        ),
        imports=("Gear", "Inertia", "RotaryViscousFriction"),
        lines=(
            'rotor = model.add("rotor", Inertia(J=1e-4))',
            'gear = model.add("gear", Gear(ratio=10.0))',
            'load = model.add("load", Inertia(J=0.1))',
            'bearing = model.add("bearing", RotaryViscousFriction(viscous=0.1))',
            "model.connect(motor.flange, rotor.flange, gear.a)",
            "model.connect(gear.b, load.flange, bearing.b)",
            "model.connect(bearing.a, model.ground)",
        ),
        fixed="rotor.J (1e-4 kg*m2) acts as inertia of the load, too; gear.ratio (10) unless both sides are measured",
    ),
    MachineKind(
        name="elastic-load",
        what="A motor turns a load through an elastic shaft",
        drives=SHAFT,
        outputs=(*_ACROSS, Place("load.angle", "rad", _LOAD), Place("load.speed", "rad/s", _LOAD)),
        unknown=(
            Unknown("rotor.J"),
            Unknown("load.J"),
            Unknown("shaft.stiffness"),
            Unknown("damping.damping"),
            Unknown("bearing.viscous"),
        ),
        imports=("Inertia", "RotaryViscousFriction", "TorsionDamper", "TorsionSpring"),
        lines=(
            'rotor = model.add("rotor", Inertia(J=1e-3))',
            'shaft = model.add("shaft", TorsionSpring(stiffness=100.0))',
            'damping = model.add("damping", TorsionDamper(damping=0.01))',
            'load = model.add("load", Inertia(J=1e-3))',
            'bearing = model.add("bearing", RotaryViscousFriction(viscous=1e-3))',
            "model.connect(motor.flange, rotor.flange, shaft.a, damping.a)",
            "model.connect(shaft.b, damping.b, load.flange, bearing.b)",
            "model.connect(bearing.a, model.ground)",
        ),
    ),
    MachineKind(
        name="dc-motor",
        what="A motor turns an inertia",
        drives=SHAFT,
        outputs=_ACROSS,
        unknown=(Unknown("rotor.J"), Unknown("bearing.viscous")),
        imports=("Inertia", "RotaryViscousFriction"),
        lines=(
            'rotor = model.add("rotor", Inertia(J=1e-3))',
            'bearing = model.add("bearing", RotaryViscousFriction(viscous=1e-3))',
            "model.connect(motor.flange, rotor.flange, bearing.b)",
            "model.connect(bearing.a, model.ground)",
        ),
    ),
    MachineKind(
        name="pendulum",
        what="A rod swings about a pivot; angle 0 hangs straight down",
        drives=(
            Drive(
                what="a torque at its pivot",
                inputs=TORQUE.inputs,
                unknown=(Unknown("rod.m"),),  # gravity's torque is weighed against the motor's
                imports=TORQUE.imports,
                lines=TORQUE.lines,
                last=("model.connect(motor.flange, rod.flange, pivot.b)",),
                fixed="rod.arm (0.1 m): only its product with rod.m acts",
            ),
            Drive(
                what="nothing",
                last=("model.connect(rod.flange, pivot.b)",),
                fixed="rod.m and rod.arm (0.5 kg at 0.1 m): the period shows rod.J only by their product",
            ),
        ),
        outputs=(
            Place("rod.angle", "rad", ("rod", "pendulum", "arm", "swing")),
            Place("rod.speed", "rad/s", ("rod", "pendulum", "arm", "swing")),
        ),
        unknown=(Unknown("rod.J"), Unknown("pivot.viscous")),
        imports=("Pendulum", "RotaryViscousFriction"),
        lines=(
            'rod = model.add("rod", Pendulum(J=1e-2, m=0.5, arm=0.1))',
            'pivot = model.add("pivot", RotaryViscousFriction(viscous=1e-3))',
            "model.connect(pivot.a, model.ground)",
        ),
    ),
    MachineKind(
        name="mass-spring",
        what="A mass on a spring and a damper",
        drives=(FORCE,),
        outputs=(
            Place("mass.position", "m", ("mass", "body")),
            Place("mass.velocity", "m/s", ("mass", "body")),
            Place("mass.acceleration", "m/s**2", ("mass", "body")),
        ),
        unknown=(Unknown("mass.m"), Unknown("spring.stiffness"), Unknown("spring.damping")),
        imports=("Mass", "SpringDamper"),
        lines=(
            'mass = model.add("mass", Mass(m=1.0))',
            'spring = model.add("spring", SpringDamper(stiffness=1000.0, damping=2.0))',
            "model.connect(push.flange, mass.flange, spring.b)",
            "model.connect(spring.a, model.ground)",
        ),
    ),
    MachineKind(
        name="quarter-car",
        what="A body and a wheel on a spring, a damper and a tyre; heights from where they rest",
        drives=(
            Drive(
                what="the height of the road",
                inputs=(Place("road.height", "m", ("road", "ground", "track", "profile", "actuator", "plate")),),
            ),
        ),
        outputs=(
            Place("body.position", "m", ("body", "sprung", "chassis", "s")),
            Place("wheel.position", "m", ("wheel", "unsprung", "hub", "axle", "us")),
            Place("body.velocity", "m/s", ("body", "sprung", "chassis")),
            Place("wheel.velocity", "m/s", ("wheel", "unsprung", "hub", "axle")),
            Place("body.acceleration", "m/s**2", ("body", "sprung", "chassis")),
            Place("wheel.acceleration", "m/s**2", ("wheel", "unsprung", "hub", "axle")),
        ),
        unknown=(
            Unknown("suspension.stiffness"),
            Unknown("suspension.damping"),
            Unknown("wheel.m"),
            Unknown("tyre.stiffness"),
        ),
        imports=("Mass", "SpringDamper"),
        own_imports=("Component", "Input", "Parameter", "Power", "Translation"),
        classes=_ROAD,
        lines=(
            'body = model.add("body", Mass(m=300.0))',
            'wheel = model.add("wheel", Mass(m=40.0))',
            'suspension = model.add("suspension", SpringDamper(stiffness=2e4, damping=1500.0))',
            'tyre = model.add("tyre", Tyre(stiffness=2e5))',
            "model.connect(suspension.b, body.flange)",
            "model.connect(suspension.a, wheel.flange, tyre.wheel)",
            'model.input("road.height", tyre.road)',
        ),
        fixed="body.m (300 kg): motion alone shows the ratios of masses and stiffnesses",
    ),
    MachineKind(
        name="tanks",
        what="A pump fills an upper tank, which drains into a lower one and that into a sump",
        drives=(
            Drive(
                what="the flow of its pump",
                inputs=(Place("pump.flow", "m**3/s", ("pump", "inflow", "feed", "flow", "in")),),
            ),
        ),
        outputs=(
            Place("upper.level", "m", ("upper", "first", "1", "level1", "h1")),
            Place("lower.level", "m", ("lower", "second", "2", "level2", "h2")),
        ),
        unknown=(
            Unknown("upper.area"),
            Unknown("drain.area"),
            Unknown("lower.area", ("lower.level",)),
            Unknown("outlet.area", ("lower.level",)),
        ),
        imports=("FlowSource", "Orifice", "Tank"),
        lines=(
            'pump = model.add("pump", FlowSource())',
            'upper = model.add("upper", Tank(area=0.02, level=0.1))',
            'drain = model.add("drain", Orifice(area=5e-5))',
            'lower = model.add("lower", Tank(area=0.02, level=0.1))',
            'outlet = model.add("outlet", Orifice(area=5e-5))',
            'fall = model.add("fall", Fall())  # the lower level does not hold back what falls',
            "model.connect(pump.a, model.ground)",
            "model.connect(pump.b, upper.port, drain.a)",
            "model.connect(drain.b, model.ground)",
            "model.connect(lower.port, outlet.a, fall.port)",
            "model.connect(outlet.b, model.ground)",
            "model.connect(drain.flow, fall.flow)",
            'model.input("pump.flow", pump.flow)',
        ),
        own_imports=("Component", "FluidPort", "Input", "Power"),
        classes='''
class Fall(Component):
    """A jet that falls into a tank: a flow given by a signal."""

    flow = Input("m**3/s", "flow into the tank")
    port = FluidPort("bottom of the tank")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.port.volume_flow = -self.flow
        self.power = self.port.pressure * self.flow
''',
    ),
    MachineKind(
        name="heated-body",
        what="A heater warms a body, which loses heat to its surroundings",
        drives=(
            Drive(
                what="the power of its heater, in recorded surroundings",
                inputs=(
                    Place("heater.power", "W", ("heater", "heating", "power")),
                    Place(
                        "surroundings.temperature", "K", ("ambient", "surroundings", "outside", "room", "air", "amb")
                    ),
                ),
                imports=("TemperatureSource",),
                lines=(
                    'air = model.add("surroundings", TemperatureSource())',
                    'body = model.add("body", HeatCapacity(capacity=5000.0, recorded_ambient=True))',
                    'model.input("surroundings.temperature", air.temperature, body.surroundings)',
                ),
            ),
            Drive(
                what="the power of its heater, in surroundings at 20 °C",
                inputs=(Place("heater.power", "W", ("heater", "heating", "power")),),
                imports=("FixedTemperature",),
                lines=(
                    'air = model.add("surroundings", FixedTemperature(temperature=293.15))',
                    'body = model.add("body", HeatCapacity(capacity=5000.0))',
                ),
            ),
        ),
        outputs=(Place("body.temperature", "K", ("body", "water", "plate", "block", "inside", "oven", "tank")),),
        unknown=(Unknown("body.capacity"), Unknown("wall.conductance")),
        imports=("HeatCapacity", "HeatSource", "ThermalConductance"),
        lines=(
            'heater = model.add("heater", HeatSource())',
            'wall = model.add("wall", ThermalConductance(conductance=5.0))',
            "model.connect(heater.port, body.port, wall.a)",
            "model.connect(wall.b, air.port)",
            'model.input("heater.power", heater.heat)',
        ),
    ),
)

KINDS: dict[str, MachineKind] = {kind.name: kind for kind in _KINDS}
"""Every kind of machine by the name that ``--machine`` takes."""
