"""What small additions to inputs change in the outputs: one set of transitions for any number of them.

Around its trajectory a machine is linear, x_{k+1} = Φ_k x_k + Γ0_k φ_k + Γ1_k φ_{k+1} from sample to sample.  The
matrices are integrated once; hundreds of forces along the motion then cost a few products each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.response.perturbations import Change, Push

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["PushResponse", "at_hand", "forget", "response_of", "worth_it"]

APART = 8  # samples from one stretch of the motion to the next that are not worth being integrated again
EXACT = 1e-8  # relative tolerance of the states that Jacobians are taken at
KEPT_BYTES = 1 << 25  # transitions larger than this are kept only while one question is answered


def worth_it(system: System, pushes: Sequence[Push | Change]) -> bool:
    """Tell whether transitions are cheaper than a direction for each push: about twice as many steps, fewer columns."""
    columns = len(system.states) + sum(1 if isinstance(c, Change) else 2 for c in _channels(pushes))
    return len(system.states) > 0 and len(pushes) > 2 * columns


@dataclass(frozen=True, eq=False)
class PushResponse:
    """A machine along one record, linear in additions to some of its inputs.

    Attributes
    ----------
    channels : tuple of (str or Change)
        Inputs that may be added to, and then parameters that may be changed.
    outputs : ndarray, shape (nt, n_channels)
        Nominal outputs, raw: on the record's grid, before sensors and preparation.
    phi, gamma0, gamma1 : ndarray
        See `multibody.solvers.transitions.Transitions`.
    c, d : ndarray, shape (nt, n_channels, n) and (nt, n_channels, n_pushed)
        Derivatives of the outputs by states and by the inputs.
    """

    channels: tuple[str | Change, ...]
    outputs: np.ndarray
    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @classmethod
    def along(
        cls, experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray, channels: Sequence[str | Change]
    ) -> PushResponse:
        """Integrate the transitions along the trajectory from x0; channels as the attribute.

        Raises
        ------
        SimulationError
            If the integration fails.
        """
        from multibody.base.errors import SimulationError
        from multibody.compile.several_directions import worth_lanes
        from multibody.solvers.problem import ProblemError
        from multibody.solvers.transitions import transitions
        from multibody.system.along_trajectory import longest_steps

        time = np.array(experiment.record.time)
        motion = _Motion(experiment, system, p, x0)
        wide = worth_lanes(time.size, len(system.states))  # of the whole record, though it is asked for slice by slice

        def jacobians(at: np.ndarray) -> Callable[[slice], tuple[np.ndarray, np.ndarray]]:
            x, u = motion.at(at)

            def some(part: slice) -> tuple[np.ndarray, np.ndarray]:
                t, x_t, u_t = at[part], x[part], u[part]
                by_states = system.jacobian_along("x", t, x_t, u_t, p, in_lanes=wide)
                return by_states, _by_channels(system, p, channels, t, x_t, u_t, "rhs", wide)

            return some

        x, u = motion.at(time)
        longest = longest_steps(motion.problem, time, x, u)
        try:
            limit, jumps = np.minimum(longest[1:], longest[:-1]), motion.table.jumps(p)
            lasting = sum(isinstance(c, Change) for c in channels)
            found = transitions(time, jacobians, limit, jumps, lasting)
        except ProblemError as error:
            raise SimulationError(f"'{system.name}' on record '{experiment.name}': {error}") from error
        pick = np.array([system.index("output", n) for n in experiment.outputs])
        return cls(
            tuple(channels),
            system.outputs_along(time, x, u, p)[:, pick],
            found.phi,
            found.gamma0,
            found.gamma1,
            np.ascontiguousarray(system.jacobian_along("x", time, x, u, p, of="outputs")[:, pick]),
            np.ascontiguousarray(_by_channels(system, p, channels, time, x, u, "outputs", wide)[:, pick]),
        )

    @property
    def nbytes(self) -> int:
        """Memory taken."""
        return sum(a.nbytes for a in (self.phi, self.gamma0, self.gamma1, self.c, self.d))

    def __call__(self, pushes: Sequence[Push | Change]) -> np.ndarray:
        """Return what each push changes in the outputs, raw, shape (nt, n_channels, m)."""
        from multibody.compile.native import load_driver

        channel = np.array([self.channels.index(_channel(q)) for q in pushes], dtype=np.int64)
        ones = np.ones(len(self.outputs))
        values = np.ascontiguousarray(np.stack([q.values if isinstance(q, Push) else ones for q in pushes], axis=1))
        out = np.empty((*self.outputs.shape, len(pushes)))
        load_driver("multibody.solvers.kernels.carry").carry(
            self.phi, self.gamma0, self.gamma1, self.c, self.d, channel, values, out
        )
        return out


def _channel(push: Push | Change) -> str | Change:
    return push.channel if isinstance(push, Push) else push


def _channels(pushes: Sequence[Push | Change], also: Sequence[str | Change] = ()) -> tuple[str | Change, ...]:
    """Return what is pushed or changed, each once: inputs first, then parameters, those beside the same together."""
    every = dict.fromkeys([*map(_channel, pushes), *also])
    changes = [c for c in every if isinstance(c, Change)]
    return *(c for c in every if not isinstance(c, Change)), *sorted(changes, key=lambda c: c.beside)


def _by_channels(
    system: System,
    p: np.ndarray,
    channels: Sequence[str | Change],
    t: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    of: str,
    wide: bool,
) -> np.ndarray:
    """Return the derivatives by inputs and parameters at every row of a motion, shape (nt, rows, n_channels)."""
    inputs = [system.index("input", c) for c in channels if not isinstance(c, Change)]
    found = [system.jacobian_along("u", t, x, u, p, of=of, columns=np.array(inputs, dtype=int), in_lanes=wide)]
    for beside, some in groupby((c for c in channels if isinstance(c, Change)), key=lambda c: c.beside):
        own = p.copy()
        for name, value in beside:
            own[system.index("parameter", name)] = value
        columns = np.array([system.index("parameter", c.parameter) for c in some])
        found.append(system.jacobian_along("p", t, x, u, own, of=of, columns=columns, in_lanes=wide))
    return np.ascontiguousarray(np.concatenate(found, axis=2))


class _Motion:
    """States and inputs along a record at any times: at its samples, at first looks between them, and elsewhere.

    Exact, however exact the experiment's outputs need be: where friction sticks, the Jacobian follows from a speed of a
    millionth of what it is elsewhere.
    """

    def __init__(self, experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray) -> None:
        from multibody.compile.several_directions import worth_lanes
        from multibody.solvers.transitions import look_at_times
        from multibody.system.simulate import native_problem

        self.experiment, self.p, self.name = experiment, p, f"'{system.name}' on record '{experiment.name}'"
        self.samples = np.array(experiment.record.time)
        self.table = experiment.table(system)
        wide = worth_lanes(self.samples.size, len(system.states))
        self.problem = native_problem(system, p, self.table, tangent=True, in_lanes=wide)
        self._known = np.sort(np.concatenate((self.samples, look_at_times(self.samples))))
        self._states = self._integrated(x0, float(self.samples[0]), self._known)

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (nt, n) and inputs (nt, n_u) at times in any order."""
        where = np.searchsorted(self._known, times).clip(0, self._known.size - 1)
        if np.array_equal(self._known[where], times):
            x = self._states[where]
        else:
            order = np.argsort(times, kind="stable")
            x = np.empty((times.size, self._states.shape[1]))
            x[order] = self._between(times[order])
        return x, np.ascontiguousarray(self.table(times, self.p).reshape(times.size, -1))

    def _between(self, times: np.ndarray) -> np.ndarray:
        """Return the states at increasing times: each stretch is integrated from the sample before it."""
        from multibody.base.parallel import side_by_side

        before = np.searchsorted(self.samples, times, side="right") - 1
        edges = np.flatnonzero(np.diff(before) > APART) + 1
        stretches = [part for part in np.split(np.arange(times.size), edges) if part.size]

        def states(part: np.ndarray) -> np.ndarray:
            begin = float(self.samples[before[part[0]]])
            return self._integrated(self._states[np.searchsorted(self._known, begin)], begin, times[part])

        return np.concatenate(side_by_side(states, stretches))

    def _integrated(self, x0: np.ndarray, begin: float, times: np.ndarray) -> np.ndarray:
        from multibody.base.errors import SimulationError
        from multibody.solvers import Samples, integrate

        rtol, limit = min(self.experiment.rtol, EXACT), self.experiment.max_evaluations
        samples = Samples(times)
        solution = integrate(
            self.problem,
            (begin, float(times[-1])),
            x0,
            samples=samples,
            rtol=rtol,
            atol=rtol * 1e-3,
            max_step=np.inf,
            max_evaluations=limit,
        )
        if solution.status < 0 or samples.count < times.size or not np.all(np.isfinite(samples.states)):
            raise SimulationError(f"{self.name}: {solution.message}")
        return np.ascontiguousarray(samples.states)


