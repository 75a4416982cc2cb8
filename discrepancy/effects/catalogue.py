"""What might be missing: every kind of effect at every place, part and signal of a machine where it makes sense."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from discrepancy.effects.kinds import Kind, kind_named, kinds
from discrepancy.effects.signal_errors import SignalLag
from discrepancy.effects.slip_of_transmissions import can_slip, domain_of
from multibody.declare.declarations import Input, Output, Rotation, State, Translation
from multibody.model.driving_signals import driving_signals

if TYPE_CHECKING:
    from multibody.assembly.places import Place
    from multibody.machine.model import System

__all__ = ["Entry", "catalogue", "has_friction"]

#: What a part has that is a friction: the speed below which dry friction fades, or the displacement before it slides,
#: or a friction per speed.
FRICTION = {"dry friction": ("v_s", "x_s"), "viscous friction": ("viscous", "damping")}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A kind of effect at a place (connections), at a signal (sensors, inputs, controllers), in a part or in its place.

    Parameters
    ----------
    kind : Kind
    where : str
    place : Place or None
    stiffness : str
        Parameter that gives the connection its own stiffness, or empty.
    load : str
        Output that carries the load or the temperature that the law takes, or empty.
    stated : tuple of float
        Values that were stated, of a kind whose strengths are such.
    domain : str
        ``"translation"`` or ``"rotation"``: of the driven side, of a kind that replaces a transmission.
    """

    kind: Kind
    where: str
    place: Place | None = None
    stiffness: str = ""
    load: str = ""
    stated: tuple[float, ...] = ()
    domain: str = ""

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind.name}@{self.where}"

    @property
    def key(self) -> str:
        """The name, and the law: a kind may have two at one place."""
        return f"{self.name}:{self.kind.law}"

    def matches(self, pattern: str) -> bool:
        """Tell whether a shell pattern over ``kind`` or ``kind@where`` names this entry (or other names of a place)."""
        also = self.place.also if self.place is not None and self.where == self.place.name else ()
        called = (self.kind.name, *kind_named(self.kind.name).aliases)
        names = [*called, *(f"{kind}@{where}" for kind in called for where in (self.where, *also))]
        return any(fnmatchcase(name, pattern) for name in names)


def catalogue(
    system: System,
    outputs: Sequence[str],
    inputs: Sequence[str],
    *,
    include: Sequence[str] = ("*",),
    exclude: Sequence[str] = (),
    every_law: bool = False,
) -> list[Entry]:
    """Return every effect that fits the machine's topology and its measured signals.

    Parameters
    ----------
    system : System
        Built with probes.
    outputs, inputs : sequence of str
        Measured outputs and recorded inputs.
    include, exclude : sequence of str
        Shell patterns over ``kind`` or ``kind@where``.
    every_law : bool
        With two entries of one name where a kind has two laws at a place; by default the first.
    """
    entries: list[Entry] = []
    controlled = [
        s for s in driving_signals(system.model) if f"probe.{s}" in system.input_names and not _late(s, system)
    ]
    for kind in (form for whole in kinds().values() for form in (whole, *whole.forms)):
        if kind.free_form:
            continue  # offered by `discrepancy.sensitivities.free_curve_scan` where no law is good enough
        if kind.needs == "drive":
            entries += _at_drives(kind, system)
        elif kind.at == "connection":
            entries += [e for place in system.places if (e := _at_place(kind, place, system)) is not None]
        elif kind.at == "parameter":
            entries += _built_in(kind, system)
        elif kind.at == "transmission":
            parts = {name: part for name, part in system.model.components.items() if can_slip(part)}
            entries += [Entry(kind=kind, where=name, domain=domain_of(part)) for name, part in parts.items()]
        elif kind.at == "signal":
            entries += [Entry(kind=kind, where=name) for name in controlled]
        elif kind.at == "sensor":
            entries += [Entry(kind=kind, where=name) for name in outputs]
        else:
            entries += [Entry(kind=kind, where=name) for name in inputs]
    if not every_law:
        entries = list({e.name: e for e in reversed(entries)}.values())[::-1]
    return [e for e in entries if any(e.matches(p) for p in include) and not any(e.matches(p) for p in exclude)]


