"""Least squares with corrected Jacobians ends where SciPy's does, and asks for few Jacobians."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from estimation.fit.least_squares import AT_LIMIT, Piece, solve

T = np.linspace(0.0, 4.0, 200)


def decay(x):
    """Amplitude, rate and frequency of a ringing."""
    return x[0] * np.exp(-x[1] * T) * np.cos(x[2] * T)


def problem(data, own=0.3):
    """Two pieces: the second has an unknown of its own."""

    def residuals(x):
        return [decay(x) - data, decay(x) + x[3] - data - own]

    def jacobian(x):
        e, c, s = np.exp(-x[1] * T), np.cos(x[2] * T), np.sin(x[2] * T)
        return np.column_stack([e * c, -T * x[0] * e * c, -T * x[0] * e * s])

    def pieces(x):
        j = jacobian(x)
        first, second = residuals(x)
        yield Piece(j, np.array([0, 1, 2]), first)
        yield Piece(np.column_stack([j, np.ones_like(T)]), np.array([0, 1, 2, 3]), second)

    return residuals, pieces


def fitted(low=-np.inf, **options):
    data = decay([2.0, 0.7, 5.0]) + 0.01 * np.random.default_rng(3).standard_normal(T.size)
    residuals, pieces = problem(data)
    start, bounds = np.array([1.5, 0.4, 4.6, 0.0]), (np.array([low, -9, -9, -9.0]), np.full(4, 9.0))
    mine = solve(residuals, pieces, start, *bounds, **options)
    theirs = least_squares(
        lambda x: np.concatenate(residuals(x)),
        np.maximum(start, bounds[0] + 1e-9),
        bounds=bounds,
        xtol=1e-12,
        ftol=1e-14,
    )
    return mine, theirs


def test_it_ends_where_scipy_ends():
    mine, theirs = fitted(tolerance=1e-10)
    assert mine.cost == pytest.approx(theirs.cost, rel=1e-8)
    assert mine.x == pytest.approx(theirs.x, rel=1e-5)


def test_a_bound_holds_and_the_rest_settles_on_it():
    mine, theirs = fitted(low=2.5, tolerance=1e-10)
    assert mine.x[0] == 2.5
    assert mine.cost <= theirs.cost * (1.0 + 1e-6)


def test_corrected_jacobians_save_new_ones():
    mine, _ = fitted(tolerance=1e-7)
    assert mine.evaluations >= mine.jacobians + 2


@pytest.mark.parametrize(("steepness", "most"), [(100.0, 25), (1000.0, 60)])
def test_steps_follow_a_curved_valley(steepness, most):
    """Rosenbrock's valley, the steeper the narrower: straight steps need 40 and 162 Jacobians."""

    def residuals(x):
        return [np.array([steepness * (x[1] - x[0] ** 2), 1.0 - x[0]])]

    def pieces(x):
        slopes = np.array([[-2.0 * steepness * x[0], steepness], [-1.0, 0.0]])
        yield Piece(slopes, np.array([0, 1]), residuals(x)[0])

    bounds = np.full(2, -9.0), np.full(2, 9.0)
    solution = solve(residuals, pieces, np.array([-1.5, 1.0]), *bounds, tolerance=1e-9, max_evaluations=1000)
    assert solution.x == pytest.approx([1.0, 1.0], abs=1e-9)
    assert solution.jacobians <= most


def test_a_failed_simulation_is_a_bad_step_and_not_the_end():
    data = decay([2.0, 0.7, 5.0])
    residuals, pieces = problem(data)

    def fragile(x):
        return None if x[1] > 0.75 else residuals(x)

    found = solve(fragile, pieces, np.array([1.0, 0.1, 4.8, 0.0]), np.full(4, -9.0), np.full(4, 9.0), tolerance=1e-9)
    assert found.x[:3] == pytest.approx([2.0, 0.7, 5.0], rel=1e-3)


def test_without_confirmation_it_still_ends_near_the_minimum():
    mine, theirs = fitted(tolerance=1e-4, confirm=False)
    assert mine.cost <= theirs.cost * (1.0 + 2e-3)


