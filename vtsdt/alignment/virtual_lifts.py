"""Virtual lifts for the study of the alignment sensor: what their sensors read, and the truth that it never sees.

Trips that are judged, trips before and trips after a rail was moved for the paper's scaling are three visits to the
same lift: each meets disturbances and noise of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from vtsdt.alignment.estimate import align, calibrated, equivalent_deviation, pressing_deviation
from vtsdt.alignment.filter import DEFAULT, Tuning
from vtsdt.alignment.trips import Trip, prepare
from vtsdt.files.parameters import LiftParameters

__all__ = [
    "CALM", "INTRODUCED", "RECORDED", "SCALING", "Case", "Visit", "make_case", "prepared", "recorded", "spoiled",
    "visit",
]  # fmt: skip

#: How far the whole rail is moved for the paper's scaling, m.
INTRODUCED = 1e-3
#: Trips before and after that; trips that no force disturbs; trips that are recorded for judging.
SCALING, CALM, RECORDED = 10, 4, 10
_STEP = 0.01  # m between heights of the truth

Records = tuple[dict[str, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class Visit:
    """What was recorded on one visit to a virtual lift, before it is low-passed, and what is true of it.

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


@dataclass(frozen=True, eq=False)
class Case:
    """Trips of one virtual lift before they are low-passed, and its truth.

    Parameters
    ----------
    seed : int
    judged, before, after : Visit
        What is estimated from, and what the friction is scaled with: other trips, before and after the rail was moved.
    height, pressing, in_plane : ndarray, shape (n,), m
        By the height of the floor: the deviation of a single rail that presses as hard, and the sum of both rails'
        deviations in x.
    """

    seed: int
    judged: Visit
    before: Visit
    after: Visit
    height: np.ndarray = field(repr=False)
    pressing: np.ndarray = field(repr=False)
    in_plane: np.ndarray = field(repr=False)

    @cached_property
    def calm(self) -> Visit:
        """A few trips that no force disturbs; recorded when they are asked for."""
        return visit(self.seed, 3, CALM, force=0.0)

    @cached_property
    def more(self) -> Visit:
        """As many further trips as are judged; recorded when they are asked for."""
        return visit(self.seed, 4, len(self.judged.records))

    def scaled(self, tuning: Tuning | str = DEFAULT) -> tuple[LiftParameters, float]:
        """Return nominal parameters with friction scaled by the rail that was moved, and the factor.

        Parameters
        ----------
        tuning : Tuning or str
            Of the filter that the scaling is for.
        """
        name = tuning if isinstance(tuning, str) else tuning.name
        kept: dict[str, tuple[LiftParameters, float]] = self.__dict__.setdefault("_scaled", {})
        if name not in kept:
            nominal = LiftParameters.bench()
            pair = [
                align(prepared(each.records), nominal, tuning=tuning, observe=False)
                for each in (self.before, self.after)
            ]
            kept[name] = calibrated(nominal, pair[0], pair[1], INTRODUCED)
        return kept[name]


def visit(
    seed: int, number: int, trips: int, *, shift: float = 0.0, force: float = 1.0,
    parameters: LiftParameters | None = None, progress: Callable[[str], Any] = lambda text: None,
) -> Visit:  # fmt: skip
    """Record trips of a virtual lift.

    Parameters
    ----------
    seed : int
        Of the lift: its rails, its true parameters, the offsets of its sensors.
    number : int
        Of the visit: another number has other disturbances and noise.
    trips : int
    shift : float, m
        By which the cabin's right rail was moved as a whole towards the cabin.
    force : float, N
        Root mean square of the force that disturbs the cabin.
    parameters : LiftParameters, optional
        A lift whose own rails are taken; default: the bench between rails drawn for the seed.
    progress : callable
    """
    from discrepancy.rigs.recording import Disturbance, Logger, perturb
    from vtsdt.rig.models import with_rails
    from vtsdt.rig.rails import rail_tables
    from vtsdt.rig.rig import LiftRig

    given = parameters or with_rails(LiftParameters.bench(), rail_tables(LiftRig(seed=seed).profiles))
    guide = given.cabin_guide
    if shift and guide.right_x is not None:
        moved = dataclasses.replace(guide.right_x, deviation=tuple(d + shift for d in guide.right_x.deviation))
        given = dataclasses.replace(given, cabin_guide=dataclasses.replace(guide, right_x=moved))
    rig = LiftRig(
        seed=seed, trips=trips, under_test="cabin", only_express=True, logger=Logger(rate=1000.0, fine=4), rails=None,
        parameters=given, configuration=number, disturbance=Disturbance(force),
    )  # fmt: skip
    drawn = perturb(rig.uncertain, rig.stream(1))
    values = {name: float(getattr(v, "value", v)) for name, v in dict(drawn).items()}
    nominal = {u.name: u.value for u in rig.uncertain}
    truth = {name: values[name] / nominal[name] for name in nominal}
    return Visit(recorded(rig, values, progress), rig.true_parameters(values), truth)


