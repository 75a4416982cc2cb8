"""The command line: `vtsdt.cli.commands` lists which command calls what; each file parses the words of one command.

Calls all packages; nothing imports it.
"""

from vtsdt.cli.command_line import main

__all__ = ["main"]
