"""A force that disturbs the machine and is in no model: how to weigh down what it makes of the residual.

Where nothing holds a machine, what disturbs it adds up along the record: the residual wanders, remembers as long as
the record is, and shuffling it shows little of what luck can do.  What kind of wandering that is, the machine's own
equations say.  The force is a Gaussian process with an exponential memory at one connection, sent through the exact
linearisation; residual, sensitivities and candidates are multiplied by the inverse square root of what it and the
noise make together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.residual.windows import keeps_growing
from discrepancy.sensitivities.force_estimate import ForceEquations, correlated, force_posterior, force_responses
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.low_rank_noise import Shaping, shaping_along
from discrepancy.statistics.null import WHOLE_RECORDS, cut
from discrepancy.statistics.whitened import plain_projection, projection_in
from discrepancy.statistics.whitening import identity
from estimation.response.perturbations import Push
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from estimation.signals.preparation import Preparation
    from multibody.assembly.places import Place

__all__ = ["Disturbance", "comparable_residuals", "disturbance_of", "facts_of"]

ROUNDS = 5  # of force against noise, each told by the other; a sixth changes them by less than 0.1 % on two drives
_KEY = "disturbance"


@dataclass(frozen=True, eq=False)
class Disturbance:
    """A random force that adds up along the records.

    Parameters
    ----------
    where, unit : str
        The connection at which it explains the residual best, and N or N*m.
    size : float
        Standard deviation.
    memory : float, s
        Of its exponential correlation.
    preparation : Preparation
        Of the residual that tells it.
    weighing : tuple of Shaping
        What weighs each record's residual down for it.
    """

    where: str
    unit: str
    size: float
    memory: float
    preparation: Preparation
    weighing: tuple[Shaping, ...]

    @property
    def sentence(self) -> str:
        """What it is and what was done."""
        return (
            f"What is left wanders as if a random {'torque' if self.unit == 'N*m' else 'force'} of "
            f"{quantity_text(self.size, self.unit, 2)} that changes within about {self.memory:.2g} s acted at "
            f"{self.where}: nothing holds the machine against it, so it adds up along the records. "
            "Effects were judged beside it."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in diagnosis.json."""
        return {"where": self.where, "size": self.size, "unit": self.unit, "memory_s": self.memory}


def disturbance_of(stage: Stage) -> Disturbance | None:
    """Return the disturbance that a stage's residual was weighed down for, or None."""
    return stage.worked_out.get(_KEY)


def facts_of(stage: Stage, preparation: Preparation) -> LinearisedProblem:
    """Return a stage's machine beside its records, weighed down where a disturbance adds up along them.

    Parameters
    ----------
    stage : Stage
    preparation : Preparation
        For the scan.
    """
    key = ("weighed facts", preparation)
    if key not in stage.worked_out:
        facts = LinearisedProblem.of_stage(stage, preparation)
        stage.worked_out[_KEY] = found = _found(facts) if _adds_up(facts) else None
        stage.worked_out[key] = facts.weighed_down(found.weighing) if found is not None else facts
    return stage.worked_out[key]


