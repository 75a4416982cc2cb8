"""Filters that have settled, whose gains and variances have closed forms.

Constant velocity under white acceleration, position read: the gains of the α-β filter by the tracking index (Kalata
1984, IEEE Transactions on Aerospace and Electronic Systems AES-20, 174).  Random walk: the roots of the scalar Riccati
equation; between two far ends the smoother's information is the sum of the filter's and of the prediction backwards,
which gives q r / √(q (q + 4 r)).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimation.filters import (
    FilterModel,
    FilterSamples,
    LinearModel,
    Noise,
    Prior,
    extended_kalman_filter,
    kalman_filter,
    rauch_tung_striebel,
    unscented_kalman_filter,
)
from multibody import Model
from multibody.library import Integrator, Mass

STEP, COUNT = 0.5, 400
#: Standard deviations: of the acceleration, of a step of the walk, of a reading.
SIGMA_A, SIGMA_W, SIGMA_V = 0.3, 0.2, 0.7


def results() -> Iterator[tuple[str, str, float, float]]:
    """Yield machine, what, the value that was reached and its closed form."""
    yield from _constant_velocity()
    yield from _random_walk()


def _samples(inputs: int) -> FilterSamples:
    readings = np.random.default_rng(0).standard_normal((COUNT, 1))
    return FilterSamples(np.arange(COUNT) * STEP, np.zeros((COUNT, inputs)), readings)


def _constant_velocity() -> Iterator[tuple[str, str, float, float]]:
    index = STEP**2 * SIGMA_A / SIGMA_V
    root = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - root**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    r = SIGMA_V**2
    closed = {"variance of position": alpha * r, "covariance": beta * r / STEP}
    q = SIGMA_A**2 * np.array([[STEP**4 / 4.0, STEP**3 / 2.0], [STEP**3 / 2.0, STEP**2]])
    model = Model("cart")
    model.add("cart", Mass(m=1.0))
    system = model.build(outputs=["cart.position"])
    prior = np.zeros(2), np.eye(2)
    linear = LinearModel(F=np.array([[1.0, STEP], [0.0, 1.0]]), H=np.array([[1.0, 0.0]]), Q=q, R=np.array([[r]]))
    covariances = {"textbook filter": kalman_filter(linear, _samples(0).readings, *prior).covariances}
    readings, noise = _samples(len(system.input_names)), Noise(q, np.array([r]), "per_step")
    start, filter_model = Prior(prior[0], covariance=prior[1]), FilterModel(system, ["cart.position"])
    covariances["extended filter"] = extended_kalman_filter(
        filter_model, readings, noise, start, hold=True, keep="covariances"
    ).covariances
    covariances["unscented filter"] = unscented_kalman_filter(
        filter_model, readings, noise, start, hold=True, covariances=True
    ).covariances
    for name, p in covariances.items():
        for k, (what, wanted) in enumerate(closed.items()):
            yield f"constant velocity, {name}", what, float(p[-1, 0, k]), wanted


def _random_walk() -> Iterator[tuple[str, str, float, float]]:
    q, r = SIGMA_W**2, SIGMA_V**2
    predicted = q / 2.0 + np.sqrt(q**2 / 4.0 + q * r)
    filtered, smoothed = predicted - q, q * r / np.sqrt(q * (q + 4.0 * r))
    linear = LinearModel(F=np.eye(1), H=np.eye(1), Q=np.array([[q]]), R=np.array([[r]]))
    textbook = kalman_filter(linear, _samples(0).readings, np.zeros(1), np.eye(1))
    _, backwards = rauch_tung_striebel(linear, textbook)
    model = Model("walk")
    walk = model.add("walk", Integrator())
    model.input("rate", walk.input, default=0.0)
    system = model.build(outputs=["walk.output"])
    run = extended_kalman_filter(
        FilterModel(system, ["walk.output"]),
        _samples(1),
        Noise(np.array([[q]]), np.array([r]), "per_step"),
        Prior(np.zeros(1), covariance=np.eye(1)),
        hold=True,
        keep="everything",
    )
    for name, forward, back in (
        ("textbook filter", textbook.covariances, backwards),
        ("extended filter", run.covariances, run.smooth().covariances),
    ):
        yield f"random walk, {name}", "variance", float(forward[-1, 0, 0]), filtered
        yield f"random walk, {name}", "smoothed variance", float(back[COUNT // 2, 0, 0]), smoothed
