"""Laws of missing effects, as components between two sides of a moving connection; strength zero is absence.

Every law gives ``force``, what it exerts on side a; side b gets the opposite.  ``v`` is the speed of a relative to b,
``x`` the position and ``t`` the time of the record.  Dry friction is smoothed within ``v_s`` of rest, as in
`multibody.library.friction`, whose laws are used here.
"""

from __future__ import annotations

import math
from typing import ClassVar

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Power, Rotation, State, Table, Translation
from multibody.declare.domains import in_both_domains
from multibody.library.laws import asymmetric, bell, bristle_rate, contact, coulomb, one_sided, quadratic

__all__ = ["CURVE_OVER", "CURVE_POINTS", "LAWS", "AddedInertia", "DryLaw", "Law", "add_law"]

CURVE_OVER = ("position", "speed", "time", "friction")
CURVE_POINTS = 17


class Law(Component):
    """What all laws share: an equal and opposite force on the two sides."""

    force = Output("F", "what the effect exerts on the first side")
    speed = Output("V", "speed of the first side relative to the second")
    loss = Power(kind="loss", meaning="power that the effect takes from the motion")
    #: States that stay where they are while nothing moves: not what balances a machine at rest, but what came before.
    memory: ClassVar[tuple[str, ...]] = ()

    def equations(self):
        self.speed = self.a.velocity - self.b.velocity
        self.a.force = self.force
        self.b.force = -self.force
        self.loss = -self.force * self.speed


class DryLaw(Law):
    """What laws of dry friction share."""

    v_s = Parameter(1e-3, "V", "speed below which dry friction fades (regularisation)", min=1e-300)


class _Viscous(Law):
    """Friction proportional to speed: F = −viscous·v."""

    viscous = Parameter(0.0, "F/V", "friction per speed")

    def equations(self):
        super().equations()
        self.force = -self.viscous * self.speed


class _Coulomb(DryLaw):
    """Dry friction: F = −coulomb·tanh(v / v_s)."""

    coulomb = Parameter(0.0, "F", "friction level")

    def equations(self):
        super().equations()
        self.force = -coulomb(self.speed, self.coulomb, self.v_s)


class _AsymmetricCoulomb(DryLaw):
    """Dry friction that differs with direction: F = −(forward or backward)·tanh(v / v_s)."""

    forward = Parameter(0.0, "F", "friction level for v > 0")
    backward = Parameter(0.0, "F", "friction level for v < 0")

    def equations(self):
        super().equations()
        self.force = -asymmetric(self.speed, self.forward, self.backward, self.v_s)


class _AsymmetricViscous(DryLaw):
    """Friction proportional to speed, with a factor for each direction: F = −(forward or backward)·v."""

    forward = Parameter(0.0, "F/V", "friction per speed for v > 0")
    backward = Parameter(0.0, "F/V", "friction per speed for v < 0")

    def equations(self):
        super().equations()
        self.force = -one_sided(self.speed, self.forward, self.backward, self.v_s) * self.speed


class _Stribeck(DryLaw):
    """Extra friction at low speed: F = −breakaway·exp(−(v / v_stribeck)²)·tanh(v / v_s)."""

    breakaway = Parameter(0.0, "F", "friction above the level at speed")
    v_stribeck = Parameter(1e-2, "V", "speed at which the extra friction has fallen to 1/e", min=1e-300)

    def equations(self):
        super().equations()
        ratio = self.speed / self.v_stribeck
        self.force = -coulomb(self.speed, self.breakaway * math.exp(-ratio * ratio), self.v_s)


class _Drag(Law):
    """Drag that grows with the square of the speed: F = −drag·v·|v|."""

    drag = Parameter(0.0, "F/V**2", "drag per speed squared")

    def equations(self):
        super().equations()
        self.force = -quadratic(self.speed, self.drag)


class _LoadFriction(DryLaw):
    """Friction proportional to the load that passes through: F = −share·|load|·tanh(v / v_s)."""

    load = Input("F", "force or torque that passes through")
    share = Parameter(0.0, "", "friction per load")

    def equations(self):
        super().equations()
        self.force = -coulomb(self.speed, self.share * abs(self.load), self.v_s)


