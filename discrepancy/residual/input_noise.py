"""Noise of recorded inputs: how much it changes the outputs, the low-pass that removes it, and weights for the rest.

A recorded input is a sensor.  Its noise drives a simulation as a real force would and reaches every output through the
machine's own resonances.  Worse, a gain that is too small reduces the noise together with a part of the signal, and an
effect with the signal's form then compensates for the lost part: a search that takes the input as exact reports both.

Above twice the frequency at which anything stands out of its spectrum, an input holds noise, or a real excitation.  The
records tell which: noise excites the simulation and not the machine.  A low-pass removes such noise; what lies below
has the same density, stays, and is weighted down in the scan (`input_noise_weighting`).

In a window the noise accumulates to a smooth deviation that a curve with a few points can follow, and that no
resampling of such deviations resembles.  Its covariance is known, though: the input's noise, propagated by the exact
linearisation.  Residual and sensitivities are multiplied by the inverse square root of (output noise + that), relative
to the output noise; the result is white.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.residual.signal_bandwidth import signal_bandwidth
from discrepancy.statistics.hat_functions import even_hat_functions
from discrepancy.statistics.low_rank_weighting import LowRankWeighting, low_rank_weighting
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation
from estimation.signals.correlation import correlation_time
from estimation.signals.preparation import SignalError, low_pass
from multibody.base.parallel import parallel_map
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from estimation.response.sensors import SensorError
    from multibody.machine.model import System

__all__ = ["NoisyInput", "input_noise_weighting", "noise_summary", "reduce_input_noise"]

MATTERS = 0.1
"""Root mean square in an output, over its noise floor, from which the noise of an input is removed.
At that size the likelihood of 6000 samples gains 30 by an input gain that reduces the noise."""
SURELY = 0.5
"""Share of an input above its cutoff that must be noise by two standard deviations."""
NOISE_DRAWS, NOISE_ROUNDS = 4, 2
_KNOTS, _MOST_KNOTS = 40, 400
_KNOTS_PER_PERIOD = 4.0  # of the highest frequency that is weighted


@dataclass(frozen=True, kw_only=True)
class NoisyInput:
    """A recorded input whose noise matters.

    Attributes
    ----------
    input : str
    noise : float
        Standard deviation, in ``input_unit``.
    cutoff : float, Hz
        Above it nothing stands out of the noise.
    low_passed, weighed : bool
        Whether the input is used without the part above the cutoff, and whether the scan weights down the part below.
    output : str
        In which the noise above the cutoff, or where that does not matter the noise below it, has its largest effect.
    made, left : float
        Root mean square effect of the noise there, as recorded and low-passed, in ``output_unit``.
    floor : float
        Noise floor of that output.
    before, after : float
        Root mean square error of that output by the model as given, from the input as recorded and as used.
    held_out : bool
        True if that is on the records held out.
    """

    input: str
    noise: float
    input_unit: str
    cutoff: float
    low_passed: bool
    weighed: bool
    output: str
    made: float
    left: float
    floor: float
    output_unit: str
    before: float
    after: float
    held_out: bool

    @property
    def sentence(self) -> str:
        """The noise, its effect, and what was done."""
        unit, times = self.output_unit, self.made / self.floor
        text = (
            f"The recorded input {self.input} is noisy: {quantity_text(self.noise, self.input_unit)}. This alone "
            f"changes {self.output} by {quantity_text(self.made, unit)}, {times:.2g} times its noise floor."
        )
        if self.low_passed:
            text += (
                f" It is used low-passed at {self.cutoff:.3g} Hz, above which nothing stands out of its noise; "
                f"{quantity_text(self.left, unit)} remain."
            )
        if self.weighed:
            text += f" The scan weights down the effect of its noise below {self.cutoff:.3g} Hz."
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the fields."""
        return asdict(self)


