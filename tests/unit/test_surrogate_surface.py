"""Response surfaces: exact recovery, derivatives, leave-one-out, intervals, files, bad input."""

import dataclasses
import json
import warnings

import numpy as np
import pytest

from surrogate import (
    DesignSpace,
    RankDeficiencyError,
    ResponseSurface,
    SurrogateWarning,
    fit_response_surface,
    latin_hypercube,
    maximise,
    polynomial_terms,
    surface_study,
)

SPACE = DesignSpace(("K", "C_D", "e_F"), ("N/mm^1.5", "N*s/mm", ""), (4.3e5, 86.0, 1.5), (12.9e5, 860.0, 2.5))


def fitted(n=100, order=3, terms="paper", noise=0.0, seed=0, **more):
    rng = np.random.default_rng(seed)
    true = ResponseSurface.from_coefficients(
        SPACE, rng.normal(size=len(polynomial_terms(3, order, terms))), order=order, terms=terms
    )
    x = latin_hypercube(SPACE, n, seed=seed).points
    y = true(x) + noise * rng.normal(size=n)
    return true, fit_response_surface(SPACE, x, y, order=order, terms=terms, **more)


@pytest.mark.parametrize(
    ("k", "order", "kind", "count"),
    [
        (3, 1, "paper", 4),
        (3, 2, "paper", 10),
        (3, 3, "paper", 19),
        (3, 3, "full", 20),
        (3, 3, "eq11", 16),
        (6, 3, "full", 84),
        (6, 3, "paper", 64),
        (1, 3, "paper", 4),
        (1, 3, "full", 4),
    ],
)
def test_numbers_of_terms(k, order, kind, count):
    # full: binomial(k + order, order); paper: without the products of three, binomial(k, 3) fewer.
    assert len(polynomial_terms(k, order, kind)) == count


def test_paper_terms_stand_in_the_order_of_eq_18():
    names = polynomial_terms(3, 3).names(("a", "b", "c"))
    printed = "a^2 b^2 c^2 a*b a*c b*c a^3 b^3 c^3 a^2*b a^2*c a*b^2 b^2*c a*c^2 b*c^2"
    assert names[4:] == tuple(printed.split())
    assert set(polynomial_terms(3, 3, "full").names("abc")) - set(names) == {"a*b*c"}


@pytest.mark.parametrize(("order", "terms"), [(1, "paper"), (2, "paper"), (3, "paper"), (3, "full"), (3, "eq11")])
def test_polynomials_are_recovered_exactly(order, terms):
    true, found = fitted(order=order, terms=terms)
    # Rounding times the condition number of the scaled terms (about 1e3 for a cubic).
    np.testing.assert_allclose(found.coefficients, true.coefficients, atol=1e-11)
    assert found.quality.r2 == pytest.approx(1.0, abs=1e-12)
    assert found.quality.r2_loo == pytest.approx(1.0, abs=1e-12)


def test_gradient_and_hessian_agree_with_differences():
    _, surface = fitted(terms="full")
    t = np.random.default_rng(1).uniform(0.05, 0.95, (5, 3))
    h = 1e-4
    for i in range(3):
        step = np.eye(3)[i] * h
        ahead, behind = SPACE.from_unit(t + step), SPACE.from_unit(t - step)
        span = ahead[0, i] - behind[0, i]
        # Central differences of a cubic err by h² f'''/6, of its gradient not at all but for rounding.
        slope = (surface(ahead) - surface(behind)) / span * SPACE.span[i]
        np.testing.assert_allclose(surface.gradient(SPACE.from_unit(t))[:, i] * SPACE.span[i], slope, atol=1e-7)
        curve = (surface.gradient(ahead) - surface.gradient(behind)) / span
        scale = SPACE.span[i] * SPACE.span
        np.testing.assert_allclose(surface.hessian(SPACE.from_unit(t))[:, i] * scale, curve * scale, atol=1e-8)


