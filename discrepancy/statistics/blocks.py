"""The arrays that the statistics work on: residual, sensitivities and candidates, block by block.

A block is one record (a trip, a run) or a part of one, sampled on a uniform grid. Nothing here knows where
the arrays came from: simulation, prediction error and inverse residuals are treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from multibody.base.memory import ArrayStore

Array = NDArray[np.float64]


class KeptSensitivities(Sequence[tuple[Array, ...]]):
    """Sensitivities of a candidate that a store keeps: read shape by shape, when they are asked for.

    Parameters
    ----------
    store : ArrayStore
    numbers : sequence over shapes of sequence over blocks of int
        Of the arrays in the store.
    """

    def __init__(self, store: ArrayStore, numbers: Sequence[Sequence[int]]) -> None:
        self._store, self._numbers = store, tuple(tuple(of_shape) for of_shape in numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, shape: int) -> tuple[Array, ...]: ...
    @overload
    def __getitem__(self, shape: slice) -> Sequence[tuple[Array, ...]]: ...
    def __getitem__(self, shape: int | slice) -> tuple[Array, ...] | Sequence[tuple[Array, ...]]:
        """Return the blocks of a shape."""
        if isinstance(shape, slice):
            return KeptSensitivities(self._store, self._numbers[shape])
        return tuple(self._store.get(k) for k in self._numbers[shape])


class Weighting(Protocol):
    """A linear map of one block's arrays, (n_t, n_channels) or (n_t, n_channels, k), and its inverse."""

    def __call__(self, block: Array) -> Array:
        """Return a block weighted."""
        ...

    def inverse(self, block: Array) -> Array:
        """Return a block as it was before it was weighted."""
        ...


def _check_blocks(name: str, blocks: Sequence[Array], ndim: int) -> list[str]:
    faults = []
    for i, b in enumerate(blocks):
        if b.ndim != ndim:
            faults.append(f"{name}: block {i} has {b.ndim} axes, expected {ndim}")
        elif not np.all(np.isfinite(b)):
            bad = np.argwhere(~np.isfinite(b))[0]
            faults.append(f"{name}: block {i} holds a value that is not finite at index {tuple(bad.tolist())}")
    return faults


def _raise_if(faults: list[str]) -> None:
    if faults:
        raise ValueError("; ".join(faults))


@dataclass(frozen=True)
class Residual:
    """Measured minus modelled outputs.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (n_t, n_channels)
        One array per record or part of a record, in the units of the outputs.
    dt : float
        Sampling interval, s.
    channels : sequence of str
        Names of the outputs, one per column.
    weighting : sequence of Weighting
        Weighting of each block, applied to its sensitivities and candidates as well; empty: none.

    Raises
    ------
    ValueError
        If shapes disagree, a value is not finite or ``dt`` is not positive; all faults are listed.
    """

    blocks: tuple[Array, ...]
    dt: float
    channels: tuple[str, ...]
    weighting: tuple[Weighting, ...] = ()

    def __init__(
        self, blocks: Sequence[Array], dt: float, channels: Sequence[str], weighting: Sequence[Weighting] = ()
    ) -> None:
        object.__setattr__(self, "blocks", tuple(np.asarray(b, dtype=float) for b in blocks))
        object.__setattr__(self, "dt", float(dt))
        object.__setattr__(self, "channels", tuple(channels))
        object.__setattr__(self, "weighting", tuple(weighting))
        faults = _check_blocks("residual", self.blocks, 2)
        if not self.blocks:
            faults.append("residual: no block given")
        if not dt > 0:
            faults.append(f"residual: dt must be positive, got {dt}")
        if not faults:
            for i, b in enumerate(self.blocks):
                if b.shape[1] != len(self.channels):
                    faults.append(f"residual: block {i} has {b.shape[1]} columns for {len(self.channels)} channels")
                if b.shape[0] < 16:
                    faults.append(f"residual: block {i} has {b.shape[0]} samples; at least 16 are needed")
        _raise_if(faults)

    @property
    def n_samples(self) -> int:
        """Number of scalar observations, all blocks and channels."""
        return sum(b.size for b in self.blocks)

    @property
    def duration(self) -> float:
        """Total recorded time, s."""
        return self.dt * sum(len(b) for b in self.blocks)


