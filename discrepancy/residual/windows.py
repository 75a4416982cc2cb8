"""Windows of a record: short enough that a simulation from a free start cannot run away within one.

How fast a machine runs away is read from exact derivatives: how much a start that is slightly off, or an input that
is slightly wrong, moves the outputs as time goes on.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.residual.initial_state import Followed
from estimation.files.record import Record
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation
from estimation.signals.preparation import Preparation

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = [
    "FACTOR",
    "LEAST_SAMPLES",
    "NOISE_FACTOR",
    "WINDOW_FACTOR",
    "Growth",
    "crop",
    "cut_windows",
    "divergence_time",
    "growth_from",
]

FACTOR = 30.0
"""A machine whose start or input is 1 % off, and whose outputs are then off by 30 % of their spread, runs away."""
WINDOW_FACTOR = 6.0
"""Within a window errors may grow less far: the scan is linear, and on a tumbling arm windows with a factor of 12 or 30
ended beside the true friction, those with 5 found it."""
NOISE_FACTOR = 10.0
"""An input whose mere noise adds up to ten times an output's noise makes a simulation of the whole record worthless."""
WINDOW_NOISE = 3.0
LEAST_SAMPLES = 20
_STARTS = 6
_RECORDS = 3
_LONGEST = 3.0
_DRAWS = 4


@dataclass(frozen=True, eq=False)
class Growth:
    """How errors grow along a record, from one instant on.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Since that instant.
    start : ndarray, shape (n,)
        Largest relative change of an output for a relative change of the start, over its value in the first samples.
    inputs : ndarray, shape (n,)
        Largest relative change of an output for a relative change of an input.
    input_name, output_name : str
        The pair with the largest such change.
    input_change : float
        What 1 % of that input moves that output by at most, in the output's unit.
    noise : ndarray, shape (n,)
        Largest deviation so far that the noise of the inputs brings about, over the noise of the output.
    noisy : tuple of (str, str, float)
        Input and output with the largest such deviation, and its size in the output's unit.
    """

    time: np.ndarray
    start: np.ndarray
    inputs: np.ndarray
    input_name: str = ""
    output_name: str = ""
    input_change: float = 0.0
    noise: np.ndarray = field(default_factory=lambda: np.zeros(0))
    noisy: tuple[str, str, float] = ("", "", 0.0)

    @property
    def within(self) -> float:
        """Time within which errors stay below `FACTOR` and `NOISE_FACTOR`, s; infinite when they do to the end."""
        return self.until(FACTOR, NOISE_FACTOR)

    def until(self, factor: float, noise: float) -> float:
        """Return the time at which errors have grown by a factor, or noise has added up, s; infinite when never."""
        beyond = self.start > factor
        if keeps_growing(self.inputs):
            beyond = beyond | (self.inputs > factor)
        if self.noise.size and keeps_growing(self.noise):
            beyond = beyond | (self.noise > noise)
        return float(self.time[np.argmax(beyond)]) if np.any(beyond) else float("inf")


def keeps_growing(influence: np.ndarray) -> bool:
    """Tell whether an influence grows to the end: one that settles is only a gain."""
    half = influence.size // 2
    return bool(np.max(influence[half:], initial=0.0) > 1.5 * np.max(influence[:half], initial=0.0))


def crop(experiment: Experiment) -> Experiment:
    """Return the experiment with its record cut to the window of its preparation."""
    given, time = experiment.preparation, experiment.record.time
    if given.start is None and given.stop is None:
        return experiment
    slack = 1e-6 * float(np.median(np.diff(time)))
    low = int(np.searchsorted(time, (time[0] if given.start is None else given.start) - slack))
    high = int(np.searchsorted(time, (time[-1] if given.stop is None else given.stop) + slack))
    record = sub_record(experiment.record, slice(low, high), experiment.record.name)
    return replace(experiment, record=record, preparation=replace(given, start=None, stop=None))


