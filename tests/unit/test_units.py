"""Units at the door."""

from __future__ import annotations

import subprocess
import sys

import pytest

from multibody.base import units


@pytest.mark.parametrize("pair", sorted(units._USUAL))
def test_usual_conversions_are_those_of_pint(pair):
    registry = units._registry()
    expected = registry.Quantity(1.0, pair[0]).to(pair[1]).magnitude
    assert units._USUAL[pair] == pytest.approx(expected, rel=1e-15)
    assert units.convert(2.0, *pair) == 2.0 * units._USUAL[pair]


def test_the_shipped_lift_needs_no_definitions_of_units():
    code = "import sys; from vtsdt.lift.lift import Lift; Lift.reference(); print('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
