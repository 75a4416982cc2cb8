"""``python -m vtsdt`` is the command ``vtsdt``."""

import sys

from vtsdt.cli.command_line import main

if __name__ == "__main__":
    sys.exit(main())