def test_leave_one_out_equals_refitting_without_each_point():
    with pytest.warns(SurrogateWarning):
        _, surface = fitted(n=30, noise=0.1)
    x, y = surface.train_points, surface.train_responses
    brute = []
    for i in range(len(y)):
        keep = np.arange(len(y)) != i
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SurrogateWarning)
            brute.append(y[i] - fit_response_surface(SPACE, x[keep], y[keep])(x[i])[0])
    np.testing.assert_allclose(surface.loo_residuals(), brute, rtol=1e-8)
    expected = 1 - np.sum(np.square(brute)) / np.sum((y - y.mean()) ** 2)
    assert surface.quality.r2_loo == pytest.approx(expected, abs=1e-10)


def test_quality_by_its_definitions():
    _, surface = fitted(n=80, noise=0.2)
    x, y = surface.train_points, surface.train_responses
    e, q = y - surface(x), surface.quality
    r2 = 1 - (e @ e) / np.sum((y - y.mean()) ** 2)
    assert q.r2 == pytest.approx(r2)
    assert q.r2_adjusted == pytest.approx(1 - (1 - r2) * 79 / (80 - 19))
    assert q.sigma == pytest.approx(np.sqrt(e @ e / (80 - 19)))
    assert q.max_relative_error == pytest.approx(np.max(np.abs(e / y)))
    assert q.mean_relative_error == pytest.approx(np.mean(np.abs(e / y)))
    assert q.r2_loo < q.r2_adjusted < q.r2


def test_overfitting_shows_in_leave_one_out_and_test_but_not_in_r2():
    """25 points, 19 coefficients and pure noise: the paper's smallest design, where it saw R² = 0.991."""
    r2, unseen = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x, xt = (latin_hypercube(SPACE, n, seed=s).points for n, s in ((25, seed), (40, seed + 100)))
        with pytest.warns(SurrogateWarning):
            surface = fit_response_surface(SPACE, x, rng.normal(size=25), test=(xt, rng.normal(size=40)))
        r2.append(surface.quality.r2)
        unseen.append((surface.quality.r2_loo, surface.test_quality.r2))
    # R² of noise is Beta(9, 3): mean 18/24, standard deviation 0.12; four standard errors over 20 fits.
    assert np.mean(r2) == pytest.approx(0.75, abs=0.11)
    assert (np.array(unseen) < 0.0).all()
    assert "test R²" in repr(surface)


def test_prediction_intervals_cover_what_they_promise():
    covered = []
    for seed in range(20):
        true, surface = fitted(n=80, order=2, noise=0.3, seed=seed)
        rng = np.random.default_rng(seed + 500)
        x = SPACE.from_unit(rng.random((200, 3)))
        fresh = true(x) + 0.3 * rng.normal(size=200)
        centre, low, high = surface.prediction_interval(x, confidence=0.9)
        assert (low < centre).all()
        covered.append(np.mean((low < fresh) & (fresh < high)))
    # Scatter of the mean coverage over 20 fits: 0.01, mostly from each fit's own sigma (70 spare points).
    assert np.mean(covered) == pytest.approx(0.9, abs=0.03)


def test_interval_is_the_textbook_one_for_a_line():
    line = DesignSpace(("x",), ("m",), (0.0,), (10.0,))
    x = np.linspace(0, 10, 11)
    y = 2 * x + np.tile([0.5, -0.5], 6)[:11]
    surface = fit_response_surface(line, x[:, None], y, order=1)
    from scipy import stats

    plain = stats.linregress(x, y)
    s = np.sqrt(np.sum((y - plain.intercept - plain.slope * x) ** 2) / 9)
    half = stats.t.ppf(0.975, 9) * s * np.sqrt(1 + 1 / 11 + (7 - 5) ** 2 / np.sum((x - 5) ** 2))
    centre, low, high = surface.prediction_interval([[7.0]])
    assert centre[0] == pytest.approx(plain.intercept + 7 * plain.slope)
    assert (high - low)[0] / 2 == pytest.approx(half)
    frame = surface.to_frame()
    assert frame.loc["x", "std_error"] == pytest.approx(plain.stderr * 10)


