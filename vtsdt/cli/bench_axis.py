"""``vtsdt bench axis``: recordings of a virtual linear axis."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import CommandError, Parser, check_out, common, number, whole

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt bench axis``."""
    args = _parser().parse_args(list(arguments))
    if not args.list and args.out is None:
        raise CommandError("--out DIR is missing: name a folder for the recordings, or ask for --list")
    if args.out is not None:
        check_out(args.out)
    with ProgressLine(args.quiet) as progress:
        progress("prepare the model of the axis")
        from discrepancy.questions.trip_plan import TripPlan
        from discrepancy.rigs.axis import list_axis, make_axis
        from discrepancy.rigs.texts import list_table

        try:
            plan = TripPlan.parse(args.trip)
        except ValueError as error:
            raise CommandError(f"--trip {args.trip}: {error}") from error
        if args.list:
            message = list_table(list_axis(strength=args.strength, dry=args.dry_friction))
        else:
            study = make_axis(
                args.out,
                args.hide,
                args.seed,
                args.trips,
                args.strength,
                args.disturbance,
                dry=args.dry_friction,
                over=args.unknown_over,
                plan=plan,
                progress=progress,
            )
            message = (
                f"{args.trips} synthetic recordings of a virtual axis are in {study.parent}\n"
                f"next: vtsdt diagnose {study} --out {study.parent / 'diagnosis'}"
            )
    if args.list or not args.quiet:
        print(message)
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="vtsdt bench axis",
        description="Write recordings of a virtual linear axis. Without --hide nothing is hidden.",
    )
    add = parser.add_argument
    add(
        "--hide",
        metavar="KIND[@WHERE]",
        action="extend",
        nargs="+",
        default=[],
        help="effect to hide; give several, or repeat the option",
    )
    add("--list", action="store_true", help="print what can be hidden, where, and its usual size")
    add("--seed", metavar="N", type=whole(0, "seed"), default=0, help="of all random numbers (default 0)")
    add("--trips", metavar="N", type=whole(2, "number of trips"), default=8, help="recordings (default 8)")
    add(
        "--strength",
        metavar="FACTOR",
        type=number(True, "factor"),
        default=1.0,
        help="factor on the usual size of what is hidden (default 1)",
    )
    add(
        "--disturbance",
        metavar="N",
        type=number(False, "force"),
        default=3.0,
        help="root mean square of the force that disturbs the carriage, N (default 3)",
    )
    add("--dry-friction", action="store_true", help="the guide has dry friction, which the model knows")
    add(
        "--trip",
        metavar="PLAN",
        default="",
        help="other trips of the same machine, as diagnose proposes them: speed=0.5,amplitude=1.5,mirror,stops=3,"
        "load=1.5,sensor=OUTPUT, any of these",
    )
    add(
        "--unknown-over",
        metavar="WHAT",
        default="position",
        help="what unknown_force depends on: position, speed or time (default position)",
    )
    common(parser, out=False)
    return parser