@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Derivatives of the outputs with respect to what calibration may move.

    Parameters
    ----------
    names : sequence of str
        Uncertain parameters.
    blocks : sequence of ndarray, shape (n_t, n_channels, n_theta)
        Derivative of the outputs, residual convention ``e = F·Δθ + noise``.
    prior_std : ndarray, shape (n_theta,), optional
        Prior standard deviation of each parameter; ``inf`` where there is no prior (the default).
    prior_offset : ndarray, shape (n_theta,), optional
        Prior mean minus the value at which the residual was computed; zero by default.
    nuisance : sequence of ndarray or None, shape (n_t, n_channels, q), optional
        Directions that belong to one block only (its initial state, its sensor offset), no prior.
    """

    names: tuple[str, ...]
    blocks: tuple[Array, ...]
    prior_std: Array
    prior_offset: Array
    nuisance: tuple[Array | None, ...]

    def __init__(
        self,
        names: Sequence[str],
        blocks: Sequence[Array],
        *,
        prior_std: Array | Sequence[float] | None = None,
        prior_offset: Array | Sequence[float] | None = None,
        nuisance: Sequence[Array | None] | None = None,
    ) -> None:
        p = len(names)
        object.__setattr__(self, "names", tuple(names))
        object.__setattr__(self, "blocks", tuple(np.asarray(b, dtype=float) for b in blocks))
        std = np.full(p, np.inf) if prior_std is None else np.asarray(prior_std, dtype=float)
        off = np.zeros(p) if prior_offset is None else np.asarray(prior_offset, dtype=float)
        object.__setattr__(self, "prior_std", std)
        object.__setattr__(self, "prior_offset", off)
        object.__setattr__(self, "nuisance", tuple(nuisance) if nuisance is not None else (None,) * len(self.blocks))
        faults = _check_blocks("sensitivities", self.blocks, 3)
        if not faults:
            for i, b in enumerate(self.blocks):
                if b.shape[2] != p:
                    faults.append(f"sensitivities: block {i} has {b.shape[2]} columns for {p} parameters")
        if std.shape != (p,) or np.any(~(std > 0)):
            faults.append("sensitivities: prior_std must hold one positive number (or inf) per parameter")
        if off.shape != (p,) or not np.all(np.isfinite(off)):
            faults.append("sensitivities: prior_offset must hold one finite number per parameter")
        if len(self.nuisance) != len(self.blocks):
            faults.append(f"sensitivities: {len(self.nuisance)} nuisance blocks for {len(self.blocks)} blocks")
        else:
            faults += _check_blocks("nuisance", [n for n in self.nuisance if n is not None], 3)
        _raise_if(faults)


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect that might be missing, at one place.

    Parameters
    ----------
    kind, where : str
        What it is and where it would act.
    sensitivities : sequence over shapes of sequence over blocks of ndarray, shape (n_t, n_channels, k)
        Derivative of the outputs with respect to the k strengths, for each point of the shape grid; in memory, or
        `KeptSensitivities`.
    shapes : sequence of mapping, optional
        Shape parameters of each grid point, for instance ``{"speed": 0.01}``; one empty mapping by default.
    one_sided : bool
        True if physics allows no negative strength (friction).
    strength_that_matters : float or None
        None: what moves an output by its noise floor.
    strengths : sequence of str, optional
        Names of the k strengths.
    unit : str
        Of the strengths.
    info : mapping
        What the maker of the candidate needs to know it by.
    """

    kind: str
    where: str
    sensitivities: Sequence[tuple[Array, ...]]
    shapes: tuple[Mapping[str, float], ...] = ()
    one_sided: bool = False
    strength_that_matters: float | None = None
    strengths: tuple[str, ...] = ()
    unit: str = ""
    info: Mapping[str, Any] = field(default_factory=dict)
    block_shapes: tuple[tuple[tuple[int, ...], ...], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        grid = self.sensitivities
        if not isinstance(grid, KeptSensitivities):
            grid = tuple(tuple(np.asarray(b, dtype=float) for b in blocks) for blocks in grid)
            object.__setattr__(self, "sensitivities", grid)
        if not self.shapes:
            object.__setattr__(self, "shapes", ({},) * len(grid))
        faults = []
        if not grid:
            faults.append(f"candidate {self.name}: no sensitivities")
        if len(self.shapes) != len(grid):
            faults.append(f"candidate {self.name}: {len(self.shapes)} shapes for {len(grid)} sets of sensitivities")
        block_shapes = []
        for blocks in grid:
            faults += _check_blocks(f"candidate {self.name}", blocks, 3)
            block_shapes.append(tuple(b.shape for b in blocks))
        object.__setattr__(self, "block_shapes", tuple(block_shapes))
        if not faults and len({b[2] for blocks in block_shapes for b in blocks}) > 1:
            faults.append(f"candidate {self.name}: the number of strengths must be the same everywhere")
        if not faults and self.one_sided and self.n_strengths > 2:
            faults.append(f"candidate {self.name}: a one-sided effect may have at most two strengths")
        if self.strength_that_matters is not None and not self.strength_that_matters > 0:
            faults.append(f"candidate {self.name}: strength_that_matters must be positive")
        _raise_if(faults)
        if not self.strengths:
            n = self.n_strengths
            names = ("strength",) if n == 1 else tuple(f"strength_{i + 1}" for i in range(n))
            object.__setattr__(self, "strengths", names)

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind}@{self.where}"

    @property
    def n_strengths(self) -> int:
        """Number of strengths, k."""
        return int(self.block_shapes[0][0][2])

    @property
    def n_free_shapes(self) -> int:
        """Number of shape parameters that the grid leaves free."""
        keys = {key for s in self.shapes for key in s}
        return sum(len({s.get(key) for s in self.shapes}) > 1 for key in keys)


