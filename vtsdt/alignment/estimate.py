"""The guide's alignment from a few sensors of the cabin.

González et al. 2020, sections IV-A and IV-B: the equivalent deviation of the guide rails over height follows from rope
tension, height and vertical acceleration of a few trips.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from multibody.base.progress import Progress, Step, shown_in_notebooks, silent
from vtsdt.alignment.filter import DEFAULT, DELTA, MAX_SPEED_ERROR, TUNINGS, GuideFilter, Tuning
from vtsdt.alignment.result import Alignment
from vtsdt.alignment.trips import AlignmentError, Trip
from vtsdt.files.parameters import LiftParameters

__all__ = ["THRESHOLD", "align", "balance", "calibrated"]

#: Threshold of the paper, m: 70 % of 14 configurations are below it (Fig. 10).
THRESHOLD = 2.3e-3
#: Speed below which friction carries no information on the guides, m/s.
LEAST_SPEED = 0.05
_WINDOW = 0.02  # m: each height uses the samples within this distance
#: Standard deviation of the smoothing weights over height, m: short against the features of the rails, which two levels
#: of shoes blur anyway, and long enough to suppress the cabin's vibration (5 Hz at 0.4 m/s: 80 mm).
_SMOOTH = 0.02


@shown_in_notebooks
def align(
    trips: Sequence[Trip],
    parameters: LiftParameters | None = None,
    *,
    tuning: Tuning | str = DEFAULT,
    threshold: float = THRESHOLD,
    step: float = 0.01,
    balanced: bool = True,
    smooth: bool = False,
    observe: bool = True,
    progress: Progress = silent,
    **options: Any,
) -> Alignment:
    """Estimate the equivalent deviation of the guide over height from several trips.

    Parameters
    ----------
    trips : sequence of Trip
        From `read_trips`.
    parameters : LiftParameters, optional
        Default: the shipped bench.
    tuning : Tuning or {"quiet", "bounded", "table2", "likelihood"}
    threshold : float, m
        Deviations above it are to be corrected.
    step : float, m
        Between heights.
    balanced : bool
        True subtracts from the tension the force that trips up and down have in common besides friction; see `balance`.
    smooth : bool
        True applies the smoother of Rauch, Tung and Striebel to each trip: four times the time, and a slightly smaller
        error.
    observe : bool
        True assesses, on the first trip, what the sensors determine.
    progress : callable, optional
        Called with a line of text.
    options
        Further arguments of `estimation.filters.extended_kalman_filter`.

    Raises
    ------
    AlignmentError
        If there is no trip, or the filter diverges.
    """
    if not trips:
        raise AlignmentError(["no trips were given: name their files"])
    lift = parameters if parameters is not None else LiftParameters.bench()
    if isinstance(tuning, str):
        if tuning not in TUNINGS:
            raise AlignmentError([f"tuning is '{tuning}': give one of {', '.join(TUNINGS)}"])
        tuning = TUNINGS[tuning]
    progress("prepare the model of the cabin")
    sensor = GuideFilter(parameters=lift, tuning=tuning, loaded=any(t.payload != 0.0 for t in trips), options=options)
    low, high = min(t.height.min() for t in trips), max(t.height.max() for t in trips)
    height = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step + 0.0  # no minus zero
    error = balance(trips, lift, height) if balanced else None
    curves: list[np.ndarray] = []
    faults: list[str] = []
    notes, observability = [note for t in trips for note in t.notes], None
    for k, trip in enumerate(trips):
        progress(Step(f"trip {k + 1} of {len(trips)}: {trip.name}", k, len(trips)))
        try:
            run = sensor.run(trip, error or 0.0, keep="everything" if smooth else "variances")
        except AlignmentError as refused:
            faults += refused.faults
            continue
        curve, at_low, at_high = _over_height(run, trip, height)
        if smooth:
            curve, _, _ = _over_height(run.smooth(), trip, height)
        if at_high > 0.2:
            faults.append(
                f"{trip.name}: the filter diverges: over {at_high:.0%} of the travel δ is at its upper bound of "
                f"{1e3 * lift.cabin_guide.gap:g} mm, the depth of the shoe's slot: there is more friction than "
                "guides can cause; check the tension's zero, the cabin's mass and the friction coefficient "
                "in the parameters"
            )
        elif at_low > 0.6:
            faults.append(
                f"{trip.name}: over {at_low:.0%} of the travel there is less friction than shoes with play have in the "
                f"model (δ below {1e3 * sensor.play:.2g} mm is not observable): check the tension's zero"
                f"{'' if error is not None else ' (trips of one direction do not show it)'}, the cabin's mass and the "
                "friction coefficient in the parameters"
            )
        elif at_low > 0.2:
            notes.append(f"{trip.name}: over {at_low:.0%} of the travel the shoes are loose: δ is at its lower bound")
        curves.append(_smoothed(curve, _SMOOTH / step))
        if observability is None and observe:
            from estimation.filters.observability_gramian import observability as observability_of

            moving = np.flatnonzero(np.abs(trip.speed) > LEAST_SPEED)
            observability = observability_of(
                sensor.run(trip, error or 0.0, keep="everything"),
                window=400,
                instants=40,
                part=slice(int(moving[0]), int(moving[-1]) + 1) if moving.size else None,
            )
    if faults:
        raise AlignmentError(faults)
    return Alignment(
        height=height,
        trips=tuple(t.name for t in trips),
        directions=np.array([t.direction for t in trips]),
        curves=np.array(curves),
        threshold=threshold,
        tuning=tuning,
        tension_error=error,
        shoes=(lift.cabin.shoe_low, lift.cabin.shoe_high),
        loose=sensor.play,
        slope=sensor.stiffness,
        observability=observability,
        notes=tuple(dict.fromkeys(notes)),
    )


def _over_height(run: Any, trip: Trip, height: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return δ by height, and the shares of the travel at its lower and its upper bound.

    Samples are left out where the cabin is slow, and where the filter's speed differs from the measured one.
    """
    followed = np.abs(run["cabin.v_z"] - trip.speed) < MAX_SPEED_ERROR
    moving = (np.abs(trip.speed) > LEAST_SPEED) & followed
    at, delta = run["cabin.z"][moving], run[DELTA][moving]
    order = np.argsort(at)
    at, delta = at[order], delta[order]
    first, last = np.searchsorted(at, height - _WINDOW), np.searchsorted(at, height + _WINDOW)
    curve = np.array([np.median(delta[a:b]) if b > a else np.nan for a, b in zip(first, last, strict=True)])
    low, high = run.model.bounds[run.model.index(DELTA)] + run.model.nominal(DELTA)
    known = curve[np.isfinite(curve)]
    if known.size == 0:
        return curve, 0.0, 0.0
    return curve, float(np.mean(known < low + 1e-5)), float(np.mean(known > high - 1e-5))


