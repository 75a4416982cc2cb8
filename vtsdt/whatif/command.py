"""``vtsdt what-if``: what straightening and lubricating would bring, from an estimated profile and measured trips."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vtsdt.files.parameters import LiftParameters, ParameterError
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.whatif.settings import Settings, read_settings

if TYPE_CHECKING:
    from vtsdt.whatif.result import WhatIf
    from vtsdt.whatif.threshold import Threshold

__all__ = ["main", "run", "threshold_from"]


def run(settings: Settings, out: str | Path, progress: Callable[[str], None] | None = None) -> tuple[WhatIf, Path]:
    """Carry out a what-if study and write it into a folder.

    Parameters
    ----------
    settings : Settings
    out : path
    progress : callable, optional

    Returns
    -------
    WhatIf, Path
        The study, and its page.

    Raises
    ------
    ParameterError, RecordError, ValueError
        With everything that is wrong with files and settings.
    """
    from vtsdt.whatif.compare import compare_trips, read_trips, updated, weighed
    from vtsdt.whatif.report import write_what_if
    from vtsdt.whatif.study import what_if

    told = progress or (lambda text: None)
    parameters = LiftParameters.load(settings.lift) if settings.lift else LiftParameters.bench()
    rail = ProfileTable.load(settings.profile) if settings.profile else None
    if rail is None:
        if parameters.cabin_guide.right_x is None:
            raise ParameterError(
                "what-if", ["the lift's right rail is straight: give --profile, as `vtsdt align` writes it"]
            )
        rail = ProfileTable.of(parameters.cabin_guide.right_x)
    notes = []
    low, high = float(rail.height[0]), float(rail.height[-1])
    reach = parameters.hoistway.travel + parameters.cabin.shoe_high
    if high < reach - 0.05 or low > parameters.cabin.shoe_low + 0.05:
        notes.append(
            f"The profile covers {low:.2f} to {high:.2f} m, the shoes reach {parameters.cabin.shoe_low:.2f} to "
            f"{reach:.2f} m: beyond its ends the rail is taken to go on as it ends."
        )
    rail = _extended(rail, parameters)
    records = read_trips(settings.trips, settings.time, settings.columns) if settings.trips else []
    if records:
        parameters = weighed(parameters, records)
    parameters = updated(parameters, rail)
    found = threshold_from(settings, parameters) if settings.configurations else None
    level = found.level if found is not None else settings.threshold
    trips = compare_trips(records, parameters, rail, progress=told) if records else []
    study = what_if(
        parameters,
        rail,
        threshold=level,
        lubrication=settings.lubrication,
        doubts=settings.doubts,
        samples=settings.samples,
        direction=settings.direction,
        seed=settings.seed,
        progress=told,
    )
    told("draw the figures")
    page = write_what_if(Path(out), study, settings, lift=parameters.name, trips=trips, threshold=found, notes=notes)
    return study, page


def _extended(rail: ProfileTable, parameters: LiftParameters) -> ProfileTable:
    """Return the profile over the whole rail: constant beyond its ends, as the model takes it."""
    low, high = parameters.hoistway.rail_bottom, parameters.hoistway.rail_top
    height, delta, spread = rail.height, rail.delta, rail.spread
    if height[0] > low:
        height, delta, spread = np.r_[low, height], np.r_[delta[0], delta], np.r_[spread[0], spread]
    if height[-1] < high:
        height, delta, spread = np.r_[height, high], np.r_[delta, delta[-1]], np.r_[spread, spread[-1]]
    return ProfileTable(height, delta, spread)


def threshold_from(settings: Settings, parameters: LiftParameters) -> Threshold:
    """Return the threshold from the configurations of the settings: estimated profiles, measured energies.

    The energy of a trip is ∫ friction · speed with friction = m (z̈ + g) − F_c, the cabin's mass from the tension at
    rest of all trips of that configuration.
    """
    from estimation.signals.preparation import low_pass
    from vtsdt.whatif.compare import FRICTION_LOW_PASS, read_trips, weighed
    from vtsdt.whatif.threshold import configuration, friction_loss, threshold

    found = []
    for each in settings.configurations:
        records = read_trips(each.trips, settings.time, settings.columns)
        cabin = weighed(parameters, records).cabin
        energies = []
        for record in records:
            t = np.asarray(record.time)
            signal = {n: np.asarray(s.values) for n, s in record.signals.items()}
            speed = np.gradient(low_pass(t, signal["z_c"], FRICTION_LOW_PASS), t)
            mass = cabin.mass + float(np.median(signal["payload"]))
            energies.append(friction_loss(t, signal["F_c"], signal["a_c"], speed, mass))
        reach = parameters.hoistway.travel + parameters.cabin.shoe_high
        rail = ProfileTable.load(each.profile)
        low, high = max(rail.height[0], parameters.cabin.shoe_low), min(rail.height[-1], reach)
        found.append(configuration(each.name, rail, energies, float(low), float(high)))
    return threshold(found, settings.fraction, seed=settings.seed)


# -------------------------------------------------------------------- command line


def _parser() -> argparse.ArgumentParser:
    from vtsdt.cli.arguments import Parser, common, number, whole

    parser = Parser(
        prog="vtsdt what-if",
        description=(
            "Run the reference model with the estimated profile of the rail as it is, straightened, lubricated and "
            "both, and lay it beside measured trips. Writes report.html, what-if.json and the figures."
        ),
    )
    add = parser.add_argument
    add("files", metavar="SETTINGS.toml|TRIP", nargs="*", help="a settings file, recordings of trips, or both")
    add("--profile", metavar="FILE", help="estimated profile: height_m, delta_mm, spread_mm as CSV or JSON")
    add("--lift", metavar="FILE.toml", help="parameters of the lift (default: the shipped bench)")
    add("--threshold", metavar="MM", type=number(True, "threshold"), help="deviation that is left (default 2.3)")
    add("--lubrication", metavar="FACTOR", type=number(True, "factor"), help="on the friction (default 0.9)")
    add("--direction", choices=("up", "down"), help="of the trip (default up)")
    add("--samples", metavar="N", type=whole(0, "number of draws"), help="draws for the intervals (default 40)")
    add("--seed", metavar="N", type=whole(0, "seed"), help="of the draws (default 0)")
    add("--trips-per-day", metavar="N", type=number(False, "number of trips"), help="to tell savings of a year")
    common(parser)
    return parser


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt what-if``."""
    from multibody.base.progress import ProgressLine
    from vtsdt.cli.arguments import CommandError
    from vtsdt.whatif.report import answer

    args = _parser().parse_args(list(arguments))
    tables = [f for f in args.files if f.endswith(".toml")]
    trips = tuple(Path(f) for f in args.files if not f.endswith(".toml"))
    if len(tables) > 1:
        raise CommandError(f"{' and '.join(tables)}: give one settings file")
    settings = read_settings(tables[0]) if tables else Settings()
    settings = settings.with_options(
        lift=Path(args.lift) if args.lift else None,
        profile=Path(args.profile) if args.profile else None,
        trips=trips or None,
        threshold=1e-3 * args.threshold if args.threshold else None,
        lubrication=args.lubrication,
        direction=args.direction,
        samples=args.samples,
        seed=args.seed,
        trips_per_day=args.trips_per_day,
    )
    if Path(args.out).is_file():
        raise CommandError(f"--out {args.out}: is a file: name a folder to write into")
    with ProgressLine(args.quiet) as progress:
        progress("read the settings")
        try:
            study, page = run(settings, args.out, progress)
        except ValueError as error:
            if type(error) is ValueError:  # settings that do not go together
                raise CommandError(str(error)) from None
            raise
    if not args.quiet:
        print(answer(study))
        print(f"the page is {page}")
    return 0
