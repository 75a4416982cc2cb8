"""Finite-amplitude sensitivities to dry friction, for a model that is far from the machine.

The derivative at strength zero describes a small friction along the model's motion.  Where the machine comes to rest
and the model swings on, that is another motion, and the derivative grows where the machine stands.  There the change by
a friction of a real size in a full simulation, divided by its strength, is used instead: at several sizes, as points of
the shape grid, in the scan and in its null distribution alike.  Most tight spots and small frictions change the motion
too little for that: their sensitivities have the direction of the derivative, and more of them add nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect, law_class
from discrepancy.effects.laws import DryLaw
from multibody.base.errors import ModelError, SimulationError
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.sensitivities.linearised_problem import LinearisedProblem
    from multibody.machine.model import System

__all__ = [
    "far_from_machine",
    "finite_amplitude_sensitivities",
    "in_new_directions",
    "outputs_of",
    "parameters_for",
    "takes_finite_amplitudes",
]

#: A sensitivity, record by record.
Blocks = Sequence[np.ndarray]

LARGE_RESIDUAL = 0.4  # size of the residual over the spread of the output, beyond which a derivative at zero misleads
SAME_DIRECTION = (
    1e-3  # share of energy beyond which a direction is another; neighbours in STRENGTH_SIZES differ by more
)
STRENGTH_SIZES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # strengths, over the force that the connection's motion needs


def far_from_machine(linearised: LinearisedProblem) -> bool:
    """Tell whether the residual of some output is a large part of what was measured."""
    residual = np.concatenate(linearised.residual().blocks)
    spread = np.std(np.concatenate([e.measured for e in linearised.experiments]), axis=0)
    error = np.sqrt(np.mean(residual**2, axis=0))
    return bool(np.any(error > LARGE_RESIDUAL * np.maximum(spread, 1e-300)))


def takes_finite_amplitudes(entry: Entry) -> bool:
    """Tell whether an effect is a dry friction of one strength, which can bring a machine to rest."""
    kind = entry.kind
    return (
        kind.at == "connection"
        and kind.linear
        and kind.one_sided
        and len(kind.strengths) == 1
        and (kind.law == "Hysteresis" or issubclass(law_class(kind, entry.place.domain), DryLaw))  # type: ignore[union-attr]
    )


def force_scale(linearised: LinearisedProblem, entry: Entry) -> float:
    """Return the force or torque that a connection's own motion needs: its inertia there times its acceleration."""
    place = entry.place
    assert place is not None
    speed = f"place.{place.name}.{place.motion_names()[1][0]}"
    largest = 0.0
    for i, experiment in enumerate(linearised.experiments):
        time = np.array(experiment.record.time)
        acceleration = np.gradient(linearised.nominal_outputs(i)[speed], time)
        largest = max(largest, float(np.sqrt(np.mean(acceleration**2))))
    x, probe = linearised.initial_state(0), linearised.system.index("input", f"probe.{place.name}")
    step = linearised.system.jacobian("u", 0.0, x, None, linearised.p)[:, probe]
    slopes = linearised.system.jacobian("x", 0.0, x, None, linearised.p, of="outputs")
    slope = slopes[linearised.system.index("output", speed)]
    by_force = abs(float(slope @ step))
    return largest / by_force if by_force > 0.0 else 0.0


