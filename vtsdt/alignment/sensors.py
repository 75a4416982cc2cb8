"""Observability of the deviations of both rails in both directions, with these sensors and with further ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from multibody.base.progress import Progress, silent
from vtsdt.alignment.filter import DELTA, TUNINGS, GuideFilter
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile
from vtsdt.lift.lift import Lift

if TYPE_CHECKING:
    import pandas

__all__ = ["SENSORS", "sensor_table", "table_text"]

#: Sets of further sensors: outputs of the cabin model and the standard deviation of their noise.
SENSORS: dict[str, dict[str, float]] = {
    "as in the paper: z, z̈": {},
    "+ lateral accelerometer x": {"cabin.a_x": 0.01},
    "+ lateral accelerometer y": {"cabin.a_y": 0.01},
    "+ inclinometers (roll, pitch)": {"cabin.roll": 1e-4, "cabin.pitch": 1e-4},
    "+ gap sensor x": {"cabin.x": 2e-5},
    "+ gap sensor y": {"cabin.y": 2e-5},
    "+ gap sensors x and y": {"cabin.x": 2e-5, "cabin.y": 2e-5},
    "+ gap sensors x, y and yaw": {"cabin.x": 2e-5, "cabin.y": 2e-5, "cabin.yaw": 1e-4},
}
_QUANTITIES = ("right rail x", "left rail x", "right rail y", "left rail y")
#: Drift of a deviation over a trip without any reading, m; one known to better than half of it counts as observed.
_DRIFT = 1e-3


@dataclass(frozen=True)
class SensorRow:
    """How well a set of sensors determines four deviations.

    Parameters
    ----------
    sensors : str
    std : dict of str to float, m
        Standard deviation of each deviation at the end of the trip.
    detectable : bool
    hidden : str
        The combination that is known worst, if the lift is not detectable.
    """

    sensors: str
    std: dict[str, float]
    detectable: bool
    hidden: str

    def determines(self, quantity: str) -> bool:
        """True if the deviation is known to better than half of its drift."""
        return self.std[quantity] < 0.5 * _DRIFT


def _curved(parameters: LiftParameters) -> LiftParameters:
    """Return a lift whose four rails have profiles of two equal points, so that their values are parameters."""
    ends = (parameters.hoistway.rail_bottom, parameters.hoistway.rail_top)
    guide = dataclasses.replace(
        parameters.cabin_guide.straightened(),
        left_y=RailProfile(ends, (0.0, 0.0)),
        right_y=RailProfile(ends, (0.0, 0.0)),
    )
    return dataclasses.replace(parameters, cabin_guide=guide)


def sensor_table(
    trip: Trip,
    parameters: LiftParameters | None = None,
    *,
    sensors: dict[str, dict[str, float]] | None = None,
    progress: Progress = silent,
) -> list[SensorRow]:
    """Return, for sets of sensors, how well they determine the four deviations along a trip.

    The states follow the trip with the deviations that the sensors of the paper estimate; only covariances matter, so
    the further sensors need not exist.

    Parameters
    ----------
    trip : Trip
    parameters : LiftParameters, optional
    sensors : dict, optional
        Further outputs with their noise by the set's name; default: `SENSORS`.
    progress : callable, optional
    """
    from estimation.filters.extended_kalman import extended_kalman_filter
    from estimation.filters.latent import RandomWalk
    from estimation.filters.model import FilterModel
    from estimation.filters.noise import Noise, Prior
    from estimation.filters.observability_gramian import observability
    from estimation.filters.samples import FilterSamples

    given = parameters if parameters is not None else LiftParameters.bench()
    sets = sensors if sensors is not None else SENSORS
    lift = Lift.cabin(_curved(given))
    names = sorted({output for outputs in sets.values() for output in outputs})
    system = lift.build(outputs=["z_c", "zdd_c", *names])
    duration = float(trip.time[-1] - trip.time[0])
    rate = _DRIFT**2 / duration
    targets: dict[str, dict[str, float]] = {
        "right rail x": {"cabin_guide.right_deviation": 1.0},
        "left rail x": {"cabin_guide.left_deviation": 1.0},
    }
    for side in ("right", "left"):
        values = [n for n in system.parameter_names if n.startswith(f"cabin_guide.{side}_y.y[")]
        targets[f"{side} rail y"] = dict.fromkeys(values, 1.0)
    walks = [RandomWalk(t, name=n, rate=rate, std=0.2 * _DRIFT) for n, t in targets.items()]
    paper = GuideFilter(parameters=given, tuning=TUNINGS["quiet"])
    base = paper.run(trip)
    delta = float(np.median(base[DELTA]))
    rest = lift.equilibrium(
        float(trip.height[0]),
        system=system,
        parameters={DELTA: delta},
        inputs={"F_c": given.cabin.mass * STANDARD_GRAVITY},
    ).to_dict()
    rest["cabin.z"] = float(trip.height[0])
    process = {name: 1e-8 for name in system.state_names}
    rows = []
    for k, (label, further) in enumerate(sets.items()):
        progress(f"sensors {k + 1} of {len(sets)}: {label}")
        model = FilterModel(system, ["z_c", "zdd_c", *further], walks, parameters={DELTA: delta})
        # Sensors that do not exist read what the model expects: they shift no estimate, only the covariances.
        noise = Noise(process, {"z_c": 1e-8, "zdd_c": 1e-2, **{n: s**2 for n, s in further.items()}})
        run = extended_kalman_filter(
            model,
            FilterSamples(trip.time, trip.tension, _expected(model, trip, rest)),
            noise,
            Prior(rest, {**dict.fromkeys(rest, 1e-4)}),
            keep="everything",
            once=True,
        )
        observed = observability(run, window=400, instants=30)
        cruising = slice(len(trip.time) // 2, 4 * len(trip.time) // 5)
        std = {name: float(np.median(run.std(name)[cruising])) for name in _QUANTITIES}
        hidden = str(observed.undetectable[0]).split(" (")[0] if observed.undetectable else ""
        rows.append(SensorRow(label, std, observed.detectable, hidden))
    return rows


def _expected(model: Any, trip: Trip, rest: dict[str, float]) -> np.ndarray:
    """Return readings along the trip: those measured, and zero lateral motion for the others."""
    columns = [trip.height, trip.acceleration]
    columns += [np.full(trip.time.size, rest.get(name, 0.0)) for name in model.measured[2:]]
    return np.column_stack(columns)


def table_text(rows: Sequence[SensorRow]) -> str:
    """Return the rows as a Markdown table; standard deviations in mm."""
    head = "| sensors | " + " | ".join(f"{q} [mm]" for q in _QUANTITIES) + " | detectable | what is hidden |"
    lines = [head, "|---|" + "---:|" * len(_QUANTITIES) + "---|---|"]
    for row in rows:
        cells = " | ".join(f"{1e3 * row.std[q]:.2f}" for q in _QUANTITIES)
        lines.append(f"| {row.sensors} | {cells} | {'yes' if row.detectable else 'no'} | {row.hidden} |")
    return "\n".join(lines)


def to_frame(rows: Sequence[SensorRow]) -> pandas.DataFrame:
    """Return the rows as a table."""
    import pandas

    data = [
        {"sensors": r.sensors, **{f"{q} [mm]": 1e3 * s for q, s in r.std.items()}, "detectable": r.detectable}
        for r in rows
    ]
    return pandas.DataFrame(data).set_index("sensors")
