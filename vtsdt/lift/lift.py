"""A lift that makes trips: reference, one-dimensional and cabin model (González et al. 2020, sections II and III)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import vtsdt.lift.stated_values  # noqa: F401 - adds parameters of a lift that may be stated wrongly to the catalogue
from multibody.machine.model import Model
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.model import LiftModel, Structure
from vtsdt.lift.speed_reference import sampled_reference
from vtsdt.lift.trip import simulate_trip, state_at_rest

if TYPE_CHECKING:
    import numpy as np

    from multibody.system.equilibrium import Equilibrium
    from multibody.system.trajectory import Trajectory

__all__ = ["Lift", "cabin", "one_dimensional", "reference"]


class Lift(LiftModel):
    """A lift: its model, its state at rest and its trips.

    Parameters
    ----------
    parameters : LiftParameters, optional
        Default: the shipped bench.
    structure : Structure, optional
        Default: all motions free.
    start : float, m
        Height of the cabin at which the pulley's angle is zero.
    payload : tuple of four float, optional
        Mass (kg) and position (x, y, z in m, from the middle of the floor) of a load.
    name : str

    Raises
    ------
    ParameterError
        If parts do not fit together: rails shorter than the travel, clearance larger than the gap, …

    Examples
    --------
    >>> lift = Lift.reference()
    >>> len(lift.system.states), len(Lift.one_dimensional().system.states), len(Lift.cabin().system.states)
    (37, 17, 12)
    """

    @classmethod
    def reference(
        cls,
        parameters: LiftParameters | None = None,
        *,
        start: float = 0.0,
        payload: Any = None,
        name: str | None = None,
        **structure: bool,
    ) -> Lift:
        """Return the reference model: 37 states, input omega_ref (and tau_L)."""
        return cls(parameters, Structure(**structure), start=start, payload=payload, name=name)

    @classmethod
    def one_dimensional(
        cls,
        parameters: LiftParameters | None = None,
        *,
        start: float = 0.0,
        payload: Any = None,
        name: str | None = None,
        **structure: bool,
    ) -> Lift:
        """Return the 1D model: 17 states, inputs omega_ref and the two friction forces."""
        locked = dict.fromkeys(
            ("cabin_lateral", "cabin_rotation", "counterweight_lateral", "counterweight_rotation"), False
        )
        return cls(parameters, Structure(**{**locked, **structure}), start=start, payload=payload, name=name)

    @classmethod
    def cabin(
        cls,
        parameters: LiftParameters | None = None,
        *,
        start: float = 0.0,
        payload: Any = None,
        name: str | None = None,
        **structure: bool,
    ) -> Lift:
        """Return the cabin model: 12 states, input the tension F_c."""
        return cls(parameters, Structure(**{"drive": False, **structure}), start=start, payload=payload, name=name)

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        p = self.parameters
        rows = [
            ("travel", f"{p.hoistway.travel:g} m"),
            ("mass of the cabin", f"{p.cabin.mass:g} kg"),
            ("components, states", f"{len(self.components)}, {len(self.system.states)}"),
            ("friction coefficient of the cabin's shoes", f"{p.cabin_guide.mu:g}"),
        ]
        time, speed = self.speed_reference()
        figure = small_figure(time, [("pulley [rad/s]", {"speed reference, trip up": speed})])
        return notebook_view(f"Lift '{self.name}'", rows, figure=figure)

    def speed_reference(self, direction: str = "up", step: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Return times (s) and speed reference of the pulley (rad/s) of a whole trip.

        A positive speed lets the cabin down, so the reference of a trip up is negative.
        """
        return sampled_reference(self.parameters, direction, step)

    def equilibrium(self, height: float | None = None, **options: Any) -> Equilibrium:
        """Return the state at rest with the cabin at a height (default: the start).

        Options are those of `vtsdt.lift.trip.state_at_rest`.
        """
        return state_at_rest(self, height, **options)

    def at_rest(self, height: float | None = None, **options: Any) -> Model:
        """Return the lift as a plain model whose start values are those of `equilibrium`."""
        resting = self.equilibrium(height, **options)
        start = {}
        for name, value in resting.to_dict().items():
            owner, _, state = name.partition(".")
            start[f"{name}_start" if owner in ("cabin", "counterweight") else f"{owner}.{state}"] = value
        return self.with_values(start)

    def trip(self, direction: str = "up", **options: Any) -> Trajectory:
        """Simulate a trip; options are those of `vtsdt.lift.trip.simulate_trip`."""
        return simulate_trip(self, direction, **options)


def reference(parameters: str | None = None, height: float | None = None, **options: Any) -> Model:
    """Return the reference model at rest for a parameter file: ``build = "vtsdt.lift:reference"`` in a study file."""
    return Lift.reference(_loaded(parameters), **options).at_rest(height)


def one_dimensional(parameters: str | None = None, height: float | None = None, **options: Any) -> Model:
    """Return the 1D model at rest for a parameter file, as `reference` does."""
    return Lift.one_dimensional(_loaded(parameters), **options).at_rest(height)


def cabin(parameters: str | None = None, height: float | None = None, **options: Any) -> Model:
    """Return the cabin model at rest for a parameter file, as `reference` does."""
    return Lift.cabin(_loaded(parameters), **options).at_rest(height)


def _loaded(path: str | None) -> LiftParameters | None:
    return LiftParameters.load(path) if path is not None else None
