"""Trajectories: signals by name, units in tables and on axes."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model
from multibody.library import ForceSource, Mass, Spring


@pytest.fixture(scope="module")
def run():
    model = Model("m")
    body, spring, push = (
        model.add("body", Mass(m=1.0, position=0.1)),
        model.add("spring", Spring(stiffness=100.0)),
        model.add("push", ForceSource()),
    )
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange, push.flange)
    model.input("force", push.force, default=0.0)
    model.output("wall", spring.tension)
    return model.build(compiled=False).simulate(1.0, method="RK45", rtol=1e-8, atol=1e-10, step=0.01)


def test_signals_by_name(run):
    assert run["body.position"] == pytest.approx(0.1 * np.cos(10.0 * run.times), abs=1e-6)
    assert run["wall"] == pytest.approx(100.0 * run["body.position"])
    assert run["force"] == pytest.approx(np.zeros(run.times.size))
    assert run.unit("wall") == "N"
    assert set(run.names) >= {
        "force",
        "body.position",
        "body.velocity",
        "body.acceleration",
        "wall",
        "energy.stored",
    }
    with pytest.raises(KeyError, match=r"no signal 'body.positon'; did you mean 'body.position'"):
        run["body.positon"]


def test_frame_has_units_in_its_columns(run):
    frame = run.to_frame()
    assert frame.index.name == "time [s]"
    assert {"body.position [m]", "body.velocity [m/s]", "wall [N]", "energy.stored [J]", "force [N]"} <= set(
        frame.columns
    )
    assert frame.columns.is_unique
    assert frame["wall [N]"].to_numpy() == pytest.approx(run["wall"])
    assert list(run.to_frame(["wall"]).columns) == ["wall [N]"]


def test_plot_has_units_on_its_axes(run):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure = run.plot(["body.position", "wall", "spring.tension"])
    assert [a.get_ylabel() for a in figure.axes] == ["position [m]", "value [N]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert [t.get_text() for t in figure.axes[1].get_legend().get_texts()] == ["wall", "spring.tension"]
    plt.close(figure)
    figure, axes = plt.subplots()
    assert run.plot(["wall"], axes) is figure
    plt.close(figure)


def test_plot_into_too_few_axes_says_so(run):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    with pytest.raises(ValueError, match="2 units need 2 panels, 1 given"):
        run.plot(["body.position", "wall"], axes)
    plt.close(figure)


def test_trajectory_shows_what_it_is(run):
    assert repr(run) == (f"Trajectory('m': 101 samples from 0 s to 1 s, {len(run.system.output_names)} outputs, RK45)")
