"""The table of errors that commands print: no name and no number is cut on a terminal of 80 columns."""

from __future__ import annotations

import io
import re
from types import SimpleNamespace

from rich.console import Console

from discrepancy.study.command import _error_table

STAGES = ("as given", "recalibrated", "+ load_dependent_friction@gearbox.output_shaft.bearing_left")
OUTPUT = "gearbox.housing.acceleration_beside_the_left_bearing.vertical"


def _stage(name: str, size: float) -> SimpleNamespace:
    errors = {OUTPUT: 6.5453e-5 * size, "motor.torque": 0.054391 * size}
    return SimpleNamespace(
        name=name,
        outputs=tuple(errors),
        system=SimpleNamespace(unit=lambda name: "m/s^2"),
        fits=lambda part: (1,),
        rmse=lambda part: errors,
    )


def test_neither_names_nor_numbers_are_cut_at_80_columns() -> None:
    stages = [_stage(name, 1.0 / (k + 1)) for k, name in enumerate(STAGES)]
    console = Console(file=io.StringIO(), width=80)
    console.print(_error_table(stages))  # type: ignore[arg-type]
    lines = console.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    shown = "".join("".join(lines).split())  # long names go on in a second line
    assert "…" not in shown
    for text in ("6.545e-05", "2.182e-05", "0.05439", "0.01813"):
        assert shown.count(text) == 2
    names = [re.sub(r"\s[\d.]+(e-\d+)?\s+[\d.]+(e-\d+)?\s*$", "", line) for line in lines]
    words = "".join("".join(names).split())
    assert OUTPUT in words
    assert STAGES[2].replace(" ", "") in words
