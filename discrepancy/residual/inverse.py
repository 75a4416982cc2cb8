"""The inverse residual: the recorded motion is prescribed, and the force that it needs is compared.

In a copy of the model every free motion whose position, angle or speed is measured becomes a prescribed one.  The sum
of the modelled forces (springs, friction, gravity, recorded forces) leaves a remainder, the reaction of the
prescription: zero for the right model.  Motion and all recorded signals pass the same zero-phase low-pass, so that
everything compared has been treated alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.problem.study_file import StudyError
from discrepancy.residual.initial_state import estimate_states
from discrepancy.residual.prepared_problem import PreparedProblem
from discrepancy.residual.prescribed_motion import (
    UNITS,
    MeasuredMotion,
    cut_loops,
    measured_motions,
    outputs_of_motion,
    with_prescribed_motion,
)
from discrepancy.residual.signal_bandwidth import signal_bandwidth
from discrepancy.residual.windows import crop
from estimation.files.record import Record, RecordedSignal
from estimation.response.experiment import Experiment
from estimation.signals.metrics import noise_floor
from estimation.signals.preparation import Preparation, edge_time, low_pass

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["derivatives", "inverse_problem"]


def inverse_problem(problem: Problem, bandwidth: float | None = None) -> PreparedProblem:
    """Return the problem in which the measured motion is prescribed and the force that it needs is compared.

    Parameters
    ----------
    problem : Problem
    bandwidth : float, optional, Hz
        Of the smoothing; default: the study's low-pass, else where the motion disappears in its noise.

    Raises
    ------
    StudyError
        If no position, angle or speed of a free motion is measured.
    """
    first = problem.identify[0]
    model, cut = cut_loops(problem.model, first.outputs)
    recorded = tuple(n for n in (*first.inputs, *cut) if n in model.inputs)
    outputs = tuple(n for n in first.outputs if n not in cut)
    system = model.build(outputs=outputs)
    motions = measured_motions(model, system, outputs, recorded, problem)
    if not motions:
        raise StudyError(
            [
                '[study] residual = "inverse": none of the measured outputs '
                f"({', '.join(first.outputs)}) is the position, angle or speed of a free motion; measure one, or use "
                '"simulation" or "prediction"'
            ]
        )
    inputs = tuple(n for n in recorded if n not in {m.force for m in motions})
    shown = outputs_of_motion(system, outputs, motions)
    copy = with_prescribed_motion(model, motions)
    if bandwidth is None:
        bandwidth = first.preparation.low_pass_hz
    if bandwidth is None:
        bandwidth = max(
            signal_bandwidth(e.record.time, e.record.values(m.output)[:, 0]) for e in problem.identify for m in motions
        )
    compared = tuple(n for n in outputs if n not in shown)
    built = copy.build(outputs=(*(m.compared for m in motions), *compared))
    known = set(built.parameter_names)
    whole = problem.model.build(outputs=first.outputs)

    def with_motion(e: Experiment) -> Experiment:
        return _experiment(crop(e), motions, inputs, compared, built, bandwidth, whole)

    identify, validate = tuple(map(with_motion, problem.identify)), tuple(map(with_motion, problem.validate))
    excluded = (*problem.exclude, "sensor_*@needed.*", "input_*@motion.*")
    if any(not m.force for m in motions):  # a comparison with zero is best where the gain of every signal is zero
        excluded = (*excluded, "sensor_gain@*", "input_gain@*")
    noise = {n: v for n, v in problem.noise.items() if n in compared}
    changed = replace(
        problem,
        model=copy,
        identify=identify,
        validate=validate,
        exclude=excluded,
        noise=noise,
        uncertain=tuple(q for q in problem.uncertain if q.name in known),
    )
    changed = replace(changed, noise={**noise, **_floors(changed, built, motions)})
    names = " and ".join(m.output for m in motions)
    return PreparedProblem(
        changed,
        "inverse",
        f"the motion is given by {names}, low-passed at {bandwidth:.3g} Hz, and the force or torque that it "
        "needs is compared",
    )


def derivatives(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivative of a smooth, evenly sampled signal by five-point differences.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Already low-passed to a tenth of the sampling rate at most, where the formulas are right within 0.5 %, and
        within 0.1 % at a twentieth.

    Notes
    -----
    Differences of the low-passed signal, not a smoothing differentiator: position, rate, acceleration and the recorded
    forces have then passed the same filter, and no difference of filters looks like a missing inertia.
    """
    h = float(time[-1] - time[0]) / (len(time) - 1)
    padded = np.concatenate([_extrapolated(values[:8])[::-1], values, _extrapolated(values[::-1][:8])])
    a, b, c, d, e = (padded[k : len(padded) - 4 + k] for k in range(5))
    return (a - 8.0 * b + 8.0 * d - e) / (12.0 * h), (-a + 16.0 * b - 30.0 * c + 16.0 * d - e) / (12.0 * h * h)


