"""Sensitivities against functions whose effects are known in closed form."""

import numpy as np
import pytest

from surrogate import DesignSpace, SurrogateWarning, morris, one_at_a_time, sobol

SPACE = DesignSpace(("a", "b", "c"), ("m", "", ""), (0.0, -1.0, 10.0), (2.0, 1.0, 20.0))


def linear(x):
    return 3.0 * x[0] - 2.0 * x[1] + 0.0 * x[2]


def ishigami(x):
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_one_at_a_time_of_a_line_gives_its_slopes():
    result = one_at_a_time(linear, SPACE)
    np.testing.assert_allclose(result.slopes, [6.0, -4.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(result.ranges, [6.0, 4.0, 0.0], atol=1e-12)
    assert result.to_frame().loc["a", "slope_per_unit"] == pytest.approx(3.0)
    assert result.select(0.1) == ("a", "b")
    assert result.select(0.9) == ("a",)
    assert result.evaluations == 1 + 3 * (11 + 2)


def test_one_at_a_time_at_a_bound_differentiates_inwards():
    result = one_at_a_time(lambda x: (x[0] - 2.0) ** 2, SPACE, base={"a": 2.0}, step=1e-3)
    # One-sided difference of a parabola at its vertex: h (scaled), times the range squared.
    assert result.slopes[0] == pytest.approx(-1e-3 * 4.0, rel=1e-6)


def test_one_at_a_time_misses_interaction_that_morris_and_sobol_see():
    def product(x):
        return x[:, 0] * x[:, 1]

    space = DesignSpace(("u", "v"), ("", ""), (-1.0, -1.0), (1.0, 1.0))
    assert (one_at_a_time(product, space, vectorised=True).ranges == 0.0).all()
    assert (morris(product, space, vectorised=True).mu_star > 0.5).all()
    shares = sobol(product, space, vectorised=True)
    np.testing.assert_allclose(shares.total, 1.0, atol=0.05)
    np.testing.assert_allclose(shares.first, 0.0, atol=0.05)


def test_morris_of_a_line_is_exact_in_every_trajectory():
    result = morris(linear, SPACE, trajectories=7, seed=5)
    np.testing.assert_allclose(result.effects, np.tile([6.0, -4.0, 0.0], (7, 1)), atol=1e-12)
    np.testing.assert_allclose(result.sigma, 0.0, atol=1e-12)
    assert result.evaluations == 7 * 4
    assert result.select() == ("a", "b")


def test_morris_walks_stay_on_the_grid_and_inside():
    seen = []
    morris(lambda x: seen.append(x.copy()) or x[0], SPACE, trajectories=20, levels=4, seed=1)
    t = SPACE.to_unit(np.array(seen))
    np.testing.assert_allclose(t * 3, np.round(t * 3), atol=1e-9)
    assert set(np.unique(np.round(t * 3)).astype(int)) == {0, 1, 2, 3}


def test_sobol_of_ishigami_against_its_closed_form():
    space = DesignSpace(("x1", "x2", "x3"), ("",) * 3, (-np.pi,) * 3, (np.pi,) * 3)
    result = sobol(ishigami, space, samples=4096, seed=1, vectorised=True)
    # Homma and Saltelli 1996 for a = 7, b = 0.1; the tolerance is the estimator's error at 4096 samples.
    np.testing.assert_allclose(result.first, [0.3139, 0.4424, 0.0], atol=0.02)
    np.testing.assert_allclose(result.total, [0.5576, 0.4424, 0.2437], atol=0.02)
    assert (result.total_interval[:, 0] <= result.total).all()
    assert (result.total <= result.total_interval[:, 1]).all()
    assert result.evaluations == 4096 * 5
    assert list(result.to_frame().index) == ["x1", "x2", "x3"]


def test_failed_evaluations_are_told_and_left_out():
    def sometimes(x):
        return np.nan if x[2] > 19.0 else linear(x)

    with pytest.warns(SurrogateWarning, match=r"failed .* at 1 of 40 points"):
        result = one_at_a_time(sometimes, SPACE)
    np.testing.assert_allclose(result.ranges, [6.0, 4.0, 0.0], atol=1e-12)
    with pytest.warns(SurrogateWarning, match="left out"):
        kept = morris(sometimes, SPACE, trajectories=20)
    np.testing.assert_allclose(kept.mu, [6.0, -4.0, 0.0], atol=1e-12)
    with pytest.raises(ValueError, match="estimator needs all of them"):
        sobol(sometimes, SPACE, samples=64)
    with pytest.raises(ValueError, match="failed at the base"):
        one_at_a_time(lambda x: np.nan, SPACE)


def test_bad_settings_are_named():
    with pytest.raises(ValueError, match="base names rho, which the space lacks"):
        one_at_a_time(linear, SPACE, base={"rho": 1.0})
    with pytest.raises(ValueError, match="outside the bounds: row 0 a = 3"):
        one_at_a_time(linear, SPACE, base={"a": 3.0})
    with pytest.raises(ValueError, match="even number of levels"):
        morris(linear, SPACE, levels=3)
    with pytest.raises(ValueError, match="at least 2 trajectories"):
        morris(linear, SPACE, trajectories=1)
    with pytest.raises(ValueError, match="power of two"):
        sobol(linear, SPACE, samples=1000)
    with pytest.raises(ValueError, match="no variance to divide among the parameters"):
        sobol(lambda x: 1.0, SPACE, samples=16)
    with pytest.raises(ValueError, match="share must lie between 0 and 1"):
        morris(linear, SPACE).select(2.0)


def test_figures_have_labelled_axes():
    def product(x):  # every parameter matters: SciPy cannot bootstrap a share of exactly zero
        return x[0] * (x[1] + 2.0) * x[2]

    runs = (one_at_a_time(linear, SPACE), morris(linear, SPACE), sobol(product, SPACE, samples=64))
    for figure in (run.plot() for run in runs):
        assert figure.axes[0].get_ylabel()
