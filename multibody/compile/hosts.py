"""Equations that ask a program in another process: work that evaluates them often is done there as a whole.

A question from here to there takes some hundred microseconds, an evaluation there less than one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Protocol

__all__ = ["ASKS", "Host", "hosts_in"]

#: The line by which a text of equations that asks another process is known.
ASKS = "from multibody.fmi.asking import ask, host_of, key_of, room, shown, slope_shown\n"


class Host(Protocol):
    """A process in which equations are compiled that ask a program there."""

    def do(self, work: Callable[..., Any], *given: Any, receive: Callable[..., None] | None = None) -> Any:
        """Return ``work(*given)``, done there.

        Parameters
        ----------
        work : callable
            A function of a module; its result is made of arrays, numbers and texts.
        given
            What can be pickled.
        receive : callable, optional
            Gets numbers and arrays that the work hands over before it ends: it is given one more argument for that.
        """
        ...


def hosts_in(names: dict[str, Any]) -> tuple[Host, ...]:
    """Return the hosts that the equations of a module ask, by the module's names."""
    hosts = {id(v): v for name, v in names.items() if name.endswith("_host") and v is not None}
    return tuple(hosts.values())


def constants_in(names: dict[str, Any]) -> tuple[str, ...]:
    """Return what machine code of a module's equations has in it beside their text: numbers of what they call."""
    called = {v.__module__ for v in names.values() if hasattr(v, "py_func")}
    modules = (sys.modules[name] for name in sorted(called))
    return tuple(f"{m.__name__} {k} {v}" for m in modules for k, v in vars(m).items() if k.isupper() and type(v) is int)
