"""A threshold for the alignment from several configurations of the guides.

González et al. 2020, section IV-C and Fig. 10: the median deviation that a share of all configurations does not exceed,
and the energy that is lost in the guides of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from operation.statistics.fleet_level import share_level
from vtsdt.files.rail_profile_table import ProfileTable

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

__all__ = ["Configuration", "Threshold", "configuration_of", "friction_loss", "threshold_of"]


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """One alignment of the guides.

    Parameters
    ----------
    name : str
    median, largest : float, m
        Of the absolute deviation over the height that the shoes pass.
    energy : float, J
        Lost in the cabin's guides on one trip.
    energy_std : float, J
        Its standard error from repeated trips; NaN for a single trip.
    """

    name: str
    median: float
    largest: float
    energy: float
    energy_std: float = float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class Threshold:
    """A threshold and the configurations behind it.

    Parameters
    ----------
    level : float, m
        Median deviation that a share ``fraction`` of the configurations does not exceed.
    interval : (float, float), m
        95 % interval by bootstrap over the configurations.
    fraction : float
    configurations : tuple of Configuration
    slope : float, J/m
        Of the energy over the median deviation, by least squares.
    correlation : float
        Of energy and median deviation.
    """

    level: float
    interval: tuple[float, float]
    fraction: float
    configurations: tuple[Configuration, ...]
    slope: float
    correlation: float

    @property
    def under(self) -> tuple[str, ...]:
        """Names of the configurations that do not exceed the level."""
        return tuple(c.name for c in self.configurations if c.median <= self.level)

    def __repr__(self) -> str:
        low, high = (1e3 * v for v in self.interval)
        return (
            f"Threshold {1e3 * self.level:.2f} mm (95 %: {low:.2f} to {high:.2f}): "
            f"{len(self.under)} of {len(self.configurations)} configurations do not exceed it"
        )

    def to_frame(self) -> pandas.DataFrame:
        """Return the configurations as a table."""
        import pandas

        rows = [(c.name, 1e3 * c.median, 1e3 * c.largest, c.energy, c.energy_std) for c in self.configurations]
        return pandas.DataFrame(
            rows, columns=["configuration", "median [mm]", "largest [mm]", "energy loss [J]", "its error [J]"]
        )

    def to_json(self) -> dict[str, Any]:
        """Return level, interval and configurations in mm and J."""
        return {
            "level_mm": 1e3 * self.level,
            "interval_mm": [1e3 * v for v in self.interval],
            "fraction": self.fraction,
            "slope_J_per_mm": 1e-3 * self.slope,
            "correlation": self.correlation,
            "configurations": [
                {"name": c.name, "median_mm": 1e3 * c.median, "largest_mm": 1e3 * c.largest, "energy_J": c.energy}
                for c in self.configurations
            ],
        }

    def plot(self) -> Figure:
        """Draw median and largest deviation of each configuration against its energy loss (Fig. 10)."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        axis = figure.subplots()
        energy = [c.energy for c in self.configurations]
        median = np.array([1e3 * c.median for c in self.configurations])
        largest = np.array([1e3 * c.largest for c in self.configurations])
        axis.vlines(energy, median, largest, color="#bbbbbb", linewidth=1.0, zorder=1)
        axis.plot(energy, median, "o", color="#0072B2", label="median deviation")
        axis.plot(energy, largest, "^", color="#D55E00", label="largest deviation")
        low, high = (1e3 * v for v in self.interval)
        axis.axhspan(low, high, color="#eeeeee", zorder=0, label="its 95 % interval")
        axis.axhline(
            1e3 * self.level,
            color="black",
            linewidth=1.2,
            linestyle="--",
            label=f"threshold {1e3 * self.level:.2f} mm: {100 * self.fraction:.0f} % of the medians are below it",
        )
        axis.set_xlabel("energy lost in the cabin's guides on one trip [J]")
        axis.set_ylabel("guide deviation [mm]")
        axis.legend(fontsize="small")
        axis.grid(color="#eeeeee")
        return figure


def configuration_of(
    name: str, rail: ProfileTable, energies: Sequence[float], low: float | None = None, high: float | None = None
) -> Configuration:
    """Return one configuration from the estimated rail and the energies of its trips.

    Parameters
    ----------
    name : str
    rail : ProfileTable
    energies : sequence of float, J
        Lost in the cabin's guides, one for each trip.
    low, high : float, m, optional
        Range of heights of the deviation; default: the whole table.
    """
    a = rail.height[0] if low is None else low
    b = rail.height[-1] if high is None else high
    heights = np.linspace(a, b, 400)  # evenly over the height, independent of the table's points
    deviation = np.abs([rail.profile.at(h) for h in heights])
    energy = np.asarray(energies, dtype=float)
    error = float(energy.std(ddof=1) / np.sqrt(energy.size)) if energy.size > 1 else float("nan")
    return Configuration(
        name=name,
        median=float(np.median(deviation)),
        largest=float(deviation.max()),
        energy=float(energy.mean()),
        energy_std=error,
    )


def friction_loss(
    time: np.ndarray, tension: np.ndarray, acceleration: np.ndarray, speed: np.ndarray, mass: float
) -> float:
    """Return the energy lost in the cabin's guides on a trip from the paper's measurements, J.

    Friction is m (z̈ + g) − F_c.  A constant error of the tension contributes that error times the distance.

    Parameters
    ----------
    time, tension, acceleration, speed : ndarray, s, N, m/s² and m/s
        Of the cabin, up positive; acceleration without gravity.
    mass : float, kg
        Of the cabin with its load.
    """
    friction = mass * (np.asarray(acceleration) + STANDARD_GRAVITY) - np.asarray(tension)
    return float(-np.trapezoid(friction * np.asarray(speed), time))


def threshold_of(
    configurations: Sequence[Configuration], fraction: float = 0.7, *, draws: int = 2000, seed: int = 0
) -> Threshold:
    """Return the median deviation that a share of the configurations does not exceed.

    It is the smallest of the medians that at least ``fraction`` of them do not exceed, as it is read from Fig. 10: with
    14 configurations and 70 % it is the tenth.

    Parameters
    ----------
    configurations : sequence of Configuration
    fraction : float
        Between 0 and 1; the paper takes 0.7.
    draws : int
        Bootstrap samples for the interval.
    seed : int

    Raises
    ------
    ValueError
        If there are fewer than three configurations, or the fraction is not between 0 and 1.

    Examples
    --------
    >>> configurations = [
    ...     Configuration(name=f"{k}", median=1e-3 * k, largest=2e-3 * k, energy=10.0 + k) for k in range(1, 15)
    ... ]
    >>> round(1e3 * threshold_of(configurations).level, 6)
    10.0
    """
    medians = np.array([c.median for c in configurations])
    energy = np.array([c.energy for c in configurations])
    level, interval = share_level(medians, fraction, draws=draws, seed=seed)
    varied = np.ptp(medians) > 0.0 and np.ptp(energy) > 0.0
    return Threshold(
        level=level,
        interval=interval,
        fraction=fraction,
        configurations=tuple(configurations),
        slope=float(np.polyfit(medians, energy, 1)[0]) if varied else float("nan"),
        correlation=float(np.corrcoef(medians, energy)[0, 1]) if varied else float("nan"),
    )
