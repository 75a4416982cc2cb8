"""A model that is off by orders of magnitude is refused, before anything is concluded from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vtsdt.cli.command_line import main

MODEL = """
import multibody.library as lib
from multibody import Component, Model
from multibody.declare.declarations import Parameter, Translation


class Repeller(Component):
    "Pushes away from where it stands."
    rate = Parameter(0.0, "N/m", "force per distance")
    a = Translation("its place")
    b = Translation("what is pushed")

    def equations(self):
        force = self.rate * (self.b.position - self.a.position)
        self.b.force = force
        self.a.force = -force


def build(rate: float):
    m = Model("repelled")
    push, body = m.add("push", lib.ForceSource()), m.add("body", lib.Mass(m=1.0))
    guide, repeller = m.add("guide", lib.ViscousFriction(viscous=2.0)), m.add("repeller", Repeller(rate=rate))
    sensor = m.add("sensor", lib.PositionSensor())
    m.input("force", push.force)
    m.connect(push.flange, body.flange, guide.b, repeller.b, sensor.flange)
    m.connect(guide.a, m.ground)
    m.connect(repeller.a, m.ground)
    m.output("x", sensor.position)
    return m
"""

STUDY = """
[model]
build = "repelled.py:build"
arguments = { rate = RATE }
[uncertain]
"guide.viscous" = { std = 1.0, min = 0.0 }
[inputs]
force = "force"
[outputs]
x = { column = "x" }
[records]
time = "time"
identify = ["a.csv"]
"""


def compared(folder: Path, rate: float, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Compare a mass that is held by a spring of 400 N/m with a model in which it is pushed away."""
    from scipy.integrate import solve_ivp

    time = 2e-3 * np.arange(1000)
    force = 20.0 * np.sin(7.0 * time) + 10.0 * np.sin(23.0 * time)
    run = solve_ivp(
        lambda t, x: (x[1], np.interp(t, time, force) - 2.0 * x[1] - 400.0 * x[0]),
        (0.0, time[-1]),
        (0.0, 0.0),
        t_eval=time,
        max_step=2e-3,
    )
    x = run.y[0] + 1e-5 * np.random.default_rng(1).standard_normal(time.size)
    np.savetxt(
        folder / "a.csv",
        np.column_stack([time, force, x]),
        delimiter=",",
        header="time,force,x",
        comments="",
        fmt="%.9g",
    )
    (folder / "repelled.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY.replace("RATE", f"{rate:g}"))
    code = main(["compare", str(folder / "study.toml"), "--out", str(folder / "out")])
    return code, capsys.readouterr().err


@pytest.mark.filterwarnings("error")
def test_an_unstable_model_is_compared_by_its_forces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, told = compared(tmp_path, 4e5, capsys)
    assert "state 'body." in told
    assert "the model runs away; check the sign of its feedback, stiffness and damping" in told
    assert code == 0
    assert (tmp_path / "out" / "comparison.json").exists()


@pytest.mark.filterwarnings("error")
def test_errors_beyond_belief_end_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, told = compared(tmp_path, 4e9, capsys)
    assert "'force': the error after calibration is" in told
    assert "no comparison with these records can be believed" in told
    assert code == 2
    assert not (tmp_path / "out" / "comparison.json").exists()