def recorded(rig: Any, values: dict[str, float], progress: Callable[[str], Any]) -> Records:
    """Return what a virtual lift's sensors read on each of its trips."""
    _, runs = rig.record(values, (), (), [f"trip {k + 1}" for k in range(rig.trips)], progress)
    columns = {
        "tension": ("tension_c_N", 1.0), "height": ("cabin_height_mm", 1e-3),
        "acceleration": ("cabin_acceleration_m_per_s2", 1.0),
    }  # fmt: skip
    return tuple(
        {"time": stamps, **{k: factor * table[column] for k, (column, factor) in columns.items()}}
        for _, stamps, table in runs
    )


def make_case(seed: int, trips: int = RECORDED, progress: Callable[[str], Any] = lambda text: None) -> Case:
    """Record trips of a virtual lift, and others before and after its rail was moved, for the scaling.

    Parameters
    ----------
    seed : int
    trips : int
    progress : callable
    """
    judged = visit(seed, 0, trips, progress=partial(_tell, progress, "judged, "))
    before = visit(seed, 1, SCALING, progress=partial(_tell, progress, "before the rail is moved, "))
    after = visit(seed, 2, SCALING, shift=INTRODUCED, progress=partial(_tell, progress, "after it, "))
    cabin, travel = judged.parameters.cabin, judged.parameters.hoistway.travel
    height = np.arange(round(travel / _STEP) + 1) * _STEP
    rails = judged.parameters.cabin_guide.profiles()
    return Case(
        seed, judged, before, after, height, pressing_deviation(judged.parameters, height),
        equivalent_deviation(rails, (cabin.shoe_low, cabin.shoe_high), height),
    )  # fmt: skip


def _tell(progress: Callable[[str], Any], before: str, text: str) -> None:
    progress(before + text)


def prepared(records: Sequence[dict[str, np.ndarray]]) -> list[Trip]:
    """Return records as trips, low-passed and without the accelerometer's offset."""
    from estimation.files.record import Record, Signal

    found = []
    for k, each in enumerate(records):
        units = {"tension": "N", "height": "m", "acceleration": "m/s**2"}
        signals = {name: Signal(each[name], unit, name, unit) for name, unit in units.items()}
        found.append(prepare(Record(f"trip {k + 1}", Path(f"trip_{k + 1}"), each["time"], signals)))
    return found


def spoiled(
    records: Sequence[dict[str, np.ndarray]], seed: int, *, tension_gain: float = 0.0, tension_offset: float = 0.0,
    tension_noise: float = 0.0, acceleration_noise: float = 0.0, acceleration_offset: float = 0.0,
    height_noise: float = 0.0, height_offset: float = 0.0, height_gain: float = 0.0,
) -> list[dict[str, np.ndarray]]:  # fmt: skip
    """Return records with further errors of their sensors: a gain (1 is 100 %), offsets, white noise."""
    rng = np.random.default_rng([seed, 77])
    found = []
    for each in records:
        size = each["time"].size
        found.append(
            {
                "time": each["time"],
                "tension": (1.0 + tension_gain) * each["tension"] + tension_offset
                + tension_noise * rng.standard_normal(size),
                "height": (1.0 + height_gain) * each["height"] + height_offset
                + height_noise * rng.standard_normal(size),
                "acceleration": each["acceleration"] + acceleration_offset
                + acceleration_noise * rng.standard_normal(size),
            }
        )  # fmt: skip
    return found
