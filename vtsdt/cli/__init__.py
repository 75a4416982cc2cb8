"""The command line: one leaf that calls each package's own subcommand when it is asked for it.

Nothing may import it.
"""

from vtsdt.cli.command_line import main

__all__ = ["main"]
