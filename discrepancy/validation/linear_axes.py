"""Linear axes in a closed loop, made with numpy alone, to measure error rates of the statistics.

A mass follows a reference under a position and speed controller. Forces f enter the equation of motion;
position error and drive force are the outputs. To first order the outputs respond linearly to any missing
force, so a machine is its reference motion, its closed-loop filter, and a list of forces. The coefficients of
the loop change from record to record with the load. The disturbance can be white, an AR(2), a slow drift, a
disturbance during motion only, or all of them, beyond the sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities

DISTURBANCES = ("white", "ar2", "drift", "drifting sensor", "motion", "mixed")
KP, KV = 40.0, 400.0
WARM = 1.0


@dataclass(frozen=True)
class Motion:
    """Reference motion of one record: position, speed, acceleration, and the load."""

    x: Array
    v: Array
    a: Array
    mass: float


@dataclass(frozen=True)
class Axis:
    """Records of one axis."""

    motions: tuple[Motion, ...]
    dt: float

    @property
    def channels(self) -> tuple[str, str]:
        """Outputs."""
        return ("position", "force")

    def respond(self, forces: Sequence[Array]) -> list[Array]:
        """Outputs (n_t, 2, …) for one force per record, N; the first value has acted for long before."""
        return [_closed_loop(f, self.dt, m.mass) for f, m in zip(forces, self.motions, strict=True)]


def _closed_loop(force: Array, dt: float, mass: float) -> Array:
    """Position and drive force for a force on the mass: m·x'' = f + u, u = −KV·(KP·x + x')."""
    from scipy.signal import cont2discrete, lfilter

    A = np.array([[0.0, 1.0], [-KP * KV / mass, -KV / mass]])
    B = np.array([[0.0], [1.0 / mass]])
    C = np.array([[1.0, 0.0], [-KP * KV, -KV]])
    num_den = cont2discrete((A, B, C, np.zeros((2, 1))), dt, method="bilinear")
    from scipy.signal import ss2tf

    num, den = ss2tf(*num_den[:4])
    warm = np.repeat(force[:1], round(WARM / dt), axis=0)
    full = np.concatenate([warm, force])
    return np.stack([lfilter(num[c], den, full, axis=0)[len(warm) :] for c in range(2)], axis=1)


def _profile(rng: np.random.Generator, duration: float, dt: float, travel: float) -> Motion:
    """Back-and-forth moves with ramps and stops, smoothed; each record has its own targets and speeds."""
    n = round(duration / dt)
    v = np.zeros(n)
    i = int(rng.uniform(0.1, 0.4) / dt)
    pos = 0.0
    while i < n:
        target = rng.uniform(0.15, 1.0) * travel * (1 if pos <= 0 else -1) - 0.5 * pos * rng.uniform(0, 1)
        vmax = rng.uniform(0.15, 0.6)
        acc = rng.uniform(1.0, 4.0)
        dist = abs(target)
        peak = min(vmax, np.sqrt(dist * acc))
        ramp = peak / acc
        hold = max(0.0, dist / peak - ramp)
        t = np.arange(0, 2 * ramp + hold, dt)
        seg = np.sign(target) * np.clip(np.minimum(t * acc, (2 * ramp + hold - t) * acc), 0, peak)
        stop = min(n, i + len(t))
        v[i:stop] = seg[: stop - i]
        pos += float(np.sum(v[i:stop])) * dt
        i = stop + int(rng.uniform(0.1, 0.5) / dt)
    k = np.hanning(max(3, int(0.06 / dt)))
    v = np.convolve(v, k / k.sum(), mode="same")
    return Motion(np.cumsum(v) * dt, v, np.gradient(v, dt), 20.0)


def make_axis(rng: np.random.Generator, n_records: int, duration: float = 6.0, dt: float = 0.005) -> Axis:
    """Axis with ``n_records`` records of ``duration`` s."""
    motions = []
    for _ in range(n_records):
        m = _profile(rng, duration, dt, 0.5)
        motions.append(Motion(m.x, m.v, m.a, 20.0 * rng.uniform(0.8, 1.6)))
    return Axis(tuple(motions), dt)


def _smooth_sign(v: Array) -> Array:
    return np.tanh(v / 0.004)


def force_laws() -> dict[str, tuple[list[dict[str, float]], int, bool]]:
    """Kinds of force, with the shape grid, number of amplitudes and one-sidedness."""
    return {
        "coulomb_friction": ([{}], 1, True),
        "asymmetric_coulomb_friction": ([{}], 1, False),
        "viscous_friction": ([{}], 1, True),
        "stribeck_friction": ([{"speed": s} for s in (0.01, 0.02, 0.04, 0.08)], 1, True),
        "quadratic_drag": ([{}], 1, True),
        "constant_force": ([{}], 1, False),
        "linear_stiffness": ([{}], 1, False),
        "cubic_stiffness": ([{}], 1, False),
        "angle_harmonic": ([{"wavelength": w} for w in (0.02, 0.03, 0.045, 0.07, 0.1, 0.15)], 2, False),
        "local_bump": (
            [{"place": c, "width": w} for c in np.linspace(-0.2, 0.5, 12) for w in (0.01, 0.03)],
            1,
            False,
        ),
        "load_dependent_friction": ([{}], 1, True),
        "added_inertia": ([{}], 1, False),
        "hysteresis": ([{"length": s} for s in (0.002, 0.01)], 1, False),
        "input_delay": ([{}], 1, False),
    }


def law(kind: str, m: Motion, shape: dict[str, float], dt: float) -> Array:
    """Force of unit amplitude along a motion, shape (n_t, k), N."""
    x, v, a = m.x, m.v, m.a
    if kind == "coulomb_friction":
        f = -_smooth_sign(v)
    elif kind == "asymmetric_coulomb_friction":
        f = -np.abs(_smooth_sign(v))
    elif kind == "viscous_friction":
        f = -v
    elif kind == "stribeck_friction":
        f = -_smooth_sign(v) * np.exp(-((v / shape["speed"]) ** 2))
    elif kind == "quadratic_drag":
        f = -v * np.abs(v)
    elif kind == "constant_force":
        f = np.ones_like(v)
    elif kind == "linear_stiffness":
        f = -x
    elif kind == "cubic_stiffness":
        f = -(x**3)
    elif kind == "angle_harmonic":
        w = 2 * np.pi * x / shape["wavelength"]
        return np.stack([np.cos(w), np.sin(w)], axis=1)
    elif kind == "local_bump":
        f = -np.exp(-0.5 * ((x - shape["place"]) / shape["width"]) ** 2)
    elif kind == "load_dependent_friction":
        f = -_smooth_sign(v) * m.mass / 20.0
    elif kind == "added_inertia":
        f = -a
    elif kind == "hysteresis":
        f = np.zeros_like(v)
        for i in range(1, len(v)):
            f[i] = f[i - 1] - (v[i] + abs(v[i]) * f[i - 1]) * dt / shape["length"]
    elif kind == "input_delay":
        f = -np.gradient(a, dt)
    else:
        raise ValueError(f"unknown force law {kind!r}; known: {', '.join(force_laws())}")
    return f[:, None]


def candidates(axis: Axis, exclude: Sequence[str] = ()) -> list[Candidate]:
    """Every force law, and sensor faults of the position channel and of the force channel."""
    out = []
    for kind, (grid, _, one_sided) in force_laws().items():
        if kind in exclude:
            continue
        cols = [axis.respond([law(kind, m, s, axis.dt) for m in axis.motions]) for s in grid]
        out.append(
            Candidate(
                kind=kind,
                where="guide",
                sensitivities=tuple(map(tuple, cols)),
                shapes=tuple(grid),
                one_sided=one_sided,
                unit="N",
            )
        )
    for c, name in enumerate(axis.channels):
        for kind in ("sensor_offset", "sensor_drift", "sensor_gain"):
            blocks = []
            for m in axis.motions:
                z = np.zeros((len(m.x), 2, 1))
                t = np.linspace(-1, 1, len(m.x))
                nominal = m.x if c == 0 else m.mass * m.a
                z[:, c, 0] = {"sensor_offset": np.ones_like(t), "sensor_drift": t, "sensor_gain": nominal}[kind]
                blocks.append(z)
            if kind not in exclude:
                out.append(Candidate(kind=kind, where=name, sensitivities=(tuple(blocks),)))
    return out


def baseline(
    axis: Axis, kinds: Sequence[str] = ("added_inertia", "viscous_friction", "coulomb_friction")
) -> Sensitivities:
    """Sensitivities of the parameters that the model has: mass, viscous and Coulomb friction by default."""
    per = [axis.respond([law(k, m, {}, axis.dt) for m in axis.motions]) for k in kinds]
    blocks = [np.concatenate([p[b] for p in per], axis=2) for b in range(len(axis.motions))]
    return Sensitivities(names=kinds, blocks=blocks, prior_std=[2.0, 20.0, 20.0][: len(kinds)])


def _ar2(rng: np.random.Generator, n: int, freq: float, damping: float, dt: float) -> Array:
    from scipy.signal import lfilter

    r = np.exp(-damping * 2 * np.pi * freq * dt)
    den = [1.0, -2 * r * np.cos(2 * np.pi * freq * dt), r * r]
    x = lfilter([1.0], den, rng.standard_normal(n + 2000))[2000:]
    return x / np.std(x)


def _ou(rng: np.random.Generator, n: int, tau: float, dt: float) -> Array:
    from scipy.signal import lfilter

    phi = np.exp(-dt / tau)
    burn = int(8 * tau / dt)
    out: Array = lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(n + burn))[burn:]
    return out


