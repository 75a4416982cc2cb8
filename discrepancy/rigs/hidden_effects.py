"""Effects to hide in a virtual rig: what fits the machine, how large it is, and its entry in ``truth.json``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect, law_class
from discrepancy.effects.kinds import kinds
from discrepancy.effects.shape_grids import MotionRange
from discrepancy.effects.uncatalogued_laws import OVER, UNKNOWN_LAWS
from discrepancy.rigs.recording import BenchError
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.signature import written_docstring
from multibody.machine.model import Model

__all__ = [
    "UNKNOWN",
    "Hidden",
    "Scale",
    "SignalScale",
    "choose",
    "draw_effect",
    "misstated",
    "strengths_of",
    "unknown_effect",
]

UNKNOWN = "unknown_force"


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Scales of motion and force at a place of a rig, from which the size of an effect follows.

    Parameters
    ----------
    motion : MotionRange
    acceleration : float
        95th percentile of its absolute value, m/s² or rad/s².
    force : float
        A force or torque that shows clearly in the outputs, N or N m.
    load : float
        95th percentile of the force that passes through, N or N m.
    duration : float
        Of a record, s.
    """

    motion: MotionRange
    acceleration: float
    force: float
    load: float
    duration: float


@dataclass(frozen=True)
class SignalScale:
    """Scales of a signal of a rig.

    Parameters
    ----------
    visible : float
        An error that shows clearly, in the signal's unit.
    span : float
        From its least to its largest value.
    rate : float
        95th percentile of the absolute rate, per s.
    duration : float
        Of a record, s.
    """

    visible: float
    span: float
    rate: float
    duration: float


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """An effect that a rig has and the model lacks: of a kind in the catalogue or not.

    ``stated`` has the values that the model has in place of strengths that are parameters of it.
    """

    effect: Effect | None = None
    where: str = ""
    component: Component | None = None
    ports: tuple[str, str] = ("", "")
    over: str = ""
    stated: tuple[float, ...] = ()

    def added_to(self, model: Model) -> Model:
        """Return a copy of the model with the effect in it; errors of sensors leave it as it is."""
        if self.effect is not None:
            return self.effect.added_to(model)
        assert self.component is not None
        other = model.copy()
        part = other.add(f"{UNKNOWN}.{self.where}", self.component)
        other.connect(part.a, self.ports[0])
        other.connect(part.b, self.ports[1])
        return other

    @property
    def memory(self) -> tuple[str, ...]:
        """States of the machine with the effect in it that keep what was before: at rest nothing says what they are."""
        if self.effect is None or self.effect.definition.at != "connection":
            return ()
        law = law_class(self.effect.definition, self.effect.domain)
        return tuple(f"{self.effect.component_name}.{n}" for n in getattr(law, "memory", ()))

    def truth(self, units: Mapping[str, str]) -> dict[str, Any]:
        """Return kind, place and parameters as ``truth.json`` holds them, given the units of signals."""
        if self.effect is None:
            assert self.component is not None
            declared: Mapping[str, Any] = self.component.declarations
            values = {n: {"value": v, "unit": _plain(declared[n].unit)} for n, v in self.component.values.items()}
            law = written_docstring(type(self.component)).strip()
            return {"kind": UNKNOWN, "where": self.where, "over": self.over, "law": law, "parameters": values}
        effect = self.effect
        own = units.get(effect.where, "")
        extra = {"offset": own, "drift": f"{own}/s"} if effect.definition.at != "connection" else {}
        parameters = {
            n: {"value": float(v), "unit": extra.get(n) or _plain(effect.unit(n))}
            for n, v in {**effect.strengths, **effect.shape}.items()
        }
        for name, value in zip(effect.strengths, self.stated, strict=False):
            parameters[name]["stated"] = value
        return {"kind": effect.kind, "where": effect.where, "parameters": parameters}


