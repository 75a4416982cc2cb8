"""Assembly of the spatial part of a model: bodies from the ground outwards, states, frames, forces."""

from __future__ import annotations

from multibody.assembly.equation_set import Assembly, Coordinate, Quantity, owner_rank
from multibody.assembly.kinematics import Kinematics
from multibody.assembly.spatial.frames import Fixture, circles, fixtures
from multibody.assembly.spatial.inertia import Linked, energies, equations_of_motion, joint_reactions
from multibody.assembly.spatial.motion import GROUND_MOTION, Carrier, Freedom, Moving, move, point
from multibody.assembly.spatial.symbols import ZERO, ZERO_VECTOR, Vector, Writer, cross, matmul, plus
from multibody.declare.declarations import Frame
from multibody.declare.rigid_body import ANGLES, COORDINATES, LENGTHS, RigidBody, World
from multibody.equations.statements import variable
from multibody.model.graph import ModelGraph
from multibody.model.network import Network

__all__ = ["assemble_spatial"]

_FREE_FALL: Vector = (ZERO, ZERO, "-9.80665")


def assemble_spatial(model: ModelGraph, net: Network, kin: Kinematics, work: Assembly) -> None:
    """Write the motion of all bodies and frames and their equations of motion into ``work``.

    ``work`` has to contain the forces that components exert on frames; what acts on a body's axes is added by the
    balance of their nodes.
    """
    bodies = {n: c for n, c in model.components.items() if isinstance(c, RigidBody)}
    worlds = [n for n, c in model.components.items() if isinstance(c, World)]
    if len(worlds) > 1:
        work.faults.append(f"there is more than one World ({', '.join(worlds)}): keep one")
    fixture_of = fixtures(net, work.faults)
    parents = {n: fixture_of[f"{n}.parent"].body if f"{n}.parent" in fixture_of else None for n in bodies}
    for circle in circles(parents):
        shown = " to ".join(f"'{n}'" for n in (*circle, circle[0]))
        work.faults.append(f"bodies are attached to each other in a circle ({shown}): attach one of them to the ground")
    if work.faults:
        return
    gravity = _FREE_FALL
    if worlds:
        gravity = tuple(variable(worlds[0], f"gravity_{a}") for a in LENGTHS)  # type: ignore[assignment]
    written = {name for s in work.statements for name in s.writes}
    linked: dict[str, Linked] = {}
    while len(linked) < len(bodies):
        for name, body in bodies.items():
            if name not in linked and (parents[name] is None or parents[name] in linked):
                linked[name] = _link(name, body, fixture_of, linked, net, kin, work)
    positions = {n: b.carrier.position for n, b in linked.items()}
    order = list(linked.values())
    for b in order:
        energies(b, gravity)
    for fixture in dict.fromkeys(fixture_of.values()):
        carrier = linked[fixture.body].carrier if fixture.body else GROUND_MOTION
        _frame(work, fixture, carrier, gravity)
    work.contributions += equations_of_motion(order, positions, gravity, written)
    if shown_bodies := [n for n, c in bodies.items() if c.options["reactions"]]:
        joint_reactions(order, shown_bodies, positions, gravity, written)
    _order_states(model, bodies, work)


def _link(
    name: str,
    body: RigidBody,
    fixture_of: dict[str, Fixture],
    linked: dict[str, Linked],
    net: Network,
    kin: Kinematics,
    work: Assembly,
) -> Linked:
    attached_to = fixture_of.get(f"{name}.parent")
    parent = linked[attached_to.body] if attached_to and attached_to.body else None
    writer = Writer(work, f"{variable(name)}_", name)  # three underscores: names that nobody else has
    own = _coordinates(name, body, net, kin, writer)
    carrier, freedoms = move(
        writer,
        name,
        parent.carrier if parent else GROUND_MOTION,
        attached_to.offset if attached_to else ZERO_VECTOR,
        attached_to.angles if attached_to else ZERO_VECTOR,
        own,
        body.body_rates,
    )
    loads = tuple(f for f in dict.fromkeys(fixture_of.values()) if f.body == name and f.users)
    chain: tuple[Freedom, ...] = (*(parent.chain if parent else ()), *freedoms)
    return Linked(name=name, writer=writer, carrier=carrier, parent=parent, chain=chain, loads=loads)


