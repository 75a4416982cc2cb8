"""The kinds of effect that the catalogue knows: law, strengths, shapes to try, and what each means to an engineer."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

from discrepancy.effects import shape_grids
from discrepancy.effects.shape_grids import MotionRange, Shapes
from multibody.base.references import EFFECTS_GROUP, offered_modules

if TYPE_CHECKING:
    from multibody.declare.component import Component

__all__ = ["SHIPPED", "Kind", "KindText", "kind_named", "kinds", "register"]


@dataclass(frozen=True)
class KindText:
    """A kind in words, for reports: what it is, what usually causes it, how to confirm it by hand."""

    title: str
    what: str
    causes: str
    confirm: str


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of effect.

    Parameters
    ----------
    name : str
        Name in files; a kind once named keeps its name.
    at : {"connection", "sensor", "input", "signal", "parameter", "transmission"}
        What it acts on; ``"signal"`` is what a controller gives to the machine, ``"parameter"`` is an effect
        that a component already contains, with its strengths at zero, ``"transmission"`` one that replaces a rigid
        transmission.
    law : str
        Name in `discrepancy.effects.laws.LAWS` (connections), the sensor's or input's error, the class of the component
        whose parameters the strengths are, or the function of `multibody.library.laws` by which a transmission slips.
    strengths : tuple of str
        Parameters that are zero when the effect is absent.
    text : KindText
    shapes : callable, optional
        From the motion, the shapes to try: other parameters of the law.
    free_shapes : tuple of str
        Shape parameters that are fitted once the effect is in.
    one_sided : bool
        A strength below zero makes no physical sense.
    linear : bool
        False if the force is not proportional to the strength; the scan then takes a finite-amplitude sensitivity, at
        the strength that the shape names ``amplitude``, or at a small one.
    needs : {"", "stiffness", "load", "drive", "ground", "travel", "dry friction", "viscous friction"}
        What the connection must have: a spring of its own, a force that passes through, a part that drives it and says
        with which force, the ground on one side with an inertia on the other, a travel, which the stretch of a spring
        between two bodies is not, or a friction in the model.
    signal : {"", "load", "temperature"}
        Input of the law beside the motion: the load, or a temperature that is in the model.
    elastic : bool or None
        True: only where the connection has a spring; False: only where it has none; None: anywhere.
    contains : tuple of str
        Simpler kinds that this one becomes in a limit of its parameters: they are tried first.
    by_direction : bool
        The two strengths are those of the contained kind, one for each direction of motion.
    component : type or tuple of type, optional
        Parameter effects: the class or classes whose instances can have it.
    sides : tuple of (str, str)
        Parameter effects: parts of the component that can each have it, and the ending of their parameters' names.
    component_shapes : callable, optional
        Parameter effects: from the component and the ending, the shapes to try.
    stated : bool
        Parameter effects: the component holds the stated value, which may be wrong; absence is that value, not zero.
    same_law : tuple of str
        Connections: names of parameters that are, in a component, the strength of the same law.  Where a component at
        the connection has one that is uncertain, the kind is not offered: the value is fitted already.
    aliases : tuple of str
        Other names under which the kind is found.
    forms : tuple of Kind
        The same effect, under the same name, where it acts elsewhere, or with another law.
    """

    name: str
    at: str
    law: str
    strengths: tuple[str, ...]
    text: KindText
    shapes: Callable[[MotionRange], Shapes] | None = None
    free_shapes: tuple[str, ...] = ()
    one_sided: bool = False
    linear: bool = True
    needs: str = ""
    elastic: bool | None = None
    contains: tuple[str, ...] = ()
    by_direction: bool = False
    aliases: tuple[str, ...] = field(default=())
    component: type[Component] | tuple[type[Component], ...] | None = None
    sides: tuple[tuple[str, str], ...] = ()
    component_shapes: Callable[[Component, str], Shapes] | None = None
    stated: bool = False
    signal: str = ""
    same_law: tuple[str, ...] = ()
    forms: tuple[Kind, ...] = ()

    @property
    def law_input(self) -> str:
        """Input of the law beside the motion, or an empty text."""
        return self.signal or ("load" if self.needs in ("load", "drive") else "")

    @property
    def component_class(self) -> type[Component]:
        """The class whose declarations say what the strengths are (parameter effects)."""
        assert self.component is not None
        return self.component[0] if isinstance(self.component, tuple) else self.component

    def owner_of(self, where: str) -> tuple[str, str]:
        """Return the component and the ending of its parameters' names that a place of a parameter effect stands for.

        Examples
        --------
        >>> text = KindText("", "", "", "")
        >>> sides = (("gear_1", "_1"), ("gear_2", "_2"))
        >>> kind = Kind(name="k", at="parameter", law="Mesh", strengths=("a",), text=text, sides=sides)
        >>> kind.owner_of("stage.mesh.gear_1")
        ('stage.mesh', '_1')
        """
        for side, ending in self.sides:
            if where.endswith(f".{side}"):
                return where[: -len(side) - 1], ending
        return where, ""

    def form(self, *, connection: bool, strengths: Iterable[str] = ()) -> Kind:
        """Return the form of the kind that acts on connections, or on something else, and has these strengths.

        The kind itself where none has: what it is given is then wrong, and is told where it is used.

        Examples
        --------
        >>> late = kind_named("input_delay")
        >>> [late.form(connection=False, strengths=[s]).at for s in ("delay", "lag")], late.form(connection=True).law
        (['input', 'signal'], 'LateForce')
        """
        given = set(strengths)
        fitting = (f for f in (self, *self.forms) if (f.at == "connection") == connection and given <= {*f.strengths})
        return next(fitting, self)

    @property
    def every_strength(self) -> tuple[str, ...]:
        """The strengths of all forms."""
        return tuple(dict.fromkeys(name for form in (self, *self.forms) for name in form.strengths))

    @property
    def inserted(self) -> bool:
        """True for a part that stands between a signal and what it feeds."""
        return self.at == "signal" or (self.at == "input" and self.law == "lag")

    @property
    def free_form(self) -> bool:
        """True for a curve given by points in place of a law."""
        return self.law == "Curve"

    def shape_grid(self, motion: MotionRange) -> Shapes:
        """Return the shapes to try for a motion; one empty shape when the kind has none."""
        shapes = self.shapes(motion) if self.shapes is not None else [{}]
        if any("secant" in shape for shape in shapes):
            text = f"kind '{self.name}': the entry 'secant' of a shape is now called 'amplitude'"
            warnings.warn(text, FutureWarning, stacklevel=2)
            shapes = [{"amplitude" if k == "secant" else k: v for k, v in shape.items()} for shape in shapes]
        return shapes


