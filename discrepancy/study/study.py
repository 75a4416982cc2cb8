"""A study: a search with the methods that users call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.conclusion.conclude import conclude
from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.effects.effect import Effect
from discrepancy.evidence.search import EvidenceSearch
from discrepancy.problem.problem import read_problem
from discrepancy.questions.compare import Comparison, compare
from discrepancy.questions.locate import WhereItFails, locate
from discrepancy.search.loop import Search
from discrepancy.search.moves import Decision
from discrepancy.search.state import SearchState
from discrepancy.stages.stage import AcceptedEffect, Stage
from multibody.base.progress import silent

if TYPE_CHECKING:
    import pandas

__all__ = ["Study"]


@dataclass(repr=False)
class Study(SearchState):
    """A model compared with records, and every stage of the search for what it lacks.

    Make one with `Study.from_file`, then call `diagnose`, or take the steps yourself: `compare`, `locate`, `explain`,
    `add`, `undo`.  Parameters and attributes as of `discrepancy.search.state.SearchState`.
    """

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        seed: int | None = None,
        max_effects: int | None = None,
        progress: Callable[[str], None] = silent,
    ) -> Study:
        """Return the study that a study file describes; see `discrepancy.problem.problem.read_problem`."""
        return cls(read_problem(path, seed=seed, max_effects=max_effects), progress)

    def compare(self) -> Comparison:
        """Compare the latest stage with the records."""
        return compare(self.stage)

    def locate(self) -> WhereItFails:
        """Locate the error of the latest stage: signals, regimes, frequencies, connections."""
        return locate(self.stage)

    def explain(self) -> Decision:
        """Score every candidate on the latest stage and refit the best; nothing is added yet."""
        return Search(self).explain()

    def add(self, effect: Effect, accepted: AcceptedEffect | None = None) -> Stage:
        """Add an effect to the model, fit again, and make that the latest stage.

        Where the machine cannot be simulated with the strengths given, the fit begins at smaller ones.

        Parameters
        ----------
        effect : Effect
        accepted : AcceptedEffect, optional
            Why it is added, as `explain` gives it (``decision.accepted``); by default the effect counts as given.

        Raises
        ------
        SimulationError
            If the machine cannot be simulated with a hundredth of them either.
        """
        return Search(self).add(effect, accepted)

    def undo(self) -> Stage:
        """Remove the latest effect."""
        return Search(self).undo()

    def diagnose(self) -> Conclusion:
        """Search for what the model lacks, as ``problem.search`` says; then conclude."""
        by_evidence = EvidenceSearch(self) if self.problem.search == "evidence" else None
        try:
            if by_evidence is not None:
                by_evidence.run()
            else:
                Search(self).run()
        except KeyboardInterrupt:
            if len(self.stages) < 2:
                raise  # no result would be lost
            self.interrupted = True
        return conclude(self, by_evidence)

    def to_frame(self) -> pandas.DataFrame:
        """Return the root mean square error of every output, stage by stage, on both parts."""
        import pandas

        rows = {}
        for stage in self.stages:
            row = {}
            for part in ("identify", "validate"):
                for name, value in stage.rmse(part).items():
                    row[part, f"{name} [{stage.system.unit(name)}]"] = value
            rows[stage.name] = row
        names = list(dict.fromkeys(name for row in rows.values() for name in row))
        columns = pandas.MultiIndex.from_tuples(names) if names else None
        cells = [[row.get(name, np.nan) for name in names] for row in rows.values()]
        return pandas.DataFrame(cells, index=list(rows), columns=columns)

    def __repr__(self) -> str:
        records = f"{len(self.problem.identify)} + {len(self.problem.validate)} records"
        return f"Study({self.problem.name!r}: {records}, {len(self.stages)} stages)"
