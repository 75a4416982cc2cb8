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

__all__ = ["ExtendedFilter", "extended_kalman_filter"]

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
    compiled = ExtendedFilter(
        model,
        noise,
        discretisation=discretisation,
        square_root=square_root,
        once=once,
        hold=hold,
        substeps=substeps,
        gate=gate,
    )
    check_shapes(model, samples)
    x, p = (prior or Prior()).of(model)
    return compiled(samples, x, compiled.carried(p), keep=keep)


class ExtendedFilter:
    """The extended Kalman filter of one model, set up once and called for block after block of samples.

    Parameters
    ----------
    model, noise
    discretisation, square_root, once, hold, substeps, gate
        As for `extended_kalman_filter`.

    Raises
    ------
    FilterError
        If a setting is not possible.
    """

    def __init__(
        self,
        model: FilterModel,
        noise: Noise,
        *,
        discretisation: Discretisation = "exponential",
        square_root: bool = False,
        once: bool = False,
        hold: bool = False,
        substeps: int = 1,
        gate: float | None = None,
    ):
        faults = []
        if substeps < 1:
            faults.append(f"substeps is {substeps}: give 1 or more")
        if discretisation not in _DISCRETISATION:
            faults.append(f"discretisation is '{discretisation}': take one of {', '.join(_DISCRETISATION)}")
        if faults:
            raise FilterError("filter", faults)
        self.model, self.noise, self.hold = model, noise, hold
        self.q, self.r = noise.of(model)
        self.square_root = square_root
        self.gate = 0.0 if gate is None else float(gate)
        self.settings = (_DISCRETISATION[discretisation], noise.code, square_root, once, hold, substeps)
        self.method = f"extended Kalman filter, {discretisation}{', square root' if square_root else ''}"
        n, ld, m = model.n, model.ld, len(model.measured)
        tall = max(3 * n, len(model.system.outputs)) + m + 8
        self._space = np.zeros(8 * n * ld + tall * ld + 16 * n + 4 * len(model.system.inputs) + 2 * m)
        self._arguments = KernelArguments(model)
        self._q, self._q_root = padded(self.q, ld), padded(root_of(self.q), ld)

    def carried(self, covariance: np.ndarray) -> np.ndarray:
        """Return a covariance, shape (n, n), in the form that is carried from sample to sample, shape (n, ld)."""
        return padded(root_of(covariance) if self.square_root else covariance, self.model.ld)

    @property
    def memory(self) -> tuple[np.ndarray, np.ndarray]:
        """What a later call needs besides state and covariance: the last Jacobian, shape (n ld,), and its balance.

        Both are views: write into them to continue a filter that was saved.
        """
        size = self.model.n * self.model.ld
        return self._space[5 * size : 6 * size], self._arguments.balance

    def __call__(
        self, samples: FilterSamples, x: np.ndarray, p: np.ndarray, *, taken: int = 0, keep: Keep = "variances"
    ) -> FilterRun:
        """Filter samples; state and covariance at the end are written into x and p.

        Parameters
        ----------
        samples : FilterSamples
            With ``taken`` above zero, the first row is the last of the call before.
        x : ndarray, shape (n,)
        p : ndarray, shape (n, ld)
            As `carried` returns it.
        taken : int
            Samples that earlier calls have filtered.
        keep : {"variances", "covariances", "everything"}
        """
        model, count = self.model, samples.count
        n, m = model.n, len(model.measured)
        kept = _KEEP[keep]
        full = (count, n, n) if kept >= COVARIANCES else (1, 1, 1)
        whole = (count, n, n) if kept == EVERYTHING else (1, 1, 1)
        covariances, predicted, transitions = np.empty(full), np.empty(whole), np.empty(whole)
        rows = np.zeros((count, m, n) if kept == EVERYTHING else (1, 1, 1))
        out, innovations = np.empty((count, 3 * n)), np.full((count, 3 * m), np.nan)
        discretisation, kind, root, once, hold, substeps = self.settings
        settings = np.array([discretisation, kind, kept, root, once, hold, substeps, taken], dtype=np.int64)
        verdict = np.zeros(3)
        kernel.extended(
            self._arguments.numbers,
            samples.times,
            samples.inputs,
            samples.readings,
            self.r,
            self._q,
            self._q_root,
            x,
            p,
            settings,
            self.gate,
            out,
            covariances,
            predicted,
            transitions,
            rows,
            innovations,
            self._space,
            verdict,
        )
        self._arguments.raise_python_error()
        likelihood, refused, bad = float(verdict[0]), int(verdict[1]), int(verdict[2])
        if bad >= 0:
            raise diverged(model, samples, out[: bad + 1].reshape(-1, 3, n))
        every = {"predicted": predicted, "transitions": transitions, "rows": rows} if kept == EVERYTHING else {}
        return FilterRun.from_rows(
            model,
            samples,
            self.noise,
            out,
            innovations,
            covariances=covariances if kept >= COVARIANCES else None,
            log_likelihood=likelihood,
            refused=refused,
            kept=every,
            method=self.method,
        )


def root_of(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric square root of a covariance."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
