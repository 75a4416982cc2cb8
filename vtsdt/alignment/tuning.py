"""Origin of the tuning ``likelihood``: ``python -m vtsdt.alignment.tuning [--out FILE.md]``.

Variances of height, speed, δ and both readings that maximise the likelihood of trips of a virtual lift.  The readings
are not low-passed, because filtered readings are not white and have no meaningful likelihood.  The other tunings are
evaluated on the same trips.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from multibody.base.progress import Progress, ProgressLine, silent
from vtsdt.alignment.estimate import balance
from vtsdt.alignment.filter import DELTA, TUNINGS, GuideFilter, Tuning
from vtsdt.alignment.trips import AlignmentError, Trip
from vtsdt.alignment.virtual_lifts import prepared, visit
from vtsdt.files.parameters import LiftParameters

if TYPE_CHECKING:
    from estimation.filters.run import FilterRun
    from estimation.filters.samples import FilterSamples
    from estimation.filters.tuning import Tuned

__all__ = ["page_text", "recorded", "table_text"]

_FREE = ("z", "v_z", "delta")
#: Searches, each from the geometric mean over the trips of the previous one.
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class TunedTrips:
    """TunedTrips of a virtual lift, as sampled and low-passed.

    Parameters
    ----------
    lift : LiftParameters
        Nominal ones.
    smooth : sequence of Trip
        Low-passed.
    raw : sequence of FilterSamples
        As sampled, without the offset of the accelerometer and the error of the tension.
    """

    lift: LiftParameters
    smooth: Sequence[Trip]
    raw: Sequence[FilterSamples]


@dataclass(frozen=True, kw_only=True)
class TuningFit:
    """How well a tuning fits the trips.

    Parameters
    ----------
    tuning : Tuning
    likelihood : float
        Mean logarithm of the likelihood of a sample; NaN if the filter diverges.
    height, acceleration : float
        Mean square of each reading's innovation over the variance that the filter expects; 1 if that is right.
    bound : float
        Share of the samples with δ at its lower bound, on the low-passed trips that `vtsdt align` uses.
    """

    tuning: Tuning
    likelihood: float
    height: float
    acceleration: float
    bound: float


def recorded(seed: int = 41, trips: int = 2, progress: Progress = silent) -> TunedTrips:
    """Record trips of a virtual lift.

    Parameters
    ----------
    seed : int
        Of the lift.
    trips : int
        Two or more, up and down alternately.
    progress : callable
    """
    from estimation.filters.samples import FilterSamples

    records = visit(seed, 0, trips, progress=progress).records
    smooth, lift = prepared(records), LiftParameters.bench()
    error = balance(smooth, lift, np.linspace(0.1, lift.hoistway.travel - 0.1, 100)) or 0.0
    raw = [
        FilterSamples(r["time"], r["tension"] - error, np.column_stack([r["height"], r["acceleration"] - t.offset]))
        for r, t in zip(records, smooth, strict=True)
    ]
    taken = [dataclasses.replace(trip, tension=trip.tension - error) for trip in smooth]
    return TunedTrips(lift, taken, raw)


def maximum_likelihood(
    trips: TunedTrips, steps: int = 25, progress: Progress = silent
) -> tuple[Tuning, list[list[Tuned]]]:
    """Return the tuning that maximises the likelihood of trips, from the start ``quiet``, and the searches.

    A search stops early, at different values for each trip; it is restarted from the mean over the trips.  The lateral
    states keep their noise, because the likelihood hardly depends on it.

    Parameters
    ----------
    trips : TunedTrips
    steps : int
        Of each search, at most.
    progress : callable

    Returns
    -------
    Tuning, list of list of Tuned
        The searches, by round and trip.
    """
    from estimation.filters.tuning import tune

    tuning, searches = TUNINGS["quiet"], []
    for _ in range(ROUNDS):
        sensor = GuideFilter(parameters=trips.lift, tuning=tuning)
        model, names = sensor.model(), {n.rpartition(".")[2]: n for n in sensor.system.state_names}
        names["delta"] = DELTA
        # Each trip has its own initial state, so each is tuned alone; the geometric mean is used.
        results = [
            tune(
                model,
                part,
                sensor.noise(),
                sensor.prior(trip),
                process=[names[k] for k in _FREE],
                measurement=["z_c", "zdd_c"],
                steps=steps,
                progress=progress,
                once=True,
            )
            for part, trip in zip(trips.raw, trips.smooth, strict=True)
        ]
        values = np.exp(np.mean([np.log(tuned.to_frame()["tuned"].to_numpy()) for tuned in results], axis=0))
        process = {**tuning.process, **dict(zip(_FREE, map(float, values), strict=False))}
        tuning = dataclasses.replace(
            TUNINGS["likelihood"], process=process, height=float(values[3]), acceleration=float(values[4])
        )
        searches.append(results)
    return tuning, searches


def fit_tuning(trips: TunedTrips, tuning: Tuning) -> TuningFit:
    """Return how likely the trips are under a tuning, and how often δ is at its lower bound.

    Parameters
    ----------
    trips : TunedTrips
    tuning : Tuning
    """
    from estimation.filters.errors import FilterDivergence
    from estimation.filters.extended_kalman import extended_kalman_filter

    sensor = GuideFilter(parameters=trips.lift, tuning=tuning)
    model, noise = sensor.model(), sensor.noise()
    try:
        runs = [
            extended_kalman_filter(model, part, noise, sensor.prior(trip), once=True)
            for part, trip in zip(trips.raw, trips.smooth, strict=True)
        ]
    except FilterDivergence:
        runs = []
    count = sum(run.samples.count for run in runs)
    likelihood = sum(run.log_likelihood for run in runs) / count if runs else np.nan
    squares = np.nanmean(np.concatenate([run.normalised**2 for run in runs]), axis=0) if runs else (np.nan, np.nan)
    shares = [_at_bound(sensor, trip) for trip in trips.smooth]
    return TuningFit(
        tuning=tuning,
        likelihood=float(likelihood),
        height=float(squares[0]),
        acceleration=float(squares[1]),
        bound=float(np.mean(shares)),
    )


def _at_bound(sensor: GuideFilter, trip: Trip) -> float:
    """Return the share of a trip's samples with δ at its lower bound; NaN if the filter diverges."""
    try:
        run: FilterRun = sensor.run(trip)
    except AlignmentError:
        return np.nan
    low = run.model.bounds[run.model.index(DELTA)][0] + run.model.nominal(DELTA)
    return float(np.mean(run[DELTA] < low + 1e-5))


