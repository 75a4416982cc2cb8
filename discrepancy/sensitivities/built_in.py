"""Sensitivities to effects that components have built in: their strengths are parameters of the model.

A strength acts on the equations as a constant input, so the state-transition matrices along the trajectory propagate it
as they propagate a force.  Where they are not computed, its sensitivity is integrated.
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

__all__ = ["Plan", "integrated_sensitivities", "parameter_perturbations"]

#: An entry of the catalogue, its shapes, its strengths.
Plan = tuple[Entry, list[dict[str, float]], list[str]]

#: A candidate's name and the number of its shape; a perturbation of one of its strengths.
Keyed = tuple[tuple[str, int], ParameterPerturbation]


def parameter_perturbations(plans: Sequence[Plan], system: System) -> tuple[list[Keyed], list[Keyed]]:
    """Return the strengths that state-transition matrices propagate, and delays of inputs, which they cannot."""
    delays = {system.parameter_names[k] for k in system.input_delays.values()}
    propagated: list[Keyed] = []
    others: list[Keyed] = []
    for entry, shapes, strengths in plans:
        owner, ending = entry.kind.owner_of(entry.where)
        names = [f"{owner}.{n}{ending}" for n in strengths]
        for k, shape in enumerate(shapes):
            evaluated_at = tuple((f"{owner}.{n}{ending}", float(v)) for n, v in shape.items())
            (others if delays & set(names) else propagated).extend(
                ((entry.key, k), ParameterPerturbation(n, evaluated_at)) for n in names
            )
    return propagated, others


def integrated_sensitivities(
    linearised: LinearisedProblem, index: int, perturbations: Sequence[Keyed]
) -> list[tuple[tuple[str, int], np.ndarray]]:
    """Return one record's sensitivities (nt, n_y) to some strengths, in any order; those that share a shape together.

    They are exact at strength zero.
    """
    by_shape: dict[tuple[tuple[str, float], ...], list[Keyed]] = {}
    for keyed in perturbations:
        by_shape.setdefault(keyed[1].evaluated_at, []).append(keyed)
    sensitivities = []
    for evaluated_at, group in by_shape.items():
        p = linearised.p.copy()
        for name, value in evaluated_at:
            p[linearised.slim.index("parameter", name)] = value
        names = [change.parameter for _, change in group]
        dy = (
            linearised.experiments[index]
            .respond(linearised.slim, p, linearised.initial_state(index), parameters=names, sensors=linearised.sensors)
            .derivatives
        )
        sensitivities += [(key, dy[:, :, k]) for k, (key, _) in enumerate(group)]
    return sensitivities
