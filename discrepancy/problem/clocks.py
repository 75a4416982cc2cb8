"""Loggers whose clocks differ by a constant: how far to move them before a fit finds the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimation.response.experiment import Experiment
from estimation.signals.preparation import Preparation, edge_time
from estimation.signals.time_shift import time_shift
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["found_offsets", "with_margin"]

#: A clock is moved where this factor or less is left of what the model did not explain; else the fit begins at zero.
CLEARLY = 0.5
#: Share of the shortest record that is left out at each end: as far as a fit may move a clock without comparing
#: outputs at times before or after those of the inputs.
MARGIN = 0.01


def found_offsets(experiments: Sequence[Experiment], system: System, p: np.ndarray) -> dict[str, dict[str, float]]:
    """Return what to add to the time of loggers whose clocks are fitted, by record and pattern of file names.

    A fit of a motion that swings ends at the next swing: it has to begin near.  The outputs of the model as given are
    shifted along the whole record, and the shift is taken at which a logger's channels follow them best.

    Parameters
    ----------
    experiments : sequence of Experiment
    system : System
    p : ndarray
        Parameters at the start of the fit.
    """
    offsets: dict[str, dict[str, float]] = {}
    for e in experiments:
        if not e.clocks:
            continue
        time, signals = np.asarray(e.record.time), e.record.signals
        on_grid = {n: replace(s, own=None) for n, s in signals.items()}
        whole = replace(e, record=replace(e.record, signals=on_grid), preparation=Preparation(), clocks=())
        try:
            modelled = whole.simulate(system, p)
        except SimulationError:
            continue  # the diagnosis says so, with the reason
        step = float(time[-1] - time[0]) / (len(time) - 1)
        for clock in e.clocks:
            columns = [e.outputs.index(n) for n in clock.outputs]
            measured = np.column_stack(
                [
                    s.values if (s := signals[n]).own is None else np.interp(time, s.own.time, s.own.values)
                    for n in clock.outputs
                ]
            )
            shift, left, unshifted = time_shift(step, modelled[:, columns], measured)
            if shift and left <= CLEARLY * unshifted:
                offsets.setdefault(e.name, {})[clock.files] = shift
    return offsets


def with_margin(experiments: Sequence[Experiment], records: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return experiments that leave out the ends of their records, as a clock that moves asks for.

    Parameters
    ----------
    experiments : sequence of Experiment
    records : sequence of Experiment
        All of the study: their preparation stays the same.
    """
    if not any(e.clocks for e in records):
        return tuple(experiments)
    margin = MARGIN * min(e.record.duration for e in records)

    def edge(given: Preparation, rate: float) -> float:
        cutoff = given.cutoff(rate)
        return max(margin, given.edge if given.edge is not None else 0.0 if cutoff is None else edge_time(cutoff))

    widest = max(edge(e.preparation, float(e.record.rate)) for e in records)
    return tuple(replace(e, preparation=replace(e.preparation, edge=widest)) for e in experiments)