def _smoothed(curve: np.ndarray, width: float) -> np.ndarray:
    """Return Gaussian weighted means over the heights that are known; ``width`` in grid points."""
    from scipy.ndimage import gaussian_filter1d

    known = np.isfinite(curve)
    weights = gaussian_filter1d(known.astype(float), width, mode="constant")
    sums = gaussian_filter1d(np.where(known, curve, 0.0), width, mode="constant")
    return np.where(known, sums / np.where(known, weights, 1.0), np.nan)


def balance(trips: Sequence[Trip], parameters: LiftParameters, height: np.ndarray) -> float | None:
    """Return the mean force that trips up and down have in common, N: an error of the tension's zero or of the mass.

    Tension less weight less inertia is the friction: downwards on the way up, upwards on the way down.  Half the sum
    of the two at the same height is therefore not friction of the guides but an error of the tension's zero or of the
    mass.  Friction that depends on the direction would count as such an error.

    Returns
    -------
    float or None
        None if all trips go the same way, or trips up and down have no height in common.
    """
    from estimation.signals.preparation import low_pass

    residuals: dict[int, list[np.ndarray]] = {1: [], -1: []}
    for trip in trips:
        z, a, f = low_pass(trip.time, np.column_stack([trip.height, trip.acceleration, trip.tension]), 20.0).T
        speed = np.gradient(z, trip.time)
        moving = speed * trip.direction > 2.0 * LEAST_SPEED
        rest = f - (parameters.cabin.mass + trip.payload) * (STANDARD_GRAVITY + a)
        order = np.argsort(z[moving])
        if order.size:
            residuals[trip.direction].append(
                np.interp(height, z[moving][order], rest[moving][order], left=np.nan, right=np.nan)
            )
    if not (residuals[1] and residuals[-1]):
        return None
    with np.errstate(all="ignore"):
        up, down = (_median(np.array(residuals[d])) for d in (1, -1))
    both = np.isfinite(up) & np.isfinite(down)
    return float(np.mean(0.5 * (up[both] + down[both]))) if both.any() else None


def _median(curves: np.ndarray) -> np.ndarray:
    known = np.isfinite(curves).any(axis=0)
    out = np.full(curves.shape[1], np.nan)
    out[known] = np.nanmedian(curves[:, known], axis=0)
    return out


def calibrated(
    parameters: LiftParameters, before: Alignment, after: Alignment, introduced: float
) -> tuple[LiftParameters, float]:
    """Return parameters with which δ grows by as much as a rail was moved on purpose, and the factor on friction.

    The paper determines contact parameters, which cannot be measured, in this way: increments of δ have to match a
    misalignment that was introduced under control.  Here the friction coefficient is multiplied by the factor.

    Parameters
    ----------
    parameters : LiftParameters
        With which both were estimated.
    before, after : Alignment
        Without and with the rail moved, over the same heights.
    introduced : float, m
        How far the whole rail was moved towards the cabin.

    Raises
    ------
    AlignmentError
        If the estimate did not grow.
    """
    import dataclasses

    low, high = max(before.height[0], after.height[0]), min(before.height[-1], after.height[-1])
    at = before.height[(before.height >= low) & (before.height <= high)]
    growth = np.interp(at, after.height, after.estimate) - np.interp(at, before.height, before.estimate)
    # Only where the shoes touched before: elsewhere a part of the movement takes up play and causes no friction.
    touching = np.interp(at, before.height, before.estimate) > before.loose + 2e-4
    chosen = growth[np.isfinite(growth) & touching]
    change = float(np.median(chosen)) if chosen.size else 0.0
    factor = change / introduced
    if not factor > 0.05:
        raise AlignmentError(
            [
                f"the rail was moved by {1e3 * introduced:.3g} mm and δ grew by {1e3 * change:.3g} mm: the recordings "
                "do not show the movement"
            ]
        )
    guide = dataclasses.replace(parameters.cabin_guide, mu=parameters.cabin_guide.mu * factor)
    return dataclasses.replace(parameters, cabin_guide=guide), factor