def test_files_give_back_the_same_surface(tmp_path):
    x = latin_hypercube(SPACE, 20, seed=9).points
    true, surface = fitted(n=100, noise=0.05, response="similarity")
    surface = fit_response_surface(
        SPACE, surface.train_points, surface.train_responses, test=(x, true(x)), response="similarity"
    )
    surface.save(tmp_path / "s.json")
    again = ResponseSurface.load(tmp_path / "s.json")
    assert (again.coefficients == surface.coefficients).all()
    assert again.quality == surface.quality
    assert again.test_quality == surface.test_quality
    assert repr(again) == repr(surface)
    np.testing.assert_array_equal(again.prediction_interval(x), surface.prediction_interval(x))
    given = ResponseSurface.from_coefficients(SPACE, np.arange(19.0))
    given.save(tmp_path / "g.json")
    assert (ResponseSurface.load(tmp_path / "g.json").coefficients == np.arange(19.0)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("space"), "lacks space"),
        (lambda c: c.update(schema=99), "schema 99"),
        (lambda c: c["coefficients"].pop(), "18 coefficients .* for 19 terms"),
        (lambda c: c["coefficients"].__setitem__(3, None), "coefficients are not finite: e_F"),
        (lambda c: c["train"]["responses"].pop(), "99 train responses for 100 train points"),
        (lambda c: c["train"].pop("points"), "lacks 'points'"),
        (lambda c: c["space"].pop("units"), "lacks units"),
    ],
)
def test_bad_files_are_named(tmp_path, change, message):
    _, surface = fitted()
    path = tmp_path / "s.json"
    surface.save(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"s\.json: .*{message}"):
        ResponseSurface.load(path)
    path.write_text("{")
    with pytest.raises(ValueError, match=r"s\.json: not a JSON file"):
        ResponseSurface.load(path)


def test_bad_data_are_named():
    x = latin_hypercube(SPACE, 80, seed=0).points
    y = np.random.default_rng(0).normal(size=80)
    with pytest.raises(ValueError, match=r"responses have shape \(79,\) for 80 points"):
        fit_response_surface(SPACE, x, y[:-1])
    bad = y.copy()
    bad[[3, 17]] = np.nan
    with pytest.raises(ValueError, match=r"not finite in rows \[3, 17\].*simulation failed"):
        fit_response_surface(SPACE, x, bad)
    with pytest.raises(ValueError, match=r"responses are all 0\.7: they do not vary"):
        fit_response_surface(SPACE, x, np.full(80, 0.7))
    with pytest.raises(ValueError, match=r"points lie outside the bounds: row 0 K = 1"):
        fit_response_surface(SPACE, np.vstack([[1.0, 100.0, 2.0], x[1:]]), y)
    with pytest.raises(ValueError, match=r"19 coefficients cannot be found from 15 points.*at least 76"):
        fit_response_surface(SPACE, x[:15], y[:15])
    with pytest.raises(ValueError, match="order must be 1, 2 or 3, not 4"):
        fit_response_surface(SPACE, x, y, order=4)
    with pytest.raises(ValueError, match="unknown set of terms 'all'"):
        fit_response_surface(SPACE, x, y, terms="all")
    still = x.copy()
    still[:, 1] = 100.0
    with pytest.raises(ValueError, match="C_D never changes"):
        fit_response_surface(SPACE, still, y)
    with pytest.raises(ValueError, match=r"test responses have shape"):
        fit_response_surface(SPACE, x, y, test=(x, y[:3]))


def test_terms_that_cannot_be_told_apart_are_named():
    x = latin_hypercube(SPACE, 100, seed=0).points
    # Two values of C_D leave its square and cube (and the mixed ones) in the span of the others.
    x[:, 1] = np.where(x[:, 1] > 400.0, 860.0, 86.0)
    y = np.random.default_rng(0).normal(size=100)
    with pytest.raises(RankDeficiencyError, match=r"only 15 of 19.*C_D, .*C_D\^2.*C_D\^3"):
        fit_response_surface(SPACE, x, y)
    with pytest.warns(SurrogateWarning, match="cannot be told apart"):
        surface = fit_response_surface(SPACE, x, y, on_rank_deficiency="warn")
    assert surface.quality.rank == 15
    assert surface.to_frame()["std_error"].isna().all()
    with pytest.raises(ValueError, match="no prediction interval"):
        surface.prediction_interval(x)


