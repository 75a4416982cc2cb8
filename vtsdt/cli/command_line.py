"""The command line: one leaf that calls each package's own subcommand when it is asked for it.

Starting it imports nothing heavy; each command imports what it needs.  Exit codes: 0 success, 1 a fault in
the program, 2 bad input (one message, no traceback; ``--debug`` shows it), 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from vtsdt.cli.arguments import ELSEWHERE, CommandError, parser

__all__ = ["BAD_INPUT", "main"]

#: Exceptions that mean bad input.  A class whose module was never imported cannot have been raised.
BAD_INPUT = {
    "discrepancy.problem.study_file": "StudyError",
    "discrepancy.rigs.recording": "BenchError",
    "estimation.files.checks": "RecordError",
    "estimation.signals.preparation": "SignalError",
    "multibody.base.errors": "ModelError SimulationError EquationError",
    "multibody.base.parameter_file": "ParameterError",
    "multibody.base.units": "UnitError",
    "multibody.inputs.table": "InputError",
    "vtsdt.cli.arguments": "CommandError",
    "vtsdt.lift.comfort": "ComfortError",
    "vtsdt.alignment.trips": "AlignmentError",
    "estimation.filters.errors": "FilterError FilterDivergence",
}


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
    from multibody.base.progress import ProgressLine

    _check_out(args.out)
    if not hasattr(args, "max_effects"):
        args.max_effects = None
    function = _function(f"discrepancy.study.command:{args.command}", f"vtsdt {args.command}")
    with ProgressLine(args.quiet) as args.progress:
        return function(args) or 0


def _run_axis(args: argparse.Namespace) -> int:
    from multibody.base.progress import ProgressLine

    if not args.list and args.out is None:
        raise CommandError("--out DIR is missing: name a folder for the recordings, or ask for --list")
    if args.out is not None:
        _check_out(args.out)
    with ProgressLine(args.quiet) as progress:
        progress("prepare the model of the axis")
        from discrepancy.questions.trip_plan import TripPlan
        from discrepancy.rigs.axis import list_axis, make_axis

        try:
            plan = TripPlan.parse(args.trip)
        except ValueError as error:
            raise CommandError(f"--trip {args.trip}: {error}") from error
        if args.list:
            rows = list_axis(strength=args.strength, dry=args.dry_friction)
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
    if args.list:
        from discrepancy.rigs.texts import list_table

        print(list_table(rows))
    elif not args.quiet:
        print(f"{args.trips} synthetic recordings of a virtual axis are in {study.parent}")
        print(f"next: vtsdt diagnose {study} --out {study.parent / 'diagnosis'}")
    return 0


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
    top = parser()
    args = top.parse_args(argv)
    if args.version:
        from vtsdt import __version__

        print(f"vtsdt {__version__}")
        return 0
    if args.words is None:
        top.print_help()
        return 2
    return {"study": _run_study, "axis": _run_axis}[args.run](args)


def _is_bad_input(error: BaseException) -> bool:
    classes: list[type] = [OSError]
    for module, names in BAD_INPUT.items():
        loaded = sys.modules.get(module)
        classes += [getattr(loaded, n) for n in names.split() if loaded is not None and hasattr(loaded, n)]
    return isinstance(error, tuple(classes))


def _told(error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror or error}: check the path and its permissions"
    return str(error)


def _one_thread_for_linear_algebra() -> None:
    """Keep the processors for our own threads and processes, before numpy is imported; what the user set stands.

    The matrices here are tall and narrow: a second thread of the linear-algebra library mostly waits, and it waits
    by turning: on the EMPS diagnosis it raised the processor time from 66 to 94 s and shortened nothing.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


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
    _one_thread_for_linear_algebra()
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
                "run the same command with --debug and report what it prints",
                file=sys.stderr,
            )
        return 2 if expected else 1


if __name__ == "__main__":
    sys.exit(main())
