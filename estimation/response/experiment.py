"""A machine confronted with one record: what the model says the sensors read, and how that changes with anything.

The model runs from the recorded inputs over the record's own time grid.  Outputs and their derivatives then pass the
same window, filter and decimation as the measurement.  Sensors may have errors of their own (offset, gain, drift,
delay), which are parameters like any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from estimation.files.record import Record
from estimation.response.perturbations import Change, Push
from estimation.signals.preparation import Preparation
from multibody.base.parallel import side_by_side
from multibody.compile.several_directions import worth_lanes
from multibody.system.along_trajectory import observe_along

if TYPE_CHECKING:
    from estimation.response.perturbation_response import PushResponse
    from multibody.inputs.table import InputTable
    from multibody.machine.model import System
    from multibody.solvers.problem import Directions

__all__ = ["Experiment", "Response", "SensorError"]

FEW_DIRECTIONS = 6  # fewer are not worth a second thread, which must simulate the machine as well
SENSOR_KINDS = ("offset", "gain", "drift", "delay")


@dataclass(frozen=True)
class SensorError:
    """An error of the sensor of one output: ``y = (1 + gain)·ŷ(t − delay) + offset + drift·t``.

    Parameters
    ----------
    output : str
    kind : {"offset", "gain", "drift", "delay"}
        Unit: that of the output, 1, that of the output per s, and s.
    value : float
    """

    output: str
    kind: str
    value: float = 0.0

    @property
    def name(self) -> str:
        """Parameter name, such as ``"sensor.carriage.position.offset"``."""
        return f"sensor.{self.output}.{self.kind}"


@dataclass(frozen=True, eq=False)
class Response:
    """Model outputs on the prepared grid of a record, and their derivatives.

    Parameters
    ----------
    outputs : ndarray, shape (n, n_channels)
    derivatives : ndarray, shape (n, n_channels, m)
    evaluations : int
        Evaluations of the equations that the simulation took.
    """

    outputs: np.ndarray
    derivatives: np.ndarray
    evaluations: int = 0


@dataclass(frozen=True, eq=False)
class Experiment:
    """One record, and how a machine is laid beside it.

    Parameters
    ----------
    record : Record
        Its signals carry the names of model inputs and outputs.
    inputs, outputs : tuple of str
        Model inputs that the record drives, and outputs that it measured.
    preparation : Preparation
        Window, low-pass and decimation for record and model.
    start : mapping of str to (float or "measured")
        Start values of states in SI; ``"measured"`` takes the first sample of the output of the same name.
    free : tuple of str
        States whose start value is estimated from this record.
    offsets : tuple of str
        Outputs whose sensor may have an offset of its own in this record.
    rtol : float
        Relative tolerance of the integration.
    held : tuple of str
        Inputs that keep their value until the next sample; the others change in a straight line.
    input_noise : mapping of str to float
        Noise of recorded inputs that a scan has to reckon with, SI; empty where it does not matter.
    noise_band : float, Hz
        Up to which frequency it has to; 0 leaves that to the scan.
    max_evaluations : int, optional
        A simulation that needs more evaluations of the equations than this is given up.
    """

    record: Record
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    preparation: Preparation = field(default_factory=Preparation)
    start: Mapping[str, float | Literal["measured"]] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    offsets: tuple[str, ...] = ()
    rtol: float = 1e-6
    held: tuple[str, ...] = ()
    input_noise: Mapping[str, float] = field(default_factory=dict)
    noise_band: float = 0.0
    max_evaluations: int | None = None
    _cache: dict[str, object] = field(default_factory=dict, repr=False)

    # ---------------------------------------------------------------- the measurement

    @property
    def name(self) -> str:
        """The record's name."""
        return self.record.name

    @property
    def time(self) -> np.ndarray:
        """Time of the prepared samples, shape (n,), s."""
        return self._measured()[0]

    @property
    def measured(self) -> np.ndarray:
        """Prepared measurement, shape (n, n_channels)."""
        return self._measured()[1]

    def _measured(self) -> tuple[np.ndarray, np.ndarray]:
        if "measured" not in self._cache:
            self._cache["measured"] = self.preparation.apply(self.record.time, self.record.values(*self.outputs))
        return self._cache["measured"]  # type: ignore[return-value]

    def with_preparation(self, preparation: Preparation) -> Experiment:
        """Return the same experiment, prepared otherwise."""
        kept = {k: v for k, v in self._cache.items() if k.startswith("table ")}
        return replace(self, preparation=preparation, _cache=kept)

    # ---------------------------------------------------------------- the model

    def table(self, system: System) -> InputTable:
        """Return the recorded inputs as the system's input table; inputs that are not recorded keep their default."""
        from multibody.system.simulate import input_table

        key = self._table_key(system)
        if key not in self._cache:
            driven = {n: (self.record.time, self.record.signals[n].values) for n in self.inputs}
            table = input_table(system, driven)
            if self.held:
                kinds = ["hold" if n in self.held else k for n, k in zip(table.names, table.interpolation, strict=True)]
                table = replace(table, interpolation=kinds)
            self._cache[key] = table
        return self._cache[key]  # type: ignore[return-value]

    def _table_key(self, system: System) -> str:
        # systems of the same inputs share a table: one with more outputs, one with an effect in it
        of = (system.input_names, tuple(sorted(system.input_delays.items())), tuple(q.value for q in system.inputs))
        return f"table {of}"

    def _inputs_along(self, system: System, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return inputs and their rates at the record's samples, each (nt, n_u); kept where no parameter delays one."""
        table, key = self.table(system), f"{self._table_key(system)} along"
        if key in self._cache:
            return self._cache[key]  # type: ignore[return-value]
        time = np.array(self.record.time)
        inputs, rates = (
            np.ascontiguousarray(of(time, p).reshape(time.size, -1)) for of in (table, table.derivative)
        )
        if np.all(np.asarray(table.delay_parameter) < 0):
            self._cache[key] = inputs, rates
        return inputs, rates

    def start_vector(self, system: System) -> np.ndarray:
        """Return the start state: the study's values, what the sensors read first, else the model's own."""
        x = system.start
        for k, name in enumerate(system.state_names):
            given = self.start.get(name)
            if isinstance(given, float | int):
                x[k] = given
            elif name in self.outputs and (given == "measured" or name in self.free):
                x[k] = self.record.signals[name].values[0]
        return x

    def simulate(
        self, system: System, p: np.ndarray, x0: np.ndarray | None = None, sensors: Sequence[SensorError] = ()
    ) -> np.ndarray:
        """Return what the model says the sensors read, prepared, shape (n, n_channels).

        Raises
        ------
        SimulationError
            If the integration fails.
        """
        return self.respond(system, p, x0, sensors=sensors).outputs

    def respond(
        self,
        system: System,
        p: np.ndarray,
        x0: np.ndarray | None = None,
        *,
        parameters: Sequence[str] = (),
        states: Sequence[str] = (),
        pushes: Sequence[Push | Change] = (),
        sensors: Sequence[SensorError] = (),
        batch: int = 48,
        workers: int = 1,
    ) -> Response:
        """Simulate the record and differentiate the outputs along directions, all in compiled code.

        Parameters
        ----------
        system : System
        p : ndarray, shape (n_p,)
        x0 : ndarray, shape (n,), optional
            Start state; default `start_vector`.
        parameters, states : sequence of str
            Parameters (``sensor.…`` included) and start values to differentiate by.
        pushes : sequence of Push or Change
            Extra input signals to differentiate by; with a Change among them all are carried by transitions.
        sensors : sequence of SensorError
            Errors of the sensors.
        batch : int
            Directions integrated together; limits memory.
        workers : int
            Threads among which the directions are divided.

        Returns
        -------
        Response
            Derivatives in the order parameters, states, pushes.
        """
        from estimation.response.perturbation_response import at_hand, response_of, worth_it

        x0 = self.start_vector(system) if x0 is None else x0
        integrated = [q for q in pushes if isinstance(q, Push)]
        changed = len(integrated) < len(pushes)
        if changed and (parameters or states):
            raise ValueError("a Change is carried, parameters and start values are integrated: ask for them apart")
        alone = not (parameters or states)
        if changed or (alone and (worth_it(system, pushes) or at_hand(self, system, p, x0, pushes))):
            return self._carried(response_of(self, system, p, x0, pushes), pushes, sensors, workers)
        physical = [n for n in parameters if not n.startswith("sensor.")]
        total = len(physical) + len(states) + len(pushes)
        pick = np.array([system.index("output", n) for n in self.outputs])
        if workers > 1 and total >= FEW_DIRECTIONS:
            batch = min(batch, -(-total // workers))

        def part(first: int) -> tuple[np.ndarray, np.ndarray, int]:
            directions = self._directions(system, physical, states, integrated, slice(first, min(first + batch, total)))
            return _integrate(system, self, p, x0, directions, pick)

        self.table(system)  # made once, before the threads ask for it
        parts = side_by_side(part, range(0, max(total, 1), batch), most=workers)
        dy = np.concatenate([d for _, d, _ in parts], axis=2)
        found = self._prepared(parts[0][0], dy, sensors, parameters, physical)
        return replace(found, evaluations=parts[0][2])

    def _carried(
        self, by: PushResponse, pushes: Sequence[Push | Change], sensors: Sequence[SensorError], workers: int
    ) -> Response:
        """Return the response to pushes through transitions, the pushes divided among threads."""

        def answer(some: Sequence[Push | Change]) -> Response:
            return self._prepared(by.outputs, by(some), sensors, [], [])

        count = min(workers, len(pushes))
        shares = side_by_side(answer, [pushes[k::count] for k in range(count)])
        derivatives = np.empty((*shares[0].outputs.shape, len(pushes)))
        for k, share in enumerate(shares):
            derivatives[:, :, k::count] = share.derivatives
        return Response(shares[0].outputs, derivatives)

    def _prepared(
        self,
        raw: np.ndarray,
        dy: np.ndarray,
        sensors: Sequence[SensorError],
        parameters: Sequence[str],
        physical: Sequence[str],
    ) -> Response:
        """Send raw outputs and derivatives through sensors and preparation."""
        time = self.record.time
        y, dy, own = _apply_sensors(self.outputs, time, raw, dy, sensors, [n for n in parameters if n not in physical])
        order = {n: k for k, n in enumerate(physical)}
        if own:
            columns = [dy[:, :, order[n]] if n in order else own[n] for n in parameters]
            dy = np.concatenate([np.stack(columns, axis=2), dy[:, :, len(physical) :]], axis=2)
        stacked = np.concatenate([y[:, :, None], dy], axis=2)
        prepared = self.preparation.apply(time, stacked.reshape(time.size, -1))[1].reshape(-1, *stacked.shape[1:])
        return Response(prepared[:, :, 0], prepared[:, :, 1:])

    def _directions(
        self, system: System, parameters: Sequence[str], states: Sequence[str], pushes: Sequence[Push], part: slice
    ) -> Directions | None:
        from multibody.solvers.problem import Directions

        n, n_p = len(system.states), len(system.parameters)
        chosen = [*parameters, *states, *pushes][part]
        if not chosen:
            return None
        m = len(chosen)
        x_dot, p_dot, channel = np.zeros((m, n)), np.zeros((m, n_p)), np.full(m, -1)
        shape_t = self.record.time if pushes else None
        shape = np.zeros((self.record.time.size, m)) if pushes else None
        for k, item in enumerate(chosen):
            if isinstance(item, Push):
                channel[k] = system.index("input", item.channel)
                assert shape is not None
                shape[:, k] = item.values
            elif part.start + k < len(parameters):
                p_dot[k, system.index("parameter", str(item))] = 1.0
            else:
                x_dot[k, system.index("state", str(item))] = 1.0
        return Directions(x_dot, p_dot, channel, shape_t, shape)


def _integrate(
    system: System, experiment: Experiment, p: np.ndarray, x0: np.ndarray, directions: Directions | None,
    pick: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return outputs (nt, n_channels), their derivatives (nt, n_channels, m) on the record's grid, and evaluations."""
    from multibody.base.errors import SimulationError
    from multibody.solvers import Samples, integrate
    from multibody.system.simulate import native_problem

    time = np.array(experiment.record.time)
    table = experiment.table(system)
    wide = directions is not None and worth_lanes(time.size, directions.count)
    problem = native_problem(system, p, table, directions, in_lanes=wide)
    inputs, rates = experiment._inputs_along(system, p)
    n, m = len(system.states), problem.n_directions
    y = np.empty((time.size, pick.size))
    dy = np.empty((time.size, pick.size, m))
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
        y[rows] = system.outputs_along(times, x, inputs[rows], p)[:, pick]
        if directions is not None:
            step = max(1, 4_000_000 // max(m * n_y, 1))
            for a in range(0, times.size, step):
                b = min(a + step, times.size)
                part = slice(first + a, first + b)
                dy[part] = observe_along(
                    system, times[a:b], states[a:b], inputs[part], p, directions, rates[part], delays, shape[part]
                )[:, pick]

    if n == 0:  # the motion is given: nothing to integrate
        receive(0, time, np.zeros((time.size, 0)))
        return y, dy, 0
    solution = integrate(
        problem, (float(time[0]), float(time[-1])), x0, samples=Samples(time, receive), rtol=experiment.rtol,
        atol=experiment.rtol * 1e-3, max_step=np.inf, max_evaluations=experiment.max_evaluations,
        stiff_problem=lambda: native_problem(system, p, table, directions, tangent=True, in_lanes=wide))
    if solution.status < 0 or not np.all(np.isfinite(y)):
        raise SimulationError(f"'{system.name}' on record '{experiment.name}': {solution.message}")
    return y, dy, int(solution.nfev)


def _apply_sensors(
    outputs: Sequence[str], time: np.ndarray, y: np.ndarray, dy: np.ndarray, sensors: Sequence[SensorError],
    wanted: Sequence[str],
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Send outputs and derivatives through the sensors, and differentiate by the sensors' own parameters."""
    if not sensors and not wanted:
        return y, dy, {}
    y, dy = y.copy(), dy if not sensors else dy.copy()
    value = {s.name: s.value for s in sensors}
    own = {name: np.zeros_like(y) for name in wanted}
    since = time - time[0]
    for c, output in enumerate(outputs):
        offset, gain, drift, delay = (value.get(f"sensor.{output}.{kind}", 0.0) for kind in SENSOR_KINDS)
        rate = np.gradient(y[:, c], time) if f"sensor.{output}.delay" in own or delay else None
        if delay:
            late = time - delay
            y[:, c] = np.interp(late, time, y[:, c])
            for k in range(dy.shape[2]):
                dy[:, c, k] = np.interp(late, time, dy[:, c, k])
        parts = {"offset": np.ones_like(time), "gain": y[:, c], "drift": since,
                 "delay": -(1.0 + gain) * rate if rate is not None else None}
        for kind, part in parts.items():
            if part is not None and f"sensor.{output}.{kind}" in own:
                own[f"sensor.{output}.{kind}"][:, c] = part
        y[:, c] = (1.0 + gain) * y[:, c] + offset + drift * since
        dy[:, c] *= 1.0 + gain
    return y, dy, own
