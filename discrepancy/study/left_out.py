"""Stretches of records that a person leaves out of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.residual.initial_state import estimate_states
from discrepancy.residual.windows import crop, sub_record, window
from estimation.response.experiment import Experiment
from multibody.base.errors import SimulationError

__all__ = ["Stretch", "stretch_of", "stretches_in", "without_stretches"]

LEAST = 100  # samples of a remainder that is worth keeping; chosen: a fit needs some beside the free initial state


@dataclass(frozen=True)
class Stretch:
    """A stretch of a record, or the whole of it.

    Parameters
    ----------
    record : str
    start, stop : float, s
        Infinite where the record's own beginning or end is meant.
    """

    record: str
    start: float = -np.inf
    stop: float = np.inf

    def to_dict(self) -> dict[str, float | str | None]:
        """Return it for a JSON file; None stands for the record's own beginning or end."""
        start, stop = (None if not np.isfinite(t) else float(t) for t in (self.start, self.stop))
        return {"record": self.record, "start": start, "stop": stop}

    def __str__(self) -> str:
        if not (np.isfinite(self.start) or np.isfinite(self.stop)):
            return self.record
        begin = "its beginning" if not np.isfinite(self.start) else f"{self.start:.4g} s"
        end = "its end" if not np.isfinite(self.stop) else f"{self.stop:.4g} s"
        return f"{self.record} from {begin} to {end}"


def stretch_of(source: Problem, used: Problem, stretch: Stretch) -> Stretch:
    """Return a stretch of a record's part, section or window as one of the record itself.

    Parameters
    ----------
    source, used : Problem
        With whole records, and with the parts of them that are used.
    stretch : Stretch
        Of a record of either.
    """
    known = [e.name for e in (*source.identify, *source.validate)]
    if stretch.record in known:
        return stretch
    times = [e.record.time for e in (*used.identify, *used.validate) if e.name == stretch.record]
    whole = [n for n in known if stretch.record.startswith(f"{n} [")]
    if not times or not whole:
        return stretch
    low, high = float(min(t[0] for t in times)), float(max(t[-1] for t in times))
    return Stretch(max(whole, key=len), max(low, stretch.start), min(high, stretch.stop))


def stretches_in(left_out: Sequence[Stretch], wanted: Stretch) -> list[Stretch]:
    """Return those stretches of a record that lie within wanted times.

    Raises
    ------
    KeyError
        If there is none.
    """
    inside = [s for s in left_out if s.record == wanted.record and wanted.start <= s.start and s.stop <= wanted.stop]
    if not inside:
        given = "; ".join(map(str, left_out)) or "nothing"
        raise KeyError(f"no stretch of {wanted} is left out: {given} is")
    return inside


def without_stretches(problem: Problem, stretches: Sequence[Stretch]) -> Problem:
    """Return a problem without some stretches of its records; a record is divided where its middle is left out.

    Raises
    ------
    KeyError
        If there is no such record.
    ValueError
        If a stretch ends before it begins, or nothing is left to fit.
    """
    known = [e.name for e in (*problem.identify, *problem.validate)]
    for s in stretches:
        if s.record not in known:
            raise KeyError(f"there is no record '{s.record}' in this study: take one of {', '.join(known)}")
        if not s.start < s.stop:
            raise ValueError(f"{s.record}: the stretch from {s.start:g} s to {s.stop:g} s is empty")
    identify = tuple(part for e in problem.identify for part in _parts(e, stretches, problem))
    if not identify:
        raise ValueError("nothing would be left to fit: keep a part of one identification record at least")
    validate = tuple(part for e in problem.validate for part in _parts(e, stretches, problem))
    return replace(problem, identify=identify, validate=validate)


def _parts(experiment: Experiment, stretches: Sequence[Stretch], problem: Problem) -> list[Experiment]:
    """Return what is used of a record; a part that begins later than the record starts from a state of its own."""
    mine = [s for s in stretches if s.record == experiment.name]
    if not mine:
        return [experiment]
    experiment = crop(experiment)
    time = experiment.record.time
    kept = np.ones(time.size, dtype=bool)
    for s in mine:
        kept &= (time < s.start) | (time > s.stop)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(int)))
    ranges = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= LEAST]
    if not any(a for a, _ in ranges):
        return [replace(experiment, record=sub_record(experiment.record, slice(*r), experiment.name)) for r in ranges]
    if problem.model.stepped_part:
        raise ValueError(
            f"{experiment.name}: a unit that steps itself cannot begin in mid-record: leave the end of the record out, "
            "or all of it"
        )
    system = problem.model.build(outputs=experiment.outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    try:
        states = estimate_states(experiment, system, p)
    except SimulationError as error:
        raise ValueError(
            f"{experiment.name}: the model cannot be simulated up to the middle of this record, where it would begin: "
            f"leave the end of the record out, or all of it ({error})"
        ) from None
    return [window(states, slice(*r), named=len(ranges) > 1) for r in ranges]
