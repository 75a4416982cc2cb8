"""Half a second of the cabin on its guides under a given rope tension, 12 states, at equal error, with other programs.

Exudyn and MuJoCo do the rigid body and the integration; the forces of Eqs. 3 and 4 act through their callbacks in
Python, as `tests/peers` states them.  Each takes the largest step of a series of halves that keeps the RMS error of the
cabin's acceleration below 1e-4 of its standard deviation.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from trips import TARGET, TOLERANCES

UNTIL, PERIOD = 0.5, 5e-3
SIDEWAYS = np.array([3e-4, -2e-4, 0.0, 5e-4, -4e-4, 3e-4, 0.01, -0.02, 0.3, 0.03, -0.02, 0.04])
PEERS = Path(__file__).resolve().parent.parent / "tests" / "peers"
STEPS = tuple(PERIOD / 2**k for k in range(12))


def _tests(name: str) -> Any:
    """Return the module of tests that builds a peer."""
    spec = importlib.util.spec_from_file_location(name, PEERS / f"{name}.py")
    if spec is None or spec.loader is None:
        raise ImportError(f"there is no {PEERS / name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def _case() -> tuple[Any, Any, np.ndarray, np.ndarray, Any]:
    """Parameters, system, start, times and the table of the tension (its polygon is off by 4e-7)."""
    from multibody.inputs.table import InputTable
    from vtsdt.files.parameters import LiftParameters
    from vtsdt.lift.lift import Lift

    parameters = LiftParameters.bench()
    lift = Lift.cabin(parameters)
    start = lift.equilibrium(0.3, inputs={"F_c": parameters.cabin.mass * 9.80665}).state + SIDEWAYS
    times = np.arange(round(UNTIL / PERIOD) + 1) * PERIOD
    fine = np.arange(5001) * 1e-4
    force = np.array([_tension(parameters, t) for t in fine])
    columns = {n: force if n == "F_c" else 0.0 for n in lift.system.input_names}
    return parameters, lift, start, times, InputTable.from_columns(fine, columns)


def _tension(parameters: Any, t: float) -> float:
    return parameters.cabin.mass * 9.80665 + 4.0 * float(np.sin(2.0 * np.pi * 3.0 * t))


def _ours(rtol: float, method: str = "Automatic") -> np.ndarray:
    from multibody import solvers
    from multibody.system.simulate import native_problem

    _, lift, start, times, table = _case()
    problem = native_problem(lift.system, lift.system.p, table, tangent=method == "Rodas5P")
    run = solvers.integrate(
        problem, (0.0, UNTIL), start, t_eval=times, method=getattr(solvers, method), rtol=rtol, atol=1e-3 * rtol
    )
    return np.ascontiguousarray(run.y.T)


def _acceleration(states: np.ndarray) -> np.ndarray:
    _, lift, _, times, table = _case()
    inputs = table(times, lift.system.p)
    index = lift.system.index("output", "zdd_c")
    return lift.system.outputs_along(times, states, inputs, lift.system.p)[:, index]


@cache
def _truth() -> np.ndarray:
    return _acceleration(_ours(1e-11, "DormandPrince54"))


def _matched(solve: Callable[[float], np.ndarray], settings: tuple[float, ...], name: str) -> Callable[[], None]:
    """Return the work at the loosest setting that reaches the target."""
    truth = _truth()
    for setting in settings:
        found = float(np.sqrt(np.mean((solve(setting)[1:] - truth[1:]) ** 2)) / truth.std())
        if found <= TARGET:
            break
    else:
        raise ValueError(f"{name} does not reach an error of {TARGET:g}: {found:.1e} at {setting:g}")

    def work() -> None:
        solve(setting)

    work.note = f"{'rtol' if settings is TOLERANCES else 'step'} {setting:g}, error {found:.1e}"  # type: ignore[attr-defined]
    return work


def bench_ours() -> Callable[[], None]:
    """solve_ivp, default method"""
    return _matched(lambda rtol: _acceleration(_ours(rtol)), TOLERANCES, "ours")


def bench_exudyn() -> Callable[[], None]:
    """Exudyn, Runge-Kutta 4, forces in Python"""
    parameters, lift, start, times, _ = _case()
    tests = _tests("test_lift_cabin_exudyn")
    exudyn, peer = tests.exudyn, tests.Peer(parameters, lift.rim_heights[0], start)
    sensor = peer.mbs.AddSensor(
        exudyn.itemInterface.SensorNode(
            nodeNumber=peer.node,
            storeInternal=True,
            writeToFile=False,
            outputVariableType=exudyn.OutputVariableType.Acceleration,
        )
    )
    peer.mbs.Assemble()

    def solve(step: float) -> np.ndarray:
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(UNTIL / step)
        settings.timeIntegration.endTime = UNTIL
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = PERIOD
        peer.mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)
        return np.array(peer.mbs.GetSensorStoredData(sensor))[: times.size, 3]

    return _matched(solve, STEPS, "Exudyn")


def bench_mujoco() -> Callable[[], None]:
    """MuJoCo, Runge-Kutta 4, forces in Python"""
    parameters, lift, start, times, _ = _case()
    tests = _tests("test_lift_cabin_peers")
    mujoco, peer = tests.mujoco, tests.Peer(parameters, lift.rim_heights[0])
    model, data = peer.model, peer.data
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    x, y, z, w = tests.Turn.from_euler("ZYX", start[[5, 4, 3]]).as_quat()

    def push(_: Any, at: Any) -> None:
        at.qfrc_applied[:] = 0.0
        for name in tests.PLACES:
            peer.push(name, peer.force(name))
        way = np.array([0.0, 0.0, peer.anchor]) - at.site_xpos[peer.sites["hitch"]]
        peer.push("hitch", _tension(parameters, at.time) * way / np.linalg.norm(way))

    def solve(step: float) -> np.ndarray:
        mujoco.mj_resetData(model, data)
        model.opt.timestep = step
        data.qpos[:] = (*start[:3], w, x, y, z)
        data.qvel[:] = start[6:]
        found = np.empty(times.size)
        mujoco.set_mjcb_control(push)
        try:
            for k in range(times.size):
                for _ in range(round(PERIOD / step) if k else 0):
                    mujoco.mj_step(model, data)
                mujoco.mj_forward(model, data)
                found[k] = data.qacc[2]
        finally:
            mujoco.set_mjcb_control(None)
        return found

    return _matched(solve, STEPS, "MuJoCo")
