"""The lift's trips that the benchmarks run: the paper's three models on one reference, and their outputs' errors."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

DURATION, STEP = 6.0, 1e-3
TARGET = 1e-4
WATCHED = ("zdd_c", "F_c")
HERE = Path(__file__).resolve().parent


@dataclass(frozen=True, eq=False)
class Trip:
    """A model with the inputs and the start of one trip."""

    name: str
    system: Any
    inputs: dict[str, tuple[np.ndarray, np.ndarray]]
    start: np.ndarray
    times: np.ndarray

    @property
    def table(self) -> Any:
        """The inputs as one table."""
        from multibody.system.simulate import input_table

        return input_table(self.system, self.inputs)

    def watched(self, states: np.ndarray) -> np.ndarray:
        """Return the outputs that errors are judged by, shape (nt, ·)."""
        names = [n for n in WATCHED if n in self.system.output_names]
        pick = [self.system.index("output", n) for n in names]
        inputs = self.table(self.times, self.system.p).reshape(self.times.size, -1)
        return self.system.outputs_along(self.times, states, inputs, self.system.p)[:, pick]

    def error(self, states: np.ndarray, truth: np.ndarray) -> float:
        """Return the largest RMS error of a watched output, relative to its standard deviation."""
        return float(np.max(np.sqrt(np.mean((self.watched(states) - truth) ** 2, axis=0)) / truth.std(axis=0)))


@cache
def reference_trip() -> Trip:
    """37 states, six seconds up."""
    return _trip("reference")


@cache
def trip(kind: str, stiff: bool = False) -> Trip:
    """Return a trip of ``"reference"``, ``"one_dimensional"`` or ``"cabin"``."""
    return _trip(kind, stiff)


def _trip(kind: str, stiff: bool = False) -> Trip:
    from vtsdt.lift.lift import Lift

    lift = getattr(Lift, kind)()
    times = np.arange(round(DURATION / STEP) + 1) * STEP
    inputs: dict[str, Any] = {}
    if kind == "cabin":
        whole = reference_trip()
        run = whole.system.simulate(DURATION, inputs=whole.inputs, initial=whole.start, times=times)
        inputs["F_c"] = (times, run["F_c"])
    else:
        given, omega = lift.speed_reference("up")
        inputs["omega_ref"] = (times, np.interp(times, given, omega))
    if kind == "one_dimensional":
        speed = np.interp(times, *lift.speed_reference("up"))
        for name in ("friction_c", "friction_cw"):
            inputs[name] = (times, -20.0 * np.tanh(-speed / 0.05))
    values = stiffer(lift.system) if stiff else {}
    first = {n: float(v[1][0]) for n, v in inputs.items() if n != "omega_ref"}
    start = lift.equilibrium(0.0, inputs=first, parameters=values).state
    system = lift.with_values(values).build() if values else lift.system
    return Trip(kind, system, inputs, start, times)


def stiffer(system: Any) -> dict[str, float]:
    """Return parameters of the stiff set: a current loop of 1 kHz, ropes and contact ten times as stiff."""
    p = dict(zip(system.parameter_names, system.p, strict=True))
    values = {}
    for name, value in p.items():
        if name == "ropes.EA" or name.endswith("_guide.stiffness"):
            values[name] = 10.0 * value
    if "control.K_pq" in p:
        band = 2.0 * np.pi * 1000.0
        values["control.K_pq"] = band * p["machine.L_q"]
        values["control.K_pd"] = band * p["machine.L_d"]
    return values


class HandWritten:
    """A trip in C: the model's own equations translated, and Dormand and Prince's method written by hand.

    Parameters
    ----------
    trip : Trip
    options : sequence of str
        For gcc.
    largest : float, s
        Largest step.
    stops : bool
        Whether steps end where the package's own methods end theirs for the sake of the inputs.
    """

    def __init__(
        self,
        trip: Trip,
        options: tuple[str, ...] = ("-O3", "-march=native"),
        largest: float = 1e300,
        stops: bool = False,
    ) -> None:
        from multibody.compile.c_source import c_source
        from multibody.compile.emitter.units import unit_of_text

        compiler = shutil.which("gcc") or shutil.which("cc")
        if compiler is None:
            raise FileNotFoundError("the comparison with C needs gcc: install it, or leave this benchmark out")
        system = trip.system
        kinds = ("float", *["floats"] * 4)
        text = c_source(unit_of_text(system.texts["rhs"], "rhs"), "rhs", kinds, "rhs")
        text += f"\n#define N {len(system.states)}\n#define N_U {len(system.inputs)}\n"
        text += (HERE / "dormand_prince.c").read_text(encoding="utf-8")
        self._folder = tempfile.TemporaryDirectory()
        source, library = Path(self._folder.name) / "trip.c", Path(self._folder.name) / "trip.so"
        source.write_text(text, encoding="utf-8")
        subprocess.run([compiler, *options, "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
        self._integrate = ctypes.CDLL(str(library)).integrate
        self._integrate.restype = ctypes.c_longlong
        pointer, number, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_longlong
        self._integrate.argtypes = [
            pointer,
            pointer,
            pointer,
            whole,
            number,
            pointer,
            whole,
            number,
            number,
            number,
            pointer,
            whole,
            pointer,
        ]
        self.trip, self.largest, self.stops = trip, largest, stops
        self._inputs = trip.table
        self.table = np.ascontiguousarray(self._inputs(trip.times, system.p).reshape(trip.times.size, -1))
        self.out = np.empty((trip.times.size, len(system.states)))
        self.times = trip.times
        self.p = system.p.copy()

    def __call__(self, rtol: float, atol: float) -> np.ndarray:
        """Integrate, and return the states at the trip's times."""
        stops = self._inputs.kernel_for(rtol)["breaks"] if self.stops else self.trip.times[:0]
        done = self._integrate(
            self.trip.start.ctypes.data,
            self.p.ctypes.data,
            self.table.ctypes.data,
            len(self.table),
            STEP,
            self.times.ctypes.data,
            self.times.size,
            rtol,
            atol,
            self.largest,
            stops.ctypes.data,
            stops.size,
            self.out.ctypes.data,
        )
        if done < 0:
            raise ArithmeticError("the step became too small")
        self.evaluations = done
        return self.out