def test_warns_below_four_points_per_coefficient_and_not_above():
    with pytest.warns(SurrogateWarning, match=r"75 points for 19 coefficients \(3.9 each"):
        fitted(n=75)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SurrogateWarning)
        fitted(n=76)


def test_as_many_points_as_coefficients_leaves_nothing_to_judge_by():
    with pytest.warns(SurrogateWarning):
        _, surface = fitted(n=19, noise=0.1)
    q = surface.quality
    assert q.r2 == pytest.approx(1.0, abs=1e-9)
    assert np.isnan([q.r2_loo, q.r2_adjusted, q.sigma]).all()
    with pytest.raises(ValueError, match="19 points leave none over"):
        surface.prediction_interval(surface.train_points)


def test_given_coefficients_say_what_they_cannot_do():
    surface = ResponseSurface.from_coefficients(SPACE, np.ones(19))
    assert "given coefficients" in repr(surface)
    assert list(surface.to_frame().columns) == ["coefficient"]
    for ask in (
        lambda: surface.quality,
        surface.loo_residuals,
        lambda: surface.prediction_interval([8e5, 100, 2]),
    ):
        with pytest.raises(ValueError, match="made from given coefficients"):
            ask()


def test_extrapolation_is_refused_unless_asked_for():
    surface = ResponseSurface.from_coefficients(SPACE, np.ones(19))
    with pytest.raises(ValueError, match="outside the bounds: row 0 e_F = 3"):
        surface.predict([[8e5, 100.0, 3.0]])
    assert np.isfinite(surface.predict([[8e5, 100.0, 3.0]], outside="allow")).all()


def test_zero_responses_are_left_out_of_relative_errors_and_told():
    line = DesignSpace.unit_cube(("x",))
    x = np.linspace(0, 1, 20)[:, None]
    y = x[:, 0] + 0.1 * np.sin(20 * x[:, 0])
    y[0] = 0.0
    surface = fit_response_surface(line, x, y, order=1)
    with pytest.warns(SurrogateWarning, match=r"rows \[0\]"):
        q = surface.quality
    assert np.isfinite(q.max_relative_error)


def test_study_over_sample_counts_keeps_impossible_fits_with_their_reason():
    true, _ = fitted()
    designs = [(x, true(x)) for x in (latin_hypercube(SPACE, n, seed=n).points for n in (15, 45))]
    xt = latin_hypercube(SPACE, 20, seed=99).points
    frame = surface_study(SPACE, designs, (xt, true(xt)))
    assert list(frame["order"]) == [2, 3, 2, 3]
    assert np.isnan(frame.loc[1, "r2"])
    assert "19 coefficients cannot be found from 15 points" in frame.loc[1, "note"]
    assert frame.loc[3, "test_r2"] == pytest.approx(1.0, abs=1e-9)
    assert frame.loc[2, "test_r2"] < 0.9999


def test_figures_label_units():
    _, surface = fitted(unit="m", response="x")
    axes = surface.plot().axes
    assert [a.get_xlabel() for a in axes] == ["simulated x [m]", "K [N/mm^1.5]", "C_D [N*s/mm]", "e_F"]
    assert len(latin_hypercube(SPACE, 9).plot().axes) == 4


def test_a_maximum_beyond_what_the_response_can_be_is_told(tmp_path):
    """A cubic on few points of a cosine promises more than 1 between them; the limit survives a file."""
    space = DesignSpace.unit_cube(("a", "b"))
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.2], [0.2, 0.7]])
    steep = np.array([0.1, 0.1, 0.1, 0.1, 0.99, 0.99])
    surface = fit_response_surface(space, points, steep, order=2, response="cosine similarity", limits=(-1.0, 1.0))
    surface.save(tmp_path / "surface.json")
    for one in (surface, ResponseSurface.load(tmp_path / "surface.json")):
        with pytest.warns(SurrogateWarning, match=r"promises cosine similarity 1\.\d+, and none is above 1"):
            best = maximise(one, space, method="multistart", budget=500)
        assert best.value > 1.0
    with pytest.raises(ValueError, match="limits must rise"):
        dataclasses.replace(surface, limits=(1.0, -1.0))
