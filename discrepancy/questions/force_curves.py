"""What an estimated force is a function of: position, speed, angle, time, load, or the direction of travel.

A smooth curve over each regressor is fitted to the samples of a force that no model term explains, once as it is and
once with its sign reversed with the direction of travel (friction reverses, gravity and misalignment do not).
Regressors are compared by the variance that they explain in blocks left out of the fit; the null distribution comes
from shuffled blocks.  Regressors that are correlated in these records cannot be distinguished; the aliasing table says
how far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.hat_functions import hat_functions, quantile_knots
from discrepancy.statistics.periodicity import find_period, record_parts
from discrepancy.statistics.thresholds import FEWEST_FORCES

if TYPE_CHECKING:
    import pandas as pd

PARITIES = ("even", "odd")
ALIASED = 0.8
NOT_PERIODIC = ("time", "speed", "load", "acceleration")
# Explained variance that one more knot must bring before a finer curve, or a less simple regressor, is
# preferred.
PER_KNOT = 5e-4


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A force as a function of one regressor, ready to become a table component.

    Attributes
    ----------
    regressor : str
    unit : str
        Unit of the regressor.
    parity : str
        "even": the same in both directions of travel; "odd": multiplied by the direction's sign.
    grid, value, std : ndarray, shape (n,)
        Knots of a piecewise-linear curve, its value and standard error there, in the force's unit.
    period : float or None
        Period of the regressor, if the curve repeats.
    """

    regressor: str
    unit: str
    parity: str
    grid: Array
    value: Array
    std: Array
    period: float | None = None

    def __call__(self, x: Array, direction: Array | None = None) -> Array:
        """Force at regressor values ``x``; an odd curve needs the direction of travel."""
        z = np.asarray(x, dtype=float)
        if self.period is not None:
            z = self.grid[0] + np.mod(z - self.grid[0], self.period)
        out: Array = np.interp(z, self.grid, self.value)
        if self.parity == "odd":
            if direction is None:
                raise ValueError("an odd curve needs the direction of travel")
            out = out * direction
        return out

    def to_frame(self) -> pd.DataFrame:
        """Table of the curve."""
        import pandas as pd

        return pd.DataFrame({f"{self.regressor} [{self.unit}]": self.grid, "value": self.value, "std": self.std})


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """How well one regressor explains the force.

    Attributes
    ----------
    explained : float
        Share of the variance explained in blocks left out of the fit (may be negative).
    p : float
        Probability that the best of all regressors explains as much of a shuffled force.
    aliases : dict
        Other regressor → share of this curve that a curve of the other reproduces in these records.
    """

    regressor: str
    parity: str
    explained: float
    p: float
    curve: Curve
    aliases: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class CurveReport:
    """All regressors, best first."""

    explanations: tuple[Explanation, ...]
    level: float
    n_blocks: int

    @property
    def best(self) -> Explanation | None:
        """The best explanation if it is significant, else None."""
        first = self.explanations[0]
        return first if first.p < self.level and first.explained > 0 else None

    @property
    def statement(self) -> str:
        """The finding and what aliases with it, in a sentence."""
        b = self.best
        if b is None:
            return "the force does not follow any of the regressors significantly"
        turn = ", and turns with the direction of travel" if b.parity == "odd" else ""
        if b.curve.period is not None:
            turn += f", repeating every {b.curve.period:.4g} {b.curve.unit}".rstrip()
        text = (
            f"a function of {b.regressor}{turn} (explains {100 * b.explained:.0f} % of blocks left out, p = {b.p:.2g})"
        )
        same = [f"{k} ({100 * v:.0f} %)" for k, v in sorted(b.aliases.items(), key=lambda i: -i[1]) if v > ALIASED]
        if same:
            text += "; in these records it looks nearly the same over " + ", ".join(same)
        return text

    def to_frame(self) -> pd.DataFrame:
        """Table of the comparison."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "regressor": e.regressor,
                    "parity": e.parity,
                    "explained": e.explained,
                    "p": e.p,
                    **{f"alias {k}": v for k, v in e.aliases.items()},
                }
                for e in self.explanations
            ]
        )

    def __repr__(self) -> str:
        lines = [f"CurveReport: {self.statement}"]
        lines += [
            f"  {e.regressor:16s} {e.parity:5s} explains {100 * e.explained:6.1f} %  p = {e.p:.2g}"
            for e in self.explanations
        ]
        return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class _Basis:
    regressor: str
    parity: str
    knots: Array
    X: Array
    penalty: Array
    period: float | None


def _basis(name: str, x: Array, parity: str, direction: Array, n_knots: int, period: float | None) -> _Basis | None:
    if period is not None:
        knots = np.linspace(0.0, period, n_knots + 1)
        T = hat_functions(np.mod(x, period), knots)
        T[:, 0] += T[:, -1]
        T = T[:, :-1]
        m = T.shape[1]
        D = np.eye(m) - 2 * np.roll(np.eye(m), 1, axis=1) + np.roll(np.eye(m), 2, axis=1)
    else:
        knots = quantile_knots(x, n_knots)
        if len(knots) == 0:
            return None
        T = hat_functions(x, knots)
        # Curvature on the true spacing, so that straight lines cost nothing.
        D = np.zeros((len(knots) - 2, len(knots)))
        h = np.diff(knots) / np.mean(np.diff(knots))
        for i in range(len(knots) - 2):
            D[i, i : i + 3] = [1 / h[i], -1 / h[i] - 1 / h[i + 1], 1 / h[i + 1]]
    X = T * direction[:, None] if parity == "odd" else T
    return _Basis(regressor=name, parity=parity, knots=knots, X=X, penalty=D.T @ D, period=period)


class _Fit:
    """Cross-validated penalised least squares of one basis, for many forces at once."""

    def __init__(self, basis: _Basis, weight: Array, blocks: list[Array], smooth: float) -> None:
        self.basis, self.w, self.blocks = basis, weight, blocks
        X = basis.X
        self.grams = [X[b].T @ (X[b] * weight[b, None]) for b in blocks]
        total = np.sum(self.grams, axis=0)
        m = len(total)
        self.ridge = smooth * np.trace(total) / m * basis.penalty + 1e-6 * np.trace(total) / m * np.eye(m)
        self.total = total
        self.inverse = np.linalg.inv(total + self.ridge)
        self.folds = [np.linalg.inv(total - g + self.ridge) for g in self.grams]

    def rhs(self, F: Array) -> Array:
        """Per-block right-hand sides, shape (n_blocks, m, draws)."""
        X = self.basis.X
        return np.array([X[b].T @ (F[b] * self.w[b, None]) for b in self.blocks])

    def explained(self, F: Array) -> Array:
        """Share of weighted variance explained in left-out blocks, per column of F."""
        r = self.rhs(F)
        total = r.sum(axis=0)
        gain = np.zeros(F.shape[1])
        for inv, g, rb in zip(self.folds, self.grams, r, strict=True):
            c = inv @ (total - rb)
            gain += 2 * np.sum(c * rb, axis=0) - np.sum(c * (g @ c), axis=0)
        energy = np.sum(self.w[:, None] * F**2, axis=0)
        out: Array = gain / np.maximum(energy, 1e-300)
        return out

    def coefficients(self, f: Array) -> Array:
        out: Array = self.inverse @ self.rhs(f[:, None]).sum(axis=0)[:, 0]
        return out

    def std(self, f: Array) -> Array:
        """Block-sandwich standard error of the curve's values."""
        c = self.coefficients(f)
        X = self.basis.X
        scores = np.array([X[b].T @ (self.w[b] * (f[b] - X[b] @ c)) for b in self.blocks])
        n = len(self.blocks)
        cov = self.inverse @ (scores.T @ scores) @ self.inverse * n / max(1, n - 1)
        out: Array = np.sqrt(np.maximum(np.diag(cov), 0.0))
        return out

    def curve(self, f: Array, unit: str) -> Curve:
        c, s = self.coefficients(f), self.std(f)
        b = self.basis
        if b.period is not None:
            c, s = np.append(c, c[0]), np.append(s, s[0])
        return Curve(
            regressor=b.regressor,
            unit=unit,
            parity=b.parity,
            grid=b.knots,
            value=c,
            std=s,
            period=b.period,
        )


