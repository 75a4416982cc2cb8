"""``vtsdt what-if``: what straightening and lubricating a lift's guides would save."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import CommandError, Parser, check_out, common, json_option, number, print_json, whole
from vtsdt.whatif.report import summary
from vtsdt.whatif.run import run_what_if
from vtsdt.whatif.settings import Settings, read_settings

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt what-if``."""
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
    check_out(args.out)
    with ProgressLine(args.quiet) as progress:
        progress("read the settings")
        try:
            study, page = run_what_if(settings, args.out, progress)
        except ValueError as error:
            if type(error) is ValueError:  # settings that contradict each other
                raise CommandError(str(error)) from None
            raise
    if args.json:
        print_json(page.with_name("what-if.json"))
    elif not args.quiet:
        print(summary(study))
        print(f"the page is {page}")
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="vtsdt what-if",
        description=(
            "Run the reference model with the estimated profile of the rail as it is, straightened, lubricated and "
            "both, and compare it with measured trips. Writes report.html, what-if.json and the figures."
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
    add("--trips-per-day", metavar="N", type=number(False, "number of trips"), help="to state the savings of a year")
    json_option(parser)
    common(parser)
    return parser
