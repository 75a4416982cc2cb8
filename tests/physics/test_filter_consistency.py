"""NEES and NIS of the lift's own filter, 12 states and δ, on data that fulfil its assumptions."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

FIGURES = Path(__file__).parents[2] / "docs" / "images" / "filter_figures.py"


@pytest.mark.slow
def test_nees_and_nis_of_the_cabin_with_its_deviation_lie_within_their_bounds():
    """Eight trips drawn from the model itself: contacts, friction and δ as the filter assumes them."""
    spec = importlib.util.spec_from_file_location("filter_figures", FIGURES)
    figures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(figures)
    found, tests = figures.consistency_of(figures.cabin(), 8)
    # Instants are correlated, so the share inside wanders about 95 %.
    assert found.inside > 0.88
    assert found.values.mean() == pytest.approx(1.0, abs=0.1)
    inside = [t.nis_bounds[0] <= t.nis <= t.nis_bounds[1] for t in tests]
    assert sum(inside) >= 6  # of 8 at 95 %: 5 or fewer has a chance of 0.6 %
