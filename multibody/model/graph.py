"""A machine as a named graph: components, what is connected to what, what comes in and what is looked at."""

from __future__ import annotations

from dataclasses import dataclass, field

from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Port

__all__ = ["GROUND", "Endpoint", "ModelGraph", "ModelInput", "Part"]

GROUND = "ground"


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


class ModelGraph:
    """A named graph of components: the data that assembly, files and descriptions take.

    Parameters
    ----------
    name : str
        Name of the machine, used in messages, tables and files.
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

    def __repr__(self) -> str:
        graph = self._graph
        return (
            f"{type(self).__name__}({self.name!r}: {len(graph.components)} components, "
            f"{len(graph.connections)} connections, {len(graph.inputs)} inputs)"
        )
