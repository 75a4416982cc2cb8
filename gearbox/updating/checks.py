"""Checks of an updated model: other operating conditions, identifiable directions, signals for figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gearbox.signals.main_components import main_components
from gearbox.updating.identifiability import Identifiability, identifiability
from gearbox.updating.objectives import AmplitudeObjective, MeasuredLines
from gearbox.updating.outcome import Candidate, Check
from gearbox.updating.problem import UpdatingProblem
from surrogate import DesignSpace

__all__ = ["check_conditions", "directions", "pictured"]


def check_conditions(problem: UpdatingProblem, updated: Mapping[str, float]) -> tuple[Check, ...]:
    """Compare start and updated model with recordings that were not used."""
    checks = []
    for recording in problem.validate:
        objective = problem.similarity.at(recording)
        wanted = [(problem.settings.start, recording.condition), (dict(updated), recording.condition)]
        before, after = problem.runs.many(wanted, "other conditions")
        if before.failed or after.failed:
            problem.notes.append(f"The model cannot be run at {recording.name}: {before.error or after.error}")
            continue
        rate = recording.signal(problem.settings.sensor).rate
        duration = 0.5 if problem.runs.settings.periodic else problem.runs.settings.duration
        mesh = recording.condition.mesh_frequency(problem.settings.driving_teeth)
        lines = problem.lines_of([recording], problem.settings.free_gain)
        assert recording.nominal is not None
        checks.append(
            Check(
                condition=recording.condition,
                reported_rpm=recording.nominal.speed_rpm,
                before=objective.similarity(before),
                after=objective.similarity(after),
                components=main_components(after.signal(problem.settings.sensor, rate, duration), mesh),
                amplitude_before=lines.value([before]),
                amplitude_after=lines.value([after]),
            )
        )
    return tuple(checks)


def directions(
    problem: UpdatingProblem, space: DesignSpace, updated: Mapping[str, float]
) -> tuple[Identifiability, ...]:
    """Identifiable directions of the parameters, by the paper's objective and by amplitudes over all loads."""
    s = problem.settings
    mesh = problem.identify[0].condition.mesh_frequency(s.driving_teeth)
    low, high = s.processing.band
    orders = [k for k in range(1, int(high / mesh) + 1) if k * mesh >= low]
    point = {n: updated[n] for n in space.names}
    fixed = {n: v for n, v in updated.items() if n not in space.names}
    lines = MeasuredLines.of(problem.identify[0], (s.sensor,), orders, s.driving_teeth)
    compared = [
        (
            AmplitudeObjective(measured=(lines,), orders=tuple(orders), driving_teeth=s.driving_teeth, free_gain=True),
            f"cosine similarity at {problem.identify[0].name} (mesh orders {', '.join(map(str, orders))} in the band)",
        ),
        (
            problem.amplitudes,
            f"amplitudes and phases of {len(s.sensors or (s.sensor,))} sensor(s) at {len(problem.identify)} "
            "condition(s)",
        ),
    ]
    results = []
    for objective, what in compared:
        runs = problem.runs.many([(dict(updated), c) for c in objective.conditions])
        model = objective.of_runs(runs)
        # Two real numbers for each line; the residual is the error of one of them.
        left = objective.misfit(model) * float((np.abs(objective.target()) ** 2).sum())
        noise = float(np.sqrt(left / (2.0 * model.size)))
        try:
            results.append(
                identifiability(objective, problem.runs, space, point, noise=max(noise, 1e-3), fixed=fixed, what=what)
            )
        except ValueError as error:
            problem.notes.append(f"Identifiable directions ({what}): {error}")
    return tuple(results)


def pictured(problem: UpdatingProblem, start: Candidate, updated: Candidate) -> dict[str, Any]:
    """Signals for the report's figures: the base condition and those not used."""
    pairs = []
    for recording in (problem.identify[0], *problem.validate):
        objective = problem.similarity if recording is problem.identify[0] else problem.similarity.at(recording)
        runs = problem.runs.many([(dict(c.values), recording.condition) for c in (start, updated)])
        if any(run.failed for run in runs):
            continue
        measured, before = objective.aligned(runs[0])
        after = objective.aligned(runs[1])[1]
        pairs.append((recording, measured, before, after))
    return {"pairs": pairs}
