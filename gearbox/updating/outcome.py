"""The outcome of updating a model: every step of the chain, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.main_components import MainComponents
from gearbox.signals.similarity import Similarity
from gearbox.updating.identifiability import Identifiability
from gearbox.updating.settings import OBJECTIVES, UpdatingSettings

if TYPE_CHECKING:
    import pandas as pd

    from gearbox.updating.output_surfaces import OutputSurfaces
    from surrogate import OneAtATimeResult, OptimisationResult, ResponseSurface

__all__ = ["Candidate", "Check", "FrequencyCheck", "SurfaceChoice", "UpdatingOutcome"]


@dataclass(frozen=True)
class FrequencyCheck:
    """Step 2: main components of model and measurement against theory.

    Parameters
    ----------
    condition : OperatingCondition
        With the speed found in the measurement.
    reported_rpm : float
        Speed that the rig reported.
    virtual, measured : MainComponents
    """

    condition: OperatingCondition
    reported_rpm: float
    virtual: MainComponents
    measured: MainComponents

    @property
    def accepted(self) -> bool:
        """Whether the model's main components are within 5 % of theory."""
        return self.virtual.accepted


@dataclass(frozen=True, kw_only=True)
class SurfaceChoice:
    """Step 6: the response surface that stands for the model.

    Parameters
    ----------
    study : DataFrame
        Quality over sample counts and orders (Figs. 9 and 10).
    surface : ResponseSurface or OutputSurfaces
    points, order : int
        Of the surface taken.
    failed : int
        Simulations of the designs that failed and were left out.
    """

    study: pd.DataFrame
    surface: ResponseSurface | OutputSurfaces
    points: int
    order: int
    failed: int = 0


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A set of parameters that was simulated to see whether it is better than the start.

    Parameters
    ----------
    origin : str
        Where it comes from, such as ``"optimum of the surface"``.
    values : mapping of str to float
    predicted : float
        By the surface; NaN for the start and for design points.
    simulated : float
        By the model; NaN if the run failed.
    similarity : Similarity, optional
        Its cosine similarity in full.
    """

    origin: str
    values: Mapping[str, float]
    predicted: float
    simulated: float
    similarity: Similarity | None = None


@dataclass(frozen=True, kw_only=True)
class Check:
    """Step 7's consequence: start and updated model under a condition that was not used.

    Parameters
    ----------
    condition : OperatingCondition
        With the speed found in the recording.
    reported_rpm : float
    before, after : Similarity
    components : MainComponents
        Of the updated model.
    amplitude_before, amplitude_after : float
        Share of the measured mesh lines explained, over the sensors compared; NaN without sensors.
    """

    condition: OperatingCondition
    reported_rpm: float
    before: Similarity
    after: Similarity
    components: MainComponents
    amplitude_before: float = float("nan")
    amplitude_after: float = float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class UpdatingOutcome:
    """The values of all steps of the chain.

    Parameters
    ----------
    settings : UpdatingSettings
    frequencies : FrequencyCheck
    sensitivity : OneAtATimeResult
        Step 5, of the objective.
    selected : tuple of str
        Parameters updated.
    choice : SurfaceChoice
    search : OptimisationResult
        On the surface.
    rivals : DataFrame
        Local maxima of the surface.
    start, optimum : Candidate
        Before updating, and the surface's optimum simulated again.
    updated : Candidate
        What was taken: the start itself if nothing was better.
    tried : tuple of Candidate
        Everything that was simulated as a candidate.
    checks : tuple of Check
    directions : tuple of Identifiability
    off_mesh : float
        Largest share of a run's RMS that was not at mesh lines.
    simulations, reused, failed : int
        Runs made, found in the store, and failed.
    seconds : float
        Computing time of the runs made.
    notes : tuple of str
        Remarks for the reader.
    pictures : mapping
        Signals for the figures.
    """

    settings: UpdatingSettings
    frequencies: FrequencyCheck
    sensitivity: OneAtATimeResult
    selected: tuple[str, ...]
    choice: SurfaceChoice
    search: OptimisationResult
    rivals: pd.DataFrame
    start: Candidate
    optimum: Candidate
    updated: Candidate
    tried: tuple[Candidate, ...]
    checks: tuple[Check, ...]
    directions: tuple[Identifiability, ...] = ()
    off_mesh: float = 0.0
    simulations: int = 0
    reused: int = 0
    failed: int = 0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def accepted(self) -> bool:
        """Whether the surface's optimum, simulated again, is better than the start."""
        return self.optimum.simulated > self.start.simulated

    @property
    def improved(self) -> bool:
        """Whether any set of parameters better than the start was taken."""
        return self.updated.simulated > self.start.simulated

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.sentence()})"

    def sentence(self) -> str:
        """The outcome in a sentence or two."""
        what = OBJECTIVES[self.settings.objective]
        before, optimum = self.start.simulated, self.optimum
        text = (
            f"The surface predicted a {what} of {optimum.predicted:.3f}; the simulation gives {optimum.simulated:.3f}, "
            f"and gave {before:.3f} before updating: "
        )
        if self.updated is self.optimum:
            return text + "the model is updated."
        if self.improved:
            taken = f"{self.updated.origin}, {self.updated.simulated:.3f}, is taken instead"
            why = "refused, as it is not better than the start" if not self.accepted else "a better point was simulated"
            return text + f"{why}; {taken}."
        return text + "refused, as it is not better. The model stays as it was."

    def parameters(self) -> pd.DataFrame:
        """Parameters before and after (Table 4)."""
        import pandas as pd

        space = self.settings.space
        return pd.DataFrame(
            {
                "unit": space.units,
                "lower": space.lower,
                "upper": space.upper,
                "start": [self.start.values[n] for n in space.names],
                "updated": [self.updated.values[n] for n in space.names],
                "selected": [n in self.selected for n in space.names],
            },
            index=pd.Index(space.names, name="parameter"),
        )

    def to_frame(self) -> pd.DataFrame:
        """Similarity at the base and under other conditions, before and after (Fig. 12)."""
        import pandas as pd

        rows = []
        if self.start.similarity is not None and self.updated.similarity is not None:
            base = (self.frequencies.condition, self.start.similarity, self.updated.similarity, True)
            rows.append(base)
        rows += [(c.condition, c.before, c.after, False) for c in self.checks]
        return pd.DataFrame(
            [
                {
                    "condition": c.label,
                    "speed [r/min]": c.speed_rpm,
                    "load [N·m]": c.load_Nm,
                    "used for updating": used,
                    "before": before.value,
                    "after": after.value,
                    "upper bound": after.bound,
                    "lag [ms]": 1e3 * after.lag,
                    "rule": after.rule,
                }
                for c, before, after, used in rows
            ]
        )
