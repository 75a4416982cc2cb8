"""Natural frequencies of a lift along its trip; vertical modes are identified by participation factors.

González et al. 2020, Eq. 19 and Fig. 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

    from multibody.system.trajectory import Trajectory
    from vtsdt.lift.lift import Lift

__all__ = ["Modes", "ModesAlong", "modes_along_run", "modes_along_trip"]

_VERTICAL = ("z", "v_z")
_BODIES = ("cabin", "counterweight")


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """The oscillating modes of a linearised lift, by rising frequency.

    Parameters
    ----------
    frequency : ndarray, shape (m,), Hz
        f = |λ|/2π (Eq. 19).
    damping : ndarray, shape (m,)
        Damping ratio.
    participation : ndarray, shape (m, n)
        Share of each state in each mode; rows sum to 1.
    shapes : ndarray, shape (m, n), complex
        Eigenvectors.
    states : tuple of str
    """

    frequency: np.ndarray
    damping: np.ndarray
    participation: np.ndarray
    shapes: np.ndarray
    states: tuple[str, ...]

    @property
    def vertical_share(self) -> np.ndarray:
        """Share of vertical motion, pulley and support in each mode, shape (m,)."""
        chosen = [k for k, n in enumerate(self.states) if _is_vertical(n)]
        return self.participation[:, chosen].sum(axis=1)

    @property
    def vertical(self) -> np.ndarray:
        """True for modes with more than half of their participation in vertical motion, shape (m,)."""
        return self.vertical_share > 0.5

    def to_frame(self) -> pandas.DataFrame:
        """Return a table of frequency, damping, share of vertical motion and strongest state."""
        import pandas

        return pandas.DataFrame(
            {
                "frequency [Hz]": self.frequency,
                "damping ratio [1]": self.damping,
                "vertical share [1]": self.vertical_share,
                "strongest state": [self.states[int(k)] for k in np.argmax(self.participation, axis=1)],
            }
        )


def _is_vertical(state: str) -> bool:
    owner, _, name = state.partition(".")
    return name in _VERTICAL if owner in _BODIES else owner in ("pulley", "support")


def modes_of(matrix: np.ndarray, states: tuple[str, ...], least: float = 0.5) -> Modes:
    """Return the oscillating modes of a process matrix.

    Parameters
    ----------
    matrix : ndarray, shape (n, n), 1/s
    states : tuple of str
    least : float, Hz
        Slower ones are left out: they belong to the control and not to the mechanics.
    """
    values, right = np.linalg.eig(matrix)
    left = np.linalg.inv(right)
    chosen = [k for k in np.argsort(np.abs(values)) if values[k].imag > 0 and abs(values[k]) > 2 * np.pi * least]
    share = np.abs(right * left.T)[:, chosen].T
    mechanical = [k for k, n in enumerate(states) if n.partition(".")[0] in (*_BODIES, "pulley", "support")]
    share = share / share.sum(axis=1, keepdims=True)
    is_mechanical = share[:, mechanical].sum(axis=1) > 0.5
    chosen = [k for k, keep in zip(chosen, is_mechanical, strict=True) if keep]
    poles = values[chosen]
    size = np.abs(poles)
    return Modes(
        frequency=size / (2 * np.pi),
        damping=-poles.real / size,
        participation=share[is_mechanical],
        shapes=right[:, chosen].T,
        states=states,
    )


@dataclass(frozen=True, eq=False)
class ModesAlong:
    """Modes at several heights of the cabin.

    Parameters
    ----------
    height : ndarray, shape (k,), m
    cable_length : ndarray, shape (k,), m
        Free length on the cabin's side.
    modes : tuple of Modes
    """

    name: str
    height: np.ndarray
    cable_length: np.ndarray
    modes: tuple[Modes, ...]

    def vertical(self) -> np.ndarray:
        """Return the vertical modes' frequencies, shape (k, number of them), Hz; NaN where one is missing."""
        rows = [m.frequency[m.vertical] for m in self.modes]
        out = np.full((len(rows), max(map(len, rows), default=0)), np.nan)
        for k, row in enumerate(rows):
            out[k, : len(row)] = row
        return out

    def plot(self, axes: Any = None, *, largest: float = 60.0) -> Any:
        """Draw all modes against the cable's length; returns the figure.

        In given axes, for a second model, the markers are hollow.
        """
        import matplotlib.pyplot as plt

        first = axes is None
        if axes is None:
            _, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
        for vertical, marker in ((True, "." if first else "s"), (False, "x" if first else "+")):
            points = [
                (length, f)
                for length, m in zip(self.cable_length, self.modes, strict=True)
                for f in m.frequency[m.vertical == vertical]
                if f <= largest
            ]
            if points:
                label = f"{self.name}: {'vertical' if vertical else 'lateral and rotational'}"
                axes.plot(
                    *zip(*points, strict=True),
                    marker,
                    markersize=5,
                    linestyle="none",
                    label=label,
                    markerfacecolor=None if first else "none",
                )
        axes.set_xlabel("cable length at the cabin's side [m]")
        axes.set_ylabel("natural frequency [Hz]")
        axes.legend(fontsize="small")
        axes.grid(alpha=0.3)
        return axes.figure


def modes_along_trip(lift: Lift, heights: np.ndarray | None = None) -> ModesAlong:
    """Return the modes about the state at rest at several heights (default: ten over the travel).

    At rest the regularised friction is a strong damper at the shoes; `modes_along_run` is for a moving cabin.
    """
    if heights is None:
        heights = np.linspace(0.0, lift.parameters.hoistway.travel, 10)
    heights = np.asarray(heights, dtype=float)
    modes, guess = [], None
    system = lift.system
    for h in heights:
        rest = lift.equilibrium(float(h), guess=guess or {})
        modes.append(modes_of(system.jacobian("x", 0.0, rest.state), system.state_names))
        lateral = [n for n in system.state_names if n.rpartition(".")[2] in ("x", "y", "roll", "pitch", "yaw")]
        guess = {n: rest[n] for n in lateral}
    return ModesAlong(lift.name, heights, lift.parameters.ropes.L_0_c - heights, tuple(modes))


def modes_along_run(lift: Lift, run: Trajectory, times: np.ndarray) -> ModesAlong:
    """Return the modes of the process matrix at instants of a simulated trip, as the paper does."""
    rows = np.searchsorted(run.times, times)
    system = run.system
    matrices = system.jacobian_along("x", run.times[rows], run.states[rows], run.inputs[rows], run.p)
    height = run["cabin.z"][rows]
    length = run["ropes.L_c"][rows] if lift.structure.drive else lift.parameters.ropes.L_0_c - height
    return ModesAlong(lift.name, height, length, tuple(modes_of(a, system.state_names) for a in matrices))
