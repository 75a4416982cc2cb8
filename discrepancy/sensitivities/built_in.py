"""Effects that components have in them: how the outputs change with strengths that are parameters of the model.

A strength acts on the equations as an input that stays what it is, so the machine's transitions along its trajectory
carry it as they carry a force.  Where no transitions are worked out, its derivative is integrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.catalogue import Entry
from estimation.response.perturbations import ParameterPerturbation

if TYPE_CHECKING:
    from discrepancy.sensitivities.linearised_problem import LinearisedProblem
    from multibody.machine.model import System

__all__ = ["Plan", "Wanted", "changes_of", "integrated_sensitivities"]

#: an entry of the catalogue, its shapes, its strengths
Plan = tuple[Entry, list[dict[str, float]], list[str]]

#: a candidate's name and the number of its shape, beside one of its strengths
Wanted = tuple[tuple[str, int], ParameterPerturbation]


def changes_of(plans: Sequence[Plan], system: System) -> tuple[list[Wanted], list[Wanted]]:
    """Return the strengths that transitions can carry, and those of how late an input is, which they cannot."""
    late = {system.parameter_names[k] for k in system.input_delays.values()}
    carried: list[Wanted] = []
    others: list[Wanted] = []
    for entry, shapes, strengths in plans:
        owner, ending = entry.kind.owner_of(entry.where)
        names = [f"{owner}.{n}{ending}" for n in strengths]
        for k, shape in enumerate(shapes):
            evaluated_at = tuple((f"{owner}.{n}{ending}", float(v)) for n, v in shape.items())
            (others if late & set(names) else carried).extend(
                ((entry.name, k), ParameterPerturbation(n, evaluated_at)) for n in names
            )
    return carried, others


def integrated_sensitivities(
    linearised: LinearisedProblem, index: int, wanted: Sequence[Wanted]
) -> list[tuple[tuple[str, int], np.ndarray]]:
    """Return one record's derivatives (nt, n_y) by some strengths, in any order; what shares a shape at once.

    The derivatives are exact at strength zero.
    """
    together: dict[tuple[tuple[str, float], ...], list[Wanted]] = {}
    for each in wanted:
        together.setdefault(each[1].evaluated_at, []).append(each)
    found = []
    for evaluated_at, group in together.items():
        p = linearised.p.copy()
        for name, value in evaluated_at:
            p[linearised.slim.index("parameter", name)] = value
        names = [change.parameter for _, change in group]
        dy = (
            linearised.experiments[index]
            .respond(linearised.slim, p, linearised.initial_state(index), parameters=names, sensors=linearised.sensors)
            .derivatives
        )
        found += [(key, dy[:, :, k]) for k, (key, _) in enumerate(group)]
    return found
