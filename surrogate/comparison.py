"""Optimisers compared at equal numbers of evaluations, over many seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from surrogate.methods import SEARCHES
from surrogate.optimisation_result import OptimisationResult
from surrogate.optimise import METHODS, maximise
from surrogate.plots import plot_history
from surrogate.space import DesignSpace

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["OptimiserComparison", "compare_optimisers"]


@dataclass(frozen=True)
class OptimiserComparison:
    """Runs of several methods on one function.

    Parameters
    ----------
    results : dict of str to tuple of OptimisationResult
        Runs of each method, one for each seed.
    target : float
        The value that a run must reach, the tolerance already subtracted.
    """

    results: dict[str, tuple[OptimisationResult, ...]]
    target: float

    def hit_rate(self, method: str) -> float:
        """Share of the runs that reached the target."""
        return float(np.mean([run.value >= self.target for run in self.results[method]]))

    def to_frame(self) -> pd.DataFrame:
        """Hit rate with and without polish, values, and evaluations needed to reach the target."""
        import pandas as pd

        rows = []
        for method, runs in self.results.items():
            values = np.array([run.value for run in runs])
            needed = [
                int(run.improved_at[int(np.argmax(run.improved_to >= self.target))])
                for run in runs
                if run.value >= self.target
            ]
            rows.append(
                {
                    "method": method,
                    "runs": len(runs),
                    "hit_rate": self.hit_rate(method),
                    "hit_rate_before_polish": np.mean([r.value_before_polish >= self.target for r in runs]),
                    "worst": values.min(),
                    "median": np.median(values),
                    "best": values.max(),
                    "evaluations_to_target": np.median(needed) if needed else np.nan,
                    "evaluations": np.mean([run.evaluations for run in runs]),
                    "gradient_evaluations": np.mean([run.gradient_evaluations for run in runs]),
                }
            )
        return pd.DataFrame(rows).set_index("method")

    def plot(self) -> Figure:
        """Median best value against evaluations; returns the figure."""
        return plot_history([run for runs in self.results.values() for run in runs], target=self.target)


def compare_optimisers(
    f: Callable[..., Any],
    space: DesignSpace,
    *,
    target: float,
    tolerance: float = 1e-4,
    methods: Mapping[str, Mapping[str, Any]] | Iterable[str] = METHODS,
    budget: int = 3000,
    seeds: Iterable[int] = range(20),
    polish: int = 5,
    gradient: Callable[..., Any] | None = None,
    vectorised: bool | None = None,
) -> OptimiserComparison:
    """Run several optimisers over several seeds with the same number of evaluations.

    Parameters
    ----------
    f, space, budget, polish, gradient, vectorised
        As in :func:`surrogate.maximise`.
    target, tolerance : float
        A run reaches the target at ``target - tolerance`` or above.
    methods : mapping or iterable of str
        Names, or a label for each set of options: ``{"label": {"method": …, "options": …}}``.
    seeds : iterable of int
        One run of each method for each; DIRECT has no randomness and is run once.
    """
    if isinstance(methods, Mapping):
        chosen = {label: dict(settings) for label, settings in methods.items()}
    else:
        chosen = {label: {} for label in methods}
    listed = list(seeds)
    if not listed:
        raise ValueError("give at least one seed")
    results = {}
    for label, settings in chosen.items():
        method = settings.pop("method", label)
        if method not in SEARCHES:
            raise ValueError(f"unknown method '{method}'; choose one of {', '.join(METHODS)}")
        results[label] = tuple(
            maximise(
                f,
                space,
                method=method,
                seed=seed,
                **{
                    "budget": budget,
                    "polish": polish,
                    "gradient": gradient,
                    "vectorised": vectorised,
                    **settings,
                },
            )
            for seed in (listed[:1] if method == "direct" else listed)
        )
    return OptimiserComparison(results, target - tolerance)
