"""A fit that has ended in a local minimum begins again where the errors are smaller."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimation.fit.calibration import UncertainParameter
from estimation.fit.elsewhere import LOWER, better_place, log_size

MOVING = np.array([0, 1])


class Valley:
    """Two outputs whose errors have given sizes over two parameters, (n,) samples each."""

    k = 2
    parameters = (
        UncertainParameter(name="friction", value=1.0, std=0.1, min=0.5),
        UncertainParameter(name="inertia", value=2.0, std=np.inf),
    )

    def __init__(self, sizes: Any) -> None:
        self.sizes, self.scale, self.asked = sizes, np.array([3.0, 50.0]), 0

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.5, -np.inf]), np.array([np.inf, np.inf])

    def start(self, given: None, own: None) -> np.ndarray:
        return np.array([p.value for p in self.parameters])

    def residuals(self, theta: np.ndarray) -> list[np.ndarray] | None:
        self.asked += 1
        sizes = self.sizes(theta)
        if sizes is None:
            return None
        errors = np.outer(np.tile([1.0, -1.0], 20), sizes)
        return [(errors / self.scale).ravel(), np.zeros(1)]


@pytest.fixture
def floor() -> np.ndarray:
    return np.array([0.1, 0.1])


def sizes(theta: np.ndarray) -> list[float]:
    """Return a narrow good fit at a friction of 1.15, and else one that does not tell where it is."""
    return [0.15, 1.0] if abs(theta[0] - 1.15) < 0.05 else [3.0, 1.0]


def test_it_is_the_errors_that_count_and_not_their_weights(floor):
    """The output that is far off has a hundredth of the weight of the other here."""
    there = better_place(Valley(sizes), np.array([1.0, 2.0]), MOVING, floor)
    assert there == pytest.approx([1.15, 2.0])


def test_nothing_is_asked_where_the_errors_are_noise(floor):
    valley = Valley(lambda theta: [0.15, 0.19])
    assert better_place(valley, np.array([1.0, 2.0]), MOVING, floor) is None
    assert valley.asked == 1


def test_errors_below_the_noise_count_as_noise(floor):
    valley = Valley(lambda theta: [0.01 if theta[0] > 1.1 else 0.1, 1.0])
    assert better_place(valley, np.array([1.0, 2.0]), MOVING, floor) is None


@pytest.mark.parametrize(("fall", "again"), [(0.9 * LOWER, False), (1.1 * LOWER, True)])
def test_a_small_hill_is_no_reason_to_begin_again(floor, fall, again):
    valley = Valley(lambda theta: [3.0 * np.exp(-fall * (theta[0] > 1.1)), 1.0])
    assert (better_place(valley, np.array([1.0, 2.0]), MOVING, floor) is not None) is again


def test_a_place_that_cannot_be_simulated_is_passed_over(floor):
    valley = Valley(lambda theta: None if theta[0] > 1.1 else [3.0, 1.0] if theta[0] > 0.9 else [1.0, 1.0])
    there = better_place(valley, np.array([1.0, 2.0]), MOVING, floor)
    assert there == pytest.approx([0.85, 2.0])
    assert log_size(valley, np.array([1.15, 2.0]), floor) == np.inf
