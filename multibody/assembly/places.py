"""Where an effect can act: every relative motion in the machine's topology."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from multibody.declare.declarations import Rotation, Translation
from multibody.model.graph import ModelGraph
from multibody.model.network import Network, Node

__all__ = ["Place", "places_of"]


@dataclass(frozen=True, kw_only=True)
class Place:
    """A pair of sides that move against each other.

    Parameters
    ----------
    name : str
        The component that joins the two sides, or, for motion against the ground, the component that moves; its
        port where one name would stand for several motions.
    domain : {"translation", "rotation"}
        Kind of motion.
    first_port, second_port : str
        Endpoints of the two sides; the motion is that of the first relative to the second; ``"ground"`` possible.
    first, second : Node
        Nodes of the two sides; the second is None for the ground.
    also : tuple of str
        Other names for the same pair.
    """

    name: str
    domain: str
    first_port: str
    second_port: str
    first: Node = field(repr=False, compare=False)
    second: Node | None = field(repr=False, compare=False, default=None)
    also: tuple[str, ...] = ()

    def motion_names(self) -> tuple[tuple[str, str], ...]:
        """Names and units of position, rate and acceleration."""
        port: type[Translation] | type[Rotation] = Translation if self.domain == "translation" else Rotation
        names = (port.potential, port.rate, "acceleration")
        return tuple((name, port.units[name]) for name in names)

    @property
    def force_unit(self) -> str:
        """Unit of what acts between the two sides."""
        return "N" if self.domain == "translation" else "N*m"


def places_of(model: ModelGraph, net: Network, moves: Callable[[Node], bool]) -> list[Place]:
    """Return the places of a model, one for each pair of sides, named by the part that joins them.

    ``moves`` tells whether a node can move.
    """
    pairs_of_sides: dict[tuple[int, int], list[tuple[str, str, str, Node, Node | None]]] = {}

    def still(node: Node) -> bool:
        return node.grounded or not moves(node)

    def note(name: str, first: str, second: str, a: Node, b: Node | None) -> None:
        key = (id(a), id(b) if b is not None else 0)
        swapped = (key[1], key[0])
        pairs_of_sides.setdefault(swapped if swapped in pairs_of_sides else key, []).append((name, first, second, a, b))

    for owner, component in model.components.items():
        flanges = component.of_kind(Translation | Rotation)  # type: ignore[arg-type]
        ports = [n for n, p in flanges.items() if not p.coordinate]
        pairs = [(ports[0], ports[1])] if len(ports) == 2 and not component.is_transmission() else []
        for first, second in pairs:
            a, b = net.node_of[f"{owner}.{first}"], net.node_of[f"{owner}.{second}"]
            if a is b or a.domain != b.domain or (still(a) and still(b)):
                continue
            if still(a):
                first, second, a, b = second, first, b, a
            note(owner, f"{owner}.{first}", "ground" if still(b) else f"{owner}.{second}", a, None if still(b) else b)
    for node in net.nodes:
        if node.axes and moves(node):
            port = node.axes[0]
            note(f"{port.owner}.{port.coordinate}", port.name, "ground", node, None)
        if node.domain in ("translation", "rotation") and node.inertial and moves(node):
            port = node.inertial[0]
            note(port.owner, port.name, "ground", node, None)
    places = []
    for entries in pairs_of_sides.values():
        name, first, second, node, other = next(e for e in entries if not _named_after_another(e[0], entries))
        also = tuple(dict.fromkeys(e[0] for e in entries if e[0] != name))
        places.append(
            Place(
                name=name,
                domain=node.domain,
                first_port=first,
                second_port=second,
                first=node,
                second=other,
                also=also,
            )
        )
    return _with_distinct_names(places)


def _named_after_another(name: str, entries: list[tuple[str, str, str, Node, Node | None]]) -> bool:
    """Tell whether a part is named after a place, as ``coulomb_friction.motor`` is: the place is not named after it."""
    return any(f".{e[0]}." in f"{name}." for e in entries if e[0] != name)


def _with_distinct_names(places: list[Place]) -> list[Place]:
    """Name the places of a part with several motions by its ports; two sides that a part joins keep the part's name."""
    count = Counter(p.name for p in places)
    return [replace(p, name=p.first_port) if count[p.name] > 1 and p.second is None else p for p in places]
