"""Settled filters have the gains and variances of their closed forms."""

from __future__ import annotations

import pytest
from steady_filters import results


def test_settled_filters_have_their_closed_forms():
    found = list(results())
    assert len(found) == 10
    for _, _, value, wanted in found:
        assert value == pytest.approx(wanted, rel=1e-10)
