"""What passes by while a machine moves, such as a rail's joints or a gear's teeth, and steps that do not miss it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.system.compiled import CompiledSystem
from multibody.system.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["Feature", "Passing", "features", "finer_step", "look_at"]


@dataclass(frozen=True)
class Feature:
    """Something narrow, and the signal at whose speed it passes by.

    Parameters
    ----------
    width : float or str
        In the unit of the speed times s, or the name of the output that tells it.
    speed : str
        State or output of the machine, or ``"time"``.
    """

    width: float | str
    speed: str


@dataclass(frozen=True)
class Passing:
    """What passes by, as the solvers look at it.

    Parameters
    ----------
    widths : dict of str to float
        Least width by speed, in ``system.speed_names``: the compiled methods look at these speeds in every step.
    largest_step : float, s
        Half the shortest duration.
    left : tuple of Feature
        Those whose width is a signal: only a finished run shows whether one was jumped over.
    """

    widths: dict[str, float] = field(default_factory=dict)
    largest_step: float = np.inf
    left: tuple[Feature, ...] = ()


def look_at(system: CompiledSystem, p: np.ndarray) -> Passing:
    """Return what passes by a system at parameters p, shape (n_p,)."""
    found = features(system, p)
    widths: dict[str, float] = {}
    for each in found:
        if each.speed != "time" and not isinstance(each.width, str):
            widths[each.speed] = min(each.width, widths.get(each.speed, np.inf))
    return Passing(widths, _step_over_time(found), tuple(each for each in found if isinstance(each.width, str)))


def features(system: CompiledSystem, p: np.ndarray) -> list[Feature]:
    """Return what can pass by, at parameters p, shape (n_p,), without what has no width or no speed here."""
    found: list[Feature] = []
    width: float | str
    for owner, component in system.model.components.items():
        for width_name, speed_name in component.features.items():
            if width_name in component.tables:
                width = _closest(component.tables[width_name][0])
            elif width_name in component.values:
                width = float(p[system.index("parameter", f"{owner}.{width_name}")])
            else:
                width = f"{owner}.{width_name}"
            found.append(Feature(width, "time" if speed_name == "time" else f"{owner}.{speed_name}"))
    for given, signal in system.model.features.values():
        width = given
        if isinstance(given, str):
            owner, _, table = given.partition(".")
            held = system.model.components.get(owner)
            if held is None or table not in held.tables:
                continue
            width = _closest(held.tables[table][0])
        found.append(Feature(width, signal))
    known = {"time", *system.speed_names}
    return [f for f in found if f.speed in known and (isinstance(f.width, str) or 0.0 < f.width < np.inf)]


def _step_over_time(found: Iterable[Feature]) -> float:
    """Return half the shortest duration among the features, s; infinite without one."""
    return min((0.5 * f.width for f in found if f.speed == "time" and not isinstance(f.width, str)), default=np.inf)


def finer_step(run: Trajectory, found: Iterable[Feature], limit: float) -> float | None:
    """Return a smaller largest step where one of a run could have jumped over a feature, else None."""
    finest = limit
    for feature in found:
        width = np.min(np.abs(run[feature.width])) if isinstance(feature.width, str) else feature.width
        speed = 1.0 if feature.speed == "time" else np.max(np.abs(run[feature.speed]), initial=0.0)
        if speed > 0.0 and width > 0.0:
            finest = min(finest, 0.5 * float(width) / float(speed))
    if float(run.statistics.get("longest_step", np.inf)) <= finest:
        return None
    return finest if finest < 0.8 * limit else None  # the same speed, sampled anew, is no reason to run again


def _closest(points: Any) -> float:
    """Return the least distance of a table's points; two points nearer than a millionth of its length are one."""
    x = np.asarray(points, dtype=float)
    apart = np.diff(x)
    return float(np.min(apart[apart > 1e-6 * (x[-1] - x[0])], initial=np.inf))