def _late(signal: str, system: System) -> bool:
    """Tell whether a signal comes from a lag that an effect has put in: its place goes when that effect goes."""
    return isinstance(system.model.components.get(signal.rpartition(".")[0]), SignalLag)


def _built_in(kind: Kind, system: System) -> list[Entry]:
    """Return where components have an effect in them whose strengths are zero, or values that may be stated wrongly."""
    entries = []
    for name, component in system.model.components.items():
        if kind.component is None or not isinstance(component, kind.component):
            continue
        for side, ending in kind.sides or (("", ""),):
            values = [component.values.get(f"{s}{ending}") for s in kind.strengths]
            where = f"{name}.{side}" if side else name
            if kind.stated and all(v for v in values):
                entries.append(Entry(kind=kind, where=where, stated=tuple(map(float, values))))  # type: ignore[arg-type]
            elif not kind.stated and all(v == 0.0 for v in values):
                entries.append(Entry(kind=kind, where=where))
    return entries


def _at_drives(kind: Kind, system: System) -> list[Entry]:
    """Return the parts that drive the machine by a law of their own, such as a controller with its motor in one part.

    Such a part has an input, a state, one flange without inertia, and an output that says its force.
    """
    entries = []
    for place in system.places:
        if place.second is not None:
            continue
        for port in place.first.ports:
            part = port.component
            flanges = part.of_kind(Translation | Rotation)  # type: ignore[arg-type]
            own = f"{port.owner}." if part.of_kind(Input) and part.of_kind(State) and len(flanges) == 1 else ""
            forces = [n for n, o in part.of_kind(Output).items() if o.unit == place.force_unit]
            if own and forces and port not in place.first.inertial and own + forces[0] in system.output_names:
                entries.append(Entry(kind=kind, where=port.owner, place=place, load=own + forces[0]))
    return entries


def _at_place(kind: Kind, place: Place, system: System) -> Entry | None:
    # a motion that is named by a body's axis or port is no connection with a stiffness of its own
    component = system.model.components.get(place.name)
    stiffness = f"{place.name}.stiffness" if component is not None and "stiffness" in component.values else ""
    if kind.elastic is not None and kind.elastic != bool(stiffness):
        return None
    if kind.needs == "stiffness" and not stiffness:
        return None
    if kind.needs == "ground" and (place.second is not None or not place.first.inertial):
        return None
    if kind.needs == "travel" and stiffness and place.second is not None:
        return None
    if kind.law == "AddedInertia" and place.second is not None:
        return None
    if kind.needs in FRICTION and not has_friction(place, system, kind.needs):
        return None
    load = ""
    if kind.law_input:
        load = _load_at(place, system) if kind.law_input == "load" else _temperature_in(system)
        if not load:
            return None
    return Entry(kind=kind, where=place.name, place=place, stiffness=stiffness, load=load)


def has_friction(place: Place, system: System, which: str) -> bool:
    """Tell whether a part between the two sides of a place, an effect included, has one of the kinds of `FRICTION`."""
    names = FRICTION[which]
    parts = (system.model.components.get(name) for name in (place.name, *place.also))
    return any(part is not None and any(n in part.values for n in names) for part in parts)


def _temperature_in(system: System) -> str:
    """Return the first output of a part that is a temperature."""
    for owner, component in system.model.components.items():
        for name, item in component.declarations.items():
            if isinstance(item, Output) and item.unit == "K" and f"{owner}.{name}" in system.output_names:
                return f"{owner}.{name}"
    return ""


def _load_at(place: Place, system: System) -> str:
    """Return the output of a part on the same node that says which force or torque it brings there.

    What acts between the two sides themselves, a friction that the model has there for instance, does not pass through.
    """
    unit = place.force_unit
    best = ""
    for port in place.first.ports:
        if port.owner in (place.name, *place.also) or "_friction." in port.owner:
            continue
        for name, item in port.component.declarations.items():
            if isinstance(item, Output) and item.unit == unit and f"{port.owner}.{name}" in system.output_names:
                best = best or f"{port.owner}.{name}"
    return best
