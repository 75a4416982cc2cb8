"""Virtual lifts for the study of the alignment sensor: readings of their sensors, and the truth.

Trips that are evaluated, and trips before and after a rail was moved for the paper's scaling, are three visits to the
same lift: each has its own disturbances and noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from discrepancy.rigs.recording import Logger, RigDisturbance, perturb
from multibody.base.progress import Progress, silent
from vtsdt.alignment.estimate import align, calibrated
from vtsdt.alignment.filter import DEFAULT, Tuning
from vtsdt.alignment.rail import equivalent_deviation, pressing_deviation
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig.models import with_rails
from vtsdt.rig.rails import rail_tables
from vtsdt.rig.rig import LiftRig

__all__ = [
    "EVALUATED_TRIPS",
    "RAIL_SHIFT",
    "SCALING_TRIPS",
    "UNDISTURBED_TRIPS",
    "LiftCase",
    "Visit",
    "make_case",
    "prefixed",
    "prepared",
    "recorded",
    "visit",
    "with_sensor_errors",
]

#: How far the whole rail is moved for the paper's scaling, m.
RAIL_SHIFT = 1e-3
#: Trips before and after that; trips without a disturbing force; trips that are evaluated.
SCALING_TRIPS, UNDISTURBED_TRIPS, EVALUATED_TRIPS = 10, 4, 10
_STEP = 0.01  # m between heights of the truth

Records = tuple[dict[str, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class Visit:
    """Recordings of one visit to a virtual lift, before they are low-passed, and the truth.

    Parameters
    ----------
    records : tuple of dict of ndarray
        time, tension, height, acceleration by trip, as recorded.
    parameters : LiftParameters
        The true ones, with the rails as they are.
    truth : dict of str to float
        True parameters over nominal ones.
    """

    records: Records = field(repr=False)
    parameters: LiftParameters = field(repr=False)
    truth: dict[str, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftCase:
    """Trips of one virtual lift before they are low-passed, and its truth.

    Parameters
    ----------
    seed : int
    evaluated, before, after : Visit
        The trips of the estimate, and other trips before and after the rail was moved, for the scaling of the friction.
    height, pressing, in_plane : ndarray, shape (n,), m
        Height of the floor; deviation of a single rail that presses as hard; sum of both rails' deviations in x.
    """

    seed: int
    evaluated: Visit
    before: Visit
    after: Visit
    height: np.ndarray = field(repr=False)
    pressing: np.ndarray = field(repr=False)
    in_plane: np.ndarray = field(repr=False)
    _scaled: dict[str, tuple[LiftParameters, float]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def undisturbed(self) -> Visit:
        """A few trips without a disturbing force; recorded on first use."""
        return visit(self.seed, 3, UNDISTURBED_TRIPS, force=0.0)

    @cached_property
    def further(self) -> Visit:
        """As many further trips as are evaluated; recorded on first use."""
        return visit(self.seed, 4, len(self.evaluated.records))

    def scaled(self, tuning: Tuning | str = DEFAULT) -> tuple[LiftParameters, float]:
        """Return nominal parameters with friction scaled by the moved rail, and the factor.

        Parameters
        ----------
        tuning : Tuning or str
            Of the filter that the scaling is for.
        """
        name = tuning if isinstance(tuning, str) else tuning.name
        if name not in self._scaled:
            nominal = LiftParameters.bench()
            before, after = (
                align(prepared(part.records), nominal, tuning=tuning, observe=False)
                for part in (self.before, self.after)
            )
            self._scaled[name] = calibrated(nominal, before, after, RAIL_SHIFT)
        return self._scaled[name]


def visit(
    seed: int,
    number: int,
    trips: int,
    *,
    shift: float = 0.0,
    force: float = 1.0,
    parameters: LiftParameters | None = None,
    progress: Progress = silent,
) -> Visit:
    """Record trips of a virtual lift.

    Parameters
    ----------
    seed : int
        Of the lift: its rails, its true parameters, the offsets of its sensors.
    number : int
        Of the visit; another number has other disturbances and noise.
    trips : int
    shift : float, m
        By which the cabin's right rail was moved as a whole towards the cabin.
    force : float, N
        Root mean square of the force that disturbs the cabin.
    parameters : LiftParameters, optional
        A lift with its rails; default: the bench between rails drawn for the seed.
    progress : callable
    """
    given = parameters or with_rails(LiftParameters.bench(), rail_tables(LiftRig(seed=seed).profiles))
    guide = given.cabin_guide
    if shift and guide.right_x is not None:
        moved = dataclasses.replace(guide.right_x, deviation=tuple(d + shift for d in guide.right_x.deviation))
        given = dataclasses.replace(given, cabin_guide=dataclasses.replace(guide, right_x=moved))
    rig = LiftRig(
        seed=seed,
        trips=trips,
        under_test="cabin",
        only_express=True,
        logger=Logger(rate=1000.0, fine=4),
        rails=None,
        parameters=given,
        configuration=number,
        disturbance=RigDisturbance(force),
    )
    drawn = perturb(rig.uncertain, rig.stream(1))
    values = {name: float(getattr(v, "value", v)) for name, v in dict(drawn).items()}
    nominal = {u.name: u.value for u in rig.uncertain}
    truth = {name: values[name] / nominal[name] for name in nominal}
    return Visit(recorded(rig, values, progress), rig.true_parameters(values), truth)


def recorded(rig: LiftRig, values: dict[str, float], progress: Progress) -> Records:
    """Return the readings of a virtual lift's sensors on each of its trips."""
    _, runs = rig.record(values, (), (), [f"trip {k + 1}" for k in range(rig.trips)], progress)
    columns = {
        "tension": ("tension_c_N", 1.0),
        "height": ("cabin_height_mm", 1e-3),
        "acceleration": ("cabin_acceleration_m_per_s2", 1.0),
    }
    return tuple(
        {"time": stamps, **{k: factor * table[column] for k, (column, factor) in columns.items()}}
        for _, stamps, table in runs
    )


