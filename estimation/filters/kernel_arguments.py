"""Arguments of the compiled filters, the check that samples fit a model, and the error of a run that diverged."""

from __future__ import annotations

import numpy as np

from estimation.filters.errors import FilterDivergence, FilterError
from estimation.filters.kernels import layout as at
from estimation.filters.model import FilterModel
from estimation.filters.samples import FilterSamples

__all__ = ["KernelArguments", "check_shapes", "diverged", "padded"]


class KernelArguments:
    """Numbers and addresses of a model for one run of a compiled filter, with the arrays that they point into."""

    def __init__(self, model: FilterModel):
        from multibody.compile.vector_mode import along_directions
        from multibody.system.narrow_features import step_limits

        system, n = model.system, model.n
        exact = model.jacobian == "exact"
        kinds = np.array([kind for kind, _ in model.channels], dtype=np.int64)
        generic = bool(np.any(kinds == 2))
        n_y = len(system.outputs)
        column = max(n, n_y)
        reads = model.readouts
        arrays = {
            at.P_0: model.p,
            at.P: model.p.copy(),
            at.U: np.zeros(len(system.inputs)),
            at.DRIFT: np.ascontiguousarray(model.drift),
            at.READ_STATE: np.array([r[0] for r in reads], dtype=np.int64),
            at.READ_KIND: np.array([r[1] for r in reads], dtype=np.int64),
            at.READ_INDEX: np.array([r[2] for r in reads], dtype=np.int64),
            at.READ_WEIGHT: np.array([r[3] for r in reads], dtype=float),
            at.CHANNEL_KIND: kinds,
            at.CHANNEL_INDEX: np.array([index for _, index in model.channels], dtype=np.int64),
            at.X_DOT: np.zeros(len(system.states)),
            at.U_DOT: np.zeros(len(system.inputs)),
            at.P_DOT: np.zeros(len(model.p)),
            at.Y: np.zeros(column),
            at.STEPS: model.steps,
            at.A: np.zeros(column),
            at.B: np.zeros(column),
            at.BALANCE: np.ones(n),
            at.LOW: model.bounds[:, 0].copy(),
            at.HIGH: model.bounds[:, 1].copy(),
        }
        functions = {at.RHS: system.rhs_function}
        limits = step_limits(system, model.p)
        arrays[at.LARGEST] = np.array([limits.largest_step])
        if limits.widths:
            functions[at.SPEEDS] = system.speeds_function
            arrays[at.WIDTHS] = np.array([limits.widths.get(n, np.inf) for n in system.speed_names])
            arrays[at.PACES] = np.zeros(len(system.speed_names))
        if generic:
            functions[at.OUT] = system.outputs_function
        if exact:
            tangents = [(at.RHS_W, at.RHS_T, system.rhs_tangent)]
            if generic:
                tangents.append((at.OUT_W, at.OUT_T, system.outputs_tangent))
            for in_lanes, single, tangent in tangents:  # one of the two is compiled
                wide = along_directions(tangent, model.ld)
                functions[single if wide is None else in_lanes] = tangent if wide is None else wide
            arrays |= dict(zip((at.X_WIDE, at.U_WIDE, at.P_WIDE), model.directions, strict=True))
        numbers = np.zeros(at.SIZE, dtype=np.int64)
        for index, function in functions.items():
            numbers[index] = function.address
        for index, array in arrays.items():
            numbers[index] = array.__array_interface__["data"][0]
        numbers[at.N], numbers[at.ALL], numbers[at.LD] = len(system.states), n, model.ld
        numbers[at.N_U], numbers[at.N_P], numbers[at.N_Y] = len(system.inputs), len(model.p), n_y
        numbers[at.N_SPEEDS] = len(system.speed_names) if limits.widths else 0
        numbers[at.M], numbers[at.N_READ] = len(model.measured), len(reads)
        numbers[at.EXACT], numbers[at.GENERIC] = int(exact), int(generic)
        self.numbers = numbers
        self._functions = tuple(functions.values())
        self._arrays = arrays

    @property
    def balance(self) -> np.ndarray:
        """Sizes that balance the Jacobian, shape (n,): they are updated from time to time, and kept between calls."""
        return self._arrays[at.BALANCE]

    def raise_python_error(self) -> None:
        """Raise the error of a plain Python function that compiled code called."""
        for function in self._functions:
            function.check()


def check_shapes(model: FilterModel, samples: FilterSamples) -> None:
    """Refuse samples that do not fit a model."""
    faults = []
    if samples.inputs.shape[1] != len(model.system.inputs):
        faults.append(
            f"there are {samples.inputs.shape[1]} columns of inputs, '{model.system.name}' has "
            f"{len(model.system.inputs)}: {', '.join(model.system.input_names) or 'none'}"
        )
    if samples.readings.shape[1] != len(model.measured):
        faults.append(
            f"there are {samples.readings.shape[1]} columns of readings, measured are {', '.join(model.measured)}"
        )
    if faults:
        raise FilterError(f"samples for the filter of '{model.system.name}'", faults)


def padded(matrix: np.ndarray, ld: int) -> np.ndarray:
    """Return a matrix with its rows padded with zeros to a length."""
    out = np.zeros((len(matrix), ld))
    out[:, : matrix.shape[1]] = matrix
    return out


def diverged(model: FilterModel, samples: FilterSamples, states: np.ndarray) -> FilterDivergence:
    """Return the error for a run that ended with numbers that are not finite."""
    k = len(states) - 1
    names = model.state_names
    lost = [name for j, name in enumerate(names) if not np.isfinite(states[k, :, j]).all()]
    before = states[max(k - 1, 0), 1]
    growth = np.abs(np.nan_to_num(before, nan=np.inf, posinf=np.inf)) / (1.0 + np.abs(states[0, 0]))
    grown = int(np.argmax(growth))
    return FilterDivergence(
        f"the filter of '{model.system.name}' diverged at {samples.times[k]:.6g} s (row {k}): no finite value for "
        f"{', '.join(lost[:4])}{' and others' if len(lost) > 4 else ''}; the row before, '{names[grown]}' had "
        f"grown most, to {before[grown]:.4g}. Check units and signs of inputs and readings, start nearer "
        "(prior), take more substeps, or lower the process noise of that state"
    )
