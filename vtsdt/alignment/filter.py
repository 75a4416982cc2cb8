"""The virtual sensor of the guide's alignment: a joint filter on the cabin model (González et al. 2020, section IV-B).

The cabin model has 12 states and the rope's tension as input; height and vertical acceleration of the cabin are
measured; the deviation δ of the right rail is estimated along with the states as a random walk.  The left rail counts
as straight and all deviation as one in x: δ is equivalent, not exact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from vtsdt.alignment.trips import AlignmentError, Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

if TYPE_CHECKING:
    from estimation.filters.model import FilterModel
    from estimation.filters.noise import Noise, Prior
    from estimation.filters.run import FilterRun

__all__ = ["DEFAULT", "DELTA", "MAX_SPEED_ERROR", "TUNINGS", "GuideFilter", "Tuning"]

#: The state that is the deviation δ.
DELTA = "cabin_guide.right_deviation"
_LATERAL = ("x", "y", "roll", "pitch", "yaw", "v_x", "v_y", "w_x", "w_y", "w_z")
_TABLE_2 = {
    "x": 1e-2,
    "y": 1e-2,
    "z": 1e-2,
    "v_x": 1e-1,
    "v_y": 1e-1,
    "v_z": 1e-1,
    "roll": 1e-4,
    "pitch": 1e-4,
    "yaw": 1e-4,
    "w_x": 1e-3,
    "w_y": 1e-3,
    "w_z": 1e-3,
    "delta": 1e-3,
}
_START = 1.0e-3  # m, δ above the play at the start
#: Tolerated error of the filter's speed, m/s, and share of the samples that may exceed it.
MAX_SPEED_ERROR, _MAX_SHARE = 0.1, 0.2
_TOUCH = 0.05e-3  # m above the play: closer to it the shoes leave the rail, and no reading would bring δ back


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Noise that the filter assumes of model and readings.

    Parameters
    ----------
    name : str
    process : mapping of str to float
        Density of the process noise by the state's short name and ``delta``, unit² per second.
    height, acceleration : float
        Variances of the readings, m² and m²/s⁴.
    meaning : str
        One line for the help.
    """

    name: str
    process: Mapping[str, float] = field(repr=False)
    height: float = 1e-4
    acceleration: float = 1e-7
    meaning: str = ""


def _lateral_times(factor: float) -> dict[str, float]:
    """Return the densities of Table 2 with those of the lateral states multiplied."""
    return {k: v * (factor if k in _LATERAL else 1.0) for k, v in _TABLE_2.items()}


#: Maximum of the marginal likelihood of two trips of the virtual lift 41 (`vtsdt.alignment.tuning`).
_LIKELIHOOD = {**{k: 1e-2 * v for k, v in _lateral_times(1e-4).items()}, "z": 2.9e-9, "v_z": 3.9e-6, "delta": 3.5e-7}

#: The tuning that is used by default.
DEFAULT = "quiet"
#: The tunings by name.  Table 2 does not say whether its Q is per second or per step; here it is per second.
TUNINGS = {
    t.name: t
    for t in (
        Tuning(name="table2", process=_TABLE_2, meaning="Table 2 of the paper as printed, its Q per second"),
        Tuning(
            name="bounded",
            process=_lateral_times(1e-2),
            meaning="Table 2 with the noise of the lateral states, which the guides bound, a hundred times smaller",
        ),
        Tuning(
            name="quiet",
            process={**{k: 1e-2 * v for k, v in _lateral_times(1e-4).items()}, "delta": 1e-6},
            height=1e-8,
            acceleration=1e-2,
            meaning="readings weighted by the accuracy of the bench's sensors, and more weight on the model",
        ),
        Tuning(
            name="likelihood",
            process=_LIKELIHOOD,
            height=4.0e-10,
            acceleration=2.2e-4,
            meaning="variances that maximise the likelihood of two unfiltered trips of the virtual lift",
        ),
    )
}