def test_a_large_unknown_at_its_bound_does_not_hold_up_a_small_one():
    """Newtons at a bound and a micrometre that still has to move: steps are measured by what they change."""

    def residuals(x):
        return [1e5 * (x[1] - 4e-6) * np.ones(50) + 1e-6 * (x[0] - 1e5) * T[:50]]

    def pieces(x):
        yield Piece(np.column_stack([1e-6 * T[:50], np.full(50, 1e5)]), np.array([0, 1]), residuals(x)[0])

    low, high = np.array([4e5, -1.0]), np.array([9e5, 1.0])
    found = solve(residuals, pieces, np.array([4e5, 0.0]), low, high, tolerance=1e-4)
    exact = least_squares(
        lambda x: residuals(np.array([4e5, 1e-6 * x[0]]))[0], [0.0], x_scale=1.0, xtol=1e-14, ftol=1e-14
    )
    assert found.x[0] == 4e5
    assert found.x[1] == pytest.approx(1e-6 * exact.x[0], rel=1e-3)


def brown_dennis(x):
    """Moré, Garbow and Hillstrom (1981), ACM TOMS 7, 17: problem 16, minimum 85822.2 (of the whole sum of squares)."""
    t = np.arange(1, 21) / 5.0
    first, second = x[0] + t * x[1] - np.exp(t), x[2] + x[3] * np.sin(t) - np.cos(t)
    one = np.ones_like(t)
    jacobian = np.column_stack([2 * first, 2 * first * t, 2 * second * one, 2 * second * np.sin(t)])
    return first**2 + second**2, jacobian


def jennrich_sampson(x):
    """The same collection's problem 6, minimum 124.362."""
    i = np.arange(1, 11)
    a, b = np.exp(i * x[0]), np.exp(i * x[1])
    return 2.0 + 2.0 * i - a - b, np.column_stack([-i * a, -i * b])


@pytest.mark.parametrize(
    ("of", "start", "minimum"),
    [(brown_dennis, [25.0, 5.0, -5.0, -1.0], 85822.2), (jennrich_sampson, [0.3, 0.4], 124.362)],
)
def test_large_residuals_teach_their_curvature(of, start, minimum, monkeypatch):
    def run():
        def pieces(x):
            residual, jacobian = of(x)
            yield Piece(jacobian, np.arange(x.size), residual)

        bound = np.full(len(start), 1e6)
        return solve(lambda x: [of(x)[0]], pieces, np.array(start), -bound, bound, tolerance=1e-10, max_evaluations=100)

    learned = run()
    assert 2.0 * learned.cost == pytest.approx(minimum, rel=1e-5)
    monkeypatch.setattr("estimation.fit.least_squares._updated_curvature", lambda curvature, *rest: curvature)
    assert learned.jacobians < run().jacobians


def test_a_fit_goes_on_with_the_pieces_that_it_ended_with():
    data = decay([2.0, 0.7, 5.0]) + 0.01 * np.random.default_rng(3).standard_normal(T.size)
    residuals, pieces = problem(data)
    bounds = np.full(4, -9.0), np.full(4, 9.0)
    start, options = np.array([1.5, 0.4, 4.6, 0.0]), {"tolerance": 1e-4, "confirm": False}
    first = solve(residuals, pieces, start, *bounds, max_evaluations=5, keep=True, **options)
    assert first.message == AT_LIMIT
    assert [p.residual for p in first.pieces] == [pytest.approx(r) for r in residuals(first.x)]
    going_on = solve(residuals, pieces, first.x, *bounds, begin=first.pieces, **options)
    anew = solve(residuals, pieces, first.x, *bounds, **options)
    assert going_on.jacobians < anew.jacobians
    # neither is confirmed by a new Jacobian: a corrected one promises only about what there is to gain
    assert going_on.cost == pytest.approx(anew.cost, rel=1e-2)
    fitted_anew = solve(residuals, pieces, first.x, *bounds, tolerance=1e-10, begin=first.pieces)
    assert fitted_anew.cost == pytest.approx(fitted(tolerance=1e-10)[0].cost, rel=1e-8)