def with_candidate(sens: Sensitivities, candidate: Candidate, shape: int = 0) -> Sensitivities:
    """Return sensitivities with an effect's strengths as further uncertain parameters without prior.

    They serve to test what remains after an effect: by a second scan, or by the omnibus test for lack of fit.
    """
    blocks = [np.concatenate([f, z], axis=2) for f, z in zip(sens.blocks, candidate.sensitivities[shape], strict=True)]
    names = (*sens.names, *(f"{candidate.name}.{a}" for a in candidate.strengths))
    return Sensitivities(
        names=names,
        blocks=blocks,
        prior_std=np.append(sens.prior_std, np.full(candidate.n_strengths, np.inf)),
        prior_offset=np.append(sens.prior_offset, np.zeros(candidate.n_strengths)),
        nuisance=sens.nuisance,
    )


def check_compatible(residual: Residual, sens: Sensitivities, candidates: Sequence[Candidate]) -> None:
    """Refuse arrays whose blocks do not match the residual's; the error lists all faults."""
    faults = []
    shapes = [b.shape for b in residual.blocks]
    if [b.shape[:2] for b in sens.blocks] != shapes:
        faults.append(f"sensitivities have blocks {[b.shape[:2] for b in sens.blocks]}, the residual {shapes}")
    for i, nuis in enumerate(sens.nuisance):
        if nuis is not None and i < len(shapes) and nuis.shape[:2] != shapes[i]:
            faults.append(f"nuisance of block {i} has shape {nuis.shape[:2]}, the residual {shapes[i]}")
    for c in candidates:
        for s, of_shape in zip(c.shapes, c.block_shapes, strict=True):
            if [b[:2] for b in of_shape] != shapes:
                faults.append(f"candidate {c.name} {dict(s)}: blocks do not match the residual's {shapes}")
    seen: dict[str, int] = {}
    for c in candidates:
        seen[c.name] = seen.get(c.name, 0) + 1
    faults += [f"candidate {n} is given {k} times" for n, k in seen.items() if k > 1]
    _raise_if(faults)
