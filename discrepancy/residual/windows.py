"""Windows of a record, short enough that a simulation from a free initial state cannot diverge within one.

How fast a simulation diverges follows from exact derivatives: how much a small error of the initial state or of an
input changes the outputs as time goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from discrepancy.residual.initial_state import StateEstimate
from estimation.files.record import Record
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation
from estimation.signals.preparation import Preparation
from multibody.base.errors import SimulationError

__all__ = [
    "DIVERGENCE_FACTOR",
    "LEAST_SAMPLES",
    "MOST_UNKNOWNS",
    "NOISE_FACTOR",
    "WINDOW_FACTOR",
    "ErrorGrowth",
    "crop",
    "cut_windows",
    "divergence_time",
    "error_growth",
    "keeps_growing",
    "samples_needed",
    "window",
]

DIVERGENCE_FACTOR = 30.0
"""A simulation diverges when 1 % error of the initial state or an input becomes 30 % of an output's spread."""
WINDOW_FACTOR = 6.0
"""Within a window errors may grow less far: the scan is linear, and on a tumbling arm windows with a factor of 12 or 30
missed the true friction, those with 5 found it."""
MOST_TRANSIENT = 100.0
"""An error of the initial state that is forgotten later may be this much larger for a while: there, 1 % of the initial
state is as large as the spread of an output, and no simulation follows from then on."""
NOISE_FACTOR = 10.0
"""A simulation of the whole record is useless when the noise of an input alone reaches ten times an output's noise."""
END = 10
"""Part of a record, the tenth, that is its end."""
WINDOW_NOISE = 3.0
LEAST_SAMPLES = 20
MOST_UNKNOWNS = 2000
"""Initial states of all windows together, about: a fit solves for all of them at once, which takes the cube of their
number.  With the shortest windows, 20 000 rows of a machine of two states have as many, and 4000 of one of ten."""
_STARTS = 6
_RECORDS = 3
_LONGEST = 3.0
_DRAWS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class ErrorGrowth:
    """How errors grow along a record from one instant on.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Since that instant.
    start : ndarray, shape (n,)
        Largest relative change of an output for a relative change of the initial state, over its value in the first
        samples.
    inputs : ndarray, shape (n,)
        Largest relative change of an output for a relative change of an input.
    input_name, output_name : str
        The pair with the largest such change.
    input_change : float
        Largest change of that output by 1 % of that input, in the output's unit.
    noise : ndarray, shape (n,)
        Largest deviation so far caused by the noise of the inputs, over the noise of the output.
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
        """Time at which errors exceed `DIVERGENCE_FACTOR` or `NOISE_FACTOR`, s; infinite if never."""
        return self.until(DIVERGENCE_FACTOR, NOISE_FACTOR)

    @property
    def is_forgotten(self) -> bool:
        """True where an error of the initial state is a transient: it stays bounded, and has died out at the end.

        When in the record that happens says nothing: dry friction keeps an error until the machine first moves.
        """
        end = self.start[-max(self.start.size // END, 1) :]
        return bool(np.max(self.start, initial=0.0) < MOST_TRANSIENT and np.max(end, initial=0.0) < 1.0)

    def until(self, factor: float, noise: float) -> float:
        """Return the time at which errors exceed a factor, or noise exceeds its own, s; infinite if never."""
        exceeded = (self.start > factor) & (not self.is_forgotten)
        if keeps_growing(self.inputs):
            exceeded = exceeded | (self.inputs > factor)
        if self.noise.size and keeps_growing(self.noise):
            exceeded = exceeded | (self.noise > noise)
        return float(self.time[np.argmax(exceeded)]) if np.any(exceeded) else float("inf")


def keeps_growing(influence: np.ndarray) -> bool:
    """Tell whether an influence grows to the end; one that settles is only a gain."""
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
    """Return a part of a record under another name."""
    time = record.time[part]
    signals = {k: replace(s, values=s.values[part]) for k, s in record.signals.items()}
    return Record(
        name=name,
        path=record.path,
        time=time,
        signals=signals,
        log=(*record.log, f"samples {part.start} to {part.stop}"),
        warnings=record.warnings,
    )


def error_growth(
    states: StateEstimate, spread: np.ndarray, scale: np.ndarray, first: int = 0, last: int | None = None
) -> ErrorGrowth:
    """Return how errors grow from a sample of a record to its end, or as far as the simulation gets.

    Parameters
    ----------
    states : StateEstimate
        Along the record.
    spread, scale : ndarray, shapes (n_channels,) and (n,)
        Spread of the outputs and of the states: what 100 % is.
    first : int
        Sample to begin at.
    last : int, optional
        Sample to stop before; default: the record's end.
    """
    experiment, system = states.experiment, states.system
    names = [n for n in system.state_names if not n.startswith("energy.")]
    pick = [system.index("state", n) for n in names]
    last = len(experiment.record.time) if last is None else last
    while True:
        record = sub_record(experiment.record, slice(first, last), experiment.record.name)
        part = replace(experiment, record=record, preparation=Preparation())
        values = [np.array(record.signals[n].values) for n in experiment.inputs]
        perturbations = [InputPerturbation(n, v) for n, v in zip(experiment.inputs, values, strict=True)]
        rng = np.random.default_rng(first)  # the same noise for the same first sample
        perturbations += [
            InputPerturbation(n, s * rng.standard_normal(last - first))
            for _ in range(_DRAWS)
            for n, s in zip(experiment.inputs, states.input_noise, strict=True)
        ]
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                start = states.states[first]
                changed = part.respond(system, states.p, start, states=names, perturbations=perturbations).derivatives
            break
        except SimulationError:
            last = first + (last - first) // 2
            if last - first < LEAST_SAMPLES:
                time = experiment.record.time[first : first + 2] - experiment.record.time[first]
                return ErrorGrowth(time=time, start=np.full(time.size, np.inf), inputs=np.zeros(time.size))
    with np.errstate(over="ignore", invalid="ignore"):
        by_start = changed[:, :, : len(names)] * scale[pick] / spread[:, None]
        by_start = np.nan_to_num(np.sqrt(np.sum(by_start**2, axis=2)), nan=np.inf, posinf=np.inf)
        n_s, n_i = len(names), len(experiment.inputs)
        by_input = np.nan_to_num(np.abs(changed[:, :, n_s : n_s + n_i]) / spread[:, None], nan=np.inf, posinf=np.inf)
        by_noise = changed[:, :, n_s + n_i :].reshape(*changed.shape[:2], _DRAWS, n_i)
        by_noise = np.sqrt(np.mean(by_noise**2, axis=2)) / states.reading.noise[:, None]
        by_noise = np.maximum.accumulate(np.nan_to_num(by_noise, nan=np.inf, posinf=np.inf), axis=0)
    early = np.maximum(
        np.max(by_start[:LEAST_SAMPLES], axis=0, where=np.isfinite(by_start[:LEAST_SAMPLES]), initial=0.0), 1.0
    )
    time = record.time - record.time[0]
    if not experiment.inputs:
        return ErrorGrowth(time=time, start=np.max(by_start / early, axis=1), inputs=np.zeros(time.size))
    d, j = np.unravel_index(int(np.argmax(by_noise[-1])), by_noise[-1].shape)
    noisy = (experiment.inputs[j], experiment.outputs[d], float(by_noise[-1, d, j] * states.reading.noise[d]))
    peak = np.max(by_input, axis=0)
    c, i = np.unravel_index(int(np.argmax(peak)), peak.shape)
    return ErrorGrowth(
        time=time,
        start=np.max(by_start / early, axis=1),
        inputs=np.max(by_input, axis=(1, 2)),
        input_name=experiment.inputs[i],
        output_name=experiment.outputs[c],
        input_change=0.01 * float(peak[c, i] * spread[c]),
        noise=np.max(by_noise, axis=(1, 2)),
        noisy=noisy,
    )


def divergence_time(estimates: Sequence[StateEstimate], spread: np.ndarray, scale: np.ndarray) -> float:
    """Return the time within which errors stay below `WINDOW_FACTOR` from most starts of the records, s.

    Errors grow faster from some states than from others (a pendulum that stands, one that hangs).  The lower quartile
    over starts spread over the longest records is taken: the free initial state of a window corrects one that is
    somewhat too long, while short windows everywhere would blind the study to slow effects.
    """
    order = np.argsort([-e.experiment.record.duration for e in estimates], kind="stable")[:_RECORDS]
    times = []
    for states in (estimates[i] for i in order):
        record = states.experiment.record
        n = len(record.time)
        for first in np.linspace(0, n, _STARTS, endpoint=False).astype(int):
            if n - first < 2 * LEAST_SAMPLES:
                continue
            growth = error_growth(states, spread, scale, int(first))
            reach = growth.until(WINDOW_FACTOR, WINDOW_NOISE)
            if np.isfinite(reach) or first == 0:
                times.append(min(reach, record.duration))
    return float(np.quantile(times, 0.25)) if times else 0.0


def samples_needed(preparation: Preparation, rate: float) -> int:
    """Return how many raw samples a window needs so that enough prepared ones are left."""
    return LEAST_SAMPLES * preparation.decimate + 2 * preparation.edge_samples(rate)


def cut_windows(
    states: StateEstimate, length: float, spread: np.ndarray, scale: np.ndarray, every: int = 1
) -> list[Experiment]:
    """Return the experiment of a record as experiments on windows, each with an initial state of its own.

    Each window ends where errors of its initial state have grown too far, so windows are short where errors grow fast
    and long where they do not; never shorter than `samples_needed`, nor longer than three times ``length``.

    Parameters
    ----------
    states : StateEstimate
        Along the record: where the fit of each initial state begins.
    length : float, s
        Usual length.
    spread, scale : ndarray
        As in `error_growth`.
    every : int
        Keep one window, and leave out the time of ``every - 1`` as long ones behind it.
    """
    experiment = states.experiment
    record = experiment.record
    n, rate = len(record.time), record.rate
    least = samples_needed(experiment.preparation, rate)
    most = max(least, int(_LONGEST * length * rate))
    parts: list[slice] = []
    first = 0
    while n - 1 - first > least:
        last = min(first + most, n - 1)
        growth = error_growth(states, spread, scale, first, last + 1)
        reach = min(growth.until(WINDOW_FACTOR, WINDOW_NOISE), float(growth.time[-1]))
        end = int(np.clip(first + reach * rate, first + least, last))
        parts.append(slice(first, end + 1))
        first = end + (every - 1) * (end - first)
    if not parts or n - 1 - first == least:
        parts.append(slice(first, n))
    elif every == 1:
        parts[-1] = slice(parts[-1].start, n)  # the remainder is too short for a window
    noise = dict(zip(experiment.inputs, states.input_noise, strict=True))
    return [replace(window(states, part, named=len(parts) > 1), input_noise=noise) for part in parts]


def window(states: StateEstimate, rows: slice, *, named: bool) -> Experiment:
    """Return the experiment of some rows of a record, with an initial state of its own unless they are the first.

    Parameters
    ----------
    states : StateEstimate
        Along the record.
    rows : slice
    named : bool
        Whether the name says which part of the record it is.
    """
    experiment, system = states.experiment, states.system
    record, x = experiment.record, states.at(rows.start)
    name = f"{record.name} [{record.time[rows][0]:.4g}..{record.time[rows][-1]:.4g} s]" if named else record.name
    start: dict[str, float | Literal["measured"]]
    if rows.start == 0:
        free = experiment.free
        start = {**experiment.start, **{s: float(x[system.index("state", s)]) for s in free}}
    else:
        free = tuple(s for s in system.state_names if not s.startswith("energy."))
        start = {s: float(v) for s, v in zip(system.state_names, x, strict=True)}
    return replace(experiment, record=sub_record(record, rows, name), start=start, free=free)