def _extrapolated(first: np.ndarray) -> np.ndarray:
    """Continue a signal two samples before its first by the cubic through its first four."""
    a, b, c, d = first[:4]
    one = 4.0 * a - 6.0 * b + 4.0 * c - d
    return np.array([one, 4.0 * one - 6.0 * a + 4.0 * b - c])


def _experiment(
    experiment: Experiment,
    motions: Sequence[MeasuredMotion],
    inputs: Sequence[str],
    compared: Sequence[str],
    system: System,
    bandwidth: float,
    whole: System,
) -> Experiment:
    """Return an experiment whose record prescribes the motion; other states start at their estimates."""
    record = experiment.record
    time = np.array(record.time)
    nyquist = 0.5 * record.rate
    cutoff = min(bandwidth, 0.45 * nyquist)
    edge = int(np.ceil(edge_time(cutoff) * record.rate))
    if time.size < 4 * edge + 40:
        raise StudyError(
            [
                f"{record.name}: {time.size} samples are too few to differentiate a motion at {cutoff:.3g} Hz "
                f"({edge} samples "
                'are left out at each end): record longer, or use "prediction"'
            ]
        )
    inside = slice(edge, time.size - edge)
    inputs = tuple(n for n in inputs if n in record.signals)
    signals: dict[str, RecordedSignal] = {}
    for name in (*inputs, *compared):
        raw = record.signals[name]
        signals[name] = replace(raw, values=low_pass(time, raw.values, cutoff)[inside])
    for m in motions:
        units = UNITS[m.domain]
        smooth = (low_pass(time, record.signals[m.output].values, cutoff) - m.offset) / m.factor
        rate, second = derivatives(time, smooth)
        if m.order == 1:
            position = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(time))])
            first = experiment.start.get(m.states[0], 0.0)
            smooth, rate, second = position + (first if isinstance(first, float | int) else 0.0), smooth, rate
        for name, values, unit in zip(m.quantities, (smooth, rate, second), units, strict=False):
            signals[name] = RecordedSignal(
                values=values[inside], unit=unit, column=record.signals[m.output].column, measured_unit=unit
            )
        if m.force:
            drive = record.signals[m.force]
            signals[m.force] = replace(drive, values=low_pass(time, drive.values, cutoff)[inside])
        else:
            signals[m.needed] = RecordedSignal(
                values=np.zeros(time.size)[inside], unit=units[3], column="", measured_unit=units[3]
            )
    log = (
        *record.log,
        f"zero-phase low-pass at {cutoff:.4g} Hz, motion differentiated, {edge} samples left out at each end",
    )
    inner = Record(
        name=record.name, path=record.path, time=time[inside], signals=signals, log=log, warnings=record.warnings
    )
    factor = max(1, int(record.rate / (5.0 * cutoff)))
    factor = max(1, min(factor, inner.time.size // 200))
    decimate = experiment.preparation.decimate
    factor = max(factor, decimate if decimate * 200 <= inner.time.size else 1)
    free = tuple(n for n in system.state_names if not n.startswith("energy."))
    start: dict[str, float] = {}
    if free:
        x = estimate_states(experiment, whole, whole.p).at(edge)
        start = {n: float(x[whole.index("state", n)]) for n in free if n in whole.state_names}
    return replace(
        experiment,
        record=inner,
        inputs=(*inputs, *(q for m in motions for q in m.quantities)),
        outputs=(*(m.compared for m in motions), *compared),
        preparation=Preparation(decimate=factor),
        start=start,
        free=free,
        held=(),
        offsets=tuple(o for o in experiment.offsets if o in compared),
        clocks=(),
    )


def _floors(problem: Problem, system: System, motions: Sequence[MeasuredMotion]) -> dict[str, float]:
    """Return the noise of the compared forces: the model's force carries the noise of the differentiated motion."""
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    floors: dict[str, list[float]] = {}
    for e in problem.identify:
        residual = e.measured - e.simulate(system, p)
        for c, m in enumerate(motions):
            floors.setdefault(m.compared, []).append(noise_floor(residual[:, c]).std)
    return {n: float(np.median(v)) for n, v in floors.items()}
