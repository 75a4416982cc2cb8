"""Exponentials of 2000 stiff matrices at once: 5 states, 8 inputs held and ramped, norm about 100."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

COUNT, STATES, INPUTS, RATE = 2000, 5, 8, 30.0


@functools.lru_cache(maxsize=1)
def _matrices() -> tuple[np.ndarray, np.ndarray]:
    """Damped and rotating motions, a, and what drives them, b."""
    rng = np.random.default_rng(1)
    damped, turning = rng.standard_normal((2, COUNT, STATES, STATES))
    a = -damped @ damped.transpose(0, 2, 1) / STATES + 0.3 * (turning - turning.transpose(0, 2, 1))
    return RATE * a, RATE * rng.standard_normal((COUNT, STATES, INPUTS))


def bench_package() -> Callable[[], object]:
    """halving and squaring of e^a − 1, all matrices at once (as the search)"""
    from multibody.solvers.frozen import frozen_state_transition

    a, b = _matrices()
    return lambda: frozen_state_transition(a[:, None], b[:, None], np.ones(COUNT))


def bench_scipy() -> Callable[[], object]:
    """scipy.linalg.expm of the stacked matrices"""
    from scipy.linalg import expm

    a, b = _matrices()
    size = STATES + 2 * INPUTS
    whole = np.zeros((COUNT, size, size))
    whole[:, :STATES, :STATES], whole[:, :STATES, STATES : STATES + INPUTS] = a, b
    whole[:, STATES : STATES + INPUTS, STATES + INPUTS :] = np.eye(INPUTS)
    return lambda: expm(whole)
