"""A page that shows a finished result: sentences, figures, tables, and sliders that change what is shown.

What is shown is a dict with the entries

``name``, ``sentences``
    Of the result.
``sliders``
    Each ``name``, ``label``, ``unit``, ``low``, ``high``, ``value``.
``figures``
    Each ``title``, ``labels`` (of the two axes), ``lines`` (``name``, ``style``, ``x``, ``y``), and optionally
    ``bands`` (stretches of the abscissa), ``marks`` (``at``, ``name``: vertical lines) and ``logarithmic``.
``tables``
    Each ``title``, ``heads`` (text, and whether it is a number) and ``rows`` of text.

Styles of lines are ``"measured"``, ``"before"``, ``"after"``, ``"each"`` (one of many) and ``"limit"``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from discrepancy.workbench.server import served

if TYPE_CHECKING:
    from starlette.applications import Starlette

__all__ = ["result_application"]


def result_application(
    view: Callable[[Mapping[str, float]], dict[str, Any]], token: str, hosts: list[str] | None = None
) -> Starlette:
    """Return the application of a result.

    Parameters
    ----------
    view : callable
        From the positions of the sliders to what is shown.
    token : str
        Has to stand in the address of every request.
    hosts : list of str, optional
        Host names that may stand in a request; default: those of this computer.
    """

    def shown(given: Any) -> dict[str, Any]:
        return view({str(k): float(v) for k, v in given.items()})

    return served("result.html", {}, {"result": shown}, token, hosts)
