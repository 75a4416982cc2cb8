"""The extended Kalman filter: states and latent quantities of any machine (González et al. 2020, Eqs. 20 to 31).

The paper's Eqs. 26 and 29 print the innovation with the wrong sign and Eq. 30 an index one too low; here the
innovation is reading minus prediction, and the update is Joseph's with the matrices of the same instant.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.kernel_arguments import KernelArguments, check_shapes, diverged, padded
from estimation.filters.kernels import extended as kernel
from estimation.filters.kernels.layout import COVARIANCES, EVERYTHING
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.run import FilterRun
from estimation.filters.samples import FilterSamples

__all__ = ["extended_kalman_filter"]

Discretisation = Literal["exponential", "euler", "variational"]
Keep = Literal["variances", "covariances", "everything"]

_DISCRETISATION = {"exponential": 0, "euler": 1, "variational": 2}
_KEEP = {"variances": 0, "covariances": 1, "everything": 2}


def extended_kalman_filter(
    model: FilterModel,
    samples: FilterSamples,
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

    States are propagated by Runge and Kutta's method of order 4, covariances by a transition matrix.  Readings
    of one instant are processed in turn, which equals processing them at once because their noise is independent.

    Parameters
    ----------
    model : FilterModel
    samples : FilterSamples
    noise : Noise
    prior : Prior, optional
        Default: the machine's start values, known exactly.
    discretisation : {"exponential", "euler", "variational"}
        Transition matrix: exp(J h) with the Jacobian at the last estimate (Eq. 23), I + J h, or the exact
        derivative of the propagated state.
    keep : {"variances", "covariances", "everything"}
        What is kept of each instant; the smoother needs everything.
    square_root : bool
        True propagates the square root of the covariance (Householder triangles and Potter's update), which
        cannot lose its sign; False the covariance, in Joseph's form and made symmetric.
    once : bool
        True linearises once for each instant, at the prediction; False at the last estimate for the transition and
        at the prediction for the readings.
    hold : bool
        True holds inputs between instants, False interpolates them.
    substeps : int
        Steps of the integration between two instants; more are taken where a step would be longer than half of a
        narrow feature of the machine (`Model.feature`).
    gate : float, optional
        Readings whose innovation exceeds so many standard deviations are refused.

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
    arguments = KernelArguments(model)
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
        [
            _DISCRETISATION[discretisation],
            noise.code,
            kept,
            square_root,
            once,
            hold,
            arguments.fewest_substeps(substeps, samples),
        ],
        dtype=np.int64,
    )
    tall = max(3 * n, len(model.system.outputs)) + m + 8
    space = np.zeros(8 * n * ld + tall * ld + 16 * n + 4 * samples.inputs.shape[1] + 2 * m)
    covariance = padded(root_of(p) if square_root else p, ld)
    verdict = np.zeros(3)
    kernel.extended(
        arguments.numbers,
        samples.times,
        samples.inputs,
        samples.readings,
        r,
        padded(q, ld),
        padded(root_of(q), ld),
        x,
        covariance,
        settings,
        0.0 if gate is None else float(gate),
        out,
        covariances,
        predicted,
        carried,
        rows,
        innovations,
        space,
        verdict,
    )
    arguments.raise_python_error()
    likelihood, refused, bad = float(verdict[0]), int(verdict[1]), int(verdict[2])
    if bad >= 0:
        raise diverged(model, samples, out[: bad + 1].reshape(-1, 3, n))
    every = {"predicted": predicted, "transitions": carried, "rows": rows} if kept == EVERYTHING else {}
    return FilterRun.from_rows(
        model,
        samples,
        noise,
        out,
        innovations,
        covariances=covariances if kept >= COVARIANCES else None,
        log_likelihood=likelihood,
        refused=refused,
        kept=every,
        method=f"extended Kalman filter, {discretisation}{', square root' if square_root else ''}",
    )


def root_of(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric square root of a covariance."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
