"""Friction and drag between two flanges, for translation and, with ``Rotary`` before the name, for rotation.

Each law is written once, as the ``resistance`` against the ``speed`` of b relative to a; the pair of flanges
on which it acts comes from `Sliding` or `Turning`. Dry friction is regularised: ``tanh(speed / v_s)`` stands
for the sign, so that below about ``v_s`` it creeps where the real contact sticks; the laws of Dahl and LuGre stick, as
a spring.
"""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Power, Rotation, State, Translation
from multibody.library.laws import asymmetric, bell, bristle_rate, coulomb, one_sided, quadratic, stribeck

__all__ = [
    "AsymmetricFriction",
    "CoulombFriction",
    "DahlFriction",
    "LoadDependentFriction",
    "LuGreFriction",
    "QuadraticDrag",
    "RotaryAsymmetricFriction",
    "RotaryCoulombFriction",
    "RotaryDahlFriction",
    "RotaryLoadDependentFriction",
    "RotaryLuGreFriction",
    "RotaryQuadraticDrag",
    "RotaryStribeckFriction",
    "RotaryViscousFriction",
    "Sliding",
    "StribeckFriction",
    "Turning",
    "ViscousFriction",
]


class Sliding(Component):
    """Two flanges that slide along each other, with a resistance between them that a subclass states."""

    a = Translation("first side, usually the ground")
    b = Translation("second side")
    speed = Output("m/s", "velocity of b relative to a")
    resistance = Output("N", "friction force, positive at positive speed")
    loss = Power(kind="loss")

    def equations(self):
        self.speed = self.b.velocity - self.a.velocity
        self.a.force = self.resistance
        self.b.force = -self.resistance
        self.loss = self.resistance * self.speed


class Turning(Component):
    """Two flanges that turn against each other, with a resistance between them that a subclass states."""

    a = Rotation("first side, usually the ground")
    b = Rotation("second side")
    speed = Output("rad/s", "speed of b relative to a")
    resistance = Output("N*m", "friction torque, positive at positive speed")
    loss = Power(kind="loss")

    def equations(self):
        self.speed = self.b.speed - self.a.speed
        self.a.torque = self.resistance
        self.b.torque = -self.resistance
        self.loss = self.resistance * self.speed


class _Viscous(Component):
    def equations(self):
        super().equations()
        self.resistance = self.viscous * self.speed


class ViscousFriction(_Viscous, Sliding):
    """Friction in proportion to speed: resistance = viscous · v."""

    viscous = Parameter(None, "N*s/m", "force per speed", min=0.0)


class RotaryViscousFriction(_Viscous, Turning):
    """Friction in proportion to speed: resistance = viscous · ω."""

    viscous = Parameter(None, "N*m*s/rad", "torque per speed", min=0.0)


class _Coulomb(Component):
    def equations(self):
        super().equations()
        self.resistance = coulomb(self.speed, self.coulomb, self.v_s)


class CoulombFriction(_Coulomb, Sliding):
    """Dry friction of constant level: resistance = coulomb · tanh(v / v_s)."""

    coulomb = Parameter(None, "N", "level of dry friction", min=0.0)
    v_s = Parameter(1e-3, "m/s", "speed below which friction fades (regularisation)", min=1e-12)


class RotaryCoulombFriction(_Coulomb, Turning):
    """Dry friction of constant level: resistance = coulomb · tanh(ω / v_s)."""

    coulomb = Parameter(None, "N*m", "level of dry friction", min=0.0)
    v_s = Parameter(1e-2, "rad/s", "speed below which friction fades (regularisation)", min=1e-12)


class _Dahl(Component):
    def equations(self):
        super().equations()
        self.der.z = bristle_rate(self.speed, self.z, 1.0, self.x_s)
        self.resistance = self.coulomb * self.z


class DahlFriction(_Dahl, Sliding):
    """Dry friction that gives way elastically before it slides: resistance = coulomb · z, ż = (v − |v|·z) / x_s.

    Its loss counts what the asperities store, and is negative while they spring back.  P. R. Dahl, "A solid friction
    model", The Aerospace Corporation, TOR-0158(3107-18)-1, 1968.
    """

    coulomb = Parameter(None, "N", "level of dry friction", min=0.0)
    x_s = Parameter(1e-5, "m", "displacement before sliding", min=1e-12)
    z = State("", "deflection of the asperities relative to sliding")


