"""The models under test of the virtual lift: a lift at rest whose payload is a recorded signal.

A study file refers to `build` as ``build = "vtsdt.rig.models:build"``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Output, Parameter, Translation
from multibody.machine.model import Model
from vtsdt.files.parameters import LiftParameters, ParameterError
from vtsdt.files.rail_profile import RailProfile
from vtsdt.lift.lift import Lift

__all__ = ["MODELS", "add_weighed_load", "build", "with_rails"]

#: Models that ``vtsdt bench lift --model`` offers.
MODELS = ("one_dimensional", "reference", "cabin")


class WeighedLoad(Component):
    """A payload in the middle of the floor whose mass is a signal, as a weighing floor measures it."""

    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")
    mass = Input("kg", "mass of the load", default=0.0)
    inertia = Output("kg", "mass of the load, for the motion it takes part in")
    floor = Translation("vertical motion of the cabin", inertia="inertia")
    energy = Energy(meaning="potential energy of the load")

    def equations(self):
        self.inertia = self.mass
        self.floor.force = -self.mass * self.g
        self.energy = self.mass * self.g * self.floor.position


def with_rails(parameters: LiftParameters, rails: Mapping[str, Mapping[str, Sequence[float]]]) -> LiftParameters:
    """Return a lift with other rails.

    Parameters
    ----------
    parameters : LiftParameters
    rails : mapping
        By ``"cabin.right_x"``, ``"counterweight.left_y"``, …: ``height_m`` and ``delta_mm``, lists of one length.
        Rails that are not named are straight.

    Raises
    ------
    ParameterError
        With every rail that does not exist and every invalid table.
    """
    names = ("left_x", "right_x", "left_y", "right_y")
    faults: list[str] = []
    profiles: dict[str, dict[str, Any]] = {s: dict.fromkeys(names) for s in ("cabin", "counterweight")}
    for key, table in rails.items():
        side, _, name = key.partition(".")
        if side not in profiles or name not in names:
            faults.append(f"there is no rail '{key}': name one such as 'cabin.right_x' or 'counterweight.left_y'")
            continue
        height, delta = list(table.get("height_m", ())), list(table.get("delta_mm", ()))
        if len(height) < 2 or len(height) != len(delta):
            faults.append(f"rail '{key}': needs height_m and delta_mm, two lists of one length, two points or more")
            continue
        profiles[side][name] = RailProfile(tuple(map(float, height)), tuple(1e-3 * float(d) for d in delta))
    if faults:
        raise ParameterError("rails", faults)
    return dataclasses.replace(
        parameters,
        cabin_guide=dataclasses.replace(parameters.cabin_guide, **profiles["cabin"]),
        counterweight_guide=dataclasses.replace(parameters.counterweight_guide, **profiles["counterweight"]),
    )


def build(
    model: str = "one_dimensional",
    parameters: str | None = None,
    rails: Mapping[str, Mapping[str, Sequence[float]]] | None = None,
) -> Model:
    """Return a lift at rest at the bottom.

    Parameters
    ----------
    model : {"one_dimensional", "reference", "cabin"}
        The 1D model takes payload and guide friction as recorded signals; the others have rail profiles.
    parameters : str, optional
        Parameter file of the lift; default: the shipped bench.
    rails : mapping, optional
        Surveyed profiles; see `with_rails`.

    Raises
    ------
    ParameterError
        If there is no such model, or a rail is invalid.

    Examples
    --------
    >>> sorted(build().inputs)
    ['friction_c', 'friction_cw', 'omega_ref', 'payload', 'tau_L']
    """
    if model not in MODELS:
        raise ParameterError("[model] arguments", [f"model is '{model}': give one of {', '.join(MODELS)}"])
    given = LiftParameters.load(parameters) if parameters else LiftParameters.bench()
    if rails is not None:
        given = with_rails(given, rails)
    make: dict[str, Any] = {
        "one_dimensional": Lift.one_dimensional,
        "reference": Lift.reference,
        "cabin": Lift.cabin,
    }
    lift = make[model](given)
    resting = lift.at_rest()
    if model == "one_dimensional":
        add_weighed_load(resting)
    return resting


def add_weighed_load(lift: Model) -> None:
    """Add a payload whose mass is the input ``payload``."""
    load = lift.add("payload", WeighedLoad())
    lift.connect(load.floor, "cabin.z_axis")
    lift.input("payload", load.mass, default=0.0)
