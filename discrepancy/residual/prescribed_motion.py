"""The copy of a model in which the measured motions are prescribed, and which motions the sensors show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.residual.recorded_motion import GivenAngle, GivenPosition
from multibody.declare.declarations import Output, Port

if TYPE_CHECKING:
    from discrepancy.problem.problem import Problem
    from multibody.machine.model import Model, System

__all__ = [
    "UNITS",
    "MeasuredMotion",
    "cut_loops",
    "free_motions",
    "measured_motions",
    "outputs_of_motion",
    "with_prescribed_motion",
]

UNITS = {"translation": ("m", "m/s", "m/s**2", "N"), "rotation": ("rad", "rad/s", "rad/s**2", "N*m")}


@dataclass(frozen=True, kw_only=True)
class MeasuredMotion:
    """A free motion of the machine that a sensor shows.

    Parameters
    ----------
    place : str
        Name of what moves.
    port : str
        Endpoint at which the motion is prescribed.
    domain : {"translation", "rotation"}
    output : str
        Measured output: ``offset + factor · (position or rate)``.
    order : int
        0 when the output shows the position, 1 when the rate.
    factor, offset : float
    states : tuple of str
        The position and rate states that become prescribed.
    force : str
        Recorded force or torque that acts at the same place and nowhere else, or empty.  The needed force is compared
        with it, and it is no input any more.
    """

    place: str
    port: str
    domain: str
    output: str
    order: int
    factor: float
    offset: float
    states: tuple[str, str]
    force: str = ""

    @property
    def quantities(self) -> tuple[str, str, str]:
        """Names of position, rate and acceleration as model inputs."""
        words = ("position", "velocity") if self.domain == "translation" else ("angle", "speed")
        return (
            f"motion.{self.place}.{words[0]}",
            f"motion.{self.place}.{words[1]}",
            f"motion.{self.place}.acceleration",
        )

    @property
    def compared(self) -> str:
        """Name of the compared output: the recorded force, else the needed force, which is compared with zero."""
        return self.force or self.needed

    @property
    def needed(self) -> str:
        """Name of the force or torque that the motion needs."""
        return f"needed.{self.place}.{'force' if self.domain == 'translation' else 'torque'}"


def cut_loops(model: Model, outputs: Sequence[str]) -> tuple[Model, tuple[str, ...]]:
    """Return a copy in which measured signals of controllers are inputs, without components that then drive nothing."""
    other, cut = model.copy(), []
    for name in outputs:
        source = model.outputs.get(name, name)
        if not _is_output(model, source):
            continue
        fed = [e for ends in other.connections if source in ends for e in ends if e != source]
        if not fed:
            continue
        other.disconnect(source)
        if name in other.outputs:
            other.remove_output(name)
        other.input(name, *fed)
        cut.append(name)
    if cut:
        _prune(other)
    return other, tuple(cut)


def _prune(model: Model) -> None:
    """Remove signal components whose outputs feed nothing any more, and those that only fed them."""
    while True:
        unused = [
            n
            for n, c in model.components.items()
            if not c.of_kind(Port)
            and not any(model.owner(e) == n for e in model.outputs.values())
            and not any(_drives(model, n, ends) for ends in model.connections)
        ]
        if not unused:
            return
        for name in unused:
            model.remove(name)


def _drives(model: Model, name: str, ends: Sequence[str]) -> bool:
    """Tell whether a component drives the other ends of a connection."""
    return model.owner(ends[0]) == name or any(model.owner(e) == name and _is_output(model, e) for e in ends)


def _is_output(model: Model, endpoint: str) -> bool:
    """Tell whether an endpoint is the output of a component without ports, such as a controller."""
    target = model.find(endpoint)
    if target is None or target[1].of_kind(Port):
        return False
    return isinstance(target[1].declarations.get(target[2]), Output)


def free_motions(model: Model, system: System) -> dict[tuple[str, ...], tuple[str, str, str]]:
    """Return free motions against the ground: (position, rate) states → (place, port, domain)."""
    motions = {}
    for place in model.places():
        if place.second is None and place.first.prescriber is None:
            port = place.first.label
            if port.coordinate:
                names = [n for n, _ in port.component.coordinate_states(port.coordinate)]  # type: ignore[attr-defined]
            else:
                words = ("position", "velocity") if place.domain == "translation" else ("angle", "speed")
                names = [w if f"{port.owner}.{w}" in system.state_names else f"{port.port_name}_{w}" for w in words]
            states = tuple(f"{port.owner}.{n}" for n in names)
            if all(s in system.state_names for s in states):
                motions[states] = (place.name, port.name, place.domain)
    return motions


def measured_motions(
    model: Model, system: System, outputs: Sequence[str], recorded: Sequence[str], problem: Problem
) -> tuple[MeasuredMotion, ...]:
    """Return the free motions that an output shows by itself, one output for each, positions before rates."""
    free = free_motions(model, system)
    values = _affine(system, outputs, problem)
    motions: dict[tuple[str, ...], MeasuredMotion] = {}
    for order in (0, 1):
        for states, (name, flange, domain) in free.items():
            if states in motions:
                continue
            for output, (state, factor, offset) in values.items():
                if state == states[order]:
                    motions[states] = MeasuredMotion(
                        place=name,
                        port=flange,
                        domain=domain,
                        output=output,
                        order=order,
                        factor=factor,
                        offset=offset,
                        states=states,  # type: ignore[arg-type]
                        force=_force_at(model, flange, domain, recorded),
                    )
                    break
    return tuple(motions.values())


def _affine(system: System, outputs: Sequence[str], problem: Problem) -> dict[str, tuple[str, float, float]]:
    """Return the outputs that are ``offset + factor · state`` for one state, by name."""
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain if q.name in system.parameter_names})
    points = [system.start + shift * np.arange(1, system.start.size + 1) for shift in (0.0, 0.0137, -0.0291)]
    slopes = [system.jacobian("x", 0.0, x, None, p, of="outputs") for x in points]
    by_input = [system.jacobian("u", 0.0, x, None, p, of="outputs") for x in points]
    affine = {}
    for name in outputs:
        c = system.index("output", name)
        row = slopes[0][c]
        used = np.flatnonzero(row)
        same = all(np.allclose(s[c], row, rtol=1e-9, atol=0.0) for s in slopes)
        if used.size == 1 and same and not any(np.any(b[c]) for b in by_input):
            k = int(used[0])
            y = system.outputs_at(0.0, points[0], None, p)[c]
            affine[name] = (system.state_names[k], float(row[k]), float(y - row[k] * points[0][k]))
    return affine


def outputs_of_motion(system: System, outputs: Sequence[str], motions: Sequence[MeasuredMotion]) -> set[str]:
    """Return the outputs that depend on nothing but the prescribed motion."""
    prescribed = np.array([system.index("state", s) for m in motions for s in m.states])
    x = system.start + 0.0137
    slopes = system.jacobian("x", 0.0, x, of="outputs")
    by_input = system.jacobian("u", 0.0, x, of="outputs")
    units = {"m", "rad", "m/s", "rad/s"}
    shown = {m.output for m in motions}
    for name in outputs:
        c = system.index("output", name)
        others = np.delete(slopes[c], prescribed)
        if system.unit(name) in units and not np.any(others) and not np.any(by_input[c]):
            shown.add(name)
    return shown


def _force_at(model: Model, port: str, domain: str, recorded: Sequence[str]) -> str:
    """Return the recorded input that acts as a force at a port's node and nowhere else, or an empty text."""
    from multibody.library import ForceSource, TorqueSource

    unit = UNITS[domain][3]
    node = next(p.first for p in model.places() if p.second is None and p.first.label.name == port)
    owners = {p.owner for p in node.ports}
    for name in recorded:
        targets = [model.find(t) for t in model.inputs[name].targets]
        if len(targets) != 1 or targets[0] is None:
            continue
        owner, component, input_name = targets[0]
        is_source = isinstance(component, ForceSource | TorqueSource)
        if owner in owners and is_source and getattr(component.declarations[input_name], "unit", "") == unit:
            return name
    return ""


def with_prescribed_motion(model: Model, motions: Sequence[MeasuredMotion]) -> Model:
    """Return a copy of the model in which these motions are prescribed and the force that they need is an output."""
    other = model.copy()
    for m in motions:
        part = f"needed.{m.place}"
        cls = GivenPosition if m.domain == "translation" else GivenAngle
        other.add(part, cls())
        other.connect(f"{part}.flange", m.port)
        for name in m.quantities:
            other.input(name, f"{part}.{name.rpartition('.')[2]}")
        if m.force:
            entry = other.remove_input(m.force)
            other.input(f"idle.{m.force}", *entry.targets, default=0.0)
            other.output(m.force, m.needed)
    states = {s for m in motions for s in m.states}
    for name, source in other.outputs.items():
        if source in states:
            other.remove_output(name)
    return other
