"""The random forces that a fitted model needs beside its sensors' noise, in words and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.innovations.noise_model import Process
from multibody.base.quantity_text import quantity_text

__all__ = ["RandomForces", "random_forces_of", "slow_force_sentence"]


@dataclass(frozen=True, kw_only=True)
class RandomForces:
    """What acts at random on a machine and on its sensors.

    Parameters
    ----------
    processes : tuple of (Process, str)
        The latent processes, each with its unit.
    noise : dict of str to float
        Standard deviation of the white noise of each output, SI, in the means that the fit used.
    duration : float, s
        Of the longest record.
    """

    processes: tuple[tuple[Process, str], ...]
    noise: dict[str, float]
    duration: float

    @property
    def slower_than_records(self) -> tuple[tuple[Process, str], ...]:
        """The forces that remember longer than the longest record lasts."""
        return tuple((q, unit) for q, unit in self.processes if q.channel < 0 and q.outlasts(self.duration))

    @property
    def sentence(self) -> str:
        """What it is and what was done."""
        if not self.processes:
            return "The records ask for no random force beside the noise of their sensors."
        parts = [f"{_where_and_how_large(q, unit)} that {_how_fast(q)}" for q, unit in self.processes]
        return (
            f"Beside the noise of the sensors the records show {', '.join(parts[:-1])}{' and ' if parts[:-1] else ''}"
            f"{parts[-1]} (standard deviations). All effects were judged with these taken into account."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in diagnosis.json."""
        return {
            "processes": [
                {
                    "where": q.where,
                    "acts_on": "output" if q.channel >= 0 else "machine",
                    "size": q.std,
                    "unit": unit,
                    "memory_s": q.memory,
                    "frequency_hz": q.frequency,
                    "smooth": q.smooth,
                    "at_standstill": q.at_standstill,
                }
                for q, unit in self.processes
            ],
            "white_noise": self.noise,
        }


def slow_force_sentence(forces: RandomForces, output: str) -> str:
    """Return what to think of random forces that are slower than the records and that an output cannot do without."""
    parts = [_where_and_how_large(q, unit, "") for q, unit in forces.slower_than_records]
    return (
        f"Without {' and '.join(parts)} the model does not follow {output}. What changes more slowly than the records "
        "last, they cannot show to be chance."
    )


def _where_and_how_large(process: Process, unit: str, random: str = "random ") -> str:
    size = quantity_text(process.std, unit, 2)
    if process.channel >= 0:
        return f"a slow error of {size} in {process.where}"
    what = {"N": "force", "N*m": "torque"}.get(unit, "change")
    at = "in the rate of" if process.in_rate else "at"
    text = f"a {random}{what} of {size} {at} {process.where}"
    return f"{text} while it stands still" if process.at_standstill else text


def _how_fast(process: Process) -> str:
    if not process.swings:
        return f"changes {'smoothly ' if process.smooth else ''}within about {_seconds(process.memory)}"
    return f"swings at about {quantity_text(process.frequency, 'Hz', 2)}"


def _seconds(memory: float) -> str:
    return quantity_text(memory, "s", 2)


def random_forces_of(likelihood: StageLikelihood) -> RandomForces:
    """Return the random forces of a fitted model, those of no size left out."""
    stage, model = likelihood.stage, likelihood.noise.model
    places = {p.name: ("N*m" if p.domain == "rotation" else "N") for p in stage.system.places}

    def unit_of(process: Process) -> str:
        if process.channel < 0 and process.where in places:
            return places[process.where]
        unit = stage.system.unit(process.where)
        return f"({unit})/s" if process.in_rate else unit

    kept = tuple((q, unit_of(q)) for q in model.processes if q.std > 1e-6 * max(p.std for p in model.processes))
    noise = dict(zip(stage.outputs, model.noise, strict=True))
    return RandomForces(processes=kept, noise=noise, duration=likelihood.duration)
