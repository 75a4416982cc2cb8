"""The command ``vtsdt init``."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from discrepancy.problem.study_file import StudyError
from discrepancy.starters.kinds import KINDS
from discrepancy.starters.start import start_study
from multibody.base.terminal_text import printable

__all__ = ["default_folder", "init", "list_kinds"]


def init(args: Namespace) -> int:
    """Write a study from recordings, and print what was assumed.

    Parameters
    ----------
    args : namespace
        ``data``, ``machine``, ``fmu``, ``column``, ``time``, ``out``, ``quiet``, ``progress``.
    """
    columns: dict[str, str] = {}
    for text in args.column:
        name, given, column = text.partition("=")
        if not given:
            raise StudyError([f"--column {text}: write it as --column NAME=COLUMN, such as rotor.speed=channel_3"])
        columns[name.strip()] = column.strip()
    started = start_study(
        args.data,
        args.out,
        machine=args.machine,
        fmu=args.fmu,
        columns=columns,
        time=args.time,
        progress=args.progress,
    )
    if not args.quiet:
        print("assumed:")
        for text in started.assumed:
            print(f"  - {printable(text)}")
        print(f"study: {started.path}")
        out = started.path.parent
        print(f"next: vtsdt check {started.path}; vtsdt diagnose {started.path} --out {out / 'diagnosis'}")
    return 0


def list_kinds() -> int:
    """Print every kind of machine and what it is."""
    width = max(map(len, KINDS))
    for kind in KINDS.values():
        print(f"{kind.name:{width}}  {kind.what}")
    return 0


def default_folder(machine: str | None, fmu: str | None) -> str:
    """Return the folder that a study goes into where none is named."""
    return machine or Path(fmu or "study").stem