def disturb(axis: Axis, kind: str, rng: np.random.Generator, size: float = 8.0) -> list[Array]:
    """Noise of the outputs: sensor noise and a disturbance force of about ``size`` N rms, per record."""
    out = []
    for m in axis.motions:
        before = round(WARM / axis.dt)
        n = len(m.x) + before
        f = np.zeros(n)
        if kind in ("ar2", "mixed"):
            f += size * _ar2(rng, n, 3.0, 0.15, axis.dt)
        if kind in ("drift", "mixed"):
            f += size * _ou(rng, n, 1.5, axis.dt)
        if kind == "motion":
            f += size * _ou(rng, n, 0.05, axis.dt) * np.minimum(1.0, np.abs(np.pad(m.v, (before, 0))) / 0.1)
        y = _closed_loop(f, axis.dt, m.mass)[before:]
        n = len(m.x)
        y += rng.standard_normal((n, 2)) * np.array([2e-5, 1.0])
        if kind == "drifting sensor":
            y += np.stack([2e-4 * _ou(rng, n, 3.0, axis.dt), 5.0 * _ou(rng, n, 3.0, axis.dt)], axis=1)
        out.append(y)
    return out


@dataclass(frozen=True)
class Case:
    """One simulated study: residual, sensitivities, and what was hidden."""

    residual: Residual
    sensitivities: Sensitivities
    hidden: tuple[str, ...]


def make_case(
    axis: Axis,
    disturbance: str,
    rng: np.random.Generator,
    hidden: Sequence[tuple[str, dict[str, float], Sequence[float]]] = (),
    miscalibrated: bool = True,
) -> Case:
    """Residual of a model that lacks the hidden effects (kind, shape, amplitudes), miscalibrated."""
    sens = baseline(axis)
    noise = disturb(axis, disturbance, rng)
    p = len(sens.names)
    off = sens.prior_std * rng.standard_normal(p) if miscalibrated else np.zeros(p)
    blocks = []
    for b, m in enumerate(axis.motions):
        y = noise[b] + sens.blocks[b] @ off
        for kind, shape, amp in hidden:
            y = y + _closed_loop(law(kind, m, shape, axis.dt) @ np.asarray(amp), axis.dt, m.mass)
        blocks.append(y)
    # The prior mean is zero change: the true values lie around it with the prior's own spread.
    return Case(Residual(blocks, axis.dt, axis.channels), sens, tuple(h[0] for h in hidden))
