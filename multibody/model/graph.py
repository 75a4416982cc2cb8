"""A machine as a named graph: components, connections, inputs, outputs and narrow features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from multibody.base.quantity_text import count_text
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Port

__all__ = ["GROUND", "Endpoint", "ModelGraph", "ModelInput", "Part"]

GROUND = "ground"


class Endpoint(str):
    """A port or signal of a named component, such as ``"guide.a"``."""


class Location(NamedTuple):
    """A name split into component and the rest: ``"carriage.guide.a"`` is ``a`` of the component ``carriage.guide``."""

    owner: str
    component: Component
    item: str


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
        endpoints = self.component.of_kind((Port, Input, Output))  # type: ignore[arg-type]
        if attribute not in endpoints:
            kind = type(self.component).__name__
            raise AttributeError(
                f"{kind} '{self.name}' has no port or signal '{attribute}'{nearest(attribute, endpoints)}"
            )
        return Endpoint(f"{self.name}.{attribute}")

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.component!r})"


@dataclass(kw_only=True)
class ModelInput:
    """A signal that enters the model from outside and the component inputs that it feeds.

    ``gain`` (relative), ``offset`` (in the unit of the targets) and ``delay`` (s) are errors of the signal; None means
    that the model has no such error.
    """

    name: str
    targets: list[str]
    default: float | None = None
    gain: float | None = None
    offset: float | None = None
    delay: float | None = None


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
        self._components: dict[str, Component] = {}
        self._connections: list[tuple[str, ...]] = []
        self._inputs: dict[str, ModelInput] = {}
        self._outputs: dict[str, str] = {}
        self._features: dict[str, tuple[float | str, str]] = {}
        self._faults: list[str] = []

    # ---------------------------------------------------------------- building

    def add(self, name: str, component: Component) -> Part:
        """Add a component under a name and return it as a `Part` whose attributes can be connected."""
        name = str(name)
        if not isinstance(component, Component):
            what = f"the class {component.__name__}" if isinstance(component, type) else f"a {type(component).__name__}"
            self._faults.append(f"'{name}' is {what}, not a component: add an instance of a Component class")
            component = Component()
        elif not hasattr(component, "values"):
            kind = type(component).__name__
            self._faults.append(f"component '{name}': {kind}.__init__ must call super().__init__(**values)")
            component = Component()
        elif name in self._components:
            self._faults.append(f"the name '{name}' is used twice: give each component its own name")
        else:
            self._components[name] = component
        return Part(name, component)

    def connect(self, *endpoints: str) -> None:
        """Connect ports to each other (or to ``model.ground``), or an output signal to input signals."""
        self._connections.append(tuple(str(e) for e in endpoints))

    def input(self, name: str, *targets: str, default: float | None = None) -> None:
        """Declare a signal that enters from outside and the component inputs that it feeds."""
        if name in self._inputs:
            self._faults.append(f"the model input '{name}' is declared twice")
        self._inputs[name] = ModelInput(name=name, targets=[str(t) for t in targets], default=default)

    def output(self, name: str, source: str) -> None:
        """Give a second name to a component's output, state or port quantity, such as ``"drive.flange.force"``."""
        if name in self._outputs:
            self._faults.append(f"the model output '{name}' is declared twice")
        self._outputs[name] = str(source)

    def feature(self, what: str, width: float | str, speed: str) -> None:
        """Declare a narrow feature that passes by, such as a tooth or a bend of a rail: no step jumps over it.

        Parameters
        ----------
        what : str
            A name for it.
        width : float or str
            Its width, or ``"component.table"``: the least distance of that table's points.
        speed : str
            State or output of the model at whose speed it passes; without that signal the feature is ignored.
        """
        self._features[what] = (width, speed)

    def remove(self, name: str) -> None:
        """Remove a component with its ends of connections, and what then connects or feeds nothing."""
        left = (tuple(end for end in ends if self.owner(end) != name) for ends in self._connections)
        self._connections = [ends for ends in left if len(ends) > 1]
        for entry in self._inputs.values():
            entry.targets = [target for target in entry.targets if self.owner(target) != name]
        self._inputs = {k: entry for k, entry in self._inputs.items() if entry.targets}
        del self._components[name]

    def replace(self, name: str, component: Component) -> None:
        """Put another component, which has what of the first is connected, in the place of one."""
        self._components[self.part(name).name] = component

    def disconnect(self, endpoint: str) -> None:
        """Remove every connection of an endpoint."""
        self._connections = [ends for ends in self._connections if endpoint not in ends]

    def remove_input(self, name: str) -> ModelInput:
        """Remove a model input and return it."""
        return self._inputs.pop(name)

    def remove_output(self, name: str) -> None:
        """Remove a second name of a quantity."""
        del self._outputs[name]

    def redirect_output(self, name: str, source: str) -> None:
        """Let the second name of a quantity stand for another one."""
        self._outputs[name] = str(source)

    # ---------------------------------------------------------------- looking

    @property
    def features(self) -> dict[str, tuple[float | str, str]]:
        """Narrow features: width and speed by name (see `feature`)."""
        return dict(self._features)

    @property
    def components(self) -> dict[str, Component]:
        """The components by name, in the order in which they were added."""
        return dict(self._components)

    @property
    def stepped_part(self) -> str | None:
        """The name of the component that steps itself (`Component.steps_itself`), None where there is none."""
        return next((name for name, part in self._components.items() if part.steps_itself), None)

    @property
    def connections(self) -> list[tuple[str, ...]]:
        """The connections as they were made."""
        return list(self._connections)

    @property
    def inputs(self) -> dict[str, ModelInput]:
        """The declared model inputs by name."""
        return dict(self._inputs)

    @property
    def outputs(self) -> dict[str, str]:
        """Second names of quantities: name → component quantity."""
        return dict(self._outputs)

    @property
    def declared_faults(self) -> list[str]:
        """Faults found while the model was built up (a name used twice, not a component)."""
        return list(self._faults)

    def part(self, name: str) -> Part:
        """Return a component of the model as a `Part`."""
        if name not in self._components:
            raise KeyError(f"model '{self.name}' has no component '{name}'{nearest(name, self._components)}")
        return Part(name, self._components[name])

    def find(self, endpoint: str) -> Location | None:
        """Split ``"carriage.guide.a"`` into component name, component and the rest; None without such a component."""
        pieces = endpoint.split(".")
        for cut in range(len(pieces) - 1, 0, -1):
            name = ".".join(pieces[:cut])
            if name in self._components:
                return Location(name, self._components[name], ".".join(pieces[cut:]))
        return None

    def owner(self, endpoint: str) -> str:
        """Return the name of the component that an endpoint belongs to; empty when there is none."""
        location = self.find(endpoint)
        return location.owner if location is not None else ""

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self.name!r}: {count_text(len(self._components), 'component')}, "
            f"{count_text(len(self._connections), 'connection')}, {count_text(len(self._inputs), 'input')})"
        )