_T = KindText
_KINDS: dict[str, Kind] = {}
_REGISTERED_BY: dict[str, str] = {}  # the file that registered each


def register(kind: Kind, law: type[Component] | None = None) -> Kind:
    """Add a kind to the catalogue; its name must be new, unless the same file registers it again.

    Parameters
    ----------
    kind : Kind
    law : type, optional
        The law that ``kind.law`` names, if it is not one that ships: see `discrepancy.effects.laws.add_law`.

    Raises
    ------
    ValueError
        If the name of the kind or of the law is taken, or the law is not at the top of its file.
    """
    caller = sys._getframe(1)
    # each cell of a notebook is a file of its own
    file = "__main__" if caller.f_globals.get("__name__") == "__main__" else caller.f_code.co_filename
    again = _REGISTERED_BY.get(kind.name) == file
    if kind.name in _KINDS and not again:
        raise ValueError(f"there is already a kind '{kind.name}': give yours another name")
    if law is not None:
        from discrepancy.effects.laws import add_law

        add_law(kind.law, law, again=again)
    _KINDS[kind.name], _REGISTERED_BY[kind.name] = kind, file
    return kind


@lru_cache(maxsize=1)
def _load_offered() -> None:
    """Import what installed packages offer as effects, which registers them; what fails is reported and left out."""
    for module in offered_modules(EFFECTS_GROUP):
        try:
            importlib.import_module(module)
        except Exception as error:
            text = (
                f"the effects that the installed package of '{module}' offers are left out: "
                f"{type(error).__name__}: {error}: mend or uninstall it"
            )
            warnings.warn(text, RuntimeWarning, stacklevel=3)


