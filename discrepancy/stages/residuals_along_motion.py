"""The residuals of a stage with the motion of its connections, and blocks in which they are independent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.stages.stage import Stage
from estimation.signals.correlation import correlation_time, cut_rows
from estimation.signals.preparation import Preparation

if TYPE_CHECKING:
    from multibody.assembly.places import Place

__all__ = ["PlaceMotion", "ResidualsAlongMotion", "residuals_along_motion"]

LEAST_BLOCKS = 8
MOST_BLOCKS = 40
COUPLED = 0.9999
"""Correlation of speeds from which two places count as moving together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaceMotion:
    """Motion of a connection in the model, on the samples that were compared, all records one after another.

    Attributes
    ----------
    place : Place
    position, speed, acceleration : ndarray, shape (n,), SI
    also : tuple of str
        Other places that move in proportion to it.
    """

    place: Place
    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    also: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the place."""
        return self.place.name

    @property
    def moves(self) -> bool:
        """False if the place stands still in these records."""
        return bool(np.ptp(self.position) > 1e-12)


@dataclass(frozen=True, eq=False, kw_only=True)
class ResidualsAlongMotion:
    """Residuals of a part of a stage, with the motion of its connections.

    Attributes
    ----------
    stage : Stage
    part : {"identify", "validate"}
    linearised : LinearisedProblem
        The calibrated model along the part's records, with their own preparation.
    time : ndarray, shape (n,), s
        Of all records, one after another.
    values : ndarray, shape (n, n_channels)
    record : ndarray of int, shape (n,)
    motions : tuple of PlaceMotion
        Of every place that moves.
    blocks : tuple of ndarray of int
        Rows of blocks longer than the residual's memory, none across two records.
    """

    stage: Stage
    part: str
    linearised: LinearisedProblem
    time: np.ndarray
    values: np.ndarray
    record: np.ndarray
    motions: tuple[PlaceMotion, ...]
    blocks: tuple[np.ndarray, ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.stage.outputs

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the outputs."""
        return tuple(self.stage.system.unit(n) for n in self.outputs)

    @property
    def noise(self) -> np.ndarray:
        """Noise floor of each output; the residual's own size where none is known, shape (n_channels,)."""
        own = np.sqrt(np.mean(self.values**2, axis=0))
        known = np.array([self.stage.noise.get(n, 0.0) for n in self.outputs])
        return np.where(known > 0.0, known, np.maximum(own, 1e-300))

    def guides(self) -> list[PlaceMotion]:
        """Return the places that move against the ground, one of each coupled group; else all that move."""
        moving = [m for m in self.motions if m.moves]
        return [m for m in moving if m.place.second is None] or moving

    def jackknife(self) -> Iterator[np.ndarray]:
        """Yield, for each block, the rows that remain when it is left out."""
        for block in self.blocks:
            remain = np.ones(len(self.values), dtype=bool)
            remain[block] = False
            yield np.flatnonzero(remain)


def coupled_places(motions: Sequence[PlaceMotion]) -> list[list[PlaceMotion]]:
    """Return groups of places whose speeds are proportional: a rigid coupling, whatever its ratio."""
    groups: list[list[PlaceMotion]] = []
    for m in motions:
        for group in groups:
            a, b = group[0].speed, m.speed
            size = float(np.linalg.norm(a) * np.linalg.norm(b))
            if size > 0.0 and abs(float(a @ b)) > COUPLED * size:
                group.append(m)
                break
        else:
            groups.append([m])
    return groups


def residuals_along_motion(stage: Stage, part: str = "identify") -> ResidualsAlongMotion:
    """Collect the residuals of a part of a stage and the motion of every place.

    Raises
    ------
    ValueError
        If the part has no records.
    """
    calibration = stage.identify if part == "identify" else stage.validate
    if calibration is None or not calibration.fits:
        raise ValueError(f"stage '{stage.name}' has no records in part '{part}'")
    fits = calibration.fits
    linearised = LinearisedProblem(  # without noise floors: nothing is weighted here
        system=stage.system,
        slim=stage.slim,
        calibration=calibration,
        sensors=stage.sensors,
        preparation=fits[0].experiment.preparation,
        p=stage.p,
    )
    time = np.concatenate([f.experiment.time for f in fits])
    values = np.concatenate([f.residual for f in fits])
    lengths = [len(f.experiment.time) for f in fits]
    record = np.repeat(np.arange(len(fits)), lengths)
    motions = _motions(linearised, stage, [f.experiment.preparation for f in fits])
    memory = max(correlation_time(f.residual[:, c]) for f in fits for c in range(values.shape[1]))
    # With fewer blocks no spread can be estimated; shorter blocks are then the lesser evil.
    shortest = min(int(3 * memory), max(1, len(values) // LEAST_BLOCKS))
    blocks = tuple(cut_rows(lengths, shortest, MOST_BLOCKS))
    return ResidualsAlongMotion(
        stage=stage,
        part=part,
        linearised=linearised,
        time=time,
        values=values,
        record=record,
        motions=motions,
        blocks=blocks,
    )


def _motions(
    linearised: LinearisedProblem, stage: Stage, preparations: Sequence[Preparation]
) -> tuple[PlaceMotion, ...]:
    motions = []
    parts: dict[str, list[np.ndarray]] = {}
    wanted = [f"place.{p.name}.{n}" for p in stage.system.places for n, _ in p.motion_names()]
    wanted = [n for n in wanted if n in stage.system.output_names]
    if not wanted:
        return ()
    for i, preparation in enumerate(preparations):
        run = linearised.nominal_outputs(i)
        table = np.column_stack([run[n] for n in wanted])
        table = preparation.apply(np.asarray(linearised.experiments[i].record.time), table)[1]
        for k, name in enumerate(wanted):
            parts.setdefault(name, []).append(table[:, k])
    series = {name: np.concatenate(arrays) for name, arrays in parts.items()}
    step = float(np.median(np.diff(linearised.experiments[0].time)))
    for place in stage.system.places:
        names = [f"place.{place.name}.{n}" for n, _ in place.motion_names()]
        if names[0] not in series or names[1] not in series:
            continue
        speed = series[names[1]]
        acceleration = series[names[2]] if names[2] in series else np.gradient(speed, step)
        motions.append(PlaceMotion(place=place, position=series[names[0]], speed=speed, acceleration=acceleration))
    independent = []
    for group in coupled_places([m for m in motions if m.moves]):
        lead = min(group, key=lambda m: m.place.second is not None)
        also = tuple(m.name for m in group if m is not lead)
        independent.append(replace(lead, also=also))
    return tuple(independent)
