"""The same problems through filterpy: Kalman filter, smoother, unscented filter."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import (
    FilterModel,
    FilterSamples,
    Noise,
    Prior,
    RandomWalk,
    extended_kalman_filter,
    unscented_kalman_filter,
)

filterpy = pytest.importorskip("filterpy.kalman", reason="pip install filterpy")

STEP = 0.01


def pendulum():
    """A pendulum turned by a torque: nonlinear in its angle."""
    from multibody import Model
    from multibody.library import Pendulum, RotaryViscousFriction

    model = Model("pendulum")
    bob = model.add("bob", Pendulum(J=0.5, m=1.0, arm=0.6))
    bearing = model.add("bearing", RotaryViscousFriction(viscous=0.05))
    model.connect(bearing.a, model.ground)
    model.connect(bearing.b, bob.flange)
    return model.build(outputs=["bob.angle"])


def readings(system, count=400):
    rng = np.random.default_rng(1)
    run = system.simulate(
        (0.0, (count - 1) * STEP), initial={"bob.angle": 1.2}, times=np.arange(count) * STEP, rtol=1e-9
    )
    return run["bob.angle"][:, None] + 1e-2 * rng.standard_normal((count, 1))


def step(system, x, h):
    """Runge and Kutta's step on [angle, speed, friction]."""
    p = system.p.copy()
    at = system.index("parameter", "bearing.viscous")

    def rate(z):
        p[at] = 0.05 + z[2]
        return np.append(system.rhs(0.0, z[:2].copy(), system.u, p), 0.0)

    k1 = rate(x)
    k2 = rate(x + 0.5 * h * k1)
    k3 = rate(x + 0.5 * h * k2)
    k4 = rate(x + h * k3)
    return x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)


Q = np.diag([1e-8, 1e-6, 1e-7])
P = np.diag([0.04, 0.04, 4e-4])
X = np.array([1.0, 0.0, 0.0])


def test_extended_filter_and_smoother_agree_with_filterpy():
    from scipy.linalg import expm

    system = pendulum()
    y = readings(system)
    model = FilterModel(system, ["bob.angle"], [RandomWalk("bearing.viscous", std=0.02)])
    samples = FilterSamples(np.arange(len(y)) * STEP, np.zeros((len(y), 0)), y)
    run = extended_kalman_filter(
        model, samples, Noise(Q, np.array([1e-4]), "per_step"), Prior(X, covariance=P), keep="everything"
    )

    class Peer(filterpy.ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = step(system, self.x, STEP)

    peer = Peer(3, 1)
    peer.x, peer.P, peer.Q, peer.R = X.copy(), P.copy(), Q, np.array([[1e-4]])
    states, covariances, moved = [], [], []
    p = system.p.copy()
    for k, value in enumerate(y):
        if k:
            p[system.index("parameter", "bearing.viscous")] = 0.05 + peer.x[2]
            jac = np.zeros((3, 3))
            jac[:2, :2] = system.jacobian("x", 0.0, peer.x[:2].copy(), system.u, p)
            jac[:2, 2] = system.jacobian("p", 0.0, peer.x[:2].copy(), system.u, p)[
                :, system.index("parameter", "bearing.viscous")
            ]
            peer.F = expm(jac * STEP)
            moved.append(peer.F)
            peer.predict()
        peer.update(value, lambda x: np.array([[1.0, 0.0, 0.0]]), lambda x: x[:1])
        states.append(peer.x.copy())
        covariances.append(peer.P.copy())
    assert np.abs(run.states - np.array(states)).max() < 1e-10
    assert np.abs(run.covariances - np.array(covariances)).max() < 1e-10


def test_smoother_agrees_with_filterpy():
    from multibody import Model
    from multibody.library import Mass, Spring

    model = Model("oscillator")
    body = model.add("body", Mass(m=1.0))
    spring = model.add("spring", Spring(stiffness=30.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    system = model.build(outputs=["body.position"])
    rng = np.random.default_rng(0)
    y = 0.1 * np.cos(np.sqrt(30.0) * np.arange(300) * STEP)[:, None] + 0.01 * rng.standard_normal((300, 1))
    q, p = np.diag([1e-8, 1e-5]), np.diag([0.01, 0.1])
    run = extended_kalman_filter(
        FilterModel(system, ["body.position"]),
        FilterSamples(np.arange(300) * STEP, np.zeros((300, 0)), y),
        Noise(q, np.array([1e-4]), "per_step"),
        Prior(np.zeros(2), covariance=p),
        keep="everything",
        substeps=10,
    )
    from scipy.linalg import expm

    peer = filterpy.KalmanFilter(2, 1)
    peer.x, peer.P, peer.Q, peer.R = np.zeros(2), p, q, np.array([[1e-4]])
    peer.F, peer.H = expm(system.jacobian("x", 0.0, np.zeros(2)) * STEP), np.array([[1.0, 0.0]])
    peer.update(y[0])
    first_x, first_p = peer.x.copy(), peer.P.copy()
    means, covariances, _, _ = peer.batch_filter(list(y[1:]))
    xs = np.vstack([first_x, np.array(means)])
    ps = np.concatenate([first_p[None], np.array(covariances)])
    smoothed_x, smoothed_p, _, _ = peer.rts_smoother(xs, ps)
    found = run.smooth()
    assert np.abs(run.states - xs).max() < 1e-10
    assert np.abs(found.states - smoothed_x).max() < 1e-10
    assert np.abs(found.covariances - smoothed_p).max() < 1e-10


def test_unscented_filter_agrees_with_filterpy():
    system = pendulum()
    y = readings(system)
    model = FilterModel(system, ["bob.angle"], [RandomWalk("bearing.viscous", std=0.02)])
    samples = FilterSamples(np.arange(len(y)) * STEP, np.zeros((len(y), 0)), y)
    run = unscented_kalman_filter(
        model,
        samples,
        Noise(Q, np.array([1e-4]), "per_step"),
        Prior(X, covariance=P),
        covariances=True,
        alpha=0.8,
        beta=2.0,
        kappa=1.0,
    )
    points = filterpy.MerweScaledSigmaPoints(3, alpha=0.8, beta=2.0, kappa=1.0)
    peer = filterpy.UnscentedKalmanFilter(
        3, 1, STEP, hx=lambda x: x[:1], fx=lambda x, dt: step(system, x, dt), points=points
    )
    peer.x, peer.P, peer.Q, peer.R = X.copy(), P.copy(), Q, np.array([[1e-4]])
    states = []
    for k, value in enumerate(y):
        if k:
            peer.predict()
        else:
            peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        # filterpy reads at the points carried along; drawn again they hold the process noise.
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(value)
        states.append(peer.x.copy())
    assert np.abs(run.states - np.array(states)).max() < 1e-9
