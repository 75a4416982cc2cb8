"""A dead time of a held input: its derivative is right, and a fit finds it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation import Experiment, Record, RecordedSignal, UncertainParameter, calibrate
from multibody import Model
from multibody.library import FlowSource, Orifice, Tank

AREA, DENSITY = 0.05, 1000.0
STEP = 1.0  # s: the pump's command is sent once a second and held until the next
TIME = np.arange(400) * STEP


def pumped(delay: float) -> Model:
    """A tank that drains through an orifice and is filled by a pump which answers late."""
    model = Model("pump")
    tank = model.add("tank", Tank(area=AREA))
    hole = model.add("hole", Orifice(area=2e-4, discharge=0.6))
    pump = model.add("pump", FlowSource())
    model.connect(tank.port, hole.a, pump.b)
    model.connect(hole.b, pump.a, model.ground)
    model.input("flow", pump.flow)
    return model.with_input_error("flow", delay=delay)


def experiment(record: Record) -> Experiment:
    return Experiment(
        record=record, inputs=("flow",), outputs=("tank.level",), held=("flow",), start={"tank.level": 0.4}, rtol=1e-9
    )


def recording(delay: float) -> Record:
    rng = np.random.default_rng(8)
    flow = 3e-4 + 1e-4 * np.repeat(rng.choice([-1.0, 1.0], 40), 10) + 2e-5 * rng.standard_normal(400)
    signals = {
        "flow": RecordedSignal(values=flow, unit="m**3/s", column="flow", measured_unit="m**3/s"),
        "tank.level": RecordedSignal(values=np.zeros(400), unit="m", column="level", measured_unit="m"),
    }
    record = Record(name="pump", path=Path("pump.csv"), time=TIME, signals=signals)
    system = pumped(delay).build()
    level = experiment(record).simulate(system, system.parameter_vector({}))[:, 0]
    noisy = level + 2e-4 * rng.standard_normal(400)
    return Record(
        name="pump",
        path=Path("pump.csv"),
        time=TIME,
        signals={**signals, "tank.level": RecordedSignal(values=noisy, unit="m", column="level", measured_unit="m")},
    )


def delay_name(system) -> str:
    (index,) = system.input_delays.values()
    return system.parameter_names[index]


def test_derivative_by_the_delay_is_that_of_the_response():
    record = recording(6.0)
    system = pumped(6.3).build()
    name = delay_name(system)
    run = experiment(record)
    by_delay = run.respond(system, system.parameter_vector({}), parameters=[name]).derivatives[:, 0, 0]
    # Over a whole sample up and down the response to a held input is a straight line in the delay, up to the curvature
    # of what the tank does within a sample, which is slow: its time constant is minutes.
    late, early = (run.simulate(system, system.parameter_vector({name: 6.3 + d}))[:, 0] for d in (STEP, -STEP))
    expected = (late - early) / (2.0 * STEP)
    assert np.max(np.abs(by_delay - expected)) < 0.1 * np.max(np.abs(expected))
    assert np.corrcoef(by_delay, expected)[0, 1] > 0.99


def test_a_dead_time_is_found_from_far_away():
    record = recording(6.0)
    system = pumped(3.0).build()
    name = delay_name(system)
    fit = calibrate(
        system,
        [experiment(record)],
        [UncertainParameter(name=name, value=3.0, std=5.0, min=0.0, unit="s")],
        noise={"tank.level": 2e-4},
    )
    assert abs(fit[name] - 6.0) < max(4.0 * float(fit.std[0]), 0.05 * STEP)
    assert 0.0 < fit.std[0] < 0.5