def comparable_residuals(one: Stage, other: Stage) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the residuals of two stages on the identification records, each a list of (n, n_channels).

    Where a disturbance adds up along the records of either they are weighed down alike, and free of what calibration
    could still change, since a fit weighs outputs and not what they remember.
    """
    known = disturbance_of(other) or disturbance_of(one)
    if known is None:
        return [f.residual for f in one.identify.fits], [f.residual for f in other.identify.fits]
    return _weighed(one, known), _weighed(other, known)


def _weighed(stage: Stage, beside: Disturbance) -> list[np.ndarray]:
    key = ("weighed residuals", beside)
    if key not in stage.worked_out:
        facts = LinearisedProblem.of_stage(stage, beside.preparation).weighed_down(beside.weighing)
        residual = facts.residual()
        noise = beside.weighing[0].noise
        scale = identity(list(noise), residual.channels, residual.dt)
        projection = projection_in(scale, residual, facts.sensitivities())
        layout = projection.layout
        e = projection.remove(layout.stack(projection.whitener, residual.blocks))
        stage.worked_out[key] = [layout.view(e, b) * noise for b in range(len(residual.blocks))]
    return stage.worked_out[key]


def _adds_up(facts: LinearisedProblem) -> bool:
    """Tell whether a force would add up, and the residual remembers so long that there are few pieces of it.

    An effect that is missing makes a residual remember as well; where the machine is held, that is all there is to it.
    """
    if len(facts.experiments) >= WHOLE_RECORDS:
        return False
    residual = facts.residual()
    if not all(facts.noise.get(n, 0.0) > 0.0 for n in residual.channels):
        return False
    projection = plain_projection(residual, facts.sensitivities())
    e = projection.layout.stack(projection.whitener, residual.blocks)
    if not cut(projection.layout, residual.dt, projection.remove(e)).few:
        return False
    return any(_runs_on(facts, i) for i in range(len(facts.experiments)))


def _runs_on(facts: LinearisedProblem, index: int) -> bool:
    """Tell whether a steady force at some connection moves an output ever further along a record.

    Dry friction holds a machine where it stands still, and so one record may say no where another says yes.
    """
    experiment = facts.experiments[index]
    steady = np.ones_like(np.asarray(experiment.record.time))
    pushes = [Push(f"probe.{place.name}", steady) for place in facts.system.places]
    if not pushes:
        return False
    start = facts.start(index)
    moved = experiment.respond(facts.slim, facts.p, start, pushes=pushes, sensors=facts.sensors).derivatives
    return any(keeps_growing(np.abs(moved[:, c, k])) for c in range(moved.shape[1]) for k in range(moved.shape[2]))


def _found(facts: LinearisedProblem) -> Disturbance | None:
    """Return the force that explains a residual best; None if none does."""
    tried = [(place, _Force.at(facts, place)) for place in facts.system.places]
    place, best = max(tried, key=lambda t: t[1].log_likelihood, default=(None, None))
    if place is None or best is None or not best.log_likelihood > 0.0:
        return None
    unit = "N*m" if place.domain == "rotation" else "N"
    return Disturbance(place.name, unit, best.size, best.memory, facts.preparation, best.weighing())


@dataclass(frozen=True, eq=False)
class _Force:
    """A random force at a connection on trial.

    Parameters
    ----------
    times : list of ndarray, shape (k,), s
        At which the force has a value, in each record.
    responses : list of ndarray, shape (n, n_channels, k)
        What each value makes of the outputs.
    size, memory : float
        Standard deviation, N or N·m, and memory, s.
    noise : ndarray, shape (n_channels,)
        What it leaves of each output, not below the noise floor.
    log_likelihood : float
        Above that of no force.
    """

    times: list[np.ndarray]
    responses: list[np.ndarray]
    size: float
    memory: float
    noise: np.ndarray
    log_likelihood: float

    @classmethod
    def at(cls, facts: LinearisedProblem, place: Place) -> _Force:
        """Estimate the force at a place, and the noise beside it, which each tell what the other is."""
        residual = facts.residual()
        given = [force_responses(facts, place, i) for i in range(len(facts.experiments))]
        times, responses = [t for t, _ in given], [r for _, r in given]
        floor = np.array([facts.noise[n] for n in residual.channels])
        noise = _rms(residual.blocks)
        count = sum(len(block) for block in residual.blocks)
        without = None
        best = cls(times, responses, 0.0, 1.0, noise, -np.inf)
        if not all(np.all(np.isfinite(r)) for r in responses):  # the machine runs away from it
            return best
        for _ in range(ROUNDS):
            equations = ForceEquations.of(facts, responses, noise)
            force, _, size, memory, _, gain = force_posterior(equations.A, equations.b, times)
            none = -0.5 * equations.energy - count * float(np.sum(np.log(noise)))
            without = none if without is None else without
            best = cls(times, responses, size, memory, noise, none + gain - without)
            left = [e.reshape(-1, noise.size) for e in equations.left(force)]
            noise = np.maximum(floor, np.minimum(noise * _rms(left), noise))
        return best

    def weighing(self) -> tuple[Shaping, ...]:
        """Return how to weigh each record."""
        found = []
        for times, response in zip(self.times, self.responses, strict=True):
            root = np.linalg.cholesky(correlated(times, self.memory) + 1e-9 * np.eye(times.size))
            found.append(shaping_along(self.size * response @ root, self.noise))
        return tuple(found)


def _rms(blocks: Sequence[np.ndarray]) -> np.ndarray:
    return np.maximum(np.sqrt(np.mean(np.concatenate(blocks) ** 2, axis=0)), 1e-300)
