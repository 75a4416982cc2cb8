"""The network of a model: its nodes and signal paths, with every fault of its graph."""

from __future__ import annotations

from dataclasses import dataclass, field

from multibody.base.quantity_text import count_text
from multibody.base.spelling import nearest
from multibody.base.units import same_dimension
from multibody.declare.checks import declaration_faults, name_fault
from multibody.declare.component import Component
from multibody.declare.declarations import FlowPort, Frame, Input, Output, Port
from multibody.model.graph import GROUND, ModelGraph

__all__ = ["Network", "Node", "PortOf", "network"]

RESERVED = frozenset((GROUND, "energy", "input", "place", "probe"))


@dataclass(frozen=True)
class PortOf:
    """A port of a named component."""

    owner: str
    component: Component = field(compare=False, repr=False)
    port: Port = field(compare=False, repr=False)
    port_name: str = ""

    @property
    def name(self) -> str:
        """Endpoint text, such as ``"guide.a"``."""
        return f"{self.owner}.{self.port_name}"

    @property
    def inertia(self) -> str | None:
        """Name of the parameter that gives the port inertia."""
        return getattr(self.port, "inertia", None)

    @property
    def coordinate(self) -> str | None:
        """Name of the free motion of a rigid body that the port is."""
        return getattr(self.port, "coordinate", None)

    @property
    def prescribed(self) -> bool:
        """True when the component's equations give the port its motion or potential."""
        return bool(getattr(self.port, "prescribed", False))

    @property
    def locked(self) -> bool:
        """True when the component's Boolean option takes the degree of freedom away."""
        options = self.component.options
        return options.get(f"{self.port_name}_free", options.get("free", True)) is False and self.inertia is not None


@dataclass(eq=False)
class Node:
    """Ports that are connected and so share one potential."""

    domain: str
    ports: list[PortOf] = field(default_factory=list)
    grounded: bool = False

    @property
    def label(self) -> PortOf:
        """The port that names the node: the first that is a body's axis, has inertia or prescribes; else the first."""
        for wanted in ("coordinate", "inertia", "prescribed"):
            for port in self.ports:
                if getattr(port, wanted):
                    return port
        return self.ports[0]

    @property
    def still(self) -> bool:
        """True for a node of a domain in which something flows and nothing moves."""
        return isinstance(self.ports[0].port, FlowPort)

    @property
    def prescriber(self) -> PortOf | None:
        """The port whose component gives the node its motion or potential."""
        return next((p for p in self.ports if p.prescribed), None)

    @property
    def inertial(self) -> list[PortOf]:
        """Ports with inertia."""
        return [p for p in self.ports if p.inertia]

    @property
    def axes(self) -> list[PortOf]:
        """Ports that are a free motion of a rigid body."""
        return [p for p in self.ports if p.coordinate]


