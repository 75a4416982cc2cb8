"""An integration that cannot go on says where: component, equation, values, time and remedy; and it ends soon."""

from __future__ import annotations

import importlib.util
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from discrepancy.residual import initial_state
from estimation import Record
from estimation.files.record import RecordedSignal
from estimation.response.experiment import Experiment
from multibody import Model
from multibody.base.errors import SimulationError, Stop
from multibody.library import Mass
from multibody.solvers import scipy_methods
from multibody.solvers.limits import RUNAWAY
from multibody.system.not_finite import not_finite

PART = """
import math
from multibody import Component
from multibody.declare.declarations import Output, Parameter, Power, Translation

class Odd(Component):
    "A force that breaks."
    k = Parameter(1.0, "N", "size")
    flange = Translation("the flange")
    power = Power(kind="supply", meaning="power brought in")
    shown = Output("N", "what is shown")

    def equations(self):
        x = self.flange.position
        v = self.flange.velocity
        k = self.k
        self.flange.force = FORCE
        self.power = self.flange.force * v
        self.shown = SHOWN
"""


@pytest.fixture
def model(tmp_path: Path):
    """Return a mass, at one metre, on which an odd force acts."""
    names = []

    def make(force: str, shown: str = "k", mass: float = 1.0) -> Model:
        path = tmp_path / f"odd_part_{len(names)}.py"
        path.write_text(PART.replace("FORCE", force).replace("SHOWN", shown))
        spec = importlib.util.spec_from_file_location(path.stem, path)
        module = importlib.util.module_from_spec(spec)
        sys.modules[path.stem] = module
        names.append(path.stem)
        spec.loader.exec_module(module)
        machine = Model("machine")
        body = machine.add("body", Mass(m=mass, position=1.0))
        odd = machine.add("odd", module.Odd())
        machine.connect(odd.flange, body.flange)
        machine.output("shown", odd.shown)
        return machine

    yield make
    for name in names:
        del sys.modules[name]


BORN = {
    "a division by zero": ("k / (x - 1.0)", ["divides by zero at t = 0 s", "odd.x = 1", "give 'odd.x - 1.0' a value"]),
    "zero over zero": ("k * 0.0 / (0.0 * x)", ["divides by zero", "'0.0 * odd.x'"]),
    "a root of a negative number": ("k * math.sqrt(-x)", ["a root or a logarithm where there is none", "max(…, 0.0)"]),
    "a root on the way": ("-k * math.sqrt(x)", ["a root or a logarithm", "at t = 1.49367 s", "odd.x = -"]),
    "a logarithm of zero": ("k * math.log(x - 1.0)", ["a root or a logarithm where there is none"]),
    "an overflow": ("k * math.exp(1000.0 * x)", ["is beyond the largest number", "check the sizes of these values"]),
    "infinity less infinity": ("(1e300 * x * 1e300) - (1e300 * x * 1e300)", ["(NaN)", "check the sizes"]),
}


@pytest.mark.parametrize(("force", "says"), BORN.values(), ids=BORN)
def test_the_equation_and_its_component_are_named(model, force: str, says: list[str]) -> None:
    with pytest.raises(SimulationError) as error:
        model(force).build().simulate(10.0)
    for text in ["component 'odd' (Odd): the equation 'odd.flange.force = ", *says]:
        assert text in str(error.value)
    assert error.value.stop is Stop.NOT_FINITE


def test_a_mass_of_zero_is_named(model) -> None:
    with pytest.raises(SimulationError, match=r"give what moves at 'body.flange' a mass or an inertia above zero"):
        model("-k", mass=0.0).build().simulate(1.0)


def test_a_state_that_is_not_finite_and_an_output_are_named(model) -> None:
    system = model("-k", shown="2.0 * math.sqrt(x) + k").build()
    told = not_finite(system, 0.5, np.array([-1.0, 0.0]), system.u, system.p, "outputs")
    assert "component 'odd' (Odd): the equation 'odd.shown = 2.0 * math.sqrt(odd.x) + odd.k'" in told
    assert not_finite(system, 0.5, np.array([1.0, 0.0]), system.u, system.p, "outputs") == ""
    assert "state 'body.velocity' is nan" in not_finite(system, 0.0, np.array([1.0, np.nan]), system.u, system.p)


def test_a_model_that_runs_away_is_told_so(model) -> None:
    with pytest.raises(
        SimulationError, match=r"state 'body\.\w+' has reached .* the model runs away; check the sign"
    ) as error:
        model("1e9 * x").build().simulate(10.0)
    assert error.value.stop is Stop.NOT_FINITE
    assert error.value.evaluations < 20_000  # it does not go on to the largest number, or to the end