class _PositionFriction(DryLaw):
    """Dry friction that changes along the way: F = −(slope·ξ + bow·(2ξ² − 1))·tanh(v / v_s), ξ = (x − centre)/half."""

    slope = Parameter(0.0, "F", "change of the friction level from the middle to the end")
    bow = Parameter(0.0, "F", "friction level at both ends above the mean, below it in the middle")
    centre = Parameter(0.0, "X", "middle of the travel")
    half = Parameter(1.0, "X", "half of the travel", min=1e-300)

    def equations(self):
        super().equations()
        xi = (self.a.position - self.b.position - self.centre) / self.half
        self.force = -coulomb(self.speed, self.slope * xi + self.bow * (2.0 * xi * xi - 1.0), self.v_s)


class _Constant(Law):
    """A constant force: F = push (weight, a pre-loaded cable, an offset of the drive)."""

    push = Parameter(0.0, "F", "force on the first side")

    def equations(self):
        super().equations()
        self.force = self.push


class _Stiffness(Law):
    """A spring: F = −stiffness·(x − centre)."""

    stiffness = Parameter(0.0, "F/X", "force per displacement")
    centre = Parameter(0.0, "X", "position without force")

    def equations(self):
        super().equations()
        self.force = -self.stiffness * (self.a.position - self.b.position - self.centre)


class _CubicStiffness(Law):
    """A hardening or softening spring: F = −stiffness·(x − centre)³."""

    stiffness = Parameter(0.0, "F/X**3", "force per displacement cubed")
    centre = Parameter(0.0, "X", "position without force")

    def equations(self):
        super().equations()
        s = self.a.position - self.b.position - self.centre
        self.force = -self.stiffness * s * s * s


class _Backlash(Law):
    """Play in an elastic connection: within ±gap/2 the spring that is there does not act.

    The law takes back what the spring does inside the gap: F = stiffness·clip(x − centre, ±gap/2).
    """

    gap = Parameter(0.0, "X", "play, from contact to contact")
    stiffness = Parameter(1.0, "F/X", "stiffness of the connection that has the play", min=0.0)
    centre = Parameter(0.0, "X", "middle of the play")

    def equations(self):
        super().equations()
        s = self.a.position - self.b.position - self.centre
        h = 0.5 * self.gap
        self.force = self.stiffness * max(min(s, h), -h)


class _Hysteresis(Law):
    """Friction with elastic displacement before sliding (Dahl 1968): F = −level·z, ż = (v − |v|·z)/x_s."""

    level = Parameter(0.0, "F", "friction level when sliding")
    x_s = Parameter(1e-4, "X", "displacement before sliding", min=1e-300)
    z = State("", "deflection of the asperities relative to sliding")
    memory: ClassVar[tuple[str, ...]] = ("z",)

    def equations(self):
        super().equations()
        self.der.z = bristle_rate(self.speed, self.z, 1.0, self.x_s)
        self.force = -self.level * self.z


class _PositionForce(Law):
    """A force that belongs to the position and not to the direction of travel, beyond a spring.

    F = bow·(2ξ² − 1) + wave·(4ξ³ − 3ξ), ξ = (x − centre)/half (Chebyshev polynomials of the travel).
    """

    bow = Parameter(0.0, "F", "force at both ends, of opposite sign in the middle")
    wave = Parameter(0.0, "F", "force that changes sign three times along the travel")
    centre = Parameter(0.0, "X", "middle of the travel")
    half = Parameter(1.0, "X", "half of the travel", min=1e-300)

    def equations(self):
        super().equations()
        xi = (self.a.position - self.b.position - self.centre) / self.half
        self.force = self.bow * (2.0 * xi * xi - 1.0) + self.wave * xi * (4.0 * xi * xi - 3.0)


