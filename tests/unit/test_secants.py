"""Columns at strengths that matter: simulated only where they point elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.sensitivities.finite_amplitude import SAME_DIRECTION, bent


def straight():
    return [np.array([1.0, 0.0])]


def direction(blocks):
    size = np.linalg.norm(blocks[0])
    return blocks[0] / size if size > 0.0 else None


def asked_of(angles):
    """Return a function that gives columns of these angles (None: there is none), and the list of what was asked."""
    asked = []

    def column(k):
        asked.append(k)
        return None if angles[k] is None else [2.0 * np.array([np.cos(angles[k]), np.sin(angles[k])])]

    return column, asked


NEAR = 0.5 * np.sqrt(SAME_DIRECTION)


@pytest.mark.parametrize(
    ("angles", "asked", "kept"),
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
def test_only_what_differs_is_asked_for_and_kept(angles, asked, kept):
    column, seen = asked_of(angles)
    found = bent(straight(), column, len(angles), direction)
    assert seen == asked
    assert [k for k, _ in found] == kept


def test_a_column_of_which_calibration_leaves_nothing_has_no_like():
    column, seen = asked_of([0.0] * 6)
    assert [k for k, _ in bent([np.zeros(2)], column, 6, direction)] == [0]
    assert seen == [5, 2, 0]
