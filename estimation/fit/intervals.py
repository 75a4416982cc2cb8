"""Parameter intervals that remain valid when the residual is coloured: the block sandwich.

White-noise formulas count every sample as new information. Here whole blocks (trips, or pieces longer than
the correlation time) are the units: each block's contribution to the gradient varies from block to block, and
that variation is the uncertainty.

Coverage of nominal 95 % intervals, measured by ``python -m estimation.fit.intervals`` (least squares with three
parameters, Ornstein–Uhlenbeck noise of 0.5 s in blocks of 5 s, 1000 trials): see docs/method/score-scan.md.

Sources: Bell and McCaffrey (2002), Survey Methodology 28, 169 (the leverage correction for few clusters, of
which the CR3 form of Hansen (2024) is used here); Cameron and Miller (2015), J. Human Resources 50, 317.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class ParameterInterval:
    """Interval of an estimate, from the block sandwich.

    Attributes
    ----------
    covariance : ndarray, shape (p, p)
    std : ndarray, shape (p,)
    quantile : float
        Student quantile; the interval is estimate ± quantile · std.
    n_blocks : int
    dof : float
    statement : str
        Basis of the interval, with a warning when there are few blocks.
    """

    covariance: Array
    std: Array
    quantile: float
    n_blocks: int
    dof: float
    statement: str

    @property
    def half_width(self) -> Array:
        """Half width of the interval, in the parameters' units."""
        out: Array = self.quantile * self.std
        return out


def block_sandwich(
    jacobians: Sequence[Array],
    residuals: Sequence[Array],
    prior_information: Array | None = None,
    level: float = 0.95,
    columns: Sequence[Array] | None = None,
) -> ParameterInterval:
    """Covariance of a least-squares estimate from the scores of whole blocks.

    Parameters
    ----------
    jacobians : sequence of ndarray, shape (n_b, c)
        Derivative of each block's (weighted) residual with respect to the parameters, at the solution.
    residuals : sequence of ndarray, shape (n_b,)
        (Weighted) residuals at the solution.
    prior_information : ndarray, shape (p, p), optional
        Inverse prior covariance in the same weighting; its variance counts as known.
    level : float
        Confidence level.
    columns : sequence of ndarray of int, shape (c,), optional
        Which of the p parameters each block depends on; default: all.  With the initial states of hundreds of windows
        among them, the work of a block is that of the few it depends on.

    Raises
    ------
    ValueError
        With fewer than two blocks: cut long records into pieces first (`split_blocks`).

    Notes
    -----
    Each block's score is corrected for the block's own leverage (the CR3 correction, the same as leaving the
    block out), and the quantile is Student's with one degree of freedom less than there
    are blocks.
    """
    from scipy.stats import t as student

    n = len(jacobians)
    if n < 2:
        raise ValueError("the block sandwich needs at least two blocks; cut the record with split_blocks")
    if columns is None:
        columns = [np.arange(J.shape[1]) for J in jacobians]
    p = 1 + max(int(np.max(of, initial=-1)) for of in columns)
    H_data = np.zeros((p, p))
    H_b = [J.T @ J for J in jacobians]
    for h, of in zip(H_b, columns, strict=True):
        H_data[np.ix_(of, of)] += h
    P = np.zeros((p, p)) if prior_information is None else prior_information
    H = H_data + P
    # Work in a scale in which the normal matrix has a unit diagonal: units differ by many orders.
    d = np.sqrt(np.where(np.diag(H) > 0, np.diag(H), 1.0))
    Hs = H / np.outer(d, d)
    Hi = np.linalg.pinv(Hs, rcond=1e-12)
    meat = np.zeros((p, p))
    for J, r, h, of in zip(jacobians, residuals, H_b, columns, strict=True):
        s = (J.T @ r) / d[of]
        leave = np.eye(of.size) - (h / np.outer(d[of], d[of])) @ Hi[np.ix_(of, of)]
        u, sv, vt = np.linalg.svd(leave)
        s = vt.T @ ((u.T @ s) / np.maximum(sv, 0.05))
        meat[np.ix_(of, of)] += np.outer(s, s)
    meat *= (n - 1) / n
    cov = Hi @ (meat + P / np.outer(d, d)) @ Hi / np.outer(d, d)
    dof = float(n - 1)
    text = f"block sandwich, {n} blocks, Student t with {n - 1} degrees of freedom"
    if n < 6:
        text += "; with fewer than six blocks the interval is wide and its coverage only approximate"
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    return ParameterInterval(
        covariance=cov,
        std=std,
        quantile=float(student.ppf(0.5 + level / 2, dof)),
        n_blocks=n,
        dof=dof,
        statement=text,
    )


def split_blocks(arrays: Sequence[Array], pieces: int) -> list[Array]:
    """Cut each array along time into about ``pieces`` parts in total, proportionally to length."""
    total = sum(len(a) for a in arrays)
    out: list[Array] = []
    for a in arrays:
        k = max(1, round(pieces * len(a) / total))
        out += [np.asarray(part) for part in np.array_split(a, k)]
    return out


def measure_coverage(
    n_blocks: int,
    trials: int = 1000,
    seed: int = 0,
    tau: float = 0.5,
    duration: float = 5.0,
    dt: float = 0.01,
) -> tuple[float, float]:
    """Coverage of 95 % intervals, (block sandwich, white-noise formula), mean over three parameters."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    n = round(duration / dt)
    phi = np.exp(-dt / tau)
    hit = np.zeros(2)
    for _ in range(trials):
        J, y = [], []
        for _ in range(n_blocks):
            t = np.arange(n) * dt
            v = np.sin(2 * np.pi * rng.uniform(0.2, 0.5) * t + rng.uniform(0, 6)) * rng.uniform(0.3, 1.0)
            J.append(np.column_stack([v, np.sign(v), np.gradient(v, dt)]))
            ou = lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal(n + 500))[500:]
            y.append(ou + 0.2 * rng.standard_normal(n))
        A, b = np.concatenate(J), np.concatenate(y)
        est = np.linalg.lstsq(A, b, rcond=None)[0]
        res = [yb - Jb @ est for Jb, yb in zip(J, y, strict=True)]
        iv = block_sandwich(J, res)
        hit[0] += np.mean(np.abs(est) < iv.half_width)
        s2 = sum(float(r @ r) for r in res) / (len(b) - 3)
        hit[1] += np.mean(np.abs(est) < 1.96 * np.sqrt(s2 * np.diag(np.linalg.inv(A.T @ A))))
    return float(hit[0] / trials), float(hit[1] / trials)


def main() -> None:
    """Write the coverage table to standard output."""
    import sys

    for n in (3, 4, 6, 8, 12, 20):
        robust, white = measure_coverage(n)
        sys.stdout.write(f"{n:3d} blocks: sandwich {100 * robust:5.1f} %   white noise {100 * white:5.1f} %\n")


if __name__ == "__main__":
    main()
