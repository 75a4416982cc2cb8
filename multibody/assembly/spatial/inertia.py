"""Newton's law for a tree of bodies: mass matrix and forces over the free motions, energies, joints.

For free motion j and body b that it carries, ``J_j`` is the velocity of the centre of mass (world axes) and
``W_j`` the angular velocity (body axes) for unit speed.  Then M_ij = Σ_b m J_i·J_j + W_i·I W_j.  Forces are
gathered from the leaves to the root: each body adds what acts on it and its inertia force for unchanged
speeds, and hands force and moment on to its parent; free motion j takes their part along its axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from multibody.assembly.equation_set import Contribution
from multibody.assembly.spatial.frames import Fixture
from multibody.assembly.spatial.motion import Carrier, Freedom
from multibody.assembly.spatial.symbols import (
    ONE,
    ZERO,
    ZERO_VECTOR,
    Matrix,
    Vector,
    Writer,
    cross,
    dot,
    neg,
    plus,
    times,
    transpose,
    turn,
)
from multibody.declare.rigid_body import LENGTHS
from multibody.equations.statements import variable

__all__ = ["Linked", "energies", "equations_of_motion", "joint_reactions"]


@dataclass(frozen=True, kw_only=True)
class Linked:
    """A body in its tree.

    Parameters
    ----------
    name : str
    writer : Writer
    carrier : Carrier
    parent : Linked or None
        None on the ground.
    chain : tuple of Freedom
        Free motions that carry it, its own last.
    loads : tuple of Fixture
        Its frames on which a force or moment acts.
    """

    name: str
    writer: Writer
    carrier: Carrier
    parent: Linked | None
    chain: tuple[Freedom, ...]
    loads: tuple[Fixture, ...] = ()

    @property
    def mass(self) -> str:
        """Variable of the mass."""
        return variable(self.name, "mass")

    @property
    def tensor(self) -> Matrix:
        """Variables of the inertia tensor about the centre of mass."""
        return tuple(  # type: ignore[return-value]
            tuple(variable(self.name, f"I_{''.join(sorted(a + b))}") for b in LENGTHS) for a in LENGTHS
        )

    @property
    def root(self) -> str:
        """Name of the body of this tree that is attached to the ground."""
        return self.parent.root if self.parent else self.name

    def arm(self) -> Vector:
        """Return the arm from the origin to the centre of mass, world axes."""
        com: Vector = tuple(variable(self.name, f"com_{a}") for a in LENGTHS)  # type: ignore[assignment]
        return self.writer.vector("com_arm", turn(self.carrier.rotation, com))


def equations_of_motion(
    bodies: list[Linked], positions: Mapping[str, Vector], gravity: Vector, written: set[str]
) -> list[Contribution]:
    """Return mass and force over the free motions of each tree, their texts written out.

    Parameters
    ----------
    bodies : list of Linked
        Parents before children.
    positions : mapping
        Origin of each body in world axes.
    gravity : tuple of str
        Acceleration of free fall.
    written : set of str
        Variables that some equation determines; forces and moments among them count.
    """
    mass: dict[tuple[str, str], list[str]] = {}
    sums = {b.name: _own_load(b, gravity, written) for b in bodies}
    for b in bodies:
        _add_mass(b, positions, mass)
    force: dict[str, str] = {}
    for b in reversed(bodies):
        f, n, n_own = sums[b.name]
        f, n, n_own = b.writer.vector("f", f), b.writer.vector("n", n), b.writer.vector("n_own", n_own)
        for j in b.chain:
            if j.body == b.name:
                text = plus(dot(j.axis, n), dot(j.own_axis, n_own)) if j.turns else dot(j.axis, f)
                force[j.name] = b.writer.set(f"Q_{j.name.rpartition('.')[2]}", text)
        if b.parent:
            lever = b.writer.vector("lever", _minus(positions[b.name], positions[b.parent.name]))
            handed = b.writer.sum("handed", n, turn(b.carrier.rotation, n_own), cross(lever, f))
            upper = sums[b.parent.name]
            sums[b.parent.name] = (_plus(upper[0], f), _plus(upper[1], handed), upper[2])
    entries = {
        (i, j): _writer_of(bodies, i).let(f"M_{i}_{j}".replace(".", "_"), plus(*terms))
        for (i, j), terms in mass.items()
    }
    _needed(bodies, entries, force)
    trees: dict[str, dict[str, Freedom]] = {}
    for b in bodies:
        trees.setdefault(b.root, {}).update({j.name: j for j in b.chain})
    parts = []
    for root, freedoms in trees.items():
        place = {name: k for k, name in enumerate(freedoms)}
        half = {(place[i], place[j]): var for (i, j), var in entries.items() if i in place}
        parts.append(
            Contribution(
                origin=root,
                rows=tuple(dict(j.moving.factors) for j in freedoms.values()),
                mass=half | {(s, r): var for (r, s), var in half.items()},
                bias=tuple(j.moving.bias for j in freedoms.values()),
                force=tuple(force[name] for name in freedoms),
            )
        )
    return [part for part in parts if part.rows]


def _writer_of(bodies: list[Linked], freedom: str) -> Writer:
    return next(b.writer for b in bodies if any(j.name == freedom and j.body == b.name for j in b.chain))


def _needed(bodies: list[Linked], entries: Mapping[tuple[str, str], str], force: Mapping[str, str]) -> None:
    """Write the force along each axis that its motion needs beyond what acts on frames (for gears)."""
    freedoms = {j.name: j for b in bodies for j in b.chain}
    for name, j in freedoms.items():
        terms = [
            times(var, freedoms[m if n == name else n].moving.acceleration)
            for (n, m), var in entries.items()
            if name in (n, m)
        ]
        writer = _writer_of(bodies, name)
        axis = f"{variable(j.body)}__{name.rpartition('.')[2]}_axis"
        writer.work.add(f"{axis}___needed = {plus(*terms, neg(force[name]))}", j.body)


def _minus(a: Vector, b: Vector) -> Vector:
    pairs = zip(a, b, strict=True)
    return tuple(plus(x, neg(y)) if x != y else ZERO for x, y in pairs)  # type: ignore[return-value]


def _plus(*vectors: Vector) -> Vector:
    return tuple(plus(*parts) for parts in zip(*vectors, strict=True))  # type: ignore[return-value]


def _scaled(factor: str, v: Vector) -> Vector:
    return tuple(times(factor, x) for x in v)  # type: ignore[return-value]


def _add_mass(b: Linked, positions: Mapping[str, Vector], mass: dict[tuple[str, str], list[str]]) -> None:
    w, arm = b.writer, b.arm()
    own_axes = transpose(b.carrier.rotation)
    shifts: dict[str, Vector] = {b.name: arm}
    columns: list[tuple[Freedom, Vector, Vector, Vector]] = []
    for j in b.chain:
        tag = j.name.replace(".", "_")
        if not j.turns:
            columns.append((j, j.axis, ZERO_VECTOR, ZERO_VECTOR))
            continue
        if j.body not in shifts:
            shifts[j.body] = w.vector(
                f"from_{j.body.replace('.', '_')}", _plus(arm, _minus(positions[b.name], positions[j.body]))
            )
        turned = j.own_axis if j.body == b.name else w.vector(f"W_{tag}_", turn(own_axes, j.axis))
        moved = w.vector(f"J_{tag}_", cross(j.axis, shifts[j.body]))
        columns.append((j, moved, turned, w.vector(f"H_{tag}_", turn(b.tensor, turned))))
    for k, (i, moved_i, turned_i, _) in enumerate(columns):
        for j, moved_j, _, spun_j in columns[k:]:
            if i.body == j.body and not i.turns and not j.turns:  # axes of one frame
                product = ONE if i is j else ZERO
            else:
                product = dot(moved_i, moved_j)
            text = plus(times(b.mass, product), dot(turned_i, spun_j))
            if text != ZERO:
                mass.setdefault((i.name, j.name), []).append(text)


def _own_load(b: Linked, gravity: Vector, written: set[str]) -> tuple[Vector, Vector, Vector]:
    """Force and moment about the origin (world axes), gyroscopic moment (body axes), at unchanged speeds."""
    w, c, arm = b.writer, b.carrier, b.arm()
    sway = w.vector("com_bias", _com_acceleration(w, "bias", c, arm))
    weight = w.vector("weight", _scaled(b.mass, _minus(gravity, sway)))
    force, moment = _plus(weight), cross(arm, weight)
    for load in b.loads:
        f, m, at = _load_at(b, load, written)
        force, moment = _plus(force, f), _plus(moment, m, cross(at, f))
    momentum = w.vector("momentum", turn(b.tensor, c.spin))
    gyro = _plus(turn(b.tensor, c.bias.body), cross(c.spin, momentum))
    return force, moment, tuple(neg(x) for x in gyro)  # type: ignore[return-value]


def _com_acceleration(w: Writer, kind: str, c: Carrier, arm: Vector) -> Vector:
    acceleration = c.bias if kind == "bias" else c.actual
    round_ = w.vector("com_swing", cross(c.spin_world, arm))
    return _plus(
        acceleration.origin,
        w.vector(f"com_{kind}_t", cross(acceleration.world, arm)),
        w.vector("com_round", cross(c.spin_world, round_)),
    )


def _load_at(b: Linked, load: Fixture, written: set[str]) -> tuple[Vector, Vector, Vector]:
    """Force and moment at a frame, summed over the components that act there, and the arm to it."""
    w, tag = b.writer, load.name.rpartition(".")[2]

    def total(flow: str) -> Vector:
        parts = [[variable(p.owner, p.port_name, f"{flow}{a}") for p in load.users] for a in LENGTHS]
        return w.vector(f"{tag}_{flow}", [plus(*(v for v in axis if v in written)) for axis in parts])

    return total("f"), total("m"), w.vector(f"{tag}_arm", turn(b.carrier.rotation, load.offset))


def energies(b: Linked, gravity: Vector) -> None:
    """Write kinetic and potential energy of a body."""
    w, c, arm = b.writer, b.carrier, b.arm()
    speed = w.sum("com_v", c.velocity, w.vector("com_swing", cross(c.spin_world, arm)))
    momentum = w.vector("momentum", turn(b.tensor, c.spin))
    kinetic = plus(times("0.5", b.mass, dot(speed, speed)), times("0.5", dot(c.spin, momentum)))
    w.work.kinetic.append((b.name, w.set("kinetic_energy", kinetic)))
    place = w.sum("com_at", c.position, arm)
    w.work.potential.append((b.name, w.set("potential_energy", neg(times(b.mass, dot(gravity, place))))))


def joint_reactions(
    bodies: list[Linked],
    shown: list[str],
    positions: Mapping[str, Vector],
    gravity: Vector,
    written: set[str],
) -> None:
    """Write force and moment (about its origin, world axes) that the parent frame exerts on each body.

    Only bodies in ``shown`` get the outputs ``joint_force_x``, …, ``joint_moment_z``.
    """
    above: dict[str, tuple[Vector, Vector]] = {b.name: (ZERO_VECTOR, ZERO_VECTOR) for b in bodies}
    for b in reversed(bodies):
        w, c, arm = b.writer, b.carrier, b.arm()
        true = w.vector("com_true", _com_acceleration(w, "true", c, arm))
        needed = w.vector("needed", _scaled(b.mass, _minus(true, gravity)))
        momentum = w.vector("momentum", turn(b.tensor, c.spin))
        spun = w.vector("spun", _plus(turn(b.tensor, c.actual.body), cross(c.spin, momentum)))
        force, moment = needed, _plus(cross(arm, needed), turn(c.rotation, spun))
        for load in b.loads:
            f, m, at = _load_at(b, load, written)
            force = _plus(force, tuple(neg(x) for x in f))  # type: ignore[arg-type]
            pull = _plus(m, cross(at, f))
            moment = _plus(moment, tuple(neg(x) for x in pull))  # type: ignore[arg-type]
        force = w.vector("joint_f", _plus(force, above[b.name][0]))
        moment = w.vector("joint_n", _plus(moment, above[b.name][1]))
        if b.parent:
            lever = w.vector("lever", _minus(positions[b.name], positions[b.parent.name]))
            upper = above[b.parent.name]
            above[b.parent.name] = (_plus(upper[0], force), _plus(upper[1], moment, cross(lever, force)))
        if b.name in shown:
            for k, a in enumerate(LENGTHS):
                for what, unit, vector in (("force", "N", force), ("moment", "N*m", moment)):
                    var = w.set(f"joint_{what}_{a}", vector[k])
                    w.work.output(f"{b.name}.joint_{what}_{a}", unit, f"{what} of the parent frame on the body", var)
