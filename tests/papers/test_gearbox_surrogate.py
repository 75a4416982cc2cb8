"""The printed response surface of the gearbox paper (Eq. 18): variable order, maxima, and firefly on it.

Source: "Digital twin-assisted gearbox dynamic model updating toward fault diagnosis", Eqs. 13, 14, 18 to 20,
Tables 3 and 4.
"""

from __future__ import annotations

import importlib.util
import sys
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from surrogate import DesignSpace, ResponseSurface, local_maxima, maximise, polynomial_terms

ROOT = Path(__file__).resolve().parents[2]


def _benchmark():
    spec = importlib.util.spec_from_file_location("optimisers_benchmark", ROOT / "benchmarks" / "optimisers.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


BENCHMARK = _benchmark()
EQ18 = BENCHMARK.EQ18

#: Table 3, the three parameters that Fig. 8 leaves.
BOUNDS = {"K": (4.3e5, 12.9e5, "N/mm^1.5"), "C_D": (86.0, 860.0, "N*s/mm"), "e_F": (1.5, 2.5, "")}
#: Table 4.
INITIAL = {"K": 8.60e5, "C_D": 86.0, "e_F": 2.00}
UPDATED = {"K": 6.44e5, "C_D": 303.0, "e_F": 2.27}


def at(order: tuple[str, str, str], values: dict[str, float]) -> float:
    """Eq. 18 with (t1, t2, t3) standing for the parameters in this order."""
    space = DesignSpace.from_mapping({name: BOUNDS[name] for name in order})
    surface = ResponseSurface.from_coefficients(space, EQ18, response="cosine similarity")
    return float(surface([values[name] for name in order])[0])


def test_eq_18_has_the_paper_set_of_terms():
    assert len(EQ18) == len(polynomial_terms(3, 3, "paper")) == 19
    # Written out by hand from the print, as a check on the order of the coefficients.
    a, b, c = 0.3, 0.7, 0.2
    by_hand = (
        0.6349
        - 0.8374 * a
        - 0.0945 * b
        + 0.5874 * c
        + 0.1797 * a**2
        + 0.7383 * b**2
        - 0.7154 * c**2
        + 1.8013 * a * b
        + 0.2717 * a * c
        - 0.6715 * b * c
        + 0.3009 * a**3
        - 0.6105 * b**3
        + 0.0692 * c**3
        - 0.6517 * a**2 * b
        - 0.4633 * a**2 * c
        - 0.8417 * b**2 * a
        + 0.2818 * b**2 * c
        + 0.0397 * c**2 * a
        + 0.2283 * c**2 * b
    )
    assert BENCHMARK.eq18()([a, b, c])[0] == pytest.approx(by_hand, abs=1e-14)


def test_variable_order_as_the_paper_says_contradicts_table_4():
    order = ("K", "C_D", "e_F")
    assert at(order, UPDATED) == pytest.approx(0.564, abs=5e-4)
    assert at(order, INITIAL) == pytest.approx(0.437, abs=5e-4)
    assert abs(at(order, UPDATED) - 0.752) > 0.15


def test_variable_order_with_damping_and_exponent_swapped_fits_the_updated_point():
    order = ("K", "e_F", "C_D")
    assert at(order, UPDATED) == pytest.approx(0.756, abs=5e-4)
    assert at(order, INITIAL) == pytest.approx(0.623, abs=5e-4)
    # The mean relative error that the paper gives for its surface is 0.027, the largest 0.067.
    assert abs(at(order, UPDATED) / 0.752 - 1) < 0.027
    assert abs(at(order, INITIAL) / 0.689 - 1) > 0.067  # which the initial point exceeds all the same


def test_table_4_tells_only_that_the_second_variable_is_the_exponent():
    """Two of the six orders reach the updated value; only the cyclic one of them reaches the initial one."""
    orders = list(permutations(("K", "C_D", "e_F")))
    near = {order for order in orders if abs(at(order, UPDATED) / 0.752 - 1) < 0.027}
    assert near == {("K", "e_F", "C_D"), ("C_D", "e_F", "K")}
    assert at(("C_D", "e_F", "K"), UPDATED) == pytest.approx(0.754, abs=5e-4)
    assert at(("C_D", "e_F", "K"), INITIAL) == pytest.approx(0.715, abs=5e-4)
    # The largest relative error that the paper gives for this surface is 0.067.
    both = {order for order in near if abs(at(order, INITIAL) / 0.689 - 1) < 0.067}
    assert both == {("C_D", "e_F", "K")}


def test_three_local_maxima_and_the_paper_is_on_the_way_to_the_third():
    surface = BENCHMARK.eq18()
    found = local_maxima(surface, surface.space, starts=100, seed=1)
    expected = np.array([[0.0, 0.0, 0.44, 0.7607], [1.0, 0.70, 0.06, 0.759], [0.16, 0.75, 0.27, 0.7576]])
    assert len(found) == 3
    # Positions are given to two decimals and values to three or four.
    np.testing.assert_allclose(found[["t1", "t2", "t3"]], expected[:, :3], atol=5e-3)
    np.testing.assert_allclose(found["value"], expected[:, 3], atol=5e-4)

    space = DesignSpace.from_mapping({name: BOUNDS[name] for name in ("K", "e_F", "C_D")})
    paper = space.to_unit([[UPDATED[name] for name in space.names]])
    distance = np.linalg.norm(found[["t1", "t2", "t3"]].to_numpy() - paper, axis=1)
    assert distance.argmin() == 2
    assert surface(paper)[0] < found["value"].iloc[2]


def test_local_maxima_satisfy_the_conditions_for_one():
    surface = BENCHMARK.eq18()
    for point in local_maxima(surface, surface.space, starts=60)[["t1", "t2", "t3"]].to_numpy():
        slope, curved = surface.gradient(point)[0], surface.hessian(point)[0]
        free = (point > 1e-9) & (point < 1 - 1e-9)
        np.testing.assert_allclose(slope[free], 0.0, atol=1e-6)  # L-BFGS-B's gtol of 1e-9, with room
        assert (slope[point <= 1e-9] < 0).all()
        assert (slope[point >= 1 - 1e-9] > 0).all()
        assert (np.linalg.eigvalsh(curved[np.ix_(free, free)]) < 0).all()


def test_firefly_without_polish_ends_where_the_paper_did():
    """The swarm alone, with uniform steps and beta0 = 1, never finds 0.7607 but stays on the third hill."""
    settings = {
        "method": "firefly",
        "polish": 0,
        "options": BENCHMARK.FORMS["firefly, beta0 = 1, uniform"]["options"],
    }
    run = BENCHMARK.on_eq18(range(20), {"firefly": settings})
    assert run.hit_rate("firefly") == 0.0
    assert np.median([r.value for r in run.results["firefly"]]) == pytest.approx(0.7576, abs=2e-3)


@pytest.mark.parametrize("method", ["firefly (default)", "firefly, exp(-gamma r^2)"])
def test_firefly_30_by_100_finds_the_maximum(method):
    # Of 20 seeds 18 at least: a method with a true rate of 0.98 fails this in 0.7 % of draws of seeds.
    run = BENCHMARK.on_eq18(range(1000, 1020), {method: BENCHMARK.FORMS[method]})
    assert run.hit_rate(method) >= 0.9
    first = run.results[method][0]
    assert first.options["population"] == 30
    assert first.options["iterations"] == 100


@pytest.mark.slow
def test_firefly_30_by_100_on_100_seeds_beside_the_alternatives():
    """Further forms of the firefly: `python benchmarks/optimisers.py`."""
    alternatives = ("differential_evolution, restarted", "direct", "multistart")
    names = ("firefly (default)", "firefly, exp(-gamma r^2)", *alternatives)
    run = BENCHMARK.on_eq18(range(1000, 1100), {name: BENCHMARK.FORMS[name] for name in names})
    assert run.hit_rate("firefly (default)") >= 0.95
    assert run.hit_rate("firefly, exp(-gamma r^2)") >= 0.95
    assert run.hit_rate("multistart") >= 0.99
    assert all(r.evaluations <= BENCHMARK.BUDGET for runs in run.results.values() for r in runs)


def test_alternatives_on_eq_18_at_equal_evaluations():
    names = ("multistart", "direct", "differential_evolution, restarted")
    run = BENCHMARK.on_eq18(range(1000, 1002), {name: BENCHMARK.FORMS[name] for name in names})
    assert run.hit_rate("multistart") == 1.0
    assert run.hit_rate("direct") == 1.0
    assert all(r.evaluations <= BENCHMARK.BUDGET for runs in run.results.values() for r in runs)


def test_optimum_in_the_parameters_of_table_3():
    space = DesignSpace.from_mapping({name: BOUNDS[name] for name in ("K", "e_F", "C_D")})
    surface = ResponseSurface.from_coefficients(space, EQ18, response="cosine similarity")
    found = maximise(surface, space, method="multistart", budget=1000)
    assert found.value == pytest.approx(0.7607, abs=1e-4)
    assert found.at_bound == ("K", "e_F")
    assert found.parameters["C_D"] == pytest.approx(86.0 + 0.4384 * 774.0, abs=0.5)
