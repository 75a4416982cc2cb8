"""The firefly algorithm of the gearbox paper (Eqs. 13 and 14), after Yang."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from surrogate.objective import CountedObjective

__all__ = ["FireflySettings", "firefly_search"]

Array = NDArray[np.float64]
Attraction = Literal["exp(-gamma r)", "exp(-gamma r^2)"]
Steps = Literal["uniform", "gaussian", "printed"]


@dataclass(frozen=True, kw_only=True)
class FireflySettings:
    """Settings of the swarm; lengths are shares of the parameters' ranges.

    Parameters
    ----------
    population : int
        Number of fireflies (paper: 30).
    iterations : int, optional
        Moves of the whole swarm (paper: 100); by default as many as the budget allows.
    beta0 : float
        Attractiveness at no distance, 0 to 1.
    gamma : float
        Absorption of light, at least 0 (paper: 1).
    alpha : float
        Size of the random step in the first iteration, 0 to 1.
    decay : float
        Factor on ``alpha`` after each iteration, above 0 to 1; 1 keeps it, as printed.
    attraction : {"exp(-gamma r)", "exp(-gamma r^2)"}
        As the paper prints it, and the usual form.
    steps : {"gaussian", "uniform", "printed"}
        Random vector of a step: standard normal, uniform on [−0.5, 0.5], or normal minus 0.5, which is what
        Eq. 13 says if read to the letter and which drifts towards the lower bounds.
    """

    population: int = 30
    iterations: int | None = None
    beta0: float = 0.3
    gamma: float = 1.0
    alpha: float = 0.3
    decay: float = 0.97
    attraction: Attraction = "exp(-gamma r)"
    steps: Steps = "gaussian"

    def __post_init__(self) -> None:
        faults = []
        if self.population < 2:
            faults.append(f"population must be at least 2, not {self.population}")
        if self.iterations is not None and self.iterations < 1:
            faults.append(f"iterations must be at least 1, not {self.iterations}")
        for name in ("beta0", "alpha"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                faults.append(f"{name} must lie between 0 and 1, not {getattr(self, name)}")
        if not (np.isfinite(self.gamma) and self.gamma >= 0.0):
            faults.append(f"gamma must be a finite number of at least 0, not {self.gamma}")
        if not 0.0 < self.decay <= 1.0:
            faults.append(f"decay must lie above 0 and at most at 1, not {self.decay}")
        for name, allowed in (("attraction", get_args(Attraction)), ("steps", get_args(Steps))):
            if getattr(self, name) not in allowed:
                choices = ", ".join(repr(item) for item in allowed)
                faults.append(f"{name} must be one of {choices}, not {getattr(self, name)!r}")
        if faults:
            raise ValueError("firefly: " + "; ".join(faults))


def firefly_search(objective: CountedObjective, settings: FireflySettings, rng: np.random.Generator) -> None:
    """Move the swarm until the iterations are done or the objective refuses further evaluations.

    In one iteration every firefly moves towards each one that was brighter when the iteration began, and is
    evaluated once at the end; the brightest moves at random.  The objective remembers the best point met,
    since the brightest may move to a worse place.
    """
    n, k = settings.population, len(objective.space)
    place = rng.random((n, k))
    light = objective.many(place)
    alpha = settings.alpha
    done = 0
    while settings.iterations is None or done < settings.iterations:
        place = _move(place, light, alpha, settings, rng)
        light = objective.many(place)
        alpha *= settings.decay
        done += 1


def _move(place: Array, light: Array, alpha: float, settings: FireflySettings, rng: np.random.Generator) -> Array:
    moved = place.copy()
    # The dimmest pulls first, so that the last word of every firefly's move belongs to the brightest.
    for j in np.argsort(light, kind="stable"):
        drawn = light < light[j]
        if not drawn.any():
            continue
        away = place[j] - moved[drawn]
        r = np.sqrt((away**2).sum(axis=1))
        exponent = r if settings.attraction == "exp(-gamma r)" else r**2
        pull = settings.beta0 * np.exp(-settings.gamma * exponent)
        moved[drawn] += pull[:, None] * away + alpha * _steps(away.shape, settings.steps, rng)
        np.clip(moved, 0.0, 1.0, out=moved)
    brightest = light == light.max()
    moved[brightest] += alpha * _steps(moved[brightest].shape, settings.steps, rng)
    return np.clip(moved, 0.0, 1.0)


def _steps(shape: tuple[int, ...], kind: Steps, rng: np.random.Generator) -> Array:
    if kind == "uniform":
        return rng.random(shape) - 0.5
    normal = rng.standard_normal(shape)
    return normal - 0.5 if kind == "printed" else normal
