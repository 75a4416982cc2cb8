"""The results of filters and smoothers: states with their deviations, innovations, likelihood."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.filters.consistency import Consistency, innovation_tests
from estimation.filters.errors import FilterError
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise
from estimation.filters.samples import FilterSamples
from estimation.filters.smoother import backward_pass, smoother_gains

if TYPE_CHECKING:
    import pandas

__all__ = ["Estimate", "FilterRun", "Smoothed"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """States over time with their variances.

    Parameters
    ----------
    model : FilterModel
    samples : FilterSamples
    states, variances : ndarray, shape (k, n)
        After the readings of their instant.
    covariances : ndarray, shape (k, n, n), optional
        If they were kept.
    """

    model: FilterModel = field(repr=False)
    samples: FilterSamples = field(repr=False)
    states: np.ndarray
    variances: np.ndarray
    covariances: np.ndarray | None

    @property
    def times(self) -> np.ndarray:
        """Instants, shape (k,), s."""
        return self.samples.times

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a state over time, shape (k,); a latent parameter with the value that it adds to."""
        return self.states[:, self.model.index(name)] + self.model.nominal(name)

    def std(self, name: str) -> np.ndarray:
        """Return the standard deviation of a state over time, shape (k,)."""
        return np.sqrt(np.maximum(self.variances[:, self.model.index(name)], 0.0))

    def to_frame(self, names: Iterable[str] | None = None) -> pandas.DataFrame:
        """Return states and their deviations as a table indexed by time in s."""
        import pandas

        chosen = list(names) if names is not None else list(self.model.state_names)
        data = {}
        for name in chosen:
            unit = self.model.unit(name) or "1"
            data[f"{name} [{unit}]"] = self[name]
            data[f"std {name} [{unit}]"] = self.std(name)
        return pandas.DataFrame(data, index=pandas.Index(self.times, name="time [s]"))

    def plot(self, names: Iterable[str] | None = None, axes: Any = None) -> Any:
        """Draw states over time with twice their standard deviation, one panel each; returns the figure."""
        import matplotlib.pyplot as plt

        latent = [n for quantity in self.model.latents for n in quantity.state_names[:1]]
        chosen = list(names) if names is not None else (latent or list(self.model.state_names))
        if axes is None:
            height = 1.8 * len(chosen) + 0.6
            _, grid = plt.subplots(
                len(chosen), 1, sharex=True, squeeze=False, figsize=(8, height), layout="constrained"
            )
            axes = grid[:, 0]
        axes = np.atleast_1d(axes)
        for axis, name in zip(axes, chosen, strict=True):
            value, std = self[name], self.std(name)
            axis.fill_between(self.times, value - 2 * std, value + 2 * std, alpha=0.25, label="±2 standard deviations")
            axis.plot(self.times, value, linewidth=1.0, label=name)
            axis.set_ylabel(f"{name.rsplit('.', 1)[-1]} [{self.model.unit(name) or '1'}]")
            axis.legend(fontsize="small", loc="upper right")
            axis.grid(alpha=0.3)
        axes[-1].set_xlabel("time [s]")
        return axes[0].figure


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterRun(Estimate):
    """The result of a filter.

    Parameters
    ----------
    noise : Noise
    predicted : ndarray, shape (k, n)
        States before the readings of their instant.
    innovations, innovation_variances : ndarray, shape (k, m)
        Reading minus prediction, and its variance; NaN where nothing was read.
    normalised : ndarray, shape (k, m)
        Innovations of the readings taken one after another, over their standard deviations: independent and
        of variance one if the assumptions hold.
    log_likelihood : float
        Of all readings.
    refused : int
        Readings that the gate kept out.
    kept : dict of ndarray
        Predicted covariances, transition matrices and rows of the readings, if everything was kept.
    """

    noise: Noise = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    innovations: np.ndarray = field(repr=False)
    innovation_variances: np.ndarray = field(repr=False)
    normalised: np.ndarray = field(repr=False)
    log_likelihood: float = 0.0
    refused: int = 0
    kept: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    method: str = ""

    @property
    def nis(self) -> np.ndarray:
        """Normalised innovation squared of each instant, NaN where nothing was read, shape (k,)."""
        squares = self.normalised**2
        total = np.nansum(squares, axis=1)
        return np.where(np.isnan(squares).all(axis=1), np.nan, total)

    @classmethod
    def from_rows(
        cls,
        model: FilterModel,
        samples: FilterSamples,
        noise: Noise,
        states: np.ndarray,
        innovations: np.ndarray,
        *,
        covariances: np.ndarray | None,
        log_likelihood: float,
        method: str,
        refused: int = 0,
        kept: dict[str, np.ndarray] | None = None,
    ) -> FilterRun:
        """Return the run whose compiled filter wrote these rows.

        Parameters
        ----------
        model, samples, noise
        states : ndarray, shape (k, 3 n)
            Predicted states, states, variances.
        innovations : ndarray, shape (k, 3 m)
            Innovations, their variances, normalised innovations.
        covariances, log_likelihood, method, refused, kept
            As the fields.
        """
        predicted, filtered, variances = np.moveaxis(states.reshape(len(states), 3, -1), 1, 0)
        difference, variance, normalised = np.moveaxis(innovations.reshape(len(innovations), 3, -1), 1, 0)
        return cls(
            model=model,
            samples=samples,
            states=filtered,
            variances=variances,
            noise=noise,
            predicted=predicted,
            innovations=difference,
            innovation_variances=variance,
            normalised=normalised,
            covariances=covariances,
            log_likelihood=log_likelihood,
            method=method,
            refused=refused,
            kept=kept or {},
        )

    def consistency(self, level: float = 0.95) -> Consistency:
        """Test the innovations: their size (NIS), their mean, and whether they are white."""
        return innovation_tests(self.normalised, self.model.measured, level)

    def smooth(self) -> Smoothed:
        """Return the states and covariances given all readings, by Rauch, Tung and Striebel.

        Raises
        ------
        FilterError
            If the run is not one of `extended_kalman_filter` with ``keep="everything"``.
        """
        if "transitions" not in self.kept or self.covariances is None:
            raise FilterError(
                "smoother",
                ['the filter did not keep its transitions: run extended_kalman_filter(…, keep="everything")'],
            )
        predicted = self.kept["predicted"]
        gains = smoother_gains(self.covariances, predicted, self.kept["transitions"])
        states, covariances = backward_pass(self.states, self.covariances, self.predicted, predicted, gains)
        variances = np.ascontiguousarray(np.diagonal(covariances, axis1=1, axis2=2))
        return Smoothed(
            model=self.model,
            samples=self.samples,
            states=states,
            variances=variances,
            covariances=covariances,
            gains=gains,
        )

    def __repr__(self) -> str:
        rows = int(np.isfinite(self.innovations).any(axis=1).sum())
        return (
            f"FilterRun({self.model.system.name!r}: {self.method}, {self.samples.count} instants, "
            f"{rows} with readings, log likelihood {self.log_likelihood:.6g})"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Smoothed(Estimate):
    """States given all readings, by Rauch, Tung and Striebel.

    Parameters
    ----------
    gains : ndarray, shape (k - 1, n, n)
        Of the smoother.
    """

    gains: np.ndarray = field(repr=False)

    def __repr__(self) -> str:
        return f"Smoothed({self.model.system.name!r}: {self.samples.count} instants, {self.model.n} states)"
