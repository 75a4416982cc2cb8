"""The model of a filter: a machine, its measured outputs, latent quantities, exact or central derivatives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.latent import Latent, latent_readouts
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["FilterModel"]

_CUBE_ROOT_OF_ROUNDING = 6e-6


class FilterModel:
    """States of a machine and latent quantities as one state, z = [x, latent], with the measured outputs.

    Parameters
    ----------
    system : System
        The machine.  Built with only the measured outputs it is evaluated faster.
    measured : sequence of str
        Outputs that are measured, in the order of the readings.
    latents : sequence of Latent
        Quantities that are estimated together with the states.
    parameters : mapping or ndarray, optional
        Values that differ from the machine's own.
    jacobian : {"exact", "central"}
        Derivatives by differentiated equations, or by central differences (González et al. 2020).
    steps : mapping of str to float, optional
        Steps of the central differences by state; default: 6e-6 of the state's size at the start, at least
        6e-6 of one unit.
    bounds : mapping of str to (float, float), optional
        Range of a state: after a reading its estimate is set back to the nearer bound.  Needed where a machine no
        longer reacts to a quantity, so that no reading would bring it back.  A latent parameter's bounds are those
        of its value.

    Raises
    ------
    FilterError
        With every unknown output, input, parameter or state.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0))
    >>> spring = model.add("spring", Spring(stiffness=100.0))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> from estimation.filters import RandomWalk
    >>> FilterModel(model.build(), ["body.position"], [RandomWalk("spring.stiffness", rate=1.0, std=10.0)])
    FilterModel('oscillator': 2 states + 1 latent, measured body.position, exact derivatives)
    """

    def __init__(
        self,
        system: System,
        measured: Sequence[str],
        latents: Sequence[Latent] = (),
        *,
        parameters: Mapping[str, float] | np.ndarray | None = None,
        jacobian: Literal["exact", "central"] = "exact",
        steps: Mapping[str, float] | None = None,
        bounds: Mapping[str, tuple[float, float]] | None = None,
    ):
        from multibody.base.spelling import nearest

        self.system = system
        self.measured = tuple(measured)
        self.latents = tuple(latents)
        self.p = system.parameter_vector(parameters)
        self.jacobian = jacobian
        self.readouts, faults = latent_readouts(system, self.latents)
        self.state_names: tuple[str, ...] = (
            *system.state_names,
            *(name for latent in self.latents for name in latent.state_names),
        )
        for name in self.measured:
            if name not in system.output_names:
                faults.append(f"'{system.name}' has no output '{name}'{nearest(name, system.output_names)}")
        if not self.measured:
            faults.append("nothing is measured: name at least one output")
        if len(set(self.state_names)) < len(self.state_names):
            twice = sorted({n for n in self.state_names if self.state_names.count(n) > 1})
            faults.append(f"several states are called {', '.join(twice)}: give the latent quantities names")
        for name in [*(steps or {}), *(bounds or {})]:
            if name not in self.state_names:
                faults.append(f"there is no state '{name}'{nearest(name, self.state_names)}")
        if jacobian not in ("exact", "central"):
            faults.append(f"jacobian is '{jacobian}': take exact or central")
        if faults:
            raise FilterError(f"filter of '{system.name}'", faults)
        start = np.concatenate([system.start, np.zeros(len(self.state_names) - len(system.states))])
        self.steps = _CUBE_ROOT_OF_ROUNDING * np.maximum(1.0, np.abs(start))
        for name, value in (steps or {}).items():
            self.steps[self.state_names.index(name)] = value
        self.bounds = np.tile([-np.inf, np.inf], (self.n, 1))
        for name, ends in (bounds or {}).items():
            self.bounds[self.state_names.index(name)] = np.array(ends, dtype=float) - self.nominal(name)

    @property
    def n(self) -> int:
        """Number of states with the latent ones."""
        return len(self.state_names)

    @property
    def ld(self) -> int:
        """Length of a stored matrix row: a multiple of eight."""
        return -(-self.n // 8) * 8

    @cached_property
    def drift(self) -> np.ndarray:
        """A of the latent states, block diagonal, shape (k, k)."""
        return _blocks([latent.drift for latent in self.latents])

    @cached_property
    def latent_density(self) -> np.ndarray:
        """Density of the latent states' noise, shape (k, k)."""
        return _blocks([latent.density for latent in self.latents])

    @cached_property
    def latent_prior(self) -> np.ndarray:
        """Covariance of the latent states at the start, shape (k, k)."""
        return _blocks([latent.prior for latent in self.latents])

    @cached_property
    def channels(self) -> list[tuple[int, int]]:
        """Kind (0 state, 1 rate of a state, 2 output) and index of each measured output.

        An output that is a state or the rate of one costs no evaluation of its own.
        """
        system = self.system
        states = {q.variable: k for k, q in enumerate(system.states)}
        rates = dict(re.findall(r"^ {4}dx\[(\d+)\] = (\w+)$", system.texts["rhs"], re.MULTILINE))
        by_rate = {variable: int(k) for k, variable in rates.items()}
        channels = []
        for name in self.measured:
            index = system.index("output", name)
            variable = system.outputs[index].variable
            if variable in states:
                channels.append((0, states[variable]))
            elif variable in by_rate:
                channels.append((1, by_rate[variable]))
            else:
                channels.append((2, index))
        return channels

    def index(self, name: str) -> int:
        """Return the position of a state.

        Raises
        ------
        KeyError
            With the nearest name that exists.
        """
        from multibody.base.spelling import nearest

        if name not in self.state_names:
            raise KeyError(f"the filter has no state '{name}'{nearest(name, self.state_names)}")
        return self.state_names.index(name)

    def unit(self, name: str) -> str:
        """Return the SI unit of a state, a latent quantity or an output."""
        for latent in self.latents:
            if name in latent.state_names:
                order = latent.state_names.index(name)
                unit = self.system.unit(next(iter(latent.weights)))
                return unit if order == 0 else f"{unit or '1'}/s" + (f"**{order}" if order > 1 else "")
        return self.system.unit(name)

    def nominal(self, name: str) -> float:
        """Return the value that a latent quantity adds to: the parameter's, or zero for an input."""
        for latent in self.latents:
            if name == latent.name and isinstance(latent.target, str) and latent.target in self.system.parameter_names:
                return float(self.p[self.system.index("parameter", latent.target)])
        return 0.0

    @cached_property
    def directions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction of every state as columns over states, inputs and parameters; each of `ld` columns."""
        system, n = self.system, len(self.system.states)
        x, u, p = (np.zeros((size, self.ld)) for size in (n, len(system.inputs), len(self.p)))
        x[:, :n] = np.eye(n)
        for state, kind, index, weight in self.readouts:
            (u if kind == 0 else p)[index, state] = weight
        return x, u, p

    def __repr__(self) -> str:
        latent = f" + {self.n - len(self.system.states)} latent" if self.latents else ""
        return (
            f"FilterModel({self.system.name!r}: {count_text(len(self.system.states), 'state')}{latent}, "
            f"measured {', '.join(self.measured)}, {self.jacobian} derivatives)"
        )


def _blocks(parts: list[np.ndarray]) -> np.ndarray:
    size = sum(len(part) for part in parts)
    out, at = np.zeros((size, size)), 0
    for part in parts:
        out[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return out
