"""What an updated model is judged by: the paper's two objectives, and amplitudes and phases over several loads.

All take runs of the model at the recordings' conditions and return one number to be made large.  They are explicit
about what they fit on the way: a lag for each recording and, for amplitudes, a gain for each sensor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.mesh_lines import fit_lines
from gearbox.signals.recordings import Recording
from gearbox.signals.signal import Processing, Signal, SignalError
from gearbox.signals.similarity import LagRule, Similarity, bound_of_mesh_lines, similarity
from gearbox.updating.virtual import Run

__all__ = ["AmplitudeObjective", "DifferenceObjective", "MeasuredLines", "Objective", "SimilarityObjective"]

Complex = NDArray[np.complex128]


class Objective(Protocol):
    """What the chain needs of an objective."""

    name: str

    @property
    def conditions(self) -> tuple[OperatingCondition, ...]:
        """Conditions that the model is to be run at."""
        ...

    def value(self, runs: Sequence[Run]) -> float:
        """One number for runs at the conditions, to be made large; NaN where one failed."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class SimilarityObjective:
    """Cosine similarity of one sensor in one recording (Eq. 8).

    Parameters
    ----------
    recording : Recording
        With its speed matched.
    sensor : str
    processing : Processing
    driving_teeth : int
    rule : str
        How the lag is chosen, see :data:`gearbox.signals.similarity.LAG_RULES`.
    lag : float, optional, s
        For the rule "held".
    """

    recording: Recording
    sensor: str
    processing: Processing
    driving_teeth: int
    rule: LagRule = "best"
    lag: float | None = None
    name: str = "cosine similarity"

    @property
    def conditions(self) -> tuple[OperatingCondition, ...]:
        """The recording's condition."""
        return (self.recording.condition,)

    @cached_property
    def measured(self) -> Signal:
        """The processed measurement."""
        return self.processing.apply(self.recording.signal(self.sensor))

    @cached_property
    def _bound(self) -> tuple[float, float]:
        """The highest similarity that mesh lines alone can reach, and their share of the energy: of no run."""
        mesh_frequency = self.recording.condition.mesh_frequency(self.driving_teeth)
        return bound_of_mesh_lines(self.measured, mesh_frequency, self.processing.band)

    def virtual(self, run: Run) -> Signal:
        """The processed signal of a run."""
        rate = self.recording.signal(self.sensor).rate
        return self.processing.apply(run.signal(self.sensor, rate, self.processing.needed + 2.0 / rate))

    def similarity(self, run: Run) -> Similarity:
        """The similarity with lag, speed match and upper bound."""
        return similarity(
            self.measured,
            self.virtual(run),
            mesh_frequency=self.recording.condition.mesh_frequency(self.driving_teeth),
            virtual_mesh_frequency=run.mesh_frequency,
            band=self.processing.band,
            rule=self.rule,
            lag=self.lag,
            bound=self._bound,
        )

    def value(self, runs: Sequence[Run]) -> float:
        """Cosine similarity; NaN where the run failed."""
        return float("nan") if runs[0].failed else self.similarity(runs[0]).value

    def aligned(self, run: Run) -> tuple[Signal, Signal]:
        """Measured signal and the run's, shifted by the lag and scaled to the same size, for a figure."""
        from gearbox.signals.signal import value_at

        score, virtual = self.similarity(run), self.virtual(run)
        times = np.clip(np.arange(len(virtual)) / virtual.rate + score.lag, 0.0, (len(virtual) - 1) / virtual.rate)
        values = value_at(virtual, times)
        return self.measured, virtual.with_values(values * (self.measured.rms / np.sqrt(np.mean(values**2))))

    def at(self, recording: Recording) -> SimilarityObjective:
        """The same for another recording, whose lag is found anew."""
        rule: LagRule = "best" if self.rule == "held" else self.rule
        return replace(self, recording=recording, rule=rule, lag=None)


