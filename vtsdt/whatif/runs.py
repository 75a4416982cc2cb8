"""Energies of many trips of the reference model: other rails and parameters, one compiled structure.

Rails are tables in the parameter vector, so the rail as it is, straightened and drawn rails are the same compiled model
with other numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.errors import SimulationError
from multibody.base.gravity import STANDARD_GRAVITY
from multibody.equations.tables import packed
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile
from vtsdt.lift.energy import TripEnergy
from vtsdt.lift.lift import Lift

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["TripRunner", "Variant"]

#: Step of the samples from which energies are integrated, s.
STEP = 2e-3
_SIGNALS = ("pulley.speed", "machine.torque", "fric_c", "fric_cw", "v_c", "z_c", "cabin.potential_energy")
_RAIL = "cabin_guide.right_x"


@dataclass(frozen=True, eq=False)
class SimulatedTrip:
    """What the energies of a trip need of its simulation.

    Parameters
    ----------
    energy : TripEnergy
    height : ndarray, shape (n,), m
        Of the cabin.
    loss : ndarray, shape (n,), W
        Power lost in the cabin's guides.
    time : ndarray, shape (n,), s
    """

    energy: TripEnergy
    height: np.ndarray
    loss: np.ndarray
    time: np.ndarray

    def lost_between(self, low: float, high: float) -> float:
        """Return the energy lost in the cabin's guides while the floor is between two heights, J."""
        inside = (self.height >= low) & (self.height <= high)
        return float(np.trapezoid(np.where(inside, self.loss, 0.0), self.time))


@dataclass(frozen=True, eq=False)
class Variant:
    """Rail and parameters of one run.

    Parameters
    ----------
    rail : RailProfile or None
        The cabin's right rail; None: the lift's own.
    values : mapping of str to float
        Parameters of the model by name, SI.
    """

    rail: RailProfile | None = None
    values: Mapping[str, float] = field(default_factory=dict)


class TripRunner:
    """Simulates trips of one lift, with other rails and parameters from run to run.

    Parameters
    ----------
    parameters : LiftParameters
    heights : ndarray, m
        Heights of the points of the cabin's rail; a clipped rail needs points close to its kinks.
    direction : {"up", "down"}
    rtol : float
        Relative tolerance of the integration.
    """

    def __init__(
        self, parameters: LiftParameters, heights: np.ndarray, direction: str = "up", rtol: float = 1e-7
    ) -> None:
        self.parameters, self.direction, self.rtol = parameters, direction, rtol
        self.heights = np.asarray(heights, dtype=float)
        rail = parameters.cabin_guide.right_x or RailProfile(
            (parameters.hoistway.rail_bottom, parameters.hoistway.rail_top), (0.0, 0.0)
        )
        guide = dataclasses.replace(parameters.cabin_guide, right_x=rail.resampled(tuple(map(float, self.heights))))
        self.lift = Lift.reference(dataclasses.replace(parameters, cabin_guide=guide))
        travel = parameters.hoistway.travel
        self.start = 0.0 if direction == "up" else travel

    @cached_property
    def system(self) -> System:
        """The compiled lift with the outputs that energies need."""
        names = [n for n in _SIGNALS if n != "cabin.potential_energy"]
        return self.lift.build(outputs=names)

    @cached_property
    def _points(self) -> slice:
        first = self.system.index("parameter", f"{_RAIL}.x[0]")
        return slice(first, first + 3 * self.heights.size)

    def vector(self, run: Variant) -> np.ndarray:
        """Return the parameter vector of a run."""
        p = self.system.parameter_vector(dict(run.values))
        if run.rail is not None:
            same_heights = np.array_equal(run.rail.height, self.heights)
            deviation = np.array(run.rail.deviation if same_heights else [run.rail.at(h) for h in self.heights])
            p[self._points] = packed(self.heights, deviation, "cubic")
        return p

    def run(self, runs: Sequence[Variant], progress: Callable[[int], None] | None = None) -> Iterator[SimulatedTrip]:
        """Simulate trips in parallel threads and yield them in order.

        Raises
        ------
        SimulationError
            If a run fails: which, and why.
        """
        from multibody.solvers.batch import batch
        from multibody.system.simulate import input_table, native_problem

        system = self.system
        duration = self.parameters.trip.duration
        times = np.arange(round(duration / STEP) + 1) * STEP
        omega = self.lift.speed_reference(self.direction)
        table = input_table(system, {"omega_ref": omega})
        inputs = np.ascontiguousarray(table(times, system.p).reshape(times.size, -1))
        vectors: list[np.ndarray] = []
        guess: dict[str, float] = {}

        def problems() -> Iterator[tuple[Any, np.ndarray]]:
            for one in runs:
                p = self.vector(one)
                vectors.append(p)
                start = self.lift.equilibrium(
                    self.start, system=system, inputs={"omega_ref": 0.0}, parameters=p, guess=guess
                )
                if not guess:  # the next state at rest is close to this one
                    guess.update({k: v for k, v in start.to_dict().items() if k != "pulley.angle"})
                yield native_problem(system, p, table), start.state

        options: dict[str, Any] = {"rtol": self.rtol, "atol": 1e-3 * self.rtol}
        for result in batch(problems(), (0.0, float(times[-1])), times, **options):
            if not result.success:
                raise SimulationError(f"'{self.lift.name}', run {result.index + 1} of {len(runs)}: {result.message}")
            states = np.ascontiguousarray(result.y[: len(system.states)].T)
            p = vectors[result.index]
            y = system.outputs_along(times, states, inputs, p)
            yield self._signals(times, states, y, p)
            if progress is not None:
                progress(result.index + 1)

    def _signals(self, t: np.ndarray, states: np.ndarray, y: np.ndarray, p: np.ndarray) -> SimulatedTrip:
        system = self.system

        def out(name: str) -> np.ndarray:
            return y[:, system.index("output", name)]

        def state(name: str) -> np.ndarray:
            return states[:, system.index("state", name)]

        loss_c = -out("fric_c") * state("cabin.v_z")
        loss_cw = -out("fric_cw") * state("counterweight.v_z")
        machine_energy = -float(np.trapezoid(out("machine.torque") * out("pulley.speed"), t))
        potential = 0.0
        for body in ("cabin", "counterweight"):
            mass = p[system.index("parameter", f"{body}.mass")]
            potential -= mass * STANDARD_GRAVITY * float(_com_height(body, states, system, p)[[-1, 0]] @ (1.0, -1.0))
        energy = TripEnergy(float(np.trapezoid(loss_c, t)), float(np.trapezoid(loss_cw, t)), potential, machine_energy)
        return SimulatedTrip(energy, out("z_c"), loss_c, t)


def _com_height(body: str, states: np.ndarray, system: System, p: np.ndarray) -> np.ndarray:
    """Return the height of a body's centre of mass over time, m."""

    def state(name: str) -> np.ndarray:
        return states[:, system.index("state", f"{body}.{name}")]

    x, y, z = (float(p[system.index("parameter", f"{body}.com_{axis}")]) for axis in "xyz")
    roll, pitch = state("roll"), state("pitch")
    # third row of R_z(yaw) R_y(pitch) R_x(roll)
    lifted = -np.sin(pitch) * x + np.cos(pitch) * (np.sin(roll) * y + np.cos(roll) * z)
    return np.asarray(state("z") + lifted)