def reduce_input_noise(problem: Problem, progress: Callable[[str], None]) -> tuple[Problem, tuple[NoisyInput, ...]]:
    """Return the problem with noisy inputs low-passed, or marked for weighting, where it matters, and a list of them.

    The part above the cutoff counts as noise where its effect is missing in the recorded outputs (`_noise_share`).
    Inputs that keep their value until the next sample, inputs that are compared as well and uneven sampling are left
    alone.

    Parameters
    ----------
    problem : Problem
        Simulations of whole records.
    progress : callable
        Gets a line of text now and then.
    """
    system = problem.model.build(outputs=problem.identify[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    floors = np.array(list(noise_floors(problem.identify, problem.noise).values()))
    floors = np.maximum(floors, 1e-300)
    all_cutoffs = {n: _cutoff(problem.identify, n) for n in _free_inputs(problem.identify[0])}
    try:
        share = _noise_share(problem, system, p, all_cutoffs)
        noise = {
            n: _noise_of(problem.identify, n, cutoff) * share[n] ** 0.5
            for n, cutoff in all_cutoffs.items()
            if share[n] > 0.0
        }
        made, left = (_made_by_noise(problem, system, p, noise, c) for c in ({}, all_cutoffs))
    except SignalError as error:
        progress(f"the inputs stay as recorded: {error}")
        return problem, ()
    removed = {n: np.sqrt(np.maximum(made[n] ** 2 - left[n] ** 2, 0.0)) / floors for n in noise}
    cutoffs = {n: all_cutoffs[n] for n in noise if np.max(removed[n]) > MATTERS}
    weighted = {n: noise[n] for n in noise if np.max(left[n] / floors) > MATTERS}
    if not cutoffs and not weighted:
        return problem, ()
    progress(f"noise of recorded inputs matters: {', '.join(dict.fromkeys((*cutoffs, *weighted)))}")
    band = max((all_cutoffs[n] for n in weighted), default=0.0)

    def used(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
        quiet = (_low_passed(e, cutoffs) for e in experiments)
        return tuple(replace(e, input_noise=weighted, noise_band=band) for e in quiet)

    quiet = replace(problem, identify=used(problem.identify), validate=used(problem.validate))
    before, after = (_errors(q.validate or q.identify, system, p) for q in (problem, quiet))
    noisy = []
    for n in dict.fromkeys((*cutoffs, *weighted)):
        c = int(np.argmax(removed[n] if n in cutoffs else left[n] / floors))
        output = problem.identify[0].outputs[c]
        noisy.append(
            NoisyInput(
                input=n,
                noise=noise[n],
                input_unit=problem.identify[0].record.signals[n].unit,
                cutoff=all_cutoffs[n],
                low_passed=n in cutoffs,
                weighed=n in weighted,
                output=output,
                made=float(made[n][c]),
                left=float(left[n][c]),
                floor=float(floors[c]),
                output_unit=system.unit(output),
                before=float(before[c]),
                after=float(after[c]),
                held_out=bool(problem.validate),
            )
        )
    return quiet, tuple(noisy)


def noise_summary(noisy: Sequence[NoisyInput]) -> str:
    """Return one sentence on the inputs whose noise was reduced."""
    names = " and ".join(n.input for n in noisy)
    ways = {"removed": any(n.low_passed for n in noisy), "weighted down": any(n.weighed for n in noisy)}
    done = " or ".join(way for way, used in ways.items() if used)
    return (
        f"Noise of the recorded input{'s' * (len(noisy) > 1)} {names} excites the simulation and is no missing effect; "
        f"it was {done}."
    )


def _free_inputs(experiment: Experiment) -> list[str]:
    """Return the inputs that change from sample to sample and are not compared."""
    held, outputs, signals = experiment.held, experiment.outputs, experiment.record.signals
    return [n for n in experiment.inputs if n not in held and n not in outputs and np.ptp(signals[n].values) > 0.0]


def _noise_of(experiments: Sequence[Experiment], name: str, cutoff: float) -> float:
    """Return the standard deviation of the white noise with the energy that an input has above the cutoff, SI."""
    deviations = []
    for e in experiments:
        values = np.asarray(e.record.signals[name].values)
        above = values - low_pass(np.asarray(e.record.time), values, cutoff)
        deviations.append(float(np.std(above)) / (1.0 - 2.0 * cutoff / e.record.rate) ** 0.5)
    return float(np.median(deviations))


def _noise_share(problem: Problem, system: System, p: np.ndarray, cutoffs: Mapping[str, float]) -> dict[str, float]:
    """Return the share of each input's variance above its cutoff that is noise; 0 where that is uncertain.

    Noise excites the simulation and not the machine: the error then is minus its response, and a real excitation leaves
    no such error.  Both are compared above the cutoffs, by least squares over all inputs, free of the parameters and
    each record's own initial state.

    Raises
    ------
    SignalError
        If a record is not sampled evenly.
    """
    names, lowest = list(cutoffs), min(cutoffs.values(), default=0.0)
    if not names:
        return {}
    parameters = [q.name for q in problem.uncertain if not q.name.startswith("sensor.")]

    def above(e: Experiment) -> tuple[np.ndarray, np.ndarray]:
        """Return the error with the sensitivities to inputs and parameters, and those to the initial state.

        All above the cutoff, each of shape (n, n_y, ·).
        """
        time = np.asarray(e.record.time)
        values = [np.asarray(e.record.signals[n].values) for n in names]
        perturbations = [
            InputPerturbation(n, v - low_pass(time, v, cutoffs[n])) for n, v in zip(names, values, strict=True)
        ]
        response = e.respond(system, p, parameters=parameters, states=e.free, perturbations=perturbations)
        stacked = np.concatenate([(e.measured - response.outputs)[:, :, None], response.derivatives], axis=2)
        flat = stacked.reshape(len(stacked), -1)
        high = (flat - low_pass(e.time, flat, lowest)).reshape(stacked.shape)
        first, last = 1 + len(parameters), 1 + len(parameters) + len(e.free)
        shared = [high[:, :, :1], high[:, :, last:], high[:, :, 1:first]]
        return np.concatenate(shared, axis=2), high[:, :, first:last]

    records = parallel_map(above, problem.identify)
    scale = np.sqrt(np.mean(np.concatenate([shared[:, :, 0] for shared, _ in records]) ** 2, axis=0))
    for _ in range(NOISE_ROUNDS):  # each output is weighted by its remaining error
        scale = np.maximum(scale, 1e-300)
        free = [_without_own(shared / scale[:, None], own / scale[:, None]) for shared, own in records]
        whole = np.concatenate(free).reshape(-1, free[0].shape[2])
        size = np.linalg.norm(whole[:, 1:], axis=0)
        unit = whole[:, 1:] / np.where(size > 0.0, size, 1.0)
        solved = np.linalg.lstsq(unit, whole[:, 0], rcond=None)[0]
        left = (whole[:, 0] - unit @ solved).reshape(-1, scale.size)
        scale = scale * np.sqrt(np.mean(left**2, axis=0))
    lengths = np.cumsum([len(shared) for shared, _ in records])[:-1]
    memory = max(correlation_time(c) for part in np.split(left, lengths) for c in part.T)
    variance = np.mean(left**2) * memory * np.diag(np.linalg.pinv(unit.T @ unit))
    spread = np.sqrt(np.where(variance > 0.0, variance, np.inf))  # below zero by rounding: the records cannot show it
    share = {}
    for k, name in enumerate(names):
        felt, std = (-solved[k] / size[k], spread[k] / size[k]) if size[k] > 0.0 else (0.0, np.inf)
        share[name] = float(np.clip(felt, 0.0, 1.0)) if felt - 2.0 * std > SURELY else 0.0
    return share


def _without_own(block: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return a block, shape (n, n_y, k), without what its record's own unknowns (n, n_y, q) can make."""
    flat, basis = block.reshape(-1, block.shape[2]), own.reshape(len(block) * block.shape[1], own.shape[2])
    size = np.linalg.norm(basis, axis=0)
    basis = basis[:, size > 0.0] / size[size > 0.0]
    return np.asarray((flat - basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]).reshape(block.shape))


def _made_by_noise(
    problem: Problem, system: System, p: np.ndarray, noise: Mapping[str, float], cutoffs: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the root mean square effect of the inputs' noise on every output of the longest record, low-passed or not.

    The same seed draws the same noise.

    Raises
    ------
    SignalError
        If a cutoff is given and the record is not sampled evenly.
    """
    if not noise:
        return {}
    longest = max(problem.identify, key=lambda e: e.record.duration)
    rng = np.random.default_rng(problem.seed)
    time = np.asarray(longest.record.time)
    perturbations = []
    for n, s in noise.items():
        for _ in range(NOISE_DRAWS):
            drawn = s * rng.standard_normal(time.size)
            perturbations.append(InputPerturbation(n, low_pass(time, drawn, cutoffs[n]) if n in cutoffs else drawn))
    responses = longest.respond(system, p, perturbations=perturbations).derivatives
    squares = np.mean(responses**2, axis=0).reshape(responses.shape[1], len(noise), NOISE_DRAWS)
    made = np.sqrt(np.mean(squares, axis=2))
    return {n: made[:, k] for k, n in enumerate(noise)}


def _cutoff(experiments: Sequence[Experiment], name: str) -> float:
    """Return twice the highest frequency at which an input stands out of its noise in any record, Hz.

    At half its cutoff the low-pass lets 99.6 % through.
    """
    return 2.0 * max(signal_bandwidth(np.asarray(e.record.time), e.record.signals[name].values) for e in experiments)


def _low_passed(experiment: Experiment, cutoffs: Mapping[str, float]) -> Experiment:
    record = experiment.record
    time, signals = np.asarray(record.time), dict(record.signals)
    log = []
    for name, cutoff in cutoffs.items():
        signals[name] = replace(signals[name], values=low_pass(time, np.asarray(signals[name].values), cutoff))
        log.append(f"{name}: low-pass at {cutoff:.4g} Hz (Butterworth, zero phase), because of its noise")
    return replace(experiment, record=replace(record, signals=signals, log=(*record.log, *log)))


def _errors(experiments: Sequence[Experiment], system: System, p: np.ndarray) -> np.ndarray:
    """Return the root mean square error of every output over all records."""
    squares = [(e.measured - e.simulate(system, p)) ** 2 for e in experiments]
    return np.asarray(np.sqrt(np.mean(np.concatenate(squares), axis=0)))


def input_noise_weighting(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    x0: np.ndarray,
    noise: np.ndarray,
    sensors: Sequence[SensorError] = (),
) -> LowRankWeighting:
    """Return the weights of an experiment's residual, from ``experiment.input_noise``.

    Parameters
    ----------
    experiment : Experiment
    system : System
        With the measured outputs.
    p, x0 : ndarray
        Parameters and start.
    noise : ndarray, shape (n_channels,)
        Noise of the outputs as they are compared, SI.
    sensors : sequence of SensorError
    """
    none = LowRankWeighting(noise, np.zeros((0, 0)), np.zeros(0))
    time = np.array(experiment.record.time)
    noisy = {n: s for n, s in experiment.input_noise.items() if s > 0.0}
    if not noisy or time.size < 4 or not np.all(noise > 0.0):
        return none
    wanted = max(_KNOTS, math.ceil(_KNOTS_PER_PERIOD * experiment.noise_band * float(time[-1] - time[0])))
    knots = min(wanted, _MOST_KNOTS, time.size // 2)
    hats = even_hat_functions((time - time[0]) / (time[-1] - time[0]) * (knots - 1), knots)
    # White noise of deviation s at the sampling rate has the same low-frequency density as hats of this deviation.
    share = np.sqrt((knots - 1) / (time.size - 1))
    perturbations = [InputPerturbation(n, s * share * hats[:, k]) for n, s in noisy.items() for k in range(knots)]
    responses = experiment.respond(system, p, x0, perturbations=perturbations, sensors=sensors).derivatives
    return low_rank_weighting(responses, noise)
