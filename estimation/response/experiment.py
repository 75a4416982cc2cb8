"""An experiment: one record, how it drives a machine, and which outputs it measured.

The model runs from the recorded inputs over the record's own time grid.  Outputs and their derivatives then pass the
same window, filter and decimation as the measurement.  Sensors may have errors of their own (offset, gain, drift,
delay), which are parameters like any other.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from estimation.files.record import Record
from estimation.response.own_instants import AtOwnInstants, at_own_instants
from estimation.response.perturbations import (
    Channel,
    InputPerturbation,
    Perturbation,
    PerturbationResponse,
    cheaper_by_transition_matrices,
    perturbed_channels,
)
from estimation.response.record_simulation import RecordSimulation
from estimation.response.sensors import SensorError, apply_sensors
from estimation.signals.preparation import Preparation
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from multibody.inputs.table import InputTable
    from multibody.machine.model import System
    from multibody.solvers.problem import Directions

__all__ = ["Experiment", "FittedClock", "Response"]

FEW_DIRECTIONS = 6  # fewer are not worth a second thread, which must simulate the machine as well
AT_ONCE = 64  # perturbations whose responses at the rate of the record are in memory at a time, for each thread; chosen
KEPT_BYTES = 1 << 25  # state-transition matrices larger than this do not survive `Experiment.trim_cache`


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


@dataclass(eq=False, kw_only=True)
class _Cache:
    """Results that an experiment keeps; only the experiment itself reads and writes them."""

    measured: tuple[np.ndarray, np.ndarray] | None = None
    own_instants: dict[int, AtOwnInstants] | None = None
    tables: dict[Hashable, InputTable] = field(default_factory=dict)
    inputs_along: dict[Hashable, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    perturbation_response: tuple[System, np.ndarray, np.ndarray, PerturbationResponse] | None = None


@dataclass(frozen=True)
class FittedClock:
    """A logger whose clock may differ by a constant from that of the inputs.

    Parameters
    ----------
    files : str
        Pattern of its file names.
    outputs : tuple of str
        What it measured.
    added : float, s
        What has been added to its time already; a fit estimates what is left.
    """

    files: str
    outputs: tuple[str, ...]
    added: float = 0.0

    @property
    def name(self) -> str:
        """Name of what is left of the offset among a record's own unknowns."""
        return f"clock of {self.files}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment:
    """One record, how it drives a machine, and which outputs it measured.

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
    clocks : tuple of FittedClock
        Loggers whose clock may differ by a constant from that of the inputs in this record.
    rtol : float
        Relative tolerance of the integration.
    held : tuple of str
        Inputs that keep their value until the next sample; the others change in a straight line.
    input_noise : mapping of str to float
        Standard deviation of the noise of recorded inputs that a scan takes into account, SI; empty where it does not
        matter.
    noise_band : float, Hz
        Highest frequency of that noise to take into account; 0 leaves it to the scan.
    max_evaluations : int, optional
        A simulation that needs more evaluations of the equations stops with an error.
    forces : mapping of str to ndarray, shape (nt,)
        What acted on inputs of the model besides, on the record's time grid: the likeliest course of forces that nobody
        recorded.
    """

    record: Record
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    preparation: Preparation = field(default_factory=Preparation)
    start: Mapping[str, float | Literal["measured"]] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    offsets: tuple[str, ...] = ()
    clocks: tuple[FittedClock, ...] = ()
    rtol: float = 1e-6
    held: tuple[str, ...] = ()
    input_noise: Mapping[str, float] = field(default_factory=dict)
    noise_band: float = 0.0
    max_evaluations: int | None = None
    forces: Mapping[str, np.ndarray] = field(default_factory=dict)
    _cache: _Cache = field(default_factory=_Cache, init=False, repr=False)

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
        if self._cache.measured is None:
            self._cache.measured = self.preparation.apply(self.record.time, self.record.values(*self.outputs))
        return self._cache.measured

    def with_preparation(self, preparation: Preparation) -> Experiment:
        """Return the same experiment with another preparation; the input tables are shared."""
        return self._with_tables(replace(self, preparation=preparation))

    def with_forces(self, forces: Mapping[str, np.ndarray]) -> Experiment:
        """Return the same experiment with other forces that nobody recorded."""
        return replace(self, forces=dict(forces))

    def without_input_noise(self) -> Experiment:
        """Return the same experiment with inputs that count as exact; the input tables are shared."""
        return self._with_tables(replace(self, input_noise={}))

    def _with_tables(self, other: Experiment) -> Experiment:
        """Let an experiment on the same record share the input tables, also those that either makes later."""
        other._cache.tables, other._cache.inputs_along = self._cache.tables, self._cache.inputs_along
        return other

    # ---------------------------------------------------------------- the model

    def table(self, system: System) -> InputTable:
        """Return the recorded inputs as the system's input table; inputs that are not recorded keep their default."""
        from multibody.system.simulate import input_table

        key = self._table_key(system)
        if key not in self._cache.tables:
            driven = {n: (self.record.time, self.record.signals[n].values) for n in self.inputs}
            driven |= {n: (self.record.time, values) for n, values in self.forces.items()}
            table = input_table(system, driven)
            if self.held:
                kinds = ["hold" if n in self.held else k for n, k in zip(table.names, table.interpolation, strict=True)]
                table = replace(table, interpolation=kinds)
            self._cache.tables[key] = table
        return self._cache.tables[key]

    @staticmethod
    def _table_key(system: System) -> Hashable:
        # systems of the same inputs share a table: one with more outputs, one with an effect in it
        return system.input_names, tuple(sorted(system.input_delays.items())), tuple(q.value for q in system.inputs)

    def _inputs_along(self, system: System, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return inputs and their rates at the record's samples, each (nt, n_u); kept where no parameter delays one."""
        table, key = self.table(system), self._table_key(system)
        if key in self._cache.inputs_along:
            return self._cache.inputs_along[key]
        time = np.array(self.record.time)
        inputs, rates = (np.ascontiguousarray(of(time, p).reshape(time.size, -1)) for of in (table, table.derivative))
        if np.all(np.asarray(table.delay_parameter) < 0):
            self._cache.inputs_along[key] = inputs, rates
        return inputs, rates

    def start_vector(self, system: System) -> np.ndarray:
        """Return the start state: the study's values, the first samples of the sensors, else the model's own."""
        x = system.start
        for k, name in enumerate(system.state_names):
            given = self.start.get(name)
            if isinstance(given, float | int):
                x[k] = given
            elif name in self.outputs and (given == "measured" or name in self.free):
                x[k] = self.record.signals[name].values[0]
        return x

    def simulation(self, system: System, p: np.ndarray, x0: np.ndarray | None = None) -> RecordSimulation:
        """Return the simulation of this record by a system, ready to integrate."""
        inputs, rates = self._inputs_along(system, p)
        return RecordSimulation(
            record=self.name,
            system=system,
            p=p,
            x0=self.start_vector(system) if x0 is None else x0,
            time=np.array(self.record.time),
            table=self.table(system),
            inputs=inputs,
            input_rates=rates,
            outputs=np.array([system.index("output", n) for n in self.outputs]),
            rtol=self.rtol,
            max_evaluations=self.max_evaluations,
        )

    def simulate(
        self, system: System, p: np.ndarray, x0: np.ndarray | None = None, sensors: Sequence[SensorError] = ()
    ) -> np.ndarray:
        """Return the model's prediction of what the sensors measure, prepared, shape (n, n_channels).

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
        perturbations: Sequence[Perturbation] = (),
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
        perturbations : sequence of InputPerturbation or ParameterPerturbation
            Extra input signals and lasting changes of parameters to differentiate by.  They are propagated by
            state-transition matrices where a ParameterPerturbation is among them, where that is cheaper, and where
            the matrices are kept from an earlier call; elsewhere each is a direction that is integrated.
        sensors : sequence of SensorError
            Errors of the sensors.
        batch : int
            Directions integrated together; limits memory.
        workers : int
            Threads among which the directions are divided.

        Returns
        -------
        Response
            Derivatives in the order parameters, states, perturbations.
        """
        x0 = self.start_vector(system) if x0 is None else x0
        integrated = [q for q in perturbations if isinstance(q, InputPerturbation)]
        lasting = len(integrated) < len(perturbations)
        if lasting and (parameters or states):
            raise ValueError(
                "a ParameterPerturbation is propagated by state-transition matrices, parameters and start values are "
                "integrated: differentiate by them in separate calls"
            )
        if not (parameters or states):
            kept = self._kept_perturbation_response(system, p, x0)
            if (
                lasting
                or cheaper_by_transition_matrices(system, perturbations, np.size(self.record.time))
                or (kept is not None and kept.serves(perturbations))
            ):
                linearised = self.perturbation_response(system, p, x0, perturbations)
                return self._propagated(linearised, perturbations, sensors, workers)
        physical = [n for n in parameters if not n.startswith("sensor.")]
        total = len(physical) + len(states) + len(perturbations)
        if workers > 1 and total >= FEW_DIRECTIONS:
            batch = min(batch, -(-total // workers))
        simulation = self.simulation(system, p, x0)

        def part(first: int) -> tuple[np.ndarray, np.ndarray, int]:
            chosen = slice(first, min(first + batch, total))
            return simulation.integrate(_directions(simulation, physical, states, integrated, chosen))

        parts = parallel_map(part, range(0, max(total, 1), batch), most=workers)
        dy = np.concatenate([d for _, d, _ in parts], axis=2)
        response = self._prepared(parts[0][0], dy, sensors, parameters, physical)
        return replace(response, evaluations=parts[0][2])

    def _propagated(
        self,
        linearised: PerturbationResponse,
        perturbations: Sequence[Perturbation],
        sensors: Sequence[SensorError],
        workers: int,
    ) -> Response:
        """Return the response to perturbations by state-transition matrices, divided among threads."""

        def prepared(dy: np.ndarray) -> Response:
            return self._prepared(linearised.outputs, dy, sensors, [], [])

        total = len(perturbations)
        outputs = prepared(np.empty((*linearised.outputs.shape, 0))).outputs
        derivatives = np.empty((*outputs.shape, total))
        count = max(min(workers, total), -(-total // AT_ONCE))

        def fill(k: int) -> None:
            derivatives[:, :, k::count] = prepared(linearised(perturbations[k::count])).derivatives

        parallel_map(fill, range(count), most=workers)
        return Response(outputs, derivatives)

    def _prepared(
        self,
        raw: np.ndarray,
        dy: np.ndarray,
        sensors: Sequence[SensorError],
        parameters: Sequence[str],
        physical: Sequence[str],
    ) -> Response:
        """Apply sensors and preparation to raw outputs and derivatives."""
        time = self.record.time
        of_sensors = [n for n in parameters if n not in physical]
        y, dy, by_sensors = apply_sensors(self.outputs, time, raw, dy, sensors, of_sensors)
        order = {n: k for k, n in enumerate(physical)}
        if by_sensors:
            ordered = [dy[:, :, order[n]] if n in order else by_sensors[n] for n in parameters]
            dy = np.concatenate([np.stack(ordered, axis=2), dy[:, :, len(physical) :]], axis=2)
        stacked = np.concatenate([y[:, :, None], dy], axis=2)
        for c, taken in self._own_instants().items():
            stacked[:, c] = taken(stacked[:, c])
        prepared = self.preparation.apply(time, stacked.reshape(time.size, -1))[1].reshape(-1, *stacked.shape[1:])
        return Response(prepared[:, :, 0], prepared[:, :, 1:])

    def _own_instants(self) -> dict[int, AtOwnInstants]:
        """Return the operators of the outputs that were sampled at instants of their own, by column."""
        if self._cache.own_instants is None:
            signals = self.record.signals  # of a trip that is only proposed, no output has been recorded
            recorded = {c: signals[n] for c, n in enumerate(self.outputs) if n in signals}
            samples = {c: s.own for c, s in recorded.items() if s.own is not None}
            self._cache.own_instants = at_own_instants(np.asarray(self.record.time), samples)
        return self._cache.own_instants

    # ---------------------------------------------------------------- what is unknown of this record alone

    @property
    def own_unknowns(self) -> tuple[str, ...]:
        """Names of what is estimated from this record alone: start values, offsets of sensors and of clocks."""
        offsets = (f"offset of {n}" for n in self.offsets)
        return (*self.free, *offsets, *(c.name for c in self.clocks))

    @property
    def at_own_instants(self) -> bool:
        """Whether an output has instants, or a clock, of its own."""
        return bool(self.clocks) or any(
            self.record.signals[n].own is not None for n in self.outputs if n in self.record.signals
        )

    def respond_with_own(
        self,
        system: System,
        p: np.ndarray,
        own: Mapping[str, float],
        *,
        parameters: Sequence[str] = (),
        sensors: Sequence[SensorError] = (),
        derivatives: bool = True,
        workers: int = 1,
    ) -> Response:
        """Simulate the record with values for what is unknown of it alone.

        Parameters
        ----------
        system, p, parameters, sensors, workers
            As for `respond`.
        own : mapping of str to float
            Values of `own_unknowns`; those that are missing are as at the start of a fit.
        derivatives : bool
            Whether to differentiate.

        Returns
        -------
        Response
            Derivatives by the parameters, then by `own_unknowns`.
        """
        x0 = self.start_vector(system)
        for name in self.free:
            if name in own:
                x0[system.index("state", name)] = own[name]
        late = {f"sensor.{o}.delay": -own.get(c.name, 0.0) for c in self.clocks for o in c.outputs}
        given = {s.name: s for s in sensors}
        for name, value in late.items():
            before = given[name].value if name in given else 0.0
            given[name] = SensorError(name[7:-6], "delay", before + value)
        asked = [*parameters, *(n for n in late if n not in parameters)] if derivatives else []
        response = self.respond(
            system,
            p,
            x0,
            parameters=asked,
            states=self.free if derivatives else (),
            sensors=tuple(given.values()),
            workers=workers,
        )
        outputs = response.outputs.copy()
        for name in self.offsets:
            outputs[:, self.outputs.index(name)] += own.get(f"offset of {name}", 0.0)
        if not derivatives:
            return Response(outputs, response.derivatives, response.evaluations)
        dy = response.derivatives
        blocks = [dy[:, :, : len(parameters)], dy[:, :, len(asked) :]]
        for name in self.offsets:
            one = np.zeros((*dy.shape[:2], 1))
            one[:, self.outputs.index(name)] = 1.0
            blocks.append(one)
        for clock in self.clocks:
            shifted = [dy[:, :, asked.index(f"sensor.{o}.delay"), None] for o in clock.outputs]
            blocks.append(-np.sum(shifted, axis=0))
        return Response(outputs, np.concatenate(blocks, axis=2), response.evaluations)

    # ---------------------------------------------------------------- state-transition matrices, kept

    def perturbation_response(
        self,
        system: System,
        p: np.ndarray,
        x0: np.ndarray,
        perturbations: Sequence[Perturbation],
        also: Sequence[Channel] = (),
    ) -> PerturbationResponse:
        """Return the linearised response to some perturbations; the last one is kept until `trim_cache`.

        ``also`` names further channels that will be perturbed later.
        """
        channels = perturbed_channels(perturbations, also)
        kept = self._kept_perturbation_response(system, p, x0)
        if kept is not None:
            if set(channels) <= set(kept.channels):
                return kept
            channels = perturbed_channels(perturbations, [*kept.channels, *also])
        linearised = PerturbationResponse.along(self.simulation(system, p, x0), channels)
        self._cache.perturbation_response = system, p.copy(), x0.copy(), linearised
        return linearised

    def _kept_perturbation_response(self, system: System, p: np.ndarray, x0: np.ndarray) -> PerturbationResponse | None:
        if self._cache.perturbation_response is None:
            return None
        of, at, start, linearised = self._cache.perturbation_response
        same = of is system and np.array_equal(at, p) and np.array_equal(start, x0)
        return linearised if same else None

    def trim_cache(self) -> None:
        """Free the memory of state-transition matrices that are too large to be kept."""
        kept = self._cache.perturbation_response
        if kept is not None and kept[3].nbytes > KEPT_BYTES:
            self._cache.perturbation_response = None

    def drop_matrices(self) -> None:
        """Free the memory of the state-transition matrices."""
        self._cache.perturbation_response = None

    def clear_cache(self) -> None:
        """Drop every kept result; each is computed again when it is needed."""
        object.__setattr__(self, "_cache", _Cache())


def _directions(
    simulation: RecordSimulation,
    parameters: Sequence[str],
    states: Sequence[str],
    perturbations: Sequence[InputPerturbation],
    part: slice,
) -> Directions | None:
    """Return the directions of a part of all that the outputs are differentiated by; None for none."""
    from multibody.solvers.problem import Directions

    system, time = simulation.system, simulation.time
    n, n_p = len(system.states), len(system.parameters)
    every: list[str | InputPerturbation] = [*parameters, *states, *perturbations]
    chosen = every[part]
    if not chosen:
        return None
    m = len(chosen)
    x_dot, p_dot, channel = np.zeros((m, n)), np.zeros((m, n_p)), np.full(m, -1)
    shape_t = time if perturbations else None
    shape = np.zeros((time.size, m)) if perturbations else None
    for k, item in enumerate(chosen):
        if isinstance(item, InputPerturbation):
            channel[k] = system.index("input", item.channel)
            assert shape is not None
            shape[:, k] = item.values
        elif part.start + k < len(parameters):
            p_dot[k, system.index("parameter", item)] = 1.0
        else:
            x_dot[k, system.index("state", item)] = 1.0
    return Directions(x0_dot=x_dot, p_dot=p_dot, channel=channel, shape_t=shape_t, shape=shape)
