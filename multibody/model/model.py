"""A machine as a named graph: components, what is connected to what, what comes in and what is looked at."""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from multibody.base.errors import ModelError
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Port

if TYPE_CHECKING:
    from pathlib import Path

    from multibody.assembly.places import Place
    from multibody.system.system import System

__all__ = ["Endpoint", "Model", "ModelInput", "Part"]

GROUND = "ground"


_POINT = re.compile(r"(.+)\.(x|y)\[(\d+)\]\Z")


def _table_point(key: str) -> tuple[str, str, int] | None:
    """Split ``"rail.profile.y[3]"`` into table, axis and number of the point."""
    found = _POINT.match(key)
    return (found[1], found[2], int(found[3])) if found else None


class Endpoint(str):
    """A port or signal of a named component, such as ``"guide.a"``."""


class Part:
    """A component in a model; its attributes are the endpoints to connect.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass
    >>> Model("m").add("carriage", Mass(m=2.0)).flange
    'carriage.flange'
    """

    def __init__(self, name: str, component: Component):
        self.name = name
        self.component = component

    def __getattr__(self, attribute: str) -> Endpoint:
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        known = self.component.of_kind((Port, Input, Output))  # type: ignore[arg-type]
        if attribute not in known:
            kind = type(self.component).__name__
            raise AttributeError(
                f"{kind} '{self.name}' has no port or signal '{attribute}'{nearest(attribute, known)}"
            )
        return Endpoint(f"{self.name}.{attribute}")

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.component!r})"


@dataclass
class ModelInput:
    """A signal that enters the model from outside and the component inputs that it feeds.

    ``gain`` (relative), ``offset`` (in the signal's unit) and ``delay`` (s) are errors of the signal on its
    way in; None means that the model has no such error.
    """

    name: str
    targets: list[str]
    unit: str = ""
    default: float | None = None
    gain: float | None = None
    offset: float | None = None
    delay: float | None = None


