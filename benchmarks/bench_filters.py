"""The joint filter on the cabin model: 12 + 1 states, 6 s at 1 kHz, height and acceleration measured."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np


@functools.lru_cache(maxsize=1)
def _problem() -> tuple[Any, Any, Any, Any]:
    """Filter of the alignment sensor, a trip, its samples and noise."""
    from estimation.filters import FilterSamples, Noise
    from vtsdt.alignment.filter import DELTA, TUNINGS, GuideFilter
    from vtsdt.alignment.trips import Trip
    from vtsdt.files.parameters import LiftParameters
    from vtsdt.lift.lift import Lift

    run = Lift.reference().trip("up")
    trip = Trip(name="up", time=run.times, tension=run["F_c"], height=run["z_c"], acceleration=run["zdd_c"])
    sensor = GuideFilter(parameters=LiftParameters.bench(), tuning=TUNINGS["bounded"])
    names = {name.rpartition(".")[2]: name for name in sensor.system.state_names}
    process = {names[k]: v for k, v in sensor.tuning.process.items() if k != "delta"}
    noise = Noise({**process, DELTA: 1e-3}, {"z_c": 1e-4, "zdd_c": 1e-7}, "density_times_step")
    samples = FilterSamples(trip.time, trip.tension, np.column_stack([trip.height, trip.acceleration]))
    return sensor, trip, samples, noise


def _extended(jacobian: str = "exact", **options: Any) -> Callable[[], Any]:
    from estimation.filters import FilterModel, extended_kalman_filter

    sensor, trip, samples, noise = _problem()
    model = sensor.model()
    if jacobian == "central":
        model = FilterModel(model.system, model.measured, model.latents, jacobian="central")
    prior = sensor.prior(trip)

    def work() -> None:
        extended_kalman_filter(model, samples, noise, prior, **options)

    work()
    return work


def bench_once() -> Callable[[], Any]:
    """extended, exact derivatives, linearised once a sample (as vtsdt align)"""
    return _extended(once=True)


def bench_twice() -> Callable[[], Any]:
    """extended, exact derivatives, linearised twice a sample"""
    return _extended()


def _online(size: int, *, unscented: bool = False) -> Callable[[], Any]:
    """Return the filter fed by blocks of some samples; the seconds that it gives are those of one sample."""
    from estimation.filters import OnlineFilter

    sensor, trip, samples, noise = _problem()
    model, prior = sensor.model(), sensor.prior(trip)
    options: dict[str, Any] = {"once": True}
    if unscented:
        from vtsdt.alignment.filter import TUNINGS, GuideFilter

        quiet = GuideFilter(parameters=sensor.parameters, tuning=TUNINGS["quiet"])
        model, prior, noise = quiet.model(), quiet.prior(trip), quiet.run(trip).noise
        options = {"method": "unscented"}

    def work() -> float:
        twin, took = OnlineFilter(model, noise, prior, **options), []
        for k in range(0, samples.count - size + 1, size):
            rows = slice(k, k + size)
            start = time.perf_counter()
            twin.step(samples.times[rows], samples.inputs[rows], samples.readings[rows])
            took.append((time.perf_counter() - start) / size)
        return float(np.median(took))

    return work


def bench_online_sample() -> Callable[[], Any]:
    """beside the machine, one sample at a time: time of one (median)"""
    return _online(1)


def bench_online_block() -> Callable[[], Any]:
    """beside the machine, blocks of 20 samples: time of one (median)"""
    return _online(20)


def bench_online_unscented() -> Callable[[], Any]:
    """unscented beside the machine, one sample at a time: time of one (median)"""
    return _online(1, unscented=True)


def bench_central() -> Callable[[], Any]:
    """extended, central differences, linearised once a sample"""
    return _extended("central", once=True)


def bench_square_root() -> Callable[[], Any]:
    """extended, exact derivatives, once a sample, square root"""
    return _extended(once=True, square_root=True)


def bench_unscented() -> Callable[[], Any]:
    """unscented, 27 points"""
    from estimation.filters import unscented_kalman_filter
    from vtsdt.alignment.filter import TUNINGS, GuideFilter

    sensor, trip, samples, _ = _problem()
    quiet = GuideFilter(parameters=sensor.parameters, tuning=TUNINGS["quiet"])
    model, prior, quiet_noise = quiet.model(), quiet.prior(trip), quiet.run(trip).noise

    def work() -> None:
        unscented_kalman_filter(model, samples, quiet_noise, prior)

    work()
    return work


def _for_peers() -> tuple[Any, ...]:
    """Return samples, model, system, covariances, prior, number of states and the index of δ, for other programs."""
    sensor, trip, samples, noise = _problem()
    model, system = sensor.model(), sensor.system
    n, at = len(system.states), system.index("parameter", "cabin_guide.right_deviation")
    return samples, model, system, noise.of(model), sensor.prior(trip).of(model), n, at


def bench_filterpy() -> Callable[[], Any]:
    """filterpy's extended filter with our compiled rates and exact derivatives, a fiftieth of the trip times fifty"""
    from time import process_time

    try:
        from filterpy.kalman import ExtendedKalmanFilter
    except ImportError:
        return lambda: float("nan")
    from scipy.linalg import expm

    samples, _, system, (q, r), (x0, p0), n, at = _for_peers()
    z, acceleration = system.index("output", "z_c"), system.index("output", "zdd_c")

    def derivatives(x: np.ndarray, u: np.ndarray, p: np.ndarray, of: str) -> np.ndarray:
        by_x = system.jacobian("x", 0.0, x[:n], u, p, of=of)
        by_p = system.jacobian_along("p", np.zeros(1), x[None, :n], u[None], p, of=of, columns=np.array([at]))[0]
        return np.hstack([by_x, by_p])

    class Peer(ExtendedKalmanFilter):
        def predict_x(self, u: Any = 0) -> None:
            p = self.p

            def rate(s: np.ndarray) -> np.ndarray:
                return np.append(system.rhs(0.0, s[:n], u, p), 0.0)

            h, x = 1e-3, self.x
            k_1 = rate(x)
            k_2 = rate(x + 0.5 * h * k_1)
            k_3 = rate(x + 0.5 * h * k_2)
            k_4 = rate(x + h * k_3)
            self.x = x + h / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4)

    count = samples.count // 50

    def work() -> float:
        begun = process_time()
        peer = Peer(n + 1, 2)
        peer.x, peer.P, peer.Q, peer.R = x0.copy(), p0.copy(), 1e-3 * q, np.diag(r)
        p = system.p.copy()
        for k in range(count):
            u = samples.inputs[k]
            p[at] = peer.x[n]
            peer.p = p
            jac = np.zeros((n + 1, n + 1))
            jac[:n] = derivatives(peer.x, u, p, "rhs")
            peer.F = expm(1e-3 * jac)
            peer.predict(u)
            p[at] = peer.x[n]
            rows = derivatives(peer.x, u, p, "outputs")[[z, acceleration]]
            expected = system.outputs_at(0.0, peer.x[:n], u, p)[[z, acceleration]]
            peer.update(samples.readings[k], lambda x, rows=rows: rows, lambda x, expected=expected: expected)
        return 50.0 * (process_time() - begun)

    work()
    return work