def kinds() -> dict[str, Kind]:
    """Return all kinds by name: those that ship, those of installed packages, and those registered since."""
    _load_offered()
    return dict(_KINDS)


def kind_named(name: str) -> Kind:
    """Return a kind by its name or one of its aliases.

    Raises
    ------
    KeyError
        With the nearest name.
    """
    from multibody.base.spelling import nearest

    if name not in _KINDS:
        _load_offered()
    kind = _KINDS.get(name) or next((k for k in _KINDS.values() if name in k.aliases), None)
    if kind is None:
        raise KeyError(f"there is no effect '{name}'{nearest(name, _KINDS)}")
    return kind


def _add(rows: Sequence[Kind]) -> None:
    for row in rows:
        register(row)


_DRY = _T(
    "dry (Coulomb) friction",
    "A resistance of constant size against the motion, whatever the speed; before it slides it may give way a little.",
    "Sliding guides, seals, plain bearings, screws, preloaded rolling guides.",
    "Move slowly in both directions: the drive force jumps by twice the friction when the direction changes.",
)
_SPOT = _T(
    "a tight spot",
    "More resistance, or a force, at one place of the travel.",
    "A rail joint, a dent, dirt, a damaged ball or race, a bent screw, a detent, a cable that snags.",
    "Move slowly over the place by hand or under power and watch the force; look at the rail there.",
)
_LATE_INPUT = _T(
    "an input delay",
    "The machine receives an input later than it was recorded.",
    "Bus and computing time of the controller, filters, a digital hold.",
    "Record command and response of the amplifier together and compare the instants.",
)
_LATE_CONTROL = _T(
    "an input delay",
    "What a controller or drive gives reaches the machine late.",
    "Computing time, bus cycles, sample-and-hold (half a period), a filter in the loop, an amplifier or valve that is "
    "slow.",
    "Record reference, measurement and output of the loop together and compare a sharp event in them; raise the gain: "
    "the loop rings at a gain at which the model does not.",
)

