"""The words of the command line: commands, their options, and what is said about words that do not fit."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

__all__ = ["ELSEWHERE", "CommandError", "Elsewhere", "Parser", "common", "number", "parser", "whole"]


class CommandError(ValueError):
    """A command cannot do what it was asked for; the message says why and what to do."""


@dataclass(frozen=True)
class Elsewhere:
    """A command whose own module parses its arguments."""

    target: str
    help: str


#: Commands by their words; each ``main(arguments)`` takes the words that follow.
ELSEWHERE = {
    ("bench", "lift"): Elsewhere("vtsdt.rig.command:main", "recordings of a virtual lift"),
    ("bench", "gear"): Elsewhere("gearbox.rig.rig:main", "recordings of a virtual gear stage"),
    ("align",): Elsewhere("vtsdt.alignment.align:main", "guide rail alignment from cabin vibration"),
    ("what-if",): Elsewhere("vtsdt.whatif.command:main", "what a change of the lift does to comfort and loads"),
    ("update-gearbox",): Elsewhere("gearbox.updating.command:main", "update a gear stage model from recordings"),
    ("warm",): Elsewhere("vtsdt.cli.warm:main", "compile the shipped models before they are needed"),
    ("validate", "papers"): Elsewhere("vtsdt.papers.validation:main", "the papers' tables, made again and compared"),
    ("validate", "discrepancy"): Elsewhere(
        "vtsdt.cli.suites:main", "error rates of finding missing effects"
    ),
}


class Parser(argparse.ArgumentParser):
    """A parser that raises `CommandError` instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        found = re.match(r"argument (\w+): invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if found:
            import difflib

            known = re.findall(r"[\w-]+", found[3])
            close = difflib.get_close_matches(found[2], known, n=1, cutoff=0.5)
            hint = f"; did you mean '{close[0]}'?" if close else f": take one of {', '.join(known)}"
            message = f"there is no {found[1].lower()} '{found[2]}'{hint}"
        raise CommandError(f"{message}\n{self.format_usage().strip()}")


def whole(least: int, what: str) -> Callable[[str], int]:
    """Return a reader of whole numbers of at least ``least``."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if number < least:
            raise argparse.ArgumentTypeError(f"'{text}' is no {what}: give a whole number, {least} or more")
        return number

    return read


def number(above: bool, what: str) -> Callable[[str], float]:
    """Return a reader of numbers above zero (``above``) or of zero and more."""

    def read(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not (0.0 < number < float("inf") or (number == 0.0 and not above)):
            least = "above zero" if above else "zero or more"
            raise argparse.ArgumentTypeError(f"'{text}' is no {what}: give a number {least}")
        return number

    return read


def common(parser: argparse.ArgumentParser, out: bool = True) -> None:
    """Add ``--out``, ``--quiet`` and ``--debug``."""
    parser.add_argument(
        "--out", metavar="DIR", required=out, help="folder to write into; made if it is not there"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")


def _study(commands: Any, name: str, help_text: str, description: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=help_text, description=description)
    parser.add_argument("study", metavar="STUDY.toml", help="the study file")
    parser.add_argument(
        "--seed", metavar="N", type=whole(0, "seed"), help="of all random numbers; default: the study's"
    )
    parser.set_defaults(run="study", command=name)
    return parser


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = Parser(
        prog="vtsdt",
        description=(
            "Lay a physics model of a machine beside its recordings and learn which effect is missing."),
    )
    top.add_argument("--version", action="store_true", help="print the version and exit")
    top.add_argument(
        "--debug", action="store_true", default=argparse.SUPPRESS, help="show the traceback of an error"
    )
    commands = top.add_subparsers(dest="words", metavar="COMMAND", title="commands")

    diagnose = _study(
        commands,
        "diagnose",
        "find the missing effects, add them, and write a report",
        "Compare a model with recordings, find the effects it lacks, add them one by one, and write "
        "diagnosis.json, report.html, figures and model.json.",
    )
    diagnose.add_argument(
        "--max-effects",
        metavar="N",
        type=whole(0, "number of effects"),
        help="effects added at most; default: the study's",
    )
    diagnose.add_argument(
        "--resume",
        action="store_true",
        help="go on from history.json in DIR: after an interruption, or to build another's stages again",
    )
    common(diagnose)
    common(
        _study(
            commands,
            "compare",
            "compare model and recordings, and say where they part",
            "Compare a model with recordings and say where the model fails; nothing is added to it.",
        )
    )

    bench = commands.add_parser(
        "bench",
        help="write recordings of a virtual machine, with effects hidden in it",
        description="Write recordings of a virtual machine as a rig would, with a study file beside them.",
    )
    machines = bench.add_subparsers(dest="machine", metavar="MACHINE", title="machines", required=True)
    _axis(machines)
    for words, each in ELSEWHERE.items():
        group = {"bench": machines}.get(words[0], commands) if len(words) > 1 else commands
        if words[0] != "validate":
            group.add_parser(words[-1], help=each.help)
    validate = commands.add_parser(
        "validate",
        help="make published results and error rates again",
        description="Make results again by a command.",
    )
    suites = validate.add_subparsers(dest="suite", metavar="SUITE", title="suites", required=True)
    for words, each in ELSEWHERE.items():
        if words[0] == "validate":
            suites.add_parser(words[-1], help=each.help)
    return top


def _axis(machines: Any) -> None:
    axis = machines.add_parser(
        "axis",
        help="recordings of a virtual linear axis",
        description="Write recordings of a virtual linear axis. Without --hide nothing is hidden.",
    )
    axis.add_argument(
        "--hide",
        metavar="KIND[@WHERE]",
        action="extend",
        nargs="+",
        default=[],
        help="effect to hide; give several, or repeat the option",
    )
    axis.add_argument(
        "--list", action="store_true", help="print what can be hidden, where, and its usual size"
    )
    axis.add_argument(
        "--seed", metavar="N", type=whole(0, "seed"), default=0, help="of all random numbers (default 0)"
    )
    axis.add_argument(
        "--trips", metavar="N", type=whole(2, "number of trips"), default=8, help="recordings (default 8)"
    )
    axis.add_argument(
        "--strength",
        metavar="FACTOR",
        type=number(True, "factor"),
        default=1.0,
        help="factor on the usual size of what is hidden (default 1)",
    )
    axis.add_argument(
        "--disturbance",
        metavar="N",
        type=number(False, "force"),
        default=3.0,
        help="root mean square of the force that disturbs the carriage, N (default 3)",
    )
    axis.add_argument(
        "--dry-friction", action="store_true", help="the guide has dry friction, which the model knows"
    )
    axis.add_argument(
        "--trip",
        metavar="PLAN",
        default="",
        help="other trips of the same machine, as diagnose proposes them: speed=0.5,amplitude=1.5,mirror,stops=3,"
        "load=1.5,sensor=OUTPUT, any of these",
    )
    axis.add_argument(
        "--unknown-over",
        metavar="WHAT",
        default="position",
        help="what unknown_force depends on: position, speed or time (default position)",
    )
    common(axis, out=False)
    axis.set_defaults(run="axis")