@dataclass(kw_only=True)
class Network:
    """A model's nodes, the source of each component input, the units of model inputs, and all faults."""

    nodes: list[Node] = field(default_factory=list)
    node_of: dict[str, Node] = field(default_factory=dict)
    frames: list[Node] = field(default_factory=list)
    sources: dict[str, str] = field(default_factory=dict)
    input_units: dict[str, str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def network(model: ModelGraph) -> Network:
    """Return the checked network of a model."""
    net = Network(faults=model.declared_faults)
    if not model.components:
        net.faults.append("the model has no components: add some with model.add(name, component)")
    for name, component in model.components.items():
        own_faults = [*declaration_faults(component), *component.faults]
        net.faults += [f"component '{name}' ({type(component).__name__}): {fault}" for fault in own_faults]
    net.faults += _name_faults(model)
    links: dict[str, set[str]] = {}
    ports: dict[str, PortOf] = {}
    for owner, component in model.components.items():
        for port_name, port in component.of_kind(Port).items():
            reference = PortOf(owner, component, port, port_name)
            ports[reference.name] = reference
            links[reference.name] = set()
    connected: set[str] = set()
    for ends in model.connections:
        _connection(model, ends, ports, links, connected, net)
    _signals(model, net)
    _nodes(ports, links, net)
    for name, reference in ports.items():
        held = isinstance(reference.port, Frame) and (reference.port.parent or reference.port.offset is not None)
        free_alone = reference.inertia or reference.coordinate or held
        if name not in connected and not free_alone:
            meaning = reference.port.meaning or type(reference.component).__name__
            noun = f"{reference.port.domain} port '{name}' ({meaning})"
            net.faults.append(f"{noun} is not connected: connect it to another port or to the ground")
    for node in net.nodes:
        _overconstrained(node, net)
    return net


def _name_faults(model: ModelGraph) -> list[str]:
    """Return the faults of names with which two quantities would have the same full name."""
    faults = []
    for what, names in (("component", model.components), ("model input", model.inputs)):
        for name in names:
            why = next((why for word in name.split(".") if (why := name_fault(word))), None)
            if why:
                faults.append(f"'{name}' cannot be the name of a {what}: {why}, dots between words")
    for name in model.components:
        first = name.partition(".")[0]
        if first in RESERVED:
            faults.append(f"component '{name}': '{first}' is the model's own name for something else: rename it")
        owner, _, rest = name.rpartition(".")
        while owner:
            head = rest.partition(".")[0]
            if owner in model.components and head in model.components[owner].declarations:
                faults.append(f"component '{name}' has the same name as '{head}' of component '{owner}': rename one")
            owner, _, before = owner.rpartition(".")
            rest = f"{before}.{rest}"
    return faults


def _connection(
    model: ModelGraph,
    ends: tuple[str, ...],
    ports: dict[str, PortOf],
    links: dict[str, set[str]],
    connected: set[str],
    net: Network,
) -> None:
    shown = " – ".join(ends)
    if len(set(ends)) < 2:
        net.faults.append(f"connection '{shown}' needs two different endpoints")
        return
    mechanical: list[str] = []
    outputs: list[str] = []
    inputs: list[str] = []
    for end in ends:
        if end == GROUND:
            mechanical.append(end)
            continue
        location = model.find(end)
        if location is None:
            hint = nearest(end.rsplit(".", 1)[0], model.components)
            net.faults.append(f"connection '{shown}': there is no component for '{end}'{hint}")
            return
        owner, component, item = location
        declaration = component.declarations.get(item)
        if isinstance(declaration, Port):
            mechanical.append(end)
        elif isinstance(declaration, Output):
            outputs.append(end)
        elif isinstance(declaration, Input):
            inputs.append(end)
        else:
            known = list(component.of_kind((Port, Input, Output)))  # type: ignore[arg-type]
            hint = nearest(item, known) or f"; it has {', '.join(known) or 'none'}"
            net.faults.append(
                f"connection '{shown}': {type(component).__name__} '{owner}' has no port or signal '{item}'{hint}"
            )
            return
    if mechanical and (outputs or inputs):
        net.faults.append(f"connection '{shown}' mixes ports and signals: use a sensor or a source between them")
    elif mechanical:
        _join(mechanical, shown, ports, links, connected, net)
    else:
        _signal_connection(model, shown, outputs, inputs, net)


def _join(
    ends: list[str],
    shown: str,
    ports: dict[str, PortOf],
    links: dict[str, set[str]],
    connected: set[str],
    net: Network,
) -> None:
    domains = {ports[e].port.domain for e in ends if e != GROUND}
    if len(domains) > 1:
        kinds = ", ".join(f"'{e}' is {ports[e].port.domain}" for e in ends if e != GROUND)
        net.faults.append(
            f"connection '{shown}' joins different kinds of port ({kinds}): put a converting part between them"
        )
        return
    first = ends[0]
    for end in ends:
        connected.add(end)
        links.setdefault(first, set()).add(end)
        links.setdefault(end, set()).add(first)


def _signal_connection(model: ModelGraph, shown: str, outputs: list[str], inputs: list[str], net: Network) -> None:
    if len(outputs) != 1:
        count = count_text(len(outputs), "output") if outputs else "no output"
        net.faults.append(f"connection '{shown}' has {count}: connect exactly one output to one or more inputs")
        return
    source = outputs[0]
    _, maker, out = model.find(source)  # type: ignore[misc]
    out_unit = maker.declarations[out].unit  # type: ignore[attr-defined, union-attr]
    for target in inputs:
        _, taker, item = model.find(target)  # type: ignore[misc]
        unit = taker.declarations[item].unit  # type: ignore[attr-defined, union-attr]
        if not same_dimension(out_unit or "1", unit or "1"):
            net.faults.append(
                f"connection '{shown}': '{source}' is in {out_unit or '1'} but '{target}' takes "
                f"{unit or '1'}: put a Gain between them or connect the right signal"
            )
        if target in net.sources:
            net.faults.append(f"input '{target}' has two sources, '{net.sources[target]}' and '{source}': add a Sum")
        net.sources[target] = source


def _signals(model: ModelGraph, net: Network) -> None:
    for entry in model.inputs.values():
        units: dict[str, str] = {}
        if not entry.targets:
            net.faults.append(f"model input '{entry.name}' feeds nothing: name the component inputs that take it")
        for target in entry.targets:
            location = model.find(target)
            declaration = location.component.declarations.get(location.item) if location else None
            if not isinstance(declaration, Input):
                known = [f"{n}.{i}" for n, c in model.components.items() for i in c.of_kind(Input)]
                net.faults.append(
                    f"model input '{entry.name}': '{target}' is not an input of a component{nearest(target, known)}"
                )
                continue
            if target in net.sources:
                net.faults.append(
                    f"input '{target}' has two sources, '{net.sources[target]}' and model input '{entry.name}'"
                )
            net.sources[target] = f"input:{entry.name}"
            units[target] = declaration.unit
        if units:
            first = next(iter(units.values()))
            net.input_units[entry.name] = first
            for target, unit in units.items():
                if not same_dimension(first or "1", unit or "1"):
                    net.faults.append(
                        f"model input '{entry.name}' feeds inputs of different units ({first} and {unit} at '{target}')"
                    )
    for owner, component in model.components.items():
        for name, item in component.of_kind(Input).items():
            if f"{owner}.{name}" not in net.sources and item.default is None:
                net.faults.append(
                    f"input '{owner}.{name}' ({item.meaning}, {item.unit or '1'}) has no source: connect an output "
                    f"to it or declare model.input('{owner}.{name}', '{owner}.{name}')"
                )


def _nodes(ports: dict[str, PortOf], links: dict[str, set[str]], net: Network) -> None:
    seen: set[str] = set()
    for name, reference in ports.items():
        if name in seen:
            continue
        node = Node(reference.port.domain)
        stack, members = [name], []
        while stack:
            end = stack.pop()
            if end in seen:
                continue
            if end == GROUND:
                node.grounded = True
                continue
            seen.add(end)
            members.append(end)
            stack += links[end]
        order = list(ports)
        node.ports = [ports[e] for e in sorted(members, key=order.index)]
        for end in members:
            net.node_of[end] = node
        (net.frames if node.domain == Frame.domain else net.nodes).append(node)


def _overconstrained(node: Node, net: Network) -> None:
    holders = [f"'{p.name}' prescribes it" for p in node.ports if p.prescribed]
    holders += [f"'{p.name}' is locked" for p in node.ports if p.locked]
    if node.grounded:
        holders.append("it is connected to the ground")
    if len(holders) > 1:
        kind = type(node.label.port).potential
        net.faults.append(
            f"over-constrained: the {kind} at '{node.label.name}' is given more than once "
            f"({'; '.join(holders)}): keep one"
        )
