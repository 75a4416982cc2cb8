"""Ideal transmissions: which side follows which, and the follower's motion by exact differentiation."""

from __future__ import annotations

import ast

from multibody.assembly.called_functions import tangent_name
from multibody.assembly.dynamics import product, total
from multibody.assembly.equation_set import Assembly
from multibody.assembly.kinematics import Coupling, Kinematics
from multibody.base.errors import EquationError
from multibody.declare.declarations import Port
from multibody.equations.differentiate import Differentiator, active_names, d
from multibody.equations.reading import method_statements
from multibody.equations.scope import Scope
from multibody.equations.statements import Statement, copied, names_written, variable
from multibody.model.graph import ModelGraph
from multibody.model.network import Network

__all__ = ["directed", "follow"]


def directed(model: ModelGraph, net: Network, work: Assembly) -> list[Coupling]:
    """Choose for every transmission which side follows, so that each node follows at most once.

    The result is ordered: what a transmission reads is known before it.
    """
    options: list[list[Coupling]] = []
    for owner, component in model.components.items():
        if component.is_transmission():
            read = [_read(owner, model, work, method) for method in ("coupling", "coupling_inverse")]
            options.append([w for w in read if w is not None])
    chosen: list[Coupling] = []
    leads: dict[int, set[int]] = {}  # follower → everything that it follows, directly or not

    def possible(way: Coupling) -> bool:
        target = net.node_of[way.target]
        held = target.grounded or target.prescriber is not None or any(p.locked for p in target.ports)
        circle = any(id(target) in leads.get(s, set()) | {s} for s in (id(net.node_of[n]) for n in way.sources))
        return not held and id(target) not in leads and not circle

    for ways in options:
        fitting = [w for w in ways if possible(w)]
        if not fitting:
            if ways:
                work.faults.append(
                    f"over-constrained: '{ways[0].owner}' ties '{ways[0].target}' to '{ways[0].sources[0]}', "
                    "but both are already held or tied: free one of them, or put a spring into the loop"
                )
            continue
        # a side with inertia leads where there is a choice, because its start values then count
        best = min(fitting, key=lambda w: bool(net.node_of[w.target].inertial))
        chosen.append(best)
        target = id(net.node_of[best.target])
        direct = {id(net.node_of[s]) for s in best.sources}
        leads[target] = direct.union(*(leads.get(s, set()) for s in direct))
        for other in leads.values():
            if target in other:
                other |= leads[target]
    ordered: list[Coupling] = []
    waiting = {id(net.node_of[c.target]) for c in chosen}
    while chosen:
        ready = [c for c in chosen if not any(id(net.node_of[s]) in waiting for s in c.sources)]
        for c in ready:
            chosen.remove(c)
            waiting.discard(id(net.node_of[c.target]))
        ordered += ready
    return ordered


def _read(owner: str, model: ModelGraph, work: Assembly, method: str) -> Coupling | None:
    component = model.components[owner]
    try:
        statements = method_statements(Scope(owner, component, work.kernels), method)
    except EquationError as error:
        work.faults += str(error).splitlines()
        return None
    ports = component.of_kind(Port).items()
    potentials = {variable(owner, name, port.potential): f"{owner}.{name}" for name, port in ports}
    written = [v for s in statements for v in s.writes if v in potentials]
    read = list(dict.fromkeys(v for s in statements for v in sorted(s.reads) if v in potentials))
    if not statements:
        return None
    if len(written) != 1 or not read or written[0] in read:
        work.faults.append(f"component '{owner}': {method} must give one port's position by those of others")
        return None
    return Coupling(owner, potentials[written[0]], [potentials[v] for v in read], statements)


def follow(kin: Kinematics, net: Network, coupling: Coupling, work: Assembly) -> None:
    """Write down position, rate and acceleration of the node that a transmission drives.

    With the coupling ``q = c(q_1, q_2, …)`` the rate is ``Σ J_i v_i`` and the acceleration
    ``Σ J_i a_i + Σ_ij ∂J_i/∂q_j v_i v_j``, with ``J_i = ∂c/∂q_i`` written out exactly.
    """
    node = net.node_of[coupling.target]
    motion = kin.of(node)
    port = type(node.label.port)
    target = _potential(net, coupling.target)
    sources = [_potential(net, s) for s in coupling.sources]
    leaders = [net.node_of[s] for s in coupling.sources]
    work.statements += coupling.statements
    nodes = [n for s in coupling.statements for n in s.nodes]
    rate: list[str] = []
    bias: list[str] = []
    factors: dict[str, list[str]] = {}
    for i, (source, leader) in enumerate(zip(sources, leaders, strict=True)):
        slope = f"{variable(coupling.owner)}___J{i}"
        derived = _slope(nodes, target, source, slope)
        if derived is None:
            continue
        work.statements.append(Statement.of(derived, coupling.owner))
        rate.append(f"{slope} * {kin.motion(leader, 1)}")
        for key, factor in kin.of(leader).factors.items():
            factors.setdefault(key, []).append(product(slope, factor))
        if (led := kin.of(leader).bias) is not None:
            bias.append(f"{slope} * {led}")
        for j, (other, mover) in enumerate(zip(sources, leaders, strict=True)):
            curvature = _slope(derived, slope, other, f"{slope}_{j}")
            if curvature is not None:
                work.statements.append(Statement.of(curvature, coupling.owner))
                bias.append(f"{slope}_{j} * {kin.motion(mover, 1)} * {kin.motion(leader, 1)}")
    for key, terms in factors.items():
        var = f"{motion.base}___J__{key}"
        work.add(f"{var} = {total(terms)}", coupling.owner)
        motion.factors[key] = var
    work.add(f"{motion.base}__{port.rate} = {total(rate)}", coupling.owner)
    if bias:
        motion.bias = f"{motion.base}___bias"
        work.add(f"{motion.bias} = {total(bias)}", coupling.owner)
    known = {c.key: c.acceleration for c in work.coordinates}
    terms = [f"{var} * {known[key]}" for key, var in motion.factors.items()] + ([motion.bias] if motion.bias else [])
    work.add(f"{motion.base}__acceleration = {total(terms)}", coupling.owner)


def _potential(net: Network, endpoint: str) -> str:
    reference = next(p for p in net.node_of[endpoint].ports if p.name == endpoint)
    return variable(reference.owner, reference.port_name, reference.port.potential)


def _slope(nodes: list[ast.stmt], target: str, source: str, result: str) -> list[ast.stmt] | None:
    """Return statements that set ``result`` to ∂target/∂source, all their own names kept apart; None when it
    is 0.
    """
    active = active_names(nodes, {source})
    if target not in active:
        return None
    derived = Differentiator(active, tangent_name).statements([copied(n) for n in nodes])
    own = {n for s in derived for n in names_written(s)}

    class Renamer(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            if node.id == d(target):
                return ast.Name(result, node.ctx)
            if node.id == d(source):
                return ast.Constant(1.0)
            return ast.Name(f"{result}__{node.id}" if node.id in own else node.id, node.ctx)

    return [Renamer().visit(s) for s in derived]
