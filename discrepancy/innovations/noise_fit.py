"""The noise model of a residual, by restricted marginal likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from discrepancy.innovations.noise_model import NoiseModel, Process
from discrepancy.innovations.restricted_likelihood import RecordColumns, RestrictedLikelihood

__all__ = ["fit_noise"]

#: Nats by which a further process must raise the likelihood; it costs two parameters, of which one is at its bound
#: where there is no such process.
WORTH = 4.0
MOST_PROCESSES = 6
#: Processes of each kind that are tried again in the next round: those that raised the likelihood most.  The kinds are
#: forces, forces at a standstill, and errors of outputs: the first to be found must not crowd out the others.
PROMISING = 4
#: Standard deviations of a process that are tried first, in units of what moves an output by its noise.
FIRST_SIZES = (0.3, 3.0, 30.0)
#: Damping with which a process narrow in frequency begins, the least period in samples, and periods that are tried.
NARROW, LEAST_PERIOD, PERIODS = 0.1, 4.0, 10
#: Least damping, a hundred swings long, and the largest, from which the process is one of first order.
LEAST_DAMPING, LARGEST_DAMPING = 3e-3, 30.0
#: Least memory of a process in samples, below which it is white, and largest in durations of a record: a force that
#: changes more slowly than that is a steady one in a record, and a steady force is an effect, with a name.
LEAST_MEMORY, LARGEST_MEMORY = 0.3, 1.0 / 3.0
#: Change of a logarithm over which derivatives are taken, most iterations, and the largest change of one in each.
STEP, ROUNDS, LONGEST_STEP = 1e-3, 20, 2.0
#: Damping of the first iteration, factors after one that was better and one that was worse, and where it is given up.
DAMPING, EASED, TIGHTENED, MOST_DAMPING = 1e-2, 0.2, 5.0, 1e4
#: Samples × outputs of the records, thinned out, on which it is decided which process to try next.
SCREENING_ROWS = 1500
#: Updates of the correlation of the outputs' white noise, and its least eigenvalue: a command that a sampled controller
#: makes of noisy measurements has their noise some time later, so no combination of outputs is nearly free of noise.
CORRELATION_ROUNDS, LEAST_EIGENVALUE = 3, 0.05
CLOSE = 0.05  # nats that an iteration must gain, or it is the last: far below what two models are told apart by


def fit_noise(
    records: Sequence[RecordColumns],
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    floor: np.ndarray,
    candidates: Sequence[Process],
    start: NoiseModel | None = None,
    *,
    grow: bool = True,
) -> tuple[NoiseModel, float]:
    """Return the noise model with the largest restricted likelihood, and that likelihood.

    Begins with white noise, or with ``start``; then processes are added one after another, the one that raises the
    likelihood most, as long as it does so by more than `WORTH`.

    Parameters
    ----------
    records : sequence of RecordColumns
    prior_std, prior_offset : ndarray, shape (k,)
    floor : ndarray, shape (n_c,)
        Least standard deviation of the white noise of each output, SI.
    candidates : sequence of Process
        With the standard deviation that moves some output by its noise.
    start : NoiseModel, optional
    grow : bool
        False: fit the standard deviations of ``start`` only.
    """
    likelihood = RestrictedLikelihood(records=records, prior_std=prior_std, prior_offset=prior_offset)
    if start is None:
        left = np.sqrt(np.mean(np.concatenate([r.residual[r.record.used] for r in records]) ** 2, axis=0))
        start = NoiseModel(noise=tuple(np.maximum(left, floor).tolist()))
    model, best = _climb(*_with_correlation(start, records, likelihood, floor), likelihood, floor)
    promising = list(candidates)
    rows = sum(r.residual.size for r in records)
    thinned = [r.every(max(1, min(rows // SCREENING_ROWS, len(r.residual) // 50))) for r in records]
    screened = replace(likelihood, records=thinned)
    while grow and len(model.processes) < MOST_PROCESSES:
        tried = []
        for process in promising:
            sizes = (replace(process, std=size * process.std) for size in FIRST_SIZES)
            trials = [replace(model, processes=(*model.processes, q)) for q in sizes]
            tried.append((*max(((screened(t), t) for t in trials), key=lambda t: t[0]), process))
        if not tried:
            break
        tried.sort(key=lambda t: -t[0])
        kinds = {_kind(process): [t for t in tried if _kind(t[-1]) == _kind(process)] for *_, process in tried}
        promising = [process for of_kind in kinds.values() for *_, process in of_kind[:PROMISING]]
        # the best of each kind is fitted: which of them it is, a thinned record may not tell
        best_of = [of_kind[0][1] for of_kind in kinds.values()]
        climbed = [_climb(trial, likelihood(trial), likelihood, floor) for trial in best_of]
        fitted, value = max(climbed, key=lambda t: t[1])
        fitted, value = _of_second_order(fitted, value, likelihood, screened, floor)
        fitted, value = _climb(*_with_correlation(fitted, records, likelihood, floor), likelihood, floor)
        if value < best + WORTH:
            break
        model, best = fitted, value
    return model, best


def _kind(process: Process) -> tuple[bool, bool]:
    return process.channel >= 0, process.at_standstill


def _of_second_order(
    model: NoiseModel, value: float, likelihood: RestrictedLikelihood, screened: RestrictedLikelihood, floor: np.ndarray
) -> tuple[NoiseModel, float]:
    """Return the model with its last process of second order, if that is worth its further parameter."""
    *others, last = model.processes
    if _kind(last) != (False, False):
        return model, value
    shortest, longest = _memories(likelihood.records)
    smooth = [replace(last, damping=1.0, memory=0.5 * last.memory)]
    periods = np.geomspace(shortest / LEAST_MEMORY * LEAST_PERIOD, longest / LARGEST_MEMORY, PERIODS)
    narrow = [replace(last, damping=NARROW, memory=float(p / (2.0 * np.pi))) for p in periods]
    best, reached = model, value + WORTH
    for of_kind in (smooth, narrow):
        trials = [replace(model, processes=(*others, q)) for q in of_kind]
        trial = max(trials, key=screened) if len(trials) > 1 else trials[0]
        fitted, found = _climb(trial, likelihood(trial), likelihood, floor)
        if found > reached:
            best, reached = fitted, found
    return (model, value) if best is model else (best, reached)


def _with_correlation(
    model: NoiseModel,
    records: Sequence[RecordColumns],
    likelihood: RestrictedLikelihood,
    floor: np.ndarray,
) -> tuple[NoiseModel, float]:
    """Return the model with the covariance of the white noise that the innovations ask for, if that is likelier."""
    value = likelihood(model)
    n_c = len(model.noise)
    if n_c == 1 or not np.isfinite(value):
        return model, value
    for _ in range(CORRELATION_ROUNDS):
        excess, count = np.zeros((n_c, n_c)), 0
        for record in records:
            e, root = record.innovations(model)
            factor = np.linalg.inv(root)
            spread = np.einsum("ki,kj->kij", e, e) - np.eye(n_c)
            excess += np.sum(factor @ spread @ factor.transpose(0, 2, 1), axis=0)
            count += len(e)
        for share in (1.0, 0.3):
            covariance = model.noise_covariance() + share * excess / count
            trial = _noise_of(model, covariance, floor)
            reached = likelihood(trial)
            if reached > value:
                break
        if not reached > value + CLOSE:
            break
        model, value = trial, reached
    return model, value


def _noise_of(model: NoiseModel, covariance: np.ndarray, floor: np.ndarray) -> NoiseModel:
    std = np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), floor)
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    covariance = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T
    size = np.sqrt(np.diag(covariance))
    return replace(model, noise=tuple(std.tolist()), correlation=covariance / np.outer(size, size))


def _climb(
    model: NoiseModel, value: float, likelihood: RestrictedLikelihood, floor: np.ndarray
) -> tuple[NoiseModel, float]:
    """Maximise over the logarithms of standard deviations and memories, from a model and its likelihood.

    By Fisher scoring, damped as by Levenberg and Marquardt.  Of a process of first order the variance per unit of
    memory, which drives it, is a coordinate: what changes faster than its memory does not depend on that.
    """
    if not np.isfinite(value):
        return model, value
    least = np.log(floor)
    damping = DAMPING
    shortest, longest = _memories(likelihood.records)
    for _ in range(ROUNDS):
        count = len(model.noise) + sum(1 + q.order for q in model.processes)
        steps = STEP * np.eye(count)
        try:
            gradient, information = likelihood.slopes([_moved(model, e) for e in steps], model, STEP)
        except np.linalg.LinAlgError:
            break
        at_floor = np.log(model.noise) <= least + STEP
        free = np.ones(count, dtype=bool)
        free[: at_floor.size] = ~(at_floor & (gradient[: at_floor.size] < 0.0))
        better = False
        while damping < MOST_DAMPING:
            matrix = information + damping * np.diag(np.diag(information)) + 1e-9 * np.eye(count)
            step = np.zeros(count)
            step[free] = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
            step = np.clip(step, -LONGEST_STEP, LONGEST_STEP)
            step[: least.size] = np.maximum(step[: least.size], least - np.log(model.noise))
            memory = np.array([q.memory for q in model.processes])
            ways = slice(least.size + memory.size, least.size + 2 * memory.size)
            step[ways] = np.log(np.clip(memory * np.exp(step[ways]), shortest, longest) / memory)
            expected = float(gradient @ step - 0.5 * step @ information @ step)
            if expected < CLOSE:
                return model, value
            trial = _moved(model, step)
            reached = likelihood(trial)
            if reached > value:
                better = True
                break
            damping *= TIGHTENED
        if not better:
            break
        gain, model, value = reached - value, trial, reached
        damping *= EASED
        if gain < CLOSE:
            break
    return model, value


def _memories(records: Sequence[RecordColumns]) -> tuple[float, float]:
    """Return the least and the largest memory that records can tell, s."""
    times = [r.record.time for r in records]
    step = float(np.median(np.concatenate([np.diff(t) for t in times])))
    return LEAST_MEMORY * step, LARGEST_MEMORY * max(float(t[-1] - t[0]) for t in times)


def _moved(model: NoiseModel, step: np.ndarray) -> NoiseModel:
    """Return a noise model with its logarithms changed: noise, what drives each process, memories, dampings."""
    n_c, n_p = len(model.noise), len(model.processes)
    factors = np.exp(step)
    size, memory, dampings = (
        factors[n_c : n_c + n_p],
        factors[n_c + n_p : n_c + 2 * n_p],
        iter(factors[n_c + 2 * n_p :]),
    )
    processes = []
    for q, s, m in zip(model.processes, size, memory, strict=True):
        if q.damping is None:
            processes.append(replace(q, std=float(q.std * s * np.sqrt(m)), memory=float(q.memory * m)))
        else:
            damping = float(np.clip(q.damping * next(dampings), LEAST_DAMPING, LARGEST_DAMPING))
            processes.append(replace(q, std=float(q.std * s), memory=float(q.memory * m), damping=damping))
    noise = tuple((np.array(model.noise) * factors[:n_c]).tolist())
    return replace(model, noise=noise, processes=tuple(processes))
