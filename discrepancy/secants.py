"""Columns of dry friction where the model is far from the machine: secants at strengths that matter.

The derivative at strength zero says what a little friction would do to the motion that the model makes.  Where the
machine comes to rest and the model swings on, that is another motion, and the derivative grows where the machine
stands.  There the change that a friction of a real size makes in a full simulation, per strength, takes its place: at
several sizes, as points of the shape grid, in the scan and in its null alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effect_laws import DryLaw
from discrepancy.effects import Effect, law_class

if TYPE_CHECKING:
    from discrepancy.catalogue import Entry
    from discrepancy.confrontation import Confrontation
    from multibody.system import System

__all__ = ["far_away", "secant_columns", "takes_secants"]

FAR = 0.4  # size of the residual over the spread of what was measured, beyond which a derivative at zero misleads
SIZES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # strengths, over the force that the connection's motion takes


def far_away(facts: Confrontation) -> bool:
    """Tell whether the model misses most of what some output does."""
    residual = np.concatenate(facts.residual().blocks)
    spread = np.std(np.concatenate([e.measured for e in facts.experiments]), axis=0)
    error = np.sqrt(np.mean(residual**2, axis=0))
    return bool(np.any(error > FAR * np.maximum(spread, 1e-300)))


def takes_secants(entry: Entry) -> bool:
    """Tell whether an effect is a dry friction of one strength, which can bring a machine to rest."""
    kind = entry.kind
    return (
        kind.at == "connection"
        and kind.linear
        and kind.one_sided
        and len(kind.strengths) == 1
        and (kind.law == "Hysteresis" or issubclass(law_class(kind, entry.place.domain), DryLaw))  # type: ignore[union-attr]
    )


def force_scale(facts: Confrontation, entry: Entry) -> float:
    """Return the force or torque that a connection's own motion takes: its inertia there times its acceleration."""
    place = entry.place
    assert place is not None
    speed = f"place.{entry.where}.{place.motion_names()[1][0]}"
    most = 0.0
    for i, experiment in enumerate(facts.experiments):
        time = np.array(experiment.record.time)
        acceleration = np.gradient(facts.motions(i)[speed], time)
        most = max(most, float(np.sqrt(np.mean(acceleration**2))))
    x, probe = facts.start(0), facts.system.index("input", f"probe.{entry.where}")
    step = facts.system.jacobian("u", 0.0, x, None, facts.p)[:, probe]
    slope = facts.system.jacobian("x", 0.0, x, None, facts.p, of="outputs")[facts.system.index("output", speed)]
    by_force = abs(float(slope @ step))
    return most / by_force if by_force > 0.0 else 0.0


def secant_columns(
    facts: Confrontation, entry: Entry, shapes: list[dict[str, float]]
) -> list[tuple[dict[str, float], list[np.ndarray]]]:
    """Return shapes with their ``secant`` strength, and for each the columns of every record, (n, n_channels, 1).

    Strengths with which a record cannot be simulated are left out.
    """
    from multibody.errors import ModelError, SimulationError

    scale = force_scale(facts, entry)
    if scale <= 0.0:
        return []
    name = entry.kind.strengths[0]
    effect = Effect.at_place(entry.kind.name, entry.place, shape=shapes[0], load=entry.load, number=98)  # type: ignore[arg-type]
    try:
        system = effect.added_to(facts.system.model).build(probes=True, outputs=facts.experiments[0].outputs)
    except ModelError:
        return []
    base = _parameters(facts, system)
    without = [_outputs(facts, i, system, base) for i in range(len(facts.experiments))]
    found = []
    for shape in shapes:
        for size in SIZES:
            p = base.copy()
            for key, value in {**shape, name: size * scale}.items():
                p[system.index("parameter", effect.parameter_name(key))] = value
            try:
                changed = [_outputs(facts, i, system, p) for i in range(len(facts.experiments))]
            except SimulationError:
                continue
            blocks = [
                facts.shaped(i, (b - a)[:, :, None] / (size * scale))
                for i, (a, b) in enumerate(zip(without, changed, strict=True))
            ]
            if all(np.all(np.isfinite(b)) for b in blocks) and any(np.any(b) for b in blocks):
                found.append(({**shape, "secant": size * scale}, blocks))
    return found


def _parameters(facts: Confrontation, system: System) -> np.ndarray:
    p = system.p.copy()
    for name, value in zip(facts.system.parameter_names, facts.p, strict=True):
        if name in system.parameter_names:
            p[system.index("parameter", name)] = value
    return p


def _outputs(facts: Confrontation, index: int, system: System, p: np.ndarray) -> np.ndarray:
    experiment = facts.experiments[index]
    x, known = experiment.start_vector(system), facts.start(index)
    for name, value in zip(facts.system.state_names, known, strict=True):
        x[system.index("state", name)] = value
    return experiment.simulate(system, p, x, facts.sensors)
