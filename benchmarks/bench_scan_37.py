"""Columns of 100 candidate effects on one 6 s trip of the lift with 37 states.

The machine is simulated along the trip, its transitions from sample to sample are worked out once, and the force of
every candidate at every point of its shape grid is carried through them to the eight outputs.  Nothing is kept from the
round before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

CANDIDATES = 100


@cache
def _stage() -> tuple[Any, Any, list[Any]]:
    """Return a stage of the reference model beside one trip, and 100 candidates, evenly over the catalogue."""
    import numpy as np

    from discrepancy.effects.catalogue import catalogue
    from discrepancy.problem.problem import noise_floors
    from discrepancy.study.study import Study
    from vtsdt.rig.rig import LiftRig

    case = LiftRig(seed=1, trips=2, under_test="reference").case()
    problem = case.problem(seed=1, residual="simulation")
    problem = replace(problem, identify=(_followed(problem, problem.identify[0]),), validate=())
    study = Study(problem)
    study.prepare()
    experiment = study.problem.identify[0]
    system = study.problem.model.build(probes=True, outputs=experiment.outputs)
    x = experiment.start_vector(system)
    own = np.array([x[system.index("state", n)] for n in experiment.free])
    noise = noise_floors(study.problem.identify, {})
    values = {q.name: q.value for q in study.problem.uncertain}
    scale = {n: noise[n] for n in experiment.outputs}
    stage = study.restored("recalibrated", (), values, [own], scale, noise)
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs)
    picked = [entries[int(k)] for k in np.linspace(0, len(entries) - 1, CANDIDATES)]
    return stage, stage.scan_preparation, picked


def _followed(problem: Any, experiment: Any) -> Any:
    """Return an experiment whose record the model follows but for noise, as after a calibration."""
    import numpy as np

    system = problem.model.build(probes=True, outputs=experiment.outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    y = experiment.simulate(system, p)
    rng, signals = np.random.default_rng(1), dict(experiment.record.signals)
    for k, name in enumerate(experiment.outputs):
        values = y[:, k] + 1e-3 * np.std(y[:, k]) * rng.standard_normal(len(y))
        signals[name] = replace(signals[name], values=values)
    return replace(experiment, record=replace(experiment.record, signals=signals))


def _columns(each: int) -> Callable[[], None]:
    from discrepancy.sensitivities.candidates import candidate_sensitivities

    stage, preparation, entries = _stage()
    shapes = 0

    def work() -> None:
        nonlocal shapes
        for fit in stage.identify.fits:
            fit.experiment.clear_cache()
        linearised = stage.without_results().linearised_problem(preparation)
        candidates, _ = candidate_sensitivities(linearised, entries[::each])
        shapes = sum(len(c.sensitivities) for c in candidates)

    work()
    work.note = f"{len(entries[::each])} candidates, {shapes} with their shapes"  # type: ignore[attr-defined]
    return work


def bench_columns() -> Callable[[], None]:
    """what every candidate changes in the outputs"""
    return _columns(1)


def bench_columns_fewer() -> Callable[[], None]:
    """of every tenth candidate: what the trip itself costs"""
    return _columns(10)
