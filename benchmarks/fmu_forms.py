"""An exported unit beside the system that it was made from, in Model Exchange and in Co-Simulation.

FMPy's own loops (0.3.32) hold inputs over a step in both forms, and cannot set their derivatives (there is room for
exactly nine); the loops here use the instances that FMPy makes.  Co-Simulation of FMI 3.0 has no derivatives of inputs
and holds them over a communication step: it is laid beside a simulation that does so, too.
"""

from __future__ import annotations

import time
from ctypes import POINTER, c_double
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

__all__ = [
    "FORMS",
    "LOOPS",
    "TIGHT",
    "VERSIONS",
    "Beside",
    "Case",
    "beside",
    "deviations",
    "opened",
    "real",
    "set_real",
    "step",
]

VERSIONS = ("2.0", "3.0")
FORMS = ("ModelExchange", "CoSimulation")
#: Relative and absolute tolerance with which the integration no longer counts, so that what is left is the unit's.
TIGHT = (1e-9, 1e-12)


@dataclass(frozen=True, kw_only=True)
class Case:
    """How a system is driven.

    Parameters
    ----------
    until, step : float, s
    initial : dict
        Start values of states, which the unit has too.
    inputs : dict
        For each input ``(times, values)``, on the grid of the steps.
    """

    until: float
    step: float
    initial: dict[str, float] = field(default_factory=dict)
    inputs: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Beside:
    """Values of states and outputs by the system and by its unit, and the processor time of both, s."""

    true: np.ndarray
    found: np.ndarray
    names: tuple[str, ...]
    native_time: float
    unit_time: float


def deviations(runs: Beside) -> dict[str, float]:
    """Return the largest deviation of each state and output, as a share of its range.

    The range of what rests counts as 1e-9 of its magnitude, at least 1e-9.
    """
    away = np.max(np.abs(runs.found - runs.true), axis=0)
    least = 1e-9 * np.maximum(1.0, np.max(np.abs(runs.true), axis=0))
    return dict(zip(runs.names, map(float, away / np.maximum(np.ptp(runs.true, axis=0), least)), strict=True))


def beside(
    system: Any,
    path: Path,
    form: str,
    case: Case,
    tolerances: tuple[float, float] = TIGHT,
    of_unit: tuple[float, float] | None = None,
    **given: str,
) -> Beside:
    """Simulate a system, and its unit in one form, with the same tolerances or with others.

    In Model Exchange a ``method`` of SciPy may be named.
    """
    described = fmpy.read_model_description(str(path))
    held = described.fmiVersion.startswith("3") and form == "CoSimulation"
    names = tuple(v.name for v in described.modelVariables if v.causality == "output" or v.name in system.state_names)
    rtol, atol = tolerances
    options = {"interpolation": "hold" if held else "linear", "rtol": rtol, "atol": atol}
    begun = time.process_time()
    run = system.simulate(case.until, step=case.step, initial=case.initial, inputs=case.inputs, **options)
    true = np.column_stack([run[n] for n in names])
    native_time = time.process_time() - begun
    tolerances = of_unit or tolerances
    described, fmu = opened(path, form, tolerances[0])
    of = {v.name: v.valueReference for v in described.modelVariables}
    begun = time.process_time()
    found = LOOPS[form](
        fmu,
        described,
        [of[n] for n in names],
        [of[n] for n in system.state_names],
        run.times,
        case,
        tolerances,
        **given,
    )
    unit_time = time.process_time() - begun
    fmu.terminate()
    fmu.freeInstance()
    return Beside(true=true, found=found, names=names, native_time=native_time, unit_time=unit_time)


def opened(path: Path, form: str, tolerance: float = TIGHT[0]) -> tuple[Any, Any]:
    """Return the description and a running instance of a unit, unpacked beside its file."""
    described = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path), str(path.with_suffix("")))
    fmu = fmpy.instantiate_fmu(folder, described, fmi_type=form)
    given = {"tolerance": tolerance, "startTime": 0.0}
    if described.fmiVersion == "2.0":
        fmu.setupExperiment(**given)
        fmu.enterInitializationMode()
    else:
        fmu.enterInitializationMode(**given)
    fmu.exitInitializationMode()
    return described, fmu