class RotaryDahlFriction(_Dahl, Turning):
    """Dry friction that gives way elastically before it slides; see `DahlFriction`."""

    coulomb = Parameter(None, "N*m", "level of dry friction", min=0.0)
    x_s = Parameter(1e-4, "rad", "angle before sliding", min=1e-12)
    z = State("", "deflection of the asperities relative to sliding")


class _LuGre(Component):
    t_s = Parameter(0.0, "s", "damping of the bristles over their stiffness", min=0.0)
    breakaway = Parameter(1.0, "", "level at rest over that while sliding", min=1.0)
    z = State("", "deflection of the bristles relative to sliding")

    def equations(self):
        super().equations()
        level = 1.0 + (self.breakaway - 1.0) * bell(self.speed, 0.0, self.v_stribeck)
        rate = bristle_rate(self.speed, self.z, level, self.x_s)
        self.der.z = rate
        self.resistance = self.coulomb * (self.z + self.t_s * rate)


class LuGreFriction(_LuGre, Sliding):
    """Dry friction of damped bristles: resistance = coulomb · (z + t_s · ż), ż = (v − |v|·z / g(v)) / x_s.

    The level g(v) = 1 + (breakaway − 1)·exp(−(v / v_stribeck)²) falls as speed rises.  With the stiffness σ₀ and the
    damping σ₁ of the bristles x_s = coulomb / σ₀ and t_s = σ₁ / σ₀; viscous friction (σ₂) is a component of its own.
    The law is that of Dahl where nothing is damped and nothing falls.  C. Canudas de Wit, H. Olsson, K. J. Åström,
    P. Lischinsky, "A new model for control of systems with friction", IEEE Transactions on Automatic Control 40 (1995),
    eq. (1) to (4).
    """

    coulomb = Parameter(None, "N", "level of dry friction while sliding", min=0.0)
    x_s = Parameter(1e-5, "m", "displacement before sliding", min=1e-12)
    v_stribeck = Parameter(1e-2, "m/s", "speed at which the level falls", min=1e-12)


class RotaryLuGreFriction(_LuGre, Turning):
    """Dry friction of damped bristles; see `LuGreFriction`."""

    coulomb = Parameter(None, "N*m", "level of dry friction while sliding", min=0.0)
    x_s = Parameter(1e-4, "rad", "angle before sliding", min=1e-12)
    v_stribeck = Parameter(1e-1, "rad/s", "speed at which the level falls", min=1e-12)


class _Asymmetric(Component):
    def equations(self):
        super().equations()
        dry = asymmetric(self.speed, self.coulomb_forward, self.coulomb_backward, self.v_s)
        viscous = one_sided(self.speed, self.viscous_forward, self.viscous_backward, self.v_s)
        self.resistance = dry + viscous * self.speed


class AsymmetricFriction(_Asymmetric, Sliding):
    """Dry and viscous friction with a level for each direction of motion."""

    coulomb_forward = Parameter(None, "N", "level of dry friction at positive speed", min=0.0)
    coulomb_backward = Parameter(None, "N", "level of dry friction at negative speed", min=0.0)
    viscous_forward = Parameter(0.0, "N*s/m", "force per speed at positive speed", min=0.0)
    viscous_backward = Parameter(0.0, "N*s/m", "force per speed at negative speed", min=0.0)
    v_s = Parameter(1e-3, "m/s", "speed below which dry friction fades (regularisation)", min=1e-12)


class RotaryAsymmetricFriction(_Asymmetric, Turning):
    """Dry and viscous friction with a level for each direction of rotation."""

    coulomb_forward = Parameter(None, "N*m", "level of dry friction at positive speed", min=0.0)
    coulomb_backward = Parameter(None, "N*m", "level of dry friction at negative speed", min=0.0)
    viscous_forward = Parameter(0.0, "N*m*s/rad", "torque per speed at positive speed", min=0.0)
    viscous_backward = Parameter(0.0, "N*m*s/rad", "torque per speed at negative speed", min=0.0)
    v_s = Parameter(1e-2, "rad/s", "speed below which dry friction fades (regularisation)", min=1e-12)


class _Stribeck(Component):
    def equations(self):
        super().equations()
        dry = stribeck(self.speed, self.coulomb, self.static, self.v_stribeck, self.exponent, self.v_s)
        self.resistance = dry + self.viscous * self.speed


