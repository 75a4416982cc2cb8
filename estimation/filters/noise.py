"""Covariances of process and measurement noise, Q and R, and the state at the start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.model import FilterModel

__all__ = ["Noise", "Prior"]

_KINDS = ("density", "density_times_step", "per_step")  # INTEGRATED, TIMES_STEP, PER_STEP of the kernels


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariances of process and measurement noise.

    Parameters
    ----------
    process : mapping of str to float, or ndarray, shape (n, n)
        By state; a state that is not named has none.  Latent quantities add their own density unless named.
    measurement : mapping of str to float, or ndarray, shape (m,)
        Variance of each measured output's readings.
    kind : {"density", "density_times_step", "per_step"}
        What ``process`` is: a density in unit²/s, integrated over the step; the same, only multiplied by the
        step; or a covariance that is added at every step however long it is.  Integration is by the
        trapezoidal rule, h/2 (Q + F Q Fᵀ).
    """

    process: Mapping[str, float] | np.ndarray
    measurement: Mapping[str, float] | np.ndarray
    kind: Literal["density", "density_times_step", "per_step"] = "density"

    @property
    def code(self) -> int:
        """Number of the kind in the compiled filters (`estimation.filters.kernels.layout`)."""
        return _KINDS.index(self.kind)

    def of(self, model: FilterModel) -> tuple[np.ndarray, np.ndarray]:
        """Return Q, shape (n, n), and the diagonal of R, shape (m,), for a model.

        Raises
        ------
        FilterError
            With every fault.
        """
        from multibody.base.spelling import nearest

        n, plant, faults = model.n, len(model.system.states), []
        if self.kind not in _KINDS:
            faults.append(f"kind is '{self.kind}': take one of {', '.join(_KINDS)}")
        if isinstance(self.process, np.ndarray):
            q = np.array(self.process, dtype=float)
            if q.shape != (n, n):
                faults.append(f"process has the shape {q.shape}, the filter has {n} states")
                q = np.zeros((n, n))
        else:
            q = np.zeros((n, n))
            q[plant:, plant:] = model.latent_density
            for name, value in self.process.items():
                if name not in model.state_names:
                    faults.append(f"process names no state: '{name}'{nearest(name, model.state_names)}")
                    continue
                q[model.index(name), model.index(name)] = value
        if isinstance(self.measurement, np.ndarray):
            r = np.array(self.measurement, dtype=float)
        else:
            unknown = [name for name in self.measurement if name not in model.measured]
            faults += [f"'{name}' is not measured{nearest(name, model.measured)}" for name in unknown]
            missing = [name for name in model.measured if name not in self.measurement]
            faults += [f"measurement has no variance for '{name}'" for name in missing]
            r = np.array([self.measurement.get(name, 1.0) for name in model.measured], dtype=float)
        if r.shape != (len(model.measured),):
            faults.append(f"measurement has the shape {r.shape}, there are {len(model.measured)} readings")
        elif np.any(~(r > 0.0)):
            faults.append("every measurement variance must be positive")
        if not np.allclose(q, q.T) or np.linalg.eigvalsh(0.5 * (q + q.T)).min() < -1e-12 * max(np.abs(q).max(), 1e-300):
            faults.append("process is no covariance: it must be symmetric without negative eigenvalues")
        if faults:
            raise FilterError(f"noise of the filter of '{model.system.name}'", faults)
        return q, r


@dataclass(frozen=True, eq=False)
class Prior:
    """State and covariance before the first reading.

    Parameters
    ----------
    state : mapping of str to float, or ndarray, shape (n,) or that of the machine's states
        What is not named has the machine's start value, and zero for latent quantities.
    std : mapping of str to float, or ndarray, shape (n,)
        Standard deviation by state; what is not named is known exactly, latent quantities as they say.
    covariance : ndarray, shape (n, n), optional
        Instead of ``std``.
    """

    state: Mapping[str, float] | np.ndarray | None = None
    std: Mapping[str, float] | np.ndarray | None = None
    covariance: np.ndarray | None = None

    def of(self, model: FilterModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the state, shape (n,), and its covariance, shape (n, n), for a model."""
        from multibody.base.spelling import nearest

        n, plant, faults = model.n, len(model.system.states), []
        x = np.concatenate([model.system.start, np.zeros(n - plant)])
        p = np.zeros((n, n))
        p[plant:, plant:] = model.latent_prior
        if isinstance(self.state, np.ndarray):
            if self.state.shape not in ((n,), (plant,)):
                faults.append(f"state has the shape {self.state.shape}, not ({n},) or ({plant},)")
            else:
                x[: self.state.size] = self.state
        given: dict[str, float] = dict(self.state) if isinstance(self.state, Mapping) else {}
        stds: dict[str, float] = dict(self.std) if isinstance(self.std, Mapping) else {}
        for name in [*given, *stds]:
            if name not in model.state_names:
                faults.append(f"there is no state '{name}'{nearest(name, model.state_names)}")
        for name, value in given.items():
            if name in model.state_names:
                x[model.index(name)] = value - model.nominal(name)
        for name, value in stds.items():
            if name in model.state_names:
                p[model.index(name), model.index(name)] = value**2
        if isinstance(self.std, np.ndarray):
            if self.std.shape != (n,):
                faults.append(f"std has the shape {self.std.shape}, the filter has {n} states")
            else:
                p = np.diag(np.asarray(self.std, dtype=float) ** 2)
        if self.covariance is not None:
            p = np.array(self.covariance, dtype=float)
            if p.shape != (n, n):
                faults.append(f"covariance has the shape {p.shape}, the filter has {n} states")
        if faults:
            raise FilterError(f"start of the filter of '{model.system.name}'", faults)
        return x, p
