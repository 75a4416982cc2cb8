"""The command line: one leaf that calls each package's own subcommand when it is asked for it.

Starting it imports nothing heavy; each command imports what it needs.  Exit codes: 0 success, 1 a fault in the
program, 2 bad input (one message, no traceback; ``--debug`` shows it), 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from vtsdt.progress import Progress

__all__ = ["CommandError", "main"]


class CommandError(ValueError):
    """A command cannot do what it was asked for; the message says why and what to do."""


@dataclass(frozen=True)
class Elsewhere:
    """A command whose own module parses its arguments."""

    target: str
    help: str


#: Commands by their words; each ``main(arguments)`` takes the words that follow.
ELSEWHERE = {
    ("bench", "lift"): Elsewhere("vtsdt.bench:main", "recordings of a virtual lift"),
    ("bench", "gear"): Elsewhere("gearbox.rig:main", "recordings of a virtual gear stage"),
    ("align",): Elsewhere("vtsdt.alignment:main", "guide rail alignment from cabin vibration"),
    ("what-if",): Elsewhere("vtsdt.whatif:main", "what a change of the lift does to comfort and loads"),
    ("update-gearbox",): Elsewhere("gearbox.updating:main", "update a gear stage model from recordings"),
    ("validate", "papers"): Elsewhere("vtsdt.papers:main", "the papers' tables, made again and compared"),
    ("validate", "discrepancy"): Elsewhere("discrepancy.suite:main", "error rates of finding missing effects"),
}

#: Exceptions that mean bad input.  A class whose module was never imported cannot have been raised.
BAD_INPUT = {
    "discrepancy.study_file": "StudyError",
    "discrepancy.bench": "BenchError",
    "estimation.checks": "RecordError",
    "estimation.signals": "SignalError",
    "multibody.errors": "ModelError SimulationError EquationError",
    "multibody.units": "UnitError",
    "multibody.inputs": "InputError",
    "vtsdt.cli": "CommandError",
}


# -------------------------------------------------------------------- arguments


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        found = re.match(r"argument (\w+): invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if found:
            import difflib

            known = re.findall(r"[\w-]+", found[3])
            close = difflib.get_close_matches(found[2], known, n=1, cutoff=0.5)
            hint = f"; did you mean '{close[0]}'?" if close else f": take one of {', '.join(known)}"
            message = f"there is no {found[1].lower()} '{found[2]}'{hint}"
        raise CommandError(f"{message}\n{self.format_usage().strip()}")


def _whole(least: int, what: str) -> Callable[[str], int]:
    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if number < least:
            raise argparse.ArgumentTypeError(f"'{text}' is no {what}: give a whole number, {least} or more")
        return number

    return read


def _number(above: bool, what: str) -> Callable[[str], float]:
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


def _common(parser: argparse.ArgumentParser, out: bool = True) -> None:
    parser.add_argument("--out", metavar="DIR", required=out, help="folder to write into; made if it is not there")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")


def _study(commands: Any, name: str, help_text: str, description: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=help_text, description=description)
    parser.add_argument("study", metavar="STUDY.toml", help="the study file")
    parser.add_argument("--seed", metavar="N", type=_whole(0, "seed"), help="of all random numbers; default: the study's")
    parser.set_defaults(run=_run_study, command=name)
    return parser


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="vtsdt", description="Lay a physics model of a machine beside its recordings and learn which effect is missing.")
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    parser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show the traceback of an error")
    commands = parser.add_subparsers(dest="words", metavar="COMMAND", title="commands")

    diagnose = _study(
        commands, "diagnose", "find the missing effects, add them, and write a report",
        "Compare a model with recordings, find the effects it lacks, add them one by one, and write diagnosis.json, "
        "report.html, figures and model.json.")
    diagnose.add_argument(
        "--max-effects", metavar="N", type=_whole(0, "number of effects"), help="effects added at most; default: the study's")
    _common(diagnose)
    _common(_study(
        commands, "compare", "compare model and recordings, and say where they part",
        "Compare a model with recordings and say where the model fails; nothing is added to it."))

    bench = commands.add_parser(
        "bench", help="write recordings of a virtual machine, with effects hidden in it",
        description="Write recordings of a virtual machine as a test rig would, with a study file beside them.")
    machines = bench.add_subparsers(dest="machine", metavar="MACHINE", title="machines", required=True)
    _axis(machines)
    for words, each in ELSEWHERE.items():
        group = {"bench": machines}.get(words[0], commands) if len(words) > 1 else commands
        if words[0] != "validate":
            group.add_parser(words[-1], help=each.help)
    validate = commands.add_parser(
        "validate", help="make published results and error rates again", description="Make results again by a command.")
    suites = validate.add_subparsers(dest="suite", metavar="SUITE", title="suites", required=True)
    for words, each in ELSEWHERE.items():
        if words[0] == "validate":
            suites.add_parser(words[-1], help=each.help)
    return parser


def _axis(machines: Any) -> None:
    axis = machines.add_parser(
        "axis", help="recordings of a virtual linear axis",
        description="Write recordings of a virtual linear axis. Without --hide nothing is hidden.")
    axis.add_argument(
        "--hide", metavar="KIND[@WHERE]", action="extend", nargs="+", default=[],
        help="effect to hide; give several, or repeat the option")
    axis.add_argument("--list", action="store_true", help="print what can be hidden, where, and its usual size")
    axis.add_argument("--seed", metavar="N", type=_whole(0, "seed"), default=0, help="of all random numbers (default 0)")
    axis.add_argument("--trips", metavar="N", type=_whole(2, "number of trips"), default=8, help="recordings (default 8)")
    axis.add_argument(
        "--strength", metavar="FACTOR", type=_number(True, "factor"), default=1.0,
        help="factor on the usual size of what is hidden (default 1)")
    axis.add_argument(
        "--disturbance", metavar="N", type=_number(False, "force"), default=3.0,
        help="root mean square of the force that disturbs the carriage, N (default 3)")
    axis.add_argument("--dry-friction", action="store_true", help="the guide has dry friction, which the model knows")
    axis.add_argument(
        "--unknown-over", metavar="WHAT", default="position",
        help="what unknown_force depends on: position, speed or time (default position)")
    _common(axis, out=False)
    axis.set_defaults(run=_run_axis)


# -------------------------------------------------------------------- commands


def _check_out(out: str) -> None:
    """Refuse a folder that cannot be one before work begins, not after."""
    path = Path(out)
    if path.exists() and not path.is_dir():
        raise CommandError(f"--out {out}: is a file: name a folder to write into")
    parent = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise CommandError(f"--out {out}: nothing can be written into {parent}: name another folder")


def _run_study(args: argparse.Namespace) -> int:
    _check_out(args.out)
    if not hasattr(args, "max_effects"):
        args.max_effects = None
    function = _function(f"discrepancy.command:{args.command}", f"vtsdt {args.command}")
    with Progress(args.quiet) as args.progress:
        return function(args) or 0


def _run_axis(args: argparse.Namespace) -> int:
    if not args.list and args.out is None:
        raise CommandError("--out DIR is missing: name a folder for the recordings, or ask for --list")
    if args.out is not None:
        _check_out(args.out)
    with Progress(args.quiet) as progress:
        progress("prepare the model of the axis")
        from discrepancy.axis import list_axis, make_axis

        if args.list:
            rows = list_axis(strength=args.strength, dry=args.dry_friction)
        else:
            study = make_axis(
                args.out, args.hide, args.seed, args.trips, args.strength, args.disturbance, dry=args.dry_friction,
                over=args.unknown_over, progress=progress)
    if args.list:
        _print_list(rows)
    elif not args.quiet:
        print(f"{args.trips} synthetic recordings of a virtual axis are in {study.parent}")
        print(f"next: vtsdt diagnose {study} --out {study.parent / 'diagnosis'}")
    return 0


def _print_list(rows: Sequence[dict[str, Any]]) -> None:
    from discrepancy.hidden import strengths_of

    table = [("KIND", "WHERE", "USUAL SIZE")]
    for row in rows:
        sizes = strengths_of(row)
        told = ", ".join(f"{n} {abs(v['value']):.3g} {v['unit']}".rstrip() for n, v in sizes.items())
        table.append((row["kind"], row["where"], told))
    wide = [max(len(r[k]) for r in table) for k in (0, 1)]
    for kind, where, told in table:
        print(f"{kind:<{wide[0]}}  {where:<{wide[1]}}  {told}")


def _function(target: str, command: str) -> Callable[..., int | None]:
    """Return the function that a command calls, or say plainly that it is not there."""
    module, _, name = target.partition(":")
    if importlib.util.find_spec(module) is None:
        raise CommandError(f"{command} is not there yet: this version has no module '{module}'")
    found = getattr(importlib.import_module(module), name, None)
    if found is None:
        raise CommandError(f"{command} is not there yet: module '{module}' has no '{name}'")
    return found  # type: ignore[no-any-return]


def _run_elsewhere(words: tuple[str, ...], rest: list[str]) -> int:
    each, command = ELSEWHERE[words], " ".join(("vtsdt", *words))
    try:
        function = _function(each.target, command)
    except CommandError as error:
        if rest not in (["--help"], ["-h"]):
            raise
        print(f"usage: {command} … --out DIR\n\n{each.help}\n\n{error}")
        return 0
    return function(rest) or 0


# -------------------------------------------------------------------- main


def _dispatch(argv: list[str]) -> int:
    for words in ELSEWHERE:
        if tuple(argv[: len(words)]) == words:
            return _run_elsewhere(words, argv[len(words) :])
    parser = _parser()
    args = parser.parse_args(argv)
    if args.version:
        from vtsdt import __version__

        print(f"vtsdt {__version__}")
        return 0
    if args.words is None:
        parser.print_help()
        return 2
    return int(args.run(args))


def _is_bad_input(error: BaseException) -> bool:
    classes: list[type] = [OSError]
    for module, names in BAD_INPUT.items():
        loaded = sys.modules.get(module)
        classes += [getattr(loaded, n) for n in names.split() if loaded is not None and hasattr(loaded, n)]
    # Run as ``python -m vtsdt.cli`` this module has another name, and its classes are not those above.
    return isinstance(error, (*classes, CommandError))


def _told(error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror or error}: check the path and its permissions"
    return str(error)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Parameters
    ----------
    argv : sequence of str, optional
        Words after ``vtsdt``; default: those of the process.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in words
    words = [w for w in words if w != "--debug"]
    try:
        code = _dispatch(words)
        sys.stdout.flush()
        return code
    except SystemExit as ended:  # argparse ends --help this way
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except KeyboardInterrupt:
        print("vtsdt: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output has gone, as in `vtsdt … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        expected = _is_bad_input(error)
        if debug:
            import traceback

            traceback.print_exc()
        elif expected:
            print(f"vtsdt: {_told(error)}", file=sys.stderr)
        else:
            print(
                f"vtsdt: a fault in the program: {type(error).__name__}: {error}\n"
                "run the same command with --debug and report what it prints", file=sys.stderr)
        return 2 if expected else 1


if __name__ == "__main__":
    sys.exit(main())
