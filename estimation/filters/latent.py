"""Latent quantities: parameters that change over time, forces that are not measured.

A latent quantity adds to inputs or parameters of a machine and obeys a small linear equation of its own,
ż = A z + w, whose first state is what is added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["Latent", "Matern32", "OrnsteinUhlenbeck", "RandomWalk"]


@dataclass(frozen=True)
class Latent:
    """A quantity that is estimated together with the states; see the subclasses for how it moves.

    Parameters
    ----------
    target : str or mapping of str to float
        Input or parameter that it adds to, or several with factors.
    name : str
        By default the target's.
    """

    target: str | Mapping[str, float]
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            if not isinstance(self.target, str):
                raise ValueError("a latent quantity that adds to several targets needs a name")
            object.__setattr__(self, "name", self.target)
        faults = [
            f"{key} is {value:g}: give a positive, finite number"
            for key, value in self._positive().items()
            if not (value > 0.0 and math.isfinite(value))
        ]
        if faults:
            raise ValueError(f"latent quantity '{self.name}': " + "; ".join(faults))

    def _positive(self) -> dict[str, float]:
        return {}

    @property
    def weights(self) -> dict[str, float]:
        """Factors by target."""
        return {self.target: 1.0} if isinstance(self.target, str) else dict(self.target)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        return (self.name, *(f"{self.name}.rate{k}" for k in range(1, len(self.drift))))

    @property
    def drift(self) -> np.ndarray:
        """A, shape (k, k)."""
        raise NotImplementedError

    @property
    def density(self) -> np.ndarray:
        """Density of the noise w, unit² of the state per second, shape (k, k)."""
        raise NotImplementedError

    @property
    def prior(self) -> np.ndarray:
        """Covariance at the start, shape (k, k)."""
        raise NotImplementedError


@dataclass(frozen=True)
class RandomWalk(Latent):
    """A quantity that wanders: ṗ = w (González et al. 2020, Eq. 31).

    Parameters
    ----------
    rate : float, unit²/s
        Growth of its variance; zero for a constant.
    std : float, unit
        Standard deviation at the start.

    Examples
    --------
    >>> RandomWalk("guide.mu", rate=1e-4, std=0.05).drift
    array([[0.]])
    """

    rate: float = 0.0
    std: float = 1.0

    def _positive(self) -> dict[str, float]:
        return {"std": self.std, **({"rate": self.rate} if self.rate else {})}

    @property
    def drift(self) -> np.ndarray:
        """Zero."""
        return np.zeros((1, 1))

    @property
    def density(self) -> np.ndarray:
        """The rate."""
        return np.array([[self.rate]])

    @property
    def prior(self) -> np.ndarray:
        """The variance at the start."""
        return np.array([[self.std**2]])


@dataclass(frozen=True)
class OrnsteinUhlenbeck(Latent):
    """A quantity that wanders and returns: ṗ = −p/time + w, stationary with the given deviation.

    Parameters
    ----------
    std : float, unit
    time : float, s
        After which its correlation has fallen to 1/e.
    """

    std: float = 1.0
    time: float = 1.0

    def _positive(self) -> dict[str, float]:
        return {"std": self.std, "time": self.time}

    @property
    def drift(self) -> np.ndarray:
        """Minus one over the time."""
        return np.array([[-1.0 / self.time]])

    @property
    def density(self) -> np.ndarray:
        """2 std²/time."""
        return np.array([[2.0 * self.std**2 / self.time]])

    @property
    def prior(self) -> np.ndarray:
        """The stationary variance."""
        return np.array([[self.std**2]])


@dataclass(frozen=True)
class Matern32(Latent):
    """A smooth unknown force: a Gaussian process with the Matérn-3/2 covariance as two states.

    Its covariance over a lag τ is std² (1 + λτ) exp(−λτ) with λ = √3/time (Hartikainen and Särkkä 2010).

    Parameters
    ----------
    std : float, unit
    time : float, s
        Length scale.
    """

    std: float = 1.0
    time: float = 1.0

    def _positive(self) -> dict[str, float]:
        return {"std": self.std, "time": self.time}

    @property
    def drift(self) -> np.ndarray:
        """Companion matrix of (s + λ)²."""
        k = math.sqrt(3.0) / self.time
        return np.array([[0.0, 1.0], [-k * k, -2.0 * k]])

    @property
    def density(self) -> np.ndarray:
        """4 λ³ std² on the rate."""
        k = math.sqrt(3.0) / self.time
        return np.diag([0.0, 4.0 * k**3 * self.std**2])

    @property
    def prior(self) -> np.ndarray:
        """The stationary covariance."""
        k = math.sqrt(3.0) / self.time
        return np.diag([self.std**2, (k * self.std) ** 2])


def latent_readouts(system: System, latents: tuple[Latent, ...]) -> tuple[list[tuple[int, int, int, float]], list[str]]:
    """Return (latent state, kind 0 input or 1 parameter, index, factor) for each target, and faults."""
    from multibody.base.spelling import nearest

    readouts, faults, at = [], [], len(system.states)
    delays = set(system.input_delays.values())
    known = [*system.input_names, *system.parameter_names]
    for latent in latents:
        for name, weight in latent.weights.items():
            if name in system.input_names:
                readouts.append((at, 0, system.input_names.index(name), float(weight)))
            elif name in system.parameter_names:
                index = system.parameter_names.index(name)
                if index in delays:
                    faults.append(f"'{name}' delays an input and cannot be a latent quantity: calibrate it instead")
                readouts.append((at, 1, index, float(weight)))
            else:
                faults.append(f"'{system.name}' has no input or parameter '{name}'{nearest(name, known)}")
        at += len(latent.drift)
    return readouts, faults