def _traced(text: str, name: str) -> Callable[..., list[Any]]:
    """Return the generated rates as a function that JAX can trace: branches of the contact become selections."""
    import ast
    import types

    import jax.numpy as jnp

    def face(depth: Any, rate: Any, K: Any, C: Any, ramp: Any) -> Any:
        share = jnp.clip(depth / ramp, 0.0, 1.0)
        pressed = K * depth + C * share * share * (3.0 - 2.0 * share) * rate
        return jnp.where(depth > 0.0, jnp.maximum(pressed, 0.0), 0.0)

    tree = ast.parse(text)
    tree.body = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name != "f_guide_face"]
    spot = types.SimpleNamespace(**{n: getattr(jnp, n) for n in ("sin", "cos", "tanh", "sqrt")}, fabs=jnp.abs)
    scope: dict[str, Any] = {"math": spot, "f_guide_face": face, "min": jnp.minimum, "max": jnp.maximum, "abs": jnp.abs}
    exec(compile(tree, "<rates>", "exec"), scope)  # the text is this project's own
    return scope[name]


def bench_dynamax() -> Callable[[], Any]:
    """dynamax's extended filter (JAX, compiled before) on the same rates, its own derivatives, RK4"""
    try:
        import jax

        jax.config.update("jax_enable_x64", True)
        import jax.numpy as jnp
        from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter
    except ImportError:
        return lambda: float("nan")
    samples, model, system, (q, r), (x0, p0), n, at = _for_peers()
    rhs, nominal, acceleration = _traced(system.texts["rhs"], "rhs"), jnp.asarray(system.p), model.channels[1][1]

    def rate(z: Any, u: Any) -> Any:
        out: dict[int, Any] = {}
        rhs(0.0, z, u, nominal.at[at].add(z[n]), out)
        return jnp.stack([*(out[k] for k in range(n)), jnp.zeros(())])

    def carried(z: Any, u: Any) -> Any:
        h, middle = 1e-3, 0.5 * (u[:1] + u[1:])
        k_1 = rate(z, u[:1])
        k_2 = rate(z + 0.5 * h * k_1, middle)
        k_3 = rate(z + 0.5 * h * k_2, middle)
        k_4 = rate(z + h * k_3, u[1:])
        return z + h / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4)

    def reading(z: Any, u: Any) -> Any:
        return jnp.stack([z[2], rate(z, u[:1])[acceleration]])

    parameters = ParamsNLGSSM(
        initial_mean=jnp.asarray(x0),
        initial_covariance=jnp.asarray(p0),
        dynamics_function=carried,
        dynamics_covariance=jnp.asarray(1e-3 * q),
        emission_function=reading,
        emission_covariance=jnp.diag(jnp.asarray(r)),
    )
    u = samples.inputs[:, 0]
    both = jnp.asarray(np.column_stack([u, np.append(u[1:], u[-1])]))
    wanted = ["filtered_means", "filtered_covariances"]
    run = jax.jit(lambda y: extended_kalman_filter(parameters, y, both, output_fields=wanted).filtered_means)
    readings = jnp.asarray(samples.readings)

    def work() -> None:
        run(readings).block_until_ready()

    work.estimate = lambda: np.asarray(run(readings))  # type: ignore[attr-defined]
    work()
    return work
