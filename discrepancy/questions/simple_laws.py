"""Simple laws that resemble an unknown curve: a short list, compared by their error on blocks left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from discrepancy.questions.force_curves import Curve
from discrepancy.statistics.blocks import Array
from discrepancy.statistics.hat_functions import hat_functions
from discrepancy.statistics.periodicity import record_parts


@dataclass(frozen=True, kw_only=True)
class Law:
    """A fitted law.

    Attributes
    ----------
    name, formula : str
    parameters : dict
    error : float
        Root mean square error on blocks left out, in the force's unit.
    curve_error : float
        The same for the free curve, which stays the reference.
    """

    name: str
    formula: str
    parameters: dict[str, float]
    error: float
    curve_error: float

    @property
    def as_good_as_curve(self) -> bool:
        """True if the law predicts blocks left out within 2 % of the free curve."""
        return self.error <= 1.02 * self.curve_error


def _grid(x: Array, lo: float, hi: float, n: int = 12) -> Array:
    s = float(np.max(np.abs(x))) or 1.0
    return np.geomspace(lo * s, hi * s, n)


def _catalogue(
    x: Array,
) -> dict[str, tuple[str, tuple[str, ...], list[dict[str, float]], Callable[..., Array]]]:
    """name → formula, linear parameters, grid of nonlinear ones, columns."""
    span = float(np.ptp(x)) or 1.0
    places = np.linspace(float(x.min()), float(x.max()), 15)
    soft = 0.01 * (float(np.max(np.abs(x))) or 1.0)

    def sign(z: Array) -> Array:
        return np.tanh(z / soft)

    return {
        "constant": ("a", ("a",), [{}], lambda z: np.ones((len(z), 1))),
        "sign": ("a + b·sign(x)", ("a", "b"), [{}], lambda z: np.column_stack([np.ones_like(z), sign(z)])),
        "linear": ("a + b·x", ("a", "b"), [{}], lambda z: np.column_stack([np.ones_like(z), z])),
        "quadratic": (
            "a + b·x + c·x²",
            ("a", "b", "c"),
            [{}],
            lambda z: np.column_stack([np.ones_like(z), z, z * z]),
        ),
        "cubic": (
            "a + b·x + c·x³",
            ("a", "b", "c"),
            [{}],
            lambda z: np.column_stack([np.ones_like(z), z, z**3]),
        ),
        "tanh": (
            "a + b·tanh(x/s)",
            ("a", "b"),
            [{"s": float(s)} for s in _grid(x, 0.02, 1.0)],
            lambda z, s: np.column_stack([np.ones_like(z), np.tanh(z / s)]),
        ),
        "Stribeck": (
            "a + sign(x)·(b + c·exp(−(x/s)²))",
            ("a", "b", "c"),
            [{"s": float(s)} for s in _grid(x, 0.02, 0.7)],
            lambda z, s: np.column_stack([np.ones_like(z), sign(z), sign(z) * np.exp(-((z / s) ** 2))]),
        ),
        "sine": (
            "a + b·cos(2πx/L) + c·sin(2πx/L)",
            ("a", "b", "c"),
            [{"L": float(v)} for v in 1.0 / np.linspace(0.7 / span, 40.0 / span, 160)],
            lambda z, L: np.column_stack([np.ones_like(z), np.cos(2 * np.pi * z / L), np.sin(2 * np.pi * z / L)]),
        ),
        "bump": (
            "a + b·exp(−½((x−m)/w)²)",
            ("a", "b"),
            [{"m": float(m), "w": float(w)} for m in places for w in span * np.array([0.02, 0.05, 0.1, 0.2])],
            lambda z, m, w: np.column_stack([np.ones_like(z), np.exp(-0.5 * ((z - m) / w) ** 2)]),
        ),
    }


def law_values(law: Law, x: Array) -> Array:
    """Return a law's force at values of its regressor, shape (n,), as if travelling forwards.

    Parameters
    ----------
    law : Law
    x : ndarray, shape (n,)
        Over the range for which the law was fitted, ends included.
    """
    _, linear, grid, columns = _catalogue(x)[law.name]
    values: Array = columns(x, **{k: law.parameters[k] for k in grid[0]}) @ [law.parameters[k] for k in linear]
    return values


def suggest_laws(
    force: Array, x: Array, curve: Curve, *, direction: Array | None = None, blocks: Array | None = None
) -> list[Law]:
    """Simple laws for a force over its regressor, best first; the free curve remains the reference.

    Parameters
    ----------
    force, x : ndarray, shape (n,)
        Force and regressor.
    curve : Curve
        From `explain_force`; an odd one makes the laws odd as well.
    direction : ndarray, shape (n,), optional
        Sign of travel, needed for an odd curve.
    blocks : ndarray of int, shape (n,), optional
        Record of each sample.
    """
    f, x = np.asarray(force, float), np.asarray(x, float)
    turn = direction if curve.parity == "odd" and direction is not None else np.ones_like(f)
    spans = record_parts(len(f), blocks)
    knots = curve.grid

    def held_out(columns: Array) -> float:
        total, err = columns.T @ columns, 0.0
        rhs = columns.T @ f
        eps = 1e-9 * np.trace(total) * np.eye(len(total))
        for s in spans:
            c = np.linalg.solve(total - columns[s].T @ columns[s] + eps, rhs - columns[s].T @ f[s])
            err += float(np.sum((f[s] - columns[s] @ c) ** 2))
        return float(np.sqrt(err / len(f)))

    z = np.mod(x, curve.period) if curve.period else x
    free = held_out(hat_functions(z, knots) * turn[:, None])
    out = []
    for name, (formula, linear, grid, columns) in _catalogue(x).items():
        fits = [(held_out(columns(x, **g) * turn[:, None]), g) for g in grid]
        err, g = min(fits, key=lambda t: t[0])
        A = columns(x, **g) * turn[:, None]
        c = np.linalg.lstsq(A, f, rcond=1e-10)[0]
        out.append(
            Law(
                name=name,
                formula=formula,
                parameters={**dict(zip(linear, c.tolist(), strict=True)), **g},
                error=err,
                curve_error=free,
            )
        )
    return sorted(out, key=lambda law: law.error)
