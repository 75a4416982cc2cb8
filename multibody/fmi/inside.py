"""What equations call in the process of a unit, for compiled code: see `multibody.fmi.asking`.

The table of the unit stands at an address that is the same in every process where that is free, so that machine code
with the address in it can be kept.
"""

from __future__ import annotations

from typing import Any

from multibody.compile.calls import call_rhs, floats, inner, ints
from multibody.fmi.answering import ANSWERS, OUTS, QUESTION, ROOM, STATES, running

__all__ = ["ask", "room", "shown", "slope_shown"]

_unit = running()
TABLE = 0 if _unit is None else _unit.address


@inner
def room(count: int) -> Any:
    """Return where what is given is written."""
    table = ints(TABLE)
    return floats(table[ROOM])


@inner
def ask(key: int, wanted: int, place: int, given: Any) -> float:
    """Ask the unit; the answer stands at the place."""
    table = ints(TABLE)
    answer = floats(table[ANSWERS] + 16 * (table[STATES] + table[OUTS]) * place)
    call_rhs(table[QUESTION], float(wanted), given, given, given, answer)
    return 0.0


@inner
def shown(answer: float, place: int, k: int) -> float:
    """Return a value of an answer."""
    table = ints(TABLE)
    values = floats(table[ANSWERS] + 16 * (table[STATES] + table[OUTS]) * place)
    return values[k]  # type: ignore[no-any-return]


@inner
def slope_shown(answer: float, place: int, k: int, count: int) -> float:
    """Return the derivative of a value."""
    return shown(answer, place, count + k)