# -------------------------------------------------------------------- methods at equal error

TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 1e-7)
Solve = Callable[[float, float], np.ndarray]


@cache
def truth(kind: str, stiff: bool = False) -> np.ndarray:
    """Return the watched outputs of a trip, integrated far more exactly than they are asked for."""
    from multibody.solvers import Rodas5P

    return trip(kind, stiff).watched(_native(kind, stiff, Rodas5P)(1e-9, 1e-12))


def _native(kind: str, stiff: bool, method: Any) -> Solve:
    from multibody.solvers import integrate
    from multibody.system.simulate import native_problem

    given = trip(kind, stiff)
    problem = native_problem(given.system, given.system.p, given.table, tangent=True)

    def solve(rtol: float, atol: float) -> np.ndarray:
        done = integrate(problem, (0.0, DURATION), given.start, t_eval=given.times, method=method, rtol=rtol, atol=atol)
        return np.ascontiguousarray(done.y.T)

    return solve


def _scipy(kind: str, stiff: bool, method: str) -> Solve:
    from multibody.solvers import integrate
    from multibody.system.simulate import native_problem

    given = trip(kind, stiff)
    problem = native_problem(given.system, given.system.p, given.table, tangent=method in ("Radau", "BDF", "LSODA"))

    def solve(rtol: float, atol: float) -> np.ndarray:
        done = integrate(problem, (0.0, DURATION), given.start, t_eval=given.times, method=method, rtol=rtol, atol=atol)
        return np.ascontiguousarray(done.y.T)

    return solve


def _sundae(kind: str, stiff: bool) -> Solve:
    from sksundae.cvode import CVODE

    from multibody.system.simulate import native_problem

    given = trip(kind, stiff)
    problem = native_problem(given.system, given.system.p, given.table, tangent=True)
    rates, jacobian = problem.fun, problem.jac  # one compiled call each, inputs included

    def rhs(t: float, y: np.ndarray, out: np.ndarray) -> None:
        out[:] = rates(t, y)

    def jac(t: float, y: np.ndarray, rate: np.ndarray, out: np.ndarray) -> None:
        out[:] = jacobian(t, y)

    def solve(rtol: float, atol: float) -> np.ndarray:
        done = CVODE(rhs, jacfn=jac, rtol=rtol, atol=atol, max_num_steps=100_000).solve(given.times, given.start)
        return np.ascontiguousarray(done.y)

    return solve


