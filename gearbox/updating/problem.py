"""A gear stage model, the recordings that it is compared with, and the objectives of the comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from gearbox.signals.recordings import Recording
from gearbox.updating.errors import UpdatingError
from gearbox.updating.objectives import AmplitudeObjective, DifferenceObjective, MeasuredLines, SimilarityObjective
from gearbox.updating.recording_checks import recording_faults
from gearbox.updating.runs import Runs
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.virtual import PERIODIC_LIMIT, Run
from multibody.base.progress import Progress, silent

__all__ = ["UpdatingProblem"]


class UpdatingProblem:
    """A gear stage model, the recordings that it is compared with, and the objectives of the comparison.

    Parameters
    ----------
    settings : UpdatingSettings
    runs : Runs
        Of the model.
    identify : sequence of Recording
        The first one is the base condition, by which cosine similarity is judged; amplitudes and phases use all.
    validate : sequence of Recording
        Never used for choosing or fitting.
    progress : callable
        Gets a line of text for each step.

    Raises
    ------
    UpdatingError
        If there is no recording to update from, or with everything that is wrong with their signals.
    """

    def __init__(
        self,
        settings: UpdatingSettings,
        runs: Runs,
        identify: Sequence[Recording],
        validate: Sequence[Recording] = (),
        *,
        progress: Progress = silent,
    ) -> None:
        self.settings, self.runs, self.progress = settings, runs, progress
        if faults := recording_faults(settings, identify, (*identify, *validate)):
            raise UpdatingError(faults)
        teeth = settings.driving_teeth
        self.identify = tuple(recording if recording.nominal else recording.matched(teeth) for recording in identify)
        self.validate = tuple(recording if recording.nominal else recording.matched(teeth) for recording in validate)
        self.notes: list[str] = []

    # ---------------------------------------------------------------- objectives

    @cached_property
    def similarity(self) -> SimilarityObjective:
        """The paper's objective at the base condition, its lag held if the rule says so."""
        s = self.settings
        rule = "best" if s.rule == "held" else s.rule
        free = SimilarityObjective(
            recording=self.identify[0],
            sensor=s.sensor,
            processing=s.processing,
            driving_teeth=s.driving_teeth,
            rule=rule,
        )
        if s.rule != "held":
            return free
        lag = free.similarity(self.start_runs(free.conditions)[0]).lag
        return replace(free, rule="held", lag=lag)

    def lines_of(self, recordings: Sequence[Recording], free_gain: bool) -> AmplitudeObjective:
        """Amplitudes and phases over some recordings."""
        s = self.settings
        sensors = s.sensors or (s.sensor,)
        lines = [MeasuredLines.of(recording, sensors, s.orders, s.driving_teeth) for recording in recordings]
        return AmplitudeObjective(measured=lines, orders=s.orders, driving_teeth=s.driving_teeth, free_gain=free_gain)

    @cached_property
    def amplitudes(self) -> AmplitudeObjective:
        """Amplitudes and phases over all recordings that may be used."""
        return self.lines_of(self.identify, self.settings.free_gain)

    @cached_property
    def difference(self) -> DifferenceObjective:
        """The difference of signals at the base condition, Eq. 7, in their own unit."""
        s = self.similarity
        return DifferenceObjective(
            recording=s.recording,
            sensor=s.sensor,
            processing=s.processing,
            driving_teeth=s.driving_teeth,
            rule=s.rule,
            lag=s.lag,
        )

    @property
    def objective(self) -> SimilarityObjective | AmplitudeObjective:
        """What the model is updated by."""
        if self.settings.objective == "amplitudes":
            return self.amplitudes
        return self.similarity if self.settings.objective == "similarity" else self.difference

    # ---------------------------------------------------------------- runs

    def start_runs(self, conditions: Sequence) -> list[Run]:
        """Runs of the model before updating."""
        made = self.runs.many([(self.settings.start, c) for c in conditions], "the model as it is")
        for run in made:
            if run.failed:
                raise UpdatingError([f"the model as it is cannot be run at {run.condition.label}: {run.error}"])
            if self.runs.settings.periodic and run.off_mesh > PERIODIC_LIMIT:
                raise UpdatingError(
                    [
                        f"the model's signal at {run.condition.label} holds {100 * run.off_mesh:.1f} % of its RMS off "
                        "the mesh lines, so a short run does not stand for a long one: set periodic = false, or let it "
                        "settle for longer"
                    ]
                )
        return made
