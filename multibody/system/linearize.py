"""A machine linearised about a state: matrices, natural frequencies, damping and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from multibody.system.compiled import CompiledSystem

if TYPE_CHECKING:
    import pandas

__all__ = ["Linearization", "linearize"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Linearization:
    """ẋ = A x + B u, y = C x + D u about a state, exact to rounding.

    Parameters
    ----------
    system : CompiledSystem
    state, inputs : ndarray
        Where it was linearised.
    A, B, C, D : ndarray
        Shapes (n, n), (n, n_u), (n_y, n), (n_y, n_u).
    """

    system: CompiledSystem
    state: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A in 1/s."""
        return np.linalg.eigvals(self.A)

    def modes(self) -> pandas.DataFrame:
        """Return the oscillating modes: f = |λ|/2π in Hz, damping ratio, and the state with the largest participation.

        The frequency follows González et al. 2020, Eq. 19.
        """
        import pandas

        values, right = np.linalg.eig(self.A)
        left = np.linalg.pinv(right)
        rows = []
        for k in np.argsort(np.abs(values)):
            if values[k].imag > 1e-9 * max(1.0, abs(values[k])):
                share = np.abs(right[:, k] * left[k])
                rows.append(
                    (
                        abs(values[k]) / (2 * np.pi),
                        -values[k].real / abs(values[k]),
                        self.system.state_names[int(np.argmax(share))],
                    )
                )
        return pandas.DataFrame(rows, columns=["frequency [Hz]", "damping ratio [1]", "strongest state"])


def linearize(
    system: CompiledSystem,
    state: Mapping[str, float] | np.ndarray | None = None,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | np.ndarray | None = None,
    time: float = 0.0,
) -> Linearization:
    """Linearise a machine about a state (default: its start).

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0))
    >>> spring = model.add("spring", Spring(stiffness=(2 * np.pi) ** 2))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> round(float(model.build().linearize().modes()["frequency [Hz]"].iloc[0]), 9)
    1.0
    """
    x, p, u = system.state_vector(state), system.parameter_vector(parameters), system.input_vector(inputs)
    a, b = (system.jacobian(wrt, time, x, u, p) for wrt in ("x", "u"))
    c, d = (system.jacobian(wrt, time, x, u, p, of="outputs") for wrt in ("x", "u"))
    return Linearization(system=system, state=x, inputs=u, A=a, B=b, C=c, D=d)
