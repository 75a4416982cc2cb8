"""Other programs' fireflies, surfaces and sensitivities beside ours.

mealpy 3.0.3 asks for numpy 1.26 or older and so needs an environment of its own.
"""

from __future__ import annotations

import numpy as np
import pytest

from surrogate import (
    DesignSpace,
    ResponseSurface,
    fit_response_surface,
    latin_hypercube,
    maximise,
    morris,
    sobol,
)

CUBE = DesignSpace.unit_cube(("a", "b", "c"))


def hill(x):
    """One interior maximum of 1 at (0.3, 0.6, 0.5)."""
    return 1.0 - ((np.asarray(x) - [0.3, 0.6, 0.5]) ** 2).sum(axis=-1)


def ours(seed: int, budget: int = 1500) -> float:
    return maximise(hill, CUBE, budget=budget, seed=seed, vectorised=True, polish=0).value


def test_quadratic_surface_of_smt_predicts_the_same():
    models = pytest.importorskip("smt.surrogate_models", reason="smt is not installed")
    rng = np.random.default_rng(0)
    x = latin_hypercube(CUBE, 60, seed=1).unit
    y = np.sin(3 * x[:, 0]) + x[:, 1] * x[:, 2] + 0.05 * rng.normal(size=60)
    peer = models.QP(print_global=False)
    peer.set_training_values(x, y)
    peer.train()
    surface = fit_response_surface(CUBE, x, y, order=2)
    fresh = rng.random((50, 3))
    # Both solve the same least squares; smt through the normal equations, hence more rounding.
    np.testing.assert_allclose(surface(fresh), peer.predict_values(fresh)[:, 0], atol=1e-9)
    for i in range(3):
        slope = peer.predict_derivatives(fresh, i)[:, 0]
        np.testing.assert_allclose(surface.gradient(fresh)[:, i], slope, atol=1e-9)


def test_niapy_firefly_at_equal_evaluations():
    niapy = pytest.importorskip("niapy", reason="niapy is not installed")
    from niapy.algorithms.basic import FireflyAlgorithm

    class Hill(niapy.problems.Problem):
        def __init__(self):
            super().__init__(dimension=3, lower=0.0, upper=1.0)

        def _evaluate(self, x):
            return -float(hill(x))

    theirs, mine = [], []
    for seed in range(5):
        task = niapy.task.Task(problem=Hill(), max_evals=1500)
        theirs.append(-FireflyAlgorithm(population_size=30, seed=seed).run(task)[1])
        mine.append(ours(seed))
    assert np.median(mine) >= np.median(theirs) - 1e-3
    assert np.median(mine) > 0.999


def test_mealpy_firefly_at_equal_evaluations():
    mealpy = pytest.importorskip("mealpy", reason="mealpy is not installed (it needs numpy <= 1.26)")
    theirs, mine = [], []
    for seed in range(5):
        problem = {
            "obj_func": hill,
            "bounds": mealpy.FloatVar(lb=(0.0,) * 3, ub=(1.0,) * 3),
            "minmax": "max",
            "log_to": None,
        }
        peer = mealpy.swarm_based.FFA.OriginalFFA(epoch=1000, pop_size=30)
        theirs.append(peer.solve(problem, seed=seed, termination={"max_fe": 1500}).target.fitness)
        mine.append(ours(seed))
    assert np.median(mine) >= np.median(theirs) - 1e-3
    assert np.median(mine) > 0.999


def test_morris_and_sobol_agree_with_salib():
    pytest.importorskip("SALib", reason="SALib is not installed")
    from SALib.analyze import morris as analyse_morris
    from SALib.analyze import sobol as analyse_sobol
    from SALib.sample import morris as sample_morris
    from SALib.sample import sobol as sample_sobol

    surface = ResponseSurface.from_coefficients(CUBE, np.random.default_rng(3).normal(size=19))
    problem = {"num_vars": 3, "names": list(CUBE.names), "bounds": [[0.0, 1.0]] * 3}
    walks = 6000
    x = sample_morris.sample(problem, walks, num_levels=4, seed=1)
    theirs = analyse_morris.analyze(problem, x, surface(x), num_levels=4, seed=1)
    mine = morris(surface, CUBE, trajectories=walks, seed=1)
    # Random walks in both: three standard errors of the difference of two estimates, for three parameters.
    error = 3 * np.sqrt(2) * np.abs(mine.effects).std(axis=0) / np.sqrt(walks)
    assert (np.abs(np.asarray(theirs["mu_star"]) - mine.mu_star) < np.maximum(error, 1e-12)).all()

    # SALib 1.5.1 hands the names to pandas.unique, which since pandas 3 wants an array and not a list; and
    # its Morris sampler has written groups into the other description.
    problem = {"num_vars": 3, "names": np.array(CUBE.names), "bounds": [[0.0, 1.0]] * 3}
    x = sample_sobol.sample(problem, 2048, calc_second_order=False, seed=1)
    shares = analyse_sobol.analyze(problem, surface(x), calc_second_order=False, seed=1)
    got = sobol(surface, CUBE, samples=2048, seed=1)
    np.testing.assert_allclose(got.first, shares["S1"], atol=0.03)
    np.testing.assert_allclose(got.total, shares["ST"], atol=0.03)
