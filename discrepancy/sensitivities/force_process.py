"""An unknown force at a connection as a Gaussian process: its responses, its normal equations, its posterior.

The force has an exponential memory; it is given by values at evenly spaced times and straight lines between them.  Its
effect on the outputs is computed with the exact linearisation of the machine along the calibrated motion, so the
posterior mean of the values, with the calibration and each record's own unknowns integrated out, is the result of a
smoother of the same model.  Memory and size maximise the marginal likelihood (Rasmussen and Williams: Gaussian
Processes for Machine Learning, 2006, chapter 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.hat_functions import even_hat_functions
from estimation.response.perturbations import InputPerturbation, cheaper_by_transition_matrices

if TYPE_CHECKING:
    from multibody.assembly.places import Place

__all__ = [
    "ForceEquations",
    "exponential_correlation",
    "force_posterior",
    "force_responses",
    "keep_matrices_of_all_places",
]

#: Values of the force in a record, and in all records together.
MOST_VALUES, MOST_VALUES_TOGETHER = 120, 720
FORCE_MEMORIES = (2.0, 5.0, 15.0, 50.0)
FORCE_SIZES = tuple(np.geomspace(0.1, 30.0, 10))


def _knots(time: np.ndarray, records: int) -> np.ndarray:
    count = int(min(MOST_VALUES, MOST_VALUES_TOGETHER // max(records, 1), time.size // 4))
    return np.linspace(time[0], time[-1], max(count, 8))


def keep_matrices_of_all_places(linearised: LinearisedProblem) -> None:
    """Integrate the state-transition matrices of every record with the forces at all places, where they will be used.

    They are kept with the record.  Asked for one place after another, they would be integrated anew for each.
    """
    places = linearised.system.places
    for i, experiment in enumerate(linearised.experiments):
        time = np.array(experiment.record.time)
        nothing = np.zeros(time.size)
        forces = [InputPerturbation(f"probe.{place.name}", nothing) for place in places]
        values = forces * len(_knots(time, len(linearised.experiments)))
        if cheaper_by_transition_matrices(linearised.slim, values, time.size):
            experiment.perturbation_response(linearised.slim, linearised.p, linearised.initial_state(i), forces)


def force_responses(linearised: LinearisedProblem, place: Place, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times at which a force at a place has a value in a record, and the response to each value.

    Returns
    -------
    knots : ndarray, shape (k,), s
    responses : ndarray, shape (n, n_channels, k), SI per newton or newton metre
    """
    experiment = linearised.experiments[index]
    time = np.array(experiment.record.time)
    knots = _knots(time, len(linearised.experiments))
    position = np.clip((time - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
    basis = even_hat_functions(position, len(knots))
    perturbations = [InputPerturbation(f"probe.{place.name}", np.ascontiguousarray(column)) for column in basis.T]
    changed = experiment.respond(
        linearised.slim,
        linearised.p,
        linearised.initial_state(index),
        perturbations=perturbations,
        sensors=linearised.sensors,
        batch=96,
    ).derivatives
    return knots, linearised.weighted(index, changed)


@dataclass(frozen=True, eq=False, kw_only=True)
class ForceEquations:
    """Normal equations for the values of a force, with each record's own unknowns and the calibration eliminated.

    Parameters
    ----------
    A : ndarray, shape (n, n)
    b : ndarray, shape (n,)
        Normal equations A·force = b of all records together.
    rows : list of (ndarray, ndarray, ndarray)
        Residual, derivatives by the force and by the parameters, of each record, in standard deviations of the outputs.
    at_rest, with_force : ndarray
        Change of the parameters without a force, and its reduction by each value of the force.
    energy : float
        Sum of squares without a force.
    """

    A: np.ndarray
    b: np.ndarray
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    at_rest: np.ndarray
    with_force: np.ndarray
    energy: float

    @classmethod
    def of(cls, linearised: LinearisedProblem, responses: Sequence[np.ndarray], noise: np.ndarray) -> ForceEquations:
        """Set up the equations from the responses of every record, (n, n_channels, k), and the outputs' noise."""
        residual, sens = linearised.residual(), linearised.sensitivities()
        given = np.isfinite(sens.prior_std)
        held = np.where(given, 1.0 / np.where(given, sens.prior_std, 1.0) ** 2, 0.0)
        G, g = np.diag(held), held * sens.prior_offset
        rows = []
        for block, response, slopes, own in zip(residual.blocks, responses, sens.blocks, sens.nuisance, strict=True):
            parts = [block[:, :, None], response, slopes]
            e, Z, F = ((m / noise[:, None]).reshape(block.size, m.shape[2]) for m in parts)
            if own is not None:
                q, _ = np.linalg.qr((own / noise[:, None]).reshape(block.size, -1))
                e, Z, F = (m - q @ (q.T @ m) for m in (e, Z, F))
            rows.append((e[:, 0], Z, F))
            G += F.T @ F
            g += F.T @ e[:, 0]
        A = block_diag(*(Z.T @ Z for _, Z, _ in rows))
        b = np.concatenate([Z.T @ e for e, Z, _ in rows])
        C = np.concatenate([Z.T @ F for _, Z, F in rows])
        energy = sum(float(e @ e) for e, _, _ in rows)
        if not g.size:
            return cls(A=A, b=b, rows=rows, at_rest=g, with_force=np.zeros((0, b.size)), energy=energy)
        solved = np.linalg.lstsq(G, np.column_stack([C.T, g]), rcond=1e-12)[0]
        with_force, at_rest = solved[:, :-1], solved[:, -1]
        return cls(
            A=A - C @ with_force,
            b=b - C @ at_rest,
            rows=rows,
            at_rest=at_rest,
            with_force=with_force,
            energy=energy - float(g @ at_rest),
        )

    def residuals_after(self, force: np.ndarray) -> list[np.ndarray]:
        """Return the residual of every record after a force and the best parameters with it, in standard deviations."""
        theta = self.at_rest - self.with_force @ force
        ends = np.cumsum([Z.shape[1] for _, Z, _ in self.rows])[:-1]
        return [e - Z @ f - F @ theta for (e, Z, F), f in zip(self.rows, np.split(force, ends), strict=True)]


def exponential_correlation(times: np.ndarray, memory: float) -> np.ndarray:
    """Return the correlation matrix of a force with an exponential memory, s, at some times."""
    return np.exp(-np.abs(times[:, None] - times) / memory)


@dataclass(frozen=True, eq=False, kw_only=True)
class ForcePosterior:
    """The force with the memory and size that maximise the marginal likelihood.

    Parameters
    ----------
    mean, std : ndarray, shape (n,)
    size : float
        Prior standard deviation.
    memory : float, s
    known : float
        Share of the force's variance that the records determine, 0 to 1.
    log_likelihood : float
        Marginal, above that of no force.
    """

    mean: np.ndarray
    std: np.ndarray
    size: float
    memory: float
    known: float
    log_likelihood: float


def force_posterior(A: np.ndarray, b: np.ndarray, times: Sequence[np.ndarray]) -> ForcePosterior:
    """Return the posterior of a force from its normal equations and the times of its values in each record."""
    step = float(np.median([t[1] - t[0] for t in times]))
    # b is A times the force: its root mean square, were all values determined equally well
    usual = np.sqrt(max(float(b @ b), 1e-300)) / max(float(np.trace(A @ A)) ** 0.5, 1e-300)
    best: tuple[float, float, np.ndarray, float] | None = None
    for memory in FORCE_MEMORIES:
        K = np.zeros_like(A)
        at = 0
        for t in times:
            K[at : at + len(t), at : at + len(t)] = exponential_correlation(t, memory * step)
            at += len(t)
        L = np.linalg.cholesky(K + 1e-9 * np.eye(len(K)))
        values, vectors = np.linalg.eigh(L.T @ A @ L)
        values = np.maximum(values, 0.0)
        beta = vectors.T @ (L.T @ b)
        for size in FORCE_SIZES:
            s2 = (size * usual) ** 2
            gain = -0.5 * float(np.sum(np.log1p(s2 * values))) + 0.5 * float(np.sum(beta**2 * s2 / (1 + s2 * values)))
            if best is None or gain > best[0]:
                best = (gain, memory, L @ vectors * np.sqrt(s2 / (1 + s2 * values)), s2)
    assert best is not None
    gain, memory, root, s2 = best
    mean = root @ (root.T @ b)
    variance = np.sum(root**2, axis=1)
    return ForcePosterior(
        mean=mean,
        std=np.sqrt(variance),
        size=float(np.sqrt(s2)),
        memory=memory * step,
        known=float(1.0 - np.mean(variance) / s2),
        log_likelihood=gain,
    )
