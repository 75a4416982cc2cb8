"""How nodes move: which are independent, held, prescribed, or follow others through ideal transmissions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from multibody.assembly.dynamics import Contribution, Coordinate, total
from multibody.assembly.equation_set import Assembly, Quantity, Unknown
from multibody.assembly.transmissions import Coupling, directed, follow
from multibody.base.errors import EquationError
from multibody.declare.declarations import Pin, Port
from multibody.equations.statements import variable

if TYPE_CHECKING:
    from multibody.model.model import Model
    from multibody.model.network import Network, Node, PortOf

__all__ = ["Kinematics", "owner_rank", "resolve_nodes"]


@dataclass
class _Motion:
    """Variables of a node's motion and its factors J over the independent coordinates."""

    node: Node
    base: str
    factors: dict[str, str] = field(default_factory=dict)
    bias: str | None = None
    pushes: list[str] = field(default_factory=list)

    def variable(self, what: str) -> str:
        return f"{self.base}__{what}"


class Kinematics:
    """The motion of every mechanical node, and the balance of what acts on each node."""

    def __init__(self, net: Network):
        self.net = net
        self.motions: dict[int, _Motion] = {}
        self.drives: dict[int, set[int]] = {}
        self._massless: set[int] = set()
        self.couplings: list[Coupling] = []

    def of(self, node: Node) -> _Motion:
        """Return a node's motion."""
        return self.motions[id(node)]

    def moves(self, node: Node) -> bool:
        """Tell whether a node can move."""
        return bool(id(node) in self.motions and self.of(node).factors)

    def motion(self, node: Node, what: int) -> str:
        """Return the variable of a node's position (0), rate (1) or acceleration (2)."""
        port = type(node.label.port)
        return self.of(node).variable((port.potential, port.rate, "acceleration")[what])

    def reaches_inertia(self, node: Node) -> bool:
        """Tell whether a node has inertia, itself or through what it drives."""
        if node.inertial or node.axes:
            return True
        driven = [n for n in self.net.nodes if id(n) in self.drives.get(id(node), ())]
        return any(self.reaches_inertia(n) for n in driven)

    def massless(self, node: Node) -> bool:
        """Tell whether a node's speed follows from a balance of forces without inertia; it has no
        acceleration.
        """
        return id(node) in self._massless

    def push(self, node: Node, text: str) -> None:
        """Let a further force or torque act on a node."""
        self.of(node).pushes.append(text)

    def balance(self, work: Assembly) -> None:
        """Sum the flows at every node: forces into Newton's law, currents into Kirchhoff's."""
        written = {name for s in work.statements for name in s.writes}
        for node in self.net.nodes:
            port = type(node.label.port)
            flows = [variable(p.owner, p.port_name, port.flow) for p in node.ports]
            flows = [f for f in flows if f in written]
            if node.domain == Pin.domain:
                base = variable(node.label.owner, node.label.port_name)
                work.add(f"{base}___sum = {total(flows)}", node.label.name)
                if node.prescriber is not None:
                    work.add(f"{base}__reaction = {base}___sum", node.label.name)
                elif not node.grounded:
                    work.unknowns.append(
                        Unknown(f"{node.label.name}.voltage", f"{base}__voltage", f"{base}___sum")
                    )
                continue
            motion = self.of(node)
            terms = flows + motion.pushes
            if not motion.factors:
                continue
            work.add(f"{motion.base}___net = {total(terms)}", node.label.name)
            inertia = [variable(p.owner, p.inertia or "") for p in node.inertial]
            work.contributions.append(
                Contribution(
                    node.label.owner,
                    (motion.factors,),
                    {(0, 0): f"({total(inertia)})" if len(inertia) > 1 else inertia[0]} if inertia else {},
                    (motion.bias,),
                    (f"{motion.base}___net",),
                )
            )
            for p in node.inertial:
                var = f"{variable(p.owner, p.port_name)}___kinetic"
                work.add(
                    f"{var} = 0.5 * {variable(p.owner, p.inertia or '')} * {self.motion(node, 1)} ** 2",
                    p.owner,
                )
                work.kinetic.append((p.owner, var))
        self._transmitted(work, written)

    def _transmitted(self, work: Assembly, written: set[str]) -> None:
        """State what every transmission exerts on its ports, as ``<owner>.<port>.reaction``.

        On the side that follows it is what Newton's law there leaves over; the other sides get −J times it,
        because an ideal transmission takes as much power as it gives.
        """
        given_back: dict[int, list[str]] = {}
        for coupling in reversed(self.couplings):  # what follows this target is known before it
            node = self.net.node_of[coupling.target]
            port = type(node.label.port)
            flows = [variable(p.owner, p.port_name, port.flow) for p in node.ports]
            terms = [f for f in flows if f in written] + self.of(node).pushes + given_back.get(id(node), [])
            needed = [f"{variable(p.owner, p.inertia or '')} * {self.motion(node, 2)}" for p in node.inertial]
            needed += [f"{variable(p.owner, p.port_name)}___needed" for p in node.axes]
            reaction = variable(*coupling.target.rpartition(".")[::2], "reaction")
            work.add(f"{reaction} = {total(needed)} - ({total(terms)})", coupling.owner)
            for i, source in enumerate(coupling.sources):
                back = variable(*source.rpartition(".")[::2], "reaction")
                slope = f"{variable(coupling.owner)}___J{i}"
                work.add(f"{back} = -{slope} * {reaction}", coupling.owner)
                given_back.setdefault(id(self.net.node_of[source]), []).append(back)


