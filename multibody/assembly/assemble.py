"""From a checked model to its equations: named states, inputs, parameters, outputs and a set of statements."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from multibody.assembly.dynamics import accelerations, total
from multibody.assembly.equation_set import Assembly, Quantity, Unknown
from multibody.assembly.kinematics import Kinematics
from multibody.assembly.node_motion import resolve_nodes
from multibody.assembly.places import Place, places_of
from multibody.assembly.spatial.tree import assemble_spatial
from multibody.base.errors import EquationError, ModelError
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Output, Parameter, Power, State
from multibody.declare.declarations import Unknown as UnknownDeclaration
from multibody.equations import tables
from multibody.equations.reading import method_statements
from multibody.equations.scope import Scope
from multibody.equations.statements import Statement, variable
from multibody.model.driving_signals import driving_signals
from multibody.model.features import feature_outputs
from multibody.model.graph import ModelGraph, ModelInput
from multibody.model.network import Network, network

__all__ = ["assemble", "find_places", "with_outputs"]


def assemble(
    model: ModelGraph, *, probes: bool = False, energy: bool = False, outputs: Iterable[str] | None = None
) -> Assembly:
    """Check a model and write down its equations.

    Parameters
    ----------
    model : Model
        The machine.
    probes : bool
        Add an input ``probe.<place>`` for every place where an effect could act (a force, equal and opposite
        on the two sides), and outputs of the relative motion there; and one for every signal by which control acts on
        the machine, such as ``probe.control.output``, which is added to it.
    energy : bool
        Add states that integrate the power lost and supplied, so that an energy balance is as exact as the
        motion.
    outputs : iterable of str, optional
        Keep only these outputs.

    Raises
    ------
    ModelError
        With every fault.
    """
    net, work, kinematics = _resolved(model)
    if probes:
        _probes(work, kinematics)
    if not work.faults:
        kinematics.balance(work)
        accelerations(work)
        _energies(model, work, energy)
        _show(model, net, work, _signal_probes(model, work) if probes else {})
    if work.faults:
        raise ModelError(model.name, work.faults)
    _rename(work)
    return work if outputs is None else with_outputs(work, model, outputs)


def with_outputs(work: Assembly, model: ModelGraph, outputs: Iterable[str]) -> Assembly:
    """Return a model's equations with these outputs and those that limit the steps of a simulation.

    Raises
    ------
    ModelError
        If there is no such output.
    """
    needed = [name for owner, part in model.components.items() for name in part.needed_outputs(owner)]
    names, known = [*outputs, *feature_outputs(model), *needed], {q.name: q for q in work.outputs}
    if faults := [f"there is no output '{n}'{nearest(n, known)}" for n in names if n not in known]:
        raise ModelError(model.name, faults)
    return replace(work, outputs=[known[n] for n in dict.fromkeys(names)])


def find_places(model: ModelGraph) -> list[Place]:
    """Return where an effect could act on a model, without assembling its equations."""
    _, work, _ = _resolved(model)
    if work.faults:
        raise ModelError(model.name, work.faults)
    return work.places


def _resolved(model: ModelGraph) -> tuple[Network, Assembly, Kinematics]:
    """Check a model, read its equations and decide how its nodes move."""
    net = network(model)
    work = Assembly(name=model.name)
    _components(model, net, work)
    if net.faults or work.faults:
        raise ModelError(model.name, dict.fromkeys([*net.faults, *work.faults]))
    kinematics = resolve_nodes(model, net, work)
    if net.frames or any(node.axes for node in net.nodes):
        assemble_spatial(model, net, kinematics, work)
    work.places = places_of(model, net, kinematics.moves)
    return net, work, kinematics


def _components(model: ModelGraph, net: Network, work: Assembly) -> None:
    """Parameters, states, signals and equations of every component."""
    for owner, component in model.components.items():
        scope = Scope(owner, component, work.kernels)
        for item in component.declarations.values():
            if isinstance(item, Parameter) and item.name in component.values:
                work.parameter(
                    f"{owner}.{item.name}",
                    item.unit,
                    item.meaning,
                    component.values[item.name],
                    min=item.min,
                    max=item.max,
                )
            elif item.name in component.tables:
                _table(work, owner, item, component.tables[item.name])
        for name, state in component.of_kind(State).items():
            var = variable(owner, name)
            start = component.starts.get(name, state.start)  # absent where the value given was at fault
            bounds: dict[str, Any] = {"value": start, "min": state.min, "max": state.max}
            work.states.append(
                Quantity(name=f"{owner}.{name}", unit=state.unit, meaning=state.meaning, variable=var, **bounds)
            )
            work.derivatives[var] = variable(owner, "_der", name)
        for name, item in component.of_kind(UnknownDeclaration).items():
            work.unknowns.append(Unknown(f"{owner}.{name}", variable(owner, name), variable(owner, "_zero", name)))
            work.output(f"{owner}.{name}", item.unit, item.meaning, variable(owner, name))
        before = len(work.statements)
        try:
            work.statements += method_statements(scope, "equations")
        except EquationError as error:
            work.faults += str(error).splitlines()
            before = -1
        hook = getattr(component, "assemble", None)
        if hook is not None and not component.faults:
            hook(owner, work)  # equations whose number depends on options
        if before >= 0 and (hook is None or not component.faults):
            work.faults += _without_equation(owner, component, work.statements[before:])
    for entry in model.inputs.values():
        _model_input(work, entry, net.input_units.get(entry.name, ""))


def _without_equation(owner: str, component: Component, statements: list[Statement]) -> list[str]:
    written = {name for s in statements for name in s.writes}
    kinds: tuple[tuple[type, str, str, str], ...] = (
        (Output, "", "output '{0}' has no equation", "self.{0}"),
        (State, "_der", "state '{0}' has no rate", "self.der.{0}"),
        (UnknownDeclaration, "_zero", "unknown '{0}' has nothing that determines it", "self.zero.{0}"),
    )
    return [
        f"component '{owner}' ({type(component).__name__}): {fault.format(name)}: assign {remedy.format(name)}"
        for kind, part, fault, remedy in kinds
        for name in component.of_kind(kind)
        if variable(owner, *filter(None, (part, name))) not in written
    ]


def _model_input(work: Assembly, entry: ModelInput, unit: str) -> None:
    """A signal from outside, with its gain error, offset and delay where the model has them."""
    used = variable("input", entry.name)
    raw = used if entry.gain is None and entry.offset is None else f"{used}___raw"
    work.inputs.append(
        Quantity(name=entry.name, unit=unit, meaning="model input", variable=raw, value=entry.default or 0.0)
    )
    text = raw
    if entry.gain is not None:
        gain = work.parameter(f"input.{entry.name}.gain", "", "relative gain error of the input", entry.gain)
        text = f"(1.0 + {gain}) * {text}"
    if entry.offset is not None:
        offset = work.parameter(f"input.{entry.name}.offset", unit, "offset of the input", entry.offset)
        text = f"{text} + {offset}"
    if raw != used:
        work.add(f"{used} = {text}", f"input {entry.name}")
    if entry.delay is not None:
        name = f"input.{entry.name}.delay"
        work.parameter(name, "s", "delay of the input", entry.delay)
        work.input_delays[entry.name] = name


def _table(work: Assembly, owner: str, item: Any, points: tuple[np.ndarray, np.ndarray]) -> None:
    x, y = points
    base = variable(owner, item.name)
    work.constants[f"{base}___start"] = len(work.parameters)
    work.constants[f"{base}___size"] = x.size
    packed = tables.packed(x, y, item.interpolation)
    parts = (("x", item.x_unit), ("y", item.unit), ("slope", f"({item.unit or '1'})/({item.x_unit or '1'})"))
    for k, value in enumerate(packed):
        part, unit = parts[k // x.size]
        work.parameter(f"{owner}.{item.name}.{part}[{k % x.size}]", unit, item.meaning, float(value))


def _probes(work: Assembly, kinematics: Kinematics) -> None:
    for k, place in enumerate(work.places):
        force = f"probe__{k}"
        unit = "N" if place.domain == "translation" else "N*m"
        work.inputs.append(
            Quantity(name=f"probe.{place.name}", unit=unit, meaning=f"extra {unit} at {place.name}", variable=force)
        )
        kinematics.apply_force(place.first, force)
        if place.second is not None:
            kinematics.apply_force(place.second, f"-{force}")
        sides = [side for side in (place.first, place.second) if side is not None]
        motions = place.motion_names()[: 2 if any(kinematics.massless(s) for s in sides) else 3]
        for what, (name, motion_unit) in enumerate(motions):
            first = kinematics.motion(place.first, what)
            second = kinematics.motion(place.second, what) if place.second is not None else "0.0"
            var = f"place__{k}__{name}"
            work.add(f"{var} = {first} - {second}" if second != "0.0" else f"{var} = {first}", place.name)
            work.output(f"place.{place.name}.{name}", motion_unit, f"{name} at {place.name}", var)


def _signal_probes(model: ModelGraph, work: Assembly) -> dict[str, str]:
    """Return the variable that each input takes that control feeds: the signal and a probe that is added to it."""
    taken: dict[str, str] = {}
    for k, (source, targets) in enumerate(driving_signals(model).items()):
        owner, component, item = model.find(source)  # type: ignore[misc]
        declared: Any = component.declarations[item]
        probe, with_probe = f"probe__signal__{k}", f"signal__{k}"
        work.inputs.append(
            Quantity(name=f"probe.{source}", unit=declared.unit, meaning=f"added to {source}", variable=probe)
        )
        work.add(f"{with_probe} = {variable(owner, item)} + {probe}", source)
        taken |= dict.fromkeys(targets, with_probe)
    return taken


def _energies(model: ModelGraph, work: Assembly, integrate: bool) -> None:
    stored: list[str] = []
    lost: list[str] = []
    supplied: list[str] = []
    for owner, component in model.components.items():
        for name, item in component.of_kind(Output).items():
            var = variable(owner, name)
            if isinstance(item, Energy):
                stored.append(var)
            elif isinstance(item, Power):
                (lost if item.kind == "loss" else supplied).append(var)
    for owner, var in work.kinetic:
        work.output(f"{owner}.kinetic_energy", "J", "kinetic energy", var)
        stored.append(var)
    for owner, var in work.potential:
        work.output(f"{owner}.potential_energy", "J", "potential energy in gravity", var)
        stored.append(var)
    for name, unit, terms in (
        ("stored", "J", stored),
        ("lost_power", "W", lost),
        ("supplied_power", "W", supplied),
    ):
        var = f"energy__{name}"
        work.add(f"{var} = {total(terms)}", "energy balance")
        work.output(f"energy.{name}", unit, f"{name.replace('_', ' ')} over all components", var)
    if integrate:
        for name in ("lost", "supplied"):
            var = f"energy__{name}"
            work.states.append(
                Quantity(name=f"energy.{name}", unit="J", meaning=f"energy {name} since the start", variable=var)
            )
            work.derivatives[var] = f"energy__{name}_power"


def _show(model: ModelGraph, net: Network, work: Assembly, probed: Mapping[str, str]) -> None:
    """Connect inputs to their signals, or to what takes their place, and list the quantities that are outputs."""
    for owner, component in model.components.items():
        for name, item in component.of_kind(Input).items():
            source = net.sources.get(f"{owner}.{name}")
            target = variable(owner, name)
            if f"{owner}.{name}" in probed:
                work.renamed[target] = probed[f"{owner}.{name}"]
            elif source is None:
                work.parameter(f"{owner}.{name}", item.unit, item.meaning, float(item.default))
            elif source.startswith("input:"):
                work.renamed[target] = variable("input", source[6:])
            else:
                work.renamed[target] = variable(*model.find(source)[::2])  # type: ignore[misc, index]
        for name, item in component.of_kind(Output).items():
            work.output(f"{owner}.{name}", item.unit, item.meaning, variable(owner, name))
    for state in work.states:
        work.output(state.name, state.unit, state.meaning, state.variable)
    known = {q.name: q for q in work.outputs}
    for name, source in model.outputs.items():
        quantity = known.get(source) or _port_quantity(model, source)
        if quantity is None:
            work.faults.append(f"model output '{name}': there is no quantity '{source}'{nearest(source, known)}")
        elif name not in known:
            work.output(name, quantity.unit, quantity.meaning, quantity.variable)


def _port_quantity(model: ModelGraph, source: str) -> Quantity | None:
    head, _, last = source.rpartition(".")
    endpoint = model.find(head) if head else None
    if endpoint is None:
        return None
    owner, component, port = endpoint
    units = getattr(component.declarations.get(port), "units", {})
    if last not in units:
        return None
    return Quantity(name=source, unit=units[last], meaning=last, variable=variable(owner, port, last))


def _rename(work: Assembly) -> None:
    """Replace the quantities of ports by those of the nodes that they share."""

    def final(name: str) -> str:
        while name in work.renamed:
            name = work.renamed[name]
        return name

    class Renamer(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.Name:
            return ast.Name(final(node.id), node.ctx)

    for item in work.statements:
        if work.renamed.keys().isdisjoint(item.reads) and work.renamed.keys().isdisjoint(item.writes):
            continue
        item.nodes = [Renamer().visit(n) for n in item.nodes]
        item.reads = {final(n) for n in item.reads}
        item.writes = {final(n) for n in item.writes}
    work.outputs = [
        Quantity(name=q.name, unit=q.unit, meaning=q.meaning, variable=final(q.variable)) for q in work.outputs
    ]
    work.derivatives = {k: final(v) for k, v in work.derivatives.items()}
