"""Finite-amplitude sensitivities: simulated only between those with different directions."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.sensitivities.finite_amplitude import SAME_DIRECTION, in_new_directions


def derivative():
    return [np.array([1.0, 0.0])]


def direction(blocks):
    size = np.linalg.norm(blocks[0])
    return blocks[0] / size if size > 0.0 else None


def computed_at(angles):
    """Return a function that gives sensitivities of these angles (None: there is none), and the list of its calls."""
    calls = []

    def sensitivity(k):
        calls.append(k)
        return None if angles[k] is None else [2.0 * np.array([np.cos(angles[k]), np.sin(angles[k])])]

    return sensitivity, calls


NEAR = 0.5 * np.sqrt(SAME_DIRECTION)


@pytest.mark.parametrize(
    ("angles", "computed", "kept"),
    [
        ([0.0] * 6, [5], [5]),  # one at least: its strength is a free shape in the scan
        ([0.0, 0.0, 0.0, 0.0, NEAR, NEAR], [5], [5]),
        ([0.0, 0.0, 0.0, 0.1, 0.3, 0.9], [5, 2, 3, 4], [3, 4, 5]),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [5, 2, 0, 1, 3, 4], [0, 1, 2, 3, 4, 5]),
        ([0.0, 0.0, 0.0, 0.4, 0.4, None], [5, 2, 3, 4], [3]),  # the largest cannot be simulated
        ([0.0, None, None, None, None, None], [5, 2, 0, 1, 3, 4], [0]),
        ([None] * 6, [5, 2, 0, 1, 3, 4], []),
        ([0.0, 0.0, 0.0, 0.0, 0.0, np.pi], [5, 2, 3, 4], [5]),  # the other way is another direction
    ],
)
def test_only_new_directions_are_computed_and_kept(angles, computed, kept):
    sensitivity, calls = computed_at(angles)
    found = in_new_directions(derivative(), sensitivity, len(angles), direction)
    assert calls == computed
    assert [k for k, _ in found] == kept


def test_a_sensitivity_that_calibration_explains_entirely_has_no_direction():
    sensitivity, calls = computed_at([0.0] * 6)
    assert [k for k, _ in in_new_directions([np.zeros(2)], sensitivity, 6, direction)] == [0]
    assert calls == [5, 2, 0]
