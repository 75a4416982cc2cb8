"""The extended Kalman filter: states and latent quantities of any machine (González et al. 2020, Eqs. 20 to 31).

The paper's Eqs. 26 and 29 print the innovation with the wrong sign and Eq. 30 an index one too low; here the
innovation is reading minus prediction, and the update is Joseph's with the matrices of the same instant.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from estimation.filters.errors import FilterDivergence, FilterError
from estimation.filters.kernels import extended as kernel
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.run import FilterRun
from estimation.filters.samples import Samples

__all__ = ["extended"]

Discretisation = Literal["exponential", "euler", "variational"]
Keep = Literal["variances", "covariances", "everything"]

_HOW = {"exponential": 0, "euler": 1, "variational": 2}
_NOISE = {"density": 0, "density_times_step": 1, "per_step": 2}
_KEEP = {"variances": 0, "covariances": 1, "everything": 2}


def extended(
    model: FilterModel,
    samples: Samples,
    noise: Noise,
    prior: Prior | None = None,
    *,
    discretisation: Discretisation = "exponential",
    keep: Keep = "variances",
    square_root: bool = False,
    once: bool = False,
    hold: bool = False,
    substeps: int = 1,
    gate: float | None = None,
) -> FilterRun:
    """Run the extended Kalman filter.

    States are carried by Runge and Kutta's method of order 4, covariances by a transition matrix.  Readings
    of an instant are taken one after another, which is the same as all at once because their noise is
    independent.

    Parameters
    ----------
    model : FilterModel
    samples : Samples
    noise : Noise
    prior : Prior, optional
        Default: the machine's start values, known exactly.
    discretisation : {"exponential", "euler", "variational"}
        Transition matrix: exp(J h) with the Jacobian at the last estimate (Eq. 23), I + J h, or the exact
        derivative of the carried state.
    keep : {"variances", "covariances", "everything"}
        What is kept of each instant; the smoother needs everything.
    square_root : bool
        True carries the square root of the covariance (Householder triangles and Potter's update), which
        cannot lose its sign; False the covariance, in Joseph's form and made symmetric.
    once : bool
        True linearises once an instant, at the prediction; False at the last estimate for the transition and
        at the prediction for the readings.
    hold : bool
        True holds inputs between instants, False interpolates them.
    substeps : int
        Steps of the integration between two instants; more are taken where one would be longer than half of what
        passes by (`Model.feature`).
    gate : float, optional
        Readings whose innovation is further out than so many standard deviations are refused.

    Returns
    -------
    FilterRun

    Raises
    ------
    FilterError
        If samples do not fit the model.
    FilterDivergence
        If states or covariance grow beyond all bounds.
    """
    from estimation.filters.kernels.layout import COVARIANCES, EVERYTHING

    bundle = model.bundle()
    n, m, ld, count = model.n, len(model.measured), model.ld, samples.count
    check_shapes(model, samples)
    if substeps < 1:
        raise FilterError("filter", [f"substeps is {substeps}: give 1 or more"])
    q, r = noise.of(model)
    x, p = (prior or Prior()).of(model)
    kept = _KEEP[keep]
    full = (count, n, n) if kept >= COVARIANCES else (1, 1, 1)
    whole = (count, n, n) if kept == EVERYTHING else (1, 1, 1)
    covariances, predicted, carried = np.empty(full), np.empty(whole), np.empty(whole)
    rows = np.zeros((count, m, n) if kept == EVERYTHING else (1, 1, 1))
    out, innovations = np.empty((count, 3 * n)), np.full((count, 3 * m), np.nan)
    settings = np.array(
        [_HOW[discretisation], _NOISE[noise.kind], kept, square_root, once, hold, bundle.least(substeps, samples)],
        dtype=np.int64,
    )
    tall = max(3 * n, len(model.system.outputs)) + m + 8
    space = np.zeros(8 * n * ld + tall * ld + 16 * n + 4 * samples.inputs.shape[1] + 2 * m)
    covariance = padded(root_of(p) if square_root else p, ld)
    verdict = np.zeros(3)
    kernel.extended(
        bundle.numbers, samples.times, samples.inputs, samples.readings, r, padded(q, ld), padded(root_of(q), ld),
        x, covariance, settings, 0.0 if gate is None else float(gate), out, covariances, predicted, carried, rows,
        innovations, space, verdict,
    )  # fmt: skip
    bundle.check()
    likelihood, refused, bad = float(verdict[0]), int(verdict[1]), int(verdict[2])
    if bad >= 0:
        raise diverged(model, samples, out[: bad + 1].reshape(-1, 3, n))
    every = {"predicted": predicted, "transitions": carried, "rows": rows} if kept == EVERYTHING else {}
    states = out.reshape(count, 3, n)
    told = innovations.reshape(count, 3, m)
    return FilterRun(
        model=model,
        samples=samples,
        states=states[:, 1],
        variances=states[:, 2],
        covariances=covariances if kept >= COVARIANCES else None,
        noise=noise,
        predicted=states[:, 0],
        innovations=told[:, 0],
        innovation_variances=told[:, 1],
        normalised=told[:, 2],
        log_likelihood=likelihood,
        refused=refused,
        kept=every,
        method=f"extended Kalman filter, {discretisation}{', square root' if square_root else ''}",
    )


def check_shapes(model: FilterModel, samples: Samples) -> None:
    """Refuse samples that do not fit a model."""
    faults = []
    if samples.inputs.shape[1] != len(model.system.inputs):
        faults.append(
            f"there are {samples.inputs.shape[1]} columns of inputs, '{model.system.name}' has "
            f"{len(model.system.inputs)}: {', '.join(model.system.input_names) or 'none'}"
        )
    if samples.readings.shape[1] != len(model.measured):
        faults.append(
            f"there are {samples.readings.shape[1]} columns of readings, measured are {', '.join(model.measured)}"
        )
    if faults:
        raise FilterError(f"samples for the filter of '{model.system.name}'", faults)


def padded(matrix: np.ndarray, ld: int) -> np.ndarray:
    """Return a matrix with its rows filled up with zeros to a length."""
    out = np.zeros((len(matrix), ld))
    out[:, : matrix.shape[1]] = matrix
    return out


def root_of(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric square root of a covariance."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def diverged(model: FilterModel, samples: Samples, states: np.ndarray) -> FilterDivergence:
    """Return the error for a run that ended with numbers that are not finite."""
    k = len(states) - 1
    names = model.state_names
    wild = [name for j, name in enumerate(names) if not np.isfinite(states[k, :, j]).all()]
    before = states[max(k - 1, 0), 1]
    grown = np.argmax(np.abs(np.nan_to_num(before, nan=np.inf, posinf=np.inf)) / (1.0 + np.abs(states[0, 0])))
    return FilterDivergence(
        f"the filter of '{model.system.name}' diverged at {samples.times[k]:.6g} s (row {k}): no finite value for "
        f"{', '.join(wild[:4])}{' and others' if len(wild) > 4 else ''}; the row before, '{names[int(grown)]}' stood "
        f"furthest off at {before[int(grown)]:.4g}. Check units and signs of inputs and readings, start nearer "
        "(prior), take more substeps, or lower the process noise of that state"
    )