def resolve_nodes(model: Model, net: Network, work: Assembly) -> Kinematics:
    """Decide how every node moves, and write its position and rate down.

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
                mine = variable(p.owner, p.port_name, what)
                if mine != f"{base}__{what}":
                    work.renamed[mine] = f"{base}__{what}"
        if node.domain != Pin.domain:
            kin.motions[id(node)] = _Motion(node, base)
        elif node.grounded:
            work.add(f"{base}__voltage = 0.0", "ground")
    couplings = directed(model, net, work)
    kin.couplings = couplings
    followers = {id(net.node_of[c.target]) for c in couplings}
    for c in couplings:
        for source in c.sources:
            kin.drives.setdefault(id(net.node_of[source]), set()).add(id(net.node_of[c.target]))
    order = list(model.components)
    for node in net.nodes:
        if node.domain != Pin.domain and id(node) not in followers:
            _leader(kin, node, work)
    for coupling in couplings:
        try:
            follow(kin, net, coupling, work)
        except EquationError as error:
            work.faults.append(f"component '{coupling.owner}': {error}")
        _show_motion(kin, net.node_of[coupling.target], work, skip=None)
    wanted = {f"{n}.{s}": k for n, c in model.components.items() for k, s in enumerate(c.state_order)}
    work.states.sort(key=lambda q: (owner_rank(q.name, order), wanted.get(q.name, len(wanted))))
    return kin


def owner_rank(name: str, order: list[str]) -> int:
    """Return the place of a quantity's component among the components, or their number when it has none."""
    owners = [k for k, owner in enumerate(order) if name.startswith(owner + ".")]
    return max(owners, key=lambda k: len(order[k])) if owners else len(order)


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
            Coordinate(motion.base, label.name, rate, acceleration, "prescribed", reaction)
        )
        _show_motion(kin, node, work, skip=None)
        return
    work.coordinates.append(Coordinate(motion.base, label.name, rate, acceleration))
    massless = not kin.reaches_inertia(node)
    named = zip(_state_names(label), (port.potential, port.rate), (position, rate), strict=True)
    for (name, value), what, var in named:
        if what == port.rate and massless:
            continue
        work.states.append(Quantity(f"{label.owner}.{name}", port.units[what], what, var, value))
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
