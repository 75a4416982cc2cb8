"""The two classes that users hold: a model, and the compiled system that it is built into.

A model is built from components, copied with other values, compiled, saved and read; a system is simulated, linearised
and brought to rest.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from multibody.assembly.assemble import find_places
from multibody.assembly.dimensions import dimension_faults as find_dimension_faults
from multibody.base.errors import ModelError
from multibody.base.spelling import nearest
from multibody.fmi.export import to_fmu as write_fmu
from multibody.model.description import describe as describe_graph
from multibody.model.graph import ModelGraph
from multibody.model.storage import load as load_graph
from multibody.model.storage import save as save_graph
from multibody.system.compiled import CompiledSystem
from multibody.system.equilibrium import equilibrium as find_equilibrium
from multibody.system.linearize import linearize as linearize_system
from multibody.system.simulate import simulate as simulate_system

__all__ = ["Model", "System"]

_POINT = re.compile(r"(.+)\.(x|y)\[(\d+)\]\Z")


def _table_point(key: str) -> tuple[str, str, int] | None:
    """Split ``"rail.profile.y[3]"`` into table, axis and number of the point."""
    match = _POINT.match(key)
    return (match[1], match[2], int(match[3])) if match else None


class Model(ModelGraph):
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

    # ---------------------------------------------------------------- changing a copy

    def copy(self, name: str | None = None) -> Model:
        """Return an independent copy; components are values and are shared."""
        other = Model(name or self.name)
        other._components, other._connections = dict(self._components), list(self._connections)
        other._inputs = {name: replace(entry, targets=list(entry.targets)) for name, entry in self._inputs.items()}
        other._outputs, other._features = dict(self._outputs), dict(self._features)
        other._faults = list(self._faults)
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
            if key.startswith("input.") and getattr(other._inputs.get(source), kind, None) is not None:
                setattr(other._inputs[source], kind, value)
                continue
            if (point := _table_point(key)) is not None:
                curve = self.find(point[0])
                if curve is not None and curve.item in curve.component.tables:
                    points.setdefault((curve.owner, curve.item), []).append((point[1], point[2], value))
                    continue
            number = self.find(key)
            if number is None or number.item not in (*number.component.values, *number.component.starts):
                known = [f"{n}.{p}" for n, c in self._components.items() for p in (*c.values, *c.starts)]
                faults.append(f"no parameter '{key}'{nearest(key, known)}")
            else:
                changes.setdefault(number.owner, {})[number.item] = value
        if faults:
            raise ModelError(self.name, faults)
        for (owner, table), changed in points.items():
            x, y = (axis.copy() for axis in self._components[owner].tables[table])
            for axis, k, value in changed:
                (x if axis == "x" else y)[k] = value
            changes.setdefault(owner, {})[table] = (x, y)
        for name, change in changes.items():
            other._components[name] = self._components[name].copy(**change)
        return other

    def with_input_error(self, name: str, **errors: float) -> Model:
        """Return a copy in which an input has a ``gain`` (relative), ``offset`` or ``delay`` (s) error."""
        if name not in self._inputs:
            raise KeyError(f"model '{self.name}' has no input '{name}'{nearest(name, self._inputs)}")
        other = self.copy()
        for kind, value in errors.items():
            if kind not in ("gain", "offset", "delay"):
                raise ValueError(f"an input has no '{kind}' error: give gain, offset or delay")
            setattr(other._inputs[name], kind, value)
        return other

    # ---------------------------------------------------------------- compiling and looking

    def build(
        self,
        *,
        probes: bool = False,
        energy: bool = False,
        outputs: Iterable[str] | None = None,
        compiled: bool = True,
    ) -> System:
        """Check the model, assemble its equations and return the compiled `System`; arguments as of `System`.

        Raises
        ------
        ModelError
            With every fault of the model.
        """
        return System(self, probes=probes, energy=energy, outputs=outputs, compiled=compiled)

    places = find_places
    dimension_faults = find_dimension_faults
    describe = describe_graph

    # ---------------------------------------------------------------- files

    save = save_graph

    @staticmethod
    def load(path: str | Path) -> Model:
        """Read a model from JSON; see `multibody.model.storage.load`."""
        return load_graph(path, Model)


class System(CompiledSystem):
    """A compiled machine, as `Model.build` returns it: names, values and functions of `CompiledSystem`, and analyses.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0, position=0.1))
    >>> spring = model.add("spring", Spring(stiffness=100.0))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> system = model.build()
    >>> system
    System('oscillator': 2 states, 0 inputs, 3 parameters, 9 outputs)
    >>> system.equilibrium()["body.position"]
    0.0
    """

    model: Model

    simulate = simulate_system
    equilibrium = find_equilibrium
    linearize = linearize_system
    to_fmu = write_fmu
