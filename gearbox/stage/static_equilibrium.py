"""The state at rest of a loaded gear stage: the gap closed first, then Newton's method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.stage.model import GearModel
from multibody.base.errors import SimulationError
from multibody.machine.model import System

__all__ = ["all_values", "mean_depth", "mean_force", "moving_state", "static_state"]

Array = NDArray[np.float64]

#: steps of the differences: m, rad and modal coordinates are all of the size of 1e-5 and bend over about that length
_DIFFERENCE = 1e-9


def mean_force(stage: GearModel, torque: float) -> float:
    """Normal tooth force without friction, N: T / (r_b2 cos β_b)."""
    return torque / (stage.pair.base_radii[1] * float(np.cos(stage.pair.base_helix_angle)))


def mean_depth(stage: GearModel, force: float, values: Mapping[str, float]) -> float:
    """Penetration at which the mean length of the lines of contact carries a force, m."""
    share = stage.pair.transverse_contact_ratio
    K, e = values["mesh.K"], values["mesh.e"]
    return 1e-3 * float((max(force, 0.0) / (share * K)) ** (1.0 / e))


def all_values(stage: GearModel, parameters: Mapping[str, float] | None) -> dict[str, float]:
    """Return all parameters of the model by full name, changed ones replaced."""
    own = {f"{n}.{k}": v for n, c in stage.components.items() for k, v in c.values.items()}
    return {**own, **(parameters or {})}


def static_state(
    stage: GearModel,
    torque: float,
    *,
    system: System | None = None,
    parameters: Mapping[str, float] | None = None,
    angle: float = 0.0,
) -> Array:
    """Return the state at rest under a load, the drive held.

    The gap between the teeth is closed until there is force before Newton's method begins: without contact nothing
    resists the load, and there is no way downhill.

    Parameters
    ----------
    stage : GearModel
    torque : float, N m
        Load on the output shaft; at zero the teeth just touch.
    system : System, optional
        The stage built with other options; default: ``stage.system``.
    parameters : mapping, optional
        Full names, SI.
    angle : float, rad
        Of the drive: position in the mesh cycle.

    Raises
    ------
    SimulationError
        If the load finds no rest.
    """
    system = system or stage.system
    p = all_values(stage, parameters)
    pair = stage.pair
    state = system.state_vector()
    angles = _turned(stage, system, angle)
    state[list(angles)] = list(angles.values())
    if torque == 0.0:
        return state
    force = mean_force(stage, torque)
    sign = float(np.sign(force))
    cos_b = np.cos(pair.base_helix_angle)
    alpha = pair.working_pressure_angle
    guess: dict[str, float] = {}
    push = {
        "x": abs(force) * cos_b * np.sin(alpha),
        "y": force * cos_b * np.cos(alpha),
        "z": -force * np.sin(pair.base_helix_angle),
    }
    across = float(np.hypot(push["x"], push["y"]))
    gives = {}
    for gear, side in enumerate(("input", "output")):
        way = -1.0 if gear == 0 else 1.0
        bearing = f"{side}_low"
        for axis, f in push.items():
            name = f"{side}_shaft.{axis}_position"
            if name not in system.state_names or f"{bearing}.stiffness_radial" not in p:
                continue
            if axis == "z":
                guess[name] = way * f / p[f"{bearing}.stiffness_axial"]
            else:
                soft = 1.0 / (2.0 * p[f"{bearing}.stiffness_radial"])
                guess[name] = way * f * (soft + p[f"{bearing}.clearance"] / across)
        gives[side] = {axis: guess.get(f"{side}_shaft.{axis}_position", 0.0) for axis in push}
    depth = sign * mean_depth(stage, abs(force), p)
    torque_1 = torque * pair.base_radii[0] / pair.base_radii[1]
    wind = torque_1 / p["coupling.stiffness"] if "coupling.stiffness" in p else 0.0
    parted = sum(
        (gives["output"][axis] - gives["input"][axis]) * np.sign(push[axis]) * abs(push[axis]) / force for axis in push
    )
    lead = -wind
    # what is missing along the line of action goes into the output shaft's angle
    closing = (depth / cos_b + parted / cos_b) + (0.0 if sign > 0 else -pair.normal_backlash / cos_b)
    ahead = {
        "input_shaft.spin_angle": lead,
        "output_shaft.spin_angle": (closing - pair.base_radii[0] * lead) / pair.base_radii[1],
    }
    for name, value in {**guess, **ahead}.items():
        if name in system.state_names:
            state[system.index("state", name)] += value
    u = system.input_vector({"speed": 0.0, "torque": torque})
    values = system.parameter_vector(dict(parameters or {}))
    turn = sign * 5e-6 / p["mesh.base_2"]
    state = _touching(system, state, u, values, "output_shaft", free=torque / p["output_shaft.J"], step=float(turn))
    try:
        return _balanced(system, state, u, values, _held)
    except SimulationError:
        play = [system.index("parameter", n) for n in p if n.endswith(".clearance") and p[n] > 0.0]
        if not play:
            raise
        return _with_growing_play(system, state, u, values, play)


def _held(name: str) -> bool:
    return name.startswith(("drive.", "energy."))


def _with_growing_play(system: System, state: Array, u: Array, p: Array, play: Sequence[int], steps: int = 8) -> Array:
    """Return the state at rest, found without play in the bearings first, which then grows.

    Bearings with unequal play tilt their shaft, and at a light load Newton's method does not find the tilt from afar.

    Parameters
    ----------
    system : System
    state, u, p : ndarray
        Guess, inputs, parameters.
    play : sequence of int
        Where the clearances stand among the parameters.
    steps : int
    """
    whole = p[play].copy()
    for k in range(steps + 1):
        p = p.copy()
        p[play] = whole * k / steps
        state = _balanced(system, state, u, p, _held)
    return state


def _turned(stage: GearModel, system: System, angle: float) -> dict[int, float]:
    """States of the angles when the drive stands at an angle and nothing is loaded."""
    wanted = {
        "drive.angle": angle,
        "input_shaft.spin_angle": angle,
        "output_shaft.spin_angle": -angle / stage.pair.ratio,
    }
    return {system.index("state", n): v for n, v in wanted.items() if n in system.state_names}


def moving_state(stage: GearModel, speed: float, torque: float, **options: Any) -> Array:
    """Return the static state under a load with the speeds of steady running; see `static_state`.

    Parameters
    ----------
    stage : GearModel
    speed : float, r/min
    torque : float, N m
    """
    system = options.get("system") or stage.system
    state = static_state(stage, torque, **options)
    omega = 2.0 * np.pi * speed / 60.0
    speeds = {
        "drive.speed": omega,
        "input_shaft.spin_speed": omega,
        "output_shaft.spin_speed": -omega / stage.pair.ratio,
    }
    for name, value in speeds.items():
        if name in system.state_names:
            state[system.index("state", name)] = value
    return state


def _touching(
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


def _balanced(
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
