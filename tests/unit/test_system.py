"""Systems: the same motion by every method, inputs of every kind, failures with time and state."""

from __future__ import annotations

import math

import numpy as np
import pytest

from multibody import Component, Input, Model, ModelError, Output, SimulationError, State
from multibody.library import Damper, ForceSource, Mass, Spring
from multibody.solvers.run import integrate
from multibody.system.simulate import NATIVE, SCIPY


def driven(**options):
    model = Model("driven")
    body, spring, damper = (
        model.add("body", Mass(m=2.0)),
        model.add("spring", Spring(stiffness=50.0)),
        model.add("damper", Damper(damping=1.0)),
    )
    push = model.add("push", ForceSource())
    model.connect(spring.a, damper.a, model.ground)
    model.connect(spring.b, damper.b, body.flange, push.flange)
    model.input("force", push.force)
    model.output("wall", "spring.tension")
    return model.build(**options)


@pytest.fixture(scope="module")
def system():
    return driven()


@pytest.fixture(scope="module")
def plain():
    return driven(compiled=False)


def exact(t, force=3.0, m=2.0, k=50.0, c=1.0):
    """Step response of the damped oscillator."""
    w, d = math.sqrt(k / m), c / (2 * math.sqrt(k * m))
    wd = w * math.sqrt(1 - d * d)
    decay = np.exp(-d * w * t)
    return force / k * (1 - decay * (np.cos(wd * t) + d * w / wd * np.sin(wd * t)))


@pytest.mark.parametrize("method", [*SCIPY, *NATIVE, "auto"])
def test_every_method_gives_the_closed_form(system, method):
    run = system.simulate(2.0, inputs={"force": 3.0}, method=method, rtol=1e-8, atol=1e-11)
    # a few hundred times the tolerance: what accumulates over some hundred steps of low-order methods
    assert run["body.position"] == pytest.approx(exact(run.times), abs=3e-6)
    assert run.statistics["method"] == ("Automatic" if method == "auto" else method)


@pytest.mark.parametrize("method", ["DormandPrince54", "RK45"])
def test_plain_python_gives_the_same_numbers(system, plain, method):
    runs = [s.simulate(0.5, inputs={"force": 3.0}, method=method, step=0.1) for s in (system, plain)]
    assert runs[0].states == pytest.approx(runs[1].states, rel=1e-13, abs=1e-15)
    assert runs[0].outputs == pytest.approx(runs[1].outputs, rel=1e-13, abs=1e-12)


def test_inputs_as_number_table_and_function(system):
    t = np.linspace(0.0, 1.0, 201)
    by_table = system.simulate(1.0, inputs={"force": (t, np.sin(9.0 * t))}, step=0.05, rtol=1e-8)
    by_function = system.simulate(1.0, inputs={"force": lambda t: math.sin(9.0 * t)}, step=0.05, rtol=1e-8)
    # linear interpolation of 200 samples is off by at most (9·0.005)²/8 = 2.5e-4 of the force
    assert by_table["body.position"] == pytest.approx(by_function["body.position"], abs=2.5e-4 * 3 / 50)
    assert by_function.statistics["method"] == "LSODA"
    assert by_function["force"] == pytest.approx(np.sin(9.0 * by_function.times))
    assert system.simulate(1.0, inputs={"force": 3.0})["force"] == pytest.approx(np.full(1001, 3.0))


@pytest.mark.parametrize("method", ["DormandPrince54", "RK45"])
def test_the_step_never_jumps_over_a_sample(system, method):
    """A pulse one sample wide in a long rest is seen whatever the tolerance."""
    t = np.linspace(0.0, 20.0, 2001)
    pulse = np.where(np.abs(t - 12.0) < 0.005, 100.0, 0.0)
    run = system.simulate(20.0, inputs={"force": (t, pulse)}, rtol=1e-2, method=method, step=0.01)
    assert np.max(np.abs(run["body.velocity"])) == pytest.approx(100.0 * 0.01 / 2.0, rel=0.05)


def test_missing_unknown_and_broken_inputs_are_reported_together():
    model = Model("two")
    body = model.add("body", Mass(m=1.0))
    for name in ("one", "two", "three"):
        push = model.add(name, ForceSource())
        model.connect(push.flange, body.flange)
        model.input(f"f.{name}", push.force)
    with pytest.raises(SimulationError) as caught:
        model.build(compiled=False).simulate(
            1.0,
            inputs={
                "f.ome": 1.0,
                "f.two": ([0.0, 0.0], [1.0, 2.0]),
                "f.three": ([0.0, 1.0], [1.0, math.nan]),
            },
        )
    for words in (
        "no input 'f.ome'; did you mean 'f.one'",
        "input 'f.one' (N) is missing",
        "times must increase",
        "1 values are not finite",
    ):
        assert words in str(caught.value)


