"""The housing as a flexible body by its modes: bearing seats that move, accelerometers that see it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gearbox.files.errors import GearError
from gearbox.parts.housing_modes import AXES, SEATS, SENSORS, ModeSet
from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Option, Output, Parameter, Power, State, Translation
from multibody.equations.statements import variable

if TYPE_CHECKING:
    from collections.abc import MutableMapping

    from multibody.assembly.equation_set import Assembly

__all__ = ["housing_component"]

MAX_MODES = 40


def _declare(body: MutableMapping[str, Any]) -> None:
    """Put the declarations that repeat over modes and places into a class body."""
    for seat in SEATS:
        for axis in AXES:
            body[f"{seat}_{axis}"] = Translation(f"bearing seat {seat} along {axis}", prescribed=True)
    for sensor in SENSORS:
        for axis in AXES:
            body[f"a_{sensor}_{axis}"] = Output("m/s**2", f"acceleration at {sensor} along {axis}")
    for k in range(1, MAX_MODES + 1):
        when = f"modes >= {k}"
        body[f"q_{k}"] = State("m*kg**0.5", f"modal coordinate {k}, mass-normalised", when=when)
        body[f"v_{k}"] = State("m*kg**0.5/s", f"rate of modal coordinate {k}", when=when)
        body[f"frequency_{k}"] = Parameter(1.0, "Hz", f"natural frequency of mode {k}", min=0.0, when=when)
        body[f"damping_{k}"] = Parameter(0.01, "", f"damping ratio of mode {k}", min=0.0, when=when)
        for place in (*SEATS, *SENSORS):
            for axis in AXES:
                meaning = f"mass-normalised shape of mode {k} at {place} along {axis}"
                name = f"shape_{k}_{place}_{axis}" if place in SEATS else f"seen_{k}_{place}_{axis}"
                body[name] = Parameter(0.0, "1/kg**0.5", meaning, when=when)


class FlexibleHousing(Component):
    """A housing that moves by its modes: u(place) = Σ φ_k(place)·q_k, mass-normalised.

    q̈_k + 2 ζ_k ω_k q̇_k + ω_k² q_k = Σ φ_k(seat)·force on the seat, over the three axes of the four bearing seats.  The
    accelerometers give Σ φ_k(sensor)·q̈_k.  A rigid housing on its mounts is the same with six modes; a clamped one has
    none, and its seats stand still.
    """

    modes = Option(1, "number of modes; 0 holds the seats still", choices=tuple(range(MAX_MODES + 1)))
    _declare(locals())
    energy = Energy(meaning="kinetic and elastic energy of the housing")
    loss = Power(kind="loss", meaning="power lost to modal damping")

    def assemble(self, owner: str, work: Assembly) -> None:
        """State the equations, whose number depends on the number of modes."""
        count = int(self.options["modes"])
        ks = range(1, count + 1)

        def name(*parts: str) -> str:
            return variable(owner, *parts)

        def total(terms: list[str]) -> str:
            return " + ".join(terms) or "0.0"

        for k in ks:
            work.add(f"{name(f'omega_{k}')} = {6.283185307179586} * {name(f'frequency_{k}')}", owner)
            pushes = [
                f"{name(f'shape_{k}_{seat}_{axis}')} * {name(f'{seat}_{axis}', 'reaction')}"
                for seat in SEATS
                for axis in AXES
            ]
            work.add(f"{name(f'push_{k}')} = -({total(pushes)})", owner)
            work.add(f"{name('_der', f'q_{k}')} = {name(f'v_{k}')}", owner)
            work.derivatives[name(f"q_{k}")] = name(f"v_{k}")  # a rest looks for rates that are states themselves
            rest = (
                f"2.0 * {name(f'damping_{k}')} * {name(f'omega_{k}')} * {name(f'v_{k}')} + "
                f"{name(f'omega_{k}')} ** 2 * {name(f'q_{k}')}"
            )
            work.add(f"{name('_der', f'v_{k}')} = {name(f'push_{k}')} - ({rest})", owner)
        for place in (*SEATS, *SENSORS):
            stem = "shape" if place in SEATS else "seen"
            for axis in AXES:
                shapes = [name(f"{stem}_{k}_{place}_{axis}") for k in ks]
                motions = (
                    {"position": "q_", "velocity": "v_", "acceleration": "_der"} if place in SEATS else {"a": "_der"}
                )
                for what, source in motions.items():
                    values = [name("_der", f"v_{k}") if source == "_der" else name(f"{source}{k}") for k in ks]
                    target = name(f"{place}_{axis}", what) if place in SEATS else name(f"a_{place}_{axis}")
                    text = total([f"{s} * {v}" for s, v in zip(shapes, values, strict=True)])
                    work.add(f"{target} = {text}", owner)
        stored = [f"0.5 * ({name(f'v_{k}')} ** 2 + ({name(f'omega_{k}')} * {name(f'q_{k}')}) ** 2)" for k in ks]
        lost = [f"2.0 * {name(f'damping_{k}')} * {name(f'omega_{k}')} * {name(f'v_{k}')} ** 2" for k in ks]
        work.add(f"{name('energy')} = {total(stored)}", owner)
        work.add(f"{name('loss')} = {total(lost)}", owner)


def housing_component(modes: ModeSet) -> FlexibleHousing:
    """Return the housing that moves by a set of modes.

    Raises
    ------
    GearError
        If there are more modes than the component takes, or the housing stands on nothing.
    """
    if (modes.frequencies <= 0.0).any():
        raise GearError(
            f"the mode set '{modes.name}'",
            ["it has modes of frequency zero, so it is held by nothing: put it on mounts with on_mounts(stiffness)"],
        )
    count = modes.frequencies.size
    if count > MAX_MODES:
        raise GearError(
            f"the mode set '{modes.name}'",
            [f"it has {count} modes, the housing takes {MAX_MODES}: keep the lowest with first({MAX_MODES})"],
        )
    given: dict[str, float] = {}
    for k in range(count):
        given[f"frequency_{k + 1}"] = float(modes.frequencies[k])
        given[f"damping_{k + 1}"] = float(modes.damping[k])
        for place in (*SEATS, *SENSORS):
            stem = "shape" if place in SEATS else "seen"
            for i, axis in enumerate(AXES):
                given[f"{stem}_{k + 1}_{place}_{axis}"] = float(modes.shapes[place][k, i])
    return FlexibleHousing(modes=count, **given)
