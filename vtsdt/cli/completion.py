"""``vtsdt completion``: the script with which a shell completes commands, options and files; and what it calls."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from typing import Any

from vtsdt.cli.arguments import CommandError, Parser
from vtsdt.cli.commands import COMMANDS

__all__ = ["asked_for", "complete", "main"]

#: Where each shell reads the script from at its start.
SHELLS = {
    "bash": "vtsdt completion bash > ~/.local/share/bash-completion/completions/vtsdt",
    "zsh": "vtsdt completion zsh > ~/.zfunc/_vtsdt    # with ~/.zfunc in $fpath",
    "fish": "vtsdt completion fish > ~/.config/fish/completions/vtsdt.fish",
}


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt completion``."""
    parser = Parser(
        prog="vtsdt completion",
        description="Print the script with which a shell completes the commands, options and files of vtsdt.",
        epilog="To install it:\n" + "\n".join(f"  {line}" for line in SHELLS.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("shell", metavar="SHELL", choices=tuple(SHELLS), help=", ".join(SHELLS))
    args = parser.parse_args(list(arguments))
    print(_argcomplete().shellcode(["vtsdt"], shell=args.shell))
    return 0


def asked_for() -> bool:
    """Tell whether this process was started by a shell to complete a line."""
    return "_ARGCOMPLETE" in os.environ


def complete(dispatch: Callable[[list[str]], int]) -> int:
    """Answer the shell: the parser of the command that stands in the line completes it and ends the process.

    Parameters
    ----------
    dispatch : callable
        Runs the command whose words come first.
    """
    argcomplete = _argcomplete()
    _, _, _, words, _ = argcomplete.lexers.split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))
    words = words[1:]
    own = next((name for name in COMMANDS if tuple(words[: len(name)]) == name), ())
    # Which word of the line stands for the program: the last word of the command, if there is a command.
    os.environ["_ARGCOMPLETE"] = str(1 + len(own))

    def answer(parser: argparse.ArgumentParser, *args: Any, **options: Any) -> argparse.Namespace:
        argcomplete.autocomplete(parser)
        raise SystemExit(0)

    # Each command makes its parser when it is called: what it would parse is completed instead.
    argparse.ArgumentParser.parse_args = answer  # type: ignore[assignment, method-assign]
    return dispatch(list(own))


def _argcomplete() -> Any:
    try:
        import argcomplete
        import argcomplete.lexers
    except ImportError:
        raise CommandError("completion needs the package argcomplete: pip install argcomplete") from None
    return argcomplete
