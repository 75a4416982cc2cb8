"""Recorded inputs that react to what disturbs the machine, as what a controller puts out does.

A disturbance moves the machine, its controller answers, and the answer is in the recorded input.  So what is left
and the input go together though the model lacks nothing.  Which of the two comes first tells: what is missing in a
model follows the input, an answer comes after what is left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.whitening import fit_whitener

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from discrepancy.sensitivities.linearised_problem import LinearisedProblem
    from discrepancy.statistics.blocks import Array

__all__ = ["feedback_messages", "inputs_with_feedback"]

LAGS = 8  # samples of a scan by which one may come after the other; chosen
SURE = 6.0  # deviations of a correlation from which an answer is one, beyond luck among all outputs and lags; chosen


def inputs_with_feedback(linearised: LinearisedProblem) -> dict[str, str]:
    """Return the recorded inputs that answer to what is left, each with the output in which that shows most.

    Both are freed of their own memory by prediction-error filters, so that each keeps only what is new in it.  An input
    answers where what is new in it goes with what was new in an output's residual shortly before, beyond doubt and
    more than the other way round.
    """
    experiments, residual = linearised.experiments, linearised.residual()
    left = _new(residual.blocks, residual.dt)
    found = {}
    for name in experiments[0].inputs:
        blocks = []
        for experiment in experiments:
            time, u = np.asarray(experiment.record.time), np.asarray(experiment.record.signals[name].values)
            blocks.append(np.interp(experiment.time, time, u - np.mean(u))[:, None])
        if not any(np.ptp(b) > 0.0 for b in blocks):
            continue
        driven = [b[:, 0] for b in _new(blocks, residual.dt)]
        after = [max(abs(_together(left, driven, c, lag)) for lag in range(1, LAGS + 1)) for c in _columns(left)]
        before = [max(abs(_together(left, driven, c, -lag)) for lag in range(1, LAGS + 1)) for c in _columns(left)]
        if max(after) > max(SURE, *before):
            found[name] = residual.channels[int(np.argmax(after))]
    return found


def feedback_messages(found: Mapping[str, str]) -> list[str]:
    """Say in a sentence for each input that it answers, and what that is worth knowing for."""
    return [
        f"The recorded input {name} answers to what is left of {output}, as what a controller puts out does. Whether "
        f"what is left follows it was not asked, and a delay, gain or damping that is found may be that answer. Put "
        "the controller into the model, with what it is told as the input, to have more said."
        for name, output in found.items()
    ]


def _columns(blocks: Sequence[Array]) -> range:
    return range(blocks[0].shape[1])


def _new(blocks: Sequence[Array], dt: float) -> list[Array]:
    """Return blocks (n, channels) without what their own past predicts, in deviations."""
    filters = fit_whitener(blocks, dt, [str(c) for c in _columns(blocks)])
    return [filters.apply(b) for b in blocks]


def _together(left: Sequence[Array], driven: Sequence[Array], channel: int, lag: int) -> float:
    """Return how much an output's residual goes with the input ``lag`` samples later, in deviations of luck."""
    total, energy = 0.0, 0.0
    for e, u in zip(left, driven, strict=True):
        x = e[: len(e) - lag, channel] if lag >= 0 else e[-lag:, channel]
        y = u[lag:] if lag >= 0 else u[:lag]
        total += float(x @ y)
        energy += float((x * x) @ (y * y))
    return total / np.sqrt(energy) if energy > 0.0 else 0.0