def test_values_by_name_in_any_unit(system):
    run = system.simulate(
        0.1,
        inputs={"force": 0.0},
        parameters={"body.m": "2500 g"},
        initial={"body.position": "3 mm"},
        step=0.1,
    )
    assert run.p[system.index("parameter", "body.m")] == 2.5
    assert run["body.position"][0] == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"parameters": {"body.mass": 1.0}}, "no parameter 'body.mass'; did you mean 'body.m'?"),
        ({"parameters": {"body.m": -1.0}}, "outside its bounds"),
        ({"parameters": {"body.m": "3 m"}}, "cannot be converted"),
        ({"parameters": {"body.m": math.nan}}, "give a finite number"),
        ({"parameters": np.ones(2)}, "the array has the shape (2,)"),
        ({"initial": {"body.positon": 1.0}}, "no state 'body.positon'; did you mean 'body.position'?"),
        ({"initial": np.zeros(5)}, "there are 2 states, the array has the shape (5,)"),
        ({"method": "Euler"}, "no method 'Euler': take one of auto"),
        ({"times": np.array([0.0, 2.0])}, "lie between 0 s and 1 s"),
        ({"times": np.array([0.5, 0.1])}, "times must increase"),
        ({"step": -0.1}, "the step is -0.1 s, it must be positive"),
        (
            {"method": "DormandPrince54", "inputs": {"force": math.sin}},
            "cannot call the function given for 'force'",
        ),
    ],
)
def test_arguments_that_do_not_fit_are_refused(plain, arguments, words):
    with pytest.raises((ModelError, SimulationError)) as caught:
        plain.simulate(1.0, **{"inputs": {"force": 1.0}, **arguments})
    assert words in str(caught.value)


def test_end_before_start(plain):
    with pytest.raises(SimulationError, match="the end 1 s must be later than the start 2 s"):
        plain.simulate((2.0, 1.0), inputs={"force": 1.0})


class Runaway(Component):
    """Its state grows as x' = x², which is infinite after 1/x(0)."""

    x = State("m", "runs away", start=2.0)
    y = Output("m", "x")

    def equations(self):
        self.der.x = self.x**2
        self.y = self.x


class Broken(Component):
    """Divides by a state that passes zero."""

    x = State("m", "falls", start=1.0)
    z = State("m", "follows")

    def equations(self):
        self.der.x = -1.0
        self.der.z = math.log(self.x)


@pytest.mark.parametrize("method", ["DormandPrince54", "RK45", "LSODA", "Radau"])
@pytest.mark.parametrize(("component", "time"), [(Runaway, 0.5), (Broken, 1.0)])
def test_failing_integration_says_when_and_in_which_state(method, component, time):
    import re
    import warnings

    model = Model("m")
    model.add("part", component())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LSODA warns as well
        with pytest.raises(SimulationError) as caught:
            model.build(compiled=method == "DormandPrince54").simulate(2.0, method=method)
    message = str(caught.value)
    assert "'m': " + method in message
    assert "part." in message
    stopped = float(re.search(r"between t = ([\d.e+-]+) s", message)[1])
    assert stopped == pytest.approx(time, abs=0.01)  # the last sample before, of 1001 over 2 s
    assert "Last good state: part.x = " in message


def test_a_model_without_states_can_be_simulated():
    model = Model("m")
    held, spring = (
        model.add("held", Mass(m=1.0, free=False, position=0.2)),
        model.add("spring", Spring(stiffness=10.0)),
    )
    model.connect(spring.a, model.ground)
    model.connect(spring.b, held.flange)
    run = model.build(compiled=False).simulate(1.0, step=0.5)
    assert run["spring.tension"] == pytest.approx([2.0, 2.0, 2.0])


def test_events(system):
    def falls(t, x):
        return x[1]

    falls.direction = -1
    for method in ("DormandPrince54", "RK45"):
        run = system.simulate(2.0, inputs={"force": 3.0}, method=method, events=falls, rtol=1e-8)
        w = math.sqrt(25.0) * math.sqrt(1 - 0.05**2)
        assert run.statistics["events"][0][0] == pytest.approx(math.pi / w, abs=1e-5)


# ------------------------------------------------------------------ equilibrium, linearisation, colours


def test_equilibrium(plain):
    rest = plain.equilibrium(inputs={"force": 10.0})
    assert rest["body.position"] == pytest.approx(0.2, rel=1e-12)
    assert rest.to_frame().loc["body.position", "unit"] == "m"
    run = plain.simulate(1.0, inputs={"force": 10.0}, initial=rest.to_dict(), method="RK45")
    assert run["body.position"] == pytest.approx(np.full(1001, 0.2))


def test_no_equilibrium_says_what_remains():
    model = Model("free")
    body, push = model.add("body", Mass(m=2.0)), model.add("push", ForceSource())
    model.connect(push.flange, body.flange)
    model.input("force", push.force)
    with pytest.raises(SimulationError) as caught:
        model.build(compiled=False).equilibrium(inputs={"force": 10.0})
    assert "d/dt body.velocity = 5 m/s/s" in str(caught.value)
    assert "force that nothing balances" in str(caught.value)


def test_equilibrium_that_is_not_unique_is_the_one_nearest_to_the_guess():
    model = Model("free")
    model.add("body", Mass(m=2.0))
    assert model.build(compiled=False).equilibrium(guess={"body.position": 0.7})["body.position"] == 0.7


