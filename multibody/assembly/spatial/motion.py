"""Position, velocity and acceleration of bodies and points on them, from the root of a tree outwards.

Points and their velocities stand in world axes.  Angular velocity is kept in body axes, where the inertia
tensor is constant, and in world axes, where points need it.  There are two accelerations: ``bias`` is the
one at constant independent speeds (it enters Newton's law), ``actual`` is the true one (which a sensor measures).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from multibody.assembly.spatial.symbols import (
    ONE,
    UNIT,
    ZERO,
    ZERO_VECTOR,
    Matrix,
    Vector,
    Writer,
    cross,
    matmul,
    neg,
    plus,
    times,
    transpose,
    turn,
)
from multibody.declare.rigid_body import ANGLES, LENGTHS

__all__ = ["GROUND_MOTION", "Acceleration", "Carrier", "Freedom", "Moving", "move", "point"]


@dataclass(frozen=True)
class Acceleration:
    """Acceleration of a body's origin (world axes) and angular acceleration in body and in world axes."""

    origin: Vector = ZERO_VECTOR
    body: Vector = ZERO_VECTOR
    world: Vector = ZERO_VECTOR


@dataclass(frozen=True, kw_only=True)
class Carrier:
    """Motion of a body or of the ground.

    ``rotation`` maps body axes to world axes; ``spin`` is the angular velocity in body axes, ``spin_world``
    in world axes.
    """

    rotation: Matrix = UNIT
    position: Vector = ZERO_VECTOR
    velocity: Vector = ZERO_VECTOR
    spin: Vector = ZERO_VECTOR
    spin_world: Vector = ZERO_VECTOR
    bias: Acceleration = Acceleration()
    actual: Acceleration = Acceleration()


GROUND_MOTION = Carrier()


@dataclass(frozen=True, kw_only=True)
class Moving:
    """One coordinate of a body: value, speed, acceleration, and its rows over independent coordinates.

    ``factors`` and ``bias`` say how the acceleration follows from independent ones (as a rule
    ``{own key: "1.0"}``).
    """

    value: str
    speed: str
    acceleration: str
    factors: Mapping[str, str] = field(default_factory=dict)
    bias: str | None = None


@dataclass(frozen=True, kw_only=True)
class Freedom:
    """A free motion as Newton's law needs it.

    Parameters
    ----------
    name : str
        Such as ``"cabin.z"``.
    body : str
        The body that moves, with everything attached to it.
    turns : bool
        Rotation about an axis through the body's origin, or translation.
    axis : tuple of str
        Unit vector in world axes.
    own_axis : tuple of str
        For a rotation the same in axes of ``body``.
    moving : Moving
    """

    name: str
    body: str
    turns: bool
    axis: Vector
    own_axis: Vector
    moving: Moving


def point(w: Writer, name: str, carrier: Carrier, arm: Vector) -> tuple[Vector, Vector]:
    """Return the position of a point of a body, and the arm from the body's origin to it, in world axes."""
    world_arm = w.vector(f"{name}_arm", turn(carrier.rotation, arm))
    return w.sum(f"{name}_at", carrier.position, world_arm), world_arm


