"""Thinning of signals for drawing keeps every peak, wherever it stands."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from multibody.base.thinning import extreme_rows


@given(
    n=st.integers(1, 5000),
    most=st.integers(4, 400),
    peak=st.floats(0.0, 1.0),
    dip=st.floats(0.0, 1.0),
    seed=st.integers(0, 99),
)
def test_peaks_first_and_last_row_are_kept(n: int, most: int, peak: float, dip: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=n)
    top, bottom = round(peak * (n - 1)), round(dip * (n - 1))
    values[bottom], values[top] = -50.0, 100.0
    rows = extreme_rows(values, most)
    assert len(rows) <= max(most, 0) or n <= most
    assert np.all(np.diff(rows) > 0)
    assert {0, n - 1, top} <= set(rows)
    assert values[rows].min() == values.min()


@given(most=st.integers(6, 60), stretches=st.integers(3, 20), tail=st.integers(1, 12))
def test_a_peak_in_the_incomplete_last_stretch_is_kept(most: int, stretches: int, tail: int) -> None:
    """Every position of the tail, for lengths that do not divide evenly."""
    n = most * stretches + tail
    for k in range(1, tail + 2):
        values = np.zeros(n)
        values[n - k] = 1.0
        assert n - k in extreme_rows(values, most)


def test_nan_does_not_hide_a_peak() -> None:
    values = np.full(1000, np.nan)
    values[700], values[701] = 3.0, -2.0
    rows = extreme_rows(values, 30)
    assert {700, 701} <= set(rows)
