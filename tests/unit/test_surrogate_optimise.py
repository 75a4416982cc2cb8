"""Optimisers: what they find, what they count, and what they refuse."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from surrogate import (
    METHODS,
    DesignSpace,
    FireflySettings,
    ResponseSurface,
    StopReason,
    compare_optimisers,
    local_maxima,
    maximise,
)

SPACE = DesignSpace(("a", "b"), ("m", "kg"), (-1.0, 0.0), (3.0, 10.0))
OPTIMUM = np.array([0.3, 6.0])


def hill(x):
    return 5.0 - (x[0] - 0.3) ** 2 - 0.1 * (x[1] - 6.0) ** 2


def hills(x):
    return np.array([hill(p) for p in x])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("vectorised", [False, True])
def test_every_method_finds_a_hill_within_its_budget(method, vectorised):
    calls = []

    def counted(x):
        calls.append(len(x) if vectorised else 1)
        return hills(x) if vectorised else hill(x)

    result = maximise(counted, SPACE, method=method, budget=1200, vectorised=vectorised, seed=3)
    assert result.value == pytest.approx(5.0, abs=1e-9)
    np.testing.assert_allclose(result.x, OPTIMUM, atol=1e-3)
    assert result.evaluations == sum(calls) <= 1200
    assert result.value == hill(result.x)


@pytest.mark.parametrize("method", METHODS)
def test_history_is_what_the_function_returned(method):
    seen = []

    def remembered(x):
        seen.append(hill(x))
        return seen[-1]

    result = maximise(remembered, SPACE, method=method, budget=500)
    running = np.maximum.accumulate(seen)
    assert [result.best_after(n) for n in range(1, len(seen) + 1)] == running.tolist()
    assert result.best_after(0) == -np.inf
    frame = result.to_frame()
    assert frame["evaluations"].iloc[-1] == len(seen)
    assert frame["best"].is_monotonic_increasing


@pytest.mark.parametrize("method", ["firefly", "differential_evolution", "multistart"])
def test_runs_repeat_with_the_seed_and_differ_without(method):
    a, b, c = (maximise(hill, SPACE, method=method, budget=300, seed=s, polish=0) for s in (1, 1, 2))
    assert a.improved_to.tolist() == b.improved_to.tolist()
    assert a.improved_to.tolist() != c.improved_to.tolist()
    assert maximise(hill, SPACE, budget=300, seed=np.random.default_rng(1), polish=0).value is not None


def test_vectorised_and_single_evaluation_walk_the_same_way():
    one = maximise(hill, SPACE, budget=400, seed=4)
    many = maximise(hills, SPACE, budget=400, seed=4, vectorised=True)
    with ThreadPoolExecutor(2) as pool:
        spread = maximise(hill, SPACE, budget=400, seed=4, executor=pool)
    assert one.improved_to.tolist() == many.improved_to.tolist() == spread.improved_to.tolist()


@pytest.mark.parametrize("attraction", ["exp(-gamma r)", "exp(-gamma r^2)"])
def test_firefly_moves_as_the_equation_says(attraction):
    """Two fireflies, no noise: the dimmer one moves by beta0 exp(-gamma r or r²) of the way (Eqs. 13, 14)."""
    seen = []
    cube = DesignSpace.unit_cube(("a", "b"))

    def remembered(x):
        seen.append(x.copy())
        return -((x - 0.2) ** 2).sum(axis=1)

    options = {
        "population": 2,
        "iterations": 1,
        "beta0": 0.7,
        "gamma": 1.5,
        "alpha": 0.0,
        "attraction": attraction,
    }
    maximise(remembered, cube, options=options, polish=0, vectorised=True, seed=8)
    before, after = seen
    bright = int(np.argmax(-((before - 0.2) ** 2).sum(axis=1)))
    away = before[bright] - before[1 - bright]
    r = np.linalg.norm(away)
    share = 0.7 * np.exp(-1.5 * (r if attraction == "exp(-gamma r)" else r**2))
    np.testing.assert_allclose(after[1 - bright], before[1 - bright] + share * away, rtol=1e-14)
    np.testing.assert_array_equal(after[bright], before[bright])


@pytest.mark.parametrize(
    ("steps", "mean", "deviation"), [("uniform", 0, 12**-0.5), ("gaussian", 0, 1), ("printed", -0.5, 1)]
)
def test_firefly_steps_have_the_moments_they_claim(steps, mean, deviation):
    """On a flat function nobody is brighter, so every firefly takes one random step."""
    seen = []
    cube = DesignSpace.unit_cube(("a",))
    options = {"population": 4000, "iterations": 1, "alpha": 0.02, "steps": steps}
    maximise(
        lambda x: (seen.append(x[:, 0].copy()), np.zeros(len(x)))[1],
        cube,
        options=options,
        polish=0,
        vectorised=True,
    )
    inner = np.abs(seen[0] - 0.5) < 0.35  # steps of 5 standard deviations never reach a bound from there
    step = (seen[1] - seen[0])[inner] / 0.02
    # Some 2800 steps: their mean has a standard error of 0.02, their deviation of 0.014; five of them.
    assert step.mean() == pytest.approx(mean, abs=0.1)
    assert step.std() == pytest.approx(deviation, abs=0.07)


def test_firefly_counts_population_times_iterations():
    result = maximise(hill, SPACE, options={"population": 30, "iterations": 100}, polish=0)
    assert result.evaluations == 30 * 101
    assert result.stopped is StopReason.ITERATIONS
    assert maximise(hill, SPACE, budget=300, polish=0).stopped is StopReason.BUDGET


def test_polish_never_lowers_and_uses_the_gradient_if_there_is_one():
    surface = ResponseSurface.from_coefficients(DesignSpace.unit_cube(("a", "b")), [0, 1, 1, -1, -1, 0.5], order=2)
    exact = maximise(surface, surface.space, budget=300)
    blind = maximise(surface.predict, surface.space, budget=300, vectorised=True)
    # Stationary point of a + b - a² - b² + ab/2: a = b = 2/3, value 2/3.
    for run in (exact, blind):
        assert run.value == pytest.approx(2 / 3, abs=1e-10)
        assert run.value >= run.value_before_polish
    assert exact.gradient_evaluations > 0
    assert blind.gradient_evaluations == 0


def test_parameters_at_a_bound_are_named():
    result = maximise(lambda x: x[0] - (x[1] - 5.0) ** 2, SPACE, budget=300)
    assert result.at_bound == ("a",)
    assert "at its bound: a" in repr(result)
    assert result.parameters["a"] == 3.0
    assert result.to_dict()["units"] == {"a": "m", "b": "kg"}


@pytest.mark.parametrize("method", METHODS)
def test_failed_evaluations_are_avoided_and_counted(method):
    def sometimes(x):
        return np.nan if x[0] > 0.5 else hill(x)

    result = maximise(sometimes, SPACE, method=method, budget=800)
    assert result.value == pytest.approx(5.0, abs=1e-4)  # L-BFGS-B cannot polish across a cliff
    assert result.failed > 0


def test_local_maxima_lists_the_rivals():
    def double(x):
        return np.exp(-20 * (x[0] - 0.2) ** 2) + 0.9 * np.exp(-20 * (x[0] - 0.9) ** 2)

    found = local_maxima(double, DesignSpace.unit_cube(("x",)), starts=20)
    np.testing.assert_allclose(found["x"], [0.2, 0.9], atol=5e-3)  # each tail moves the other's top a little
    assert found["value"].is_monotonic_decreasing
    assert found["starts"].sum() == pytest.approx(1.0)


def test_comparison_gives_every_method_the_same_budget():
    run = compare_optimisers(hills, SPACE, target=5.0, budget=400, seeds=range(3), vectorised=True)
    frame = run.to_frame()
    assert list(frame.index) == list(METHODS)
    assert (frame["evaluations"] <= 400).all()
    assert (frame["hit_rate"] == 1.0).all()
    assert frame.loc["direct", "runs"] == 1
    impossible = compare_optimisers(
        hills, SPACE, target=6.0, methods=["firefly"], budget=200, seeds=[0], vectorised=True
    )
    assert impossible.hit_rate("firefly") == 0.0
    assert np.isnan(impossible.to_frame().loc["firefly", "evaluations_to_target"])
    assert run.plot().axes[0].get_xlabel() == "evaluations"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "annealing"}, "unknown method 'annealing'; choose one of firefly"),
        ({"options": {"swarm": 3}}, "firefly has no option swarm; it has population"),
        ({"options": {"beta0": 2.0, "decay": 0.0}}, "beta0 must lie between 0 and 1.*decay must lie above 0"),
        ({"options": {"attraction": "r"}}, "attraction must be one of"),
        ({"method": "multistart", "options": {"starts": 0}}, "starts must be at least 1"),
        ({"budget": 20}, "budget of 20 evaluations .* less than one generation of 30"),
        ({"polish": -1}, "polish must be 0 or more"),
    ],
)
def test_bad_settings_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        maximise(hill, SPACE, **arguments)


def test_a_function_that_never_works_is_refused():
    with pytest.raises(ValueError, match="no finite number at any of"):
        maximise(lambda x: np.nan, SPACE, budget=200)
    with pytest.raises(ValueError, match=r"gradient at .* expected 2 finite numbers"):
        maximise(hill, SPACE, budget=200, gradient=lambda x: np.array([np.nan, 1.0]))


def test_settings_are_checked_on_their_own():
    with pytest.raises(ValueError, match="population must be at least 2, not 1"):
        FireflySettings(population=1)
