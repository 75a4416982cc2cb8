"""``vtsdt``: runs a command and turns exceptions into messages and exit codes.

`vtsdt.cli.commands` lists the commands.  Starting imports nothing heavy; each command imports what it needs.  Exit
codes: 0 success, 1 a fault in the program, 2 bad input (one message, no traceback; ``--debug`` shows it), 124 the time
limit was reached, 130 interrupted, 143 ended by SIGTERM.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from multibody.base.memory_of_process import address_space_limit
from multibody.base.out_of_memory import memory_used_up
from multibody.base.stopping import Stopped, stoppable
from multibody.base.terminal_text import printable
from vtsdt.cli.arguments import CommandError, memory_limit, time_limit
from vtsdt.cli.commands import COMMANDS, Command, parser
from vtsdt.cli.completion import asked_for, complete
from vtsdt.cli.least_memory import LEAST_ADDRESS_SPACE, reserve_nothing

__all__ = ["BAD_INPUT", "main"]

#: Exceptions that mean bad input, by module.  A class whose module was never imported cannot have been raised.
BAD_INPUT = {
    "discrepancy.problem.study_file": "StudyError",
    "discrepancy.rigs.recording": "BenchError",
    "estimation.files.faults": "RecordError",
    "estimation.signals.preparation": "SignalError",
    "multibody.base.errors": "ModelError SimulationError EquationError",
    "multibody.base.memory": "MemoryLimitError",
    "multibody.fmi.errors": "FmuError",
    "multibody.base.parameter_file": "ParameterError",
    "multibody.base.units": "UnitError",
    "multibody.inputs.table": "InputError",
    "operation.store.store": "StoreError",
    "operation.sources.mqtt": "SourceError",
    "vtsdt.cli.arguments": "CommandError",
    "vtsdt.lift.comfort": "ComfortError",
    "vtsdt.alignment.trips": "AlignmentError",
    "estimation.filters.errors": "FilterError FilterDivergence",
}


#: Characters of a line and lines of a message that are printed; chosen: a screen or two.
LONGEST_LINE, MOST_LINES = 2000, 60
#: Said where there is no memory left to put a message together.
NO_MEMORY_LEFT = "vtsdt: the memory that this process may have is used up: give it more; earlier results are kept\n"


def _dispatch(words: list[str]) -> int:
    """Run the command whose words come first, or say what the words lack."""
    for name, command in COMMANDS.items():
        if tuple(words[: len(name)]) == name:
            return _run(command, " ".join(("vtsdt", *name)), words[len(name) :])
    top = parser()
    args = top.parse_args(words)
    if args.version:
        from vtsdt.cli.version import __version__

        print(f"vtsdt {__version__}")
        return 0
    top.print_help()
    return 2


def _run(command: Command, name: str, arguments: list[str]) -> int:
    try:
        function = command.function(name)
    except CommandError as error:
        if arguments not in (["--help"], ["-h"]):
            raise
        print(f"usage: {name} … --out DIR\n\n{command.help}\n\n{error}")
        return 0
    return function(arguments) or 0


def _is_named(error: BaseException) -> bool:
    """Tell whether an error is one of those whose message says what to do."""
    classes: list[type] = [OSError]
    for module, names in BAD_INPUT.items():
        loaded = sys.modules.get(module)
        classes += [getattr(loaded, n) for n in names.split() if loaded is not None and hasattr(loaded, n)]
    return isinstance(error, tuple(classes))


def _shortened(text: str) -> str:
    """Return a message without what nobody would read of it, such as a name of a million letters."""
    split = text.split("\n", MOST_LINES + 1)
    lines = [line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} …" for line in split]
    if len(lines) <= MOST_LINES:
        return "\n".join(lines)
    return "\n".join([*lines[:MOST_LINES], "  … and more: --debug shows everything"])


def _message(error: BaseException) -> str:
    if memory_used_up(error):
        limit = address_space_limit()
        given = (
            ""
            if limit is None
            else (
                f"; its address space is limited to {limit / 2**30:.3g} GiB (ulimit -v), "
                f"and the smallest diagnosis takes about {LEAST_ADDRESS_SPACE / 2**30:.3g} GiB"
            )
        )
        return (
            f"the memory that this process may have is used up{f' ({error})' if str(error) else ''}{given}: "
            "give it more, lower --memory so that more is kept in a file, or take fewer or shorter records "
            "([records] identify, decimate) and fewer effects ([candidates] include); earlier results are kept"
        )
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        place = error.filename or "the folder of the results or of compiled code (VTSDT_CACHE)"
        return f"{place}: the disk is full: free some space, or name a folder on another disk; earlier results are kept"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror or error}: check the path and its permissions"
    return str(error)


def _one_thread_for_linear_algebra() -> None:
    """Keep the processors for our own threads and processes; a setting of the user stays.  Before numpy is imported.

    The matrices here are tall and narrow: a second thread of the linear-algebra library spins while it waits.  On the
    EMPS diagnosis it raised the processor time from 66 to 94 s and shortened nothing.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


@contextmanager
def _memory(gigabytes: float | None) -> Iterator[None]:
    """Limit the memory of this process, and of those that it starts."""
    before = os.environ.get("VTSDT_MEMORY")
    if gigabytes is not None:
        os.environ["VTSDT_MEMORY"] = f"{gigabytes:g}"
    try:
        yield
    finally:
        if gigabytes is not None:
            os.environ.pop("VTSDT_MEMORY")
            if before is not None:
                os.environ["VTSDT_MEMORY"] = before


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
    reserve_nothing()
    try:
        words, seconds = time_limit(words)
        words, gigabytes = memory_limit(words)
        try:
            with stoppable(seconds), _memory(gigabytes):
                code = complete(_dispatch) if asked_for() else _dispatch(words)
        except SystemExit as ended:  # argparse ends --help this way
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        sys.stdout.flush()  # here, where a reader that has gone is no fault
        return code
    except KeyboardInterrupt as error:
        stopped = error if isinstance(error, Stopped) else Stopped("interrupted")
        remedy = ": there is no result yet; give it more time" if stopped.code == 124 else ""
        print(f"vtsdt: {stopped}{remedy}", file=sys.stderr)
        return stopped.code
    except BrokenPipeError:  # the reader of our output has gone, as in `vtsdt … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if not debug:
            error.__traceback__ = None  # frees what the command held: a lack of memory can then be reported
        try:
            return _explained(error, debug)
        except MemoryError:
            sys.stderr.write(NO_MEMORY_LEFT)
            return 2


def _explained(error: Exception, debug: bool) -> int:
    """Print what an error says, and return the exit code."""
    expected = _is_named(error) or memory_used_up(error)
    if debug:
        import traceback

        traceback.print_exception(error)
    elif expected:
        print(f"vtsdt: {printable(_shortened(_message(error)))}", file=sys.stderr)
    else:
        print(
            f"vtsdt: a fault in the program: {type(error).__name__}: {printable(_shortened(str(error)))}\n"
            "run the same command with --debug and report what it prints",
            file=sys.stderr,
        )
    return 2 if expected else 1


if __name__ == "__main__":
    sys.exit(main())