def move(
    w: Writer,
    body: str,
    parent: Carrier,
    offset: Vector,
    angles: Vector,
    own: Mapping[str, Moving],
    body_rates: bool,
) -> tuple[Carrier, list[Freedom]]:
    """Write the motion of a body that is attached to a frame of its parent.

    Parameters
    ----------
    w : Writer
        Named after the body.
    body : str
        Its name.
    parent : Carrier
    offset, angles : tuple of str
        The frame on the parent.
    own : mapping
        The body's six coordinates by name; a locked one has speed and acceleration ``"0.0"`` and no factors.
    body_rates : bool
        The speeds of rotation are the angular velocity in body axes.
    """
    slides, turns = [own[n] for n in LENGTHS], [own[n] for n in ANGLES]
    fixed = w.rotation("frame", angles)
    base = w.matrix("F", matmul(parent.rotation, fixed))  # axes of the parent frame, in the world
    arm = w.vector(
        "arm",
        [
            plus(a, b)
            for a, b in zip(turn(parent.rotation, offset), turn(base, _texts(m.value for m in slides)), strict=True)
        ],
    )
    sliding = w.vector("sliding", turn(base, _texts(m.speed for m in slides)))
    inner = w.rotation("joint", _texts(m.value for m in turns))
    rotation = w.matrix("R", matmul(base, inner))
    columns = transpose(rotation)
    inherit = transpose(w.matrix("P", matmul(fixed, inner)))  # parent's body axes to this body's
    inherited = w.vector("inherited", turn(inherit, parent.spin))
    own_axes = _own_axes(w, turns, body_rates)
    rates = _texts(m.speed for m in turns)
    relative = w.vector("relative", turn(transpose(own_axes), rates))
    spin = w.sum("spin", inherited, relative)
    spin_world = w.vector("w", turn(rotation, spin))
    swing = cross(parent.spin_world, arm)
    velocity = w.sum("v", parent.velocity, w.vector("swing", swing), sliding)
    # velocity products: the body turns with its parent, slides on it, and its axes turn into each other
    twice = w.vector("twice", [plus(s, times("2.0", v)) for s, v in zip(swing, sliding, strict=True)])
    carried = w.vector("carried", cross(parent.spin_world, twice))
    bent = w.vector("bent", _sum(cross(inherited, relative), _axes_turning(w, own_axes, rates, body_rates)))

    def acceleration(kind: str, of_parent: Acceleration, sliding: Vector, turning: Vector) -> Acceleration:
        origin = w.sum(
            f"{kind}_a",
            of_parent.origin,
            w.vector(f"{kind}_s", cross(of_parent.world, arm)),
            carried,
            sliding,
        )
        in_body = w.sum(
            f"{kind}_al",
            w.vector(f"{kind}_i", turn(inherit, of_parent.body)),
            bent,
            w.vector(f"{kind}_t", turn(transpose(own_axes), turning)),
        )
        return Acceleration(origin, in_body, w.vector(f"{kind}_alw", turn(rotation, in_body)))

    carrier = Carrier(
        rotation=rotation,
        position=w.sum("p", parent.position, arm),
        velocity=velocity,
        spin=spin,
        spin_world=spin_world,
        bias=acceleration("bias", parent.bias, ZERO_VECTOR, ZERO_VECTOR),
        actual=acceleration(
            "true",
            parent.actual,
            w.vector("pushed", turn(base, _texts(m.acceleration for m in slides))),
            _texts(m.acceleration for m in turns),
        ),
    )
    freedoms = [
        Freedom(name=f"{body}.{n}", body=body, turns=False, axis=column, own_axis=ZERO_VECTOR, moving=m)
        for n, m, column in zip(LENGTHS, slides, transpose(base), strict=True)
        if m.factors
    ]
    world_axes = transpose(rotation) if body_rates else _world_axes(w, base, columns, turns)
    freedoms += [
        Freedom(name=f"{body}.{n}", body=body, turns=True, axis=axis, own_axis=own_axis, moving=m)
        for n, m, axis, own_axis in zip(ANGLES, turns, world_axes, own_axes, strict=True)
        if m.factors
    ]
    return carrier, freedoms


def _texts(items: object) -> Vector:
    return tuple(items)  # type: ignore[arg-type, return-value]


def _sum(*vectors: Vector) -> Vector:
    return tuple(plus(*parts) for parts in zip(*vectors, strict=True))  # type: ignore[return-value]


def _own_axes(w: Writer, turns: list[Moving], body_rates: bool) -> Matrix:
    """Axes about which the three speeds of rotation turn, in body axes: rows roll, pitch, yaw."""
    if body_rates:
        return UNIT
    cx, sx = w.cosine_sine("joint_x", turns[0].value)
    cy, sy = w.cosine_sine("joint_y", turns[1].value)
    pitch: Vector = (ZERO, cx, neg(sx))
    yaw: Vector = w.vector("yaw_axis_in_body", (neg(sy), times(cy, sx), times(cy, cx)))
    return UNIT[0], pitch, yaw


def _axes_turning(w: Writer, axes: Matrix, rates: Vector, body_rates: bool) -> Vector:
    """Angular acceleration in body axes because the axes of later rotations turn with the earlier ones."""
    if body_rates:
        return ZERO_VECTOR
    by_roll: Vector = (rates[0], ZERO, ZERO)
    by_both = _sum(by_roll, _texts(times(a, rates[1]) for a in axes[1]))
    pitch = _texts(times(a, rates[1]) for a in cross(axes[1], by_roll))
    yaw = _texts(times(a, rates[2]) for a in cross(axes[2], by_both))
    return w.vector("turning", _sum(pitch, yaw))


def _world_axes(w: Writer, base: Matrix, columns: Matrix, turns: list[Moving]) -> Matrix:
    cz, sz = w.cosine_sine("joint_z", turns[2].value)
    between: Vector = (neg(sz), cz, ZERO)
    pitch = w.vector("pitch_axis_in_world", turn(base, between)) if between != (ZERO, ONE, ZERO) else transpose(base)[1]
    return columns[0], pitch, transpose(base)[2]
