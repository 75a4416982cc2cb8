"""The unscented Kalman filter: the extended filter's peer, which needs no derivatives.

S. J. Julier, J. K. Uhlmann: Unscented filtering and nonlinear estimation, Proc. IEEE 92 (2004).
"""

from __future__ import annotations

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.extended_kalman import Keep
from estimation.filters.kernel_arguments import KernelArguments, check_shapes, diverged, padded
from estimation.filters.kernels import unscented as kernel
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.run import FilterRun
from estimation.filters.samples import FilterSamples

__all__ = ["UnscentedFilter", "unscented_kalman_filter"]


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
    compiled = UnscentedFilter(model, noise, alpha=alpha, beta=beta, kappa=kappa, hold=hold, substeps=substeps)
    check_shapes(model, samples)
    x, p = (prior or Prior()).of(model)
    return compiled(samples, x, compiled.carried(p), keep="covariances" if covariances else "variances")


class UnscentedFilter:
    """The unscented Kalman filter of one model, set up once and called for block after block of samples.

    Parameters
    ----------
    model, noise
    alpha, beta, kappa, hold, substeps
        As for `unscented_kalman_filter`.

    Raises
    ------
    FilterError
        If a setting is not possible.
    """

    square_root = False
    gate = 0.0

    def __init__(
        self,
        model: FilterModel,
        noise: Noise,
        *,
        alpha: float = 1.0,
        beta: float = 0.0,
        kappa: float = 0.0,
        hold: bool = False,
        substeps: int = 1,
    ):
        whole = alpha**2 * (model.n + kappa)
        if not whole > 0.0:
            raise FilterError("unscented filter", [f"alpha² (n + kappa) is {whole:g}: it must be positive"])
        first = (whole - model.n) / whole
        self.model, self.noise, self.hold = model, noise, hold
        self.q, self.r = noise.of(model)
        self.settings = ("unscented", noise.code, hold, substeps, alpha, beta, kappa)
        self._reach = float(np.sqrt(whole))
        self._weights = np.array([first, first + 1.0 - alpha**2 + beta, 0.5 / whole])
        n, m = model.n, len(model.measured)
        size = n * model.ld + (2 * n + 1) * (n + m) + 8 * n + 4 * len(model.system.inputs) + m + m * m + n * m + n
        self._space = np.zeros(size + 8)
        self._arguments = KernelArguments(model)
        self._q = padded(self.q, model.ld)
        self._nothing = np.zeros(0)

    def carried(self, covariance: np.ndarray) -> np.ndarray:
        """Return a covariance, shape (n, n), in the form that is carried from sample to sample, shape (n, ld)."""
        return padded(covariance, self.model.ld)

    @property
    def memory(self) -> tuple[np.ndarray, np.ndarray]:
        """What a later call needs besides state and covariance: nothing."""
        return self._nothing, self._nothing

    def __call__(
        self, samples: FilterSamples, x: np.ndarray, p: np.ndarray, *, taken: int = 0, keep: Keep = "variances"
    ) -> FilterRun:
        """Filter samples; state and covariance at the end are written into x and p.

        Parameters
        ----------
        samples : FilterSamples
            With ``taken`` above zero, the first row is the last of the call before, without its readings.
        x : ndarray, shape (n,)
        p : ndarray, shape (n, ld)
        taken : int
            Samples that earlier calls have filtered; what is computed does not depend on it.
        keep : {"variances", "covariances"}
        """
        if keep == "everything":
            raise FilterError("unscented filter", ['keep="everything" is for the extended filter: it has no Jacobians'])
        model, count = self.model, samples.count
        n, m = model.n, len(model.measured)
        covariances = keep == "covariances"
        kept = np.empty((count, n, n) if covariances else (1, 1, 1))
        out, innovations = np.empty((count, 3 * n)), np.full((count, 3 * m), np.nan)
        verdict = np.zeros(2)
        kernel.unscented(
            self._arguments.numbers,
            samples.times,
            samples.inputs,
            samples.readings,
            self.r,
            self._q,
            x,
            p,
            np.array([self.noise.code, int(covariances), self.hold, self.settings[3]], dtype=np.int64),
            self._reach,
            self._weights,
            out,
            kept,
            innovations,
            self._space,
            verdict,
        )
        self._arguments.raise_python_error()
        likelihood, bad = float(verdict[0]), int(verdict[1])
        if bad >= 0:
            raise diverged(model, samples, out[: bad + 1].reshape(-1, 3, n))
        return FilterRun.from_rows(
            model,
            samples,
            self.noise,
            out,
            innovations,
            covariances=kept if covariances else None,
            log_likelihood=likelihood,
            method="unscented Kalman filter",
        )
