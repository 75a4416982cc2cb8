"""The missing force itself, over time, at one connection: what the records say of it before anyone gives it a law.

The force at the connection is a Gaussian process with an exponential memory, given by values at evenly spaced times and
straight lines between them.  Its effect on the outputs goes through the exact linearisation of the machine along the
calibrated motion, so that the posterior mean of the values, with what calibration may move and each record's own
unknowns integrated out, is what a smoother of the same model gives.  Memory and size have the largest marginal
likelihood (Rasmussen and Williams: Gaussian Processes for Machine Learning, 2006, chapter 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from discrepancy.effects.law_along_motion import MOTION
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from estimation.response.perturbations import Push
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from multibody.assembly.places import Place

__all__ = ["ForceEquations", "ForceEstimate", "correlated", "estimate_force", "force_posterior", "force_responses"]

#: Values of the force in a record, and in all records together.
MOST, MOST_TOGETHER = 120, 720
MEMORIES = (2.0, 5.0, 15.0, 50.0)
SIZES = tuple(np.geomspace(0.1, 30.0, 10))
KNOWN = 0.5


@dataclass(frozen=True, eq=False)
class ForceEstimate:
    """A force at a connection over time.

    Parameters
    ----------
    where, unit : str
    time, force, std : ndarray, shape (n,)
        Records one after another.
    record : ndarray of int, shape (n,)
    motion : dict of str to ndarray, shape (n,)
        ``position`` and ``speed`` of the connection, ``time``, and ``load`` where a force passes through.
    units : dict of str to str
    memory : float, s
    known : float
        Share of the force's variance that the records determine, 0 to 1.
    log_likelihood : float
        Marginal, above that of no force at all.
    """

    where: str
    unit: str
    time: np.ndarray
    force: np.ndarray
    std: np.ndarray
    record: np.ndarray
    motion: dict[str, np.ndarray]
    units: dict[str, str]
    memory: float
    known: float
    log_likelihood: float

    @property
    def reconstructable(self) -> bool:
        """True if the sensors determine at least half of the force's variance."""
        return self.known >= KNOWN


