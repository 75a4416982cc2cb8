"""The missing force itself, over time, at one connection: what the records say of it before it is given a law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.law_along_motion import MOTION
from discrepancy.sensitivities.force_process import ForceEquations, force_posterior, force_responses
from discrepancy.stages.stage import Stage
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from multibody.assembly.places import Place

__all__ = ["ForceEstimate", "estimate_force", "load_at"]

KNOWN = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
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
    def direction(self) -> np.ndarray:
        """Direction of travel at each sample, -1 to 1, through zero where the motion is slower than a hundredth."""
        speed = self.motion["speed"]
        direction: np.ndarray = np.tanh(speed / max(0.01 * float(np.max(np.abs(speed))), 1e-300))
        return direction

    @property
    def reconstructable(self) -> bool:
        """True if the sensors determine at least half of the force's variance."""
        return self.known >= KNOWN


def estimate_force(
    stage: Stage, place: Place, noise_of: Stage | None = None, *, explain_all: bool = False
) -> ForceEstimate:
    """Estimate the force that a stage's model lacks at a place.

    Parameters
    ----------
    stage : Stage
        Without the force.
    place : Place
    noise_of : Stage, optional
        Stage whose residual gives the noise of each output; default: the stage itself.
    explain_all : bool
        Take each output's noise floor as its noise, so that the force is to explain all of the residual.
    """
    linearised = stage.linearised_problem()
    noisy = noise_of or stage
    scale = []
    for c, name in enumerate(stage.outputs):
        if explain_all and noisy.noise.get(name, 0.0) > 0.0:
            scale.append(noisy.noise[name])
            continue
        parts = [f.residual[:, c] for f in noisy.identify.fits]
        rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        memory = float(np.mean([correlation_time(p) for p in parts]))
        coarser = parts[0].size / max(len(linearised.experiments[0].time), 1)
        scale.append(max(rms, noisy.noise.get(name, 0.0), 1e-300) * np.sqrt(max(1.0, memory / coarser)))
    names = [n for n, _ in place.motion_names()]
    load = load_at(stage, place)
    times, responses, records = [], [], []
    motion: dict[str, list[np.ndarray]] = {}
    for i, experiment in enumerate(linearised.experiments):
        time = np.array(experiment.record.time)
        knots, response = force_responses(linearised, place, i)
        responses.append(response)
        times.append(knots)
        records.append(np.full(len(knots), i))
        run = linearised.nominal_outputs(i)
        for general, own_name in zip(MOTION[:2], names[:2], strict=True):
            values = run[f"place.{place.name}.{own_name}"]
            motion.setdefault("speed" if general == "velocity" else general, []).append(np.interp(knots, time, values))
        motion.setdefault("time", []).append(knots - knots[0])
        if load:
            motion.setdefault("load", []).append(np.interp(knots, time, run[load]))
    equations = ForceEquations.of(linearised, responses, np.array(scale))
    posterior = force_posterior(equations.A, equations.b, times)
    turns = place.domain == "rotation"
    units = {
        "position": "rad" if turns else "m",
        "speed": "rad/s" if turns else "m/s",
        "time": "s",
        "load": "N*m" if turns else "N",
    }
    stacked = {n: np.concatenate(v) for n, v in motion.items()}
    return ForceEstimate(
        where=place.name,
        unit=units["load"],
        time=np.concatenate(times),
        force=posterior.mean,
        std=posterior.std,
        record=np.concatenate(records),
        motion=stacked,
        units={n: units[n] for n in stacked},
        memory=posterior.memory,
        known=posterior.known,
        log_likelihood=posterior.log_likelihood,
    )


def load_at(stage: Stage, place: Place) -> str:
    """Return the output of a stage's model that is the load at a place; an empty text where none passes through."""
    experiment = stage.identify.fits[0].experiment
    entries = catalogue(stage.system, experiment.outputs, experiment.inputs, include=[f"*@{place.name}"])
    return next((e.load for e in entries if e.load), "")