@dataclass(frozen=True, eq=False, kw_only=True)
class GuideFilter:
    """The filter of one lift, for many trips.

    Parameters
    ----------
    parameters : LiftParameters
        Its rail profiles are not used: they are what is estimated.
    tuning : Tuning
    loaded : bool
        True if trips carry a payload.
    options
        Further arguments of `estimation.filters.extended_kalman_filter`.
    forces : tuple of str
        Further outputs of the cabin model, for `estimation.filters.virtual_sensors`, such as ``fric_c`` and ``Nsum_c``.
    """

    parameters: LiftParameters
    tuning: Tuning = field(default_factory=lambda: TUNINGS[DEFAULT])
    loaded: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    forces: tuple[str, ...] = ()

    @cached_property
    def lift(self) -> Lift:
        """The cabin model between straight rails."""
        straight = dataclasses.replace(self.parameters, cabin_guide=self.parameters.cabin_guide.straightened())
        return Lift.cabin(straight, payload=(0.0, 0.0, 0.0, 0.0) if self.loaded else None)

    @cached_property
    def system(self) -> Any:
        """The lift with the measured outputs and the requested forces."""
        return self.lift.build(outputs=["z_c", "zdd_c", *self.forces])

    @property
    def play(self) -> float:
        """Deviation below which the shoes are loose, m."""
        return 2.0 * self.parameters.cabin_guide.clearance

    @property
    def stiffness(self) -> float:
        """Growth of the friction with the deviation once the shoes touch, 2 μ K, N/m."""
        guide = self.parameters.cabin_guide
        return 2.0 * guide.mu * guide.stiffness

    def model(self, payload: float = 0.0) -> FilterModel:
        """Return the filter's model for a payload, kg."""
        from estimation.filters.latent import RandomWalk
        from estimation.filters.model import FilterModel

        walk = RandomWalk(DELTA, rate=self.tuning.process["delta"], std=1e-3)
        return FilterModel(
            self.system,
            ["z_c", "zdd_c"],
            [walk],
            parameters={"payload.mass": payload} if self.loaded else None,
            bounds={DELTA: (self.play + _TOUCH, self.parameters.cabin_guide.gap)},
        )

    def noise(self) -> Noise:
        """Return the tuning in the form that the filter takes."""
        from estimation.filters.noise import Noise

        names = {name.rpartition(".")[2]: name for name in self.system.state_names}
        process = {names[k]: v for k, v in self.tuning.process.items() if k != "delta"}
        return Noise(
            {**process, DELTA: self.tuning.process["delta"]},
            {"z_c": self.tuning.height, "zdd_c": self.tuning.acceleration},
            "density_times_step",
        )

    def prior(self, trip: Trip) -> Prior:
        """Return the initial state estimate: at rest between the rails at the trip's first height."""
        from estimation.filters.noise import Prior

        delta = self.play + _START
        values = {DELTA: delta, **({"payload.mass": trip.payload} if self.loaded else {})}
        rest = self.lift.equilibrium(
            float(trip.height[0]),
            system=self.system,
            parameters=values,
            inputs={"F_c": (self.parameters.cabin.mass + trip.payload) * STANDARD_GRAVITY},
        ).to_dict()
        rest["cabin.z"] = float(trip.height[0])
        std = {name: 1e-4 for name in rest}
        return Prior({**rest, DELTA: delta}, {**std, DELTA: 1e-3})

    def run(self, trip: Trip, tension_error: float = 0.0, **options: Any) -> FilterRun:
        """Filter one trip.

        Parameters
        ----------
        trip : Trip
        tension_error : float, N
            Subtracted from the measured tension.
        options
            Further arguments of `estimation.filters.extended_kalman_filter`.

        Raises
        ------
        AlignmentError
            If the filter diverges.
        """
        from estimation.filters.errors import FilterDivergence
        from estimation.filters.extended_kalman import extended_kalman_filter
        from estimation.filters.samples import FilterSamples

        model, noise = self.model(trip.payload), self.noise()
        samples = FilterSamples(
            trip.time, trip.tension - tension_error, np.column_stack([trip.height, trip.acceleration])
        )
        try:
            run = extended_kalman_filter(
                model, samples, noise, self.prior(trip), **{"once": True, **self.options, **options}
            )
        except FilterDivergence as error:
            raise AlignmentError([f"{trip.name}: {error}"]) from error
        wrong_speed = np.abs(run["cabin.v_z"] - trip.speed) > MAX_SPEED_ERROR
        if np.mean(wrong_speed) > _MAX_SHARE:
            k = int(np.argmax(wrong_speed))
            raise AlignmentError(
                [
                    f"{trip.name}: the filter diverges at {trip.time[k]:.4g} s: its speed is "
                    f"{run['cabin.v_z'][k]:.2g} m/s, the measured one {trip.speed[k]:.2g} m/s, because the tension "
                    "implies less friction than a sliding cabin has, or far more: check the tension's zero"
                    f"{'' if tension_error else ' (trips of one direction do not show it)'}, the cabin's mass and the "
                    "friction coefficient in the parameters"
                    f"{'' if self.tuning.name == DEFAULT else f'; --tuning {DEFAULT} gives noisy readings less weight'}"
                ]
            )
        wrong_height = np.abs(run["cabin.z"] - trip.height) > 0.05
        tilt = np.abs(run.states[:, [model.index(f"cabin.{a}") for a in ("roll", "pitch", "yaw")]]).max(axis=1) > 0.3
        if np.any(wrong_height | tilt):
            k = int(np.argmax(wrong_height | tilt))
            distance = 1e3 * abs(run["cabin.z"][k] - trip.height[k])
            what = (
                f"its height is {distance:.3g} mm off the measured one"
                if wrong_height[k]
                else "its cabin is tilted by more than 0.3 rad"
            )
            raise AlignmentError(
                [
                    f"{trip.name}: the filter diverges at {trip.time[k]:.4g} s: {what}; tension, height and "
                    "acceleration contradict each other there, or the parameters are of another lift"
                ]
            )
        return run