def table_text(rows: Sequence[TuningFit]) -> str:
    """Return the fits as a Markdown table."""
    text = [
        "| tuning | Q of z [m²/s] | of ż [m²/s³] | of δ [m²/s] | of x [m²/s] | R of z [m²] | of z̈ [m²/s⁴] | "
        "log likelihood of a sample | innovations² over expected: z | z̈ | δ at its lower bound |",
        "|---|" + "---:|" * 10,
    ]
    for row in rows:
        t = row.tuning
        values = (*(t.process[k] for k in (*_FREE, "x")), t.height, t.acceleration)
        cells = [*(f"{v:.1e}" for v in values), f"{row.likelihood:.2f}", f"{row.height:.2g}", f"{row.acceleration:.2g}"]
        text.append(f"| {t.name} | {' | '.join(cells)} | {row.bound:.0%} |")
    return "\n".join(text)


def page_text(rows: Sequence[TuningFit], searches: Sequence[Sequence[Tuned]], command: str) -> str:
    """Return the table with its explanation, as a page of the documentation.

    Parameters
    ----------
    rows : sequence of TuningFit
    searches : sequence of sequence of Tuned
        The searches, by round and trip.
    command : str
        Which made them.
    """
    text = [
        "# Tuning of the alignment's filter",
        "",
        f"Written by `{command}`.",
        "",
        "The noise that the joint filter of [`vtsdt align`](../howto/align.md) assumes: densities of the process noise "
        "(unit² per second) and variances of the readings, for Table 2 of González et al. 2020 as printed, for the "
        "other tunings that ship, and for the present maximum of the marginal likelihood. Likelihood and innovations "
        "are those of two trips of a virtual lift, up and down, as sampled: low-passed readings are not white, so "
        "their likelihood has no meaning. The last column is for the same trips low-passed, as the command uses "
        "them.",
        "",
        table_text(rows),
        "",
        "Innovations² over expected are 1 where the filter estimates its own error correctly; far below 1 the assumed "
        "noise is too large, far above 1 too small. δ at its lower bound: the share of the samples at which the "
        "estimated cabin has lost contact with the rail. There the shoes are loose, no reading depends on δ, and the "
        "filter explains friction by lateral motion that a cabin between rails cannot make.",
        "",
        "The noise of x decides this. 1e-2 m²/s, as printed, is 3 mm between samples at 1 kHz, and 1e-4 m²/s is 0.3 "
        "mm; the play of a shoe is 0.6 mm. Table 2 also assumes an accelerometer accurate to 0.3 mm/s² and a height "
        "accurate to 10 mm.",
        "",
    ]
    for k, results in enumerate(searches):
        for trip, tuned in enumerate(results):
            before, after = tuned.log_likelihoods[0], tuned.log_likelihoods[-1]
            text.append(
                f"- Search {k + 1}, trip {trip + 1}: log likelihood {before:.0f} before it, {after:.0f} after "
                f"{len(tuned.log_likelihoods) - 1} steps."
            )
    best = max(rows, key=lambda row: np.nan_to_num(row.likelihood, nan=-np.inf))
    if best is not rows[-1]:
        text += [
            "",
            f"The search ends below `{best.tuning.name}`, which has a higher likelihood for the same trips: where δ "
            "reaches its bound the likelihood is not a smooth function of the variances, and a search by finite "
            "differences stops at a local maximum. From this start it does not reach the values that ship.",
        ]
    text += [
        "",
        'The estimates with each of them are in the lines "tuning" of [the study on the virtual '
        "lift](../benchmarks/guide-alignment.md).",
    ]
    return "\n".join(text) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Find the tuning, compare it with the others, and print or write the page."""
    parser = argparse.ArgumentParser(prog="python -m vtsdt.alignment.tuning", description=__doc__)
    parser.add_argument("--seed", type=int, default=41, help="of the virtual lift (default 41)")
    parser.add_argument("--steps", type=int, default=25, help="of the search, at most (default 25)")
    parser.add_argument("--out", metavar="FILE.md", default=None, help="write there instead of printing")
    args = parser.parse_args(arguments)
    with ProgressLine(False) as progress:
        trips = recorded(args.seed, progress=progress)
        best, searches = maximum_likelihood(trips, args.steps, progress)
        best = dataclasses.replace(best, name="found now")
        rows = [fit_tuning(trips, tuning) for tuning in (*TUNINGS.values(), best)]
    text = page_text(rows, searches, f"python -m vtsdt.alignment.tuning --seed {args.seed} --steps {args.steps}")
    if args.out is None:
        print(text)
    else:
        Path(args.out).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
