"""Virtual sensors: outputs of the machine that nobody measures, along what a filter estimated, with their spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.run import FilterRun

if TYPE_CHECKING:
    import pandas

__all__ = ["VirtualSensors", "virtual_sensors"]


@dataclass(frozen=True, eq=False, kw_only=True)
class VirtualSensors:
    """Quantities that were not measured, over time.

    Parameters
    ----------
    names : tuple of str
    units : tuple of str
    times : ndarray, shape (n,), s
    values : ndarray, shape (n, k)
    stds : ndarray, shape (n, k)
        Standard deviation that follows from the filter's covariance; NaN where the run kept none.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray
    stds: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[:, self.names.index(name)]

    def std(self, name: str) -> np.ndarray:
        """Return the standard deviation of a quantity, shape (n,)."""
        return self.stds[:, self.names.index(name)]

    def to_frame(self) -> pandas.DataFrame:
        """Return values and standard deviations by time."""
        import pandas

        data = {}
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            label = f"{name} [{unit}]" if unit else name
            data[label], data[f"std of {label}"] = self.values[:, k], self.stds[:, k]
        return pandas.DataFrame(data, index=pandas.Index(self.times, name="time [s]"))

    def plot(self, axes: Any = None) -> Any:
        """Draw every quantity with twice its standard deviation; returns the figure."""
        import matplotlib.pyplot as plt

        if axes is None:
            count = len(self.names)
            _, axes = plt.subplots(count, 1, sharex=True, figsize=(8, 2.2 * count), squeeze=False, layout="constrained")
        axes = np.ravel(axes)
        for k, axis in enumerate(axes):
            value, spread = self.values[:, k], 2.0 * self.stds[:, k]
            axis.fill_between(self.times, value - spread, value + spread, alpha=0.25, label="±2 standard deviations")
            axis.plot(self.times, value, linewidth=0.8)
            axis.set_ylabel(f"{self.names[k]} [{self.units[k] or '1'}]")
            axis.grid(alpha=0.3)
        axes[0].legend(fontsize="small")
        axes[-1].set_xlabel("time [s]")
        return axes[0].figure


def virtual_sensors(run: FilterRun, names: Sequence[str], every: int = 1) -> VirtualSensors:
    """Return outputs of the machine at the filter's estimates, whether they were measured or not.

    The spread is √(h P hᵀ) with the exact derivative h of the output by all states, latent ones included; it holds as
    far as the filter's own covariance does.

    Parameters
    ----------
    run : FilterRun
        Kept with ``keep="covariances"`` or ``"everything"`` for the spread.
    names : sequence of str
        Outputs that the run's system was built with.
    every : int
        Takes every so many samples.

    Raises
    ------
    FilterError
        If an output does not exist.
    """
    from multibody.base.spelling import nearest
    from multibody.compile.vector_mode import along_directions

    model, system = run.model, run.model.system
    faults = [
        f"'{system.name}' was built without the output '{n}'{nearest(n, system.output_names)}"
        for n in names
        if n not in system.output_names
    ]
    if faults:
        raise FilterError(f"virtual sensors of '{system.name}'", faults)
    chosen = [system.index("output", n) for n in names]
    rows, n, wide = range(0, run.samples.count, every), len(system.states), model.ld
    x_dot, u_dot, p_dot = model.directions
    tangent = along_directions(system.outputs_tangent, wide) if run.covariances is not None else None
    values, stds = np.empty((len(rows), len(chosen))), np.full((len(rows), len(chosen)), np.nan)
    y, slopes = np.empty(len(system.outputs)), np.empty((len(system.outputs), wide))
    for at, k in enumerate(rows):
        t, z = float(run.times[k]), run.states[k]
        x, u, p = z[:n].copy(), run.samples.inputs[k].copy(), model.p.copy()
        for state, kind, index, weight in model.readouts:
            (u if kind == 0 else p)[index] += weight * z[state]
        values[at] = system.outputs_function(t, x, u, p, y)[chosen]
        if run.covariances is None:
            continue
        if tangent is not None:
            tangent(t, x, u, p, x_dot, u_dot, p_dot, slopes)
        else:
            for j in range(model.n):
                columns = (np.ascontiguousarray(d[:, j]) for d in (x_dot, u_dot, p_dot))
                slopes[:, j] = system.outputs_tangent(t, x, u, p, *columns, y)
        h = slopes[chosen, : model.n]
        stds[at] = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", h, run.covariances[k], h), 0.0))
    units = tuple(system.unit(name) for name in names)
    return VirtualSensors(names=tuple(names), units=units, times=np.array(run.times)[::every], values=values, stds=stds)
