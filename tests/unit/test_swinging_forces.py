"""A random force that swings: it is found with its frequency, and one that does not swing gets none."""

from __future__ import annotations

import numpy as np
import pytest
from test_innovations import NO_OFFSET, NO_PRIOR, columns_of, noise_model, oscillator

from discrepancy.innovations.noise_fit import fit_noise, restricted_log_likelihood
from discrepancy.innovations.noise_model import Process

FLOOR = np.array([1e-4, 1e-3])


def offered() -> list[Process]:
    slow = [Process(where="spring", source=0, channel=-1, memory=m, std=0.3) for m in (0.04, 0.2, 1.0)]
    swinging = [
        Process(where="spring", source=0, channel=-1, memory=1.0 / f, std=0.3, frequency=f)
        for f in (0.5, 1.0, 2.0, 4.0)
    ]
    return [*slow, *swinging]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_frequency_of_a_force_is_found(seed: int) -> None:
    true = noise_model(drift=1e-6, frequency=3.0)
    records = [columns_of(oscillator(300), 10 * seed + k, true) for k in range(2)]
    model, value = fit_noise(records, NO_PRIOR, NO_OFFSET, FLOOR, offered())
    largest = max(model.processes, key=lambda q: q.std)
    assert largest.frequency == pytest.approx(3.0, rel=0.15)
    assert largest.swings
    # as good as the truth, but for the price of what was chosen
    assert value > restricted_log_likelihood(records, true, NO_PRIOR, NO_OFFSET) - 8.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_force_that_does_not_swing_is_not_said_to(seed: int) -> None:
    true = noise_model(drift=1e-6)
    records = [columns_of(oscillator(300), 10 * seed + k, true) for k in range(2)]
    model, _ = fit_noise(records, NO_PRIOR, NO_OFFSET, FLOOR, offered())
    assert not max(model.processes, key=lambda q: q.std).swings
