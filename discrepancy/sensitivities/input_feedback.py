"""Input feedback: recorded inputs that react to what disturbs the machine, such as the output of a controller.

A disturbance moves the machine, its controller reacts, and the reaction is in the recorded input.  Residual and input
are then correlated though the model lacks nothing.  The order in time distinguishes the two: the effect of a missing
force follows the input, a reaction follows the residual.
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

LAGS = 8  # samples of a scan by which one may follow the other; chosen
SIGNIFICANT = 6.0  # standard deviations of a correlation beyond chance among all outputs and lags; chosen


def inputs_with_feedback(linearised: LinearisedProblem) -> dict[str, str]:
    """Return the recorded inputs that react to the residual, each with the output that shows it most.

    Prediction-error filters remove the memory of both, so that only their innovations remain.  An input reacts where
    its innovations correlate with those of an output's residual shortly before, significantly and more than in the
    other order.
    """
    experiments, residual = linearised.experiments, linearised.residual()
    of_residual = _innovations(residual.blocks, residual.dt)
    channels = range(of_residual[0].shape[1])
    inputs = {}
    for name in experiments[0].inputs:
        blocks = []
        for experiment in experiments:
            time, u = np.asarray(experiment.record.time), np.asarray(experiment.record.signals[name].values)
            blocks.append(np.interp(experiment.time, time, u - np.mean(u))[:, None])
        if not any(np.ptp(b) > 0.0 for b in blocks):
            continue
        of_input = [b[:, 0] for b in _innovations(blocks, residual.dt)]

        def largest(order: int, channel: int, of_input: Sequence[Array] = of_input) -> float:
            lags = (order * lag for lag in range(1, LAGS + 1))
            return max(abs(_correlation(of_residual, of_input, channel, lag)) for lag in lags)

        after = [largest(1, c) for c in channels]
        before = [largest(-1, c) for c in channels]
        if max(after) > max(SIGNIFICANT, *before):
            inputs[name] = residual.channels[int(np.argmax(after))]
    return inputs


def feedback_messages(inputs: Mapping[str, str]) -> list[str]:
    """Return a sentence for each input that reacts to the residual of an output: what follows from it."""
    return [
        f"The recorded input {name} reacts to the residual of {output}, as the output of a controller does. The test "
        "whether the residual follows the inputs leaves it out, and a delay, gain or damping that is found may be that "
        "reaction. Put the controller into the model, with the controller's own input as the recorded input, for a "
        "definite answer."
        for name, output in inputs.items()
    ]


def _innovations(blocks: Sequence[Array], dt: float) -> list[Array]:
    """Return blocks (n, channels) without what their own past predicts, in standard deviations."""
    filters = fit_whitener(blocks, dt, [str(c) for c in range(blocks[0].shape[1])])
    return [filters.apply(b) for b in blocks]


def _correlation(residual: Sequence[Array], driven: Sequence[Array], channel: int, lag: int) -> float:
    """Return the correlation of an output's residual with the input ``lag`` samples later, in standard deviations."""
    total, energy = 0.0, 0.0
    for e, u in zip(residual, driven, strict=True):
        x = e[: len(e) - lag, channel] if lag >= 0 else e[-lag:, channel]
        y = u[lag:] if lag >= 0 else u[:lag]
        total += float(x @ y)
        energy += float((x * x) @ (y * y))
    return total / np.sqrt(energy) if energy > 0.0 else 0.0