class StribeckFriction(_Stribeck, Sliding):
    """Dry friction that falls from ``static`` to ``coulomb`` as speed rises, and viscous friction.

    resistance = (coulomb + (static − coulomb) · exp(−(|v|/v_stribeck)^exponent)) · tanh(v / v_s) + viscous ·
    v. Choose v_s well below v_stribeck, otherwise the peak at low speed is cut off.
    """

    coulomb = Parameter(None, "N", "level of dry friction at speed", min=0.0)
    static = Parameter(None, "N", "level of dry friction near standstill", min=0.0)
    v_stribeck = Parameter(0.01, "m/s", "speed over which friction falls", min=1e-12)
    exponent = Parameter(2.0, "", "shape of the fall: 2 Gaussian, 1 exponential", min=0.5, max=4.0)
    viscous = Parameter(0.0, "N*s/m", "force per speed", min=0.0)
    v_s = Parameter(1e-3, "m/s", "speed below which dry friction fades (regularisation)", min=1e-12)


class RotaryStribeckFriction(_Stribeck, Turning):
    """Dry friction that falls from ``static`` to ``coulomb`` as speed rises; see `StribeckFriction`."""

    coulomb = Parameter(None, "N*m", "level of dry friction at speed", min=0.0)
    static = Parameter(None, "N*m", "level of dry friction near standstill", min=0.0)
    v_stribeck = Parameter(0.1, "rad/s", "speed over which friction falls", min=1e-12)
    exponent = Parameter(2.0, "", "shape of the fall: 2 Gaussian, 1 exponential", min=0.5, max=4.0)
    viscous = Parameter(0.0, "N*m*s/rad", "torque per speed", min=0.0)
    v_s = Parameter(1e-2, "rad/s", "speed below which dry friction fades (regularisation)", min=1e-12)


class LoadDependentFriction(Sliding):
    """Dry friction in proportion to a normal load given by a signal.

    resistance = (coulomb + mu · |load|) · tanh(v / v_s). With ``lifts=True`` a negative load is a contact
    that has opened, and only a positive one counts.
    """

    mu = Parameter(None, "", "coefficient of friction", min=0.0)
    coulomb = Parameter(0.0, "N", "level of dry friction without load", min=0.0)
    v_s = Parameter(1e-3, "m/s", "speed below which friction fades (regularisation)", min=1e-12)
    load = Input("N", "normal force")
    lifts = Option(False, "whether a negative load means no contact")

    def equations(self):
        super().equations()
        pressed = max(self.load, 0.0) if self.lifts else abs(self.load)
        self.resistance = coulomb(self.speed, self.coulomb + self.mu * pressed, self.v_s)


class RotaryLoadDependentFriction(Turning):
    """Dry friction of a bearing or brake in proportion to a load given by a signal.

    resistance = (coulomb + mu · radius · |load|) · tanh(ω / v_s)
    """

    mu = Parameter(None, "", "coefficient of friction", min=0.0)
    radius = Parameter(None, "m", "radius at which it acts", min=0.0)
    coulomb = Parameter(0.0, "N*m", "level of dry friction without load", min=0.0)
    v_s = Parameter(1e-2, "rad/s", "speed below which friction fades (regularisation)", min=1e-12)
    load = Input("N", "normal force")
    lifts = Option(False, "whether a negative load means no contact")

    def equations(self):
        super().equations()
        pressed = max(self.load, 0.0) if self.lifts else abs(self.load)
        self.resistance = coulomb(self.speed, self.coulomb + self.mu * self.radius * pressed, self.v_s)


class _Quadratic(Component):
    def equations(self):
        super().equations()
        self.resistance = quadratic(self.speed, self.quadratic)


class QuadraticDrag(_Quadratic, Sliding):
    """Drag in proportion to the square of speed: resistance = quadratic · v·|v|; in air ρ·c_w·A/2."""

    quadratic = Parameter(None, "N*s**2/m**2", "force per squared speed", min=0.0)


class RotaryQuadraticDrag(_Quadratic, Turning):
    """Drag in proportion to the square of speed: resistance = quadratic · ω·|ω| (fans, windage)."""

    quadratic = Parameter(None, "N*m*s**2/rad**2", "torque per squared speed", min=0.0)
