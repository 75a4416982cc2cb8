"""Priors of uncertain parameters that a person has changed in a study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from discrepancy.problem.problem import Problem
from multibody.base.spelling import nearest

__all__ = ["Prior", "with_priors"]


@dataclass(frozen=True)
class Prior:
    """Another stated value of an uncertain parameter, or another standard deviation.

    Parameters
    ----------
    name : str
        Parameter by full name.
    value, std : float or None
        SI; None leaves it as the study file has it.
    """

    name: str
    value: float | None = None
    std: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return it for a JSON file."""
        return asdict(self)


def with_priors(problem: Problem, priors: Sequence[Prior]) -> Problem:
    """Return a problem with other priors; of several of one parameter the last counts.

    Raises
    ------
    KeyError
        If a parameter is none of those that are uncertain.
    ValueError
        If a value is outside the parameter's bounds, or a standard deviation is not positive.
    """
    uncertain = {q.name: q for q in problem.uncertain}
    for prior in priors:
        if prior.name not in uncertain:
            near = nearest(prior.name, list(uncertain))
            raise KeyError(f"'{prior.name}' is no uncertain parameter of this study{near}")
        q = uncertain[prior.name]
        value = q.value if prior.value is None else float(prior.value)
        std = q.std if prior.std is None else float(prior.std)
        if not (math.isfinite(value) and q.min <= value <= q.max):
            raise ValueError(f"{q.name}: the value {value:g} is outside {q.min:g} to {q.max:g}: give one inside")
        if not std > 0.0:
            raise ValueError(f"{q.name}: the standard deviation {std:g} is not positive: give a positive one")
        uncertain[q.name] = replace(q, value=value, std=std)
    return replace(problem, uncertain=tuple(uncertain.values()))