def sub_record(record: Record, part: slice, name: str) -> Record:
    """Return a part of a record under a name of its own."""
    time = record.time[part]
    signals = {k: replace(s, values=s.values[part]) for k, s in record.signals.items()}
    return Record(
        name, record.path, time, signals, (*record.log, f"samples {part.start} to {part.stop}"), record.warnings
    )


def growth_from(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    followed: Followed,
    first: int,
    spread: np.ndarray,
    scale: np.ndarray,
    last: int | None = None,
) -> Growth:
    """Return how errors grow from a sample of a record to its end, or as far as the simulation gets.

    Parameters
    ----------
    experiment : Experiment
        Cropped.
    system : System
        With the measured outputs.
    p : ndarray, shape (n_p,)
    followed : Followed
        States along the record.
    first : int
        Sample to begin at.
    spread, scale : ndarray, shapes (n_channels,) and (n,)
        Spread of the outputs and of the states: what 100 % is.
    last : int, optional
        Sample to stop before; default: the record's end.
    """
    from multibody.base.errors import SimulationError

    states = [n for n in system.state_names if not n.startswith("energy.")]
    pick = [system.index("state", n) for n in states]
    last = len(experiment.record.time) if last is None else last
    while True:
        record = sub_record(experiment.record, slice(first, last), experiment.record.name)
        part = replace(experiment, record=record, preparation=Preparation())
        values = [np.array(record.signals[n].values) for n in experiment.inputs]
        perturbations = [InputPerturbation(n, v) for n, v in zip(experiment.inputs, values, strict=True)]
        rng = np.random.default_rng(first)  # the same noise wherever one looks from the same sample
        perturbations += [
            InputPerturbation(n, s * rng.standard_normal(last - first))
            for _ in range(_DRAWS)
            for n, s in zip(experiment.inputs, followed.input_noise, strict=True)
        ]
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                found = part.respond(
                    system, p, followed.at(first), states=states, perturbations=perturbations
                ).derivatives
            break
        except SimulationError:
            last = first + (last - first) // 2
            if last - first < LEAST_SAMPLES:
                time = experiment.record.time[first : first + 2] - experiment.record.time[first]
                return Growth(time, np.full(time.size, np.inf), np.zeros(time.size))
    with np.errstate(over="ignore", invalid="ignore"):
        by_start = found[:, :, : len(states)] * scale[pick] / spread[:, None]
        by_start = np.nan_to_num(np.sqrt(np.sum(by_start**2, axis=2)), nan=np.inf, posinf=np.inf)
        n_s, n_i = len(states), len(experiment.inputs)
        by_input = np.nan_to_num(np.abs(found[:, :, n_s : n_s + n_i]) / spread[:, None], nan=np.inf, posinf=np.inf)
        by_noise = found[:, :, n_s + n_i :].reshape(*found.shape[:2], _DRAWS, n_i)
        by_noise = np.sqrt(np.mean(by_noise**2, axis=2)) / followed.reading.noise[:, None]
        by_noise = np.maximum.accumulate(np.nan_to_num(by_noise, nan=np.inf, posinf=np.inf), axis=0)
    early = np.maximum(
        np.max(by_start[:LEAST_SAMPLES], axis=0, where=np.isfinite(by_start[:LEAST_SAMPLES]), initial=0.0), 1.0
    )
    time = record.time - record.time[0]
    if not experiment.inputs:
        return Growth(time, np.max(by_start / early, axis=1), np.zeros(time.size))
    d, j = np.unravel_index(int(np.argmax(by_noise[-1])), by_noise[-1].shape)
    noisy = (experiment.inputs[j], experiment.outputs[d], float(by_noise[-1, d, j] * followed.reading.noise[d]))
    peak = np.max(by_input, axis=0)
    c, i = np.unravel_index(int(np.argmax(peak)), peak.shape)
    return Growth(
        time,
        np.max(by_start / early, axis=1),
        np.max(by_input, axis=(1, 2)),
        experiment.inputs[i],
        experiment.outputs[c],
        0.01 * float(peak[c, i] * spread[c]),
        np.max(by_noise, axis=(1, 2)),
        noisy,
    )


