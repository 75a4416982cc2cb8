"""What a visit to a lift says: the guides over height, the tension's error, the energy lost, the ride."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimation.signals.preparation import low_pass
from operation.store.judgement import Quantity
from vtsdt.alignment.estimate import align
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.whatif.threshold import friction_loss

__all__ = ["DEVIATIONS", "SECTIONS", "TENSION", "WORK", "judge_trips"]

#: Thirds of the travel.  A visit of two trips gives the deviation of each far better than that of single heights.
SECTIONS = ("lower", "middle", "upper")
DEVIATIONS = tuple(f"deviation, {section} third" for section in SECTIONS)
MEDIAN, TENSION, WORK, RIDE = "median deviation", "tension error", "friction work of a trip", "vibration of the ride"
#: Frequency up to which passengers' comfort is judged here, Hz.
RIDE_HZ = 10.0


def judge_trips(trips: Sequence[Trip], lift: LiftParameters | None = None) -> dict[str, Quantity]:
    """Return what trips up and down, made on one visit, say of a lift.

    Parameters
    ----------
    trips : sequence of Trip
        Both directions, so that an error of the tension is known.
    lift : LiftParameters, optional
        Default: the shipped bench.

    Raises
    ------
    AlignmentError
        If the trips cannot be evaluated.
    """
    lift = lift or LiftParameters.bench()
    alignment = align(trips, lift, observe=False)
    delta = np.asarray(alignment.estimate)
    known = np.isfinite(delta)
    height, delta = alignment.height[known], delta[known]
    edges = np.linspace(height[0], height[-1], len(SECTIONS) + 1)
    error = alignment.tension_error or 0.0
    work = [
        friction_loss(t.time, t.tension - error, t.acceleration, t.speed, lift.cabin.mass + t.payload) for t in trips
    ]
    ride = []
    for t in trips:
        moving = np.abs(t.speed) > 0.5 * np.max(np.abs(t.speed))
        slow = low_pass(t.time, t.acceleration[:, None], RIDE_HZ)[:, 0]
        ride.append(float(np.std(slow[moving])))
    quantities = {
        name: Quantity(value=float(np.mean(delta[(height >= low) & (height <= high)])), unit="m")
        for name, low, high in zip(DEVIATIONS, edges[:-1], edges[1:], strict=True)
    }
    quantities[MEDIAN] = Quantity(value=float(np.median(delta)), unit="m")
    quantities[TENSION] = Quantity(value=error, unit="N")
    quantities[WORK] = Quantity(value=float(np.mean(work)), unit="J")
    quantities[RIDE] = Quantity(value=float(np.mean(ride)), unit="m/s**2")
    return quantities