@dataclass(frozen=True, eq=False, kw_only=True)
class DifferenceObjective(SimilarityObjective):
    """The difference of signals in their own unit (Eq. 7), as the share of the measured signal that it explains.

    It is 1 − ‖X_e − X_g‖²/‖X_e‖², with the lag of the highest cosine.  A wrong size of the signal counts, which the
    cosine similarity does not see; of signals scaled to one size both have the same optimum.
    """

    name: str = "share explained in m/s²"

    def value(self, runs: Sequence[Run]) -> float:
        """Share explained, at most 1; NaN where the run failed."""
        if runs[0].failed:
            return float("nan")
        size = self._size_of(runs[0]) / self._measured_size
        return 2.0 * size * self.similarity(runs[0]).value - size**2

    @cached_property
    def _own_unit(self) -> SimilarityObjective:
        return SimilarityObjective(
            recording=self.recording,
            sensor=self.sensor,
            processing=replace(self.processing, scaled=False),
            driving_teeth=self.driving_teeth,
        )

    @cached_property
    def _measured_size(self) -> float:
        return self._own_unit.measured.rms

    def _size_of(self, run: Run) -> float:
        return self._own_unit.virtual(run).rms


@dataclass(frozen=True, eq=False)
class MeasuredLines:
    """Complex amplitudes of one recording at the mesh orders.

    Parameters
    ----------
    condition : OperatingCondition
    amplitudes : mapping of str to ndarray of complex, shape (m,)
        By sensor, peak value and phase at the first sample, averaged over pieces of the recording.
    errors : mapping of str to ndarray, shape (m,)
        Standard error of each, real and imaginary part alike.
    """

    condition: OperatingCondition
    amplitudes: Mapping[str, Complex]
    errors: Mapping[str, NDArray[np.float64]]

    @classmethod
    def of(
        cls, recording: Recording, sensors: Sequence[str], orders: Sequence[int], teeth: int, pieces: int = 8
    ) -> MeasuredLines:
        """Measure the lines of a recording in pieces, turned to the phase of the first piece's strongest line."""
        mesh = recording.condition.mesh_frequency(teeth)
        k = np.asarray(orders)
        amplitudes, errors = {}, {}
        for sensor in sensors:
            signal = recording.signal(sensor)
            if k.max() * mesh >= signal.nyquist:
                raise SignalError(
                    f"mesh order {k.max()} of '{recording.name}' is {k.max() * mesh:.5g} Hz; sensor '{sensor}' is "
                    f"sampled at {signal.rate:g} Hz: leave that order out"
                )
            # Whole mesh periods, so that the lines do not leak into each other.
            length = int(np.floor(len(signal) / pieces * mesh / signal.rate)) / mesh
            if length < 10.0 / mesh:
                raise SignalError(f"recording '{recording.name}' is too short for {pieces} pieces of 10 mesh periods")
            parts = []
            for i in range(pieces):
                begin = i * length
                fit = fit_lines(signal.cut(begin, length), mesh * k)
                first = round(begin * signal.rate) / signal.rate
                parts.append(fit.amplitudes * np.exp(-2j * np.pi * mesh * k * first))
            table = np.array(parts)
            strong = int(np.abs(table).sum(axis=0).argmax())
            # Slow wander of the speed turns all orders together: it is no error of the amplitudes.
            wander = np.angle(table[:, strong] / table[0, strong]) / k[strong]
            table = table * np.exp(-1j * np.outer(wander, k))
            amplitudes[sensor] = table.mean(axis=0)
            spread = table.real.var(axis=0, ddof=1) + table.imag.var(axis=0, ddof=1)
            errors[sensor] = np.sqrt(0.5 * spread / pieces)
        return cls(recording.condition, amplitudes, errors)


