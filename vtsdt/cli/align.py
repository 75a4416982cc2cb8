"""``vtsdt align``: the alignment of a lift's guides from recordings of trips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from multibody.base.progress import ProgressLine
from multibody.base.result_folder import check_owner
from vtsdt.alignment.estimate import THRESHOLD, align
from vtsdt.alignment.filter import DEFAULT, TUNINGS
from vtsdt.alignment.report import OWNER, write
from vtsdt.alignment.trips import ROLES, read_trips
from vtsdt.cli.arguments import Parser, check_out, common, json_option, number, print_json
from vtsdt.files.parameters import LiftParameters

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt align``."""
    args = _parser().parse_args(list(arguments))
    check_out(args.out)
    out = Path(args.out)
    parameters = LiftParameters.load(args.lift) if args.lift else LiftParameters.bench()
    check_owner(out, OWNER, parameters.name)
    columns = {r: c for r in ("time", *ROLES) if (c := getattr(args, r))}
    units = {r: u for r in ROLES if (u := getattr(args, f"{r}_unit"))}
    with ProgressLine(args.quiet) as progress:
        progress("read the trips")
        trips = read_trips(
            args.trips,
            columns=columns,
            units=units,
            parameters=parameters,
            low_pass_hz=args.low_pass,
            start=args.start,
            stop=args.stop,
        )
        alignment = align(
            trips,
            parameters,
            tuning=args.tuning,
            threshold=1e-3 * args.threshold,
            balanced=not args.no_balance,
            progress=progress,
        )
        progress("write the report")
        page = write(alignment, out, parameters, trips)
    if args.json:
        print_json(out / "alignment.json")
    elif not args.quiet:
        print("\n".join(alignment.sentences()))
        print(f"report: {page}")
        print(f"next: vtsdt what-if --profile {out / 'profile.csv'} --out {out / 'what-if'}")
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="vtsdt align",
        description=(
            "Estimate the alignment of the cabin's guide rails over height from recordings of trips: rope tension, "
            "height and vertical acceleration of the cabin. Writes alignment.json, report.html, profile.csv (for "
            "vtsdt what-if) and figures."
        ),
    )
    add = parser.add_argument
    add("trips", metavar="TRIP", nargs="+", help="recordings, one trip each (CSV, Parquet or MATLAB)")
    add("--lift", metavar="FILE.toml", default=None, help="parameters of the lift (default: the shipped bench)")
    add(
        "--threshold",
        metavar="MM",
        type=number(True, "threshold"),
        default=1e3 * THRESHOLD,
        help="deviation to be corrected, mm (default 2.3)",
    )
    add(
        "--tuning",
        choices=tuple(TUNINGS),
        default=DEFAULT,
        help="; ".join(f"{t.name}: {t.meaning}" for t in TUNINGS.values()) + f" (default {DEFAULT})",
    )
    for role in ("time", *ROLES):
        add(f"--{role}", metavar="COLUMN", default=None, help=f"column of the {role}, if its name is unusual")
    for role in ROLES:
        add(f"--{role}-unit", metavar="UNIT", default=None, help=_unit_help(role))
    add(
        "--low-pass",
        metavar="HZ",
        type=number(True, "frequency"),
        default=60.0,
        help="of all signals (default 60; the model does not hold above it)",
    )
    add("--start", metavar="S", type=float, default=None, help="use the record from this time on, s")
    add("--stop", metavar="S", type=float, default=None, help="use the record up to this time, s")
    add("--no-balance", action="store_true", help="do not correct the zero of the tension and the cabin's mass")
    json_option(parser)
    common(parser)
    return parser


def _unit_help(role: str) -> str:
    return f"unit of the {role}, where the column's name has none or a wrong one"