class _Bump(DryLaw):
    """A tight spot: dry friction at one place, F = −level·exp(−((x − place)/width)²)·tanh(v / v_s)."""

    level = Parameter(0.0, "F", "friction at the middle of the spot")
    place = Parameter(0.0, "X", "where the spot is")
    width = Parameter(1e-2, "X", "half width at 1/e of the height", min=1e-300)
    features: ClassVar[dict[str, str]] = {"width": "speed"}

    def equations(self):
        super().equations()
        height = bell(self.a.position - self.b.position, self.place, self.width)
        self.force = -coulomb(self.speed, self.level * height, self.v_s)


class _Push(Law):
    """A force at one place of the travel, whichever way it is passed: F = push·exp(−((x − place)/width)²)."""

    push = Parameter(0.0, "F", "force in the middle of the place")
    place = Parameter(0.0, "X", "middle of the place")
    width = Parameter(1e-2, "X", "half width at 1/e of the height", min=1e-300)
    features: ClassVar[dict[str, str]] = {"width": "speed"}

    def equations(self):
        super().equations()
        self.force = self.push * bell(self.a.position - self.b.position, self.place, self.width)


class _EndStop(Law):
    """A stop on one side of the travel: F = −side·stiffness·max(side·(x − place), 0)."""

    stiffness = Parameter(0.0, "F/X", "force per way into the stop")
    place = Parameter(0.0, "X", "where the stop begins")
    side = Parameter(1.0, "", "1 for a stop towards larger x, -1 for one towards smaller x")

    def equations(self):
        super().equations()
        into = self.side * (self.a.position - self.b.position - self.place)
        self.force = -self.side * contact(into, 0.0, self.stiffness, 0.0)


class _Harmonic(Law):
    """A force that repeats along the way: F = cosine·cos(order·x) + sine·sin(order·x).

    For a shaft, ``order`` is the number of periods per turn; for a slide it is 2π over the wavelength in m.
    """

    cosine = Parameter(0.0, "F", "part that has its maximum at x = 0")
    sine = Parameter(0.0, "F", "part that is zero at x = 0")
    order = Parameter(1.0, "1/X", "periods per turn, or 2π over the wavelength", min=0.0)

    def equations(self):
        super().equations()
        phase = self.order * (self.a.position - self.b.position)
        self.force = self.cosine * math.cos(phase) + self.sine * math.sin(phase)


class _Slip(Law):
    """Creep in an elastic connection: part of the stretch is given up at a rate proportional to the force.

    ż = creep·stiffness·(s − z); F = stiffness·z takes back what the spring does over the slipped part.
    """

    creep = Parameter(0.0, "V/F", "slip speed per force")
    stiffness = Parameter(1.0, "F/X", "stiffness of the connection that slips", min=0.0)
    z = State("X", "distance slipped")

    def equations(self):
        super().equations()
        self.der.z = self.creep * self.stiffness * (self.a.position - self.b.position - self.z)
        self.force = self.stiffness * self.z


class _StribeckLoadFriction(DryLaw):
    """Load-dependent friction at low speed: F = −share·|load|·exp(−(v / v_stribeck)²)·tanh(v / v_s).

    Model M4 of M. Duclusaud et al., "Extended friction models for the physics simulation of servo actuators", 2025.
    """

    load = Input("F", "force or torque that passes through")
    share = Parameter(0.0, "", "friction per load at rest, beyond that at speed")
    v_stribeck = Parameter(1e-2, "V", "speed at which the extra friction has fallen to 1/e", min=1e-300)

    def equations(self):
        super().equations()
        ratio = self.speed / self.v_stribeck
        self.force = -coulomb(self.speed, self.share * abs(self.load) * math.exp(-ratio * ratio), self.v_s)


