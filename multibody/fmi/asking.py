"""What equations with a foreign unit in them call: generated texts import it, here and in the unit's own process.

In the unit's process the question is compiled and calls the unit; anywhere else it goes to that process.

- ``room(n)``: where as many numbers can be written that are given to the unit: time, states, inputs and parameters,
  which a direction in the last three follows where derivatives are asked for; all in SI.
- ``ask(key, wanted, place, given)``: what stands for the answer; ``wanted`` as in `multibody.fmi.answering`, the place
  tells apart the questions of one text.
- ``shown(answer, place, k)``: its number k: rates, then outputs.
- ``slope_shown(answer, place, k, count)``: the derivative of number k of so many, where slopes are wanted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from multibody.compile.hosts import Host
from multibody.compile.settings import jit_enabled
from multibody.fmi import foreign
from multibody.fmi.answering import Answer, running
from multibody.fmi.foreign import key_of

__all__ = ["ask", "host_of", "key_of", "room", "shown", "slope_shown"]

_unit = running()


def host_of(path: str, digest: str) -> Host | None:
    """Return the process of a unit, None inside it; it starts when it is needed."""
    return foreign.host_of(path, digest) if _unit is None else None


room: Any = np.empty
ask: Any = foreign.ask if _unit is None else _unit.ask
shown: Any = Answer.shown
slope_shown: Any = Answer.slope_shown
if _unit is not None and jit_enabled():
    from multibody.fmi.inside import ask, room, shown, slope_shown
