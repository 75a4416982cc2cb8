"""What is asked of an updated model afterwards: other conditions, directions that can be told, signals for figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from gearbox.signals.main_components import main_components
from gearbox.updating.identifiability import Identifiability, identifiability
from gearbox.updating.objectives import AmplitudeObjective, MeasuredLines
from gearbox.updating.result import Candidate, Check
from surrogate import DesignSpace

if TYPE_CHECKING:
    from gearbox.updating.chain import UpdatingChain

__all__ = ["check_conditions", "directions", "pictured"]


def check_conditions(chain: UpdatingChain, updated: Mapping[str, float]) -> tuple[Check, ...]:
    """Start and updated model beside recordings that were not used."""
    checks = []
    for recording in chain.validate:
        objective = chain.similarity.at(recording)
        wanted = [(chain.settings.start, recording.condition), (dict(updated), recording.condition)]
        before, after = chain.runs.many(wanted, "other conditions")
        if before.failed or after.failed:
            chain.notes.append(f"The model cannot be run at {recording.name}: {before.error or after.error}")
            continue
        rate = recording.signal(chain.settings.sensor).rate
        duration = 0.5 if chain.runs.settings.periodic else chain.runs.settings.duration
        mesh = recording.condition.mesh_frequency(chain.settings.driving_teeth)
        lines = chain.lines_of([recording], chain.settings.free_gain)
        assert recording.nominal is not None
        checks.append(
            Check(
                recording.condition,
                recording.nominal.speed_rpm,
                objective.similarity(before),
                objective.similarity(after),
                main_components(after.signal(chain.settings.sensor, rate, duration), mesh),
                lines.value([before]),
                lines.value([after]),
            )
        )
    return tuple(checks)


def directions(chain: UpdatingChain, space: DesignSpace, updated: Mapping[str, float]) -> tuple[Identifiability, ...]:
    """Directions of the parameters that the paper's objective can tell, and that amplitudes over all loads can."""
    s = chain.settings
    mesh = chain.identify[0].condition.mesh_frequency(s.driving_teeth)
    low, high = s.processing.band
    orders = [k for k in range(1, int(high / mesh) + 1) if k * mesh >= low]
    point = {n: updated[n] for n in space.names}
    fixed = {n: v for n, v in updated.items() if n not in space.names}
    lines = MeasuredLines.of(chain.identify[0], (s.sensor,), orders, s.driving_teeth)
    compared = [
        (
            AmplitudeObjective((lines,), tuple(orders), s.driving_teeth, True),
            f"cosine similarity at {chain.identify[0].name} (mesh orders {', '.join(map(str, orders))} in the band)",
        ),
        (
            chain.amplitudes,
            f"amplitudes and phases of {len(s.sensors or (s.sensor,))} sensor(s) at {len(chain.identify)} condition(s)",
        ),
    ]
    found = []
    for objective, what in compared:
        runs = chain.runs.many([(dict(updated), c) for c in objective.conditions])
        model = objective.of_runs(runs)
        # Two real numbers for each line; what is left beside the measurement is the error of one of them.
        left = objective.misfit(model) * float((np.abs(objective.target()) ** 2).sum())
        noise = float(np.sqrt(left / (2.0 * model.size)))
        try:
            found.append(
                identifiability(objective, chain.runs, space, point, noise=max(noise, 1e-3), fixed=fixed, what=what)
            )
        except ValueError as error:
            chain.notes.append(f"Directions that can be told ({what}): {error}")
    return tuple(found)


def pictured(chain: UpdatingChain, start: Candidate, updated: Candidate) -> dict[str, Any]:
    """Signals for the report's figures: the base condition and those not used."""
    pairs = []
    for recording in (chain.identify[0], *chain.validate):
        objective = chain.similarity if recording is chain.identify[0] else chain.similarity.at(recording)
        runs = chain.runs.many([(dict(c.values), recording.condition) for c in (start, updated)])
        if any(run.failed for run in runs):
            continue
        measured, before = objective.aligned(runs[0])
        after = objective.aligned(runs[1])[1]
        pairs.append((recording, measured, before, after))
    return {"pairs": pairs}
