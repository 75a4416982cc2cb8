"""``vtsdt bench lift``: recordings of a virtual lift."""

from __future__ import annotations

from collections.abc import Sequence

from discrepancy.rigs.recording import Logger, RigDisturbance
from discrepancy.rigs.texts import list_table
from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import CommandError, Parser, check_out, common, number, whole
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig.models import MODELS
from vtsdt.rig.rails import RailSpectrum
from vtsdt.rig.recordings import make_configurations, make_lift
from vtsdt.rig.rig import LiftRig

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt bench lift``."""
    args = _parser().parse_args(list(arguments))
    if not args.list and args.out is None:
        raise CommandError("--out DIR is missing: name a folder for the recordings, or ask for --list")
    if args.out is not None:
        check_out(args.out)
    parameters = LiftParameters.load(args.lift) if args.lift else LiftParameters.bench()
    many = bool(args.configurations)
    rate = args.rate or (1000.0 if many else 250.0)
    rig = LiftRig(
        seed=args.seed,
        trips=args.trips,
        strength=args.strength,
        disturbance=RigDisturbance(args.disturbance),
        logger=Logger(rate=rate, fine=max(1, round(4000.0 / rate))),
        over=args.unknown_over,
        under_test=args.model,
        parameters=parameters,
        rails=RailSpectrum() if args.guides == "drawn" else None,
        loads=tuple(args.loads) or ((0.0,) if many else ()),
        only_express=args.express or many,
    )
    command = " ".join(("vtsdt bench lift", *_public_words(arguments)))
    with ProgressLine(args.quiet) as progress:
        progress("prepare the models of the lift")
        if args.list:
            rows = rig.list()
        elif many:
            studies = make_configurations(
                args.out,
                args.configurations,
                args.hide,
                rig=rig,
                parameter_file=args.lift,
                command=command,
                progress=progress,
            )
        else:
            studies = [
                make_lift(args.out, args.hide, rig=rig, parameter_file=args.lift, command=command, progress=progress)
            ]
    if args.list:
        print(list_table(rows))
    elif not args.quiet:
        if many:
            print(f"{len(studies)} configurations of {args.trips} synthetic trips each are in {args.out}")
        else:
            print(f"{args.trips} synthetic recordings of a virtual lift are in {studies[0].parent}")
            print(f"next: vtsdt diagnose {studies[0]} --out {studies[0].parent / 'diagnosis'}")
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="vtsdt bench lift",
        description=(
            "Write recordings of a virtual lift, as a rig would, with a study file. Without --hide nothing is hidden."
        ),
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
    add(
        "--model",
        metavar="NAME",
        default="one_dimensional",
        help=f"under test: {', '.join(MODELS)} (default the first)",
    )
    add("--trips", metavar="N", type=whole(2, "number of trips"), default=10, help="recordings (default 10)")
    add(
        "--rate",
        metavar="HZ",
        type=number(True, "rate"),
        default=None,
        help="rows a second (default 250; 1000 with --configurations)",
    )
    add(
        "--loads",
        metavar="KG",
        type=number(False, "mass"),
        nargs="+",
        default=[],
        help="payloads in turn (default 0 2 4 for the 1D model)",
    )
    add(
        "--guides",
        metavar="HOW",
        default="drawn",
        choices=("drawn", "given"),
        help="drawn from a spectrum, or given by the lift's parameters (default drawn)",
    )
    add("--lift", metavar="FILE.toml", default=None, help="parameters of the lift (default: the shipped bench)")
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
        default=1.0,
        help="root mean square of the force that disturbs the cabin, N (default 1)",
    )
    add(
        "--unknown-over",
        metavar="WHAT",
        default="position",
        help="what unknown_force depends on: position, speed or time",
    )
    add("--express", action="store_true", help="all trips from end to end, up and down in turn")
    add(
        "--configurations",
        metavar="N",
        type=whole(1, "number of configurations"),
        default=0,
        help="write N folders, each with newly set guides; implies --express",
    )
    common(parser, out=False)
    return parser


def _public_words(arguments: Sequence[str]) -> list[str]:
    """Return the words of the command that the README may show: without what is hidden, its size and the folder."""
    kept, skip, words = [], 0, list(arguments)
    while skip < len(words):
        word = words[skip]
        name = word.partition("=")[0]
        if name in ("--hide", "--out", "--strength", "--unknown-over", "--quiet"):
            skip += 1
            if "=" not in word:
                while skip < len(words) and not words[skip].startswith("--"):
                    skip += 1
            continue
        kept.append(word)
        skip += 1
    return kept
