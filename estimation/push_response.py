"""What small additions to inputs change in the outputs: one set of transitions for any number of them.

Around its trajectory a machine is linear, x_{k+1} = Φ_k x_k + Γ0_k φ_k + Γ1_k φ_{k+1} from sample to sample.  The
matrices are integrated once; hundreds of forces along the motion then cost a few products each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from estimation.experiment import Experiment, Push
    from multibody.solvers.problem import NativeProblem
    from multibody.system import System

__all__ = ["PushResponse", "at_hand", "forget", "response_of", "worth_it"]

EXACT = 1e-8  # relative tolerance of the states that Jacobians are taken at
KEPT_BYTES = 1 << 25  # transitions larger than this are kept only while one question is answered


def worth_it(system: System, pushes: Sequence[Push]) -> bool:
    """Tell whether transitions are cheaper than a direction for each push: about twice as many steps, fewer columns."""
    columns = len(system.states) + 2 * len({p.channel for p in pushes})
    return len(system.states) > 0 and len(pushes) > 2 * columns


@dataclass(frozen=True, eq=False)
class PushResponse:
    """A machine along one record, linear in additions to some of its inputs.

    Attributes
    ----------
    channels : tuple of str
        Inputs that may be added to.
    outputs : ndarray, shape (nt, n_channels)
        Nominal outputs, raw: on the record's grid, before sensors and preparation.
    phi, gamma0, gamma1 : ndarray
        See `multibody.solvers.transitions.Transitions`.
    c, d : ndarray, shape (nt, n_channels, n) and (nt, n_channels, n_pushed)
        Derivatives of the outputs by states and by the inputs.
    """

    channels: tuple[str, ...]
    outputs: np.ndarray
    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @classmethod
    def along(
        cls, experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray, channels: Sequence[str]
    ) -> PushResponse:
        """Integrate the transitions along the trajectory from x0.

        Raises
        ------
        SimulationError
            If the integration fails.
        """
        from multibody.along import longest_steps
        from multibody.directions import worth_lanes
        from multibody.errors import SimulationError
        from multibody.simulate import native_problem
        from multibody.solvers.problem import ProblemError
        from multibody.solvers.transitions import look_at_times, transitions

        time = np.array(experiment.record.time)
        table = experiment.table(system)
        problem = native_problem(system, p, table, tangent=True, in_lanes=worth_lanes(time.size, len(system.states)))
        chosen = np.array([system.index("input", n) for n in channels])

        known = np.sort(np.concatenate((time, look_at_times(time))))
        there = _states_at(known, experiment, system, problem, x0)

        def motion(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return states and inputs at times in any order; at those known they are not integrated again."""
            where = np.searchsorted(known, at).clip(0, known.size - 1)
            if np.array_equal(known[where], at):
                x = there[where]
            else:
                order = np.argsort(at, kind="stable")
                x = np.empty((at.size, there.shape[1]))
                x[order] = _states_at(at[order], experiment, system, problem, x0)
            return x, np.ascontiguousarray(table(at, p).reshape(at.size, -1))

        def jacobians(at: np.ndarray) -> Callable[[slice], tuple[np.ndarray, np.ndarray]]:
            x, u = motion(at)

            def some(part: slice) -> tuple[np.ndarray, np.ndarray]:
                where = at[part], x[part], u[part], p
                return system.jacobian_along("x", *where), system.jacobian_along("u", *where, columns=chosen)

            return some

        x, inputs = motion(time)
        longest = longest_steps(problem, time, x, inputs)
        try:
            found = transitions(time, jacobians, np.minimum(longest[1:], longest[:-1]), table.jumps(p))
        except ProblemError as error:
            raise SimulationError(f"'{system.name}' on record '{experiment.name}': {error}") from error
        pick = np.array([system.index("output", n) for n in experiment.outputs])
        along = {"times": time, "states": x, "inputs": inputs, "p": p, "of": "outputs"}
        return cls(
            tuple(channels),
            system.outputs_along(time, x, inputs, p)[:, pick],
            found.phi,
            found.gamma0,
            found.gamma1,
            np.ascontiguousarray(system.jacobian_along("x", **along)[:, pick]),  # type: ignore[arg-type]
            np.ascontiguousarray(system.jacobian_along("u", columns=chosen, **along)[:, pick]),  # type: ignore[arg-type]
        )

    @property
    def nbytes(self) -> int:
        """Memory taken."""
        return sum(a.nbytes for a in (self.phi, self.gamma0, self.gamma1, self.c, self.d))

    def __call__(self, pushes: Sequence[Push]) -> np.ndarray:
        """Return what each push changes in the outputs, raw, shape (nt, n_channels, m)."""
        from multibody.native import load_driver

        channel = np.array([self.channels.index(q.channel) for q in pushes], dtype=np.int64)
        values = np.ascontiguousarray(np.stack([q.values for q in pushes], axis=1))
        out = np.empty((*self.outputs.shape, len(pushes)))
        load_driver("multibody.solvers.kernels.carry").carry(
            self.phi, self.gamma0, self.gamma1, self.c, self.d, channel, values, out
        )
        return out


def _states_at(
    times: np.ndarray, experiment: Experiment, system: System, problem: NativeProblem, x0: np.ndarray
) -> np.ndarray:
    """Return the states at some times of a record, shape (nt, n).

    Exactly, however exact the experiment's outputs need be: where friction sticks, the Jacobian follows from a speed of
    a millionth of what it is elsewhere.
    """
    from multibody.errors import SimulationError
    from multibody.solvers import Samples, integrate

    whole, rtol = experiment.record.time, min(experiment.rtol, EXACT)
    samples = Samples(times)
    solution = integrate(
        problem,
        (float(whole[0]), float(whole[-1])),
        x0,
        samples=samples,
        rtol=rtol,
        atol=rtol * 1e-3,
        max_step=np.inf,
        max_evaluations=experiment.max_evaluations,
    )
    if solution.status < 0 or samples.count < times.size or not np.all(np.isfinite(samples.states)):
        raise SimulationError(f"'{system.name}' on record '{experiment.name}': {solution.message}")
    return np.ascontiguousarray(samples.states)


def response_of(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    x0: np.ndarray,
    pushes: Sequence[Push],
    also: Sequence[str] = (),
) -> PushResponse:
    """Return the transitions for some pushes; the last ones are kept with the experiment until `forget`.

    ``also`` names further inputs that will be pushed.
    """
    channels = tuple(dict.fromkeys([*(q.channel for q in pushes), *also]))
    kept = _kept(experiment, system, p, x0)
    if kept is not None:
        if set(channels) <= set(kept.channels):
            return kept
        channels = tuple(dict.fromkeys((*kept.channels, *channels)))
    found = PushResponse.along(experiment, system, p, x0, channels)
    experiment._cache["pushes"] = (system, p.copy(), x0.copy(), found)
    return found


def at_hand(experiment: Experiment, system: System, p: np.ndarray, x0: np.ndarray, pushes: Sequence[Push]) -> bool:
    """Tell whether transitions that serve these pushes are kept."""
    kept = _kept(experiment, system, p, x0)
    return kept is not None and bool(pushes) and {q.channel for q in pushes} <= set(kept.channels)


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
