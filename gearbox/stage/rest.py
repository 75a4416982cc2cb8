"""The state at rest of a loaded gear stage: the gap closed first, then Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["balanced", "touching"]

Array = NDArray[np.float64]

#: steps of the differences: m, rad and modal coordinates are all of the size of 1e-5 and bend over about that length
_DIFFERENCE = 1e-9


def touching(
    system: System, state: Array, u: Array, p: Array, turning: str, *, free: float, step: float, most: int = 400
) -> Array:
    """Turn a shaft until something resists its load, and return that state.

    Parameters
    ----------
    system : System
    state, u, p : ndarray
        State, inputs, parameters.
    turning : str
        Shaft whose ``spin_angle`` is changed.
    free : float, rad/s²
        Its acceleration without resistance.
    step : float, rad
        By which it is turned each time.
    most : int
        Number of steps before giving up.

    Raises
    ------
    SimulationError
        If the teeth do not meet.
    """
    angle = system.index("state", f"{turning}.spin_angle")
    speed = system.index("state", f"{turning}.spin_speed")
    state = state.copy()
    for _ in range(most):
        if abs(free - system.rhs(0.0, state, u, p)[speed]) > 0.05 * abs(free):
            return state
        state[angle] += step
    raise SimulationError(
        f"the teeth of '{system.name}' do not meet within {most * abs(step):.3g} rad: look at backlash and clearances"
    )


def balanced(
    system: System,
    state: Array,
    u: Array,
    p: Array,
    held: Callable[[str], bool],
    *,
    iterations: int = 60,
    tolerance: float = 1e-7,
) -> Array:
    """Return the state at rest near a guess: positions for which nothing accelerates.

    Newton's method with differences in place of the exact Jacobian, whose compilation takes longer than all else.

    Parameters
    ----------
    system : System
    state, u, p : ndarray
        Guess with all speeds zero, inputs, parameters.
    held : callable
        Tells by name which states keep their guess.
    tolerance : float
        Largest acceleration left over, relative to that at the guess.

    Raises
    ------
    SimulationError
        If no balance is found, with what remains.
    """
    pairs = [(k, r) for k, r in system.rate_states.items() if not held(system.state_names[k])]
    where, rates = (np.array(part, dtype=int) for part in zip(*pairs, strict=True))

    def accelerations(x: Array) -> Array:
        return np.asarray(system.rhs(0.0, x, u, p))[rates]

    state = state.copy()
    f = accelerations(state)
    size = float(np.max(np.abs(f), initial=1e-12))
    for _ in range(iterations):
        J = np.empty((rates.size, where.size))
        for column, k in enumerate(where):
            moved = state.copy()
            moved[k] += _DIFFERENCE
            J[:, column] = (accelerations(moved) - f) / _DIFFERENCE
        weight = 1.0 / np.maximum(np.abs(J).max(axis=1), 1e-300)
        change = -np.linalg.lstsq(weight[:, None] * J, weight * f, rcond=1e-12)[0]
        factor, norm = 1.0, float(np.linalg.norm(weight * f))
        while factor > 1e-4:
            trial = state.copy()
            trial[where] += factor * change
            g = accelerations(trial)
            if np.all(np.isfinite(g)) and float(np.linalg.norm(weight * g)) < (1.0 - 1e-3 * factor) * norm:
                break
            factor *= 0.5
        else:
            break
        state, f = trial, g
        if float(np.max(np.abs(f))) <= tolerance * size and float(np.max(np.abs(factor * change))) < 1e-11:
            break
    if not float(np.max(np.abs(f))) <= 1e-4 * size:
        worst = sorted(range(rates.size), key=lambda i: -abs(f[i]))[:6]
        lines = "\n".join(f"  - {system.state_names[rates[i]]}: {f[i]:.4g} per second" for i in worst)
        raise SimulationError(f"'{system.name}' has no rest near the guess; what remains:\n{lines}")
    return state
