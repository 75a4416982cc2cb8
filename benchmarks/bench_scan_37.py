"""Scan of 100 candidate effects on one 6 s trip of the lift with 37 states.

The machine is simulated along the trip, its transitions from sample to sample are worked out once, and the force of
every candidate at every point of its shape grid is carried through them to the eight outputs; then the residual is
scored, plainly weighed, with 400 shuffled residuals.  Nothing is kept from the round before.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

CANDIDATES = 100


@cache
def _facts() -> tuple[Any, Any, list[Any]]:
    """Return a stage of the reference model beside one trip, and 100 candidates, evenly over the catalogue."""
    import numpy as np

    from discrepancy.catalogue import catalogue
    from discrepancy.search import scan_preparation
    from discrepancy.setup import noise_floors
    from discrepancy.study import Study
    from vtsdt.bench_rig import LiftRig

    case = LiftRig(seed=1, trips=2, under_test="reference").case()
    study = Study(case.setup(seed=1, residual="simulation"))
    study.prepare()
    experiment = study.setup.identify[0]
    system = study.setup.model.build(probes=True, outputs=experiment.outputs)
    x = experiment.start_vector(system)
    own = np.array([x[system.index("state", n)] for n in experiment.free])
    noise = noise_floors(study.setup.identify, {})
    values = {q.name: q.value for q in study.setup.uncertain}
    scale = {n: noise[n] for n in experiment.outputs}
    stage = study.held_stage("recalibrated", (), values, [own], scale, noise)
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs)
    picked = [entries[int(k)] for k in np.linspace(0, len(entries) - 1, CANDIDATES)]
    return stage, scan_preparation(stage), picked


def _columns(each: int) -> Callable[[], None]:
    from discrepancy.columns import Confrontation, candidate_columns

    stage, preparation, entries = _facts()
    shapes = 0

    def work() -> None:
        nonlocal shapes
        stage.worked_out.clear()
        for fit in stage.identify.fits:
            fit.experiment._cache.clear()
        facts = Confrontation.of_stage(stage, preparation)
        candidates, _ = candidate_columns(facts, entries[::each])
        shapes = sum(len(c.columns) for c in candidates)

    work()
    work.note = f"{len(entries[::each])} candidates, {shapes} with their shapes"  # type: ignore[attr-defined]
    return work


def bench_columns() -> Callable[[], None]:
    """what every candidate changes in the outputs"""
    return _columns(1)


def bench_columns_fewer() -> Callable[[], None]:
    """of every tenth candidate: what the trip itself costs"""
    return _columns(10)


def bench_scores() -> Callable[[], None]:
    """scores of all, with their null"""
    import numpy as np

    from discrepancy.columns import Confrontation, candidate_columns
    from discrepancy.scan import scan
    from discrepancy.search import LOOKS
    from discrepancy.whitening import identity

    stage, preparation, entries = _facts()
    facts = Confrontation.of_stage(stage, preparation)
    candidates, _ = candidate_columns(facts, entries)
    residual, sensitivities = facts.residual(), facts.sensitivities()
    sizes = np.maximum(np.sqrt(np.mean(np.concatenate(residual.blocks) ** 2, axis=0)), 1e-300)

    def work() -> None:
        plain = identity(list(sizes), residual.channels, residual.dt)
        scan(residual, sensitivities, candidates, level=0.02 / LOOKS, seed=1, whitener=plain)

    work()
    return work
