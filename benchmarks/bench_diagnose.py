"""The search for a missing effect on the virtual axis (six records of 6 s): its parts, and the whole."""

from __future__ import annotations

from collections.abc import Callable


def _study():  # type: ignore[no-untyped-def]
    from discrepancy.rigs.axis import axis_case
    from discrepancy.study.study import Study

    return Study(axis_case(1, ["coulomb_friction@guide"]).problem(seed=1))


def bench_columns() -> Callable[[], None]:
    """sensitivities of all candidates and shapes on all records"""
    from discrepancy.effects.catalogue import catalogue
    from discrepancy.sensitivities.candidates import candidate_sensitivities

    stage = _study().stage
    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs)

    def work() -> None:
        candidate_sensitivities(stage.linearised_problem(), entries)

    work()
    return work


def bench_step() -> Callable[[], None]:
    """one step of the search: columns, scores, null, refits of the finalists"""
    study = _study()
    _ = study.stage

    def work() -> None:
        study.explain()
        study.decisions.clear()

    work()
    return work


def bench_diagnosis() -> Callable[[], None]:
    """whole diagnosis, everything compiled"""

    def work() -> None:
        _study().diagnose()

    work()
    return work
