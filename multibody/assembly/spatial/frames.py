"""What each frame of a model is fixed to: a body, the ground, or a frame that another component brings."""

from __future__ import annotations

from dataclasses import dataclass

from multibody.assembly.spatial.symbols import ZERO, ZERO_VECTOR, Vector, neg
from multibody.declare.declarations import Frame
from multibody.declare.rigid_body import RigidBody
from multibody.equations.statements import variable
from multibody.model.network import Network, PortOf

__all__ = ["Fixture", "circles", "fixtures"]


@dataclass(frozen=True, kw_only=True)
class Fixture:
    """Where a frame is fixed.

    Parameters
    ----------
    base : str
        Start of the variables of its motion.
    body : str or None
        Name of the body; None for the ground.
    offset, angles : tuple of str
        Place on the body in body axes and turn (roll, pitch, yaw) against them, as variables.
    users : tuple of PortOf
        Ports through which components act on the frame.
    name : str
        For messages.
    """

    base: str
    body: str | None
    offset: Vector
    angles: Vector
    users: tuple[PortOf, ...]
    name: str


def fixtures(net: Network, faults: list[str]) -> dict[str, Fixture]:
    """Return what the frame at each endpoint is fixed to; a frame fixed to nothing or to two things is a fault."""
    fixture_of: dict[str, Fixture] = {}
    for node in net.frames:
        holders = [p for p in node.ports if _frame(p).offset is not None]
        attached = [p for p in node.ports if _frame(p).parent]
        users = tuple(p for p in node.ports if p not in holders and p not in attached)
        if len(holders) + node.grounded > 1:
            holding = " and ".join([f"'{p.name}'" for p in holders] + (["the ground"] if node.grounded else []))
            faults.append(
                f"{holding} are joined, but each is fixed already: attach one body to the other by its "
                "'parent' frame, or put a FrameSpring between them"
            )
            continue
        if not holders and not node.grounded and (users or len(attached) > 1):
            names = ", ".join(f"'{p.name}'" for p in node.ports)
            faults.append(
                f"nothing fixes the frame at {names}: connect it to a frame of a body, a FixedFrame or the ground"
            )
            continue
        fixture = (
            _fixture(holders[0], users)
            if holders
            else Fixture(
                base=variable(node.ports[0].owner, node.ports[0].port_name),
                body=None,
                offset=ZERO_VECTOR,
                angles=ZERO_VECTOR,
                users=users,
                name="the ground",
            )
        )
        for p in node.ports:
            fixture_of[p.name] = fixture
    return fixture_of


def _frame(port: PortOf) -> Frame:
    assert isinstance(port.port, Frame)  # nodes of frames hold nothing else
    return port.port


def _fixture(holder: PortOf, users: tuple[PortOf, ...]) -> Fixture:
    frame = _frame(holder)

    def place(name: str | None) -> str:
        """Variable of a parameter, perhaps with a minus; what the component's options leave out is zero."""
        if name is None or name.removeprefix("-") not in holder.component.values:
            return ZERO
        var = variable(holder.owner, name.removeprefix("-"))
        return neg(var) if name.startswith("-") else var

    offset, angles = ((place(a), place(b), place(c)) for a, b, c in (frame.offset_names, frame.angle_names))
    body = holder.owner if isinstance(holder.component, RigidBody) else None
    base = variable(holder.owner, holder.port_name)
    return Fixture(base=base, body=body, offset=offset, angles=angles, users=users, name=holder.name)


def circles(parents: dict[str, str | None]) -> list[list[str]]:
    """Return the circles in a map from body to parent body, each as the list of its bodies."""
    loops: list[list[str]] = []
    cleared: set[str] = set()
    for start in parents:
        path: list[str] = []
        body: str | None = start
        while body is not None and body not in cleared and body not in path:
            path.append(body)
            body = parents.get(body)
        if body is not None and body in path:
            loops.append(path[path.index(body) :])
        cleared |= set(path)
    return loops
