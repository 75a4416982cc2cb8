"""How nodes move: which are independent, held, prescribed, or follow others through ideal transmissions."""

from __future__ import annotations

from multibody.assembly.equation_set import Assembly, Coordinate, Quantity, owner_rank
from multibody.assembly.kinematics import Kinematics, NodeMotion
from multibody.assembly.transmissions import directed, follow
from multibody.base.errors import EquationError
from multibody.declare.declarations import Port
from multibody.equations.statements import variable
from multibody.model.graph import ModelGraph
from multibody.model.network import Network, Node, PortOf

__all__ = ["resolve_nodes"]


def resolve_nodes(model: ModelGraph, net: Network, work: Assembly) -> Kinematics:
    """Decide how every node moves, and write its position and rate.

    Independent nodes bring the states ``<component>.position`` and ``<component>.velocity`` (``angle``,
    ``speed``).
    """
    kin = Kinematics(net)
    for node in net.nodes:
        port = type(node.label.port)
        base = variable(node.label.owner, node.label.port_name)
        shared = (port.potential, port.rate, "acceleration") if port.rate else (port.potential,)
        for p in node.ports:
            for what in shared:
                own = variable(p.owner, p.port_name, what)
                if own != f"{base}__{what}":
                    work.renamed[own] = f"{base}__{what}"
        if not node.still:
            kin.motions[id(node)] = NodeMotion(node=node, base=base)
        elif node.grounded:
            work.add(f"{base}__{port.potential} = 0.0", "ground")
    couplings = directed(model, net, work)
    kin.couplings = couplings
    followers = {id(net.node_of[c.target]) for c in couplings}
    for c in couplings:
        for source in c.sources:
            kin.drives.setdefault(id(net.node_of[source]), set()).add(id(net.node_of[c.target]))
    order = list(model.components)
    for node in net.nodes:
        if not node.still and id(node) not in followers:
            _leader(kin, node, work)
    for coupling in couplings:
        try:
            follow(kin, net, coupling, work)
        except EquationError as error:
            work.faults.append(f"component '{coupling.owner}': {error}")
        _show_motion(kin, net.node_of[coupling.target], work, skip=None)
    rank = {f"{n}.{s}": k for n, c in model.components.items() for k, s in enumerate(c.state_order)}
    work.states.sort(key=lambda q: (owner_rank(q.name, order), rank.get(q.name, len(rank))))
    return kin


def _leader(kin: Kinematics, node: Node, work: Assembly) -> None:
    """A node that no transmission drives: held, prescribed or independent."""
    label, motion = node.label, kin.of(node)
    port = type(label.port)
    position, rate, acceleration = (kin.motion(node, k) for k in range(3))
    locked = [p for p in node.ports if p.locked]
    if node.grounded or locked:
        start = "0.0"
        if locked:
            holder = locked[0]
            name = _start_name(holder, port.potential)
            start = work.parameter(
                f"{holder.owner}.{name}",
                port.units[port.potential],
                f"{port.potential} at which it is locked",
                holder.component.starts[name],
            )
        work.add(f"{position} = {start}", label.name)
        work.add(f"{rate} = 0.0", label.name)
        work.add(f"{acceleration} = 0.0", label.name)
        _show_motion(kin, node, work, skip=None)
        return
    motion.factors = {motion.base: "1.0"}
    if node.prescriber is not None:
        reaction = f"{variable(node.prescriber.owner, node.prescriber.port_name)}__reaction"
        work.coordinates.append(
            Coordinate(
                key=motion.base,
                name=label.name,
                velocity=rate,
                acceleration=acceleration,
                kind="prescribed",
                reaction=reaction,
            )
        )
        _show_motion(kin, node, work, skip=None)
        return
    work.coordinates.append(Coordinate(key=motion.base, name=label.name, velocity=rate, acceleration=acceleration))
    massless = not kin.reaches_inertia(node)
    named = zip(_state_names(label), (port.potential, port.rate), (position, rate), strict=True)
    for (name, value), what, var in named:
        if what == port.rate and massless:
            continue
        work.states.append(
            Quantity(name=f"{label.owner}.{name}", unit=port.units[what], meaning=what, variable=var, value=value)
        )
    work.derivatives[position] = rate
    if massless:
        kin._massless.add(id(node))
    else:
        work.derivatives[rate] = acceleration
    _show_motion(kin, node, work, skip=label if label.inertia else None)


def _state_names(port: PortOf) -> list[tuple[str, float]]:
    """Names and start values of the two states of an independent node."""
    if port.coordinate:
        return list(port.component.coordinate_states(port.coordinate))  # type: ignore[attr-defined]
    kind = type(port.port)
    if not port.inertia:
        return [(f"{port.port_name}.{what}", 0.0) for what in (kind.potential, kind.rate)]
    names = [_start_name(port, what) for what in (kind.potential, kind.rate)]
    return [(name, port.component.starts.get(name, 0.0)) for name in names]


def _start_name(port: PortOf, what: str) -> str:
    starts = port.component.starts
    return what if what in starts else f"{port.port_name}_{what}"


def _show_motion(kin: Kinematics, node: Node, work: Assembly, skip: PortOf | None) -> None:
    """Offer position, rate and acceleration of every inertial port on a node as outputs."""
    port = type(node.label.port)
    for p in node.inertial:
        single = sum(1 for q in p.component.of_kind(Port).values() if getattr(q, "inertia", None)) == 1
        for k, what in enumerate((port.potential, port.rate, "acceleration")):
            if p is skip and k < 2:
                continue  # these are states and shown as such
            name = what if single else f"{p.port_name}_{what}"
            work.output(f"{p.owner}.{name}", port.units[what], what, kin.motion(node, k))
