"""Inputs of a model over time: a table with one column per input."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from multibody.inputs.breaks import breaks, rough

__all__ = ["InputError", "InputTable", "TableArrays"]

INTERPOLATIONS = ("hold", "linear", "cubic")


class TableArrays(dict[str, np.ndarray]):
    """The arrays of a table by name; compared by identity, so that a driver can remember what it made of them."""

    __hash__ = object.__hash__  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return self is other


class InputError(ValueError):
    """A table of inputs cannot be used; the message names every input at fault."""


def _parabola_slopes(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Slopes at the samples of the parabola through each sample and its neighbours."""
    if len(times) == 1:
        return np.zeros_like(values)
    width = np.diff(times)[:, None]
    rise = np.diff(values, axis=0) / width
    if len(times) == 2:
        return np.vstack([rise, rise])
    slopes = np.empty_like(values)
    slopes[1:-1] = (width[1:] * rise[:-1] + width[:-1] * rise[1:]) / (width[1:] + width[:-1])
    slopes[0] = 2.0 * rise[0] - slopes[1]
    slopes[-1] = 2.0 * rise[-1] - slopes[-2]
    return slopes


def _held_rates(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rates at which held inputs change, one for each interval between samples.

    What a delay changes in a held input is an impulse at each jump.  Half of it is spread over the interval before the
    jump and half over that after it, so that its size and its centre are right: the derivative by a delay is right for
    machines that are slow compared with the sampling.
    """
    rates = np.zeros_like(values)
    if len(times) > 1:
        width = np.diff(times)[:, None]
        jump = np.diff(values, axis=0)  # at the sample that ends each interval
        rates[:-1] = 0.5 * jump / width
        rates[1:-1] += 0.5 * jump[:-1] / width[1:]
        rates[-2] += 0.5 * jump[-1] / width[-1]  # beyond the last sample nothing takes its half
    return rates


@dataclass(frozen=True, eq=False, kw_only=True)
class InputTable:
    """Inputs sampled at common times, interpolated column by column, constant beyond both ends.

    Parameters
    ----------
    times : ndarray, shape (nt,), s
        Increasing.  One time makes every input a constant.
    values : ndarray, shape (nt, n_u)
        One column per input, SI.
    names : sequence of str, optional
        Names of the inputs, for messages.
    interpolation : str or sequence of str
        ``"hold"`` (the value holds until the next sample), ``"linear"``, or ``"cubic"`` (piecewise cubic with
        continuous derivative, whose slope at a sample is that of the parabola through it and its neighbours).
    delay_parameter : sequence of int, optional
        For each column the index in the parameter vector of a delay τ in s, or -1: the column is looked up at
        t − τ.

    Raises
    ------
    InputError
        If times do not increase, a value is not finite, or lengths differ; all faults at once.

    Examples
    --------
    >>> table = InputTable.from_columns([0.0, 1.0], {"force": [0.0, 10.0], "gain": 2.0})
    >>> table(0.25)
    array([2.5, 2. ])
    """

    times: np.ndarray
    values: np.ndarray
    names: Sequence[str] = ()
    interpolation: str | Sequence[str] = "linear"
    delay_parameter: Sequence[int] | np.ndarray | None = None
    _kernel: TableArrays = field(default_factory=TableArrays, init=False, repr=False)
    _kernels: dict[float, TableArrays] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64, ndmin=1, order="C")
        values = np.array(self.values, dtype=np.float64, ndmin=2, order="C")
        count = values.shape[1] if values.ndim == 2 else 0
        names = tuple(self.names) or tuple(f"input {i}" for i in range(count))
        kinds = (self.interpolation,) * count if isinstance(self.interpolation, str) else tuple(self.interpolation)
        delays = np.full(count, -1) if self.delay_parameter is None else np.asarray(self.delay_parameter)
        _check(times, values, names, kinds, delays)
        code = np.array([INTERPOLATIONS.index(kind) for kind in kinds], dtype=np.int64).reshape(count)
        changing = np.any(values != values[0], axis=0) if count else np.zeros(0, dtype=bool)
        slopes = np.zeros_like(values)  # of cubic columns, and rates of held ones; of linear columns they are not used
        cubic = np.flatnonzero(code == INTERPOLATIONS.index("cubic"))
        slopes[:, cubic] = _parabola_slopes(times, values[:, cubic])
        held = np.flatnonzero(code == INTERPOLATIONS.index("hold"))
        slopes[:, held] = _held_rates(times, values[:, held])
        delays = delays.astype(np.int64).reshape(count)
        # Compiled code gets these arrays, which must be writable there; the public views are not.
        self._kernel.update(
            times=times,
            values=values,
            slopes=slopes,
            kinds=code,
            delays=delays,
            held=np.flatnonzero(changing & (code == 0)).astype(np.int64),
            moving=np.flatnonzero(changing & (code != 0)).astype(np.int64),
            **breaks(times, rough(times, values, slopes, code), code, delays),
        )
        object.__setattr__(self, "times", _view(times))
        object.__setattr__(self, "values", _view(values))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "interpolation", kinds)
        object.__setattr__(self, "delay_parameter", _view(self._kernel["delays"]))

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = {"times": np.array(self.times), "values": np.array(self.values)}
        rest = {"names": self.names, "interpolation": self.interpolation}
        return partial(InputTable, **arrays, **rest, delay_parameter=np.array(self.delay_parameter)), ()

    @classmethod
    def constant(cls, values: Mapping[str, float] | Sequence[float] | np.ndarray) -> InputTable:
        """Return a table of constants, from a sequence or from a dict of name to value."""
        if isinstance(values, Mapping):
            row = np.array(list(values.values()), dtype=np.float64)
            return cls(times=np.zeros(1), values=row.reshape(1, -1), names=tuple(values))
        return cls(times=np.zeros(1), values=np.asarray(values, dtype=np.float64).reshape(1, -1))

    @classmethod
    def from_columns(
        cls,
        times: Sequence[float] | np.ndarray,
        columns: Mapping[str, Any],
        interpolation: str | Mapping[str, str] = "linear",
        delay_parameter: Mapping[str, int] | None = None,
    ) -> InputTable:
        """Return a table from named columns; a number in place of a column is a constant input.

        Parameters
        ----------
        times : array_like, shape (nt,), s
        columns : dict of str to array_like, shape (nt,), or float
        interpolation : str or dict of str to str
            Of all columns, or by name; ``"linear"`` where a name is absent.
        delay_parameter : dict of str to int, optional
            Index of the delay in the parameter vector, by name.
        """
        t = np.asarray(times, dtype=np.float64)
        named = {} if isinstance(interpolation, str) else dict(interpolation)
        default = interpolation if isinstance(interpolation, str) else "linear"
        delays = dict(delay_parameter or {})
        faults = [
            f"'{name}' is given {what} but is not an input (inputs: {', '.join(columns) or 'none'})"
            for what, given in (("an interpolation", named), ("a delay", delays))
            for name in given
            if name not in columns
        ]
        values = np.empty((t.size, len(columns)))
        for i, (name, column) in enumerate(columns.items()):
            data = np.asarray(column, dtype=np.float64)
            if data.shape not in ((), (t.size,)):
                faults.append(f"input '{name}' has {data.size} values, but there are {t.size} times")
            else:
                values[:, i] = data
        if faults:
            raise InputError("; ".join(faults))
        return cls(
            times=t,
            values=values,
            names=tuple(columns),
            interpolation=tuple(named.get(name, default) for name in columns),
            delay_parameter=[delays.get(name, -1) for name in columns],
        )

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return self.values.shape[1]

    @property
    def kernel(self) -> TableArrays:
        """The arrays that compiled drivers read, and where steps must end (see `breaks`)."""
        return self._kernel

    def kernel_for(self, tolerance: float) -> TableArrays:
        """Return `kernel` with only those ends of steps that a relative tolerance of the inputs requires."""
        arrays = self._kernels.get(tolerance)
        if arrays is None:
            own = self._kernel
            times, values, kinds, delays = (own[key] for key in ("times", "values", "kinds", "delays"))
            marks = rough(times, values, own["slopes"], kinds, tolerance)
            arrays = TableArrays({**own, **breaks(times, marks, kinds, delays)})
            self._kernels[tolerance] = arrays
        return arrays

    def __call__(self, t: Any, p: np.ndarray | None = None) -> np.ndarray:
        """Return the inputs at time(s) t, shape (n_u,) or (len(t), n_u); delays need p."""
        return self._interpolate(t, p, 0)

    def derivative(self, t: Any, p: np.ndarray | None = None) -> np.ndarray:
        """Return the time derivative of the inputs at t, zero beyond the ends.

        That of a held input is each jump spread over the two intervals beside it.
        """
        return self._interpolate(t, p, 1)

    def _interpolate(self, t: Any, p: np.ndarray | None, order: int) -> np.ndarray:
        at = np.atleast_1d(np.asarray(t, dtype=np.float64))
        times, values, slopes = (self._kernel[key] for key in ("times", "values", "slopes"))
        out = np.zeros((at.size, self.n_inputs)) if order else np.tile(values[0], (at.size, 1))
        for c in (*self._kernel["held"], *self._kernel["moving"]):
            s, delay = at, int(self._kernel["delays"][c])
            if delay >= 0:
                if p is None:
                    raise InputError(f"input '{self.names[c]}' is delayed by a parameter: give p")
                s = at - p[delay]
            kind = self.interpolation[c]
            i = np.clip(np.searchsorted(times, s, side="right") - 1, 0, len(times) - 2)
            width = times[i + 1] - times[i]
            z = np.clip((s - times[i]) / width, 0.0, 1.0)
            low, rise = values[i, c], values[i + 1, c] - values[i, c]
            a, b = width * slopes[i, c] - rise, rise - width * slopes[i + 1, c]
            inside = (s > times[0]) & (s < times[-1])
            if kind == "hold":
                rate = inside * slopes[i, c]
                out[:, c] = rate if order else np.where(s >= times[-1], values[-1, c], low)
            elif order and kind == "linear":
                out[:, c] = inside * rise / width
            elif order:
                inner = rise + (1 - 2 * z) * ((1 - z) * a + z * b) + z * (1 - z) * (b - a)
                out[:, c] = inside * inner / width
            else:
                bend = 0.0 if kind == "linear" else (1.0 - z) * ((1.0 - z) * a + z * b)
                out[:, c] = low + z * (rise + bend)
        return out if np.ndim(t) else out[0]

    def jumps(self, p: np.ndarray) -> np.ndarray:
        """Return the times, s, at which a held input jumps, in no order; delays come from p."""
        start, delay = self._kernel["break_start"], self._kernel["break_delay"]
        late = np.repeat([p[d] if d >= 0 else 0.0 for d in delay], np.diff(start))
        return (self._kernel["breaks"] + late)[self._kernel["jumps"] != 0]

    def largest_step(self) -> float:
        """Return the largest integrator step, in s, that jumps over no sample; infinite for constant inputs.

        For SciPy's methods.  The methods of this package end their steps at every sample where an input or one of
        its first two derivatives jumps, which limits the step only there.
        """
        if len(self.times) < 2:
            return math.inf
        changed = np.any(np.diff(self.values, axis=0) != 0.0, axis=1)
        near = changed | np.append(changed[1:], False) | np.append(False, changed[:-1])
        return float(np.diff(self.times)[near].min()) if near.any() else math.inf


def _view(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view


def _check(
    times: np.ndarray, values: np.ndarray, names: tuple[str, ...], kinds: tuple[str, ...], delays: np.ndarray
) -> None:
    faults = []
    if times.ndim != 1 or times.size == 0:
        raise InputError(f"times must be a non-empty vector, not an array of shape {times.shape}")
    if values.ndim != 2 or values.shape[0] != times.size:
        raise InputError(f"there are {times.size} times, but values has the shape {values.shape}")
    count = values.shape[1]
    for what, given in (
        ("names", len(names)),
        ("interpolations", len(kinds)),
        ("delay parameters", delays.size),
    ):
        if given != count:
            faults.append(f"there are {count} inputs but {given} {what}")
    if not np.all(np.isfinite(times)):
        faults.append(f"time {int(np.flatnonzero(~np.isfinite(times))[0])} is not finite")
    elif np.any(np.diff(times) <= 0.0):
        row = int(np.flatnonzero(np.diff(times) <= 0.0)[0])
        faults.append(f"times do not increase: {times[row + 1]:g} s follows {times[row]:g} s at row {row + 1}")
    if not faults or len(names) == count:
        for c in range(count):
            bad = np.flatnonzero(~np.isfinite(values[:, c]))
            if bad.size:
                faults.append(f"input '{names[c]}' is not finite in {bad.size} rows, first row {int(bad[0])}")
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            faults.append(f"input names appear twice: {', '.join(twice)}")
    for name, kind in zip(names, kinds, strict=False):
        if kind not in INTERPOLATIONS:
            faults.append(f"input '{name}': interpolation '{kind}' is unknown, take one of {', '.join(INTERPOLATIONS)}")
    if faults:
        raise InputError("; ".join(faults))
