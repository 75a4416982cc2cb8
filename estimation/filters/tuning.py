"""Tuning Q and R from the records themselves: by marginal likelihood, or by expectation and maximisation.

R. H. Shumway, D. S. Stoffer: An approach to time series smoothing and forecasting using the EM algorithm,
J. Time Series Analysis 3 (1982).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from estimation.filters.errors import FilterDivergence, FilterError
from estimation.filters.extended_kalman import extended_kalman_filter
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.run import FilterRun
from estimation.filters.samples import FilterSamples

if TYPE_CHECKING:
    import pandas

__all__ = ["Tuned", "tune"]

_DECADES = 8.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Tuned:
    """Noise that fits the records.

    Parameters
    ----------
    noise : Noise
    given : Noise
        What the tuning began with.
    names : tuple of str
        States and readings whose variance was moved.
    log_likelihoods : tuple of float
        After each step, the first before any.
    message : str
        Why it ended.
    """

    noise: Noise
    given: Noise = field(repr=False)
    names: tuple[str, ...]
    log_likelihoods: tuple[float, ...]
    message: str
    _values: tuple[tuple[float, float], ...] = field(default=(), repr=False)

    def to_frame(self) -> pandas.DataFrame:
        """Return variances before and after, by state and reading."""
        import pandas

        return pandas.DataFrame(self._values, columns=["given", "tuned"], index=pandas.Index(self.names))


def tune(
    model: FilterModel,
    samples: FilterSamples | Sequence[FilterSamples],
    noise: Noise,
    prior: Prior | None = None,
    *,
    process: Sequence[str] = (),
    measurement: Sequence[str] = (),
    method: Literal["likelihood", "em"] = "likelihood",
    steps: int = 30,
    progress: Callable[[str], Any] | None = None,
    **options: Any,
) -> Tuned:
    """Find the variances under which the records are most likely.

    Parameters
    ----------
    model, samples, noise, prior
        As for `extended`; several records count together.
    process, measurement : sequence of str
        States and readings whose variances are free; the others stay.
    method : {"likelihood", "em"}
        Maximise the filter's marginal likelihood over the logarithms of the variances (L-BFGS-B with
        differences), or repeat smoothing and re-estimating them (diagonal entries only).
    steps : int
        At most.
    progress : callable, optional
        Takes a line of text.
    options
        Further arguments of `extended_kalman_filter`.

    Raises
    ------
    FilterError
        If nothing is free, or a free variance is zero.
    """
    records = [samples] if isinstance(samples, FilterSamples) else list(samples)
    q, r = noise.of(model)
    faults = []
    if not process and not measurement:
        faults.append("nothing is free: name states in process or readings in measurement")
    for name in process:
        if name not in model.state_names:
            faults.append(f"there is no state '{name}'")
        elif q[model.index(name), model.index(name)] <= 0.0:
            faults.append(f"the process noise of '{name}' is zero: give it a value to begin with")
    faults += [f"'{name}' is not measured" for name in measurement if name not in model.measured]
    if faults:
        raise FilterError("tuning", faults)
    states = [model.index(name) for name in process]
    readings = [model.measured.index(name) for name in measurement]
    say = progress or (lambda text: None)
    work = _likelihood if method == "likelihood" else _expectation
    tuned, log_likelihoods, message = work(model, records, noise, q, r, states, readings, prior, steps, say, options)
    new_q, new_r = tuned.of(model)
    values = [(q[i, i], new_q[i, i]) for i in states] + [(r[j], new_r[j]) for j in readings]
    names = (*(f"process {n}" for n in process), *(f"measurement {n}" for n in measurement))
    return Tuned(
        noise=tuned,
        given=noise,
        names=names,
        log_likelihoods=tuple(log_likelihoods),
        message=message,
        _values=tuple((float(a), float(b)) for a, b in values),
    )


def _with(noise: Noise, q: np.ndarray, r: np.ndarray) -> Noise:
    return Noise(q.copy(), r.copy(), noise.kind)


def _moved(q: np.ndarray, r: np.ndarray, states: list[int], readings: list[int], factors: np.ndarray) -> Any:
    scale, new_r = np.ones(len(q)), r.copy()
    scale[states] = np.sqrt(factors[: len(states)])
    new_r[readings] *= factors[len(states) :]
    return q * scale[:, None] * scale[None, :], new_r


def _likelihood(
    model: FilterModel,
    records: list[FilterSamples],
    noise: Noise,
    q: np.ndarray,
    r: np.ndarray,
    states: list[int],
    readings: list[int],
    prior: Prior | None,
    steps: int,
    say: Callable[[str], Any],
    options: dict[str, Any],
) -> tuple[Noise, list[float], str]:
    from scipy.optimize import minimize

    count = sum(record.count for record in records)

    def cost(logarithms: np.ndarray) -> float:
        trial = _with(noise, *_moved(q, r, states, readings, np.exp(logarithms)))
        try:
            total = sum(
                extended_kalman_filter(model, record, trial, prior, **options).log_likelihood for record in records
            )
        except FilterDivergence:
            return 1e6
        return -total / count if np.isfinite(total) else 1e6

    start = np.zeros(len(states) + len(readings))
    log_likelihoods = [-cost(start) * count]

    def note(logarithms: np.ndarray) -> None:
        log_likelihoods.append(-cost(logarithms) * count)
        say(f"tuning, step {len(log_likelihoods) - 1}: log likelihood {log_likelihoods[-1]:.6g}")

    reach = _DECADES * np.log(10.0)
    done: Any = minimize(  # type: ignore[call-overload]
        cost,
        start,
        method="L-BFGS-B",
        bounds=[(-reach, reach)] * start.size,
        callback=note,
        options={"maxiter": steps, "eps": 1e-3},
    )
    return _with(noise, *_moved(q, r, states, readings, np.exp(done.x))), log_likelihoods, str(done.message)


def _expectation(
    model: FilterModel,
    records: list[FilterSamples],
    noise: Noise,
    q: np.ndarray,
    r: np.ndarray,
    states: list[int],
    readings: list[int],
    prior: Prior | None,
    steps: int,
    say: Callable[[str], Any],
    options: dict[str, Any],
) -> tuple[Noise, list[float], str]:
    now, log_likelihoods, message = _with(noise, q, r), [], "the number of steps is used up"
    for step in range(steps + 1):
        runs = [extended_kalman_filter(model, record, now, prior, keep="everything", **options) for record in records]
        log_likelihoods.append(sum(run.log_likelihood for run in runs))
        say(f"tuning, step {step}: log likelihood {log_likelihoods[-1]:.6g}")
        if len(log_likelihoods) > 2 and abs(log_likelihoods[-1] - log_likelihoods[-2]) < 1e-6 * max(
            abs(log_likelihoods[-1]), 1.0
        ):
            message = "the likelihood no longer grows"
            break
        if step == steps:
            break
        parts = [_moments(run) for run in runs]
        new_q = np.sum([part[0] for part in parts], axis=0) / sum(part[1] for part in parts)
        new_r = np.sum([part[2] for part in parts], axis=0) / np.sum([part[3] for part in parts], axis=0)
        if noise.kind != "per_step":
            h = float(np.mean(np.concatenate([np.diff(record.times) for record in records])))
            new_q = new_q / h
        q, r = q.copy(), r.copy()
        for i in states:
            ratio = np.sqrt(max(new_q[i, i], 1e-300) / q[i, i])
            q[i, :] *= ratio
            q[:, i] *= ratio
        for j in readings:
            r[j] = max(float(new_r[j]), 1e-300)
        now = _with(noise, q, r)
    return now, log_likelihoods, message


def _moments(run: FilterRun) -> tuple[np.ndarray, int, np.ndarray, np.ndarray]:
    """Sums of the smoothed squares of process and measurement noise, and how many there are."""
    smoothed = run.smooth()
    assert smoothed.covariances is not None
    f, x, p, c = run.kept["transitions"][1:], smoothed.states, smoothed.covariances, smoothed.gains
    rest = x[1:] - run.predicted[1:] - np.einsum("kij,kj->ki", f, x[:-1] - run.states[:-1])
    cross = p[1:] @ np.swapaxes(c, 1, 2)  # covariance of x_{k+1} and x_k
    mixed = cross @ np.swapaxes(f, 1, 2)
    spread = p[1:] - mixed - np.swapaxes(mixed, 1, 2) + f @ p[:-1] @ np.swapaxes(f, 1, 2)
    process = np.einsum("ki,kj->ij", rest, rest) + spread.sum(axis=0)
    h = run.kept["rows"]
    seen = np.isfinite(run.innovations)
    left = np.where(seen, run.innovations, 0.0) - np.einsum("kij,kj->ki", h, x - run.predicted)
    variance = np.einsum("kij,kjl,kil->ki", h, p, h)
    measurement = np.where(seen, left**2 + variance, 0.0).sum(axis=0)
    return process, len(rest), measurement, np.maximum(seen.sum(axis=0), 1)