def divergence_time(
    experiments: Sequence[Experiment],
    system: System,
    p: np.ndarray,
    followed: Sequence[Followed],
    spread: np.ndarray,
    scale: np.ndarray,
) -> float:
    """Return the time within which errors stay below `WINDOW_FACTOR` from most starts of the records, s.

    A machine runs away faster from some states than from others (a pendulum that stands, one that hangs); the lower
    quartile over starts spread over the longest records is taken, because a window that is somewhat too long in one
    place is mended by its free start, while short windows everywhere would blind the study to slow effects.
    """
    order = np.argsort([-e.record.duration for e in experiments], kind="stable")[:_RECORDS]
    found = []
    for i in order:
        n = len(experiments[i].record.time)
        for first in np.linspace(0, n, _STARTS, endpoint=False).astype(int):
            if n - first < 2 * LEAST_SAMPLES:
                continue
            growth = growth_from(experiments[i], system, p, followed[i], int(first), spread, scale)
            reach = growth.until(WINDOW_FACTOR, WINDOW_NOISE)
            if np.isfinite(reach) or first == 0:
                found.append(min(reach, experiments[i].record.duration))
    return float(np.quantile(found, 0.25)) if found else 0.0


def samples_needed(preparation: Preparation, rate: float) -> int:
    """Return how many raw samples a window needs so that enough prepared ones are left."""
    return LEAST_SAMPLES * preparation.decimate + 2 * preparation.edge_samples(rate)


def cut_windows(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    followed: Followed,
    length: float,
    spread: np.ndarray,
    scale: np.ndarray,
) -> list[Experiment]:
    """Return an experiment as experiments on windows, each with a start of its own.

    Each window ends where errors of its own start have grown too far, so that windows are short where the machine
    is wild and long where it is calm; never shorter than `samples_needed`, nor longer than three times ``length``.

    Parameters
    ----------
    experiment : Experiment
        Cropped.
    system : System
    p : ndarray, shape (n_p,)
    followed : Followed
        States along the record: where the fit of each start begins.
    length : float, s
        Usual length.
    spread, scale : ndarray
        As in `growth_from`.
    """
    record = experiment.record
    n, rate = len(record.time), record.rate
    least = samples_needed(experiment.preparation, rate)
    most = max(least, int(_LONGEST * length * rate))
    bounds = [0]
    while n - 1 - bounds[-1] > least:
        last = min(bounds[-1] + most, n - 1)
        growth = growth_from(experiment, system, p, followed, bounds[-1], spread, scale, last + 1)
        reach = min(growth.until(WINDOW_FACTOR, WINDOW_NOISE), float(growth.time[-1]))
        bounds.append(int(np.clip(bounds[-1] + reach * rate, bounds[-1] + least, last)))
    if len(bounds) > 1 and n - 1 - bounds[-1] < least:
        bounds.pop()  # what is left is too short for a window of its own
    bounds.append(n - 1)
    everything = tuple(s for s in system.state_names if not s.startswith("energy."))
    noise = dict(zip(experiment.inputs, followed.input_noise, strict=True))
    found = []
    for k, (a, b) in enumerate(itertools.pairwise(bounds)):
        name = f"{record.name} [{record.time[a]:.4g}..{record.time[b]:.4g} s]" if len(bounds) > 2 else record.name
        x = followed.at(a)
        if k == 0:
            free = experiment.free
            start = {**experiment.start, **{s: float(x[system.index("state", s)]) for s in free}}
        else:
            free = everything
            start = {s: float(v) for s, v in zip(system.state_names, x, strict=True)}
        part = sub_record(record, slice(a, b + 1), name)
        found.append(replace(experiment, record=part, start=start, free=free, input_noise=noise))
    return found
