"""Where the tuning ``likelihood`` comes from: ``python -m vtsdt.alignment.tuning [--out FILE.md]``.

Variances of height, speed, δ and of both readings under which trips of a virtual lift are most likely, as they were
sampled: low-passed readings are not white, and their likelihood means nothing.  The same trips tell how likely they
are under the other tunings.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.alignment.estimate import balance
from vtsdt.alignment.filter import DELTA, TUNINGS, GuideFilter, Tuning
from vtsdt.alignment.trips import AlignmentError, Trip
from vtsdt.alignment.virtual_lifts import prepared, visit
from vtsdt.files.parameters import LiftParameters

if TYPE_CHECKING:
    from estimation.filters import FilterRun, Samples, Tuned

__all__ = ["Believed", "Trips", "believed", "likely", "page_text", "recorded", "table_text"]

_FREE = ("z", "v_z", "delta")
#: Searches, each from the mean of the trips of the one before.
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Trips:
    """Trips of a virtual lift, as they were sampled and low-passed.

    Parameters
    ----------
    lift : LiftParameters
        Nominal ones.
    smooth : sequence of Trip
        Low-passed.
    raw : sequence of Samples
        As they were sampled, without the accelerometer's offset and what is no friction in the tension.
    """

    lift: LiftParameters
    smooth: Sequence[Trip]
    raw: Sequence[Samples]


@dataclass(frozen=True)
class Believed:
    """How a tuning and the trips fit each other.

    Parameters
    ----------
    tuning : Tuning
    likelihood : float
        Logarithm of the likelihood for a sample; NaN if the filter loses the cabin.
    height, acceleration : float
        Mean square of each reading's innovation over the variance that the filter expects: 1 if it knows its own error.
    bound : float
        Share of the samples at which δ stands at its lower bound, on the low-passed trips as `vtsdt align` takes them.
    """

    tuning: Tuning
    likelihood: float
    height: float
    acceleration: float
    bound: float


def recorded(seed: int = 41, trips: int = 2, progress: Callable[[str], Any] = lambda text: None) -> Trips:
    """Record trips of a virtual lift.

    Parameters
    ----------
    seed : int
        Of the lift.
    trips : int
        Two or more, up and down in turn.
    progress : callable
    """
    from estimation.filters import Samples

    records = visit(seed, 0, trips, progress=progress).records
    smooth, lift = prepared(records), LiftParameters.bench()
    error = balance(smooth, lift, np.linspace(0.1, lift.hoistway.travel - 0.1, 100)) or 0.0
    raw = [
        Samples(r["time"], r["tension"] - error, np.column_stack([r["height"], r["acceleration"] - t.offset]))
        for r, t in zip(records, smooth, strict=True)
    ]
    taken = [dataclasses.replace(trip, tension=trip.tension - error) for trip in smooth]
    return Trips(lift, taken, raw)


def likely(
    trips: Trips, steps: int = 25, progress: Callable[[str], Any] = lambda text: None
) -> tuple[Tuning, list[list[Tuned]]]:
    """Return the tuning that makes trips most likely, beginning from ``quiet``, and how it was found.

    Searches stop early on the way, trip by trip in different places: they are begun again from the mean of the trips.
    The lateral states keep their noise: the likelihood hardly depends on it.

    Parameters
    ----------
    trips : Trips
    steps : int
        Of each search, at most.
    progress : callable

    Returns
    -------
    Tuning, list of list of Tuned
        The searches, by round and trip.
    """
    from estimation.filters import tune

    tuning, every = TUNINGS["quiet"], []
    for _ in range(ROUNDS):
        sensor = GuideFilter(trips.lift, tuning)
        model, names = sensor.model(), {n.rpartition(".")[2]: n for n in sensor.system.state_names}
        names["delta"] = DELTA
        # Each trip has a start of its own, so each is tuned alone; the geometric mean counts.
        found = [
            tune(
                model, part, sensor.noise(), sensor.prior(trip), process=[names[k] for k in _FREE],
                measurement=["z_c", "zdd_c"], steps=steps, progress=progress, once=True,
            )
            for part, trip in zip(trips.raw, trips.smooth, strict=True)
        ]  # fmt: skip
        values = np.exp(np.mean([np.log(each.to_frame()["tuned"].to_numpy()) for each in found], axis=0))
        process = {**tuning.process, **dict(zip(_FREE, map(float, values), strict=False))}
        tuning = dataclasses.replace(
            TUNINGS["likelihood"], process=process, height=float(values[3]), acceleration=float(values[4])
        )
        every.append(found)
    return tuning, every


def believed(trips: Trips, tuning: Tuning) -> Believed:
    """Return how likely trips are under a tuning, and how often its filter loses the rail.

    Parameters
    ----------
    trips : Trips
    tuning : Tuning
    """
    from estimation.filters import FilterDivergence, extended

    sensor = GuideFilter(trips.lift, tuning)
    model, noise = sensor.model(), sensor.noise()
    try:
        runs = [
            extended(model, part, noise, sensor.prior(trip), once=True)
            for part, trip in zip(trips.raw, trips.smooth, strict=True)
        ]
    except FilterDivergence:
        runs = []
    count = sum(run.samples.count for run in runs)
    likelihood = sum(run.log_likelihood for run in runs) / count if runs else np.nan
    squares = np.nanmean(np.concatenate([run.normalised**2 for run in runs]), axis=0) if runs else (np.nan, np.nan)
    shares = [_at_bound(sensor, trip) for trip in trips.smooth]
    return Believed(tuning, float(likelihood), float(squares[0]), float(squares[1]), float(np.mean(shares)))


def _at_bound(sensor: GuideFilter, trip: Trip) -> float:
    """Return the share of a trip's samples at which δ stands at its lower bound; NaN if the cabin is lost."""
    try:
        run: FilterRun = sensor.run(trip)
    except AlignmentError:
        return np.nan
    low = run.model.bounds[run.model.index(DELTA)][0] + run.model.nominal(DELTA)
    return float(np.mean(run[DELTA] < low + 1e-5))


