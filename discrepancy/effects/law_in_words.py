"""The law of a kind of effect in words, from the class that holds it."""

from __future__ import annotations

import inspect

from discrepancy.effects.effect import law_class
from discrepancy.effects.kinds import Kind
from multibody.declare.signature import written_docstring

__all__ = ["law_of"]

SENSOR_LAWS = {
    "offset": "reading = true value + offset",
    "gain": "reading = (1 + gain)·true value",
    "delay": "reading = true value at t − delay",
    "drift": "reading = true value + drift·t",
    "lag": "lag · rate of reading = true value − reading",
}
INPUT_LAWS = {
    "offset": "input = recorded + offset",
    "gain": "input = (1 + gain)·recorded",
    "delay": "input = recorded at t − delay",
    "lag": "output = input − lag/filter·(input − z), filter · rate of z = input − z; lag = filter is a low-pass of "
    "first order, lag = 2·filter nearly a delay",
}


def law_of(kind: Kind) -> str:
    """Return the law of a kind in words, from the class that holds it."""
    if kind.at == "sensor":
        return SENSOR_LAWS[kind.law]
    if kind.at in ("input", "signal"):
        return INPUT_LAWS[kind.law]
    holder = kind.component_class if kind.at == "parameter" else law_class(kind, "translation")
    if kind.at == "parameter":
        names = [f"{s}{ending}" for s in kind.strengths for ending in (e for _, e in kind.sides or (("", ""),))]
        return "; ".join(f"`{n}`, {getattr(holder.declarations[n], 'meaning', n)}" for n in names)
    base = next(c for c in holder.__mro__ if vars(c).get("__doc__"))
    first = inspect.cleandoc(written_docstring(base)).split("\n\n")
    shown = first[0] if "F = " in first[0] or len(first) < 2 else " ".join(p for p in first if "F = " in p) or first[0]
    return " ".join(shown.split())