def test_unknown_input_of_an_analysis(plain):
    for analysis in (plain.equilibrium, plain.linearize):
        with pytest.raises(ModelError, match="no input 'forse'; did you mean 'force'"):
            analysis(inputs={"forse": 1.0})


def test_linearisation_is_the_closed_form(plain):
    linear = plain.linearize()
    assert pytest.approx(np.array([[0.0, 1.0], [-25.0, -0.5]])) == linear.A
    assert pytest.approx(np.array([[0.0], [0.5]])) == linear.B
    row = plain.index("output", "wall")
    assert linear.C[row] == pytest.approx([50.0, 0.0])
    assert linear.D[row] == pytest.approx([0.0])
    modes = linear.modes()
    assert modes["frequency [Hz]"].iloc[0] == pytest.approx(5.0 / (2 * math.pi))
    assert modes["damping ratio [1]"].iloc[0] == pytest.approx(0.05)


class Follower(Component):
    u = Input("m", "followed")
    s = State("m", "lag")
    y = Output("m", "lag")

    def equations(self):
        self.der.s = self.u - self.s
        self.y = self.s


def test_columns_of_one_colour_share_no_row():
    model = Model("row")
    for k in range(12):
        model.add(f"f{k}", Follower())
        if k:
            model.connect(f"f{k - 1}.y", f"f{k}.u")
    model.input("u", "f0.u")
    system = model.build(compiled=False)
    for colour in set(system.colours):
        assert np.all(system.sparsity[:, system.colours == colour].sum(axis=1) <= 1)
    assert len(set(system.colours)) == 2


def test_names_and_units(plain):
    assert plain.unit("wall") == "N"
    assert plain.unit("body.m") == "kg"
    with pytest.raises(KeyError, match=r"no quantity 'wal'; did you mean 'wall'"):
        plain.unit("wal")
    with pytest.raises(KeyError, match=r"no state 'body.positon'; did you mean 'body.position'"):
        plain.index("state", "body.positon")


def test_energy_balance_is_exact(system):
    run = driven(energy=True).simulate(2.0, inputs={"force": 3.0}, rtol=1e-10, atol=1e-12)
    balance = run["energy.stored"] - run["energy.supplied"] + run["energy.lost"]
    assert np.max(np.abs(balance)) < 1e-8


def test_only_chosen_outputs_are_computed():
    system = driven(outputs=["wall"], compiled=False)
    assert system.output_names == ("wall",)
    assert system.simulate(0.1, inputs={"force": 1.0}, method="RK45")["wall"].size == 1001


def test_no_step_jumps_over_a_declared_feature():
    model = Model("slide")
    body = model.add("body", Mass(m=1.0, velocity=2.0))
    spring = model.add("spring", Spring(stiffness=1e-3))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    free = model.build().simulate(1.0, method="Rodas5P")
    model.feature("joint", 0.02, "body.velocity")
    model.feature("absent", 1e-9, "no.such_signal")
    held = model.copy("other").build().simulate(1.0, method="Rodas5P")
    assert free.statistics["longest_step"] > 0.05
    assert held.statistics["longest_step"] <= 0.5 * 0.02 / held["body.velocity"].min()
    fine = model.build().simulate(1.0, method="Rodas5P", rtol=1e-13, atol=1e-16, max_step=1e-3)
    assert fine["body.position"][-1] == pytest.approx(held["body.position"][-1], rel=1e-6)


@pytest.mark.parametrize("method", ["auto", "DormandPrince54", "Rodas5P", "Exponential43"])
def test_steps_are_limited_at_the_speed_of_each_step_and_the_run_is_made_once(method, monkeypatch):
    model = Model("start from rest")
    body = model.add("body", Mass(m=1.0))
    push = model.add("push", ForceSource())
    model.input("force", push.force, default=0.5)
    model.connect(push.flange, body.flange)
    free = model.build().simulate(4.0, method=method)
    model.feature("joint", 0.02, "body.velocity")
    runs, ends = [], []

    def recorded(problem, *arguments, **options):
        runs.append(problem)
        marks = [lambda t, x: ends.append((t, x[1])) or 1.0]  # with events every call takes one step
        return integrate(problem, *arguments, **{**options, "events": marks})

    monkeypatch.setattr("multibody.solvers.run.integrate", recorded)
    held = model.copy("other").build().simulate(4.0, method=method)
    t, v = np.unique(np.array(ends), axis=0).T
    assert len(runs) == 1
    assert free.statistics["longest_step"] > 0.5
    steps, slow = np.diff(t), np.maximum(v[:-1], 1e-12)
    assert np.all(steps <= 1.0001 * np.minimum(0.01 / slow, 0.02 / v[1:]))
    assert steps.max() > 5.0 * steps[-1]  # where it is slow, steps are long
    assert held["body.position"][-1] == pytest.approx(4.0, rel=1e-6)


def test_points_that_differ_by_rounding_are_one_feature():
    from multibody.system.narrow_features import _least_distance

    assert _least_distance((0.0, 1.0, 1.0 + 4e-16, 3.0)) == pytest.approx(1.0)
    assert _least_distance((0.0, 0.25, 2.0)) == pytest.approx(0.25)
