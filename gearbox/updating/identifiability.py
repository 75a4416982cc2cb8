"""Which directions of the parameters are identifiable from recordings, and which are not.

At a point of the parameters the compared numbers are linearised.  What a lag of each recording and a gain of each
sensor can imitate is taken out; the singular values of the rest say how far each direction of the (scaled) parameters
may move before the recordings would notice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gearbox.updating.objectives import AmplitudeObjective
from gearbox.updating.runs import Runs
from surrogate import DesignSpace

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Identifiability", "identifiability"]

Array = NDArray[np.float64]

#: A direction counts as identifiable if its standard deviation is below this share of the parameter ranges: a uniform
#: distribution over a range, which is what is known without any recording, has 0.289.
LIMIT = 0.15


@dataclass(frozen=True, eq=False, kw_only=True)
class Identifiability:
    """Directions in the scaled parameters, best known first.

    Parameters
    ----------
    space : DesignSpace
    point : ndarray, shape (k,)
        Where it was linearised, in the parameters' units.
    directions : ndarray, shape (k, k)
        One unit vector a row, in parameters scaled to their ranges.
    std : ndarray, shape (k,)
        Standard deviation along each direction, in shares of the ranges; infinite where nothing is seen.
    noise : float
        Standard deviation assumed for each compared number, relative to its sensor's size.
    numbers : int
        Independent real numbers compared, after lags and gains.
    what : str
        What was compared.
    """

    space: DesignSpace
    point: Array
    directions: Array
    std: Array
    noise: float
    numbers: int
    what: str

    @property
    def lost(self) -> tuple[int, ...]:
        """Rows of directions that cannot be identified."""
        return tuple(int(i) for i in np.flatnonzero(~(self.std < LIMIT)))

    def words(self, row: int) -> str:
        """A direction in words, such as ``0.82 K + 0.57 e_F`` (shares of the ranges)."""
        v = self.directions[row]
        v = v * np.sign(v[np.abs(v).argmax()])
        parts = [(w, n) for w, n in zip(v, self.space.names, strict=True) if abs(w) >= 0.1]
        parts.sort(key=lambda part: -abs(part[0]))
        text = " ".join(f"{'+' if w > 0 else '−'} {abs(w):.2f} {n}" for w, n in parts)
        return text.removeprefix("+ ")

    def describe(self) -> str:
        """Return one sentence on the directions that are not identifiable."""
        if not self.lost:
            return f"{self.what}: every direction of {', '.join(self.space.names)} is identifiable"
        lost = "; ".join(f"{self.words(i)} (std {_share(self.std[i])})" for i in self.lost)
        return f"{self.what}: not identifiable: {lost}"

    def to_frame(self) -> pd.DataFrame:
        """One row for each direction."""
        import pandas as pd

        return pd.DataFrame(
            {
                "direction (in shares of the ranges)": [self.words(i) for i in range(len(self.std))],
                "std [share of range]": self.std,
                "identifiable": self.std < LIMIT,
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain content, for JSON."""
        return {
            "what": self.what,
            "at": dict(zip(self.space.names, self.point.tolist(), strict=True)),
            "noise": self.noise,
            "numbers": self.numbers,
            "directions": [
                {
                    "words": self.words(i),
                    "vector": dict(zip(self.space.names, self.directions[i].tolist(), strict=True)),
                    "std": float(self.std[i]) if np.isfinite(self.std[i]) else None,
                    "identifiable": bool(self.std[i] < LIMIT),
                }
                for i in range(len(self.std))
            ],
        }


def _share(std: float) -> str:
    return f"{100 * std:.0f} % of the ranges" if std < 10.0 else "beyond all bounds"


def identifiability(
    objective: AmplitudeObjective,
    runs: Runs,
    space: DesignSpace,
    point: Mapping[str, float],
    *,
    noise: float,
    step: float = 0.04,
    fixed: Mapping[str, float] | None = None,
    what: str = "",
) -> Identifiability:
    """Find the directions of the parameters that an objective's numbers determine.

    Parameters
    ----------
    objective : AmplitudeObjective
        Its lags are always free; its gains if ``free_gain``.
    runs : Runs
        2 k runs at each condition are needed.
    space : DesignSpace
    point : mapping of str to float
        Where to linearise.
    noise : float
        Standard deviation of each compared number relative to its sensor's size.  Take what is left at the best point:
        it holds what the model lacks as well as sensor noise.
    step : float
        Half the step of the central differences, in shares of the ranges.
    fixed : mapping of str to float, optional
        Parameters that are not in the space.
    what : str
        What was compared, for texts.
    """
    if not noise > 0.0:
        raise ValueError(f"noise is {noise}: give a standard deviation above zero")
    names = space.names
    centre = space.to_unit(np.array([[point[n] for n in names]]), inside=True)[0]
    corners, spans = [], []
    for i in range(len(names)):
        low, high = centre.copy(), centre.copy()
        low[i], high[i] = max(centre[i] - step, 0.0), min(centre[i] + step, 1.0)
        corners += [low, high]
        spans.append(high[i] - low[i])
    rows = [dict(zip(names, x.tolist(), strict=True)) for x in space.from_unit(np.array([centre, *corners]))]
    wanted = [({**(fixed or {}), **row}, c) for row in rows for c in objective.conditions]
    made = runs.many(wanted, "identifiable directions")
    conditions = len(objective.conditions)
    failed = next((r for r in made if r.failed), None)
    if failed is not None:
        raise ValueError(f"a run near the optimum failed: {failed.error}")
    models = [objective.of_runs(made[i * conditions : (i + 1) * conditions]) for i in range(len(rows))]
    jacobian = np.column_stack([_real((models[2 + 2 * i] - models[1 + 2 * i]) / spans[i]) for i in range(len(names))])
    nuisance = _nuisance(objective, models[0])
    basis, values, _ = np.linalg.svd(nuisance, full_matrices=False)
    basis = basis[:, values > 1e-9 * values[0]]
    free = jacobian - basis @ (basis.T @ jacobian)
    _, singular, rows_v = np.linalg.svd(free, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(len(names) - singular.size)])
    left = jacobian.shape[0] - basis.shape[1]
    if left < len(names):
        singular[max(left, 0) :] = 0.0
    # Rounding of the differences is no knowledge.
    singular = np.where(singular > 1e-8 * max(float(np.abs(jacobian).max()), 1e-300), singular, 0.0)
    with np.errstate(divide="ignore"):
        std = noise / singular
    return Identifiability(
        space=space,
        point=np.array([point[n] for n in names]),
        directions=rows_v[: len(names)],
        std=std,
        noise=noise,
        numbers=max(left, 0),
        what=what,
    )


def _real(table: NDArray[np.complex128]) -> Array:
    return np.concatenate([table.real.ravel(), table.imag.ravel()])


def _nuisance(objective: AmplitudeObjective, model: NDArray[np.complex128]) -> Array:
    """What lags (and gains) can do to the numbers, one column each."""
    k = np.asarray(objective.orders)
    columns = []
    for r in range(model.shape[0]):
        turned = np.zeros_like(model)
        turned[r] = 2j * np.pi * k * model[r]
        columns.append(_real(turned))
    if objective.free_gain:
        for s in range(model.shape[1]):
            scaled = np.zeros_like(model)
            scaled[:, s] = model[:, s]
            columns.append(_real(scaled))
    return np.column_stack(columns)
