"""A force along the way: its period, its parts for both directions of travel, and the parts of records to shuffle."""

from __future__ import annotations

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.hat_functions import hat_functions, quantile_knots

__all__ = ["find_period", "record_parts", "split_directions"]


def record_parts(n: int, blocks: Array | None, least: int = 8) -> list[Array]:
    """Return the rows of each record; a few records are cut into at least ``least`` parts in all."""
    ids = np.zeros(n, dtype=int) if blocks is None else np.asarray(blocks)
    starts = np.flatnonzero(np.concatenate([[True], ids[1:] != ids[:-1]]))
    records = np.split(np.arange(n), starts[1:])
    out: list[Array] = []
    for r in records:
        parts = 1 if len(records) >= least else max(1, round(least * len(r) / n))
        out += np.array_split(r, parts)
    return out


def split_directions(force: Array, x: Array, direction: Array, n_knots: int = 12) -> tuple[Array, Array, Array]:
    """Return knots, and the even and odd part of a force over a regressor; NaN where a direction is missing."""
    knots = quantile_knots(np.asarray(x), n_knots)
    means = []
    for sign in (1.0, -1.0):
        sel = np.sign(direction) == sign
        T = hat_functions(np.asarray(x)[sel], knots)
        mass = T.sum(axis=0)
        means.append(np.where(mass > 3, T.T @ force[sel] / np.maximum(mass, 1e-12), np.nan))
    return knots, 0.5 * (means[0] + means[1]), 0.5 * (means[0] - means[1])


def find_period(
    force: Array,
    x: Array,
    *,
    blocks: Array | None = None,
    draws: int = 200,
    seed: int = 0,
    n_periods: int = 400,
) -> tuple[float, float, float]:
    """Return the period of a force in position or angle, its share of the variance, and p from shuffled parts."""
    f = np.asarray(force, float) - float(np.mean(force))
    x = np.asarray(x, float)
    span = float(np.ptp(x))
    if span == 0:
        raise ValueError("the regressor is constant; it has no period")
    step = float(np.quantile(np.abs(np.diff(x)), 0.9))
    shortest = max(span / 200.0, 4.0 * step)
    ks = np.linspace(1.5 / span, 1.0 / shortest, n_periods)
    spans = record_parts(len(f), blocks)
    rng = np.random.default_rng(seed)
    F = np.empty((len(f), draws + 1))
    F[:, 0] = f
    for j in range(1, draws + 1):
        for target, src in zip(spans, rng.permutation(len(spans)), strict=True):
            s = spans[src]
            F[target, j] = f[s[(rng.integers(len(s)) + np.arange(len(target))) % len(s)]] * rng.choice([-1.0, 1.0])
    energy = np.sum(F**2, axis=0)
    power = np.empty((n_periods, draws + 1))
    for i, k in enumerate(ks):
        q, _ = np.linalg.qr(np.column_stack([np.cos(2 * np.pi * k * x), np.sin(2 * np.pi * k * x)]))
        power[i] = np.sum((q.T @ F) ** 2, axis=0) / energy
    best = int(np.argmax(power[:, 0]))
    p = (1.0 + float(np.sum(power[:, 1:].max(axis=0) >= power[best, 0]))) / (draws + 1.0)
    return float(1.0 / ks[best]), float(power[best, 0]), p