@dataclass(frozen=True, eq=False, kw_only=True)
class AmplitudeObjective:
    """Amplitudes and phases at the mesh orders, over several recordings and sensors.

    The misfit is Σ |A_measured − g_s e^{2πi k f τ_r} A_model|² / s², where the lag τ_r of each recording and (if
    ``free_gain``) the gain g_s of each sensor are fitted, and s is the size of the sensor's measured lines over all
    recordings: a sensor counts by how well it is matched, not by how loud it is.  The value is the share explained,
    1 − misfit / Σ |A_measured|² / s².

    Parameters
    ----------
    measured : sequence of MeasuredLines
    orders : sequence of int
        Mesh orders, in the order of the measured amplitudes.
    driving_teeth : int
    free_gain : bool
        Whether each sensor has an unknown gain, common to all recordings.
    """

    measured: Sequence[MeasuredLines]
    orders: Sequence[int]
    driving_teeth: int
    free_gain: bool = False
    name: str = "amplitudes and phases"

    @property
    def conditions(self) -> tuple[OperatingCondition, ...]:
        """Condition of each recording."""
        return tuple(lines.condition for lines in self.measured)

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors compared."""
        return tuple(self.measured[0].amplitudes)

    def target(self) -> Complex:
        """Measured lines, each sensor divided by its size, shape (recordings, sensors, orders)."""
        table = np.array([[lines.amplitudes[s] for s in self.sensors] for lines in self.measured])
        return np.asarray(table / self.sizes()[None, :, None])

    def sizes(self) -> NDArray[np.float64]:
        """Root mean square of each sensor's measured lines over all recordings, shape (sensors,)."""
        table = np.array([[lines.amplitudes[s] for s in self.sensors] for lines in self.measured])
        return np.asarray(np.sqrt((np.abs(table) ** 2).mean(axis=(0, 2))))

    def of_runs(self, runs: Sequence[Run]) -> Complex:
        """The runs' lines, scaled as the target, shape (recordings, sensors, orders)."""
        k = np.asarray(self.orders)
        table = []
        for run in runs:
            row = []
            for s in self.sensors:
                lines = run.amplitudes.get(s)
                if lines is None:
                    raise SignalError(f"the model has no sensor '{s}'; it has {', '.join(run.amplitudes) or 'none'}")
                row.append(np.array([lines[i - 1] if i <= lines.size else 0.0 for i in k]))
            table.append(row)
        return np.asarray(np.array(table) / self.sizes()[None, :, None])

    def align(self, model: Complex) -> tuple[Complex, NDArray[np.float64], NDArray[np.float64]]:
        """Fit lags and gains; return the aligned model, the lags as turns of the mesh, and the gains."""
        target, k = self.target(), np.asarray(self.orders)
        gains = np.ones(model.shape[1])
        turns = np.zeros(model.shape[0])
        for _ in range(8 if self.free_gain else 1):
            product = (np.conj(model) * target * gains[None, :, None]).sum(axis=1)
            turns = np.array([_best_turn(row, k) for row in product])
            turned = model * np.exp(2j * np.pi * np.multiply.outer(turns, k))[:, None, :]
            if not self.free_gain:
                break
            power = (np.abs(turned) ** 2).sum(axis=(0, 2))
            gains = (np.conj(turned) * target).real.sum(axis=(0, 2)) / np.where(power > 0.0, power, 1.0)
            gains = np.maximum(gains, 1e-9)  # a sensor mounted the other way round is a fault of its sign, not a gain
        return np.asarray(turned * gains[None, :, None]), turns, gains

    def misfit(self, model: Complex) -> float:
        """Share of the measured lines that the model leaves unexplained."""
        target = self.target()
        aligned, _, _ = self.align(model)
        return float((np.abs(target - aligned) ** 2).sum() / (np.abs(target) ** 2).sum())

    def value(self, runs: Sequence[Run]) -> float:
        """Share of the measured lines explained; NaN where a run failed."""
        if any(run.failed for run in runs):
            return float("nan")
        return 1.0 - self.misfit(self.of_runs(runs))

    def restricted(
        self, recordings: Sequence[int], sensors: Sequence[str], orders: Sequence[int], free_gain: bool
    ) -> AmplitudeObjective:
        """The same for fewer recordings, sensors and orders."""
        columns = [list(self.orders).index(k) for k in orders]
        kept = [
            MeasuredLines(
                self.measured[r].condition,
                {s: self.measured[r].amplitudes[s][columns] for s in sensors},
                {s: self.measured[r].errors[s][columns] for s in sensors},
            )
            for r in recordings
        ]
        return AmplitudeObjective(
            measured=kept, orders=tuple(orders), driving_teeth=self.driving_teeth, free_gain=free_gain, name=self.name
        )


def _best_turn(product: Complex, orders: NDArray[np.int_]) -> float:
    """Turn φ of the mesh that maximises Re Σ_k p_k e^{−2πi k φ}: a grid, then Newton's method."""
    grid = np.arange(16 * int(orders.max())) / (16 * int(orders.max()))
    heights = (np.exp(-2j * np.pi * np.multiply.outer(grid, orders)) @ product).real
    phi = float(grid[int(heights.argmax())])
    for _ in range(6):
        terms = product * np.exp(-2j * np.pi * orders * phi)
        slope = float((2.0 * np.pi * orders * terms.imag).sum())
        bend = -float(((2.0 * np.pi * orders) ** 2 * terms.real).sum())
        if not bend < 0.0:
            break
        phi -= slope / bend
    return phi
