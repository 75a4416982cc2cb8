"""``vtsdt validate fleet``: a year of a simulated fleet of lifts against its truth."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import Parser, check_out, common, number, whole

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt validate fleet``."""
    parser = Parser(
        prog="vtsdt validate fleet",
        description="Simulate a year of a fleet of lifts (rails settle, shoes wear, guides are lubricated, sensors "
        "drift, or nothing happens), judge every visit, and compare with the truth: time to detection, false alarms, "
        "right names. Visits that are in --out already are not simulated again.",
    )
    add = parser.add_argument
    add("--lifts", metavar="N", type=whole(1, "number of lifts"), default=10, help="default 10; full scale: 200")
    add(
        "--visits",
        metavar="N",
        type=whole(8, "number of visits"),
        default=26,
        help="of a lift in the year (default 26)",
    )
    add("--seed", metavar="N", type=whole(0, "seed"), default=0, help="of the fleet (default 0)")
    add(
        "--false-alarms",
        metavar="N",
        type=number(True, "rate"),
        default=0.2,
        help="stated, per machine and year (default 0.2)",
    )
    add("--workers", metavar="N", type=whole(1, "number of processes"), help="default: the processors here")
    common(parser)
    args = parser.parse_args(list(arguments))
    check_out(args.out)
    with ProgressLine(args.quiet) as args.progress:
        from vtsdt.fleet.command import validate_fleet

        return validate_fleet(args)