class _DirectionalLoadFriction(DryLaw):
    """Friction per load that depends on whether the load drives the motion or resists it.

    F = −(driving or resisting)·|load|·tanh(v / v_s): ``driving`` where load and speed have one sign.  Model M5 of
    Duclusaud et al. (2025) for a drive whose motor holds its load, so that one load stands for both sides.
    """

    load = Input("F", "force or torque that passes through")
    driving = Parameter(0.0, "", "friction per load where load and speed have one sign")
    resisting = Parameter(0.0, "", "friction per load where they have opposite signs")

    def equations(self):
        super().equations()
        s = math.tanh(self.speed / self.v_s)
        mean, half = 0.5 * (self.driving + self.resisting), 0.5 * (self.driving - self.resisting)
        self.force = -s * (mean * abs(self.load) + half * self.load * s)


class _QuadraticLoadFriction(DryLaw):
    """Friction that grows with the square of the load: F = −curve·load²·tanh(v / v_s).

    The quadratic term of model M6 of Duclusaud et al. (2025), harmonic drives and worm gears.
    """

    load = Input("F", "force or torque that passes through")
    curve = Parameter(0.0, "1/F", "friction per squared load")

    def equations(self):
        super().equations()
        self.force = -coulomb(self.speed, self.curve * self.load * self.load, self.v_s)


class _FrictionDrift(DryLaw):
    """Dry friction that changes with time: F = −rate·(t − begin)·tanh(v / v_s)."""

    rate = Parameter(0.0, "F/s", "change of the friction level per time")
    begin = Parameter(0.0, "s", "time at which the friction is that of the model")

    def equations(self):
        super().equations()
        self.force = -coulomb(self.speed, self.rate * (self.time - self.begin), self.v_s)


class _ViscousDrift(Law):
    """Friction per speed that changes with time: F = −rate·(t − begin)·v."""

    rate = Parameter(0.0, "F/(V*s)", "change of the friction per speed, per time")
    begin = Parameter(0.0, "s", "time at which the friction is that of the model")

    def equations(self):
        super().equations()
        self.force = -self.rate * (self.time - self.begin) * self.speed


class _StiffnessDrift(Law):
    """A spring that changes with time: F = −rate·(t − begin)·(x − centre)."""

    rate = Parameter(0.0, "F/(X*s)", "change of the stiffness per time")
    begin = Parameter(0.0, "s", "time at which the stiffness is that of the model")
    centre = Parameter(0.0, "X", "position without force")

    def equations(self):
        super().equations()
        self.force = -self.rate * (self.time - self.begin) * (self.a.position - self.b.position - self.centre)


class _WarmFriction(DryLaw):
    """Dry friction that changes with temperature: F = −slope·(T − reference)·tanh(v / v_s)."""

    temperature = Input("K", "temperature")
    slope = Parameter(0.0, "F/K", "change of the friction level per temperature")
    reference = Parameter(293.15, "K", "temperature at which the friction is that of the model")

    def equations(self):
        super().equations()
        self.force = -coulomb(self.speed, self.slope * (self.temperature - self.reference), self.v_s)


class _WarmViscous(Law):
    """Friction per speed that changes with temperature: F = −slope·(T − reference)·v."""

    temperature = Input("K", "temperature")
    slope = Parameter(0.0, "F/(V*K)", "change of the friction per speed, per temperature")
    reference = Parameter(293.15, "K", "temperature at which the friction is that of the model")

    def equations(self):
        super().equations()
        self.force = -self.slope * (self.temperature - self.reference) * self.speed


class _WarmStiffness(Law):
    """A spring that changes with temperature: F = −slope·(T − reference)·(x − centre)."""

    temperature = Input("K", "temperature")
    slope = Parameter(0.0, "F/(X*K)", "change of the stiffness per temperature")
    reference = Parameter(293.15, "K", "temperature at which the stiffness is that of the model")
    centre = Parameter(0.0, "X", "position without force")

    def equations(self):
        super().equations()
        stretch = self.a.position - self.b.position - self.centre
        self.force = -self.slope * (self.temperature - self.reference) * stretch


