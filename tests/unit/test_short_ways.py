"""The short ways in of the docs run as printed, and give what the page says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surrogate import SurrogateWarning

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "short-ways.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


def _run(number: int) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(BLOCKS[number], f"{PAGE.name}, block {number + 1}", "exec"), names)
    return names


@pytest.mark.parametrize(("number", "lines"), [(0, 6), (1, 12), (2, 12), (3, 12)])
def test_they_are_short_and_have_one_line_of_imports(number: int, lines: int) -> None:
    code = [line for line in BLOCKS[number].splitlines() if line.strip()]
    assert len(code) <= lines
    assert sum(line.startswith(("import ", "from ")) for line in code) == 1


def test_lift_with_locked_motions() -> None:
    names = _run(0)
    assert len(names["lift"].system.states) == 27


def test_joint_filter_on_arrays() -> None:
    alignment = _run(1)["alignment"]
    assert len(alignment.trips) == 4
    inside = (alignment.height > 0.1) & (alignment.height < 1.8)
    true = [d > 2.3e-3 for d in alignment.estimate[inside]]
    assert any(true)
    assert not all(true)


def test_surface_of_any_function() -> None:
    names = _run(2)
    assert names["surface"].quality.r2 > 0.99
    assert names["f"](names["best"].x) == pytest.approx(0.9, abs=0.01)


def test_surface_of_the_gear_stage_that_promises_what_cannot_be() -> None:
    with pytest.warns(SurrogateWarning, match="none is above 1"):
        names = _run(3)
    assert names["best"].value > 1.0
    assert 0.99 < names["f"](names["best"].x) < 1.0


def test_virtual_sensing() -> None:
    names = _run(4)
    error = np.abs(names["tension"]["F_c"] - names["run"]["F_c"])[1000:]
    assert error.max() < 0.5
    assert names["tension"].std("F_c")[-1] < 0.5


def test_arrays_with_faults_are_refused_together() -> None:
    from vtsdt import AlignmentError, Trip

    time = np.arange(10) * 1e-3
    with pytest.raises(AlignmentError) as error:
        Trip.from_arrays(time[::-1], np.ones(9), np.full(10, np.nan), np.zeros(10), name="mine")
    assert len(error.value.faults) == 3
    assert "mine: tension has shape (9,), the time (10,)" in str(error.value)
