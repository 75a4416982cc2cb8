"""Small perturbations of inputs and parameters, and what they change in the outputs.

Around its trajectory a machine is linear, x_{k+1} = Φ_k x_k + Γ0_k φ_k + Γ1_k φ_{k+1} from sample to sample.  These
state-transition matrices are integrated once; the response to hundreds of forces along the motion then costs a few
matrix products each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from estimation.response.record_simulation import RecordSimulation
from multibody.base.memory import memory_limit
from multibody.solvers.kernels.perturbations import propagate

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = [
    "Channel",
    "InputPerturbation",
    "ParameterPerturbation",
    "Perturbation",
    "PerturbationResponse",
    "StateRate",
    "cheaper_by_transition_matrices",
    "perturbed_channels",
]

STRETCH_GAP = 8  # samples without a requested time that begin a new stretch of integration
#: Share of the memory limit that the matrices of one record may take: two records may be worked on at a time.
MATRICES = 0.25
STATE_RTOL = 1e-8  # relative tolerance of the states at which Jacobians are evaluated


@dataclass(frozen=True, eq=False)
class InputPerturbation:
    """A small signal added to a model input over time.

    Parameters
    ----------
    channel : str
        Model input, for instance ``"probe.guide"``.
    values : ndarray, shape (nt,)
        On the record's time grid.
    """

    channel: str
    values: np.ndarray


@dataclass(frozen=True)
class StateRate:
    """The rate of a state, as a channel that may be perturbed: what is added to it enters the state's equation.

    Parameters
    ----------
    state : str
    """

    state: str


@dataclass(frozen=True)
class ParameterPerturbation:
    """A small lasting change of a parameter; the response is per unit of the change.

    Parameters
    ----------
    parameter : str
        Not the delay of an input.
    evaluated_at : tuple of (str, float)
        Values of other parameters at which the derivative is taken.  Without the perturbation these must not change
        the motion: they shape an effect whose strength is zero.
    """

    parameter: str
    evaluated_at: tuple[tuple[str, float], ...] = ()


Perturbation = InputPerturbation | ParameterPerturbation
#: What may be perturbed: an input by its name, the rate of a state, a parameter.
Channel = str | StateRate | ParameterPerturbation


def _channel(perturbation: Perturbation) -> str | ParameterPerturbation:
    return perturbation.channel if isinstance(perturbation, InputPerturbation) else perturbation


def perturbed_channels(perturbations: Sequence[Perturbation], also: Sequence[Channel] = ()) -> tuple[Channel, ...]:
    """Return what is perturbed, each once: inputs, rates, then parameters, sorted by where they are evaluated."""
    every = dict.fromkeys([*map(_channel, perturbations), *also])
    inputs = [c for c in every if isinstance(c, str)]
    rates = [c for c in every if isinstance(c, StateRate)]
    parameters = [c for c in every if isinstance(c, ParameterPerturbation)]
    return *inputs, *rates, *sorted(parameters, key=lambda c: c.evaluated_at)


def cheaper_by_transition_matrices(system: System, perturbations: Sequence[Perturbation], samples: int) -> bool:
    """Return whether state-transition matrices cost less than one integrated direction for each perturbation.

    They take about twice as many steps, with a column for each state and perturbed channel (two for an input).  Where
    those of so many samples do not fit into memory, they are no choice: hundreds of states with all their connections
    take tens of gigabytes.
    """
    channels = perturbed_channels(perturbations)
    states = len(system.states)
    columns = states + sum(1 if isinstance(c, ParameterPerturbation) else 2 for c in channels)
    taken = 8.0 * samples * states * (states + 2 * len(channels))
    fits = taken <= MATRICES * memory_limit()
    return states > 0 and not system.stepped and len(perturbations) > 2 * columns and fits


@dataclass(frozen=True, eq=False, kw_only=True)
class PerturbationResponse:
    """The linearised response of a machine along one record to perturbations of some inputs and parameters.

    Attributes
    ----------
    channels : tuple of (str or StateRate or ParameterPerturbation)
        Inputs that may be perturbed, then rates of states, then parameters.
    outputs : ndarray, shape (nt, c)
        Nominal outputs on the record's grid, before sensors and preparation.
    phi, gamma0, gamma1 : ndarray
        State-transition matrices; see `multibody.solvers.state_transition.StateTransitionMatrices`.
    c, d : ndarray, shape (nt, c, n) and (nt, c, n_channels)
        Derivatives of the outputs by states and by the channels.
    """

    channels: tuple[Channel, ...]
    outputs: np.ndarray
    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @classmethod
    def along(cls, simulation: RecordSimulation, channels: Sequence[Channel]) -> PerturbationResponse:
        """Integrate the state-transition matrices along the trajectory of a record.

        Raises
        ------
        SimulationError
            If the integration fails.
        """
        from multibody.solvers.problem import ProblemError
        from multibody.solvers.state_transition import state_transition_matrices
        from multibody.system.along_trajectory import longest_steps

        system, p, time, pick = simulation.system, simulation.p, simulation.time, simulation.outputs
        trajectory = _Trajectory(simulation)

        def jacobians(at: np.ndarray) -> Callable[[slice], tuple[np.ndarray, np.ndarray]]:
            x, u = trajectory.at(at)

            def some(part: slice) -> tuple[np.ndarray, np.ndarray]:
                t, x_t, u_t = at[part], x[part], u[part]
                by_states = system.jacobian_along("x", t, x_t, u_t, p)
                return by_states, _by_channels(system, p, channels, t, x_t, u_t, "rhs")

            return some

        x, u = trajectory.at(time)
        longest = longest_steps(trajectory.problem, time, x, u)
        try:
            limit, jumps = np.minimum(longest[1:], longest[:-1]), simulation.table.jumps(p)
            lasting = sum(isinstance(c, ParameterPerturbation) for c in channels)
            matrices = state_transition_matrices(time, jacobians, limit, jumps, lasting)
        except ProblemError as error:
            raise simulation.error(error) from error
        return cls(
            channels=tuple(channels),
            outputs=system.outputs_along(time, x, u, p)[:, pick],
            phi=matrices.phi,
            gamma0=matrices.gamma0,
            gamma1=matrices.gamma1,
            c=np.ascontiguousarray(system.jacobian_along("x", time, x, u, p, of="outputs")[:, pick]),
            d=np.ascontiguousarray(_by_channels(system, p, channels, time, x, u, "outputs")[:, pick]),
        )

    @property
    def nbytes(self) -> int:
        """Memory taken."""
        return sum(a.nbytes for a in (self.phi, self.gamma0, self.gamma1, self.c, self.d))

    def serves(self, perturbations: Sequence[Perturbation]) -> bool:
        """Return whether every perturbation acts on one of the channels; False for none at all."""
        return bool(perturbations) and set(perturbed_channels(perturbations)) <= set(self.channels)

    def __call__(self, perturbations: Sequence[Perturbation]) -> np.ndarray:
        """Return what each perturbation changes in the outputs, before sensors and preparation, shape (nt, c, m)."""
        channel = np.array([self.channels.index(_channel(q)) for q in perturbations], dtype=np.int64)
        ones = np.ones(len(self.outputs))
        room = np.empty((2, self.phi.shape[2], len(perturbations)))
        values = [q.values if isinstance(q, InputPerturbation) else ones for q in perturbations]
        out = np.empty((*self.outputs.shape, len(perturbations)))
        propagate(
            self.phi,
            self.gamma0,
            self.gamma1,
            self.c,
            self.d,
            channel,
            np.ascontiguousarray(np.stack(values, axis=1)),
            room,
            out,
        )
        return out


def _by_channels(
    system: System,
    p: np.ndarray,
    channels: Sequence[Channel],
    t: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    of: str,
) -> np.ndarray:
    """Return the derivatives by the channels at every sample of a trajectory, shape (nt, rows, n_channels)."""
    inputs = [system.index("input", c) for c in channels if isinstance(c, str)]
    blocks = [system.jacobian_along("u", t, x, u, p, of=of, columns=np.array(inputs, dtype=int))]
    if rates := [system.index("state", c.state) for c in channels if isinstance(c, StateRate)]:
        rows = np.eye(len(system.states)) if of == "rhs" else np.zeros((len(system.outputs), len(system.states)))
        blocks.append(np.broadcast_to(rows[:, rates], (t.size, len(rows), len(rates))))
    parameters = (c for c in channels if isinstance(c, ParameterPerturbation))
    for evaluated_at, group in groupby(parameters, key=lambda c: c.evaluated_at):
        shaped = p.copy()
        for name, value in evaluated_at:
            shaped[system.index("parameter", name)] = value
        columns = np.array([system.index("parameter", c.parameter) for c in group])
        blocks.append(system.jacobian_along("p", t, x, u, shaped, of=of, columns=columns))
    return np.ascontiguousarray(np.concatenate(blocks, axis=2))


class _Trajectory:
    """States and inputs along a record at any times: at its samples, at predefined times between them, and elsewhere.

    Integrated to `STATE_RTOL` whatever the experiment's tolerance: where friction sticks, the Jacobian depends on a
    speed that is a millionth of the speed elsewhere.
    """

    def __init__(self, simulation: RecordSimulation) -> None:
        from multibody.solvers.state_transition import jacobian_times
        from multibody.system.simulate import native_problem

        self.simulation = simulation
        system, samples = simulation.system, simulation.time
        self.problem = native_problem(system, simulation.p, simulation.table, tangent=True)
        self._known = np.sort(np.concatenate((samples, jacobian_times(samples))))
        self._states = self._integrated(simulation.x0, float(samples[0]), self._known)

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (nt, n) and inputs (nt, n_u) at times in any order."""
        where = np.searchsorted(self._known, times).clip(0, self._known.size - 1)
        if np.array_equal(self._known[where], times):
            x = self._states[where]
        else:
            order = np.argsort(times, kind="stable")
            x = np.empty((times.size, self._states.shape[1]))
            x[order] = self._between(times[order])
        inputs = self.simulation.table(times, self.simulation.p)
        return x, np.ascontiguousarray(inputs.reshape(times.size, -1))

    def _between(self, times: np.ndarray) -> np.ndarray:
        """Return the states at increasing times: each stretch is integrated from the sample before it."""
        from multibody.base.parallel import parallel_map

        samples = self.simulation.time
        before = np.searchsorted(samples, times, side="right") - 1
        edges = np.flatnonzero(np.diff(before) > STRETCH_GAP) + 1
        stretches = [part for part in np.split(np.arange(times.size), edges) if part.size]

        def states(part: np.ndarray) -> np.ndarray:
            begin = float(samples[before[part[0]]])
            return self._integrated(self._states[np.searchsorted(self._known, begin)], begin, times[part])

        return np.concatenate(parallel_map(states, stretches))

    def _integrated(self, x0: np.ndarray, begin: float, times: np.ndarray) -> np.ndarray:
        from multibody.solvers import Samples, integrate

        rtol = min(self.simulation.rtol, STATE_RTOL)
        samples = Samples(times)
        solution = integrate(
            self.problem,
            (begin, float(times[-1])),
            x0,
            samples=samples,
            rtol=rtol,
            atol=rtol * 1e-3,
            max_step=np.inf,
            max_evaluations=self.simulation.max_evaluations,
        )
        if solution.status < 0 or samples.count < times.size or not np.all(np.isfinite(samples.states)):
            raise self.simulation.error(solution.message)
        return np.ascontiguousarray(samples.states)
