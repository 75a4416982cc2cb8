"""The noise model that explains a residual best: which processes are offered, and their price."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.linearised_records import noise_floor, steady_reach, what_may_act
from discrepancy.evidence.standstill import places_that_stick
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import PROCESS_PRICE, RecordColumns, fit_noise, likeliest_change
from discrepancy.innovations.noise_model import InnovationWeighting, NoiseModel, Process, innovation_weighting
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from multibody.base.parallel import parallel_map

__all__ = ["REGAINED", "FittedNoise", "fitted_noise", "log_price"]

#: Memories of latent processes: so many, from two samples to a third of a record, evenly in their logarithm.
MEMORIES = 4
#: Frequencies of processes that swing: from so many cycles in a record, each twice the last, to so many samples in a
#: cycle, the fewest there are: a speed made of differences of a quantised position, and what a sampled controller does
#: with noisy measurements, change most from sample to sample.  Their memory begins with one cycle: so wide a band that
#: the next frequency overlaps it.
CYCLES, SAMPLES_OF_A_CYCLE = 3.0, 2.0
#: Least white noise of an output, over its stated noise: a stated noise may be on the safe side.
LEAST_NOISE = 0.3
#: Share of the log evidence lost without the latent processes that what stands in their place must regain: more than
#: half, else it leaves most of what they do, and the noise beside it is much as before.
REGAINED = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedNoise:
    """The noise model that explains a residual best beside the calibration.

    Parameters
    ----------
    model : NoiseModel
    log_likelihood : float
        Restricted: every linear unknown is integrated out.
    records : tuple of LinearRecord
    change : ndarray, shape (k,)
        By which the shared parameters differ from the linearisation's at the largest likelihood.
    """

    model: NoiseModel
    log_likelihood: float
    records: tuple[LinearRecord, ...]
    change: np.ndarray

    def weighting(self) -> tuple[InnovationWeighting, ...]:
        """Return the whitening of each record."""
        return tuple(parallel_map(lambda r: innovation_weighting(r, self.model), self.records))


def fitted_noise(
    linearised: LinearisedProblem,
    records: Sequence[LinearRecord],
    columns: Sequence[RecordColumns],
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    start: NoiseModel | None,
    *,
    grow: bool = True,
    reduce: bool = True,
) -> FittedNoise:
    """Return the noise model of a residual; ``start`` is that of a neighbouring model.

    ``grow`` and ``reduce`` tell whether processes may be added to it and taken out.
    """
    noise = noise_floor(linearised)
    candidates = _candidates(linearised, records, noise) if grow else []
    floor = LEAST_NOISE * noise
    price = _price_of_a_process(linearised)
    model, value = fit_noise(
        columns, prior_std, prior_offset, floor, candidates, start=start, price=price, grow=grow, reduce=reduce
    )
    change = likeliest_change(columns, model, prior_std, prior_offset)
    return FittedNoise(model=model, log_likelihood=value, records=tuple(records), change=change)


def log_price(linearised: LinearisedProblem, model: NoiseModel) -> float:
    """Return what the latent processes of a noise model cost in the log evidence: zero, or negative.

    Each pays what it had to earn: for its size and memory, which are maximised over and not integrated out, and for its
    name, which is one among all that are offered, as an effect does.  The size of an error of an output has a prior
    besides, a Cauchy density whose scale is the stated noise of that output: an error that is many times as large,
    however slowly it changes, is no noise that the owner of the sensor knows of.
    """
    price = _price_of_a_process(linearised) * len(model.processes)
    for process in model.processes:
        if process.channel >= 0:
            stated = max(linearised.noise.get(process.where, 0.0), 1e-300)
            price += float(np.log1p((process.std / stated) ** 2))
    return -price


def _price_of_a_process(linearised: LinearisedProblem) -> float:
    """Return the nats by which a latent process must raise the likelihood; those at a standstill are not counted."""
    acting = what_may_act(linearised)
    octaves = _frequencies(linearised).size
    forces, outputs = len(acting.connections) + len(acting.states), len(linearised.residual().channels)
    offered = forces * (2 * MEMORIES + octaves) + outputs * (MEMORIES + octaves) + len(acting.inputs)
    return PROCESS_PRICE + float(np.log(offered))


def _candidates(linearised: LinearisedProblem, records: Sequence[LinearRecord], noise: np.ndarray) -> list[Process]:
    """Return the latent processes that may be part of the noise model, each of a size that shows."""
    longest, step = _length_and_step(linearised)
    memories = np.geomspace(2.0 * step, max(longest / 3.0, 4.0 * step), MEMORIES)
    places, inputs, states = what_may_act(linearised)
    sources = [*places, *inputs, *states]
    sticking = places_that_stick(linearised)
    shows = steady_reach(records, noise)
    frequencies = _frequencies(linearised)
    candidates: list[Process] = []
    # the noise of a recorded input is white
    acting = [(j, where, memories[:1] if where in inputs else memories) for j, where in enumerate(sources)]
    acting += [(len(sources) + j, places[j], memories) for j in sticking]
    for j, where, own in acting:
        if shows[j] > 0.0:
            still = j >= len(sources)
            slow = Process(
                where=where,
                source=j,
                channel=-1,
                memory=1.0,
                std=float(1.0 / shows[j]),
                at_standstill=still,
                in_rate=where in states,
            )
            candidates += _with_spectra(slow, own, () if still else frequencies)
            if not still and where not in inputs:
                candidates += [replace(slow, memory=float(m), smooth=True) for m in own]
    for c, name in enumerate(linearised.residual().channels):
        slow = Process(where=name, source=-1, channel=c, memory=1.0, std=float(noise[c]))
        candidates += _with_spectra(slow, memories[1:], frequencies)
    return candidates


def _length_and_step(linearised: LinearisedProblem) -> tuple[float, float]:
    """Return the duration of a usual record, and the time between two of its samples, s."""
    times = [e.time for e in linearised.experiments]
    step = np.median(np.concatenate([np.diff(t) for t in times]))
    return float(np.median([t[-1] - t[0] for t in times])), float(step)


def _frequencies(linearised: LinearisedProblem) -> np.ndarray:
    """Return the frequencies of the processes that swing, Hz."""
    longest, step = _length_and_step(linearised)
    octaves = max(int(np.log2(max(longest / (SAMPLES_OF_A_CYCLE * step * CYCLES), 0.5))) + 1, 0)
    frequencies: np.ndarray = CYCLES / longest * 2.0 ** np.arange(octaves)
    return frequencies


def _with_spectra(process: Process, memories: Iterable[float], frequencies: Iterable[float]) -> list[Process]:
    """Return a process with each memory, and swinging with each frequency."""
    return [
        *(replace(process, memory=float(m)) for m in memories),
        *(replace(process, memory=float(1.0 / f), frequency=float(f)) for f in frequencies),
    ]
