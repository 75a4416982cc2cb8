"""Nonlinear regression problems with certified results, and the digits that a fit reaches.

Data and certified values: NIST/ITL Statistical Reference Datasets, Nonlinear Regression, in ``nist_strd/`` as NIST
publishes them (public domain; the files name the sources of the data).  A digit is one of the log relative error,
-log10(|found - certified| / |certified|), of the worst parameter; more than eleven were not certified.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimation.fit.least_squares import Piece, Solution, solve

FOLDER = Path(__file__).parent / "nist_strd"

#: The right-hand side of each dataset's model, in the names that its file uses.
MODELS = {
    "Bennett5": "b1 * (b2 + x) ** (-1 / b3)",
    "BoxBOD": "b1 * (1 - exp(-b2 * x))",
    "Chwirut1": "exp(-b1 * x) / (b2 + b3 * x)",
    "Chwirut2": "exp(-b1 * x) / (b2 + b3 * x)",
    "DanWood": "b1 * x**b2",
    "ENSO": (
        "b1 + b2 * cos(2 * pi * x / 12) + b3 * sin(2 * pi * x / 12)"
        " + b5 * cos(2 * pi * x / b4) + b6 * sin(2 * pi * x / b4)"
        " + b8 * cos(2 * pi * x / b7) + b9 * sin(2 * pi * x / b7)"
    ),
    "Eckerle4": "b1 / b2 * exp(-0.5 * ((x - b3) / b2) ** 2)",
    "Gauss1": "b1 * exp(-b2 * x) + b3 * exp(-((x - b4) ** 2) / b5**2) + b6 * exp(-((x - b7) ** 2) / b8**2)",
    "Gauss2": "b1 * exp(-b2 * x) + b3 * exp(-((x - b4) ** 2) / b5**2) + b6 * exp(-((x - b7) ** 2) / b8**2)",
    "Gauss3": "b1 * exp(-b2 * x) + b3 * exp(-((x - b4) ** 2) / b5**2) + b6 * exp(-((x - b7) ** 2) / b8**2)",
    "Hahn1": "(b1 + b2 * x + b3 * x**2 + b4 * x**3) / (1 + b5 * x + b6 * x**2 + b7 * x**3)",
    "Kirby2": "(b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2)",
    "Lanczos1": "b1 * exp(-b2 * x) + b3 * exp(-b4 * x) + b5 * exp(-b6 * x)",
    "Lanczos2": "b1 * exp(-b2 * x) + b3 * exp(-b4 * x) + b5 * exp(-b6 * x)",
    "Lanczos3": "b1 * exp(-b2 * x) + b3 * exp(-b4 * x) + b5 * exp(-b6 * x)",
    "MGH09": "b1 * (x**2 + x * b2) / (x**2 + x * b3 + b4)",
    "MGH10": "b1 * exp(b2 / (x + b3))",
    "MGH17": "b1 + b2 * exp(-x * b4) + b3 * exp(-x * b5)",
    "Misra1a": "b1 * (1 - exp(-b2 * x))",
    "Misra1b": "b1 * (1 - (1 + b2 * x / 2) ** (-2))",
    "Misra1c": "b1 * (1 - (1 + 2 * b2 * x) ** (-0.5))",
    "Misra1d": "b1 * b2 * x / (1 + b2 * x)",
    "Nelson": "b1 - b2 * x1 * exp(-b3 * x2)",
    "Rat42": "b1 / (1 + exp(b2 - b3 * x))",
    "Rat43": "b1 / (1 + exp(b2 - b3 * x)) ** (1 / b4)",
    "Roszman1": "b1 - b2 * x - atan(b3 / (x - b4)) / pi",
    "Thurber": "(b1 + b2 * x + b3 * x**2 + b4 * x**3) / (1 + b5 * x + b6 * x**2 + b7 * x**3)",
}
#: Step of the complex-step derivative: no difference is formed, so it may be as small as this.
COMPLEX_STEP = 1e-150
CERTIFIED_DIGITS = 11.0


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """One dataset: data, the two starts, certified parameters, their standard deviations and the sum of squares."""

    name: str
    level: str
    y: np.ndarray
    x: dict[str, np.ndarray]
    starts: tuple[np.ndarray, np.ndarray]
    certified: np.ndarray
    deviations: np.ndarray
    squares: float

    def model(self, b: np.ndarray) -> np.ndarray:
        """Return the model's values at parameters that may be complex."""
        names = {f"b{k + 1}": value for k, value in enumerate(b)}
        functions = {"exp": np.exp, "sin": np.sin, "cos": np.cos, "atan": np.arctan, "pi": np.pi}
        with np.errstate(all="ignore"):  # a trial far away may overflow; the fit then refuses it
            return np.asarray(eval(MODELS[self.name], {"__builtins__": {}}, {**functions, **names, **self.x}))

    def jacobian(self, b: np.ndarray) -> np.ndarray:
        """Return the derivatives of the model by its parameters, by complex steps."""
        steps = 1j * COMPLEX_STEP * np.eye(b.size)
        return np.column_stack([self.model(b + step).imag / COMPLEX_STEP for step in steps])


