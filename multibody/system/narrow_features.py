"""Narrow features that pass by, such as rail joints or gear teeth, and steps that do not jump over them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from multibody.system.compiled import CompiledSystem
from multibody.system.trajectory import Trajectory

__all__ = ["StepLimits", "finer_step", "narrow_features", "step_limits"]


@dataclass(frozen=True)
class Feature:
    """Something narrow, and the signal at whose speed it passes by.

    Parameters
    ----------
    width : float or str
        In the unit of the speed times s, or the name of the output whose value is the width.
    speed : str
        State or output of the machine, or ``"time"``.
    """

    width: float | str
    speed: str


@dataclass(frozen=True)
class StepLimits:
    """How narrow features limit the steps of a solver.

    Parameters
    ----------
    widths : dict of str to float
        Least width by speed, in ``system.speed_names``: the compiled methods evaluate these speeds in every step.
    largest_step : float, s
        Half the shortest duration.
    of_signals : tuple of Feature
        Features whose width is a signal: only a finished run shows whether one was jumped over.
    """

    widths: dict[str, float] = field(default_factory=dict)
    largest_step: float = np.inf
    of_signals: tuple[Feature, ...] = ()


def step_limits(system: CompiledSystem, p: np.ndarray) -> StepLimits:
    """Return the limits that the features of a system set to its steps, at parameters p, shape (n_p,)."""
    widths: dict[str, float] = {}
    largest_step, of_signals = np.inf, []
    for feature in narrow_features(system, p):
        if isinstance(feature.width, str):
            of_signals.append(feature)
        elif feature.speed == "time":
            largest_step = min(largest_step, 0.5 * feature.width)
        else:
            widths[feature.speed] = min(feature.width, widths.get(feature.speed, np.inf))
    return StepLimits(widths, largest_step, tuple(of_signals))


def narrow_features(system: CompiledSystem, p: np.ndarray) -> list[Feature]:
    """Return the features that can pass by, at parameters p, shape (n_p,): those with a width and a speed."""
    declared: list[Feature] = []
    width: float | str
    for owner, component in system.model.components.items():
        for width_name, speed_name in component.features.items():
            if width_name in component.tables:
                width = _least_distance(component.tables[width_name][0])
            elif width_name in component.values:
                width = float(p[system.index("parameter", f"{owner}.{width_name}")])
            else:
                width = f"{owner}.{width_name}"
            declared.append(Feature(width, "time" if speed_name == "time" else f"{owner}.{speed_name}"))
    for given, signal in system.model.features.values():
        width = given
        if isinstance(given, str):
            owner, _, table = given.partition(".")
            holder = system.model.components.get(owner)
            if holder is None or table not in holder.tables:
                continue
            width = _least_distance(holder.tables[table][0])
        declared.append(Feature(width, signal))
    speeds = {"time", *system.speed_names}
    return [f for f in declared if f.speed in speeds and (isinstance(f.width, str) or 0.0 < f.width < np.inf)]


def finer_step(run: Trajectory, features: Iterable[Feature], limit: float) -> float | None:
    """Return a smaller largest step where a step of a run could have jumped over a feature, else None."""
    finest = limit
    for feature in features:
        width = np.min(np.abs(run[feature.width])) if isinstance(feature.width, str) else feature.width
        speed = 1.0 if feature.speed == "time" else np.max(np.abs(run[feature.speed]), initial=0.0)
        if speed > 0.0 and width > 0.0:
            finest = min(finest, 0.5 * float(width) / float(speed))
    if float(run.statistics.get("longest_step", np.inf)) <= finest:
        return None
    return finest if finest < 0.8 * limit else None  # the same speed, sampled anew, is no reason to run again


def _least_distance(points: Any) -> float:
    """Return the least distance of a table's points; two points nearer than a millionth of its length are one."""
    x = np.asarray(points, dtype=float)
    apart = np.diff(x)
    return float(np.min(apart[apart > 1e-6 * (x[-1] - x[0])], initial=np.inf))
