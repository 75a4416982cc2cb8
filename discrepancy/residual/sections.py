"""Sections of very long records: evenly spread over a record, they stand for it in fits and in the search.

Where they lie follows from the length of the record alone, never from what is in it, so that every test and interval
keeps its meaning; only its power is that of fewer rows.  Means over ever more samples, by which a search by evidence
bounds its own rows, would average over whole periods of the machine instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.residual.initial_state import estimate_states
from discrepancy.residual.windows import crop, samples_needed, window
from multibody.base.errors import SimulationError
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["in_sections"]

#: Sections of a record: as many as the blocks that a search by evidence leaves out in turn, which are then apart.
SECTIONS = 8
#: Least samples of a section that are left after decimation and the edges of filters, in those that a window needs.
LEAST_WINDOWS = 10


def in_sections(problem: Problem, progress: Callable[[str], None]) -> Problem:
    """Return a problem in which records of more than ``problem.most_rows`` rows are replaced by sections of them.

    All such records together keep about ``most_rows`` rows, those held out as many again.  A section starts from a
    state of its own, which is fitted; the fit begins with the state that a simulation of the whole record has there,
    led back to the sensors where it departs from them.  The first section starts as the record does.

    Records stay whole whose outputs have instants of their own, those of a unit that is stepped, which shows no states,
    and those that cannot be simulated.

    Parameters
    ----------
    problem : Problem
    progress : callable
        Gets a line of text for each record.
    """
    if problem.model.stepped_part:
        return problem
    system: System | None = None
    parts, notes = {}, []
    for part in ("identify", "validate"):
        experiments: list[Experiment] = []
        given: Sequence[Experiment] = getattr(problem, part)
        long = sum(_rows(e) > problem.most_rows for e in given)
        for e in given:
            bounds = _bounds(e, problem.most_rows, long)
            if not bounds or e.at_own_instants:
                experiments.append(e)
                continue
            if system is None:
                system = problem.model.build(outputs=e.outputs)
            progress(f"{SECTIONS} sections of {e.name}, which has {_rows(e)} rows")
            cut = _cut(e, system, problem, bounds)
            experiments += cut or [e]
            if cut:
                notes.append(
                    f"{e.name} has {_rows(e)} rows: {SECTIONS} sections of {count_text(bounds[0].stop, 'row')}, evenly "
                    "spread over it, stand for it in fits, tests and errors ([study] most_rows raises the limit)"
                )
        parts[part] = tuple(experiments)
    return replace(problem, **parts, warnings=(*problem.warnings, *notes)) if notes else problem  # type: ignore[arg-type]


def _rows(experiment: Experiment) -> int:
    """Return the rows of a record between the start and the stop of its preparation."""
    given, time = experiment.preparation, np.asarray(experiment.record.time)
    low = -np.inf if given.start is None else given.start
    high = np.inf if given.stop is None else given.stop
    return int(np.count_nonzero((time >= low) & (time <= high)))


def _bounds(experiment: Experiment, most: int, records: int) -> list[slice]:
    """Return the rows of each section of a cropped record; empty where it stays whole."""
    rows = _rows(experiment)
    if rows <= most:
        return []
    least = LEAST_WINDOWS * samples_needed(experiment.preparation, experiment.record.rate)
    length = max(most // (records * SECTIONS), least)
    if SECTIONS * length >= rows:
        return []
    begins = np.linspace(0, rows - length, SECTIONS).round().astype(int)
    return [slice(int(a), int(a) + length) for a in begins]


def _cut(experiment: Experiment, system: System, problem: Problem, bounds: Sequence[slice]) -> list[Experiment]:
    """Return the sections as experiments; empty where the record cannot be simulated at all."""
    whole = crop(experiment)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    try:
        states = estimate_states(whole, system, p)
    except SimulationError:
        return []
    return [window(states, rows, named=True) for rows in bounds]
