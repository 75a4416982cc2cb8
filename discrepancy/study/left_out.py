"""Stretches of records that a person leaves out of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.residual.windows import crop, sub_record
from estimation.response.experiment import Experiment

__all__ = ["Stretch", "without_stretches"]

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
    identify = tuple(part for e in problem.identify for part in _parts(e, stretches))
    if not identify:
        raise ValueError("nothing would be left to fit: keep a part of one identification record at least")
    validate = tuple(part for e in problem.validate for part in _parts(e, stretches))
    return replace(problem, identify=identify, validate=validate)


def _parts(experiment: Experiment, stretches: Sequence[Stretch]) -> list[Experiment]:
    mine = [s for s in stretches if s.record == experiment.name]
    if not mine:
        return [experiment]
    experiment = crop(experiment)
    time = experiment.record.time
    kept = np.ones(time.size, dtype=bool)
    for s in mine:
        kept &= (time < s.start) | (time > s.stop)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(int)))
    ranges = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= LEAST]
    name = experiment.name
    parts = []
    for k, (a, b) in enumerate(ranges, 1):
        own = name if len(ranges) == 1 else f"{name}, part {k}"
        parts.append(replace(experiment, record=sub_record(experiment.record, slice(int(a), int(b)), own)))
    return parts