def make_case(seed: int, trips: int = EVALUATED_TRIPS, progress: Progress = silent) -> LiftCase:
    """Record trips of a virtual lift, and others before and after its rail was moved for the scaling.

    Parameters
    ----------
    seed : int
    trips : int
    progress : callable
    """
    evaluated = visit(seed, 0, trips, progress=prefixed(progress, "evaluated, "))
    before = visit(seed, 1, SCALING_TRIPS, progress=prefixed(progress, "before the rail is moved, "))
    after = visit(seed, 2, SCALING_TRIPS, shift=RAIL_SHIFT, progress=prefixed(progress, "after it, "))
    cabin, travel = evaluated.parameters.cabin, evaluated.parameters.hoistway.travel
    height = np.arange(round(travel / _STEP) + 1) * _STEP
    rails = evaluated.parameters.cabin_guide.profiles()
    return LiftCase(
        seed=seed,
        evaluated=evaluated,
        before=before,
        after=after,
        height=height,
        pressing=pressing_deviation(evaluated.parameters, height),
        in_plane=equivalent_deviation(rails, (cabin.shoe_low, cabin.shoe_high), height),
    )


def prefixed(progress: Progress, prefix: str) -> Progress:
    """Return a progress function that puts a prefix before each line."""
    return lambda text: progress(prefix + text)


def prepared(records: Sequence[dict[str, np.ndarray]]) -> list[Trip]:
    """Return records as trips: low-passed, without the accelerometer's offset."""
    return [
        Trip.from_arrays(r["time"], r["tension"], r["height"], r["acceleration"], name=f"trip {k}")
        for k, r in enumerate(records, 1)
    ]


def with_sensor_errors(
    records: Sequence[dict[str, np.ndarray]],
    seed: int,
    *,
    tension_gain: float = 0.0,
    tension_offset: float = 0.0,
    tension_noise: float = 0.0,
    acceleration_noise: float = 0.0,
    acceleration_offset: float = 0.0,
    height_noise: float = 0.0,
    height_offset: float = 0.0,
    height_gain: float = 0.0,
) -> list[dict[str, np.ndarray]]:
    """Return records with further errors of their sensors: gain errors (1 is 100 %), offsets, white noise."""
    rng = np.random.default_rng([seed, 77])
    changed = []
    for record in records:
        size = record["time"].size
        changed.append(
            {
                "time": record["time"],
                "tension": (1.0 + tension_gain) * record["tension"]
                + tension_offset
                + tension_noise * rng.standard_normal(size),
                "height": (1.0 + height_gain) * record["height"]
                + height_offset
                + height_noise * rng.standard_normal(size),
                "acceleration": record["acceleration"]
                + acceleration_offset
                + acceleration_noise * rng.standard_normal(size),
            }
        )
    return changed
