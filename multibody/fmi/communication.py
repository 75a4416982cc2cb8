"""A model with a unit that is stepped: what the unit is given and what it shows, from communication point to point.

The equations of such a model are those around the unit.  They hear its outputs as inputs (``plant.from.x``) and show
what it is given as outputs (``plant.to.u``).  Where nothing that the unit shows acts back on it, all steps are asked
for at once.  Else a law that acts at a connection is evaluated at the beginning of each step and, with the unit's
outputs extrapolated, at its end.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from multibody.base.errors import SimulationError, Stop
from multibody.fmi.foreign import Refusal, cosimulation
from multibody.fmi.foreign_description import ForeignUnit
from multibody.fmi.structure import dependencies
from multibody.solvers import Samples, integrate
from multibody.system.simulate import native_problem
from multibody.system.stepped import LongStepsWarning, SteppedRun

if TYPE_CHECKING:
    from multibody.inputs.table import InputTable
    from multibody.system.compiled import CompiledSystem

__all__ = ["given_name", "heard_name", "stepped_run"]

#: Change of an output at the samples, as a share of its spread, by halving the steps with which they are short enough;
#: chosen.  The error goes with the square of the steps, so that a third of this is left.
SETTLED = 1e-3
#: Range, as a share of an output's magnitude (at least 1), below which an output counts as resting: what is left of it
#: is rounding, which shorter steps do not change.
LEAST_RANGE = 1e-6
#: Steps between two samples at most.
MOST_DIVISIONS = 64
#: Values beyond this count as running away.
LARGEST = 1e150

_Way = Callable[["_Around", np.ndarray, np.ndarray, int], SteppedRun]


def heard_name(owner: str, own: str) -> str:
    """Return the name of the system's input by which the model hears an output of the unit."""
    return f"{owner}.from.{own}"


def given_name(owner: str, own: str) -> str:
    """Return the name of the system's output that shows what an input of the unit is given."""
    return f"{owner}.to.{own}"


