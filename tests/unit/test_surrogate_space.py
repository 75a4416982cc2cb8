"""Design spaces, scaling, Latin hypercubes and evaluation."""

import numpy as np
import pytest

from surrogate import DesignSpace, evaluate, latin_hypercube

TABLE3 = DesignSpace(("K", "C_D", "e_F"), ("N/mm^1.5", "N*s/mm", ""), (4.3e5, 86.0, 1.5), (12.9e5, 860.0, 2.5))


def test_scaling_is_min_max_and_exact_at_the_bounds():
    x = np.array([[4.3e5, 86.0, 1.5], [12.9e5, 860.0, 2.5], [8.6e5, 473.0, 2.0]])
    t = TABLE3.to_unit(x)
    np.testing.assert_allclose(t, [[0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]], atol=1e-15)
    assert (TABLE3.from_unit(np.ones(3)) == TABLE3.upper).all()
    assert (TABLE3.from_unit(np.zeros(3)) == TABLE3.lower).all()


def test_frames_name_units():
    frame = TABLE3.to_frame()
    assert frame.loc["C_D", "unit"] == "N*s/mm"
    assert list(TABLE3.to_frame([[8.6e5, 86.0, 2.0]]).columns) == ["K [N/mm^1.5]", "C_D [N*s/mm]", "e_F"]
    assert "C_D [86, 860] N*s/mm" in repr(TABLE3)


def test_subset_keeps_bounds_and_order():
    assert TABLE3.subset(["e_F", "K"]) == DesignSpace(("e_F", "K"), ("", "N/mm^1.5"), (1.5, 4.3e5), (2.5, 12.9e5))
    with pytest.raises(ValueError, match=r"no parameter rho; the space has K, C_D, e_F"):
        TABLE3.subset(["rho"])


def test_dictionary_round_trip_and_mapping():
    assert DesignSpace.from_dict(TABLE3.to_dict()) == TABLE3
    assert DesignSpace.from_mapping({"K": (1, 2, "N"), "e": (0, 1)}).units == ("N", "")
    with pytest.raises(ValueError, match="lacks upper"):
        DesignSpace.from_dict({"names": ["a"], "units": [""], "lower": [0.0]})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((("a", "a"), ("", ""), (0, 0), (1, 1)), "repeated: a"),
        ((("a", "b"), ("",), (0, 0), (1, 1)), "'units' has 1 entries for 2 names"),
        ((("a",), ("",), (1,), (1,)), r"bounds of 'a' must be lower < upper, not \[1, 1\]"),
        ((("a",), ("",), (0,), (np.inf,)), "bounds of 'a' must be finite"),
        (((), (), (), ()), "at least one parameter"),
        (("ab", ("", ""), (0, 0), (1, 1)), "single string 'ab'"),
        ((("a",), ("",), ("low",), (1,)), "'lower' must be a sequence of numbers"),
    ],
)
def test_bad_declarations_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        DesignSpace(*arguments)


def test_all_faults_of_a_declaration_are_told_at_once():
    with pytest.raises(ValueError, match=r"bounds of 'a'.*bounds of 'b'"):
        DesignSpace(("a", "b"), ("", ""), (1, 2), (0, 0))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[1.0, 2.0]], r"shape \(1, 2\); expected \(n, 3\).*K, C_D, e_F"),
        ([[8e5, 100.0, np.nan]], "not finite: row 0 e_F = nan"),
        ([[8e5, 100.0, 2.0], [8e5, 8.0, 3.0]], "outside the bounds: row 1 C_D = 8, row 1 e_F = 3"),
    ],
)
def test_bad_points_are_named(points, message):
    with pytest.raises(ValueError, match=message):
        TABLE3.to_unit(points)


@pytest.mark.parametrize("optimisation", ["none", "random-cd", "maximin"])
@pytest.mark.parametrize("n", [2, 25, 50])
def test_designs_have_one_point_in_each_stratum(optimisation, n):
    design = latin_hypercube(TABLE3, n, optimisation=optimisation, seed=3)
    strata = np.sort(np.floor(design.unit * n).astype(int), axis=0)
    assert (strata == np.arange(n)[:, None]).all()
    assert design.is_latin
    assert design.points.shape == (n, 3)
    TABLE3.points(design.points)  # raises if any lies out of bounds


def test_optimised_designs_beat_the_plain_one_in_what_they_optimise():
    seeds = range(5)
    plain = [latin_hypercube(TABLE3, 30, optimisation="none", seed=s) for s in seeds]
    even = [latin_hypercube(TABLE3, 30, optimisation="random-cd", seed=s) for s in seeds]
    apart = [latin_hypercube(TABLE3, 30, optimisation="maximin", seed=s) for s in seeds]
    assert all(b.discrepancy < a.discrepancy for a, b in zip(plain, even, strict=True))
    assert all(b.min_distance > 1.5 * a.min_distance for a, b in zip(plain, apart, strict=True))


def test_lloyd_moves_points_apart_and_admits_what_it_costs():
    # SciPy's Lloyd leaves points with an unbounded cell where they are: it needs many points per dimension.
    flat = TABLE3.subset(["K", "e_F"])
    design = latin_hypercube(flat, 60, optimisation="lloyd", seed=0)
    assert design.min_distance > latin_hypercube(flat, 60, optimisation="none", seed=0).min_distance
    assert not design.is_latin


def test_designs_repeat_with_the_seed_and_only_then():
    a, b, c = (latin_hypercube(TABLE3, 10, seed=s).unit for s in (1, 1, 2))
    assert (a == b).all()
    assert (a != c).any()


def test_bad_designs_are_refused():
    for n in (1, 0, 2.5, True):
        with pytest.raises(ValueError, match="at least 2 points"):
            latin_hypercube(TABLE3, n)
    with pytest.raises(ValueError, match="unknown optimisation 'best'"):
        latin_hypercube(TABLE3, 5, optimisation="best")


def test_evaluation_takes_points_one_by_one_or_together():
    space = DesignSpace.unit_cube(("a", "b"))
    x = np.array([[0.1, 0.2], [0.3, 0.5]])
    one = evaluate(lambda p: p[0] + 2 * p[1], space, x)
    many = evaluate(lambda p: p[:, 0] + 2 * p[:, 1], space, x, vectorised=True)
    np.testing.assert_array_equal(one, many)


def test_evaluation_over_an_executor_keeps_the_order():
    from concurrent.futures import ThreadPoolExecutor

    space = DesignSpace.unit_cube(("a",))
    x = np.linspace(0, 1, 20)[:, None]
    with ThreadPoolExecutor(2) as pool:
        np.testing.assert_array_equal(evaluate(lambda p: p[0] ** 2, space, x, executor=pool), x[:, 0] ** 2)


def test_evaluation_names_wrong_shapes_and_the_point_of_an_exception():
    space = DesignSpace.unit_cube(("a", "b"))
    with pytest.raises(ValueError, match=r"shape \(\) for points of shape \(3, 2\).*vectorised=False"):
        evaluate(lambda p: 1.0, space, np.full((3, 2), 0.5), vectorised=True)
    with pytest.raises(ValueError, match=r"shape \(2,\).*expected one number"):
        evaluate(lambda p: p, space, np.full((3, 2), 0.5))

    def broken(p):
        raise RuntimeError("no convergence")

    with pytest.raises(RuntimeError) as caught:
        evaluate(broken, space, [[0.25, 0.5]])
    assert caught.value.__notes__ == ["while evaluating the function at a = 0.25, b = 0.5"]