@dataclass(frozen=True, kw_only=True)
class Digits:
    """The digits reached: worst parameter, worst standard deviation, sum of squares."""

    parameters: float
    deviations: float
    squares: float


def read(name: str) -> Dataset:
    """Read a dataset as NIST publishes it."""
    lines = (FOLDER / f"{name}.dat").read_text(encoding="ascii").splitlines()
    rows = [line.split() for line in lines[40:60]]
    table = np.array([row[2:] for row in rows if len(row) == 6 and row[1] == "="], dtype=float)
    squares = next(float(line.split()[-1]) for line in lines if line.startswith("Residual Sum of Squares"))
    data = np.array([line.split() for line in lines[60:] if line.strip()], dtype=float)
    level = next(line.split()[0] for line in lines if "Level of Difficulty" in line)
    names = ["x"] if data.shape[1] == 2 else ["x1", "x2"]
    return Dataset(
        name=name,
        level=level.lower(),
        y=np.log(data[:, 0]) if name == "Nelson" else data[:, 0],  # the file says: log[y] = ...
        x=dict(zip(names, data[:, 1:].T, strict=True)),
        starts=(table[:, 0], table[:, 1]),
        certified=table[:, 2],
        deviations=table[:, 3],
        squares=squares,
    )


def fit(dataset: Dataset, start: np.ndarray, tolerance: float, max_evaluations: int) -> Solution:
    """Fit a dataset by the least squares that `estimation.fit.calibrate` uses."""

    def residuals(b: np.ndarray) -> list[np.ndarray] | None:
        error = dataset.model(b) - dataset.y
        return [error] if np.all(np.isfinite(error)) else None

    def pieces(b: np.ndarray) -> list[Piece]:
        return [Piece(dataset.jacobian(b), np.arange(b.size), dataset.model(b) - dataset.y)]

    free = np.full(start.size, np.inf)
    return solve(residuals, pieces, start, -free, free, tolerance=tolerance, max_evaluations=max_evaluations)


def digits_at(dataset: Dataset, b: np.ndarray) -> Digits:
    """Return the digits that parameters, their standard deviations, and the sum of squares have."""
    error = dataset.model(b) - dataset.y
    squares = float(error @ error)
    inverse = np.linalg.pinv(np.linalg.qr(dataset.jacobian(b), mode="r"), rcond=0.0)
    deviations = np.sqrt(squares / (error.size - b.size) * np.sum(inverse**2, axis=1))
    return Digits(
        parameters=digits(b, dataset.certified),
        deviations=digits(deviations, dataset.deviations),
        squares=digits(np.array([squares]), np.array([dataset.squares])),
    )


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Return the log relative error of the worst number, between 0 and what was certified."""
    worst = float(np.max(np.abs(found - certified) / np.abs(certified)))
    return CERTIFIED_DIGITS if worst == 0.0 else float(np.clip(-np.log10(worst), 0.0, CERTIFIED_DIGITS))
