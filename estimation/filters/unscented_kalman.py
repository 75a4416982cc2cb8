"""The unscented Kalman filter: the extended filter's peer, which needs no derivatives.

S. J. Julier, J. K. Uhlmann: Unscented filtering and nonlinear estimation, Proc. IEEE 92 (2004).
"""

from __future__ import annotations

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.kernel_arguments import KernelArguments, check_shapes, diverged, padded
from estimation.filters.kernels import unscented as kernel
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.run import FilterRun
from estimation.filters.samples import FilterSamples

__all__ = ["unscented_kalman_filter"]


def unscented_kalman_filter(
    model: FilterModel,
    samples: FilterSamples,
    noise: Noise,
    prior: Prior | None = None,
    *,
    alpha: float = 1.0,
    beta: float = 0.0,
    kappa: float = 0.0,
    covariances: bool = False,
    hold: bool = False,
    substeps: int = 1,
) -> FilterRun:
    """Run the unscented Kalman filter with additive noise.

    Parameters
    ----------
    model, samples, noise, prior
        As for `estimation.filters.extended_kalman_filter`.
    alpha, beta, kappa : float
        Spread of the points: √(n + λ) standard deviations with λ = alpha² (n + kappa) − n.  The defaults make
        λ zero and leave the middle point out (the cubature rule), so that no weight is negative.
    covariances : bool
        True keeps them.
    hold, substeps
        As for `extended_kalman_filter`.

    Raises
    ------
    FilterError
        If samples do not fit the model or the weights are impossible.
    FilterDivergence
        If the covariance loses its sign or a state grows beyond all bounds.
    """
    arguments = KernelArguments(model)
    n, m, ld, count = model.n, len(model.measured), model.ld, samples.count
    check_shapes(model, samples)
    whole = alpha**2 * (n + kappa)
    if not whole > 0.0:
        raise FilterError("unscented filter", [f"alpha² (n + kappa) is {whole:g}: it must be positive"])
    first = (whole - n) / whole
    weights = np.array([first, first + 1.0 - alpha**2 + beta, 0.5 / whole])
    q, r = noise.of(model)
    x, p = (prior or Prior()).of(model)
    kept = np.empty((count, n, n) if covariances else (1, 1, 1))
    out, innovations = np.empty((count, 3 * n)), np.full((count, 3 * m), np.nan)
    settings = np.array([noise.code, int(covariances), hold, substeps], dtype=np.int64)
    size = n * ld + (2 * n + 1) * (n + m) + 8 * n + 4 * samples.inputs.shape[1] + m + m * m + n * m + n
    verdict = np.zeros(2)
    kernel.unscented(
        arguments.numbers,
        samples.times,
        samples.inputs,
        samples.readings,
        r,
        padded(q, ld),
        x,
        padded(p, ld),
        settings,
        float(np.sqrt(whole)),
        weights,
        out,
        kept,
        innovations,
        np.zeros(size + 8),
        verdict,
    )
    arguments.raise_python_error()
    likelihood, bad = float(verdict[0]), int(verdict[1])
    if bad >= 0:
        raise diverged(model, samples, out[: bad + 1].reshape(-1, 3, n))
    return FilterRun.from_rows(
        model,
        samples,
        noise,
        out,
        innovations,
        covariances=kept if covariances else None,
        log_likelihood=likelihood,
        method="unscented Kalman filter",
    )
