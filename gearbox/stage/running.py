"""Running a gear stage: start under load at rest, choice of method, steady signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.errors import GearError
from gearbox.stage.rest import balanced, touching
from multibody.base.errors import ModelError
from multibody.base.spelling import nearest

if TYPE_CHECKING:
    from gearbox.stage.stage import Stage
    from multibody.machine.model import System
    from multibody.system.trajectory import Trajectory

__all__ = ["SHORT_NAMES", "cheapest_method", "contact_rate", "model_values", "moving_state", "run", "static_state"]

Array = NDArray[np.float64]

#: the paper's names of the contact parameters, and the model's
SHORT_NAMES = {"K": "mesh.K", "C_D": "mesh.C_D", "e_F": "mesh.e", "D_P": "mesh.D_P"}
#: time for the start to die away, s
SETTLE = 0.15
#: states that grow without limit
ANGLES = ("drive.angle", "input_shaft.spin_angle", "output_shaft.spin_angle")
#: size of the vibrations that a tolerance is a share of, m/s, rad/s
SWING = 1e-2
#: rate of the contact damper (1/s) and relative tolerance from which the exponential method pays
STIFF, LOOSE = 4e4, 1e-5


def model_values(stage: Stage, changes: Mapping[str, float]) -> dict[str, float]:
    """Return parameters of a stage's model by full name for changes of physical ones.

    Parameters
    ----------
    stage : Stage
    changes : mapping of str to float
        ``K``, ``C_D``, ``e_F``, ``D_P``, ``E``, ``rho`` in SI (K in N at 1 mm), or full names.  A density changes
        masses and inertias of both shafts; an elastic modulus changes K in proportion (Eqs. 15 and 17), unless K is
        given.

    Raises
    ------
    GearError
        With every name that is unknown and every number that is not finite.
    """
    known = {f"{n}.{p}" for n, c in stage.components.items() for p in c.values}
    found: dict[str, float] = {}
    faults = []
    for name, value in changes.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
            faults.append(f"{name} is {value!r}: give a finite number")
        elif name in SHORT_NAMES:
            found[SHORT_NAMES[name]] = float(value)
        elif name in known:
            found[name] = float(value)
        elif name not in ("E", "rho"):
            faults.append(f"there is no parameter '{name}'{nearest(name, [*SHORT_NAMES, 'E', 'rho', *known])}")
        elif not float(value) > 0.0:
            faults.append(f"{name} is {value:g}: give a positive number")
    if faults:
        raise GearError(f"the parameters of '{stage.name}'", faults)
    if "E" in changes:
        ratio = float(changes["E"]) / stage.parameters.material.modulus
        found.setdefault("mesh.K", stage.parameters.contact.K * ratio)
    if "rho" in changes:
        other = stage.parameters.replaced("material", density=float(changes["rho"]))
        for gear, side in enumerate(("input_shaft", "output_shaft")):
            for name, value in zip(("mass", "J", "J_t"), other.body(gear), strict=True):
                found.setdefault(f"{side}.{name}", value)
    return found


def _mean_force(stage: Stage, torque: float) -> float:
    """Normal tooth force without friction, N: T / (r_b2 cos β_b)."""
    return torque / (stage.pair.base_radii[1] * float(np.cos(stage.pair.base_helix_angle)))


def _mean_depth(stage: Stage, force: float, values: Mapping[str, float]) -> float:
    """Penetration at which the mean length of the lines of contact carries a force, m."""
    share = stage.pair.transverse_contact_ratio
    K, e = values["mesh.K"], values["mesh.e"]
    return 1e-3 * float((max(force, 0.0) / (share * K)) ** (1.0 / e))


def _all_values(stage: Stage, parameters: Mapping[str, float] | None) -> dict[str, float]:
    own = {f"{n}.{k}": v for n, c in stage.components.items() for k, v in c.values.items()}
    return {**own, **(parameters or {})}


def static_state(
    stage: Stage,
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
    stage : Stage
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
    p = _all_values(stage, parameters)
    pair = stage.pair
    state = system.state_vector()
    angles = _turned(stage, system, angle)
    state[list(angles)] = list(angles.values())
    if torque == 0.0:
        return state
    force = _mean_force(stage, torque)
    sign = float(np.sign(force))
    cos_b = np.cos(pair.base_helix_angle)
    alpha = pair.working_pressure_angle
    guess: dict[str, float] = {}
    push = {"x": abs(force) * cos_b * np.sin(alpha), "y": force * cos_b * np.cos(alpha),
            "z": -force * np.sin(pair.base_helix_angle)}  # fmt: skip
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
    depth = sign * _mean_depth(stage, abs(force), p)
    torque_1 = torque * pair.base_radii[0] / pair.base_radii[1]
    wind = torque_1 / p["coupling.stiffness"] if "coupling.stiffness" in p else 0.0
    parted = sum(
        (gives["output"][axis] - gives["input"][axis]) * np.sign(push[axis]) * abs(push[axis]) / force for axis in push
    )
    lead = -wind
    # what is missing along the line of action goes into the output shaft's angle
    closing = (depth / cos_b + parted / cos_b) + (0.0 if sign > 0 else -pair.normal_backlash / cos_b)
    ahead = {"input_shaft.spin_angle": lead,
             "output_shaft.spin_angle": (closing - pair.base_radii[0] * lead) / pair.base_radii[1]}  # fmt: skip
    for name, value in {**guess, **ahead}.items():
        if name in system.state_names:
            state[system.index("state", name)] += value
    u = system.input_vector({"speed": 0.0, "torque": torque})
    values = system.parameter_vector(dict(parameters or {}))
    turn = sign * 5e-6 / p["mesh.base_2"]
    state = touching(system, state, u, values, "output_shaft", free=torque / p["output_shaft.J"], step=float(turn))
    return balanced(system, state, u, values, lambda name: name.startswith(("drive.", "energy.")))


def _turned(stage: Stage, system: System, angle: float) -> dict[int, float]:
    """States of the angles when the drive stands at an angle and nothing is loaded."""
    wanted = {
        "drive.angle": angle,
        "input_shaft.spin_angle": angle,
        "output_shaft.spin_angle": -angle / stage.pair.ratio,
    }
    return {system.index("state", n): v for n, v in wanted.items() if n in system.state_names}


def run(
    stage: Stage,
    speed: float,
    torque: float,
    duration: float = 1.0,
    *,
    rate: float = 25600.0,
    settle: float = SETTLE,
    parameters: Mapping[str, float] | None = None,
    initial: Array | None = None,
    system: System | None = None,
    inputs: Mapping[str, Any] | None = None,
    method: str = "auto",
    angle: float = 0.0,
    rtol: float = 1e-4,
    atol: float = 1e-8,
    **options: Any,
) -> Trajectory:
    """Run a stage from its static state.

    Parameters
    ----------
    stage : Stage
    speed : float, r/min
        Of the driving gear.
    torque : float, N m
        Load on the output shaft, against its turning.
    duration : float, s
        Of the record.
    rate : float, Hz
        Of the record.
    settle : float, s
        Time before the record in which the start dies away.
    parameters : mapping, optional
        Model parameters by full name, SI; see `model_values`.
    initial : ndarray, optional
        State at the start; default: the static state with all speeds.
    system : System, optional
        What is simulated; default: ``stage.system``.
    inputs : mapping, optional
        ``speed`` (rad/s) or ``torque`` over time, as `multibody.system.simulate.simulate` takes them, in place of
        constants.
    method : str
        As for `multibody.system.simulate.simulate`; ``"auto"`` takes what `cheapest_method` names.
    angle : float, rad
        Of the drive at the start of the run.
    rtol, atol : float
        Tolerances; the relative one of the angles, which grow without limit, is 1e-9, and speeds that swing about zero
        are as exact as a swing of 0.01 m/s or rad/s asks for.
    options
        Further arguments of `multibody.system.simulate.simulate`.

    Returns
    -------
    Trajectory
        ``rate · duration`` samples from t = 0; the start lies at −settle.

    Raises
    ------
    GearError
        With every number that makes no sense.
    """
    finite = (("speed", speed, "r/min"), ("torque", torque, "N m"))
    faults = [f"{n} is {v!r}: give a finite number in {u}" for n, v, u in finite if not np.isfinite(v)]
    positive = (("duration", duration), ("rate", rate))
    faults += [f"{n} is {v:g}: give a positive number" for n, v in positive if not v > 0.0]
    if not settle >= 0.0:
        faults.append(f"settle is {settle:g} s: give zero or more")
    count = round(duration * rate)
    if not faults and count < 2:
        faults.append(f"{duration:g} s at {rate:g} Hz are fewer than two samples: enlarge one of them")
    if faults:
        raise GearError(f"the run of '{stage.name}'", faults)
    system = system or stage.system
    try:
        system.parameter_vector(dict(parameters or {}))
    except ModelError as error:
        raise GearError(f"the run of '{stage.name}'", error.faults) from None
    omega = 2.0 * np.pi * speed / 60.0
    if initial is None:
        initial = moving_state(stage, speed, torque, system=system, parameters=parameters, angle=angle)
    if method == "auto":
        method = cheapest_method(stage, torque, parameters, rtol)
    times = np.arange(count) / rate
    return system.simulate(
        (-settle, float(times[-1])),
        inputs={"speed": omega, "torque": torque, **(inputs or {})},
        parameters=dict(parameters or {}),
        initial=initial,
        times=times,
        method=method,
        **_tolerances(system, method, rtol, atol),
        **options,
    )


def _tolerances(system: System, method: str, rtol: float, atol: float) -> dict[str, Any]:
    """Return the tolerances of all states.

    Angles grow without limit: their relative tolerance is small.  Speeds that swing about zero have an absolute one,
    a share of `SWING`, where the method can make use of it: a share of what they are would shorten every step in which
    one of them passes through zero.  An explicit method that stability holds back would only lose accuracy by that.
    """
    relative, absolute = np.full(len(system.states), rtol), np.full(len(system.states), atol)
    angles = [system.index("state", name) for name in ANGLES if name in system.state_names]
    relative[angles] = min(rtol, 1e-9)
    if method == "Exponential43":
        swinging = [speed for place, speed in system.rate_states.items() if place not in angles]
        relative[swinging], absolute[swinging] = 1e-2 * rtol, max(rtol * SWING, atol)
    return {"rtol": relative, "atol": absolute}


def contact_rate(stage: Stage, torque: float, parameters: Mapping[str, float] | None = None) -> float:
    """Return the rate at which the contact damper lets the gears' relative spin die away, 1/s.

    It is C_D·step(δ; 0, 0, D_P, 1)·cos²β_b·(r_b1²/J_1 + r_b2²/J_2) at the mean penetration δ: the fastest motion of a
    stage, which limits explicit steps.  Lines that share the load unevenly make it up to twice as fast.

    Parameters
    ----------
    stage : Stage
    torque : float, N m
    parameters : mapping, optional
        Full names, SI.

    Examples
    --------
    >>> from gearbox.stage.stage import Stage
    >>> 1e4 < contact_rate(Stage.paper(), 150.0) < 1e5
    True
    """
    p = _all_values(stage, parameters)
    share = min(_mean_depth(stage, abs(_mean_force(stage, torque)), p) / p["mesh.D_P"], 1.0)
    (r_1, r_2), cos_b = stage.pair.base_radii, float(np.cos(stage.pair.base_helix_angle))
    yielding = cos_b**2 * (r_1**2 / p["input_shaft.J"] + r_2**2 / p["output_shaft.J"])
    return float(p["mesh.C_D"] * share**2 * (3.0 - 2.0 * share) * yielding)


def cheapest_method(
    stage: Stage, torque: float, parameters: Mapping[str, float] | None = None, rtol: float = 1e-4
) -> str:
    """Return the method that was cheapest at equal error of the accelerations.

    The explicit method where the contact damper does not limit its steps much, or where accuracy does; the exponential
    one, which follows the damper's motion exactly, elsewhere.  The implicit one pays for a Jacobian of all states at
    each step: it was two to ten times slower at every corner of Table 3 (docs, "Benchmarks").
    """
    return "Exponential43" if rtol >= LOOSE and contact_rate(stage, torque, parameters) > STIFF else "DormandPrince54"


def moving_state(stage: Stage, speed: float, torque: float, **options: Any) -> Array:
    """Return the static state under a load with the speeds of steady running; see `static_state`.

    Parameters
    ----------
    stage : Stage
    speed : float, r/min
    torque : float, N m
    """
    system = options.get("system") or stage.system
    return _moving(stage, system, static_state(stage, torque, **options), 2.0 * np.pi * speed / 60.0)


def _moving(stage: Stage, system: System, state: Array, omega: float) -> Array:
    """Give a state at rest the speeds of steady running."""
    state = state.copy()
    speeds = {
        "drive.speed": omega,
        "input_shaft.spin_speed": omega,
        "output_shaft.spin_speed": -omega / stage.pair.ratio,
    }
    for name, value in speeds.items():
        if name in system.state_names:
            state[system.index("state", name)] = value
    return state
