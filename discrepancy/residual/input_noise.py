"""Noise of recorded inputs, carried through the machine: what it adds to a residual, and how to weigh it down.

Where an input is a sensor, its noise acts on the model as a real force would.  In a window it adds up to a smooth
deviation that a curve with a few points can follow, and that no reshuffling of such deviations looks like.  Its
covariance is known, though: the input's noise, sent through the exact linearisation.  Residual and sensitivities are
multiplied by the inverse square root of (output noise + that), relative to the output noise; what is left is white.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.low_rank_noise import Shaping, shaping_along
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimation.response.sensors import SensorError
    from multibody.machine.model import System

__all__ = ["shaping_of"]

_KNOTS, _MOST_KNOTS = 40, 400
_A_PERIOD = 4.0  # knots to a period of the highest frequency that is weighed


def shaping_of(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    x0: np.ndarray,
    noise: np.ndarray,
    sensors: Sequence[SensorError] = (),
) -> Shaping:
    """Return how an experiment's residual is to be weighed, from ``experiment.input_noise``.

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
    none = Shaping(noise, np.zeros((0, 0)), np.zeros(0))
    time = np.array(experiment.record.time)
    noisy = {n: s for n, s in experiment.input_noise.items() if s > 0.0}
    if not noisy or time.size < 4 or not np.all(noise > 0.0):
        return none
    wanted = max(_KNOTS, math.ceil(_A_PERIOD * experiment.noise_band * float(time[-1] - time[0])))
    knots = min(wanted, _MOST_KNOTS, time.size // 2)
    place = (time - time[0]) / (time[-1] - time[0]) * (knots - 1)
    tents = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots)))
    # White noise of deviation s at the sampling rate has the same low-frequency density as tents of this deviation.
    share = np.sqrt((knots - 1) / (time.size - 1))
    perturbations = [InputPerturbation(n, s * share * tents[:, k]) for n, s in noisy.items() for k in range(knots)]
    found = experiment.respond(system, p, x0, perturbations=perturbations, sensors=sensors).derivatives
    return shaping_along(found, noise)
