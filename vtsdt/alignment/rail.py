"""Equivalent deviation of rails, and a rail that has a given equivalent deviation."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

__all__ = ["equivalent_deviation", "pressing_deviation", "rail_profile"]


def equivalent_deviation(rails: dict[str, Any], shoes: Sequence[float], height: np.ndarray) -> np.ndarray:
    """Return the deviation of a single rail that presses on the shoes as both rails do, by the cabin's height.

    With all four shoes in contact each level of shoes is squeezed by the sum of its two rails' deviations, and the
    normal forces add up to the mean of the levels.  Where a level of shoes is loose they add up to more, see
    `pressing_deviation`.

    Parameters
    ----------
    rails : dict of str to RailProfile
        ``left_x`` and ``right_x``; a missing one is straight.
    shoes : sequence of float, m
        Heights of the shoes above the floor.
    height : ndarray, shape (n,), m
    """
    used = [rails[name] for name in ("left_x", "right_x") if rails.get(name) is not None]
    return np.array([np.mean([sum(r.at(h + s) for r in used) for s in shoes]) if used else 0.0 for h in height])


def pressing_deviation(parameters: LiftParameters, height: np.ndarray) -> np.ndarray:
    """Return the deviation of a single rail that presses on the shoes as hard as all rails of a lift do.

    Friction shows this quantity of the guides, and it is the δ of González et al. 2020, section IV-B: the left rail
    and both y directions straight, and the normal forces of the real guides.  Normal forces are those of the cabin at
    rest at each height, with all its rails in both directions.  As long as all shoes press it is the sum of both rails'
    deviations in x; the normal force of a loose shoe cannot be negative, and a cabin whose centre of mass is not below
    its ropes leans on the rail all the same.

    Parameters
    ----------
    parameters : LiftParameters
        With the true rails, mass and contact.
    height : ndarray, shape (n,), m
        Of the cabin's floor.
    """
    weight = parameters.cabin.mass * STANDARD_GRAVITY

    def normal_forces(
        lift: Lift, heights: Sequence[float], name: str = "", values: Sequence[float] = (0.0,)
    ) -> list[float]:
        system = lift.build(outputs=["Nsum_c"])
        forces = []
        for value in values:
            p = system.parameter_vector({name: value} if name else None)
            for z in heights:
                rest = lift.equilibrium(float(z), system=system, parameters=p, inputs={"F_c": weight})
                forces.append(float(system.outputs_at(0.0, rest.state, np.array([weight]), p)[0]))
        return forces

    guide = parameters.cabin_guide
    straight = Lift.cabin(dataclasses.replace(parameters, cabin_guide=guide.straightened()))
    two = 2.0 * guide.clearance + np.array([0.5e-3, 1.0e-3])
    low, high = normal_forces(straight, (float(np.median(height)),), "cabin_guide.right_deviation", list(two))
    forces = np.array(normal_forces(Lift.cabin(parameters), list(height)))
    return two[0] + (forces - low) * (two[1] - two[0]) / (high - low)


def rail_profile(
    height: np.ndarray,
    deviation: np.ndarray,
    std: np.ndarray,
    shoes: Sequence[float],
    *,
    length: float = 0.15,
    size: float = 0.5e-3,
    step: float = 0.02,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a rail whose equivalent deviation is the given one: heights, deviation, standard deviation.

    Two levels of shoes see the mean of the rail at two heights, so waves of twice their distance are not observable:
    the result is the mean of a Gaussian process (Matérn-3/2) given the equivalent deviation, whose standard deviation
    shows where the rail remains unknown.

    Parameters
    ----------
    height, deviation, std : ndarray, shape (n,), m
        Equivalent deviation by the cabin's height, and its standard deviation.
    shoes : sequence of float, m
    length, size : float, m
        Correlation length and size of the rail's deviations about their mean.
    step : float, m
        Between the heights of the result.
    """
    low, high = height[0] + min(shoes), height[-1] + max(shoes)
    points = np.linspace(low, high, int(np.ceil((high - low) / step)) + 1)

    def covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        distance = np.sqrt(3.0) * np.abs(a[:, None] - b[None, :]) / length
        return size**2 * (1.0 + distance) * np.exp(-distance)

    levels = [height + s for s in shoes]
    k_yy = np.mean([covariance(a, b) for a in levels for b in levels], axis=0)
    k_xy = np.mean([covariance(points, b) for b in levels], axis=0)
    noise = np.diag(np.maximum(std, 0.02e-3) ** 2)
    middle = float(np.mean(deviation))
    weights = np.linalg.solve(k_yy + noise, np.column_stack([deviation - middle, k_xy.T]))
    mean = middle + k_xy @ weights[:, 0]
    variance = size**2 - np.einsum("ij,ji->i", k_xy, weights[:, 1:])
    return points, mean, np.sqrt(np.maximum(variance, 0.0))