# A table, one block for each kind.
# fmt: off
_add([
    Kind(name="viscous_friction", at="connection", law="Viscous", strengths=("viscous",), text=_T(
        "viscous friction", "A resistance proportional to speed.",
        "Lubricant shear in guides, bearings and seals; grease that is cold or too stiff; eddy currents.",
        "Move at several constant speeds in both directions: the drive force rises in a straight line with speed."),
        one_sided=True, elastic=False, same_law=("viscous", "damping")),
    Kind(name="extra_damping", at="connection", law="Viscous", strengths=("viscous",), text=_T(
        "additional damping", "Damping between two sides that are joined by a spring, beyond what the model has.",
        "Material damping, joints, rubber elements, rope strands that rub.",
        "Let the machine ring down after a step or knock: the vibration dies faster or slower than the model's."),
        elastic=True, same_law=("viscous", "damping")),
    Kind(name="coulomb_friction", at="connection", law="Coulomb", strengths=("coulomb",), text=_DRY,
        shapes=shape_grids.smooth_sign, free_shapes=("v_s",), one_sided=True, same_law=("coulomb",), forms=(
        Kind(name="coulomb_friction", at="connection", law="Hysteresis", strengths=("level",), text=_DRY,
             shapes=shape_grids.small_displacements, free_shapes=("x_s",), one_sided=True, same_law=("coulomb",)),)),
    Kind(name="asymmetric_coulomb_friction", at="connection", law="AsymmetricCoulomb",
         strengths=("forward", "backward"), text=_T(
        "dry friction that differs with direction", "A constant resistance, of another size in each direction.",
        "Worn or tilted guides, a one-sided preload, a screw worn on one flank, a cable chain, weight on an incline.",
        "Move at the same constant speed forwards and backwards: the drive force differs by more than its sign."),
        shapes=shape_grids.smooth_sign, free_shapes=("v_s",), one_sided=True, contains=("coulomb_friction",),
        by_direction=True),
    Kind(name="asymmetric_viscous_friction", at="connection", law="AsymmetricViscous",
         strengths=("forward", "backward"), text=_T(
        "viscous friction that differs with direction", "A resistance proportional to speed, steeper one way.",
        "A shock absorber, a ball screw or nut worn on one flank, seals with a lip, one-sided lubrication.",
        "Plot the drive force against constant speed in both directions: the two slopes differ."),
        one_sided=True, contains=("viscous_friction", "extra_damping"), by_direction=True),
    Kind(name="stribeck_friction", at="connection", law="Stribeck", strengths=("breakaway",), text=_T(
        "Stribeck friction (more friction at low speed)", "Friction that falls while the motion gathers speed.",
        "Lubricated sliding contacts, in which the oil film builds up only with speed; guides that stood for a while.",
        "Move at very low constant speeds: the drive force falls with rising speed; stick-slip may show."),
        shapes=shape_grids.low_speeds, free_shapes=("v_stribeck", "v_s"), one_sided=True,
        contains=("coulomb_friction",)),
    Kind(name="quadratic_drag", at="connection", law="Drag", strengths=("drag",), text=_T(
        "drag that grows with the square of the speed", "A resistance proportional to speed squared.",
        "Air or fluid that is pushed aside, ventilation of rotors, displaced oil, oil through an orifice.",
        "Compare constant speeds: doubling the speed makes this part of the force four times larger."),
        one_sided=True),
    Kind(name="load_dependent_friction", at="connection", law="LoadFriction", strengths=("share",), text=_T(
        "friction proportional to the load", "Dry friction whose level follows the force that passes through.",
        "Gear meshes, screws, loaded guides and bearings: the normal force rises with the load.",
        "Repeat a slow motion with twice the payload: the friction rises with it."),
        shapes=shape_grids.smooth_sign, free_shapes=("v_s",), one_sided=True, needs="load"),
    Kind(name="position_dependent_friction", at="connection", law="PositionFriction",
         strengths=("slope", "bow"), text=_T(
        "friction that changes along the travel", "Dry friction with a level that depends on where the machine is.",
        "Guides that are not parallel, a bent rail, uneven wear, misaligned bearings.",
        "Move slowly over the whole travel both ways: half the difference of the two force curves is the friction."),
        shapes=shape_grids.centred_sign, elastic=False),
    Kind(name="constant_force", at="connection", law="Constant", strengths=("push",), text=_T(
        "a constant force", "A force that does not depend on motion.",
        "Weight of a part or a slope, a counterbalance, a preloaded cable or hose, an offset of the drive.",
        "Hold still at several places: the holding force has the same non-zero mean everywhere.")),
    Kind(name="linear_stiffness", at="connection", law="Stiffness", strengths=("stiffness",), text=_T(
        "a spring", "A force proportional to the displacement.",
        "A cable or hose that is dragged along, a bellows, a flexure, magnetic attraction.",
        "Hold still at several places: the holding force rises in a straight line with position."),
        shapes=shape_grids.centre),
    Kind(name="cubic_stiffness", at="connection", law="CubicStiffness", strengths=("stiffness",), text=_T(
        "a spring that hardens or softens", "A force that grows with the cube of the displacement.",
        "Flexures at large deflection, rubber, stops that come into contact gradually.",
        "Hold still at several places: the holding force bends away from a straight line towards the ends."),
        shapes=shape_grids.bends_about, free_shapes=("centre",)),
    Kind(name="backlash", at="connection", law="Backlash", strengths=("gap",), text=_T(
        "play (backlash)", "A gap in an elastic connection: within it nothing is transmitted.",
        "Worn gears, keys, couplings, loose screws, a nut without preload.",
        "Hold one side and move the other by hand: it moves freely for a moment. Reverse slowly and watch both sides."),
        shapes=shape_grids.spring_gap, free_shapes=("centre", "stiffness"), one_sided=True, linear=False,
        needs="stiffness", elastic=True),
    Kind(name="hysteresis", at="connection", law="Hysteresis", strengths=("level",), text=_T(
        "friction with elastic displacement (hysteresis)", "Friction that first yields like a spring, then slides.",
        "Rolling guides and ball screws (presliding), rope strands, rubber, clamped joints.",
        "Reverse after a very short stroke: force against position draws a closed loop."),
        shapes=shape_grids.displacements, free_shapes=("x_s",), one_sided=True, contains=("coulomb_friction",)),
    Kind(name="position_dependent_force", at="connection", law="PositionForce", strengths=("bow", "wave"), text=_T(
        "a force that belongs to the position", "A force that depends on position but not on direction of travel.",
        "A rail that is not level, magnetic attraction, cable carriers, cams, an uneven counterbalance.",
        "Move slowly both ways over the travel: the mean of the two force curves is not flat."),
        shapes=shape_grids.centred, free_shapes=("centre", "half")),
    Kind(name="local_bump", at="connection", law="Bump", strengths=("level",), text=_SPOT,
        shapes=shape_grids.spots, free_shapes=("place", "width", "v_s"), one_sided=True, needs="travel", forms=(
        Kind(name="local_bump", at="connection", law="Push", strengths=("push",), text=_SPOT,
             shapes=shape_grids.pushes, free_shapes=("place", "width"), needs="travel"),)),
    Kind(name="end_stop", at="connection", law="EndStop", strengths=("stiffness",), text=_T(
        "an end stop", "A stop or buffer that is met before the end of the travel.",
        "A rubber buffer, a bump stop of a suspension, a cable that is too short, a part that touches the frame.",
        "Move slowly towards both ends by hand: at one place resistance sets in. Look for a mark of contact there."),
        shapes=shape_grids.end_stops, free_shapes=("place",), one_sided=True),
    Kind(name="angle_harmonic", at="connection", law="Harmonic", strengths=("cosine", "sine"), text=_T(
        "a force that repeats along the way", "A force with a fixed period in angle or position.",
        "Cogging of a motor, eccentric pulleys or gears, unbalance against gravity, pitch error of a screw or rack.",
        "Move at several speeds: the frequency of the ripple follows the speed; its period in angle stays."),
        shapes=shape_grids.orders, free_shapes=("order",), needs="travel"),
    Kind(name="added_inertia", at="connection", law="AddedInertia", strengths=("inertia",), text=_T(
        "inertia that is not in the model", "A resistance against acceleration.",
        "A payload, coupling, rotor, hose or fixture that was forgotten or changed.",
        "Accelerate harder: the extra force is proportional to the acceleration and absent at constant speed."),
        needs="ground"),
    Kind(name="slip", at="connection", law="Slip", strengths=("creep",), text=_T(
        "slip (creep)", "An elastic connection that gives way slowly under load.",
        "A belt or rope that creeps over its pulley, a clamp or press fit that slides.",
        "Mark both sides and run loaded: the marks drift apart."),
        shapes=shape_grids.spring, one_sided=True, linear=False, needs="stiffness", elastic=True, forms=(
        Kind(name="slip", at="transmission", law="creep_traction", strengths=("creep",), text=_T(
             "slip (creep) of a transmission", "A transmission that does not hold its ratio under load: the driven "
             "side stays behind in proportion to what it is driven with.",
             "A belt or rope that creeps over its pulley, friction wheels, a wheel on its track, a hub on a shaft.",
             "Mark both sides and run loaded: the marks drift apart, the faster the larger the load."),
             one_sided=True, linear=False),)),
    Kind(name="stribeck_load_friction", at="connection", law="StribeckLoadFriction", strengths=("share",), text=_T(
        "load-dependent friction at low speed", "Friction per load that falls while the motion gathers speed.",
        "Gear meshes, worm and harmonic drives that start under load, before the oil film carries.",
        "Start and creep with several payloads: the force to start rises with the load more than that at speed."),
        shapes=shape_grids.low_loaded_speeds, free_shapes=("v_stribeck", "v_s"), one_sided=True, needs="load",
        contains=("load_dependent_friction",)),
    Kind(name="directional_load_friction", at="connection", law="DirectionalLoadFriction",
         strengths=("driving", "resisting"), text=_T(
        "friction per load that depends on the direction of power", "Friction per load, of another size where the load "
        "drives the motion than where it resists.",
        "Worm gears, screws and harmonic drives, whose efficiency differs forwards and backwards.",
        "Lift and lower the same payload slowly: the friction, half the difference of the two forces, is not the same "
        "share of the load for another payload."),
        shapes=shape_grids.fading_sign, free_shapes=("v_s",), one_sided=True, needs="load",
        contains=("load_dependent_friction",),
        by_direction=True),
    Kind(name="quadratic_load_friction", at="connection", law="QuadraticLoadFriction", strengths=("curve",), text=_T(
        "friction that grows with the square of the load", "Dry friction whose level follows the squared force that "
        "passes through.",
        "Harmonic drives, worm gears and preloaded screws whose contact deforms under load.",
        "Repeat a slow motion with two and with four times the payload: this part of the friction rises four times "
        "between them."),
        shapes=shape_grids.fading_sign, free_shapes=("v_s",), one_sided=True, needs="load"),
    Kind(name="friction_drift", at="connection", law="FrictionDrift", strengths=("rate",), text=_T(
        "dry friction that changes with time", "Dry friction that rises or falls while the machine runs.",
        "Warming up, seals that settle, wear, lubricant that is squeezed out or spreads.",
        "Repeat one slow motion over and over: the jump of the drive force at reversal changes from one to the next."),
        shapes=shape_grids.since_begin_sign, needs="dry friction"),
    Kind(name="viscous_drift", at="connection", law="ViscousDrift", strengths=("rate",), text=_T(
        "viscous friction that changes with time", "A resistance per speed that rises or falls while the machine runs.",
        "Grease or oil that warms up, a damper that heats up or loses its fluid.",
        "Repeat one fast motion over and over from a cold start: the drive force at speed falls from one to the next."),
        shapes=shape_grids.since_begin, needs="viscous friction"),
    Kind(name="stiffness_drift", at="connection", law="StiffnessDrift", strengths=("rate",), text=_T(
        "a stiffness that changes with time", "A spring that softens or stiffens while the machine runs.",
        "Rubber that warms up, a clamp or screw that loosens, a crack that grows.",
        "Let the machine ring before and after a long run: the natural frequency has changed."),
        shapes=shape_grids.spring_since_begin, needs="stiffness", elastic=True),
    Kind(name="friction_with_temperature", at="connection", law="WarmFriction", strengths=("slope",), text=_T(
        "dry friction that changes with temperature", "Dry friction that follows a temperature of the machine.",
        "Clearances that close as parts expand, seals that soften, lubricant that thins.",
        "Repeat one slow motion cold and warm: the jump of the drive force at reversal differs."),
        shapes=shape_grids.fading_sign, needs="dry friction", signal="temperature"),
    Kind(name="viscous_with_temperature", at="connection", law="WarmViscous", strengths=("slope",), text=_T(
        "viscous friction that changes with temperature", "A resistance per speed that follows a temperature.",
        "Oil and grease: their viscosity halves within 10 to 20 K.",
        "Repeat one fast motion cold and warm: the drive force at speed differs."),
        needs="viscous friction", signal="temperature"),
    Kind(name="stiffness_with_temperature", at="connection", law="WarmStiffness", strengths=("slope",), text=_T(
        "a stiffness that changes with temperature", "A spring that softens or stiffens with temperature.",
        "Rubber and plastics, preload that changes as parts expand.",
        "Let the machine ring cold and warm: the natural frequency differs."),
        needs="stiffness", elastic=True, signal="temperature"),
    Kind(name="attached_mass", at="connection", law="AttachedMass", strengths=("mass",), text=_T(
        "a mass on a spring that is carried along", "A part that swings on its own spring and damper: a resonance that "
        "the model lacks.",
        "A tool, cable carrier, cover, tank or motor on an elastic mount; sloshing liquid; a soft joint.",
        "Knock on the machine or sweep the drive: one frequency rings that the model does not have. Touch parts by "
        "hand until it stops."),
        shapes=shape_grids.resonances, free_shapes=("natural_frequency", "damping_ratio"), one_sided=True,
        needs="ground",
        contains=("added_inertia",)),
    Kind(name="sensor_offset", at="sensor", law="offset", strengths=("offset",), text=_T(
        "a sensor offset", "The sensor reads too much or too little by a constant.",
        "Zero not set, temperature, mounting under stress, a homing position that moved.",
        "Read the sensor at a state that is known (unloaded, at the reference mark).")),
    Kind(name="sensor_gain", at="sensor", law="gain", strengths=("gain",), text=_T(
        "a sensor gain error", "The sensor reads too much or too little by a fixed share.",
        "Wrong calibration factor, another amplifier setting, a scale in other units.",
        "Apply two known values and compare the difference.")),
    Kind(name="sensor_delay", at="sensor", law="delay", strengths=("delay",), text=_T(
        "a sensor delay", "The sensor's signal comes late.",
        "Filters in the sensor or amplifier, bus cycles, channels that are sampled one after the other.",
        "Record a sharp event on this and a direct channel together and compare the instants."),
        one_sided=True),
    Kind(name="sensor_lag", at="sensor", law="lag", strengths=("lag",), text=_T(
        "a lag of the sensor", "The sensor follows late and smooths: a low-pass of first order, or one of another "
        "time constant than stated.",
        "An anti-aliasing or averaging filter, a thermometer in its sleeve, a pressure line, a slow amplifier.",
        "Step what is measured: the reading creeps to its end value in place of jumping late."),
        one_sided=True),
    Kind(name="sensor_drift", at="sensor", law="drift", strengths=("drift",), text=_T(
        "a sensor drift", "The sensor's reading creeps away with time.",
        "Warming up, integrators without reset, charge amplifiers.",
        "Leave the machine at rest and record for as long as a run takes.")),
    Kind(name="input_offset", at="input", law="offset", strengths=("offset",), text=_T(
        "an input offset", "What reaches the machine differs from what was recorded as input by a constant.",
        "Offset of an amplifier or analogue output, a zero that is not set.",
        "Command zero and measure at the machine.")),
    Kind(name="input_gain", at="input", law="gain", strengths=("gain",), text=_T(
        "an input gain error", "What reaches the machine differs from what was recorded as input by a fixed share.",
        "Another amplifier gain, torque constant or unit than assumed.",
        "Command two known values and measure at the machine.")),
    Kind(name="input_delay", at="input", law="delay", strengths=("delay",), text=_LATE_INPUT,
         one_sided=True, aliases=("controller_delay",), forms=(
        Kind(name="input_delay", at="signal", law="lag", strengths=("lag",), text=_LATE_CONTROL,
             shapes=shape_grids.filters, free_shapes=("filter",), one_sided=True),
        Kind(name="input_delay", at="connection", law="LateForce", strengths=("lag",), text=_LATE_CONTROL,
             shapes=shape_grids.filters, free_shapes=("filter",), one_sided=True, needs="drive"))),
    Kind(name="input_lag", at="input", law="lag", strengths=("lag",), text=_T(
        "a lag of an input", "What reaches the machine follows the recorded input late and smoothed.",
        "An amplifier or actuator of limited bandwidth, an output filter, a valve that opens slowly.",
        "Record command and response of the amplifier together: the response creeps to its end value."),
        shapes=shape_grids.filters, free_shapes=("filter",), one_sided=True),
    Kind(name="unknown_force", at="connection", law="Curve",
         strengths=tuple(f"curve.y[{k}]" for k in range(17)), text=_T(
        "a force that no entry of the catalogue explains", "A force that follows position, speed or time in a way "
        "that no simple law does; its curve is given by points.",
        "Something that nobody has put into the catalogue yet; the curve's shape is the clue.",
        "Measure the force directly at this connection, or repeat the run and see whether the curve comes back."),
        shapes=None),
])
# fmt: on
SHIPPED = tuple(_KINDS)
"""Names of the kinds that belong to this package; others are registered by whoever has them."""
