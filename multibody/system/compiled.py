"""A compiled machine: named states, inputs, parameters and outputs, their rates, and exact Jacobians."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from multibody.assembly.assemble import find_places
from multibody.assembly.equation_set import Quantity
from multibody.assembly.places import Place
from multibody.base.errors import ModelError
from multibody.base.quantity_text import count_text
from multibody.base.spelling import nearest
from multibody.base.units import UnitError, quantity
from multibody.compile.assembled import plan_of
from multibody.compile.native import (
    RHS_ARRAYS,
    TANGENT_ARRAYS,
    NativeFunction,
    ReturningFunction,
    compile_text,
)
from multibody.compile.vector_mode import FEW_LANES, MANY_LANES, along_states
from multibody.model.graph import ModelGraph
from multibody.system.rows import jacobian_in_lanes, jacobian_rows, output_rows

__all__ = ["CompiledSystem"]


class CompiledSystem:
    """The assembled equations ẋ = f(t, x, u, p), y = h(t, x, u, p) of a model.

    Made by `Model.build`.  Vectors follow the order of ``state_names``, ``input_names``, ``parameter_names``
    and ``output_names``; every number is SI.  Functions are compiled when they are first used, once per
    structure and machine, and cached for other processes.

    Parameters
    ----------
    model : ModelGraph
        The machine.
    probes : bool
        Add an input ``probe.<place>`` for a force at every place where an effect can act.
    energy : bool
        Add states ``energy.lost`` and ``energy.supplied``.
    outputs : iterable of str, optional
        Only these outputs are computed; default: all.
    compiled : bool
        False evaluates the same text as plain Python, for debugging.

    Raises
    ------
    ModelError
        With every fault of the model.
    """

    def __init__(
        self,
        model: ModelGraph,
        *,
        probes: bool = False,
        energy: bool = False,
        outputs: Iterable[str] | None = None,
        compiled: bool = True,
    ):
        plan = plan_of(model, probes, energy, outputs)
        self.model = model
        self.name = model.name
        self.texts = plan.texts
        self.sparsity = plan.sparsity
        self.compiled = compiled and not any(c.only_python for c in model.components.values())
        #: whether a part of the model steps itself: then there are no rates of all that moves (see `stepped`)
        self.stepped = model.stepped_part is not None
        self._places = plan.places
        self.states, self.inputs = plan.states, plan.inputs
        self.parameters, self.outputs = plan.parameters, plan.outputs
        self.state_names = tuple(q.name for q in self.states)
        self.input_names = tuple(q.name for q in self.inputs)
        self.parameter_names = tuple(q.name for q in self.parameters)
        self.output_names = tuple(q.name for q in self.outputs)
        #: states and outputs at whose speeds narrow features pass by (see `multibody.system.narrow_features`)
        self.speed_names = plan.speed_names
        #: index of the parameter that delays an input, by the input's name
        self.input_delays: dict[str, int] = {
            name: self.parameter_names.index(parameter) for name, parameter in plan.input_delays.items()
        }
        #: index of the state that is the rate of another state (position → velocity)
        self.rate_states: dict[int, int] = plan.rate_states
        self._index = {
            kind: {q.name: k for k, q in enumerate(group)}
            for kind, group in (
                ("state", self.states),
                ("input", self.inputs),
                ("parameter", self.parameters),
                ("output", self.outputs),
            )
        }

    # ---------------------------------------------------------------- names and vectors

    @property
    def places(self) -> tuple[Place, ...]:
        """Where an effect can act."""
        if self._places is None:
            self._places = tuple(find_places(self.model))
        return self._places

    @property
    def start(self) -> np.ndarray:
        """Start values of the states, shape (n,)."""
        return np.array([q.value for q in self.states])

    @property
    def p(self) -> np.ndarray:
        """Parameter values of the model, shape (n_p,)."""
        return np.array([q.value for q in self.parameters])

    @property
    def u(self) -> np.ndarray:
        """Default values of the inputs, shape (n_u,)."""
        return np.array([q.value for q in self.inputs])

    def index(self, kind: str, name: str) -> int:
        """Return the position of a ``"state"``, ``"input"``, ``"parameter"`` or ``"output"`` by its name.

        Raises
        ------
        KeyError
            With the nearest name that exists.
        """
        try:
            return self._index[kind][name]
        except KeyError:
            raise KeyError(f"'{self.name}' has no {kind} '{name}'{nearest(name, self._index[kind])}") from None

    def unit(self, name: str) -> str:
        """Return the SI unit of an output, state, input or parameter."""
        for group in (self.outputs, self.states, self.inputs, self.parameters):
            for q in group:
                if q.name == name:
                    return q.unit
        raise KeyError(f"'{self.name}' has no quantity '{name}'{nearest(name, self.output_names)}")

    def parameter_vector(self, values: Mapping[str, float] | np.ndarray | None = None) -> np.ndarray:
        """Return the parameter vector with some values replaced by name.

        Raises
        ------
        ModelError
            With every unknown name and every value outside its bounds.
        """
        return self._vector("parameter", self.parameters, values)

    def state_vector(self, values: Mapping[str, float] | np.ndarray | None = None) -> np.ndarray:
        """Return the start vector with some values replaced by name."""
        return self._vector("state", self.states, values)

    def input_vector(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """Return the vector of inputs with some values replaced by name."""
        return self._vector("input", self.inputs, values)

    def _vector(
        self, kind: str, group: tuple[Quantity, ...], values: Mapping[str, float] | np.ndarray | None
    ) -> np.ndarray:
        if isinstance(values, np.ndarray):
            if values.shape != (len(group),):
                raise ModelError(self.name, [f"there are {len(group)} {kind}s, the array has the shape {values.shape}"])
            return np.ascontiguousarray(values, dtype=float)
        vector = np.array([q.value for q in group])
        faults = []
        for name, value in (values or {}).items():
            k = self._index[kind].get(name)
            if k is None:
                faults.append(f"there is no {kind} '{name}'{nearest(name, self._index[kind])}")
                continue
            q = group[k]
            try:
                value = quantity(value, q.unit)
            except (UnitError, TypeError, ValueError) as error:
                faults.append(f"{kind} '{name}': {error}")
                continue
            if not np.isfinite(value):
                faults.append(f"{kind} '{name}' is {value}: give a finite number")
            elif (q.min is not None and value < q.min) or (q.max is not None and value > q.max):
                faults.append(f"{kind} '{name}' is {value:g} {q.unit}, outside its bounds [{q.min}, {q.max}]")
            vector[k] = value
        if faults:
            raise ModelError(self.name, faults)
        return vector

    # ---------------------------------------------------------------- functions

    def _native(self, name: str) -> NativeFunction:
        arrays = TANGENT_ARRAYS if name.endswith("tangent") else RHS_ARRAYS
        return compile_text(self.texts[name], name, name, arrays, self.compiled)

    @cached_property
    def rhs_function(self) -> NativeFunction:
        """The rates as a native function ``rhs(t, x, u, p, dx)``."""
        return self._native("rhs")

    @cached_property
    def outputs_function(self) -> NativeFunction:
        """The outputs as a native function ``outputs(t, x, u, p, y)``."""
        return self._native("outputs")

    @cached_property
    def speeds_function(self) -> NativeFunction:
        """The speeds named by ``speed_names`` as a native function ``speeds(t, x, u, p, y)``."""
        return self._native("speeds")

    @cached_property
    def rhs_tangent(self) -> NativeFunction:
        """Directional derivative of the rates as a native function."""
        return self._native("rhs_tangent")

    @cached_property
    def rhs_columns(self) -> NativeFunction | None:
        """Several columns of the rates' Jacobian by the states at once, or None where nothing is compiled.

        As `multibody.compile.vector_mode.along_directions`; ``u_dot`` and ``p_dot`` are not read.
        """
        few = int(self.colours.max(initial=0)) < 4 * FEW_LANES
        return along_states(self.texts["rhs_columns"], FEW_LANES if few else MANY_LANES) if self.compiled else None

    @cached_property
    def outputs_tangent(self) -> NativeFunction:
        """Directional derivative of the outputs as a native function."""
        return self._native("outputs_tangent")

    @cached_property
    def rhs(self) -> ReturningFunction:
        """The rates of the states at one instant: ``rhs(t, x, u=None, p=None)`` returns an array, shape (n,).

        Functions compiled by numba can call it, with all four arguments.
        """
        return self._returning(self.rhs_function, len(self.states))

    @cached_property
    def outputs_at(self) -> ReturningFunction:
        """The outputs at one instant: ``outputs_at(t, x, u=None, p=None)`` returns an array, shape (n_y,).

        Functions compiled by numba can call it, with all four arguments.
        """
        return self._returning(self.outputs_function, len(self.outputs))

    def _returning(self, function: NativeFunction, size: int) -> ReturningFunction:
        return ReturningFunction(function, size, self.u, self.p)

    def jacobian(
        self,
        wrt: str,
        t: float,
        x: np.ndarray,
        u: np.ndarray | None = None,
        p: np.ndarray | None = None,
        *,
        of: str = "rhs",
    ) -> np.ndarray:
        """Return the exact Jacobian of rates or outputs with respect to states, inputs or parameters.

        Parameters
        ----------
        wrt : {"x", "u", "p"}
            What is varied.
        of : {"rhs", "outputs"}
            What is differentiated.

        Returns
        -------
        ndarray, shape (n or n_y, n or n_u or n_p)
        """
        x = np.asarray(x, dtype=float)
        u = self.u if u is None else np.asarray(u, dtype=float)
        p = self.p if p is None else np.asarray(p, dtype=float)
        return self.jacobian_along(wrt, np.array([t], dtype=float), x[None], u[None], p, of=of)[0]

    def jacobian_along(
        self,
        wrt: str,
        times: np.ndarray,
        states: np.ndarray,
        inputs: np.ndarray,
        p: np.ndarray,
        *,
        of: str = "rhs",
        columns: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the exact Jacobian at every row of a trajectory.

        Parameters
        ----------
        wrt : {"x", "u", "p"}
            What is varied.
        times, states, inputs : ndarray, shapes (nt,), (nt, n), (nt, n_u)
            The trajectory.
        p : ndarray, shape (n_p,)
            Parameters.
        columns : ndarray of int, optional
            Only these columns.

        Returns
        -------
        ndarray, shape (nt, n or n_y, number of columns)
        """
        sizes = {"x": len(self.states), "u": len(self.inputs), "p": len(self.parameters)}
        chosen = np.arange(sizes[wrt]) if columns is None else np.asarray(columns, dtype=int)
        rows, m = len(self.states) if of == "rhs" else len(self.outputs), chosen.size
        at = _contiguous(times, states, inputs, p)
        if m == 0:  # nothing has to be compiled for it
            return np.empty((times.size, rows, 0))
        # a tangent along states alone does less work, and stiff methods need it in any case
        wide = self.rhs_columns if (wrt, of) == ("x", "rhs") else None
        if wide is not None:
            return jacobian_in_lanes(wide, rows, sizes, wrt, chosen, *at)
        function = self.rhs_tangent if of == "rhs" else self.outputs_tangent
        return function.run(jacobian_rows, function, rows, sizes, wrt, chosen, *at)

    def outputs_along(self, times: np.ndarray, states: np.ndarray, inputs: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the outputs at every row of a trajectory, shape (nt, n_y).

        Of several parameter vectors, p (k, n_p), they have the shape (k, nt, n_y).
        """
        function = self.outputs_function
        at = _contiguous(times, states, inputs, np.atleast_2d(p))
        outputs = function.run(output_rows, function, len(self.outputs), *at)
        return outputs if p.ndim == 2 else outputs[0]

    @cached_property
    def colours(self) -> np.ndarray:
        """Colour of each state such that columns of one colour share no row of the Jacobian, shape (n,)."""
        n = len(self.states)
        colours = np.full(n, -1)
        for j in np.argsort(-self.sparsity.sum(axis=0), kind="stable"):
            rows = self.sparsity[:, j]
            used = {colours[k] for k in range(n) if colours[k] >= 0 and np.any(self.sparsity[:, k] & rows)}
            colours[j] = next(c for c in range(n) if c not in used)
        return colours

    def __repr__(self) -> str:
        counts = {"state": self.states, "input": self.inputs, "parameter": self.parameters, "output": self.outputs}
        listed = ", ".join(count_text(len(names), noun) for noun, names in counts.items())
        return f"{type(self).__name__}({self.name!r}: {listed})"


def _contiguous(*arrays: Any) -> tuple[np.ndarray, ...]:
    return tuple(np.require(a, float, ["C", "W"]) for a in arrays)