def real(fmu: Any, *references: int) -> list[float]:
    """Return values of an instance of either version."""
    found: list[float] = (fmu.getReal if hasattr(fmu, "getReal") else fmu.getFloat64)(list(references))
    return found


def set_real(fmu: Any, references: list[int], values: list[float]) -> None:
    """Set values of an instance of either version."""
    if references:
        (fmu.setReal if hasattr(fmu, "setReal") else fmu.setFloat64)(references, values)


def step(fmu: Any, begin: float, size: float) -> None:
    """Take a communication step."""
    fmu.doStep(currentCommunicationPoint=begin, communicationStepSize=size)


def _stepped(
    fmu: Any,
    described: Any,
    shown: list[int],
    states: list[int],
    times: np.ndarray,
    case: Case,
    tolerances: tuple[float, float],
) -> np.ndarray:
    """Return values by Co-Simulation, with the inputs' derivatives where the standard has them."""
    del states, tolerances
    of = {v.name: v.valueReference for v in described.modelVariables}
    driven = [of[n] for n in case.inputs]
    values = np.array([np.interp(times, *given) for given in case.inputs.values()]).reshape(len(driven), times.size)
    rows = []
    for k, now in enumerate(times):
        set_real(fmu, driven, values[:, k].tolist())
        rows.append(real(fmu, *shown))
        if k + 1 == times.size:
            break
        size = times[k + 1] - now
        if driven and described.fmiVersion == "2.0":
            slopes = ((values[:, k + 1] - values[:, k]) / size).tolist()
            fmu.setRealInputDerivatives(driven, [1] * len(driven), slopes)
        step(fmu, now, size)
    return np.array(rows)


def _integrated(
    fmu: Any,
    described: Any,
    shown: list[int],
    states: list[int],
    times: np.ndarray,
    case: Case,
    tolerances: tuple[float, float],
    method: str = "RK45",
) -> np.ndarray:
    """Return values by Model Exchange, integrated by SciPy with the inputs at every evaluation.

    Inputs have a kink at each sample.  A method of one step is begun anew there; LSODA, which looks back over many
    steps, goes on over the kinks.
    """
    from scipy.integrate import solve_ivp

    of = {v.name: v.valueReference for v in described.modelVariables}
    driven = [of[n] for n in case.inputs]
    n = len(states)
    x = np.array(real(fmu, *states))
    fmu.enterContinuousTimeMode()
    rates = np.empty(n)
    write, pointer = rates.ctypes.data_as(POINTER(c_double)), POINTER(c_double)
    ask = fmu.getDerivatives if hasattr(fmu, "getDerivatives") else fmu.getContinuousStateDerivatives

    def go_to(t: float, x: np.ndarray) -> None:
        fmu.setTime(t)
        set_real(fmu, driven, [float(np.interp(t, *v)) for v in case.inputs.values()])
        x = np.ascontiguousarray(x)
        fmu.setContinuousStates(x.ctypes.data_as(pointer), n)

    def f(t: float, x: np.ndarray) -> np.ndarray:
        go_to(t, x)
        ask(write, n)
        return rates.copy()

    given = {"rtol": tolerances[0], "atol": tolerances[1]}
    rows = []

    def show(t: float, x: np.ndarray) -> None:
        go_to(t, x)
        rows.append(real(fmu, *shown))

    if method == "LSODA":
        longest = case.step if driven else np.inf
        span = (float(times[0]), float(times[-1]))
        for t, state in zip(times, solve_ivp(f, span, x, method, times, max_step=longest, **given).y.T, strict=True):
            show(float(t), state)
        return np.array(rows)
    size = None
    show(float(times[0]), x)
    for begin, end in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        piece = solve_ivp(f, (begin, end), x, method, first_step=size and min(size, end - begin), **given)
        taken = np.diff(piece.t)
        size = float(taken[-2] if taken.size > 1 else taken[-1])  # the last one is cut off at the sample
        x = piece.y[:, -1]
        show(end, x)
    return np.array(rows)


#: What simulates an instance, by form.
LOOPS = {"ModelExchange": _integrated, "CoSimulation": _stepped}