def test_a_model_that_ends_beyond_all_bounds_has_run_away(model) -> None:
    far = np.log(2.0 * RUNAWAY)  # x = cosh(t)
    assert model("x").build().simulate(0.9 * far).states[-1, 0] > 1e26
    with pytest.raises(SimulationError, match="the model runs away"):
        model("x").build().simulate(1.1 * far)


def experiment() -> Experiment:
    time = 0.1 * np.arange(50)
    signals = {"odd.shown": RecordedSignal(values=np.sin(time), unit="N", column="shown", measured_unit="N")}
    record = Record(name="trip", path=Path("trip.csv"), time=time, signals=signals)
    return Experiment(record=record, inputs=(), outputs=("odd.shown",))


def simulated(model: Model) -> None:
    system = model.build()
    experiment().simulate(system, system.p)


@pytest.mark.parametrize(
    ("shown", "says"),
    [
        ("math.sqrt(x)", "the equation 'odd.shown = math.sqrt(odd.x)' takes a root or a logarithm where there is none"),
        ("math.exp(690.0 * x)", "output 'odd.shown' reaches 4."),
    ],
)
def test_an_output_that_cannot_be_compared_is_named_with_its_record(model, shown: str, says: str) -> None:
    with pytest.raises(SimulationError) as error:
        simulated(model("-k", shown=shown))
    assert says in str(error.value)
    assert "on record 'trip'" in str(error.value)
    assert error.value.stop is Stop.NOT_FINITE


def test_an_integration_of_hopelessly_small_steps_is_given_up(model) -> None:
    with pytest.raises(
        SimulationError, match="evaluations of the equations, more than the 2000000 allowed by then"
    ) as error:
        model("-1e18 * x").build().simulate(10.0)
    assert error.value.stop is Stop.TOO_MANY_EVALUATIONS
    with pytest.raises(SimulationError, match="more than the 2000000 allowed by then") as error:
        simulated(model("-1e18 * x"))
    assert error.value.stop is Stop.TOO_MANY_EVALUATIONS


@pytest.mark.parametrize(
    ("force", "says"),
    [
        ("-1e18 * x", r"the fastest is state 0 \('body.position'\), with a time constant of 1e-09 s"),
        ("-5.0 if v > 0.0 else 5.0", r"a time constant of 1e-0\d s|although no state is fast"),
    ],
)
def test_what_makes_the_steps_small_is_told(model, force: str, says: str) -> None:
    with pytest.raises(SimulationError, match=says):
        model(force).build().simulate(10.0)


def test_a_record_of_which_no_piece_can_be_simulated_is_given_up_at_the_second(model, monkeypatch) -> None:
    tried = []
    whole = initial_state.simulate
    monkeypatch.setattr(initial_state, "simulate", lambda *a, **k: (tried.append(a[1]), whole(*a, **k))[1])
    system = model("-5.0 if v > 0.0 else 5.0", shown="k * x").build()
    with pytest.raises(SimulationError, match=r"record 'trip': .* allowed by then") as error:
        initial_state.estimate_states(experiment(), system, system.p)
    assert error.value.stop is Stop.TOO_MANY_EVALUATIONS
    assert len(set(tried)) == 2


def test_pieces_that_are_slow_together_are_given_up(model, monkeypatch) -> None:
    monkeypatch.setattr(initial_state, "most_evaluations", lambda *_: 100_000)
    tried = []
    whole = initial_state.simulate
    monkeypatch.setattr(initial_state, "simulate", lambda *a, **k: (tried.append(a[1]), whole(*a, **k))[1])
    system = model("-1e10 * x", shown="k * x").build()
    told = r"record 'trip': .* more than the 200000 allowed by then, .*, and the fastest is state 'body.position', with"
    with pytest.raises(SimulationError, match=told) as error:
        initial_state.estimate_states(experiment(), system, system.p)
    assert error.value.stop is Stop.TOO_MANY_EVALUATIONS
    assert error.value.evaluations > 200_000
    assert len(set(tried)) < 5  # of five pieces


def test_a_method_of_scipy_has_the_same_limit(model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scipy_methods, "most_evaluations", lambda *_: 1000)
    with pytest.raises(SimulationError, match="1000 evaluations of the equations, more than the 1000 allowed by then"):
        model("-1e6 * x").build().simulate(10.0, method="RK45")


def test_the_error_keeps_its_reason_between_processes() -> None:
    error = pickle.loads(pickle.dumps(SimulationError("it stopped", Stop.STEP_TOO_SMALL, 7)))
    assert (str(error), error.stop, error.evaluations) == ("it stopped", Stop.STEP_TOO_SMALL, 7)
