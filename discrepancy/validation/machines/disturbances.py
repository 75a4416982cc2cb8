"""Unrecorded disturbances: Gaussian processes of several spectra, given by their Karhunen–Loève modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SPECTRA", "Disturbance", "drawn_disturbance", "modes"]

Array = NDArray[np.float64]

SPECTRA = ("slow", "broad", "narrow", "smooth")
#: Correlation time over the record's length: from a fifth of it down to what the grid of the modes resolves.
TIMES = {"slow": (0.05, 0.2), "broad": (0.004, 0.02), "narrow": (0.02, 0.1), "smooth": (0.01, 0.05)}
CYCLES = (5.0, 25.0)  # of the narrow band, within a record
LEVELS = (0.3, 3.0)  # of the machine's usual root mean square: below the sensors' noise up to well above it
NODES = 300  # of the grid on which the modes stand; twelve to the shortest period of the narrow band
SHARE = 0.99  # of the variance that the modes in the likelihood hold: the rest is below a tenth of the level
MOST = 80  # modes of a record: what the broad spectrum needs for its first 90 %


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Where a disturbance acts and how it looks.

    Parameters
    ----------
    place : str
    spectrum : {"none", "slow", "broad", "narrow", "smooth"}
    rms : float
        SI.
    time : float
        Correlation time, s.
    frequency : float
        Middle of a narrow band, Hz.
    """

    place: str = ""
    spectrum: str = "none"
    rms: float = 0.0
    time: float = 1.0
    frequency: float = 0.0

    def covariance(self, lag: Array) -> Array:
        """Return the covariance at a lag (s): exponential (slow, broad), times a cosine (narrow), or Matérn 3/2."""
        r = np.abs(lag) / self.time
        if self.spectrum == "smooth":
            shape = (1.0 + np.sqrt(3.0) * r) * np.exp(-np.sqrt(3.0) * r)
        else:
            shape = np.exp(-r) * np.cos(2.0 * np.pi * self.frequency * lag)
        return self.rms**2 * shape


def drawn_disturbance(
    rng: np.random.Generator, places: dict[str, float], length: float, *, spectrum: str = ""
) -> Disturbance:
    """Draw a place, a spectrum (or none at all, one time in five) and a level.

    Parameters
    ----------
    rng : Generator
    places : dict of str to float
        Usual root mean square by place.
    length : float
        Of a record, s.
    spectrum : str, optional
        This one.
    """
    spectrum = spectrum or str(rng.choice(["none", *SPECTRA]))
    if spectrum == "none" or not places:
        return Disturbance()
    place = str(rng.choice(sorted(places)))
    low, high = TIMES[spectrum]
    return Disturbance(
        place=place,
        spectrum=spectrum,
        rms=places[place] * float(np.exp(rng.uniform(*np.log(LEVELS)))),
        time=length * float(np.exp(rng.uniform(np.log(low), np.log(high)))),
        frequency=float(rng.uniform(*CYCLES)) / length if spectrum == "narrow" else 0.0,
    )


def modes(disturbance: Disturbance, t: Array, *, every: bool = False) -> Array:
    """Return the modes √λ·φ of a disturbance over the times of a record, the strongest first.

    A realisation is their sum with standard normal weights.

    Parameters
    ----------
    disturbance : Disturbance
    t : ndarray, shape (rows,), s
    every : bool
        All of them, in place of those that hold `SHARE` of the variance.

    Returns
    -------
    ndarray, shape (modes, rows)

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 50)
    >>> process = Disturbance(place="cart", spectrum="slow", rms=2.0, time=0.2)
    >>> bool(np.allclose((modes(process, t, every=True) ** 2).sum(axis=0), 4.0))
    True
    """
    nodes = np.linspace(t[0], t[-1], min(NODES, t.size))
    variance, shapes = np.linalg.eigh(disturbance.covariance(nodes[:, None] - nodes[None, :]))
    variance, shapes = np.maximum(variance[::-1], 0.0), shapes[:, ::-1]
    held = np.cumsum(variance) / max(variance.sum(), 1e-300)
    count = nodes.size if every else min(MOST, int(np.searchsorted(held, SHARE)) + 1)
    return np.stack([np.interp(t, nodes, np.sqrt(variance[k]) * shapes[:, k]) for k in range(count)])