def finite_amplitude_sensitivities(
    linearised: LinearisedProblem,
    entry: Entry,
    shapes: Sequence[dict[str, float]],
    derivatives: Sequence[Sequence[np.ndarray]],
) -> list[tuple[dict[str, float], list[np.ndarray]]]:
    """Return shapes with their ``amplitude``, and for each the sensitivity of every record, (n, n_channels, 1).

    Strengths with which a record cannot be simulated are left out, and those whose sensitivity has the direction of
    that of a smaller strength: scores depend on directions only.  Of each shape at least one is kept.  Where the
    sensitivities at two strengths have the same direction, those between them are assumed to have it too and are not
    simulated; the derivative counts as the sensitivity at strength zero.

    Parameters
    ----------
    linearised : LinearisedProblem
    entry : Entry
        An effect that `takes_finite_amplitudes`.
    shapes : sequence of dict
        Points of its shape grid.
    derivatives : sequence of sequence of ndarray, shape (n, n_channels, 1)
        Derivatives at strength zero, of each shape for each record.
    """
    scale = force_scale(linearised, entry)
    if scale <= 0.0:
        return []
    name = entry.kind.strengths[0]
    assert entry.place is not None
    effect = Effect.at_place(
        entry.kind.name, entry.place, strengths={name: 0.0}, shape=shapes[0], load=entry.load, number=98
    )
    try:
        system = effect.added_to(linearised.system.model).build(probes=True, outputs=linearised.experiments[0].outputs)
    except ModelError:
        return []
    base, records = parameters_for(linearised, system), range(len(linearised.experiments))
    without = parallel_map(lambda i: outputs_of(linearised, i, system, base), records)

    strengths = [size * scale for size in STRENGTH_SIZES]

    def sensitivity_of(shape: dict[str, float]) -> Callable[[int], Blocks | None]:
        def sensitivity(k: int) -> Blocks | None:
            p = base.copy()
            for key, value in {**shape, name: strengths[k]}.items():
                p[system.index("parameter", effect.parameter_name(key))] = value
            try:
                changed = parallel_map(lambda i: outputs_of(linearised, i, system, p), records)
            except SimulationError:
                return None
            blocks = [linearised.weighted(i, (changed[i] - without[i])[:, :, None] / strengths[k]) for i in records]
            return blocks if all(np.all(np.isfinite(b)) for b in blocks) and any(np.any(b) for b in blocks) else None

        return sensitivity

    return [
        ({**shape, "amplitude": strengths[k]}, list(blocks))
        for shape, derivative in zip(shapes, derivatives, strict=True)
        for k, blocks in in_new_directions(derivative, sensitivity_of(shape), len(strengths), linearised.direction)
    ]


def in_new_directions(
    first: Blocks,
    sensitivity: Callable[[int], Blocks | None],
    count: int,
    direction: Callable[[Blocks], np.ndarray | None],
) -> list[tuple[int, Blocks]]:
    """Return the sensitivities with another direction than those before them, each with its number.

    The last one if none has.

    Parameters
    ----------
    first : sequence of ndarray
        The sensitivity before number 0.
    sensitivity : callable
        Returns the sensitivity of a number, or None where there is none.  It is called by bisection: not between two
        numbers whose sensitivities have the same direction.
    count : int
        Numbers.
    direction : callable
        Returns the direction of a sensitivity, a unit vector, or None if it has none.

    Examples
    --------
    >>> computed = []
    >>> def turning(k):
    ...     computed.append(k)
    ...     return [np.array([1.0, 0.0 if k < 4 else k / 5.0])]
    >>> def direction(blocks):
    ...     return blocks[0] / np.linalg.norm(blocks[0])
    >>> [k for k, _ in in_new_directions([np.array([1.0, 0.0])], turning, 6, direction)], computed
    ([4, 5], [5, 2, 3, 4])
    """
    computed: dict[int, Blocks | None] = {-1: first}
    directions: dict[int, np.ndarray | None] = {-1: direction(first)}

    def compute(k: int) -> None:
        computed[k] = blocks = sensitivity(k)
        directions[k] = None if blocks is None else direction(blocks)

    def bisect(low: int, high: int) -> None:
        if high - low < 2 or _same_direction(directions[low], directions[high]):
            return
        middle = (low + high) // 2
        compute(middle)
        bisect(low, middle)
        bisect(middle, high)

    compute(count - 1)
    bisect(-1, count - 1)
    kept, last = [], directions[-1]
    known = sorted(k for k, blocks in computed.items() if k >= 0 and blocks is not None)
    for k in known:
        if not _same_direction(last, directions[k]):
            kept.append(k)
            last = directions[k]
    return [(k, computed[k]) for k in kept or known[-1:]]  # type: ignore[misc]


def _same_direction(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    """Tell whether two directions are the same except for a small share of their energy."""
    along = float(a @ b) if a is not None and b is not None else 0.0
    return along > 0.0 and 1.0 - along**2 < SAME_DIRECTION


def parameters_for(linearised: LinearisedProblem, system: System) -> np.ndarray:
    """Return the parameters of a system with another effect in it, the others as in the linearised problem."""
    p = system.p.copy()
    for name, value in zip(linearised.system.parameter_names, linearised.p, strict=True):
        if name in system.parameter_names:
            p[system.index("parameter", name)] = value
    return p


def outputs_of(linearised: LinearisedProblem, index: int, system: System, p: np.ndarray) -> np.ndarray:
    """Return the outputs of a record, (n, n_channels), simulated with a system that has more states at most."""
    experiment = linearised.experiments[index]
    x, known = experiment.start_vector(system), linearised.initial_state(index)
    for name, value in zip(linearised.system.state_names, known, strict=True):
        x[system.index("state", name)] = value
    return experiment.simulate(system, p, x, linearised.sensors)
