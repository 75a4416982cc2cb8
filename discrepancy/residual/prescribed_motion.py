"""A model with its measured motion given: which motions the sensors show, and the copy in which they are prescribed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.residual.inverse_parts import GivenAngle, GivenPosition

if TYPE_CHECKING:
    from discrepancy.problem.problem import Problem
    from multibody.machine.model import Model, System

__all__ = ["UNITS", "Motion", "cut_loops", "measured_motions", "prescribed", "shows_motion"]

UNITS = {"translation": ("m", "m/s", "m/s**2", "N"), "rotation": ("rad", "rad/s", "rad/s**2", "N*m")}


@dataclass(frozen=True)
class Motion:
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
        The position and rate states that become given.
    force : str
        Recorded force or torque that acts at the same place and nowhere else, or empty: it is then what the needed
        force is compared with, and no input any more.
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
        """Name of the output that is compared: the recorded force, else what is needed, to be compared with zero."""
        return self.force or self.needed

    @property
    def needed(self) -> str:
        """Name of the force or torque that the motion takes."""
        return f"needed.{self.place}.{'force' if self.domain == 'translation' else 'torque'}"


def cut_loops(model: Model, outputs: Sequence[str]) -> tuple[Model, tuple[str, ...]]:
    """Return a copy in which measured signals of controllers are inputs, and what then drives nothing is left out."""
    from multibody.declare.declarations import Output, Port

    other, cut = model.copy(), []
    for name in outputs:
        source = model.outputs.get(name, name)
        found = model.find(source)
        if found is None or not isinstance(found[1].declarations.get(found[2]), Output) or found[1].of_kind(Port):
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
    """Take out signal parts whose outputs feed nothing any more, and what only fed them."""
    from multibody.declare.declarations import Port

    while True:
        idle = [
            n
            for n, c in model.components.items()
            if not c.of_kind(Port)
            and not any(model.owner(e) == n for e in model.outputs.values())
            and not any(model.owner(ends[0]) == n or _outputs_of(model, ends, n) for ends in model.connections)
        ]
        if not idle:
            return
        for name in idle:
            model.remove(name)


def _outputs_of(model: Model, ends: Sequence[str], name: str) -> bool:
    from multibody.declare.declarations import Output

    for end in ends:
        found = model.find(end)
        if found is not None and found[0] == name and isinstance(found[1].declarations.get(found[2]), Output):
            return True
    return False


def free_motions(model: Model, system: System) -> dict[tuple[str, ...], tuple[str, str, str]]:
    """Return motions against the ground that nothing prescribes: (position, rate) states → (place, port, domain)."""
    labels = {}
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
                labels[states] = (place.name, port.name, place.domain)
    return labels


def measured_motions(
    model: Model, system: System, outputs: Sequence[str], recorded: Sequence[str], problem: Problem
) -> tuple[Motion, ...]:
    """Return the free motions that an output shows by itself, one output for each, positions before rates."""
    labels = free_motions(model, system)
    values = _affine(system, outputs, problem)
    found: dict[tuple[str, ...], Motion] = {}
    for order in (0, 1):
        for states, (name, flange, domain) in labels.items():
            if states in found:
                continue
            for output, (state, factor, offset) in values.items():
                if state == states[order]:
                    force = _force_at(model, flange, domain, recorded)
                    found[states] = Motion(name, flange, domain, output, order, factor, offset, states, force)  # type: ignore[arg-type]
                    break
    return tuple(found.values())


def _affine(system: System, outputs: Sequence[str], problem: Problem) -> dict[str, tuple[str, float, float]]:
    """Return the outputs that are ``offset + factor · state`` for one state, by name."""
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain if q.name in system.parameter_names})
    points = [system.start + shift * np.arange(1, system.start.size + 1) for shift in (0.0, 0.0137, -0.0291)]
    slopes = [system.jacobian("x", 0.0, x, None, p, of="outputs") for x in points]
    by_input = [system.jacobian("u", 0.0, x, None, p, of="outputs") for x in points]
    found = {}
    for name in outputs:
        c = system.index("output", name)
        row = slopes[0][c]
        used = np.flatnonzero(row)
        same = all(np.allclose(s[c], row, rtol=1e-9, atol=0.0) for s in slopes)
        if used.size == 1 and same and not any(np.any(b[c]) for b in by_input):
            k = int(used[0])
            y = system.outputs_at(0.0, points[0], None, p)[c]
            found[name] = (system.state_names[k], float(row[k]), float(y - row[k] * points[0][k]))
    return found


def shows_motion(system: System, outputs: Sequence[str], motions: Sequence[Motion]) -> set[str]:
    """Return the outputs that tell nothing but the motion that is given now."""
    given = np.array([system.index("state", s) for m in motions for s in m.states])
    x = system.start + 0.0137
    slopes = system.jacobian("x", 0.0, x, of="outputs")
    by_input = system.jacobian("u", 0.0, x, of="outputs")
    units = {"m", "rad", "m/s", "rad/s"}
    found = {m.output for m in motions}
    for name in outputs:
        c = system.index("output", name)
        others = np.delete(slopes[c], given)
        if system.unit(name) in units and not np.any(others) and not np.any(by_input[c]):
            found.add(name)
    return found


def _force_at(model: Model, port: str, domain: str, recorded: Sequence[str]) -> str:
    """Return the recorded input that acts as a force at a port's node and nowhere else, or an empty text."""
    from multibody.library import ForceSource, TorqueSource

    unit = UNITS[domain][3]
    node = next(p.first for p in model.places() if p.second is None and p.first.label.name == port)
    owners = {p.owner: p.component for p in node.ports}
    for name in recorded:
        targets = [model.find(t) for t in model.inputs[name].targets]
        if (
            targets
            and all(
                f is not None
                and f[0] in owners
                and getattr(f[1].declarations[f[2]], "unit", "") == unit
                and isinstance(f[1], ForceSource | TorqueSource)
                for f in targets
            )
            and len(targets) == 1
        ):
            return name
    return ""


def prescribed(model: Model, motions: Sequence[Motion]) -> Model:
    """Return a copy of the model in which these motions are given and the force that they need is an output."""
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
