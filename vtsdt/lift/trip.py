"""Trips of a lift: the state at rest, checks of the reference, simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.errors import SimulationError
from multibody.base.gravity import STANDARD_GRAVITY
from vtsdt.lift.model import LiftModel
from vtsdt.lift.speed_reference import sampled_reference, trip_sign

if TYPE_CHECKING:
    from multibody.machine.model import System
    from multibody.system.equilibrium import Equilibrium
    from multibody.system.trajectory import Trajectory

__all__ = ["simulate_trip", "state_at_rest"]

#: Simulated standstill in which the shoes settle between the rails, s, and how often it is tried.
_SETTLING, _TRIES = 2.0, 3
_MARGIN = 0.02  # m by which a reference may exceed the ends of the travel


def state_at_rest(
    lift: LiftModel,
    height: float | None = None,
    *,
    system: System | None = None,
    hold: Sequence[str] = (),
    **options: Any,
) -> Equilibrium:
    """Return the state at rest with the cabin at a height.

    Every model starts from its own equilibrium: the pulley's angle is held, and the motor current that holds it is
    solved for with the other states.  With shoes that have play between bent rails Newton's method can fail; the lift
    is then simulated at standstill until it is at rest, and the search starts again from there.

    Parameters
    ----------
    lift : LiftModel
    height : float, m, optional
        Of the cabin's floor, without the ropes' stretch; default: the lift's start.
    system : System, optional
        The lift built with other options; default: ``lift.system``.
    hold : sequence of str
        Further states that keep their guess, such as the deflection of a friction with elastic displacement: any value
        of it is an equilibrium, and the motor's current is to balance the lift.
    options
        Further arguments of `multibody.system.equilibrium.equilibrium`, such as ``parameters``.

    Raises
    ------
    SimulationError
        If there is none close to the guess.
    """
    height = lift.start if height is None else float(height)
    p, system = lift.parameters, system or lift.system
    guess = dict(options.pop("guess", {}))
    inputs = dict(options.pop("inputs", {}))
    load = (lift.payload[0] if lift.payload else 0.0) + p.cabin.mass
    stiffness = p.ropes.EA * p.ropes.n
    distance = height - lift.start
    drop_c = load * STANDARD_GRAVITY * (p.ropes.L_0_c - height) / stiffness
    drop_cw = p.counterweight.mass * STANDARD_GRAVITY * (p.ropes.L_0_cw + height) / stiffness
    sag = (load + p.counterweight.mass + p.support.mass) * STANDARD_GRAVITY / (4.0 * p.support.stiffness)
    if not lift.structure.drive:
        # a slightly wrong tension must not be balanced by tilting the cabin: its vertical acceleration is left free
        inputs.setdefault("F_c", load * STANDARD_GRAVITY)
        guess.setdefault("cabin.z", height - drop_c - sag)
        return _settled(system, guess, inputs, ("cabin.z", "cabin.v_z", *hold), options)
    guesses = {
        "cabin.z": height - drop_c - sag,
        "counterweight.z": p.hoistway.travel - height - drop_cw - sag,
        "pulley.angle": -distance / p.pulley.R_p,
        "support.plate_position": -sag,
        "support.position": -sag,
    }
    guess = {**{k: v for k, v in guesses.items() if k in system.state_names}, **guess}
    return _settled(system, guess, inputs, ("pulley.angle", *hold), options)


def _settled(
    system: System, guess: Mapping[str, float], inputs: Mapping[str, float], hold: tuple[str, ...], options: Any
) -> Equilibrium:
    """Return the state at rest; where the guess does not lead to it, simulate a standstill first."""
    known = dict(guess)
    for _ in range(_TRIES):
        try:
            return system.equilibrium(guess=known, inputs=inputs, hold=hold, **options)
        except SimulationError:
            values = {"parameters": options["parameters"]} if options.get("parameters") is not None else {}
            held = {"omega_ref": 0.0, **inputs} if "omega_ref" in system.input_names else inputs
            run = system.simulate(_SETTLING, inputs=held, initial=known, times=np.array([_SETTLING]), **values)
            known = {
                **dict(zip(system.state_names, map(float, run.states[-1]), strict=True)),
                **{n: known.get(n, 0.0) for n in hold},
            }
    return system.equilibrium(guess=known, inputs=inputs, hold=hold, **options)


def check_reference(lift: LiftModel, times: np.ndarray, omega: np.ndarray, height: float) -> None:
    """Refuse a speed reference that leaves the hoistway or needs more rope than there is.

    Parameters
    ----------
    times, omega : ndarray, s and rad/s
    height : float, m
        Start of the cabin.

    Raises
    ------
    SimulationError
        With the time at which it happens.
    """
    p = lift.parameters
    paid_out = p.pulley.R_p * np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * np.diff(times))])
    at = height - paid_out
    faults = []
    lengths = {"cabin": p.ropes.L_0_c - at, "counterweight": p.ropes.L_0_cw + at}
    for side, length in lengths.items():
        if np.any(short := length <= 0.0):
            faults.append(
                f"the rope on the {side}'s side has no length left at {times[np.argmax(short)]:.3f} s, where the "
                f"reference takes the cabin to {at[np.argmax(short)]:.3f} m"
            )
    for name, outside in (("top", at > p.hoistway.travel + _MARGIN), ("bottom", at < -_MARGIN)):
        if np.any(outside):
            k = int(np.argmax(outside))
            end = p.hoistway.travel if name == "top" else 0.0
            faults.append(
                f"the reference leaves the hoistway at its {name} ({end:g} m) at {times[k]:.3f} s and goes on to "
                f"{at.max() if name == 'top' else at.min():.3f} m; omega_ref is the pulley's speed in rad/s, positive "
                "lets the cabin down"
            )
    if faults:
        raise SimulationError(f"'{lift.name}' cannot make this trip:\n" + "\n".join(f"  - {f}" for f in faults))


def simulate_trip(
    lift: LiftModel,
    direction: str = "up",
    *,
    inputs: Mapping[str, Any] | None = None,
    step: float = 1e-3,
    height: float | None = None,
    guess: Mapping[str, float] | None = None,
    system: System | None = None,
    **options: Any,
) -> Trajectory:
    """Simulate a trip from rest.

    Parameters
    ----------
    lift : LiftModel
    direction : {"up", "down"}
        Of the speed reference that is used if ``inputs`` has no omega_ref.  A lift with its own speed reference
        (``profile=True``) goes from its start to the farther end.
    inputs : mapping, optional
        Model inputs by name, as for `multibody.system.simulate.simulate`: omega_ref, tau_L, friction_c, friction_cw,
        F_c.
    step : float, s
        Of the record.
    height : float, m, optional
        Start of the cabin; default: the end of the hoistway from which the trip leads away.
    guess : mapping, optional
        Initial guess of the state at rest; the cabin model keeps its ``cabin.z``.
    system : System, optional
        The compiled lift; default: ``lift.system``.  With ``lift.build(energy=True)`` losses are integrated.
    options
        Further arguments of `multibody.system.simulate.simulate`.

    Raises
    ------
    SimulationError
        If the reference leaves the hoistway, a rope has no length left, or the integration fails.
    ValueError
        If the lift has its own speed reference and stands at the end that the direction leads to.
    """
    sign = trip_sign(direction)
    travel = lift.parameters.hoistway.travel
    if direction == "down" and lift.structure.profile and lift.start < 0.5 * travel:
        raise ValueError(
            f"'{lift.name}' has its own speed reference, which leads up from its start at {lift.start:g} m: for a trip "
            f"down make it with start={travel:g}"
        )
    given = dict(inputs or {})
    structure = lift.structure
    if height is None:
        height = lift.start if not structure.drive or structure.profile else (0.0 if sign > 0 else travel)
    if structure.drive and not structure.profile:
        given.setdefault("omega_ref", sampled_reference(lift.parameters, direction))
        times, omega = _sampled(given["omega_ref"], options.get("until", lift.parameters.trip.duration))
        check_reference(lift, times, omega, height)
    until = options.pop("until", lift.parameters.trip.duration)
    first = {n: v for n, v in ((n, _first(v)) for n, v in given.items()) if n not in ("omega_ref", "tau_L")}
    values = {"parameters": options["parameters"]} if "parameters" in options else {}
    initial = options.pop("initial", None)
    if initial is None:
        initial = state_at_rest(lift, height, system=system, inputs=first, guess=guess or {}, **values).state
    return (system or lift.system).simulate(until, inputs=given, initial=initial, step=step, **options)


def _first(value: Any) -> float:
    if callable(value):
        return float(value(0.0))
    return float(value[1][0]) if isinstance(value, tuple | list) else float(value)


def _sampled(omega: Any, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a reference, given as number, function or samples, on a grid of 1 ms."""
    times = np.arange(int(until / 1e-3) + 2) * 1e-3
    if callable(omega):
        return times, np.array([omega(t) for t in times])
    if np.ndim(omega) == 0:
        return times, np.full(times.size, float(omega))
    given, values = (np.asarray(part, dtype=float) for part in omega)
    if given.ndim != 1 or given.shape != values.shape or given.size == 0 or np.any(np.diff(given) <= 0):
        return times, np.zeros(times.size)  # the simulation refuses it with the reason
    return times, np.interp(times, given, values)