def response_of(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    x0: np.ndarray,
    pushes: Sequence[Push | Change],
    also: Sequence[str | Change] = (),
) -> PushResponse:
    """Return the transitions for some pushes; the last ones are kept with the experiment until `forget`.

    ``also`` names further inputs that will be pushed.
    """
    channels = _channels(pushes, also)
    kept = _kept(experiment, system, p, x0)
    if kept is not None:
        if set(channels) <= set(kept.channels):
            return kept
        channels = _channels(pushes, [*kept.channels, *also])
    found = PushResponse.along(experiment, system, p, x0, channels)
    experiment._cache["pushes"] = (system, p.copy(), x0.copy(), found)
    return found


def at_hand(
    experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray, pushes: Sequence[Push | Change]
) -> bool:
    """Tell whether transitions that serve these pushes are kept."""
    kept = _kept(experiment, system, p, x0)
    return kept is not None and bool(pushes) and set(_channels(pushes)) <= set(kept.channels)


def _kept(experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray) -> PushResponse | None:
    kept: Any = experiment._cache.get("pushes")
    if kept is None:
        return None
    of, at, start, found = kept
    same = of is system and np.array_equal(at, p) and np.array_equal(start, x0)
    return found if same else None


def forget(experiment: Experiment) -> None:
    """Free the memory of transitions that are too large to be kept."""
    kept: Any = experiment._cache.get("pushes")
    if kept is not None and kept[3].nbytes > KEPT_BYTES:  # type: ignore[index]
        del experiment._cache["pushes"]
