"""A random force that disturbs the machine and is in no model, and the weights that it gives the residual.

Where nothing holds a machine, the effect of a disturbance accumulates along the record: the residual drifts, its memory
is as long as the record, and resampling it shows little of what chance can do.  The machine's own equations determine
the form of the drift.  The force is a Gaussian process with an exponential memory at one connection, propagated by the
exact linearisation; residual, sensitivities and candidates are multiplied by the inverse square root of the covariance
that it and the noise give together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.residual.windows import keeps_growing
from discrepancy.sensitivities.force_process import (
    ForceEquations,
    exponential_correlation,
    force_posterior,
    force_responses,
    keep_matrices_of_all_places,
)
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.low_rank_weighting import LowRankWeighting, low_rank_weighting
from discrepancy.statistics.null_distribution import WHOLE_RECORDS, cut_pieces
from discrepancy.statistics.whitened import projection_in, rms_projection
from discrepancy.statistics.whitening import identity
from estimation.response.perturbations import InputPerturbation
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from estimation.signals.preparation import Preparation
    from multibody.assembly.places import Place

__all__ = ["DisturbanceForce", "accumulating_disturbance", "weighted_residuals"]

ROUNDS = 5  # of force and noise, each estimated given the other; a sixth changes them by less than 0.1 % on two drives


@dataclass(frozen=True, eq=False, kw_only=True)
class DisturbanceForce:
    """A random force whose effect accumulates along the records.

    Parameters
    ----------
    where, unit : str
        The connection at which it explains the residual best, and N or N*m.
    size : float
        Standard deviation.
    memory : float, s
        Of its exponential correlation.
    preparation : Preparation
        Of the residual that it was estimated from.
    weighting : tuple of LowRankWeighting
        The weights of each record's residual.
    """

    where: str
    unit: str
    size: float
    memory: float
    preparation: Preparation
    weighting: tuple[LowRankWeighting, ...]

    @property
    def sentence(self) -> str:
        """What it is and what was done."""
        return (
            f"The residual drifts as if a random {'torque' if self.unit == 'N*m' else 'force'} of "
            f"{quantity_text(self.size, self.unit, 2)} that changes within about {self.memory:.2g} s acted at "
            f"{self.where}: nothing holds the machine against it, so its effect accumulates along the records. "
            "Effects were judged with this disturbance taken into account."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in diagnosis.json."""
        return {"where": self.where, "size": self.size, "unit": self.unit, "memory_s": self.memory}


def accumulating_disturbance(linearised: LinearisedProblem) -> DisturbanceForce | None:
    """Return the random force that explains a residual best, where the effect of one accumulates along the records.

    None where the machine is held, where the residual holds enough independent pieces, and where no force explains it.
    """
    if not _accumulates(linearised):
        return None
    keep_matrices_of_all_places(linearised)
    # one after another: the responses to a force at one place may be hundreds of megabytes
    tried = ((place, _RandomForce.at(linearised, place)) for place in linearised.system.places)
    place, best = max(tried, key=lambda t: t[1].log_likelihood, default=(None, None))
    if place is None or best is None or not best.log_likelihood > 0.0:
        return None
    return DisturbanceForce(
        where=place.name,
        unit="N*m" if place.domain == "rotation" else "N",
        size=best.size,
        memory=best.memory,
        preparation=linearised.preparation,
        weighting=best.weighting(),
    )


def weighted_residuals(linearised: LinearisedProblem, disturbance: DisturbanceForce) -> list[np.ndarray]:
    """Return each record's residual, (n, n_channels), weighted for a disturbance and free of calibration.

    A fit weighs outputs and ignores their memory, so calibration could still reduce the weighted residual.

    Parameters
    ----------
    linearised : LinearisedProblem
        With the disturbance's preparation.
    disturbance : DisturbanceForce
    """
    weighted = linearised.weighted_by(disturbance.weighting)
    residual = weighted.residual()
    noise = disturbance.weighting[0].noise
    scale = identity(list(noise), residual.channels, residual.dt)
    projection = projection_in(scale, residual, weighted.sensitivities())
    layout = projection.layout
    e = projection.remove(layout.stack(projection.whitener, residual.blocks))
    return [layout.view(e, b) * noise for b in range(len(residual.blocks))]


