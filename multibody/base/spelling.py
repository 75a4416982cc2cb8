"""Suggestions for misspelt names, as error messages give them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["nearest", "nearest_or_choices"]


def nearest(word: str, known: Iterable[object]) -> str:
    """Return a hint ``; did you mean 'x'?`` for a misspelt name, or an empty text.

    Examples
    --------
    >>> nearest("stifness", ["stiffness", "damping"])
    "; did you mean 'stiffness'?"
    """
    close = difflib.get_close_matches(word, [str(k) for k in known], n=1, cutoff=0.55)
    return f"; did you mean '{close[0]}'?" if close else ""


def nearest_or_choices(word: str, choices: Iterable[str], lead: str = "; nearest: ") -> str:
    """Return a hint with the nearest names, or with the choices themselves where none is near.

    Unlike `nearest` it ignores case, takes a part of a name for near and never returns an empty text.

    Examples
    --------
    >>> nearest_or_choices("tme_s", ["time_s", "force_N"])
    "; nearest: 'time_s'"
    >>> nearest_or_choices("u", ["time_s", "force_N"])
    "; there are 'time_s', 'force_N'"
    """
    names = list(dict.fromkeys(choices))
    lowered = {name.lower(): name for name in reversed(names)}
    near = [lowered[name] for name in difflib.get_close_matches(word.lower(), list(lowered), n=2, cutoff=0.6)]
    if not near:
        near = [name for name in names if len(word) > 2 and (word.lower() in name.lower())][:3]
    if near:
        return lead + ", ".join(f"'{name}'" for name in near)
    if not names:
        return "; there is none"
    shown = ", ".join(f"'{name}'" for name in names[:8]) + (", …" if len(names) > 8 else "")
    return f"; there are {shown}"
