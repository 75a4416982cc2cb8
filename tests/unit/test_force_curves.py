"""What a force is a function of: position, speed, direction or time; its period and its law."""

import numpy as np
import pytest

from discrepancy.questions.force_curves import explain_force
from discrepancy.questions.simple_laws import suggest_laws
from discrepancy.questions.unknown_force import describe_force
from discrepancy.stages.force_estimate import ForceEstimate
from discrepancy.statistics.hat_functions import quantile_knots
from discrepancy.statistics.periodicity import find_period, split_directions
from discrepancy.validation import linear_axes


@pytest.fixture(scope="module")
def run():
    rng = np.random.default_rng(3)
    axis = linear_axes.make_axis(rng, 6)
    cat = np.concatenate
    noise = cat(
        [3 * linear_axes._ou(rng, 1200, 0.1, 0.005) + 2 * linear_axes._ou(rng, 1200, 2.0, 0.005) for _ in range(6)]
    )
    reg = {
        "position": cat([m.x for m in axis.motions]),
        "speed": cat([m.v for m in axis.motions]),
        "time": cat([np.arange(1200) * 0.005 for _ in range(6)]),
    }
    return reg, noise, np.repeat(np.arange(6), 1200)


def force(reg, kind):
    x, v = reg["position"], reg["speed"]
    return {
        "none": 0 * x,
        "bump": -20 * np.exp(-0.5 * ((x - 0.1) / 0.05) ** 2),
        "coulomb": -8 * np.tanh(v / 0.004),
        "periodic": 8 * np.cos(2 * np.pi * x / 0.08),
        "turning": -30 * x * np.tanh(v / 0.004),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "regressor", "parity"),
    [
        ("bump", "position", "even"),
        ("coulomb", "direction", "even"),
        ("periodic", "position", "even"),
        ("turning", "position", "odd"),
    ],
)
def test_regressor_is_found(run, kind, regressor, parity):
    reg, noise, blocks = run
    r = explain_force(force(reg, kind) + noise, reg, blocks=blocks, draws=60)
    assert r.best is not None
    assert (r.best.regressor, r.best.parity) == (regressor, parity)
    assert regressor in r.statement


def test_noise_follows_nothing(run):
    reg, noise, blocks = run
    assert explain_force(noise, reg, blocks=blocks, draws=60).best is None


def test_period_of_a_ripple(run):
    reg, noise, blocks = run
    period, share, p = find_period(force(reg, "periodic") + noise, reg["position"], blocks=blocks, draws=60)
    assert period == pytest.approx(0.08, rel=0.02)  # the grid of periods has steps of about 1 % here
    assert share > 0.5
    assert p < 0.02


def test_law_of_a_bump_and_its_curve(run):
    reg, noise, blocks = run
    f = force(reg, "bump") + noise
    r = explain_force(f, {"position": reg["position"]}, direction=np.sign(reg["speed"]), blocks=blocks, draws=60)
    c = r.best.curve
    assert abs(c.grid[np.argmin(c.value)] - 0.1) < 0.05
    best = suggest_laws(f, reg["position"], c, blocks=blocks)[0]
    assert best.name == "bump"
    assert best.parameters["m"] == pytest.approx(0.1, abs=0.06)  # places lie 0.1 m apart or less


def test_parts_of_direction():
    x = np.tile(np.linspace(0, 1, 500), 2)
    d = np.repeat([1.0, -1.0], 500)
    knots, even, odd = split_directions(2 * x + 3 * d, x, d, 6)
    np.testing.assert_allclose(even[1:-1], 2 * knots[1:-1], atol=0.02)
    np.testing.assert_allclose(odd, 3.0, atol=1e-6)


def test_faults_of_input():
    with pytest.raises(ValueError, match="has 3 values for 100"):
        explain_force(np.zeros(100), {"x": np.zeros(3)})
    with pytest.raises(ValueError, match="constant"):
        explain_force(np.ones(100), {"x": np.zeros(100)})


def test_knots_of_a_machine_that_creeps_before_it_moves_lie_apart() -> None:
    # most of the distinct positions lie in a billionth of the range
    creep = 1e-9 * np.linspace(0.0, 1.0, 900)
    knots = quantile_knots(np.concatenate([creep, np.linspace(0.0, 1.0, 300)]), 12)
    assert np.diff(knots).min() >= 5e-4


def test_knots_do_not_depend_on_the_unit() -> None:
    values = np.random.default_rng(3).normal(size=500)
    np.testing.assert_allclose(quantile_knots(1e-9 * values, 12), 1e-9 * quantile_knots(values, 12), rtol=1e-9)


def test_a_force_at_few_instants_is_not_said_to_follow_anything():
    n = 50
    time = np.linspace(0.0, 1.0, n)
    few = ForceEstimate(
        where="guide",
        unit="N",
        time=time,
        force=np.sin(time),
        std=np.ones(n),
        record=np.zeros(n, dtype=int),
        motion={"position": time, "speed": np.ones(n), "time": time},
        units={"position": "m", "speed": "m/s", "time": "s"},
        memory=0.01,
        known=0.9,
        log_likelihood=5.0,
    )
    described = describe_force(None, few)  # the search is only told of progress where there is something to do
    assert described.report is None
    assert described.sentence == (
        "The force at guide is estimated at 50 instants, which are too few to say what it depends on (at least 64): "
        "take longer records."
    )
    assert described.to_dict()["depends_on"] is None
