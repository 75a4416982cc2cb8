"""What the commands' parsers share: errors as exceptions, numbers with bounds, common options."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from multibody.base.spelling import nearest_or_choices

__all__ = [
    "CommandError",
    "Parser",
    "check_out",
    "common",
    "json_option",
    "memory_limit",
    "number",
    "print_json",
    "time_limit",
    "whole",
]

#: Less is a wrong unit: the records of the smallest study take more.
LEAST_GIGABYTES = 0.01


class CommandError(ValueError):
    """A command cannot be carried out; the message gives the reason and the remedy."""


class Parser(argparse.ArgumentParser):
    """A parser that raises `CommandError` instead of ending; it names the option nearest to a misspelt one."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse a misspelt option before argparse complains of what it would have given; then as argparse."""
        known = [name for name in self._option_string_actions if name.startswith("--")]
        for word in args or ():
            if word == "--":
                break
            name = word.partition("=")[0]
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                self.error(f"there is no option '{name}'{nearest_or_choices(name, known)}")
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Raise the message, with the nearest word where a word is unknown, and the usage."""
        choice = re.match(r"argument (\w+): invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if choice:
            import difflib

            known = re.findall(r"[\w-]+", choice[3])
            close = difflib.get_close_matches(choice[2], known, n=1, cutoff=0.5)
            hint = f"; did you mean '{close[0]}'?" if close else f": take one of {', '.join(known)}"
            message = f"there is no {choice[1].lower()} '{choice[2]}'{hint}"
        elif message.startswith("unrecognized arguments"):
            message += ": take out what is too much, or quote a name with blanks"
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
    """Return a reader of numbers above zero (``above``), or of zero and more."""

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
    """Add ``--out`` (required where ``out`` is true), ``--quiet`` and ``--debug``."""
    parser.add_argument("--out", metavar="DIR", required=out, help="folder to write into; made if it is not there")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    parser.add_argument(  # read by `time_limit`, before the command
        "--time-limit",
        metavar="S",
        default=argparse.SUPPRESS,
        help="end after so many seconds, with a report of what is known by then",
    )
    parser.add_argument(  # read by `memory_limit`, before the command
        "--memory",
        metavar="GB",
        default=argparse.SUPPRESS,
        help="memory that may be used; what does not fit goes into a file (default: half of what the machine has)",
    )


def time_limit(words: Sequence[str]) -> tuple[list[str], float | None]:
    """Return the words without ``--time-limit SECONDS``, which every command has, and the seconds.

    Raises
    ------
    CommandError
        If it is no number above zero.
    """
    return _limit(words, "--time-limit", "time limit", "of seconds, such as --time-limit 600")


def memory_limit(words: Sequence[str]) -> tuple[list[str], float | None]:
    """Return the words without ``--memory GB``, which every command has, and the gigabytes.

    Raises
    ------
    CommandError
        If it is no number above zero, or so little that nothing could be held.
    """
    kept, limit = _limit(words, "--memory", "amount of memory", "of gigabytes, such as --memory 4")
    if limit is not None and limit < LEAST_GIGABYTES:
        raise CommandError(
            f"--memory: {limit:g} GB must be at least {LEAST_GIGABYTES}: give gigabytes, such as --memory 4"
        )
    return kept, limit


def _limit(words: Sequence[str], option: str, what: str, remedy: str) -> tuple[list[str], float | None]:
    kept, limit = list(words), None
    for place, word in enumerate(words):
        if word == "--":
            break
        name, given, text = word.partition("=")
        if name != option:
            continue
        if not given:
            text = words[place + 1] if place + 1 < len(words) else ""
        kept[place : place + (1 if given else 2)] = []
        try:
            limit = number(True, what)(text)
        except argparse.ArgumentTypeError as error:
            raise CommandError(f"{option}: {error} {remedy}") from error
        break
    return kept, limit


def json_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--json`` to the parser of a command that writes a JSON file."""
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON, as in the file that is written, and nothing else"
    )


def print_json(path: Path) -> None:
    """Print a JSON file that a command has written."""
    sys.stdout.write(path.read_text(encoding="utf-8").rstrip() + "\n")


def check_out(out: str) -> None:
    """Refuse a folder that cannot be written, before work begins.

    Raises
    ------
    CommandError
        If it is a file, or nothing can be written there.
    """
    path = Path(out)
    if path.exists() and not path.is_dir():
        raise CommandError(f"--out {out}: is a file: name a folder to write into")
    parent = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise CommandError(f"--out {out}: nothing can be written into {parent}: name another folder")
