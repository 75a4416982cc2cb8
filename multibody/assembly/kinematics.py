"""The motion of every mechanical node as variables, and the balance of what acts on each node."""

from __future__ import annotations

from dataclasses import dataclass, field

from multibody.assembly.dynamics import total
from multibody.assembly.equation_set import Assembly, Contribution, Unknown
from multibody.equations.statements import Statement, variable
from multibody.model.network import Network, Node

__all__ = ["Coupling", "Kinematics", "NodeMotion"]


@dataclass(kw_only=True)
class NodeMotion:
    """Variables of a node's motion and its factors J over the independent coordinates."""

    node: Node
    base: str
    factors: dict[str, str] = field(default_factory=dict)
    bias: str | None = None
    forces: list[str] = field(default_factory=list)

    def variable(self, what: str) -> str:
        """Return the variable of one quantity of the node, such as its position."""
        return f"{self.base}__{what}"


@dataclass
class Coupling:
    """An ideal transmission, in the direction in which it is used: ``target`` follows ``sources``."""

    owner: str
    target: str
    sources: list[str]
    statements: list[Statement]


class Kinematics:
    """The motion of every mechanical node, and the balance of what acts on each node."""

    def __init__(self, net: Network):
        self.net = net
        self.motions: dict[int, NodeMotion] = {}
        self.drives: dict[int, set[int]] = {}
        self._massless: set[int] = set()
        self.couplings: list[Coupling] = []

    def of(self, node: Node) -> NodeMotion:
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

    def apply_force(self, node: Node, text: str) -> None:
        """Let a further force or torque act on a node."""
        self.of(node).forces.append(text)

    def balance(self, work: Assembly) -> None:
        """Sum the flows at every node: forces into Newton's law, currents and their like into Kirchhoff's."""
        written = {name for s in work.statements for name in s.writes}
        for node in self.net.nodes:
            port = type(node.label.port)
            flows = [variable(p.owner, p.port_name, port.flow) for p in node.ports]
            flows = [f for f in flows if f in written]
            if node.still:
                base = variable(node.label.owner, node.label.port_name)
                work.add(f"{base}___sum = {total(flows)}", node.label.name)
                if node.prescriber is not None:
                    work.add(f"{base}__reaction = {base}___sum", node.label.name)
                elif not node.grounded:
                    name, potential = f"{node.label.name}.{port.potential}", f"{base}__{port.potential}"
                    work.unknowns.append(Unknown(name, potential, f"{base}___sum"))
                continue
            motion = self.of(node)
            terms = flows + motion.forces
            if not motion.factors:
                continue
            work.add(f"{motion.base}___net = {total(terms)}", node.label.name)
            inertia = [variable(p.owner, p.inertia or "") for p in node.inertial]
            work.contributions.append(
                Contribution(
                    origin=node.label.owner,
                    rows=(motion.factors,),
                    mass={(0, 0): f"({total(inertia)})" if len(inertia) > 1 else inertia[0]} if inertia else {},
                    bias=(motion.bias,),
                    force=(f"{motion.base}___net",),
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
        """Write the force of every transmission on its ports, as ``<owner>.<port>.reaction``.

        On the side that follows it is what Newton's law needs beyond the other forces; the other sides get −J times
        it, because an ideal transmission takes as much power as it delivers.
        """
        returned: dict[int, list[str]] = {}
        for coupling in reversed(self.couplings):  # what follows this target is known before it
            node = self.net.node_of[coupling.target]
            port = type(node.label.port)
            flows = [variable(p.owner, p.port_name, port.flow) for p in node.ports]
            terms = [f for f in flows if f in written] + self.of(node).forces + returned.get(id(node), [])
            needed = [f"{variable(p.owner, p.inertia or '')} * {self.motion(node, 2)}" for p in node.inertial]
            needed += [f"{variable(p.owner, p.port_name)}___needed" for p in node.axes]
            reaction = variable(*coupling.target.rpartition(".")[::2], "reaction")
            work.add(f"{reaction} = {total(needed)} - ({total(terms)})", coupling.owner)
            for i, source in enumerate(coupling.sources):
                back = variable(*source.rpartition(".")[::2], "reaction")
                slope = f"{variable(coupling.owner)}___J{i}"
                work.add(f"{back} = -{slope} * {reaction}", coupling.owner)
                returned.setdefault(id(self.net.node_of[source]), []).append(back)
