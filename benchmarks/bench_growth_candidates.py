"""Growth with the number of candidate effects: their sensitivities on six records of 6 s of the virtual axis.

A part of the catalogue is drawn at random: it goes through places and kinds in order, and what has a state of its own
costs many times what has none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np


@cache
def _stage() -> tuple[Any, Any, Any]:
    from discrepancy.effects.catalogue import catalogue
    from discrepancy.rigs.axis import axis_case
    from discrepancy.study.study import Study

    stage = Study(axis_case(1, ["coulomb_friction@guide"]).problem(seed=1)).stage
    experiment = stage.identify.fits[0].experiment
    return stage, stage.scan_preparation, catalogue(stage.system, experiment.outputs, experiment.inputs)


def _columns(every: int) -> Callable[[], None]:
    from discrepancy.sensitivities.candidates import candidate_sensitivities

    stage, preparation, entries = _stage()
    drawn = np.random.default_rng(0).permutation(len(entries))[: -(-len(entries) // every)]
    chosen = [entries[k] for k in sorted(drawn)]

    def work() -> None:
        fresh = stage.without_results()  # nothing kept from the round before
        candidate_sensitivities(fresh.linearised_problem(preparation), chosen)

    work()
    work.note = f"{len(chosen)} effects"  # type: ignore[attr-defined]
    return work


def bench_quarter() -> Callable[[], None]:
    """a quarter of the catalogue"""
    return _columns(4)


def bench_half() -> Callable[[], None]:
    """a half"""
    return _columns(2)


def bench_whole() -> Callable[[], None]:
    """all"""
    return _columns(1)
