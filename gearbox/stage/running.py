"""Running a gear stage: choice of method, tolerances, steady signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.errors import GearError
from gearbox.stage.model import GearModel
from gearbox.stage.static_equilibrium import all_values, mean_depth, mean_force, moving_state
from multibody.base.errors import ModelError
from multibody.machine.model import System
from multibody.system.trajectory import Trajectory

__all__ = ["cheapest_method", "run"]

Array = NDArray[np.float64]

#: time for the start to die away, s
SETTLE = 0.15
#: states that grow without limit
ANGLES = ("drive.angle", "input_shaft.spin_angle", "output_shaft.spin_angle")
#: size of the vibrations that a tolerance is a share of, m/s, rad/s
SWING = 1e-2
#: rate of the contact damper (1/s) and relative tolerance from which the exponential method pays
STIFF, LOOSE = 4e4, 1e-5


def run(
    stage: GearModel,
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
    stage : GearModel
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
        Model parameters by full name, SI; see `GearModel.values`.
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


def contact_rate(stage: GearModel, torque: float, parameters: Mapping[str, float] | None = None) -> float:
    """Return the rate at which the contact damper lets the gears' relative spin die away, 1/s.

    It is C_D·step(δ; 0, 0, D_P, 1)·cos²β_b·(r_b1²/J_1 + r_b2²/J_2) at the mean penetration δ: the fastest motion of a
    stage, which limits explicit steps.  Lines that share the load unevenly make it up to twice as fast.

    Parameters
    ----------
    stage : GearModel
    torque : float, N m
    parameters : mapping, optional
        Full names, SI.

    Examples
    --------
    >>> from gearbox.stage.model import GearModel
    >>> 1e4 < contact_rate(GearModel.paper(), 150.0) < 1e5
    True
    """
    p = all_values(stage, parameters)
    share = min(mean_depth(stage, abs(mean_force(stage, torque)), p) / p["mesh.D_P"], 1.0)
    (r_1, r_2), cos_b = stage.pair.base_radii, float(np.cos(stage.pair.base_helix_angle))
    yielding = cos_b**2 * (r_1**2 / p["input_shaft.J"] + r_2**2 / p["output_shaft.J"])
    return float(p["mesh.C_D"] * share**2 * (3.0 - 2.0 * share) * yielding)


def cheapest_method(
    stage: GearModel, torque: float, parameters: Mapping[str, float] | None = None, rtol: float = 1e-4
) -> str:
    """Return the method that was cheapest at equal error of the accelerations.

    The explicit method where the contact damper does not limit its steps much, or where accuracy does; the exponential
    one, which follows the damper's motion exactly, elsewhere.  The implicit one pays for a Jacobian of all states at
    each step: it was two to ten times slower at every corner of Table 3 (docs, "Benchmarks").
    """
    return "Exponential43" if rtol >= LOOSE and contact_rate(stage, torque, parameters) > STIFF else "DormandPrince54"
