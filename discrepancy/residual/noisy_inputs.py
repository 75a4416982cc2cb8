"""Recorded inputs whose noise shakes the model: how much they do, what takes it out of them, and the rest weighed down.

A recorded input is a sensor.  Its noise drives a simulation as a real force would and comes out at every output with
the machine's own resonances.  What is worse, a gain that is too small takes the noise away together with a part of the
signal, and an effect of the signal's shape then stands in for what is lost: a search that takes the input for exact
names both.

Above twice the frequency at which anything stands out of an input's spectrum it has noise, or what the machine really
felt.  The records tell which: what was not felt is in the simulation and lacks in the outputs.  A low-pass takes such
noise away; what lies below is as large again for each hertz, stays, and is weighed down in the scan
(`discrepancy.residual.input_noise`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.residual.initial_state import signal_bandwidth
from estimation.response.perturbations import InputPerturbation
from estimation.signals.correlation import correlation_time
from estimation.signals.preparation import SignalError, low_pass
from multibody.base.parallel import side_by_side
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["NoisyInput", "noise_summary", "reduce_input_noise"]

MATTERS = 0.1
"""Root mean square in an output, over its noise floor, from which it is worth while to take it out of an input.
At that size the likelihood of 6000 samples gains 30 by an input gain that takes the noise away."""
SURELY = 0.5
"""Share of what an input has above its cutoff that must be noise by two standard deviations."""
DRAWS, ROUNDS = 4, 2


@dataclass(frozen=True)
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
        Whether the input is used without what is above the cutoff, and whether the scan weighs down what is below.
    output : str
        In which the noise above the cutoff, or where that does not matter the noise below it, shows most.
    made, left : float
        Root mean square that the noise makes there, as recorded and low-passed, in ``output_unit``.
    floor : float
        Noise floor of that output.
    before, after : float
        Root mean square error of that output by the model as given, from the input as recorded and as used.
    held_out : bool
        True if that is on records that are not used to choose.
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
        """What was seen and done."""
        unit, times = self.output_unit, self.made / self.floor
        text = (
            f"The recorded input {self.input} is noisy: {quantity_text(self.noise, self.input_unit)}, which alone "
            f"would make {quantity_text(self.made, unit)} in {self.output}, {times:.2g} times its noise floor."
        )
        if self.low_passed:
            text += (
                f" It is used low-passed at {self.cutoff:.3g} Hz, above which nothing stands out of its noise; that "
                f"leaves {quantity_text(self.left, unit)}."
            )
        if self.weighed:
            text += f" What its noise makes below {self.cutoff:.3g} Hz is weighed down in the scan."
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the fields."""
        return asdict(self)


