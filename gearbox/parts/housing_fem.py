"""Modes of a box of plates by finite elements (scikit-fem, the extra ``[fem]``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.errors import GearError
from gearbox.parts.housing import SEATS
from gearbox.parts.housing_modes import PLACES, ModeSet

__all__ = ["BoxHousing", "box_housing_modes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class BoxHousing:
    """A closed box of plates with four feet at the corners of its floor.

    Parameters
    ----------
    low, high : tuple of three float, m
        Outer corners.
    wall : float, m
        Thickness of all walls.
    modulus, poisson, density : float
        Material: Pa, 1, kg/m³.
    foot : float, m
        Side of the squares of the floor that are held.
    seat_radius : float, m
        A bearing seat moves as the mean of its wall within this radius.
    cells : int
        Elements along the longest side; quadratic hexahedra, one across the wall.
    """

    low: tuple[float, float, float] = (-0.18, -0.125, -0.087)
    high: tuple[float, float, float] = (0.20, 0.125, 0.087)
    wall: float = 0.012
    modulus: float = 110e9
    poisson: float = 0.26
    density: float = 7200.0
    foot: float = 0.05
    seat_radius: float = 0.042
    cells: int = 14

    def faults(self, places: Mapping[str, tuple[float, float, float]]) -> list[str]:
        """Return what is wrong with the box or the places on it."""
        size = np.subtract(self.high, self.low)
        faults = []
        if np.any(size <= 2.0 * self.wall) or not self.wall > 0.0:
            faults.append(f"walls of {self.wall:g} m leave nothing inside a box of {tuple(map(float, size))} m")
        for name in ("modulus", "density", "foot", "seat_radius"):
            if not getattr(self, name) > 0.0:
                faults.append(f"{name} is {getattr(self, name):g}: give a positive number")
        if not 0.0 <= self.poisson < 0.5:
            faults.append(f"poisson is {self.poisson:g}: give 0 to below 0.5")
        for name in PLACES:
            if name not in places:
                faults.append(f"there is no place '{name}'")
            elif np.any(np.less(places[name], np.subtract(self.low, 1e-9))) or np.any(
                np.greater(places[name], np.add(self.high, 1e-9))
            ):
                faults.append(f"'{name}' at {places[name]} m is outside the box")
        return faults


def box_housing_modes(
    places: Mapping[str, tuple[float, float, float]],
    count: int = 16,
    *,
    box: BoxHousing | None = None,
    damping: float = 0.02,
    name: str = "box",
    held: bool = True,
) -> ModeSet:
    """Return the lowest modes of a box, mass-normalised, at its seats, sensors and feet.

    Parameters
    ----------
    places : mapping of str to (x, y, z), m
        Seats and sensors; each is taken at the nearest points of the box.
    count : int
    box : BoxHousing, optional
    damping : float
        Ratio of all modes; finite elements know nothing of it.
    held : bool
        True: the feet stand still.  False: the box is free, its first six modes are those of a rigid body, and its feet
        are mounts, for `gearbox.parts.housing_modes.ModeSet.on_mounts`.

    Raises
    ------
    GearError
        If the box or a place makes no sense, or scikit-fem is not installed.
    """
    box = box if box is not None else BoxHousing()
    if faults := box.faults(places):
        raise GearError(f"the housing '{name}'", faults)
    try:
        import skfem
    except ImportError:
        raise GearError(
            f"the housing '{name}'", ["finite elements need scikit-fem: pip install 'vtsdt[fem]'"]
        ) from None
    from scipy.sparse.linalg import eigsh

    mesh = _mesh(skfem, box)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    K, M = _matrices(skfem, basis, box)
    fixed = basis.get_dofs(lambda x: _on_feet(x, box)).all() if held else []
    free = np.setdiff1d(np.arange(K.shape[0]), fixed)
    # A free body's stiffness is singular: look a little below zero.
    sigma = 0.0 if held else -((2.0 * np.pi * 50.0) ** 2)
    values, vectors = eigsh(K[free][:, free].tocsc(), k=count, M=M[free][:, free].tocsc(), sigma=sigma)
    order = np.argsort(values)
    if not held:
        values[order[:6]] = 0.0
    full = np.zeros((K.shape[0], count))
    full[free] = vectors[:, order]
    spots, dofs = _nodes(basis)
    shapes = {p: _shape(full, spots, dofs, places[p], box.seat_radius if p in SEATS else 0.0) for p in PLACES}
    mounts = {} if held else _feet(full, spots, dofs, box)
    for k in range(count):  # the sign of a mode is free: make it the same on every machine
        column = np.concatenate([shapes[p][k] for p in PLACES])
        if column[np.argmax(np.abs(column))] < 0.0:
            for shape in (*shapes.values(), *mounts.values()):
                shape[k] *= -1.0
    origin = (
        f"scikit-fem {skfem.__version__}, quadratic hexahedra, {free.size} degrees of freedom; box "
        f"{tuple(box.low)} to {tuple(box.high)} m, wall {box.wall:g} m, E {box.modulus:g} Pa, nu {box.poisson:g}, "
        f"rho {box.density:g} kg/m**3, four feet of {box.foot:g} m {'held' if held else 'free'}; damping {damping:g} "
        "chosen"
    )
    return ModeSet(
        name=name,
        frequencies=np.sqrt(values[order]) / (2.0 * np.pi),
        damping=np.full(count, damping),
        shapes=shapes,
        origin=origin,
        mounts=mounts,
    )


def _mesh(skfem: Any, box: BoxHousing) -> Any:
    size = np.subtract(box.high, box.low)
    step = float(size.max()) / box.cells
    lines = []
    for low, high in zip(box.low, box.high, strict=True):
        inner = np.linspace(low + box.wall, high - box.wall, max(2, round((high - low) / step)) + 1)
        lines.append(np.concatenate([[low], inner, [high]]))
    mesh = skfem.MeshHex.init_tensor(*lines)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    walls = zip(middle, box.low, box.high, strict=True)
    inside = np.all([(m > lo + box.wall) & (m < hi - box.wall) for m, lo, hi in walls], axis=0)
    return mesh.remove_elements(np.flatnonzero(inside))


def _matrices(skfem: Any, basis: Any, box: BoxHousing) -> tuple[Any, Any]:
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    K = linear_elasticity(*lame_parameters(box.modulus, box.poisson)).assemble(basis)
    M = skfem.BilinearForm(lambda u, v, w: box.density * dot(u, v)).assemble(basis)
    return K, M


def _on_feet(x: Array, box: BoxHousing) -> Array:
    def at_corner(value: Array, low: float, high: float) -> Array:
        return np.asarray((value < low + box.foot) | (value > high - box.foot))

    floor = x[1] < box.low[1] + 1e-9
    return np.asarray(floor & at_corner(x[0], box.low[0], box.high[0]) & at_corner(x[2], box.low[2], box.high[2]))


def _nodes(basis: Any) -> tuple[Array, NDArray[np.int64]]:
    """Places of the corner nodes of the mesh, shape (n, 3), and their degrees of freedom, shape (n, 3)."""
    return basis.mesh.p.T, basis.nodal_dofs.T


def _shape(
    full: Array, spots: Array, dofs: NDArray[np.int64], place: tuple[float, float, float], radius: float
) -> Array:
    """Mean shape of the nodes near a place, shape (m, 3): within a radius, at least the nearest one."""
    apart = np.linalg.norm(spots - np.asarray(place), axis=1)
    near = np.flatnonzero(apart <= max(radius, float(apart.min()) + 1e-9))
    return np.stack([full[dofs[near, axis]].mean(axis=0) for axis in range(3)], axis=1)


def _feet(full: Array, spots: Array, dofs: NDArray[np.int64], box: BoxHousing) -> dict[str, Array]:
    """Mean shape of the nodes of each foot, shape (m, 3)."""
    on = np.flatnonzero(_on_feet(spots.T, box))
    middle = 0.5 * np.add(box.low, box.high)
    feet = {}
    for number, (x, z) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1)), start=1):
        at = on[(np.sign(spots[on, 0] - middle[0]) == x) & (np.sign(spots[on, 2] - middle[2]) == z)]
        feet[f"mount_{number}"] = np.stack([full[dofs[at, axis]].mean(axis=0) for axis in range(3)], axis=1)
    return feet