def _knots(time: np.ndarray, records: int) -> np.ndarray:
    count = int(min(MOST, MOST_TOGETHER // max(records, 1), time.size // 4))
    return np.linspace(time[0], time[-1], max(count, 8))


def _between(time: np.ndarray, knots: np.ndarray) -> np.ndarray:
    s = np.clip((time - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(s[:, None] - np.arange(len(knots))))


def force_responses(facts: LinearisedProblem, place: Place, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of a record at which a force at a place has a value, and what each value makes of the residual.

    Returns
    -------
    knots : ndarray, shape (k,), s
    responses : ndarray, shape (n, n_channels, k), SI per newton or newton metre
    """
    experiment = facts.experiments[index]
    time = np.array(experiment.record.time)
    knots = _knots(time, len(facts.experiments))
    pushes = [Push(f"probe.{place.name}", np.ascontiguousarray(column)) for column in _between(time, knots).T]
    found = experiment.respond(
        facts.slim, facts.p, facts.start(index), pushes=pushes, sensors=facts.sensors, batch=96
    ).derivatives
    return knots, facts.shaped(index, found)


@dataclass(frozen=True, eq=False)
class ForceEquations:
    """Least squares for the values of a force, each record's own unknowns and what calibration may move taken out.

    Parameters
    ----------
    A : ndarray, shape (n, n)
    b : ndarray, shape (n,)
        Normal equations A·force = b of all records together.
    rows : list of (ndarray, ndarray, ndarray)
        Residual, derivatives by the force and by the parameters, of each record, in deviations of the outputs.
    at_rest, with_force : ndarray
        Change of the parameters without a force, and for each value of it what it takes from that.
    energy : float
        Sum of squares that is left without a force.
    """

    A: np.ndarray
    b: np.ndarray
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    at_rest: np.ndarray
    with_force: np.ndarray
    energy: float

    @classmethod
    def of(cls, facts: LinearisedProblem, responses: Sequence[np.ndarray], noise: np.ndarray) -> ForceEquations:
        """Set up the equations from the responses of every record, (n, n_channels, k), and the outputs' noise."""
        residual, sens = facts.residual(), facts.sensitivities()
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
            return cls(A, b, rows, g, np.zeros((0, b.size)), energy)
        solved = np.linalg.lstsq(G, np.column_stack([C.T, g]), rcond=1e-12)[0]
        with_force, at_rest = solved[:, :-1], solved[:, -1]
        return cls(A - C @ with_force, b - C @ at_rest, rows, at_rest, with_force, energy - float(g @ at_rest))

    def left(self, force: np.ndarray) -> list[np.ndarray]:
        """Return what a force leaves of every record, in deviations, the parameters moved as is best beside it."""
        theta = self.at_rest - self.with_force @ force
        ends = np.cumsum([Z.shape[1] for _, Z, _ in self.rows])[:-1]
        return [e - Z @ f - F @ theta for (e, Z, F), f in zip(self.rows, np.split(force, ends), strict=True)]


def correlated(times: np.ndarray, memory: float) -> np.ndarray:
    """Return the correlation matrix of a force with an exponential memory, s, at some times."""
    return np.exp(-np.abs(times[:, None] - times) / memory)


def estimate_force(
    stage: Stage, facts: LinearisedProblem, place: Place, scale_of: Stage | None = None, *, all_of_it: bool = False
) -> ForceEstimate:
    """Estimate the force that a stage's model lacks at a place.

    Parameters
    ----------
    stage : Stage
        Without the force.
    facts : LinearisedProblem
        Of that stage.
    place : Place
    scale_of : Stage, optional
        Whose residual says how noisy each output is; default: the stage itself.
    all_of_it : bool
        Take every output to be as noisy as its noise floor, so that all of the residual is to be explained.
    """
    noisy = scale_of or stage
    scale = []
    for c, name in enumerate(stage.outputs):
        if all_of_it and noisy.noise.get(name, 0.0) > 0.0:
            scale.append(noisy.noise[name])
            continue
        parts = [f.residual[:, c] for f in noisy.identify.fits]
        rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        memory = float(np.mean([correlation_time(p) for p in parts]))
        coarser = parts[0].size / max(len(facts.experiments[0].time), 1)
        scale.append(max(rms, noisy.noise.get(name, 0.0), 1e-300) * np.sqrt(max(1.0, memory / coarser)))
    names = [n for n, _ in place.motion_names()]
    load = _load(stage, place)
    times, responses, records = [], [], []
    motion: dict[str, list[np.ndarray]] = {}
    for i, experiment in enumerate(facts.experiments):
        time = np.array(experiment.record.time)
        knots, response = force_responses(facts, place, i)
        responses.append(response)
        times.append(knots)
        records.append(np.full(len(knots), i))
        run = facts.motions(i)
        for general, own_name in zip(MOTION[:2], names[:2], strict=True):
            values = run[f"place.{place.name}.{own_name}"]
            motion.setdefault("speed" if general == "velocity" else general, []).append(np.interp(knots, time, values))
        motion.setdefault("time", []).append(knots - knots[0])
        if load:
            motion.setdefault("load", []).append(np.interp(knots, time, run[load]))
    equations = ForceEquations.of(facts, responses, np.array(scale))
    mean, std, _, step, known, likelihood = force_posterior(equations.A, equations.b, times)
    turns = place.domain == "rotation"
    units = {
        "position": "rad" if turns else "m",
        "speed": "rad/s" if turns else "m/s",
        "time": "s",
        "load": "N*m" if turns else "N",
    }
    stacked = {n: np.concatenate(v) for n, v in motion.items()}
    return ForceEstimate(
        place.name,
        units["load"],
        np.concatenate(times),
        mean,
        std,
        np.concatenate(records),
        stacked,
        {n: units[n] for n in stacked},
        step,
        known,
        likelihood,
    )


def _load(stage: Stage, place: Place) -> str:
    from discrepancy.effects.catalogue import catalogue

    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs, include=[f"*@{place.name}"])
    return next((e.load for e in entries if e.load), "")


def force_posterior(
    A: np.ndarray, b: np.ndarray, times: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, float, float, float, float]:
    """Return mean, deviation, size, memory, share known and marginal likelihood of the best memory and size."""
    step = float(np.median([t[1] - t[0] for t in times]))
    # b is A times the force: its root mean square, were all values determined equally well
    usual = np.sqrt(max(float(b @ b), 1e-300)) / max(float(np.trace(A @ A)) ** 0.5, 1e-300)
    best: tuple[float, float, np.ndarray, float] | None = None
    for memory in MEMORIES:
        K = np.zeros_like(A)
        at = 0
        for t in times:
            K[at : at + len(t), at : at + len(t)] = correlated(t, memory * step)
            at += len(t)
        L = np.linalg.cholesky(K + 1e-9 * np.eye(len(K)))
        values, vectors = np.linalg.eigh(L.T @ A @ L)
        values = np.maximum(values, 0.0)
        beta = vectors.T @ (L.T @ b)
        for size in SIZES:
            s2 = (size * usual) ** 2
            gain = -0.5 * float(np.sum(np.log1p(s2 * values))) + 0.5 * float(np.sum(beta**2 * s2 / (1 + s2 * values)))
            if best is None or gain > best[0]:
                best = (gain, memory, L @ vectors * np.sqrt(s2 / (1 + s2 * values)), s2)
    assert best is not None
    gain, memory, root, s2 = best
    mean = root @ (root.T @ b)
    variance = np.sum(root**2, axis=1)
    return mean, np.sqrt(variance), float(np.sqrt(s2)), memory * step, float(1.0 - np.mean(variance) / s2), gain
