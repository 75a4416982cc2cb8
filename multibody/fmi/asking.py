"""What equations with a foreign unit in them call: generated texts import it, here and in the unit's own process.

In the unit's process the question is compiled and calls the unit; anywhere else it goes to that process.

``ask(key, wanted, given, values)`` writes into ``values`` rates and outputs, and where slopes are wanted their
derivatives along a direction, of what is ``wanted`` (`multibody.fmi.answering`).  ``given`` is time, states, inputs and
parameters, which the direction follows (in states, inputs and parameters); all in SI.
"""

from __future__ import annotations

from collections.abc import Callable

from multibody.compile.hosts import Host
from multibody.fmi import foreign
from multibody.fmi.answering import running
from multibody.fmi.foreign import key_of

__all__ = ["ask", "host_of", "key_of"]

_unit = running()

ask: Callable[..., None] = foreign.ask if _unit is None else _unit.ask


def host_of(path: str, digest: str) -> Host | None:
    """Return the process of a unit, None inside it; it starts when it is needed."""
    return foreign.host_of(path, digest) if _unit is None else None
