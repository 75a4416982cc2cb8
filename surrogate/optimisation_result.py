"""The result of an optimisation: the best point, how it was reached, and at what cost."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surrogate.plots import plot_history
from surrogate.space import DesignSpace

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["OptimisationResult", "StopReason"]

Array = NDArray[np.float64]


class StopReason(Enum):
    """Why an optimiser stopped."""

    BUDGET = "the evaluations allowed were used up"
    ITERATIONS = "the iterations asked for were done"
    CONVERGED = "the method's own measure of convergence was met"


@dataclass(frozen=True, kw_only=True)
class OptimisationResult:
    """Outcome of :func:`surrogate.maximise`.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    method : str
        Which method searched.
    x : ndarray, shape (k,)
        Best point, in the parameters' units.
    value : float
        The function there.
    evaluations, gradient_evaluations : int
        Calls of the function (one for each point) and of its gradient, the polish included.
    failed : int
        Evaluations that gave no finite number.
    improved_at : ndarray, shape (m,)
        Number of evaluations at each improvement.
    improved_to : ndarray, shape (m,)
        Best value from there on.
    value_before_polish : float
        Best value of the search alone; equal to ``value`` without polish.
    stopped : StopReason
    options : dict
        Settings of the method, as used.
    """

    space: DesignSpace
    method: str
    x: Array
    value: float
    evaluations: int
    gradient_evaluations: int
    failed: int
    improved_at: NDArray[np.int64]
    improved_to: Array
    value_before_polish: float
    stopped: StopReason
    options: dict[str, Any]

    @property
    def parameters(self) -> dict[str, float]:
        """The best point by name."""
        return dict(zip(self.space.names, self.x.tolist(), strict=True))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Parameters that stand at a bound: the optimum may lie outside."""
        t = self.space.to_unit(self.x)[0]
        return tuple(n for n, v in zip(self.space.names, t, strict=True) if v < 1e-6 or v > 1.0 - 1e-6)

    def best_after(self, evaluations: int) -> float:
        """Best value within so many evaluations; −inf before the first success."""
        index = int(np.searchsorted(self.improved_at, evaluations, side="right")) - 1
        return float(self.improved_to[index]) if index >= 0 else float("-inf")

    def to_frame(self) -> pd.DataFrame:
        """Best value against evaluations."""
        import pandas as pd

        at = np.append(self.improved_at, self.evaluations)
        to = np.append(self.improved_to, self.value)
        frame = pd.DataFrame({"evaluations": at, "best": to})
        return frame.drop_duplicates("evaluations", keep="last", ignore_index=True)

    def to_dict(self) -> dict[str, Any]:
        """Plain content, for JSON."""
        return {
            "method": self.method,
            "parameters": self.parameters,
            "units": dict(zip(self.space.names, self.space.units, strict=True)),
            "value": self.value,
            "value_before_polish": self.value_before_polish,
            "evaluations": self.evaluations,
            "gradient_evaluations": self.gradient_evaluations,
            "failed": self.failed,
            "at_bound": list(self.at_bound),
            "stopped": self.stopped.name.lower(),
            "history": {"evaluations": self.improved_at.tolist(), "best": self.improved_to.tolist()},
            "options": self.options,
        }

    def plot(self) -> Figure:
        """Best value against evaluations; returns the figure."""
        return plot_history([self])

    def __repr__(self) -> str:
        at = ", ".join(
            f"{n} = {v:.6g}{' ' + u if u else ''}"
            for n, v, u in zip(self.space.names, self.x, self.space.units, strict=True)
        )
        text = f"{self.method}: {self.value:.6g} at {at} after {self.evaluations} evaluations; "
        text += self.stopped.value
        if self.at_bound:
            text += f"; at its bound: {', '.join(self.at_bound)}"
        return f"OptimisationResult({text})"