def entries(kind: str, stiff: bool = False, others: bool = True) -> dict[str, Any]:
    """Return the entries of one trip, each at its own loosest tolerance that keeps the error below `TARGET`."""
    from multibody import solvers

    def hand(options: tuple[str, ...]) -> Callable[[], Solve]:
        return lambda: HandWritten(trip(kind, stiff), options)

    makers: dict[str, Callable[[], Solve]] = {
        "C by hand, gcc -O3 -march=native": hand(("-O3", "-march=native")),
        "C by hand, gcc -O3": hand(("-O3",)),
        "C by hand, -O3 -march=native, no step longer than a sample": lambda: HandWritten(
            trip(kind, stiff), largest=STEP
        ),
        "C by hand, -O3 -march=native, steps end where the package's do": lambda: HandWritten(
            trip(kind, stiff), stops=True
        ),
        "solve_ivp, default method": lambda: _native(kind, stiff, solvers.Automatic),
        "solve_ivp, DormandPrince54": lambda: _native(kind, stiff, solvers.DormandPrince54),
        "solve_ivp, Rodas5P": lambda: _native(kind, stiff, solvers.Rodas5P),
    }
    if others:
        makers["CVODE (scikit-sundae), exact Jacobian"] = lambda: _sundae(kind, stiff)
        for method in ("LSODA", "RK45", "DOP853", "Radau", "BDF"):
            makers[f"SciPy {method}"] = lambda method=method: _scipy(kind, stiff, method)  # type: ignore[misc]
    return {f"bench_{k}": _entry(name, make, kind, stiff) for k, (name, make) in enumerate(makers.items())}


def _entry(name: str, make: Callable[[], Solve], kind: str, stiff: bool) -> Callable[[], Any]:
    def prepare() -> Callable[[], Any]:
        given, target = trip(kind, stiff), truth(kind, stiff)
        try:
            solve = make()
        except ModuleNotFoundError:  # another program: the others are measured all the same
            return lambda: float("nan")
        for rtol in TOLERANCES:
            try:
                states = solve(rtol, 1e-3 * rtol)
            except ArithmeticError:
                continue
            found = given.error(states, target) if len(states) == len(given.times) else np.inf
            if found <= TARGET:
                break
        else:
            raise ValueError(f"{name} does not reach an error of {TARGET:g} at any tolerance down to {rtol:g}")

        def work() -> None:
            solve(rtol, 1e-3 * rtol)

        work.note = f"rtol {rtol:g}, error {found:.1e}"  # type: ignore[attr-defined]
        return work

    prepare.__doc__ = name
    return prepare


# -------------------------------------------------------------------- where a short trip's time goes


def shares(kind: str) -> dict[str, Any]:
    """Return entries that take a trip apart: C and `solve_ivp` with the same steps, with and without samples."""
    from multibody import solvers

    rtol, atol, ends = 1e-2, 1e-5, np.array([DURATION])

    def hand(samples: bool) -> Callable[[], Any]:
        solve = HandWritten(trip(kind), stops=True)
        if not samples:
            solve.times = ends
        return lambda: (solve(rtol, atol), None)[1]

    def ours(times: Any = None, method: Any = solvers.DormandPrince54, end: float = DURATION) -> Callable[[], Any]:
        from multibody.solvers import integrate
        from multibody.system.simulate import native_problem

        given = trip(kind)
        problem = native_problem(given.system, given.system.p, given.table, tangent=True)
        at = given.times if times is None else times
        options = {"method": method, "rtol": rtol, "atol": atol}
        return lambda: (integrate(problem, (0.0, end), given.start, t_eval=at, **options), None)[1]

    def nothing() -> Callable[[], Any]:
        from scipy.integrate import OdeSolver, solve_ivp

        class Nothing(OdeSolver):
            """Arrives at once."""

            def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, vectorized: bool = False) -> None:
                super().__init__(fun, t0, y0, t_bound, vectorized)

            def _step_impl(self) -> tuple[bool, None]:
                self.t = self.t_bound
                return True, None

        start = trip(kind).start
        return lambda: (solve_ivp(_nowhere, (0.0, DURATION), start, method=Nothing), None)[1]

    makers = {
        "C by hand, steps end where the package's do": lambda: hand(True),
        "the same in C, the last state only": lambda: hand(False),
        "solve_ivp, DormandPrince54": ours,
        "the same, the last state only": lambda: ours(ends),
        "the same, 1 µs of motion: preparation and return": lambda: ours(np.array([1e-6]), end=1e-6),
        "solve_ivp with a method that does nothing": nothing,
    }
    return {f"bench_{k}": _named(name, make) for k, (name, make) in enumerate(makers.items())}


def _named(name: str, make: Callable[[], Any]) -> Callable[[], Any]:
    def prepare() -> Callable[[], Any]:
        return make()

    prepare.__doc__ = name
    return prepare


def _nowhere(t: float, y: np.ndarray) -> np.ndarray:
    return y
