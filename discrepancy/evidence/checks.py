"""Predictive checks of a fitted model: are its innovations what the model and its noise promise, everywhere?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import record_columns
from estimation.fit.calibration import Fit
from estimation.response.experiment import Experiment
from estimation.signals.correlation import correlation_time
from estimation.signals.metrics import nrmse

__all__ = ["Check", "checks_by_output", "predictive_checks"]

#: Ratio of the innovations' mean square in a regime to that elsewhere, from which a check can fail: the disturbance is
#: then 1.4 times as large there as elsewhere.  Smaller ratios are significant in any long record and change
#: no conclusion.
REGIME_RATIO = 2.0
#: Standard deviations by which the logarithm of that ratio must differ from zero: some dozens of regimes are asked.
REGIME_DEVIATIONS = 4.0
#: Correlation of innovations one sample apart, from which something is left that the noise model cannot follow, if its
#: slow part is larger than the stated noise of a sample: less than that changes no prediction that one can see.  A
#: negative one shows no missing force: noise that a sampled controller feeds back one sample later makes it.
WHITENESS = 0.35
#: Root mean square of the standardised innovations from which the noise model's promise is not kept: the square root of
#: `REGIME_RATIO`.  Smaller ones than promised show nothing that is missing: the stated noise is then on the safe side.
SIZE_RATIO = 1.4
#: Parts into which position, speed and time are cut.
PARTS = 3


@dataclass(frozen=True, kw_only=True)
class Check:
    """One predictive check.

    Parameters
    ----------
    output : str
    what : str
        ``"size"``, ``"whiteness"`` or the regime in words.
    value : float
        Root mean square, correlation, or ratio of mean squares.
    deviations : float
        By how many standard deviations it differs from what is promised.
    passed : bool
    """

    output: str
    what: str
    value: float
    deviations: float
    passed: bool

    def __str__(self) -> str:
        state = "as promised" if self.passed else "not as promised"
        return f"{self.output}, {self.what}: {self.value:.2g} ({self.deviations:.1f} deviations), {state}"

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {
            "output": self.output,
            "what": self.what,
            "value": self.value,
            "deviations": self.deviations,
            "passed": self.passed,
        }


def predictive_checks(likelihood: StageLikelihood) -> tuple[Check, ...]:
    """Check size, whiteness and evenness of the innovations of every output.

    A force that the noise model takes for a steady disturbance, but that acts only at some places, speeds or times, has
    innovations larger there and smaller elsewhere.

    Parameters
    ----------
    likelihood : StageLikelihood
    """
    linearised, fitted = likelihood.linearised, likelihood.noise
    columns, *_ = record_columns(linearised, fitted.records, likelihood.held)
    pairs = [c.innovations(fitted.model) for c in columns]
    innovations = [e for e, _ in pairs]
    sizes = _innovation_sizes([root for _, root in pairs])
    used = [r.used for r in fitted.records]
    outputs = linearised.residual().channels
    checks = []
    for c, name in enumerate(outputs):
        w = [e[:, c] for e in innovations]
        joined = np.concatenate(w)
        lag = float(np.mean([np.corrcoef(x[1:], x[:-1])[0, 1] for x in w if x.size > 3 and np.std(x) > 0.0] or [0.0]))
        deviations = lag * np.sqrt(joined.size)
        size = float(np.sqrt(np.mean(joined**2)))
        deviations_of_size = (size - 1.0) * np.sqrt(2.0 * joined.size)
        as_promised = size < SIZE_RATIO
        checks.append(
            Check(output=name, what="size", value=size, deviations=float(deviations_of_size), passed=as_promised)
        )
        # what the noise model cannot follow, against what a reader sees of a single sample
        slow = np.sqrt(max(lag, 0.0)) * sizes[c] > linearised.noise.get(name, 0.0)
        white = not (slow and lag > WHITENESS)
        checks.append(Check(output=name, what="whiteness", value=lag, deviations=float(deviations), passed=white))
        for what, inside in _regimes(likelihood, used):
            checks.append(_regime_check(name, what, w, inside))
    return tuple(checks)


def checks_by_output(checks: Sequence[Check], fits: Sequence[Fit]) -> dict[str, dict[str, object]]:
    """Return what a reader of diagnosis.json asks first of every output.

    Parameters
    ----------
    checks : sequence of Check
    fits : sequence of Fit
        Of the records on which the model is judged.

    Returns
    -------
    dict
        For each output ``fit_percent`` (100 · (1 − error / spread), root mean squares over these records),
        ``innovation_white`` and ``size`` (of the standardised innovations; 1 as promised), and ``even``: whether they
        are as large in every regime.
    """
    out: dict[str, dict[str, object]] = {}
    for c, name in enumerate(fits[0].experiment.outputs):
        own = [k for k in checks if k.output == name]
        measured = np.concatenate([f.experiment.measured[:, c] for f in fits])
        error = nrmse(measured, measured - np.concatenate([f.residual[:, c] for f in fits]))
        out[name] = {
            "fit_percent": 100.0 * (1.0 - error) if np.isfinite(error) else None,
            "innovation_white": all(k.passed for k in own if k.what == "whiteness"),
            "size": next((k.value for k in own if k.what == "size"), None),
            "even": all(k.passed for k in own if k.what not in ("whiteness", "size")),
        }
    return out


def _innovation_sizes(roots: Sequence[np.ndarray]) -> np.ndarray:
    """Return the standard deviation of the innovations of every output at a usual sample, SI, (n_c,)."""
    factors = np.linalg.inv(np.concatenate(roots))
    sizes: np.ndarray = np.median(np.sqrt(np.sum(factors**2, axis=2)), axis=0)
    return sizes


def _regime_check(name: str, what: str, w: Sequence[np.ndarray], inside: Sequence[np.ndarray]) -> Check:
    """Return whether the innovations are as large inside a regime as outside."""
    squares = [x**2 for x in w]
    memory = float(np.mean([correlation_time(s - s.mean()) for s in squares]))
    a = np.concatenate([s[m] for s, m in zip(squares, inside, strict=True)])
    b = np.concatenate([s[~m] for s, m in zip(squares, inside, strict=True)])
    if min(a.size, b.size) < 30:
        return Check(output=name, what=what, value=1.0, deviations=0.0, passed=True)
    ratio = float(np.mean(a) / max(np.mean(b), 1e-300))
    error = np.sqrt(memory * sum(np.var(x) / (x.size * np.mean(x) ** 2) for x in (a, b)))
    deviations = float(np.log(max(ratio, 1e-300)) / max(error, 1e-12))
    uneven = max(ratio, 1.0 / max(ratio, 1e-300)) > REGIME_RATIO and abs(deviations) > REGIME_DEVIATIONS
    return Check(output=name, what=what, value=ratio, deviations=deviations, passed=not uneven)


def _regimes(likelihood: StageLikelihood, used: Sequence[np.ndarray]) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Yield regimes in words, and which of the samples that count belong to them, record by record."""
    linearised = likelihood.linearised
    experiments = linearised.experiments
    for place in linearised.system.places:
        names = [n for n, _ in place.motion_names()]
        for what, own in zip(("position", "speed"), names, strict=False):
            signal = [
                _on_grid(linearised.nominal_outputs(i)[f"place.{place.name}.{own}"], e)[mask]
                for i, (e, mask) in enumerate(zip(experiments, used, strict=True))
            ]
            pooled = np.concatenate(signal)
            if what == "speed":
                pooled, signal = np.abs(pooled), [np.abs(s) for s in signal]
            if np.ptp(pooled) <= 0.0:
                continue
            edges = np.quantile(pooled, np.linspace(0.0, 1.0, PARTS + 1))
            for k in range(PARTS):
                inside = [(s >= edges[k]) & (s <= edges[k + 1]) for s in signal]
                yield f"{what} of {place.name} from {edges[k]:.3g} to {edges[k + 1]:.3g}", inside
    for k in range(PARTS):
        yield (
            f"part {k + 1} of {PARTS} of each record",
            [((np.arange(m.size) * PARTS // m.size) == k)[m] for m in used],
        )


def _on_grid(values: np.ndarray, experiment: Experiment) -> np.ndarray:
    return np.interp(experiment.time, np.asarray(experiment.record.time), values)