@dataclass(frozen=True, eq=False, kw_only=True)
class _Around:
    """The system around a unit: where it hears the unit, and what it gives it."""

    system: CompiledSystem
    unit: ForeignUnit
    owner: str
    p: np.ndarray
    table: InputTable
    extra: dict[int, tuple[np.ndarray, np.ndarray]]
    rtol: float

    @property
    def heard(self) -> np.ndarray:
        return np.array(
            [self.system.index("input", heard_name(self.owner, v.own)) for v in self.unit.outputs], dtype=int
        )

    @property
    def given(self) -> np.ndarray:
        return np.array(
            [self.system.index("output", given_name(self.owner, v.own)) for v in self.unit.inputs], dtype=int
        )

    @property
    def of_unit(self) -> np.ndarray:
        """The unit's parameters."""
        return np.array([self.p[self.system.index("parameter", f"{self.owner}.{v.own}")] for v in self.unit.parameters])

    def acts_back(self) -> tuple[bool, bool]:
        """Return whether what the unit is given depends on what it shows, and whether it depends on states."""
        heard, given = set(self.heard.tolist()), set(self.given.tolist())
        of = _sources(self.system.texts["outputs"])
        sources = frozenset().union(*(s for k, s in of.items() if k in given))
        return any(a == "u" and k in heard for a, k in sources), any(a == "x" for a, _ in sources)

    def inputs(self, times: np.ndarray) -> np.ndarray:
        """Return the recorded inputs at some times, with what is added to them, shape (nt, n_u)."""
        u = np.array(self.table(times, self.p).reshape(times.size, -1), order="C")
        for k, (t, values) in self.extra.items():
            u[:, k] += np.interp(times, t, values)
        return u

    def shown(self, times: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return what the unit is given, shape (nt, number of its inputs)."""
        return self.system.outputs_along(times, x, u, self.p)[:, self.given]


def stepped_run(
    system: CompiledSystem,
    unit: ForeignUnit,
    owner: str,
    p: np.ndarray,
    x0: np.ndarray,
    table: InputTable,
    times: np.ndarray,
    *,
    rtol: float = 1e-6,
    extra: dict[int, tuple[np.ndarray, np.ndarray]] | None = None,
    divisions: int | None = None,
) -> SteppedRun:
    """Simulate a model with a unit that is stepped.

    The steps are so short that half of them change little.  Runs that are compared with another, as differences do,
    take as many as that one did.

    Parameters
    ----------
    system : CompiledSystem
        The equations around the unit.
    unit : ForeignUnit
    owner : str
        Name of its component.
    p, x0 : ndarray
        Parameters, and start values of the states that the equations around the unit have.
    table : InputTable
    times : ndarray, shape (nt,), s
        When to record; communication points are among them.
    rtol : float
        Of the integration of those states.
    extra : dict of int to (ndarray, ndarray)
        What is added to inputs, by index: times and values.
    divisions : int, optional
        Steps between two samples; by default as many as are needed.

    Raises
    ------
    SimulationError
        If the unit refuses a step, or does not answer; if it asks for a step that does not fit the samples; if
        something runs away.
    """
    around = _Around(system=system, unit=unit, owner=owner, p=p, table=table, extra=extra or {}, rtol=rtol)
    least = _least_divisions(unit, times)
    run_in = _step_by_step if any(around.acts_back()) else _in_one_piece
    if unit.communication.fixed or divisions is not None:
        return _sound(around, run_in(around, x0, times, divisions or least))
    return _sound(around, _settled(around, x0, times, least, run_in))


def _settled(around: _Around, x0: np.ndarray, times: np.ndarray, least: int, run_in: _Way) -> SteppedRun:
    """Return a run with steps so short that half of them change little; where none are, with the shortest, and warn."""
    refusals: list[Refusal] = []

    def attempt(divisions: int) -> SteppedRun | None:
        try:
            return run_in(around, x0, times, divisions)
        except Refusal as error:  # a step that is too long, perhaps
            refusals.append(error)
            return None

    count, run = least, attempt(least)
    change, worst = (np.inf if 2 * least <= MOST_DIVISIONS else 0.0), 0  # shorter ones than it asks for are not tried
    while 2 * count <= MOST_DIVISIONS:
        finer = attempt(2 * count)
        if run is not None and finer is not None:
            change, worst = _largest_change(around, run, finer)
            if change <= SETTLED:
                return run
        count, run = 2 * count, finer
    if run is None:
        raise refusals[0]
    if change > SETTLED and np.all(np.abs(run.inputs[:, around.heard]) < LARGEST):
        _warn(around, count, change, around.unit.outputs[worst].name)
    return run


def _warn(around: _Around, count: int, change: float, output: str) -> None:
    half = f"from half as many on, '{output}' changed by {100.0 * change:.2g} % of its range"
    cause = "the unit integrates with steps that follow these (forward Euler, for example), which are too long for it"
    if around.acts_back()[0]:
        cause = f"an effect at a connection is stiff, or {cause}"
    warnings.warn(
        f"the FMU '{around.unit.path.name}' is stepped {count} times between samples, and that is not enough: "
        f"{half if np.isfinite(change) else 'with half as many it runs away'}; {cause}; export it for Model "
        "Exchange, or with an integrator that controls its own steps",
        LongStepsWarning,
        stacklevel=4,
    )


def _least_divisions(unit: ForeignUnit, times: np.ndarray) -> int:
    """Return into how many steps the time between two samples is divided at least."""
    asked = unit.communication
    if asked.size is None or times.size < 2:
        return 1
    sizes = np.diff(times)
    count = max(1, int(np.ceil(sizes.max() / asked.size - 1e-6)))
    if asked.fixed and not np.allclose(sizes, count * asked.size, rtol=1e-6):
        raise SimulationError(
            f"the FMU '{unit.path.name}' takes communication steps of {asked.size:g} s alone, and the samples are "
            f"{sizes.min():g} s to {sizes.max():g} s apart: resample the records to a multiple of it"
        )
    return count


def _points(times: np.ndarray, count: int) -> np.ndarray:
    """Return times with ``count`` even steps between each two."""
    if count == 1:
        return times
    return np.append((times[:-1, None] + np.diff(times)[:, None] * (np.arange(count) / count)).ravel(), times[-1])


def _before(points: np.ndarray) -> np.ndarray:
    """Return times just before the ends of the steps: a held input jumps there."""
    return points[1:] - 1e-9 * np.diff(points)


def _in_one_piece(around: _Around, x0: np.ndarray, times: np.ndarray, count: int) -> SteppedRun:
    """Simulate where the unit is given nothing that depends on what it shows."""
    system, points = around.system, _points(times, count)
    u = around.inputs(points)
    none = np.zeros((points.size, x0.size))
    first, last = (
        around.shown(points[:-1], none[1:], u[:-1]),
        around.shown(_before(points), none[1:], around.inputs(_before(points))),
    )
    with cosimulation(str(around.unit.path), around.unit.digest) as unit:
        begun = unit.begin(
            float(points[0]), float(points[-1]), around.shown(points[:1], none[:1], u[:1])[0], around.of_unit
        )
        u[:, around.heard] = np.vstack([begun, unit.steps(points, first, last)])
    x = np.zeros((times.size, 0))
    evaluations = points.size
    if x0.size:
        from multibody.inputs.table import InputTable

        table = InputTable.from_columns(points, dict(zip(system.input_names, u.T, strict=True)))
        samples = Samples(times)
        solution = integrate(
            native_problem(system, around.p, table),
            (float(times[0]), float(times[-1])),
            x0,
            samples=samples,
            rtol=around.rtol,
            atol=around.rtol * 1e-3,
            max_step=np.inf,
            stiff_problem=lambda: native_problem(system, around.p, table, tangent=True),
        )
        if solution.status < 0 or samples.count < times.size:
            raise SimulationError(f"'{system.name}': {solution.message}", getattr(solution.message, "stop", Stop.OTHER))
        x, evaluations = np.ascontiguousarray(samples.states), evaluations + int(solution.nfev)
    return SteppedRun(x, np.ascontiguousarray(u[::count]), evaluations, count)


def _step_by_step(around: _Around, x0: np.ndarray, times: np.ndarray, count: int) -> SteppedRun:
    """Simulate where the unit is given what depends on what it shows; what runs away is left as not a number."""
    points = _points(times, count)
    u, late = around.inputs(points), around.inputs(_before(points))
    x = np.empty((points.size, x0.size))
    x[0] = x0
    heard = around.heard
    with cosimulation(str(around.unit.path), around.unit.digest) as unit:
        y = unit.begin(float(points[0]), float(points[-1]), around.shown(points[:1], x[:1], u[:1])[0], around.of_unit)
        before = y
        for k in range(points.size - 1):
            u[k, heard] = y
            late[k, heard] = 2.0 * y - before if k else y
            t = points[k : k + 2]
            first = around.shown(t[:1], x[k : k + 1], u[k : k + 1])
            last = around.shown(t[1:], x[k : k + 1], late[k : k + 1])
            if not np.all(np.abs([first, last]) < LARGEST):
                u[k:, heard], x[k:] = np.nan, np.nan
                break
            before, y = y, unit.steps(t, first, last)[0]
            u[k + 1, heard] = late[k, heard] = y
            if x0.size:
                x[k + 1] = _moved(around, x[k], t, u[k], late[k])
    return SteppedRun(np.ascontiguousarray(x[::count]), np.ascontiguousarray(u[::count]), points.size, count)


def _moved(around: _Around, x: np.ndarray, t: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return the states around the unit at the end of a step, in which inputs run straight."""
    from scipy.integrate import solve_ivp

    def rates(at: float, state: np.ndarray) -> np.ndarray:
        share = (at - t[0]) / (t[1] - t[0])
        return around.system.rhs(at, state, first + share * (last - first), around.p)

    solution = solve_ivp(rates, (t[0], t[1]), x, "LSODA", rtol=around.rtol, atol=around.rtol * 1e-3)
    return solution.y[:, -1] if solution.success else np.full_like(x, np.nan)


def _largest_change(around: _Around, run: SteppedRun, finer: SteppedRun) -> tuple[float, int]:
    """Return the largest change of an output, as a share of its range (infinity where one runs away), and which."""
    heard = around.heard
    a, b = run.inputs[:, heard], finer.inputs[:, heard]
    if not a.shape[1]:
        return 0.0, 0
    good = np.all((np.abs(a) < LARGEST) & (np.abs(b) < LARGEST), axis=0)
    if not good.all():
        return np.inf, int(np.argmin(good))
    range_of = np.maximum(np.ptp(b, axis=0), LEAST_RANGE * np.maximum(1.0, np.max(np.abs(b), axis=0)))
    changes = np.max(np.abs(a - b), axis=0) / range_of
    return float(changes.max()), int(changes.argmax())


def _sound(around: _Around, run: SteppedRun) -> SteppedRun:
    """Return a run in which everything is finite.

    Raises
    ------
    SimulationError
        With the output that runs away.
    """
    shown = run.inputs[:, around.heard]
    bad = ~(np.abs(shown) < LARGEST)
    if bad.any():
        name = around.unit.outputs[int(np.flatnonzero(bad.any(axis=0))[0])].name
        raise SimulationError(
            f"'{around.system.name}': the output '{name}' of the FMU '{around.unit.path.name}' runs away: an effect at "
            "a connection is too stiff for communication steps, or a parameter is far from its usual size",
            Stop.NOT_FINITE,
        )
    return run


@lru_cache(maxsize=16)
def _sources(text: str) -> dict[int, frozenset[tuple[str, int]]]:
    return dependencies(text, "outputs")