def reduce_input_noise(problem: Problem, progress: Callable[[str], None]) -> tuple[Problem, tuple[NoisyInput, ...]]:
    """Return the problem with the inputs low-passed, or their noise to be weighed, where it matters, and what was done.

    What is above the cutoff counts as noise where the records lack what it makes of the outputs (`_noise_share`).
    Nothing is done to inputs that keep their value until the next sample or are compared as well, and where sampling
    is uneven.

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
    every = {n: _cutoff(problem.identify, n) for n in _free_inputs(problem.identify[0])}
    try:
        share = _noise_share(problem, system, p, every)
        noise = {n: _noise_of(problem.identify, n, every[n]) * share[n] ** 0.5 for n in every if share[n] > 0.0}
        made, left = (_made_by_noise(problem, system, p, noise, c) for c in ({}, every))
    except SignalError as error:
        progress(f"the inputs stay as recorded: {error}")
        return problem, ()
    gone = {n: np.sqrt(np.maximum(made[n] ** 2 - left[n] ** 2, 0.0)) / floors for n in noise}
    cutoffs = {n: every[n] for n in noise if np.max(gone[n]) > MATTERS}
    weighed = {n: noise[n] for n in noise if np.max(left[n] / floors) > MATTERS}
    if not cutoffs and not weighed:
        return problem, ()
    progress(f"noise of recorded inputs matters: {', '.join(dict.fromkeys((*cutoffs, *weighed)))}")
    band = max((every[n] for n in weighed), default=0.0)

    def used(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
        quiet = (_low_passed(e, cutoffs) for e in experiments)
        return tuple(replace(e, input_noise=weighed, noise_band=band) for e in quiet)

    quiet = replace(problem, identify=used(problem.identify), validate=used(problem.validate))
    compared = [each.validate or each.identify for each in (problem, quiet)]
    before, after = (_errors(each, system, p) for each in compared)
    found = []
    for n in dict.fromkeys((*cutoffs, *weighed)):
        c = int(np.argmax(gone[n] if n in cutoffs else left[n] / floors))
        output = problem.identify[0].outputs[c]
        units = problem.identify[0].record.signals[n].unit, system.unit(output)
        done = every[n], n in cutoffs, n in weighed
        of_noise = float(made[n][c]), float(left[n][c]), float(floors[c])
        errors = float(before[c]), float(after[c]), bool(problem.validate)
        found.append(NoisyInput(n, noise[n], units[0], *done, output, *of_noise, units[1], *errors))
    return quiet, tuple(found)


def noise_summary(noisy: Sequence[NoisyInput]) -> str:
    """Say of which inputs the noise was reckoned with."""
    names = " and ".join(n.input for n in noisy)
    which = f"Noise of the recorded input{'s' * (len(noisy) > 1)} {names}"
    ways = {"taken out": any(n.low_passed for n in noisy), "weighed down": any(n.weighed for n in noisy)}
    done = " or ".join(way for way, used in ways.items() if used)
    return f"{which} shakes the model and is no missing law; it was {done}."


def _free_inputs(experiment: Experiment) -> list[str]:
    """Return the inputs that change from sample to sample and are not compared."""
    held, outputs, signals = experiment.held, experiment.outputs, experiment.record.signals
    return [n for n in experiment.inputs if n not in held and n not in outputs and np.ptp(signals[n].values) > 0.0]


def _noise_of(experiments: Sequence[Experiment], name: str, cutoff: float) -> float:
    """Return the deviation of white noise that has as much above the cutoff as an input has there, SI."""
    found = []
    for e in experiments:
        values = np.asarray(e.record.signals[name].values)
        above = values - low_pass(np.asarray(e.record.time), values, cutoff)
        found.append(float(np.std(above)) / (1.0 - 2.0 * cutoff / e.record.rate) ** 0.5)
    return float(np.median(found))


def _noise_share(problem: Problem, system: System, p: np.ndarray, cutoffs: Mapping[str, float]) -> dict[str, float]:
    """Return how much of what each input has above its cutoff is noise, in terms of variance; 0 where that is open.

    What the machine did not feel is in the simulation and not in the record: the error then is minus what it makes, and
    nothing of it where the machine felt it.  Both are compared above the cutoffs, by least squares over all inputs,
    free of what parameters and each record's own start can make.

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
        """Return error, inputs' and parameters' columns (n, n_y, ·), and those of the start, above the cutoff."""
        time = np.asarray(e.record.time)
        values = [np.asarray(e.record.signals[n].values) for n in names]
        perturbations = [
            InputPerturbation(n, v - low_pass(time, v, cutoffs[n])) for n, v in zip(names, values, strict=True)
        ]
        found = e.respond(system, p, parameters=parameters, states=e.free, perturbations=perturbations)
        stacked = np.concatenate([(e.measured - found.outputs)[:, :, None], found.derivatives], axis=2)
        flat = stacked.reshape(len(stacked), -1)
        high = (flat - low_pass(e.time, flat, lowest)).reshape(stacked.shape)
        first, last = 1 + len(parameters), 1 + len(parameters) + len(e.free)
        shared = [high[:, :, :1], high[:, :, last:], high[:, :, 1:first]]
        return np.concatenate(shared, axis=2), high[:, :, first:last]

    records = side_by_side(above, problem.identify)
    scale = np.sqrt(np.mean(np.concatenate([shared[:, :, 0] for shared, _ in records]) ** 2, axis=0))
    for _ in range(ROUNDS):  # each output is weighed by what is left of it
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
    spread = np.sqrt(np.mean(left**2) * memory * np.diag(np.linalg.pinv(unit.T @ unit)))
    share = {}
    for k, name in enumerate(names):
        felt, std = (-solved[k] / size[k], spread[k] / size[k]) if size[k] > 0.0 else (0.0, np.inf)
        share[name] = float(np.clip(felt, 0.0, 1.0)) if felt - 2.0 * std > SURELY else 0.0
    return share


def _without_own(block: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return a block, shape (n, n_y, k), without what its record's own unknowns (n, n_y, q) can make."""
    flat, basis = block.reshape(-1, block.shape[2]), own.reshape(-1, own.shape[2])
    size = np.linalg.norm(basis, axis=0)
    basis = basis[:, size > 0.0] / size[size > 0.0]
    return np.asarray((flat - basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]).reshape(block.shape))


def _made_by_noise(
    problem: Problem, system: System, p: np.ndarray, noise: Mapping[str, float], cutoffs: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the root mean square that noise of inputs makes in every output of the longest record, low-passed or not.

    The same noise is drawn again for the same seed.

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
        for _ in range(DRAWS):
            drawn = s * rng.standard_normal(time.size)
            perturbations.append(InputPerturbation(n, low_pass(time, drawn, cutoffs[n]) if n in cutoffs else drawn))
    found = longest.respond(system, p, perturbations=perturbations).derivatives
    squares = np.mean(found**2, axis=0).reshape(found.shape[1], len(noise), DRAWS)
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
