"""Effects that components have in them: how the outputs change with strengths that are parameters of the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.catalogue import Entry

if TYPE_CHECKING:
    from discrepancy.confrontation import Confrontation

__all__ = ["Plan", "built_in_columns"]

#: an entry of the catalogue, its shapes, its strengths
Plan = tuple[Entry, list[dict[str, float]], list[str]]


def built_in_columns(facts: Confrontation, index: int, plans: Sequence[Plan]) -> dict[tuple[str, int], np.ndarray]:
    """Return one record's derivatives by strengths that are parameters, by candidate and shape; (nt, n_y, strengths).

    The derivatives are exact at strength zero.  What shares a shape is integrated at once.
    """
    together: dict[tuple[tuple[str, float], ...], list[tuple[tuple[str, int], list[str]]]] = {}
    for entry, shapes, strengths in plans:
        owner, ending = entry.kind.owner_of(entry.where)
        for k, shape in enumerate(shapes):
            key = tuple((f"{owner}.{n}{ending}", float(v)) for n, v in shape.items())
            names = [f"{owner}.{n}{ending}" for n in strengths]
            together.setdefault(key, []).append(((entry.name, k), names))
    found = {}
    for shape_values, group in together.items():
        p = facts.p.copy()
        for name, value in shape_values:
            p[facts.slim.index("parameter", name)] = value
        names = [n for _, each in group for n in each]
        dy = (
            facts.experiments[index]
            .respond(facts.slim, p, facts.start(index), parameters=names, sensors=facts.sensors)
            .derivatives
        )
        first = 0
        for key_of, each in group:
            found[key_of] = dy[:, :, first : first + len(each)]
            first += len(each)
    return found
