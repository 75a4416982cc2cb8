"""A Kalman filter beside a running machine: one sample or one block at a time.

A filter that is fed sample by sample gives what `extended_kalman_filter` or `unscented_kalman_filter` gives for the
whole record, also when it was saved and resumed in between, and when readings came late.  Without readings a step of
the extended filter is a simulation by Runge and Kutta's method of order 4, one of the unscented the mean of several.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.extended_kalman import Discretisation, ExtendedFilter, Keep
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.online_state import OnlineState
from estimation.filters.run import FilterRun
from estimation.filters.samples import FilterSamples
from estimation.filters.unscented_kalman import UnscentedFilter

__all__ = ["OnlineFilter"]

Method = Literal["extended", "unscented"]


@dataclass(frozen=True, eq=False)
class _Block:
    """Samples of one step, with the state before them."""

    before: OnlineState
    samples: FilterSamples


class OnlineFilter:
    """A filter that runs beside the machine.

    Parameters
    ----------
    model : FilterModel
    noise : Noise
    prior : Prior, optional
        Default: the machine's start values, known exactly.
    horizon : float, s
        How late a reading may come: samples of so much time are kept, and filtered again when one comes.
    resume : OnlineState, optional
        Continue a filter that was saved; ``prior`` is not used then.
    method : {"extended", "unscented"}
    hold, substeps
        As for both filters.
    discretisation, square_root, once, gate
        As for `extended_kalman_filter`; the unscented filter has none of them.
    alpha, beta, kappa : float
        As for `unscented_kalman_filter`.

    Raises
    ------
    FilterError
        If a setting is not possible or belongs to the other filter, or a state to resume belongs to another filter.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0))
    >>> spring = model.add("spring", Spring(stiffness=100.0))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> twin = OnlineFilter(
    ...     FilterModel(model.build(), ["body.position"]),
    ...     Noise({"body.velocity": 1e-3}, {"body.position": 1e-6}),
    ...     Prior({"body.position": 0.01}, {"body.position": 1e-3}),
    ... )
    >>> twin.step(0.0, y=0.0102).states.shape
    (1, 2)
    >>> _ = twin.step([0.01, 0.02], y=[[0.0101], [float("nan")]])
    >>> twin.time, twin.taken
    (0.02, 3)
    """

    def __init__(
        self,
        model: FilterModel,
        noise: Noise,
        prior: Prior | None = None,
        *,
        horizon: float = 0.0,
        resume: OnlineState | None = None,
        method: Method = "extended",
        discretisation: Discretisation = "exponential",
        square_root: bool = False,
        once: bool = False,
        hold: bool = False,
        substeps: int = 1,
        gate: float | None = None,
        alpha: float = 1.0,
        beta: float = 0.0,
        kappa: float = 0.0,
    ):
        if not 0.0 <= horizon < np.inf:
            raise FilterError("filter", [f"horizon is {horizon} s: give zero or more"])
        own_of_extended = {
            "discretisation": (discretisation, "exponential"),
            "square_root": (square_root, False),
            "once": (once, False),
            "gate": (gate, None),
        }
        own_of_unscented = {"alpha": (alpha, 1.0), "beta": (beta, 0.0), "kappa": (kappa, 0.0)}
        if method not in ("extended", "unscented"):
            raise FilterError("filter", [f"method is '{method}': take one of extended, unscented"])
        foreign = own_of_unscented if method == "extended" else own_of_extended
        if given := [name for name, (value, default) in foreign.items() if value != default]:
            raise FilterError("filter", [f"the {method} filter has no {name}: leave it out" for name in given])
        self._filter: ExtendedFilter | UnscentedFilter
        if method == "unscented":
            self._filter = UnscentedFilter(
                model, noise, alpha=alpha, beta=beta, kappa=kappa, hold=hold, substeps=substeps
            )
        else:
            self._filter = ExtendedFilter(
                model,
                noise,
                discretisation=discretisation,
                square_root=square_root,
                once=once,
                hold=hold,
                substeps=substeps,
                gate=gate,
            )
        self.model, self.horizon = model, horizon
        self._fingerprint = _fingerprint(self._filter)
        self._blocks: deque[_Block] = deque()
        if resume is not None:
            if resume.fingerprint != self._fingerprint:
                raise FilterError(
                    f"filter of '{model.system.name}'",
                    [
                        "the saved state belongs to another model, other parameters, noise or settings: start anew, or "
                        "set the filter up as it was"
                    ],
                )
            self._set(resume)
        else:
            x, p = (prior or Prior()).of(model)
            self._x, self._p = x, self._filter.carried(p)
            self._time, self._taken = -np.inf, 0
            self._inputs = np.full(len(model.system.inputs), np.nan)
            self._likelihood, self._late, self._refused = 0.0, 0, 0

    # ---------------------------------------------------------------- where it stands

    @property
    def time(self) -> float:
        """Time of the last sample, s; minus infinity before the first."""
        return self._time

    @property
    def taken(self) -> int:
        """Samples filtered so far."""
        return self._taken

    @property
    def late(self) -> int:
        """Readings that came later than the horizon and were not used."""
        return self._late

    @property
    def log_likelihood(self) -> float:
        """Of all readings so far."""
        return self._likelihood

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the state, shape (n, n)."""
        p = self._p[:, : self.model.n]
        return p @ p.T if self._filter.square_root else p.copy()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a state; of a latent parameter the value that it adds to."""
        return float(self._x[self.model.index(name)]) + self.model.nominal(name)

    def std(self, name: str) -> float:
        """Return the present standard deviation of a state."""
        k = self.model.index(name)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))

    def state(self) -> OnlineState:
        """Return everything that the next sample needs; see `OnlineState.save`.

        Samples that are kept for late readings are no part of it: after a resumption, readings from before it are late.
        """
        jacobian, balance = self._filter.memory
        return OnlineState(
            fingerprint=self._fingerprint,
            names=self.model.state_names,
            time=self._time,
            taken=self._taken,
            state=self._x.copy(),
            covariance=self._p.copy(),
            inputs=self._inputs.copy(),
            jacobian=jacobian.copy(),
            balance=balance.copy(),
            log_likelihood=self._likelihood,
            late=self._late,
            refused=self._refused,
        )

    # ---------------------------------------------------------------- samples

    def step(self, t: Any, u: Any = None, y: Any = None, *, keep: Keep = "variances") -> FilterRun:
        """Take one sample, or a block of samples, and return the run over them.

        Parameters
        ----------
        t : float or ndarray, shape (k,), s
            Later than what was taken before.
        u : float or ndarray, shape (n_u,) or (k, n_u), optional
            Inputs; None keeps the last ones.
        y : float, ndarray, shape (m,) or (k, m), or mapping of str to float, optional
            Readings, NaN where there is none: channels of other rates read at some of the instants only.  A mapping
            names the channels that were read.
        keep : {"variances", "covariances", "everything"}
            As for `extended_kalman_filter`; the unscented filter keeps no "everything".

        Raises
        ------
        FilterError
            If a sample is not later than the last one (see `late_reading`), or its size does not fit.
        FilterDivergence
            As for a whole record; the filter keeps the state from before.
        """
        samples = self._samples(t, u, y)
        before = self.state()
        run = self._take(samples, keep)
        if self.horizon > 0.0:
            self._blocks.append(_Block(before, samples))
            while self._blocks[0].samples.times[-1] < self._time - self.horizon:
                self._blocks.popleft()
        return run

    def late_reading(self, t: float, y: Mapping[str, float]) -> bool:
        """Take readings that belong to an earlier time: what came since is filtered again with them in their place.

        Parameters
        ----------
        t : float, s
            To which the readings belong: their stamp less the delay of their sensor.
        y : mapping of str to float
            By channel.  Inputs at that time are interpolated (held where the filter holds them).

        Returns
        -------
        bool
            False if the readings are older than the horizon; they are counted in `late` and not used.

        Raises
        ------
        FilterError
            If a channel is not known, or the time is not before the last sample.
        """
        readings = self._readings(y, 1)[0]
        if not t < self._time:
            raise FilterError("late reading", [f"{t:.6g} s is not before {self._time:.6g} s: give it to `step`"])
        if not self._blocks or t <= self._blocks[0].before.time or t < self._time - self.horizon:
            self._late += 1
            return False
        at = next(k for k, block in enumerate(self._blocks) if block.samples.times[-1] >= t)
        redone = [self._blocks[k] for k in range(at, len(self._blocks))]
        changed = _with_reading(redone[0], t, readings, self._filter.hold)
        start, now = replace(redone[0].before, late=self._late), self.state()
        for _ in redone:
            self._blocks.pop()
        self._set(start)
        try:
            for samples in (changed, *(block.samples for block in redone[1:])):
                before = self.state()
                self._take(samples, "variances")
                self._blocks.append(_Block(before, samples))
        except BaseException:
            self._set(now)
            raise
        return True

    # ---------------------------------------------------------------- inside

    def _samples(self, t: Any, u: Any, y: Any) -> FilterSamples:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        count, width = times.size, len(self.model.system.inputs)
        faults = []
        if u is None:
            inputs = np.tile(self._inputs, (count, 1))
            if width and not np.isfinite(self._inputs).all():
                faults.append(f"the first sample needs its inputs {', '.join(self.model.system.input_names)}")
        else:
            inputs = np.asarray(u, dtype=float)
            if inputs.size != count * width:
                faults.append(f"u has {inputs.size} numbers, there are {count} samples of {width} inputs")
            else:
                inputs = inputs.reshape(count, width)
        if count and not times[0] > self._time:
            faults.append(
                f"{times[0]:.6g} s is not later than the last sample, {self._time:.6g} s: sort the samples, or give "
                "readings that come late to `late_reading`"
            )
        if faults:
            raise FilterError(f"samples for the filter of '{self.model.system.name}'", faults)
        return FilterSamples(times, inputs, self._readings(y, count))

    def _readings(self, y: Any, count: int) -> np.ndarray:
        measured = self.model.measured
        if y is None:
            return np.full((count, len(measured)), np.nan)
        if isinstance(y, Mapping):
            from multibody.base.spelling import nearest

            if faults := [f"'{n}' is not measured{nearest(n, measured)}" for n in y if n not in measured]:
                raise FilterError("readings", faults)
            y = [[y.get(n, np.nan) for n in measured]] * count
        readings = np.asarray(y, dtype=float)
        if readings.size != count * len(measured):
            raise FilterError(
                "readings",
                [f"there are {readings.size} numbers for {count} samples of {len(measured)}: {', '.join(measured)}"],
            )
        return readings.reshape(count, len(measured))

    def _take(self, samples: FilterSamples, keep: Keep) -> FilterRun:
        """Filter samples; where that fails the state stays as it was."""
        before = self.state()
        carried = samples
        if self._taken:
            nothing = np.full((1, len(self.model.measured)), np.nan)
            carried = FilterSamples(
                np.append(self._time, samples.times),
                np.concatenate([self._inputs[None], samples.inputs]),
                np.concatenate([nothing, samples.readings]),
            )
        try:
            run = self._filter(carried, self._x, self._p, taken=self._taken, keep=keep)
        except BaseException:
            self._set(before)
            raise
        if self._taken:
            run = _without_first(run, samples)
        self._time, self._inputs = float(samples.times[-1]), samples.inputs[-1].copy()
        self._taken += samples.count
        self._likelihood += run.log_likelihood
        self._refused += run.refused
        return run

    def _set(self, state: OnlineState) -> None:
        self._x, self._p = state.state.copy(), state.covariance.copy()
        self._time, self._taken, self._inputs = state.time, int(state.taken), state.inputs.copy()
        self._likelihood = state.log_likelihood
        self._late, self._refused = int(state.late), int(state.refused)
        jacobian, balance = self._filter.memory
        jacobian[:], balance[:] = state.jacobian, state.balance


def _without_first(run: FilterRun, samples: FilterSamples) -> FilterRun:
    """Return a run without its first row, which belongs to the call before."""
    rows = ("states", "variances", "predicted", "innovations", "innovation_variances", "normalised")
    parts: dict[str, Any] = {name: getattr(run, name)[1:] for name in rows}
    covariances = run.covariances[1:] if run.covariances is not None else None
    kept = {name: values[1:] for name, values in run.kept.items()}
    return replace(run, samples=samples, covariances=covariances, kept=kept, **parts)


def _with_reading(block: _Block, t: float, readings: np.ndarray, hold: bool) -> FilterSamples:
    """Return a block's samples with readings at one more instant, or put beside those of the same instant."""
    times, inputs, given = block.samples.times, block.samples.inputs, block.samples.readings.copy()
    at = int(np.searchsorted(times, t))
    if at < times.size and times[at] == t:
        given[at] = np.where(np.isfinite(readings), readings, given[at])
        return FilterSamples(times, inputs, given)
    first = block.before.taken == 0
    known = times if first else np.append(block.before.time, times)
    rows = inputs if first else np.concatenate([block.before.inputs[None], inputs])
    k = int(np.searchsorted(known, t))
    share = 0.0 if hold else (t - known[k - 1]) / (known[k] - known[k - 1])
    between = rows[k - 1] + share * (rows[k] - rows[k - 1])
    return FilterSamples(
        np.insert(times, at, t), np.insert(inputs, at, between, axis=0), np.insert(given, at, readings, axis=0)
    )


def _fingerprint(compiled: ExtendedFilter | UnscentedFilter) -> str:
    """Return a digest of everything that decides what the filter computes from a state."""
    model = compiled.model
    digest = hashlib.sha256()
    texts = (*sorted(model.system.texts.items()), *model.state_names, *model.measured, model.jacobian)
    digest.update(repr((texts, compiled.settings, compiled.gate, model.readouts)).encode())
    for array in (model.p, model.steps, model.bounds, model.drift, compiled.q, compiled.r):
        digest.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return digest.hexdigest()