def strengths_of(truth: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return those parameters of an effect, as `Hidden.truth` gives it, that say how strong it is."""
    names = ("level",) if truth["kind"] == UNKNOWN else kinds()[truth["kind"]].every_strength
    return {n: v for n, v in truth["parameters"].items() if n in names}


def _plain(unit: str) -> str:
    """Return a unit without brackets that stand around all of it or around a product at its beginning.

    Examples
    --------
    >>> _plain("(m/s)"), _plain("(N*m)/rad"), _plain("(rad/s)/(N*m)")
    ('m/s', 'N*m/rad', '(rad/s)/(N*m)')
    """
    return re.sub(r"^\(([^()]*)\)$|^\(([^()/]*)\)", lambda m: m[1] or m[2], unit)


# -------------------------------------------------------------------- choice


def choose(
    asked: Sequence[str], entries: Sequence[Entry], machine: str, prefer: Sequence[str] = ()
) -> list[Entry | str]:
    """Return the entries that ``KIND`` or ``KIND@WHERE`` name, or the place of an unknown force.

    Parameters
    ----------
    asked : sequence of str
    entries : sequence of Entry
        Everything that fits the machine.
    machine : str
        Its name, for messages.
    prefer : sequence of str
        Places to take first where none is named.

    Raises
    ------
    BenchError
        With every kind that does not exist, does not fit the machine or the place, or is named twice.
    """
    faults: list[str] = []
    chosen: list[Entry | str] = []
    seen: set[str] = set()
    places = list(dict.fromkeys(e.where for e in entries if e.kind.at == "connection"))
    for text in asked:
        kind, at, where = text.strip().partition("@")
        fitting = [e for e in entries if e.kind.name == kind]
        where_fits = places if kind == UNKNOWN else [e.where for e in fitting]
        if kind != UNKNOWN and kind not in kinds():
            faults.append(
                f"--hide {text}: there is no effect '{kind}'{nearest(kind, [*kinds(), UNKNOWN])}; --list shows all"
            )
        elif not where_fits:
            faults.append(f"--hide {text}: '{kind}' fits no part of the {machine}; --list shows what does")
        elif at and (full := _place_named(where, where_fits, entries)) is None:
            known = {e.where for e in entries} | {w for e in entries if e.place is not None for w in e.place.also}
            reason = "does not fit there" if where in known else "there is no such place"
            faults.append(f"--hide {text}: {reason}; {kind} fits {', '.join(where_fits)}")
        else:
            place = full if at else min(where_fits, key=lambda w: prefer.index(w) if w in prefer else len(prefer))
            assert place is not None
            if f"{kind}@{place}" in seen:
                faults.append(f"--hide {text}: asked for twice: change its size with --strength instead")
            seen.add(f"{kind}@{place}")
            chosen.append(place if kind == UNKNOWN else next(e for e in fitting if e.where == place))
    if faults:
        raise BenchError(faults)
    return chosen


def _place_named(where: str, places: Sequence[str], entries: Sequence[Entry]) -> str | None:
    if where in places:
        return where
    return next(
        (e.where for e in entries if e.where in places and e.place is not None and where in e.place.also),
        None,
    )


# -------------------------------------------------------------------- sizes


_Sizes = Callable[[Scale], dict[str, float]]
_SIZES: dict[str, _Sizes] = {
    "viscous_friction": lambda s: {"viscous": s.force / s.motion.speed},
    "extra_damping": lambda s: {"viscous": 1.5 * s.force / s.motion.speed},
    "coulomb_friction": lambda s: {"coulomb": s.force},
    "asymmetric_coulomb_friction": lambda s: {"forward": 1.3 * s.force, "backward": 0.6 * s.force},
    "asymmetric_viscous_friction": lambda s: {
        "forward": 1.3 * s.force / s.motion.speed,
        "backward": 0.5 * s.force / s.motion.speed,
    },
    "stribeck_friction": lambda s: {"breakaway": 2.0 * s.force},
    "quadratic_drag": lambda s: {"drag": s.force / s.motion.speed**2},
    "load_dependent_friction": lambda s: {"share": min(s.force / s.load, 0.3)},
    "position_dependent_friction": lambda s: {"slope": 0.6 * s.force, "bow": 0.3 * s.force},
    "constant_force": lambda s: {"push": s.force},
    "linear_stiffness": lambda s: {"stiffness": (2.0 if s.motion.scale else 1.0) * s.force / s.motion.half},
    "cubic_stiffness": lambda s: {"stiffness": (6.0 if s.motion.scale else 1.5) * s.force / s.motion.half**3},
    "backlash": lambda s: {"gap": 0.5 * s.motion.half},
    "hysteresis": lambda s: {"level": s.force},
    # Over the range of a spring, more than this would outweigh the spring and throw it out of its range.
    "position_dependent_force": lambda s: {
        "bow": s.force * (0.3 if s.motion.scale else 1.0),
        "wave": s.force * (0.02 if s.motion.scale else 0.6),
    },
    "local_bump": lambda s: {"level": 3.0 * s.force},
    "end_stop": lambda s: {"stiffness": 10.0 * s.force / s.motion.half},
    "angle_harmonic": lambda s: {"cosine": 0.8 * s.force, "sine": 0.8 * s.force},
    "added_inertia": lambda s: {"inertia": 1.5 * s.force / s.acceleration},
    "slip": lambda s: {"creep": 6.0 / (s.motion.scale * s.duration)},
    "stribeck_load_friction": lambda s: {"share": min(2.0 * s.force / s.load, 0.3)},
    "directional_load_friction": lambda s: {
        "driving": min(1.3 * s.force / s.load, 0.3),
        "resisting": min(0.4 * s.force / s.load, 0.3),
    },
    "quadratic_load_friction": lambda s: {"curve": min(s.force / s.load, 0.3) / s.load},
    "friction_drift": lambda s: {"rate": 2.0 * s.force / s.duration},
    "viscous_drift": lambda s: {"rate": 2.0 * s.force / (s.motion.speed * s.duration)},
    "stiffness_drift": lambda s: {"rate": 2.0 * s.force / (s.motion.half * s.duration)},
    "attached_mass": lambda s: {"mass": 1.5 * s.force / s.acceleration},
}
_MISSTATED = 0.25  # share of the smaller by which a stated and a true value differ
_SIGNED = frozenset(("push", "bow", "wave", "slope", "cosine", "sine", "offset", "gain", "drift"))
_SIGNAL_SIZES: dict[str, Callable[[SignalScale], float]] = {
    "offset": lambda s: s.visible,
    "gain": lambda s: 2.0 * s.visible / s.span,
    "drift": lambda s: 2.0 * s.visible / s.duration,
    "delay": lambda s: s.visible / s.rate,
    "lag": lambda s: 2.0 * s.visible / s.rate,
}


def draw_effect(
    entry: Entry,
    scale: Scale | SignalScale,
    rng: np.random.Generator,
    *,
    strength: float = 1.0,
    regularisation: float = 0.8,
    spread: float = 0.2,
) -> Effect:
    """Return an effect of a kind with strengths around a size that shows clearly.

    Parameters
    ----------
    entry : Entry
        Kind and place.
    scale : Scale, or SignalScale for a sensor or input
        What is large there.
    rng : Generator
    strength : float
        Factor on the usual size.
    regularisation : float
        Speed at which dry friction fades, as a share of what the catalogue takes.
    spread : float
        Sizes are drawn within this share of the usual one.
    """
    if isinstance(scale, SignalScale):
        name = entry.kind.strengths[0]
        size = _drawn(name, strength * _SIGNAL_SIZES[name](scale), rng, spread)
        # A lag behind a filter of the same time is a low-pass of first order, behind one of half of it nearly a delay.
        shape = {"filter": (0.5 if entry.kind.at == "signal" else 1.0) * size} if entry.kind.inserted else {}
        return Effect(kind=entry.kind.name, where=entry.where, strengths={name: size}, shape=shape)
    sizes = _SIZES.get(entry.kind.name)
    if sizes is None:
        raise BenchError([f"'{entry.kind.name}' has no usual size on a virtual rig: it cannot be hidden there"])
    strengths = {n: _drawn(n, strength * v, rng, spread) for n, v in sizes(scale).items()}
    assert entry.place is not None
    # The catalogue's shapes may hold more than the law has: steps of the scan, for instance.
    known = law_class(entry.kind, entry.place.domain).declarations
    shape = {n: v for n, v in _shape(entry, scale.motion, rng).items() if n in known}
    if "v_s" in shape:
        shape["v_s"] *= regularisation
    return Effect.at_place(entry.kind.name, entry.place, strengths=strengths, shape=shape, load=entry.load)


def misstated(entry: Entry, rng: np.random.Generator, *, strength: float = 1.0, spread: float = 0.2) -> Effect:
    """Return a parameter that is not what the model says, by about a quarter; arguments as of `draw_effect`."""
    factor = (1.0 + _MISSTATED * strength * rng.uniform(1.0 - spread, 1.0 + spread)) ** rng.choice((-1, 1))
    values = {n: float(v * factor) for n, v in zip(entry.kind.strengths, entry.stated, strict=True)}
    return Effect(kind=entry.kind.name, where=entry.where, strengths=values)


def _drawn(name: str, size: float, rng: np.random.Generator, spread: float) -> float:
    sign = rng.choice((-1.0, 1.0)) if name in _SIGNED else 1.0
    return float(sign * size * rng.uniform(1.0 - spread, 1.0 + spread))


def _shape(entry: Entry, motion: MotionRange, rng: np.random.Generator) -> dict[str, float]:
    """Draw a shape between the points that the catalogue would try, so that no trial can be exactly right."""
    shapes = entry.kind.shape_grid(motion)
    first = shapes[int(rng.integers(len(shapes)))]
    shape = dict(first)
    if "order" in shape:  # a wave shorter than the travel, as a pitch error or cogging; whole orders on a shaft
        whole = motion.turns and motion.high - motion.low > math.pi
        shape["order"] = (
            float(rng.integers(1, 7)) if whole else 2.0 * math.pi * rng.uniform(2.0, 8.0) / (2.0 * motion.half)
        )
    if "v_stribeck" in shape:
        shape["v_stribeck"] = float(motion.speed * 10.0 ** rng.uniform(-1.3, -0.6))
    if "x_s" in shape:
        shape["x_s"] = float(motion.half * 10.0 ** rng.uniform(-2.3, -1.3))
    if "place" in shape:
        shape["place"] = float(motion.centre + 0.6 * motion.half * rng.uniform(-1.0, 1.0))
        shape["width"] = float(motion.half * rng.uniform(0.05, 0.12))
    if "natural_frequency" in shape:  # between two points of the grid, and ringing less than the scan assumes
        shape["natural_frequency"] *= float(rng.uniform(0.9, 1.1))
        shape["damping_ratio"] *= float(rng.uniform(0.6, 1.2))
    if entry.kind.name == "backlash":
        shape["centre"] = 0.0
    return shape


# -------------------------------------------------------------------- a force of no known kind


def unknown_effect(
    entry: Entry,
    over: str,
    scale: Scale,
    rng: np.random.Generator,
    *,
    strength: float = 1.0,
    spread: float = 0.2,
) -> Hidden:
    """Return a force that no kind of the catalogue describes.

    Parameters
    ----------
    entry : Entry
        Any entry of the place.
    over : {"position", "speed", "time"}
        What the force is a function of.

    Raises
    ------
    BenchError
        If ``over`` is something else.
    """
    if over not in OVER:
        raise BenchError([f"an unknown force can depend on {', '.join(OVER)}, not on '{over}'{nearest(over, OVER)}"])
    place, motion = entry.place, scale.motion
    assert place is not None
    level = float(rng.choice((-1.0, 1.0)) * 1.5 * strength * scale.force * rng.uniform(1.0 - spread, 1.0 + spread))
    a, b = rng.uniform(-1.0, 1.0), rng.uniform(0.8, 1.25)
    values = {
        "position": {
            "level": level,
            "centre": motion.centre + 0.3 * a * motion.half,
            "width": 0.12 * b * motion.half,
        },
        "speed": {"level": level, "v_half": 0.3 * b * motion.speed},
        "time": {
            "level": level,
            "t_middle": (0.5 + 0.2 * a) * scale.duration,
            "t_half": 0.2 * b * scale.duration,
        },
    }[over]
    cls = UNKNOWN_LAWS[over][0 if place.domain == "translation" else 1]
    return Hidden(
        effect=None, where=entry.where, component=cls(**values), ports=(place.first_port, place.second_port), over=over
    )
