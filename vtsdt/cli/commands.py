"""The commands: their words, what runs them, and one line of help each."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vtsdt.cli.arguments import CommandError, Parser

__all__ = ["COMMANDS", "Command", "parser"]


@dataclass(frozen=True)
class Command:
    """A command, and the function that parses its arguments and runs it.

    Parameters
    ----------
    target : str
        ``module:function``, imported when the command is called; the function takes the words after the command and
        returns an exit code.
    help : str
        One line.
    """

    target: str
    help: str

    def function(self, name: str) -> Callable[[Sequence[str]], int | None]:
        """Return the function.

        Parameters
        ----------
        name : str
            Of the command, as the user types it.

        Raises
        ------
        CommandError
            If this version does not have it.
        """
        module, _, attribute = self.target.partition(":")
        if importlib.util.find_spec(module) is None:
            raise CommandError(f"{name} is not available: this version has no module '{module}'")
        function = getattr(importlib.import_module(module), attribute, None)
        if function is None:
            raise CommandError(f"{name} is not available: module '{module}' has no '{attribute}'")
        return function  # type: ignore[no-any-return]


#: Every command by its words, in the order of the help.
COMMANDS = {
    ("init",): Command("vtsdt.cli.init:main", "write a study from recordings and a kind of machine"),
    ("diagnose",): Command("vtsdt.cli.study:diagnose", "find the missing effects, add them, and write a report"),
    ("compare",): Command("vtsdt.cli.study:compare", "compare model and recordings, and say where they differ"),
    ("check",): Command("vtsdt.cli.study:check", "whether a study's model and recordings fit each other, in seconds"),
    ("catalogue",): Command("vtsdt.cli.study:catalogue", "list the effects that a study's model could lack"),
    ("schema",): Command("vtsdt.cli.schema:main", "the JSON Schema of study files, for editors"),
    ("open",): Command("vtsdt.cli.open:main", "a study in the browser: pick an effect and watch the error fall"),
    ("follow",): Command("vtsdt.cli.follow:main", "judge new recordings of a machine as they come, and raise alarms"),
    ("history",): Command("vtsdt.cli.history:main", "what a followed machine's records have shown over months"),
    ("bench", "axis"): Command("vtsdt.cli.bench_axis:main", "recordings of a virtual linear axis"),
    ("bench", "lift"): Command("vtsdt.cli.bench_lift:main", "recordings of a virtual lift"),
    ("bench", "gear"): Command("gearbox.rig.command:main", "recordings of a virtual gear stage"),
    ("align",): Command("vtsdt.cli.align:main", "guide rail alignment from a few sensors of the cabin"),
    ("what-if",): Command("vtsdt.cli.what_if:main", "what straightening and lubricating the guides would save"),
    ("update-gearbox",): Command("gearbox.updating.command:main", "update a gear stage model from recordings"),
    ("export-fmu",): Command("vtsdt.cli.export_fmu:main", "a model as an FMU (FMI 2.0 or 3.0) for other tools"),
    ("warm",): Command("vtsdt.cli.warm:main", "compile the shipped models before they are needed"),
    ("completion",): Command("vtsdt.cli.completion:main", "completion of commands and options for bash, zsh and fish"),
    ("validate", "papers"): Command("vtsdt.cli.validate_papers:main", "the papers' tables, reproduced and compared"),
    ("validate", "discrepancy"): Command(
        "vtsdt.cli.validate_discrepancy:main", "error rates of finding missing effects"
    ),
    ("validate", "fleet"): Command("vtsdt.cli.validate_fleet:main", "a year of a simulated fleet against its truth"),
}


@dataclass(frozen=True)
class _Group:
    """Commands that share their first word."""

    help: str
    description: str
    member: str


#: First words of commands of two words.
GROUPS = {
    "bench": _Group(
        "write recordings of a virtual machine, with effects hidden in it",
        "Write recordings of a virtual machine as a rig would, with a study file.",
        "machine",
    ),
    "validate": _Group(
        "reproduce published results and error rates", "Reproduce published results and error rates.", "suite"
    ),
}


def parser() -> Parser:
    """Return the parser of the first words: help, version, and messages about words that are no command."""
    top = Parser(
        prog="vtsdt",
        description="Compare a physics model of a machine with its recordings and find the missing effect.",
    )
    top.add_argument("--version", action="store_true", help="print the version and exit")
    top.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = top.add_subparsers(dest="words", metavar="COMMAND", title="commands")
    groups = {}
    for words, command in COMMANDS.items():
        if len(words) == 1:
            commands.add_parser(words[0], help=command.help)
            continue
        if words[0] not in groups:
            group = GROUPS[words[0]]
            one = commands.add_parser(words[0], help=group.help, description=group.description)
            groups[words[0]] = one.add_subparsers(
                dest=group.member, metavar=group.member.upper(), title=f"{group.member}s", required=True
            )
        groups[words[0]].add_parser(words[1], help=command.help)
    return top
