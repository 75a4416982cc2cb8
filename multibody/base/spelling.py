"""Suggestions for misspelt names, as error messages give them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["nearest"]


def nearest(word: str, known: Iterable[object]) -> str:
    """Return a hint ``; did you mean 'x'?`` for a misspelt name, or an empty text.

    Examples
    --------
    >>> nearest("stifness", ["stiffness", "damping"])
    "; did you mean 'stiffness'?"
    """
    close = difflib.get_close_matches(word, [str(k) for k in known], n=1, cutoff=0.55)
    return f"; did you mean '{close[0]}'?" if close else ""
