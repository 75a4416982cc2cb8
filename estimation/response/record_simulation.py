"""The simulation of one record: a system driven by the recorded inputs, with derivatives along any directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimation.response.run_differences import derivatives_of_runs
from multibody.base.errors import SimulationError, Stop, StopMessage
from multibody.system.along_trajectory import observe_along
from multibody.system.not_finite import not_finite, not_finite_beyond
from multibody.system.stepped import SteppedRun, run_stepped

if TYPE_CHECKING:
    from multibody.inputs.table import InputTable
    from multibody.machine.model import System
    from multibody.solvers.problem import Directions

__all__ = ["RecordSimulation"]

LARGEST = 1e150
"""Outputs beyond this cannot be compared: their squares are beyond the largest number."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordSimulation:
    """A system with its parameters and start state, the inputs of one record, and how accurately to integrate.

    Parameters
    ----------
    record : str
        Name of the record, for messages.
    system : System
    p : ndarray, shape (n_p,)
    x0 : ndarray, shape (n,)
    time : ndarray, shape (nt,), s
        The record's own time grid.
    table : InputTable
        The recorded inputs.
    inputs, input_rates : ndarray, shape (nt, n_u)
        Inputs and their rates of change at ``time``.
    outputs : ndarray of int, shape (c,)
        Which outputs of the system are measured.
    rtol : float
        Relative tolerance of the integration; the absolute one is a thousandth of it.
    max_evaluations : int, optional
        A simulation that needs more evaluations of the equations stops with an error.
    """

    record: str
    system: System
    p: np.ndarray
    x0: np.ndarray
    time: np.ndarray
    table: InputTable
    inputs: np.ndarray
    input_rates: np.ndarray
    outputs: np.ndarray
    rtol: float
    max_evaluations: int | None = None

    def error(self, reason: object, evaluations: int = 0) -> SimulationError:
        """Return the error that names the system and the record."""
        stop = reason.stop if isinstance(reason, StopMessage) else Stop.OTHER
        return SimulationError(f"'{self.system.name}' on record '{self.record}': {reason}", stop, evaluations)

    def _not_finite(self, row: int, x: np.ndarray) -> SimulationError:
        """Return the error that says where an output that is not finite is born, or which one is beyond all bounds."""
        t, u = float(self.time[row]), np.asarray(self.inputs[row])
        text = not_finite(self.system, t, x, u, self.p, "outputs") or not_finite_beyond(self.system, t, x, u, self.p)
        if not text:
            y = self.system.outputs_at(t, x, u, self.p)
            worst = max(self.outputs.tolist(), key=lambda k: abs(y[k]))
            q = self.system.outputs[worst]
            text = (
                f"output '{q.name}' reaches {y[worst]:.3g} {q.unit} at t = {t:.6g} s: the model runs away; check the "
                "sign of its feedback, stiffness and damping, and its start values"
            )
        return self.error(StopMessage(text, Stop.NOT_FINITE))

    def _by_whole_runs(self, directions: Directions | None) -> tuple[np.ndarray, np.ndarray, int]:
        """Run a system with a part that steps itself, and again for differences along each direction."""
        first: SteppedRun | None = None  # finds how long steps may be; the others are compared with it

        def outputs(p: np.ndarray, x0: np.ndarray, extra: dict[int, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
            nonlocal first
            given = {"rtol": self.rtol, "extra": extra, "divisions": first and first.divisions}
            try:
                run = run_stepped(self.system, p, x0, self.table, self.time, **given)
            except SimulationError as error:
                raise SimulationError(f"record '{self.record}': {error}", error.stop) from error
            first = first or run
            return self.system.outputs_along(self.time, run.states, run.inputs, p)[:, self.outputs]

        y = outputs(self.p, self.x0, {})
        assert first is not None
        evaluations = first.evaluations
        if directions is None:
            return y, np.empty((*y.shape, 0)), evaluations
        parameters = self.system.parameters
        bounds = np.array([[q.min, q.max] for q in parameters], dtype=float).reshape(-1, 2)
        dy = derivatives_of_runs(outputs, y, self.p, self.x0, self.time, bounds, directions)
        return y, dy, evaluations

    def integrate(self, directions: Directions | None) -> tuple[np.ndarray, np.ndarray, int]:
        """Integrate the system, and its derivatives along directions.

        Returns
        -------
        y : ndarray, shape (nt, c)
            Outputs on the record's grid.
        dy : ndarray, shape (nt, c, m)
            Their derivatives along the m directions.
        evaluations : int
            Evaluations of the equations.

        Raises
        ------
        SimulationError
            If the integration fails.
        """
        if self.system.stepped:
            return self._by_whole_runs(directions)
        from multibody.solvers import Samples, integrate
        from multibody.system.simulate import native_problem

        system, p, time, inputs = self.system, self.p, self.time, self.inputs
        problem = native_problem(system, p, self.table, directions)
        n, m = len(system.states), problem.n_directions
        y = np.empty((time.size, self.outputs.size))
        bad: list[tuple[int, np.ndarray]] = []  # the first sample whose outputs cannot be compared, and its state
        dy = np.empty((time.size, self.outputs.size, m))
        n_y = len(system.outputs)
        if directions is not None:
            delays = np.zeros((m, inputs.shape[1]))
            for name, k in system.input_delays.items():
                delays[:, system.index("input", name)] = -directions.p_dot[:, k]
            given = directions.shape
            shape = given if given is not None and len(given) == time.size else np.zeros((time.size, m))

        def receive(first: int, times: np.ndarray, states: np.ndarray) -> None:
            rows = slice(first, first + times.size)
            x = np.ascontiguousarray(states[:, :n])
            y[rows] = system.outputs_along(times, x, inputs[rows], p)[:, self.outputs]
            if not bad and not (sound := np.all(np.abs(y[rows]) < LARGEST, axis=1)).all():
                bad.append((first + int(np.argmin(sound)), x[int(np.argmin(sound))].copy()))
            if directions is not None:
                step = max(1, 4_000_000 // max(m * n_y, 1))
                for a in range(0, times.size, step):
                    b = min(a + step, times.size)
                    part = slice(first + a, first + b)
                    dy[part] = observe_along(
                        system,
                        times[a:b],
                        states[a:b],
                        inputs[part],
                        p,
                        directions,
                        self.input_rates[part],
                        delays,
                        shape[part],
                    )[:, self.outputs]

        if n == 0:  # the motion is given: nothing to integrate
            receive(0, time, np.zeros((time.size, 0)))
            if bad:
                raise self._not_finite(*bad[0])
            return y, dy, 0
        solution = integrate(
            problem,
            (float(time[0]), float(time[-1])),
            self.x0,
            samples=Samples(time, receive),
            rtol=self.rtol,
            atol=self.rtol * 1e-3,
            max_step=np.inf,
            max_evaluations=self.max_evaluations,
            stiff_problem=lambda: native_problem(system, p, self.table, directions, tangent=True),
        )
        if bad:
            raise self._not_finite(*bad[0])
        if solution.status < 0:
            raise self.error(solution.message, int(solution.nfev))
        return y, dy, int(solution.nfev)