def _accumulates(linearised: LinearisedProblem) -> bool:
    """Tell whether the effect of a force would accumulate, and the residual holds few independent pieces.

    A missing effect gives a residual a long memory as well; where the machine is held, that is its only cause.
    """
    if len(linearised.experiments) >= WHOLE_RECORDS:
        return False
    residual = linearised.residual()
    if not all(linearised.noise.get(n, 0.0) > 0.0 for n in residual.channels):
        return False
    projection = rms_projection(residual, linearised.sensitivities())
    e = projection.layout.stack(projection.whitener, residual.blocks)
    if not cut_pieces(projection.layout, residual.dt, projection.remove(e)).too_few:
        return False
    return any(_runs_on(linearised, i) for i in range(len(linearised.experiments)))


def _runs_on(linearised: LinearisedProblem, index: int) -> bool:
    """Tell whether a steady force at some connection moves an output ever further along a record.

    Dry friction holds a machine where it stands still, so the answer may differ from record to record.
    """
    experiment = linearised.experiments[index]
    steady = np.ones_like(np.asarray(experiment.record.time))
    perturbations = [InputPerturbation(f"probe.{place.name}", steady) for place in linearised.system.places]
    if not perturbations:
        return False
    start = linearised.initial_state(index)
    changed = experiment.respond(
        linearised.slim, linearised.p, start, perturbations=perturbations, sensors=linearised.sensors
    ).derivatives
    return any(
        keeps_growing(np.abs(changed[:, c, k])) for c in range(changed.shape[1]) for k in range(changed.shape[2])
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _RandomForce:
    """A random force at a connection, fitted to the residual.

    Parameters
    ----------
    times : list of ndarray, shape (k,), s
        At which the force has a value, in each record.
    responses : list of ndarray, shape (n, n_channels, k)
        Response of the outputs to each value.
    size, memory : float
        Standard deviation, N or N·m, and memory, s.
    noise : ndarray, shape (n_channels,)
        Size of each output's residual after the force, not below the noise floor.
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
    def at(cls, linearised: LinearisedProblem, place: Place) -> _RandomForce:
        """Estimate the force at a place and the noise of the outputs, each given the other, in turns."""
        residual = linearised.residual()
        given = [force_responses(linearised, place, i) for i in range(len(linearised.experiments))]
        times, responses = [t for t, _ in given], [r for _, r in given]
        floor = np.array([linearised.noise[n] for n in residual.channels])
        noise = _rms(residual.blocks)
        count = sum(len(block) for block in residual.blocks)
        without = None
        best = cls(times=times, responses=responses, size=0.0, memory=1.0, noise=noise, log_likelihood=-np.inf)
        if not all(np.all(np.isfinite(r)) for r in responses):  # the response diverges
            return best
        for _ in range(ROUNDS):
            equations = ForceEquations.of(linearised, responses, noise)
            posterior = force_posterior(equations.A, equations.b, times)
            none = -0.5 * equations.energy - count * float(np.sum(np.log(noise)))
            without = none if without is None else without
            best = cls(
                times=times,
                responses=responses,
                size=posterior.size,
                memory=posterior.memory,
                noise=noise,
                log_likelihood=none + posterior.log_likelihood - without,
            )
            after = [e.reshape(-1, noise.size) for e in equations.residuals_after(posterior.mean)]
            noise = np.maximum(floor, np.minimum(noise * _rms(after), noise))
        return best

    def weighting(self) -> tuple[LowRankWeighting, ...]:
        """Return the weights of each record."""
        weights = []
        for times, response in zip(self.times, self.responses, strict=True):
            root = np.linalg.cholesky(exponential_correlation(times, self.memory) + 1e-9 * np.eye(times.size))
            weights.append(low_rank_weighting(self.size * response @ root, self.noise))
        return tuple(weights)


def _rms(blocks: Sequence[np.ndarray]) -> np.ndarray:
    return np.maximum(np.sqrt(np.mean(np.concatenate(blocks) ** 2, axis=0)), 1e-300)
