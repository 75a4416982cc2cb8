"""Text from files on its way to a terminal: what would move the cursor or change colours is shown, not sent."""

from __future__ import annotations

import re

__all__ = ["printable"]

#: Control characters but line feed and tab, and the marks that reverse the direction of writing.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """Return a text whose control characters are written out.

    Examples
    --------
    >>> print(printable("speed" + chr(27) + "[2J"))
    speed\\x1b[2J
    """
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