def _coordinates(name: str, body: RigidBody, net: Network, kin: Kinematics, w: Writer) -> dict[str, Moving]:
    """Return the six coordinates of a body; where an angle is not an axis of its own, add its states."""
    work = w.work
    own: dict[str, Moving] = {}
    for coordinate in COORDINATES:
        if coordinate not in body.free:
            start = body.starts[f"{coordinate}_start"]
            unit = "m" if coordinate in LENGTHS else "rad"
            value = (
                work.parameter(f"{name}.{coordinate}_start", unit, f"{coordinate} at which it is locked", start)
                if start
                else ZERO
            )
            own[coordinate] = Moving(value=value, speed=ZERO, acceleration=ZERO)
        elif not (body.body_rates and coordinate in ANGLES):
            node = net.node_of[f"{name}.{coordinate}_axis"]
            if not kin.moves(node):
                value = kin.motion(node, 0) if not node.grounded else ZERO
                own[coordinate] = Moving(value=value, speed=ZERO, acceleration=ZERO)
                continue
            motion = kin.of(node)
            position, speed, acceleration = (kin.motion(node, k) for k in range(3))
            own[coordinate] = Moving(
                value=position, speed=speed, acceleration=acceleration, factors=motion.factors, bias=motion.bias
            )
            label = "a_" + coordinate if coordinate in LENGTHS else f"{coordinate}_acceleration"
            work.output(
                f"{name}.{label}",
                "m/s**2" if coordinate in LENGTHS else "rad/s**2",
                f"acceleration of {coordinate}",
                acceleration,
            )
            if (
                node.label.name != f"{name}.{coordinate}_axis" or position not in work.derivatives
            ):  # not states of its own
                (shown, _), (rate, _) = body.coordinate_states(coordinate)
                work.output(
                    f"{name}.{shown}",
                    "m" if coordinate in LENGTHS else "rad",
                    f"coordinate {shown}",
                    position,
                )
                work.output(f"{name}.{rate}", "m/s" if coordinate in LENGTHS else "rad/s", f"speed {rate}", speed)
    if body.body_rates:
        own.update(_body_rates(name, body, w))
    return own


def _body_rates(name: str, body: RigidBody, w: Writer) -> dict[str, Moving]:
    """States of three free rotations: the angles, and the angular velocity in body axes."""
    angles = [f"{w.base}__angle_{a}" for a in ANGLES]
    speeds = [f"{w.base}__speed_w_{a}" for a in LENGTHS]
    work = w.work
    (cx, sx), (cy, sy), _ = (w.cosine_sine(f"joint_{axis}", a) for axis, a in zip(LENGTHS, angles, strict=True))
    p, q, r = speeds
    swept = w.set("swept", f"({q} * {sx} + {r} * {cx}) / {cy}")
    rates = (f"{p} + {sy} * {swept}", f"{q} * {cx} - {r} * {sx}", swept)
    own: dict[str, Moving] = {}
    for axis, coordinate, angle, speed, rate in zip(LENGTHS, ANGLES, angles, speeds, rates, strict=True):
        (_, start), (_, speed_start) = body.coordinate_states(coordinate)
        work.states.append(
            Quantity(
                name=f"{name}.{coordinate}", unit="rad", meaning=f"angle {coordinate}", variable=angle, value=start
            )
        )
        work.states.append(
            Quantity(
                name=f"{name}.w_{axis}",
                unit="rad/s",
                meaning="angular velocity, body axis",
                variable=speed,
                value=speed_start,
            )
        )
        work.derivatives[angle] = w.set(f"{coordinate}_rate", rate)
        acceleration = f"{w.base}__alpha_{axis}"
        work.derivatives[speed] = acceleration
        work.output(f"{name}.{coordinate}_rate", "rad/s", f"rate of {coordinate}", work.derivatives[angle])
        work.output(f"{name}.alpha_{axis}", "rad/s**2", "rate of w, body axis", acceleration)
        work.coordinates.append(
            Coordinate(key=speed, name=f"{name}.w_{axis}", velocity=speed, acceleration=acceleration)
        )
        own[coordinate] = Moving(value=angle, speed=speed, acceleration=acceleration, factors={speed: "1.0"})
    return own


def _frame(work: Assembly, fixture: Fixture, carrier: Carrier, gravity: Vector) -> None:
    """Write the quantities that components read at a frame."""
    shared = Writer(work, fixture.base, fixture.name)
    w = Writer(work, f"{fixture.base}_", fixture.name)
    at, arm = point(w, "origin", carrier, fixture.offset)
    fixed = w.rotation("fixed", fixture.angles)
    swing = w.vector("swing", cross(carrier.spin_world, arm))
    inward = w.vector("inward", cross(carrier.spin_world, swing))
    turned = carrier.actual.world
    shown: list[tuple[str, Vector]] = [
        ("p", at),
        ("v", w.sum("speed", carrier.velocity, swing)),
        ("w", carrier.spin_world),
        (
            "a",
            tuple(  # type: ignore[list-item]
                plus(a, b, c) for a, b, c in zip(carrier.actual.origin, cross(turned, arm), inward, strict=True)
            ),
        ),
        ("al", turned),
        ("g", gravity),
    ]
    for name, vector in shown:
        for axis, text in zip(LENGTHS, vector, strict=True):
            shared.set(f"{name}{axis}", text)
    for i, row in enumerate(matmul(carrier.rotation, fixed)):
        for j, text in enumerate(row):
            shared.set(f"r{i + 1}{j + 1}", text)
    for p in fixture.users:
        for quantity in Frame.motions:
            own = variable(p.owner, p.port_name, quantity)
            if own != f"{fixture.base}__{quantity}":
                work.renamed[own] = f"{fixture.base}__{quantity}"


def _order_states(model: ModelGraph, bodies: dict[str, RigidBody], work: Assembly) -> None:
    """Put each body's coordinates before its speeds, and states in the order of their components."""
    order = list(model.components)
    ranks: dict[str, int] = {}
    for name, body in bodies.items():
        wanted = [*body.free, *(body.speed_name(c) for c in body.free)]
        ranks.update({f"{name}.{item}": k for k, item in enumerate(wanted)})
    work.states.sort(key=lambda q: (owner_rank(q.name, order), ranks.get(q.name, 0)))