def explain_force(
    force: Array,
    regressors: Mapping[str, Array],
    *,
    std: Array | None = None,
    direction: Array | None = None,
    blocks: Array | None = None,
    units: Mapping[str, str] | None = None,
    periods: Mapping[str, float] | None = None,
    n_knots: int = 12,
    draws: int = 200,
    level: float = 0.02,
    seed: int = 0,
) -> CurveReport:
    """Determine what an estimated force is a function of.

    Parameters
    ----------
    force : ndarray, shape (n,), N or N·m
        Estimated force at uniformly sampled times, records one after another.
    regressors : mapping of str to ndarray, shape (n,)
        For instance position, speed, angle, time, load.
    std : ndarray, shape (n,), optional
        Standard error of each sample; used as weights.
    direction : ndarray, shape (n,), optional
        Sign of travel; default from the regressor named "speed", else only even curves are tried.
    blocks : ndarray of int, shape (n,), optional
        Record of each sample. Fewer than eight records are cut further, so that there are at least eight
        pieces.
    units : mapping, optional
        Unit of each regressor.
    periods : mapping, optional
        Period of a regressor that repeats (an angle modulo a turn; from `find_period`).
    n_knots : int
        Knots of each curve.
    draws, level, seed
        Shuffled forces of the null distribution, significance level, and seed.
    """
    f = np.asarray(force, dtype=float)
    n = len(f)
    bad = [f"regressor {k} has {len(v)} values for {n} forces" for k, v in regressors.items() if len(v) != n]
    if not regressors:
        bad.append("no regressor given")
    if n < FEWEST_FORCES:
        bad.append(f"{n} forces are too few; at least {FEWEST_FORCES}")
    if bad:
        raise ValueError("; ".join(bad))
    if direction is None and "speed" in regressors:
        v = np.asarray(regressors["speed"])
        direction = np.tanh(v / max(0.01 * float(np.max(np.abs(v))), 1e-300))
    w = np.ones(n) if std is None else 1.0 / np.maximum(std, 1e-3 * float(np.median(std)) + 1e-300) ** 2
    w = w / np.mean(w)
    f = f - np.sum(w * f) / np.sum(w)
    spans = record_parts(n, blocks)
    fits: list[_Fit] = []
    for name, x in regressors.items():
        for parity in PARITIES if direction is not None and name != "speed" else ("even",):
            d = direction if direction is not None else np.ones(n)
            for knots in (n_knots, 4 * n_knots):
                basis = _basis(name, np.asarray(x, float), parity, d, knots, (periods or {}).get(name))
                if basis is not None:
                    fits.append(_Fit(basis, w, spans, 1e-4))
    period_p: dict[tuple[str, float], float] = {}
    for name, x in regressors.items():
        if name in NOT_PERIODIC or name in (periods or {}) or np.ptp(x) == 0:
            continue
        period, _, p_period = find_period(f, x, blocks=blocks, draws=draws, seed=seed, n_periods=200)
        folded = _basis(name, np.asarray(x, float), "even", np.ones(n), n_knots, period)
        if p_period < level and folded is not None:
            period_p[(name, period)] = p_period
            fits.append(_Fit(folded, w, spans, 1e-4))
    if direction is not None and np.ptp(direction) > 0:
        # A force that only reverses with the direction is an odd curve over anything: offer its simplest form.
        plain = _Basis(
            regressor="direction",
            parity="even",
            knots=np.array([-1.0, 1.0]),
            X=hat_functions(direction, np.array([-1.0, 1.0])),
            penalty=np.zeros((2, 2)),
            period=None,
        )
        fits.append(_Fit(plain, w, spans, 0.0))
    if not fits:
        raise ValueError("every regressor is constant in these records; nothing can be a function of it")
    rng = np.random.default_rng(seed)
    by_chance = _shuffled_best(f, fits, spans, draws, rng)
    out = []
    for fit in fits:
        ev = float(fit.explained(f[:, None])[0])
        p = (1.0 + float(np.sum(by_chance >= ev))) / (draws + 1.0)
        if fit.basis.period is not None:
            # The period was searched for; the search has its own null distribution.
            p = max(p, period_p.get((fit.basis.regressor, fit.basis.period), 0.0))
        shown = fit.basis.X @ fit.coefficients(f)
        aliases: dict[str, float] = {}
        for other in fits:
            if other.basis.regressor == fit.basis.regressor:
                continue
            share = _reproduced(other, shown)
            aliases[other.basis.regressor] = max(share, aliases.get(other.basis.regressor, 0.0))
        unit = (units or {}).get(fit.basis.regressor, "")
        out.append(
            Explanation(
                regressor=fit.basis.regressor,
                parity=fit.basis.parity,
                explained=ev,
                p=p,
                curve=fit.curve(f, unit),
                aliases=aliases,
            )
        )
    out.sort(key=lambda e: -(e.explained - PER_KNOT * len(e.curve.grid)))
    seen: set[tuple[str, str]] = set()
    best: list[Explanation] = []
    for e in out:
        if (e.regressor, e.parity) not in seen:
            seen.add((e.regressor, e.parity))
            best.append(e)
    out = best
    return CurveReport(tuple(out), level, len(spans))


def _shuffled_best(f: Array, fits: list[_Fit], spans: list[Array], draws: int, rng: np.random.Generator) -> Array:
    F = np.empty((len(f), draws))
    for j in range(draws):
        for target, src in zip(spans, rng.permutation(len(spans)), strict=True):
            s = spans[src]
            idx = (rng.integers(len(s)) + np.arange(len(target))) % len(s)
            F[target, j] = f[s[idx]] * rng.choice([-1.0, 1.0])
    return np.max([fit.explained(F) for fit in fits], axis=0)


def _reproduced(fit: _Fit, shown: Array) -> float:
    total = float(np.sum(fit.w * (shown - np.average(shown, weights=fit.w)) ** 2))
    if total <= 0:
        return 0.0
    rest = shown - fit.basis.X @ fit.coefficients(shown)
    return float(np.clip(1.0 - np.sum(fit.w * rest**2) / total, 0.0, 1.0))
