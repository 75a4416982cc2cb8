"""Static equilibrium: a state whose rates all vanish, found by Newton's method with the exact Jacobian."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from multibody.base.errors import SimulationError
from multibody.system.compiled import CompiledSystem

if TYPE_CHECKING:
    import pandas

__all__ = ["Equilibrium", "equilibrium"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Equilibrium:
    """A static state.

    Parameters
    ----------
    names, units : tuple of str
        States and their units.
    state : ndarray, shape (n,)
    residual : ndarray, shape (n,)
        Rates that remain, unit of the state per second.
    iterations : int
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    state: np.ndarray
    residual: np.ndarray
    iterations: int

    def __getitem__(self, name: str) -> float:
        return float(self.state[self.names.index(name)])

    def to_dict(self) -> dict[str, float]:
        """Return the state by name, as `simulate` takes it for ``initial``."""
        return dict(zip(self.names, map(float, self.state), strict=True))

    def to_frame(self) -> pandas.DataFrame:
        """Return state, unit and remaining rate as a table."""
        import pandas

        return pandas.DataFrame(
            {"value": self.state, "unit": self.units, "remaining rate": self.residual},
            index=pandas.Index(self.names),
        )


def equilibrium(
    system: CompiledSystem,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | np.ndarray | None = None,
    guess: Mapping[str, float] | np.ndarray | None = None,
    hold: Iterable[str] = (),
    tolerance: float = 1e-9,
    iterations: int = 100,
) -> Equilibrium:
    """Find a state at rest.

    Speeds are zero at rest; the other states follow from rates that vanish.  Where the machine can rest
    anywhere (a mass without a spring), the state nearest to the guess is returned.

    Parameters
    ----------
    system : CompiledSystem
    inputs, parameters : mapping, optional
        Constant inputs and parameter values by name, SI.
    guess : mapping or ndarray, optional
        Where to start; default: the start values.
    hold : iterable of str
        States that keep their guess; their own rates need not vanish.
    tolerance : float
        Largest rate accepted, relative to the largest rate at the guess (at least 1).

    Raises
    ------
    SimulationError
        If no equilibrium is found, with what remains in each equation.
    """
    p, x = system.parameter_vector(parameters), system.state_vector(guess).copy()
    u = system.input_vector(inputs)
    held = {system.index("state", name) for name in hold} | {
        k for k, n in enumerate(system.state_names) if n.startswith("energy.")
    }
    speeds = set(system.rate_states.values()) - held
    x[list(speeds)] = 0.0
    kept = np.array([k for k in range(x.size) if k not in held and k not in system.rate_states], dtype=int)
    free = np.array([k for k in range(x.size) if k not in held and k not in speeds], dtype=int)
    f = system.rhs(0.0, x, u, p)
    scale = max(1.0, float(np.max(np.abs(f[kept]), initial=0.0)))
    done = 0
    for done in range(1, iterations + 1):  # noqa: B007
        if np.max(np.abs(f[kept]), initial=0.0) <= tolerance * scale:
            break
        jacobian = system.jacobian("x", 0.0, x, u, p)[np.ix_(kept, free)]
        # columns in comparable size, so that the least change is not ruled by units
        size = np.abs(jacobian).max(axis=0, initial=0.0)
        size[size <= 1e-14 * size.max(initial=0.0)] = 1.0  # rounding only: such a state may stay where it is
        change = -np.linalg.lstsq(jacobian / size, f[kept], rcond=1e-13)[0] / size
        norm, factor = np.linalg.norm(f[kept]), 1.0
        while factor > 1e-6:
            trial = x.copy()
            trial[free] += factor * change
            g = system.rhs(0.0, trial, u, p)
            if np.all(np.isfinite(g)) and np.linalg.norm(g[kept]) < (1 - 1e-4 * factor) * norm:
                x, f = trial, g
                break
            factor *= 0.5
        else:
            break
    if not np.max(np.abs(f[kept]), initial=0.0) <= tolerance * scale:
        worst = sorted(kept, key=lambda k: -abs(f[k]))[:8]
        lines = "\n".join(f"  - d/dt {system.state_names[k]} = {f[k]:.4g} {system.states[k].unit}/s" for k in worst)
        raise SimulationError(
            f"'{system.name}' has no equilibrium near the guess; after {done} steps these rates remain:\n{lines}\n"
            "Hold a state (hold=…), give a better guess, or check for a force that nothing balances."
        )
    units = tuple(q.unit for q in system.states)
    return Equilibrium(names=system.state_names, units=units, state=x, residual=f, iterations=done)