def table_text(rows: Sequence[Believed]) -> str:
    """Return tunings and what the trips say of them as a Markdown table."""
    told = [
        "| tuning | Q of z [m²/s] | of ż [m²/s³] | of δ [m²/s] | of x [m²/s] | R of z [m²] | of z̈ [m²/s⁴] | "
        "log likelihood of a sample | innovations² over expected: z | z̈ | δ at its lower bound |",
        "|---|" + "---:|" * 10,
    ]
    for row in rows:
        t = row.tuning
        values = (*(t.process[k] for k in (*_FREE, "x")), t.height, t.acceleration)
        cells = [*(f"{v:.1e}" for v in values), f"{row.likelihood:.2f}", f"{row.height:.2g}", f"{row.acceleration:.2g}"]
        told.append(f"| {t.name} | {' | '.join(cells)} | {row.bound:.0%} |")
    return "\n".join(told)


def page_text(rows: Sequence[Believed], every: Sequence[Sequence[Tuned]], command: str) -> str:
    """Return the table with what it means, as a page of the documentation.

    Parameters
    ----------
    rows : sequence of Believed
    every : sequence of sequence of Tuned
        The searches, by round and trip.
    command : str
        That made them.
    """
    told = [
        "# Tuning of the alignment's filter", "", f"Written by `{command}`.", "",
        "How much the joint filter of [`vtsdt align`](../howto/align.md) trusts its model and its readings: densities "
        "of the process noise (unit² per second) and variances of the readings, for Table 2 of González et al. 2020 as "
        "printed, for the other tunings that ship, and as the marginal likelihood finds them now. Likelihood and "
        "innovations are those of two trips of a virtual lift, up and down, as they were sampled: low-passed readings "
        "are not white, and their likelihood means nothing. The last column is of the same trips low-passed, as the "
        "command takes them.", "", table_text(rows), "",
        "Innovations² over expected are 1 where the filter knows its own error; far below 1 it expects errors that do "
        "not come, far above 1 it is surprised at every sample. δ at its lower bound: the share of the samples at "
        "which the filter has lost the rail. There the shoes are loose, no reading says anything about δ, and friction "
        "goes to lateral motion that a cabin between rails cannot make.", "",
        "Noise of x is what decides that. 1e-2 m²/s, as printed, is 3 mm from one sample to the next at 1 kHz, and "
        "1e-4 m²/s is 0.3 mm; the play of a shoe is 0.6 mm. Table 2 also trusts the accelerometer to 0.3 mm/s² and the "
        "height to no better than 10 mm.", "",
    ]  # fmt: skip
    for k, found in enumerate(every):
        for trip, one in enumerate(found):
            before, after = one.log_likelihoods[0], one.log_likelihoods[-1]
            told.append(
                f"- Search {k + 1}, trip {trip + 1}: log likelihood {before:.0f} before it, {after:.0f} after "
                f"{len(one.log_likelihoods) - 1} steps."
            )
    best = max(rows, key=lambda row: np.nan_to_num(row.likelihood, nan=-np.inf))
    if best is not rows[-1]:
        told += [
            "",
            f"The search ends below `{best.tuning.name}`, which is likelier for the same trips: δ at its bound makes "
            "the likelihood no smooth function of the variances, and a search by differences stops where a better "
            "place is further off. It does not reach the values that ship from this start.",
        ]
    told += [
        "",
        "What each of them estimates stands in the lines \"tuning\" of [the study on the virtual "
        "lift](../benchmarks/guide-alignment.md).",
    ]
    return "\n".join(told) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Find the tuning, lay the others beside it, and print or write both tables."""
    from multibody.base.progress import ProgressLine

    parser = argparse.ArgumentParser(prog="python -m vtsdt.alignment.tuning", description=__doc__)
    parser.add_argument("--seed", type=int, default=41, help="of the virtual lift (default 41)")
    parser.add_argument("--steps", type=int, default=25, help="of the search, at most (default 25)")
    parser.add_argument("--out", metavar="FILE.md", default=None, help="write there instead of printing")
    args = parser.parse_args(arguments)
    with ProgressLine(False) as progress:
        trips = recorded(args.seed, progress=progress)
        found, every = likely(trips, args.steps, progress)
        found = dataclasses.replace(found, name="found now")
        rows = [believed(trips, tuning) for tuning in (*TUNINGS.values(), found)]
    text = page_text(rows, every, f"python -m vtsdt.alignment.tuning --seed {args.seed} --steps {args.steps}")
    if args.out is None:
        print(text)
    else:
        Path(args.out).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
