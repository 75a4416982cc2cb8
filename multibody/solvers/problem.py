"""An initial value problem of native functions, with the directions in which it is differentiated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from multibody.compile.native import NativeFunction
from multibody.inputs.table import InputTable, TableArrays
from multibody.solvers.kernels.field import evaluate_at
from multibody.solvers.kernels.jacobian import jacobian_at

__all__ = ["Directions", "NativeProblem", "ProblemError"]


class ProblemError(ValueError):
    """The parts of a problem do not fit each other."""


def _array(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    return np.zeros(shape) if value is None else np.array(value, dtype=np.float64, order="C")


@lru_cache(maxsize=256)
def _shared(n: int, colours: bytes, pattern: bytes) -> tuple[str, ...]:
    """Name the columns that share a colour and a row."""
    colour, filled = np.frombuffer(colours, dtype=np.int64), np.frombuffer(pattern, dtype=bool).reshape(n, n)
    return tuple(
        f"columns {np.flatnonzero(colour == own).tolist()} share a colour and a row"
        for own in np.unique(colour)
        if np.any(filled[:, colour == own].sum(axis=1) > 1)
    )


@lru_cache(maxsize=256)
def _owners(n: int, colours: bytes, pattern: bytes) -> np.ndarray:
    """Return what `NativeProblem.owners` does."""
    _, colour = np.unique(np.frombuffer(colours, dtype=np.int64), return_inverse=True)
    filled = np.frombuffer(pattern, dtype=bool).reshape(n, n)
    owner = np.full((colour.max(initial=-1) + 1, n), -1, dtype=np.int64)
    for column in range(n):
        owner[colour[column], filled[:, column]] = column
    owner.flags.writeable = False
    return owner


@lru_cache(maxsize=256)
def _seeds(n: int, colours: bytes, pattern: bytes, lanes: int) -> np.ndarray:
    """Return the states that each colour moves as directions, in groups of ``lanes``."""
    owner = _owners(n, colours, pattern)
    seeds = np.zeros((-(-len(owner) // lanes), n, lanes))
    for colour, row in enumerate(owner):
        seeds[colour // lanes, row[row >= 0], colour % lanes] = 1.0
    return seeds


@dataclass(frozen=True, eq=False, kw_only=True)
class Directions:
    """Directions in initial state, parameters and inputs along which the solution is differentiated.

    Along direction k the derivative S_k of the state obeys S_k' = f_x S_k + f_u u_dot_k + f_p p_dot_k.

    Parameters
    ----------
    x0_dot : ndarray, shape (m, n)
        Tangent of the initial state.
    p_dot : ndarray, shape (m, n_p)
        Tangent of the parameters.  A component on a delay parameter acts through the delayed input as well.
    channel : ndarray of int, shape (m,), optional
        Input whose tangent is given over time by ``shape``, or -1.
    shape_t : ndarray, shape (ns,), s, optional
        Time grid of ``shape``.
    shape : ndarray, shape (ns, m), optional
        Tangent of the input ``channel[k]``, interpolated linearly and constant beyond the ends.
    scale : ndarray, shape (m,), optional
        Size of a step along each direction that matters; only error control of the directions uses it, which
        divides the absolute tolerance by it.
    """

    x0_dot: np.ndarray
    p_dot: np.ndarray
    channel: np.ndarray | None = None
    shape_t: np.ndarray | None = None
    shape: np.ndarray | None = None
    scale: np.ndarray | None = None

    def __post_init__(self) -> None:
        p_dot = np.array(self.p_dot, dtype=np.float64, ndmin=2, order="C")
        m = len(p_dot)
        fields = {
            "p_dot": p_dot,
            "x0_dot": np.array(self.x0_dot, dtype=np.float64, ndmin=2, order="C"),
            "channel": np.full(m, -1) if self.channel is None else np.array(self.channel, dtype=np.int64),
            "shape_t": _array(self.shape_t, (1,)),
            "shape": _array(self.shape, (1, m)),
            "scale": np.ones(m) if self.scale is None else np.array(self.scale, dtype=np.float64),
        }
        faults = []
        if len(fields["x0_dot"]) != m:
            faults.append(f"x0_dot has {len(fields['x0_dot'])} directions, p_dot has {m}")
        if fields["shape"].shape != (fields["shape_t"].size, m):
            faults.append(
                f"shape is {fields['shape'].shape}, shape_t and p_dot ask for ({fields['shape_t'].size}, {m})"
            )
        if fields["channel"].shape != (m,) or fields["scale"].shape != (m,):
            faults.append(f"channel and scale need one entry for each of the {m} directions")
        if np.any(np.diff(fields["shape_t"]) <= 0.0):
            faults.append("shape_t does not increase")
        if faults:
            raise ProblemError("; ".join(faults))
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def count(self) -> int:
        """Number of directions."""
        return len(self.p_dot)


@dataclass(frozen=True, eq=False, kw_only=True)
class NativeProblem:
    """Right-hand side, parameters and inputs of x' = f(t, x, u(t), p), for the compiled solvers.

    Parameters
    ----------
    rhs : NativeFunction
        ``f(t, x, u, p, dx)``.
    p : ndarray, shape (n_p,)
        Parameters.
    table : InputTable
        Inputs over time.
    n : int
        Number of states.
    tangent : NativeFunction, optional
        Directional derivative of ``rhs``; the stiff solver and directions need it.
    directions : Directions, optional
        The solver then integrates y = [x, S_0, S_1, ...].
    colours : ndarray of int, shape (n,), optional
        Colour of each column of the Jacobian; columns of one colour share no row.  Default: each its own.
    pattern : ndarray of bool, shape (n, n), optional
        Entries of the Jacobian that can differ from zero; needed where two columns share a colour.
    state_names : sequence of str, optional
        For messages.
    in_lanes : bool
        Evaluate several directions at once, with a tangent that is compiled for that; False: one after another.
    columns : NativeFunction, optional
        Several columns of the Jacobian at once (`System.rhs_columns`), in place of one derivative for every colour.
    speeds : NativeFunction, optional
        ``f(t, x, u, p, y)``: the speeds at which something narrow passes by (`System.speeds_function`).
    widths : ndarray, shape (n_speeds,), optional
        Its widths: no step is longer than half of one over its speed where the step begins, or than the whole where
        it ends.
    largest_step : float, s
        No step is longer, whatever the largest step that a method is given.
    explain : callable, optional
        ``explain(t, x)`` says in a sentence which equation is not finite at a state or just ahead of it, or is empty.

    Raises
    ------
    ProblemError
        If shapes do not fit; all faults at once.
    """

    rhs: NativeFunction
    p: np.ndarray
    table: InputTable
    n: int
    tangent: NativeFunction | None = None
    directions: Directions | None = None
    colours: np.ndarray | None = None
    pattern: np.ndarray | None = None
    state_names: Sequence[str] = ()
    in_lanes: bool = True
    columns: NativeFunction | None = None
    speeds: NativeFunction | None = None
    widths: np.ndarray | None = None
    largest_step: float = np.inf
    explain: Callable[[float, np.ndarray], str] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "p", np.array(self.p, dtype=np.float64, ndmin=1, order="C"))
        faults = []
        delays = self.table.kernel["delays"]
        if np.any(delays >= self.p.size):
            faults.append(f"a delay parameter has the index {delays.max()}, but there are {self.p.size} parameters")
        if not np.all(np.isfinite(self.p)):
            faults.append(f"parameter {int(np.flatnonzero(~np.isfinite(self.p))[0])} is not finite")
        d = self.directions
        if d is not None:
            if self.tangent is None:
                faults.append("directions need the tangent of the right-hand side")
            if d.x0_dot.shape[1] != self.n or d.p_dot.shape[1] != self.p.size:
                faults.append(
                    f"directions are for {d.x0_dot.shape[1]} states and {d.p_dot.shape[1]} parameters, "
                    f"the problem has {self.n} and {self.p.size}"
                )
            if d.channel is not None and np.any(d.channel >= self.table.n_inputs):
                faults.append(f"a direction acts on input {d.channel.max()}, but there are {self.table.n_inputs}")
        if self.colours is not None:
            faults += self._colour_faults(np.asarray(self.colours))
        if (self.speeds is None) != (self.widths is None):
            faults.append("speeds and widths of what passes by belong together: give both or neither")
        if not self.largest_step > 0.0:
            faults.append(f"the largest step must be positive, it is {self.largest_step}")
        if self.state_names and len(self.state_names) != self.n:
            faults.append(f"there are {self.n} states but {len(self.state_names)} state names")
        if faults:
            raise ProblemError("; ".join(faults))

    def _colour_faults(self, colours: np.ndarray) -> list[str]:
        if colours.shape != (self.n,):
            return [f"colours has the shape {colours.shape}, not ({self.n},)"]
        if self.pattern is not None and np.shape(self.pattern) == (self.n, self.n):
            return list(_shared(*self._structure))
        if np.unique(colours).size == self.n:
            return []
        return [f"columns share colours, so the pattern of the Jacobian is needed, shape ({self.n}, {self.n})"]

    @cached_property
    def _structure(self) -> tuple[int, bytes, bytes]:
        """Number of states, colours and pattern as the key of a cache."""
        n = self.n
        pattern = np.ones((n, n), bool) if self.pattern is None else np.asarray(self.pattern, dtype=bool)
        return n, np.asarray(self.colours, dtype=np.int64).tobytes(), pattern.tobytes()

    @property
    def n_directions(self) -> int:
        """Number of directions."""
        return 0 if self.directions is None else self.directions.count

    @property
    def size(self) -> int:
        """Length of y = [x, S_0, S_1, ...]."""
        return self.n * (1 + self.n_directions)

    def initial(self, x0: Any) -> np.ndarray:
        """Return y at the start from the state x0, shape (n,)."""
        x0 = np.asarray(x0, dtype=np.float64)
        if x0.shape != (self.n,):
            raise ProblemError(f"the initial state has the shape {x0.shape}, the problem has {self.n} states")
        if self.directions is None:
            return x0.copy()
        return np.concatenate([x0, self.directions.x0_dot.ravel()])

    def split(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x, shape (n, ...), and the derivatives, shape (m, n, ...), from y, shape (size, ...)."""
        return y[: self.n], y[self.n :].reshape(self.n_directions, self.n, *y.shape[1:])

    def name_of(self, index: int) -> str:
        """Return the words for component ``index`` of y in a message."""
        state = index % self.n
        name = f"state {state}" + (f" ('{self.state_names[state]}')" if self.state_names else "")
        return name if index < self.n else f"{name} along direction {index // self.n - 1}"

    def owners(self) -> np.ndarray:
        """Return for each colour and row the column that the entry belongs to, or -1; shape (colours, n)."""
        if self.colours is None:
            return np.repeat(np.arange(self.n)[:, None], self.n, axis=1)
        return _owners(*self._structure)

    def field(self, tolerance: float = 0.0, jacobian: bool = True) -> Any:
        """Return a new `Field` for compiled drivers, with its own workspace.

        With a relative tolerance steps may pass over the kinks of finely sampled inputs (see `InputTable.kernel_for`).
        Without ``jacobian`` what only a Jacobian takes is left out.
        """
        from multibody.solvers.kernels.field_layout import FADING, Field

        own = self.table.kernel_for(tolerance) if tolerance > 0.0 else self.table.kernel
        table, directions, d = own, None, self.directions
        if d is not None:
            weight = np.zeros((d.count, self.table.n_inputs))
            for column in np.flatnonzero(table["delays"] >= 0):
                weight[:, column] = -d.p_dot[:, table["delays"][column]]
            directions = {name: np.asarray(getattr(d, name)) for name in ("p_dot", "channel", "shape_t", "shape")}
            directions["weight"] = weight
            channel = directions["channel"]
            fading = (channel < 0) & ~np.any(d.p_dot, axis=1)
            directions["channel"] = np.where(fading, FADING, channel)
            table = self._with_breaks(d, own)
        columns, seeds = 0, None
        if jacobian and self.columns is not None and self.colours is not None:
            columns, seeds = self.columns.address, _seeds(*self._structure, self.columns.lanes)
        wide = self._wide()
        # What goes in lanes needs no tangent of a single direction, which would have to be compiled as well.
        single = (d is not None and wide[0] == 0) or (jacobian and columns == 0)
        tangent = self.tangent.address if single and self.tangent is not None else 0
        features: tuple[Any, ...] = ()
        if self.speeds is not None and self.widths is not None:
            features = (self.speeds.address, np.ascontiguousarray(self.widths, dtype=np.float64))
        return Field(self.rhs.address, tangent, self.n, self.p, table, directions, wide, columns, seeds, *features)

    def _wide(self) -> tuple[int, int]:
        """Return the address of a tangent for several directions at once, and for how many; zeros for none."""
        m = self.n_directions
        if not self.in_lanes or self.tangent is None or m == 0:
            return 0, 0
        from multibody.compile.vector_mode import FEW_LANES, MANY_LANES, along_directions

        lanes = FEW_LANES if m <= FEW_LANES else MANY_LANES
        wide = along_directions(self.tangent, lanes)
        return (0, 0) if wide is None else (wide.address, lanes)

    def _with_breaks(self, directions: Directions, own: TableArrays) -> TableArrays:
        """The table of inputs, where steps end at the breaks of the inputs' tangents as well."""
        times, shape = np.asarray(directions.shape_t), np.asarray(directions.shape)
        if times.size < 2:
            return own
        added = InputTable(times=times, values=shape).kernel
        table = {name: np.append(own[name], added[name]) for name in ("breaks", "jumps", "break_delay")}
        table["break_start"] = np.append(own["break_start"], own["break_start"][-1] + added["break_start"][1:])
        return TableArrays({**own, **table})

    def derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return f(t, x, u(t), p), shape (n,); slow, for a single evaluation."""
        return self.rhs(t, x, self.table(t, self.p), self.p, np.empty(self.n))

    def check(self) -> None:
        """Raise what a plain Python function raised while compiled code called it."""
        self.rhs.check()
        for other in (self.tangent, self.speeds):
            if other is not None:
                other.check()

    @property
    def jac(self) -> Callable[[float, np.ndarray], np.ndarray]:
        """The Jacobian of x as ``jac(t, x)``, shape (n, n), for SciPy's own methods; needs the tangent."""
        field, n = self.field(), self.n
        time, state, rates, columns = np.empty(1), np.empty(self.size), np.empty(self.size), np.empty((n, n))
        work = np.zeros(2 * n + max(self.table.n_inputs, self.p.size, 1))
        owner = np.ascontiguousarray(self.owners(), dtype=np.int64)
        evaluate = jacobian_at.bound(field.numbers, time, state, rates, owner, work, columns)

        def jac(t: float, x: np.ndarray, _owner: Any = field) -> np.ndarray:
            time[0], state[:n] = t, x
            evaluate()
            self.check()
            return columns.T.copy()

        return jac

    @property
    def fun(self) -> Callable[[float, np.ndarray], np.ndarray]:
        """The derivative of y as ``fun(t, y)``, for SciPy's own methods."""
        field = self.field(jacobian=False)
        time, state, rates = np.empty(1), np.empty(self.size), np.empty(self.size)
        evaluate = evaluate_at.bound(time, state, rates, field.numbers)
        check = [f.check for f in (self.rhs, self.tangent) if f is not None and not f.compiled]

        def fun(t: float, y: np.ndarray, _owner: Any = field) -> np.ndarray:
            time[0] = t
            state[:] = y
            evaluate()
            for one in check:
                one()
            return rates.copy()

        return fun