class _LateForce(Law):
    """A force that reaches the machine late: F = −(lag/filter)·(load − z), filter·ż = load − z.

    ``load`` is the force as the part gives it; F makes up the difference to the force that arrives, which for
    lag = 2·filter is the Padé approximation [1/1] of a delay.
    """

    load = Input("F", "force as the part gives it")
    lag = Parameter(0.0, "s", "by how much slow changes come late")
    filter = Parameter(1e-3, "s", "time constant of the filter behind it", min=1e-12)
    z = State("F", "force behind the filter")

    def equations(self):
        super().equations()
        behind = self.load - self.z
        self.der.z = behind / self.filter
        self.force = -self.lag / self.filter * behind


class _AttachedMass(Law):
    """A mass on a spring and a damper, carried along: F = mass·(ω²·z + 2·ζ·ω·ż), z̈ = −ω²·z − 2·ζ·ω·ż − ẍ.

    z is the displacement of the mass against what carries it, ω its natural frequency, ζ its damping ratio.  It starts
    at rest, without deflection.
    """

    mass = Parameter(0.0, "M", "mass that is carried along")
    natural_frequency = Parameter(30.0, "rad/s", "natural frequency on a carrier that stands still", min=1e-300)
    damping_ratio = Parameter(0.1, "", "damping ratio", min=0.0)
    z = State("X", "displacement of the mass against its carrier")
    w = State("V", "velocity of the mass")

    def equations(self):
        super().equations()
        rate = self.w - self.speed
        w_n = self.natural_frequency
        pull = w_n * w_n * self.z + 2.0 * self.damping_ratio * w_n * rate
        self.der.z = rate
        self.der.w = -pull
        self.force = self.mass * pull


class _Curve(DryLaw):
    """A force without a law, given by points over position, speed or time.

    Over ``"position"``, ``"speed"`` and ``"time"`` the curve is the force itself; over ``"friction"`` it is the level
    of a dry friction that changes along the way.
    """

    over = Option("position", "what the curve is a function of", choices=CURVE_OVER)
    curve = Table("", "F", "force", default=(tuple(range(CURVE_POINTS)), (0.0,) * CURVE_POINTS))
    units_by_option = ("curve",)

    def equations(self):
        super().equations()
        if self.over == "position":
            self.force = self.curve(self.a.position - self.b.position)
        elif self.over == "speed":
            self.force = self.curve(self.speed)
        elif self.over == "time":
            self.force = self.curve(self.time)
        else:
            self.force = -coulomb(self.speed, self.curve(self.a.position - self.b.position), self.v_s)


class AddedMass(Component):
    """Mass that moves along with a flange: F = −inertia·acceleration."""

    inertia = Parameter(0.0, "kg", "mass that is not in the model")
    a = Translation("what it moves with", inertia="inertia")


class AddedInertia(Component):
    """Moment of inertia that turns along with a flange: torque = −inertia·acceleration."""

    inertia = Parameter(0.0, "kg*m**2", "moment of inertia that is not in the model")
    a = Rotation("what it turns with", inertia="inertia")


def _versions() -> dict[str, tuple[type[Component], type[Component]]]:
    versions: dict[str, tuple[type[Component], type[Component]]] = {}
    for law in (*Law.__subclasses__(), *DryLaw.__subclasses__()):
        if law is DryLaw:
            continue
        name = law.__name__.lstrip("_")
        versions[name] = in_both_domains(law, _class_names(name))
    versions["AddedInertia"] = (AddedMass, AddedInertia)
    return versions


def _class_names(law: str) -> tuple[str, str]:
    return f"{law}Effect", f"Rotary{law}Effect"


def add_law(name: str, law: type[Component], *, again: bool = False) -> None:
    """Offer a user's own law to the catalogue under a name.

    Parameters
    ----------
    name : str
        What `discrepancy.effects.kinds.Kind.law` refers to.
    law : type
        Subclass of `Law` or `DryLaw`, written with the letters F, X and V in its units.
    again : bool
        Take the place of the law of this name.

    Raises
    ------
    ValueError
        If the name is taken, or the law is not at the top of its file.
    """
    if name in LAWS and not again:
        raise ValueError(f"there is already a law '{name}': give yours another name")
    LAWS[name] = in_both_domains(law, _class_names(name))


#: name of the law → its sliding and its turning version
LAWS = _versions()
