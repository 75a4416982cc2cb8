"""Candidates whose law the machine has already, with a fitted strength, at their place or rigidly coupled to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from multibody.assembly.places import Place

__all__ = ["parameters_of_same_law"]

#: Share of its size by which a speed may differ from a multiple of another for the two to be coupled rigidly: far above
#: the rounding of a simulation, far below what an elastic part gives way.
RIGID = 1e-6


def parameters_of_same_law(linearised: LinearisedProblem, entries: Sequence[Entry]) -> dict[str, str]:
    """Return the entries whose law a fitted parameter stands for, by ``kind@where``, with that parameter.

    Two dry frictions between the same two parts are one dry friction; so are two between parts that move in a fixed
    proportion, such as motor and belt of a drive with a rigid gear.

    Parameters
    ----------
    linearised : LinearisedProblem
    entries : sequence of Entry
    """
    fitted = linearised.sensitivities().names
    coupled = _coupled_places(linearised)
    out = {}
    for entry in entries:
        if entry.place is None:
            continue
        places = coupled.get(entry.place.name, [entry.place])
        names = [f"{part}.{n}" for p in places for part in (p.name, *p.also) for n in entry.kind.same_law]
        if name := next((n for n in names if n in fitted), ""):
            out[entry.name] = name
    return out


def _coupled_places(linearised: LinearisedProblem) -> dict[str, list[Place]]:
    """Return for every connection those whose speed is a multiple of its own along all records, itself first."""
    places = linearised.system.places
    runs = [linearised.nominal_outputs(i) for i in range(len(linearised.experiments))]
    rates = [np.concatenate([run[f"place.{p.name}.{p.motion_names()[1][0]}"] for run in runs]) for p in places]
    out = {}
    for place, v in zip(places, rates, strict=True):
        others = [p for p, w in zip(places, rates, strict=True) if p is not place and _proportional(v, w)]
        out[place.name] = [place, *others]
    return out


def _proportional(one: np.ndarray, other: np.ndarray) -> bool:
    """Tell whether two signals that are not zero are multiples of each other."""
    size = float(one @ one)
    if not size > 0.0 or not other @ other > 0.0:
        return False
    left = other - (other @ one / size) * one
    return bool(np.linalg.norm(left) < RIGID * np.linalg.norm(other))