@dataclass
class _Graph:
    components: dict[str, Component] = field(default_factory=dict)
    connections: list[tuple[str, ...]] = field(default_factory=list)
    inputs: dict[str, ModelInput] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    features: dict[str, tuple[float | str, str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


class Model:
    """A named graph of components.

    Parameters
    ----------
    name : str
        Name of the machine, used in messages, tables and files.

    Examples
    --------
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0, position=0.1))
    >>> spring = model.add("spring", Spring(stiffness=100.0))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> model.build().state_names
    ('body.position', 'body.velocity')
    """

    def __init__(self, name: str):
        self.name = name
        self.ground = Endpoint(GROUND)
        self._graph = _Graph()

    # ---------------------------------------------------------------- building

    def add(self, name: str, component: Component) -> Part:
        """Add a component under a name and return it as a `Part` whose attributes can be connected."""
        graph = self._graph
        name = str(name)
        if not isinstance(component, Component):
            told = (
                f"the class {component.__name__}"
                if isinstance(component, type)
                else f"a {type(component).__name__}"
            )
            graph.faults.append(f"'{name}' is {told}, not a component: add an instance of a Component class")
            component = Component()
        elif not hasattr(component, "values"):
            kind = type(component).__name__
            graph.faults.append(f"component '{name}': {kind}.__init__ must call super().__init__(**values)")
            component = Component()
        elif name in graph.components:
            graph.faults.append(f"the name '{name}' is used twice: give each component its own name")
        else:
            graph.components[name] = component
        return Part(name, component)

    def connect(self, *endpoints: str) -> None:
        """Connect ports to each other (or to ``model.ground``), or an output signal to input signals."""
        self._graph.connections.append(tuple(str(e) for e in endpoints))

    def input(self, name: str, *targets: str, default: float | None = None) -> None:
        """Declare a signal that enters from outside and the component inputs that it feeds."""
        if name in self._graph.inputs:
            self._graph.faults.append(f"the model input '{name}' is declared twice")
        self._graph.inputs[name] = ModelInput(name, [str(t) for t in targets], default=default)

    def output(self, name: str, source: str) -> None:
        """Give a second name to a component's output, state or port quantity, such as
        ``"drive.flange.force"``.
        """
        if name in self._graph.outputs:
            self._graph.faults.append(f"the model output '{name}' is declared twice")
        self._graph.outputs[name] = str(source)

    # ---------------------------------------------------------------- looking

    def feature(self, what: str, width: float | str, speed: str) -> None:
        """Declare that something narrow passes by, such as a tooth or a bend of a rail, which no step may jump over.

        Parameters
        ----------
        what : str
            A name for it.
        width : float or str
            How wide it is, or ``"component.table"`` whose closest points count.
        speed : str
            State or output of the model at whose speed it passes; without that signal it does not count.
        """
        self._graph.features[what] = (width, speed)

    @property
    def features(self) -> dict[str, tuple[float | str, str]]:
        """What passes by: width and speed by name (see `feature`)."""
        return dict(self._graph.features)

    @property
    def components(self) -> dict[str, Component]:
        """The components by name, in the order in which they were added."""
        return dict(self._graph.components)

    @property
    def connections(self) -> list[tuple[str, ...]]:
        """The connections as they were made."""
        return list(self._graph.connections)

    @property
    def inputs(self) -> dict[str, ModelInput]:
        """The declared model inputs by name."""
        return dict(self._graph.inputs)

    @property
    def outputs(self) -> dict[str, str]:
        """Second names of quantities: name → component quantity."""
        return dict(self._graph.outputs)

    @property
    def declared_faults(self) -> list[str]:
        """Faults met while the model was put together (a name used twice, not a component)."""
        return list(self._graph.faults)

    def part(self, name: str) -> Part:
        """Return a component of the model as a `Part`."""
        if name not in self._graph.components:
            raise KeyError(
                f"model '{self.name}' has no component '{name}'{nearest(name, self._graph.components)}"
            )
        return Part(name, self._graph.components[name])

    def find(self, endpoint: str) -> tuple[str, Component, str] | None:
        """Split ``"carriage.guide.a"`` into component name, component and the rest; None when no component
        fits.
        """
        pieces = endpoint.split(".")
        for cut in range(len(pieces) - 1, 0, -1):
            name = ".".join(pieces[:cut])
            if name in self._graph.components:
                return name, self._graph.components[name], ".".join(pieces[cut:])
        return None

    # ---------------------------------------------------------------- changing a copy

    def copy(self, name: str | None = None) -> Model:
        """Return an independent copy; components are values and are shared."""
        other = Model(name or self.name)
        other._graph = copy.copy(self._graph)
        for slot in ("components", "connections", "inputs", "outputs", "features", "faults"):
            setattr(other._graph, slot, copy.copy(getattr(self._graph, slot)))
        other._graph.inputs = {k: copy.deepcopy(v) for k, v in self._graph.inputs.items()}
        return other

    def with_values(self, values: dict[str, float]) -> Model:
        """Return a copy with parameters replaced, given as ``{"mass.m": 96.0}`` in SI.

        Raises
        ------
        ModelError
            If a name is not a parameter or start value of the model.
        """
        other, faults = self.copy(), []
        changes: dict[str, dict[str, Any]] = {}
        points: dict[tuple[str, str], list[tuple[str, int, float]]] = {}
        for key, value in values.items():
            kind = key.rpartition(".")[2]
            source = key.removeprefix("input.").rpartition(".")[0]
            if key.startswith("input.") and getattr(other._graph.inputs.get(source), kind, None) is not None:
                setattr(other._graph.inputs[source], kind, value)
                continue
            if (point := _table_point(key)) is not None:
                found = self.find(point[0])
                if found is not None and found[2] in found[1].tables:
                    points.setdefault((found[0], found[2]), []).append((point[1], point[2], value))
                    continue
            found = self.find(key)
            if found is None or found[2] not in (*found[1].values, *found[1].starts):
                known = [
                    f"{n}.{p}" for n, c in self._graph.components.items() for p in (*c.values, *c.starts)
                ]
                faults.append(f"no parameter '{key}'{nearest(key, known)}")
            else:
                changes.setdefault(found[0], {})[found[2]] = value
        if faults:
            raise ModelError(self.name, faults)
        for (owner, table), moved in points.items():
            x, y = (axis.copy() for axis in self._graph.components[owner].tables[table])
            for axis, k, value in moved:
                (x if axis == "x" else y)[k] = value
            changes.setdefault(owner, {})[table] = (x, y)
        for name, change in changes.items():
            other._graph.components[name] = self._graph.components[name].copy(**change)
        return other

    def with_input_error(self, name: str, **errors: float) -> Model:
        """Return a copy in which an input has a ``gain`` (relative), ``offset`` or ``delay`` (s) error."""
        if name not in self._graph.inputs:
            raise KeyError(f"model '{self.name}' has no input '{name}'{nearest(name, self._graph.inputs)}")
        other = self.copy()
        for kind, value in errors.items():
            if kind not in ("gain", "offset", "delay"):
                raise ValueError(f"an input has no '{kind}' error: give gain, offset or delay")
            setattr(other._graph.inputs[name], kind, value)
        return other

    def build(self, **options: Any) -> System:
        """Check the model, assemble its equations and return the compiled `System`.

        Raises
        ------
        ModelError
            With every fault of the model.
        """
        from multibody.system.system import System

        return System(self, **options)

    def places(self) -> list[Place]:
        """Return where an effect could act: every pair of sides that can move against each other.

        Raises
        ------
        ModelError
            If the model has faults.
        """
        from multibody.assembly.assemble import find_places

        return find_places(self)

    def describe(self) -> str:
        """Return a table of components, connections, inputs and outputs as text."""
        from multibody.model.description import describe

        return describe(self)

    # ---------------------------------------------------------------- files

    def save(self, path: str | Path) -> Path:
        """Write the model as JSON; see `multibody.model.storage.save`."""
        from multibody.model.storage import save

        return save(self, path)

    @staticmethod
    def load(path: str | Path) -> Model:
        """Read a model from JSON; see `multibody.model.storage.load`."""
        from multibody.model.storage import load

        return load(path)

    def __repr__(self) -> str:
        graph = self._graph
        return (
            f"Model({self.name!r}: {len(graph.components)} components, {len(graph.connections)} connections, "
            f"{len(graph.inputs)} inputs)"
        )
