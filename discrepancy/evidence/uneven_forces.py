"""Does a random force of the noise model act only at some positions or speeds?

A disturbance that nobody recorded has no reason to know where the machine is.  A random force that is large in one part
of its motion and small elsewhere belongs to something there, and the model lacks it.  Innovations hardly tell: a slow
force is predicted well wherever it acts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.fitted_noise import fitted_noise
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import record_columns
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import PROCESS_PRICE, RecordColumns, restricted_log_likelihood
from discrepancy.innovations.noise_model import NoiseModel
from multibody.base.quantity_text import quantity_text

__all__ = ["UnevenForce", "uneven_random_forces"]

#: Shares of the samples below the position or speed at which a force may begin or end; chosen, few: each is paid for.
EDGES = (1.0 / 3.0, 0.5, 2.0 / 3.0)
#: Width of that edge, over the range of the motion; chosen.
WIDTH = 0.05
#: Sizes of the force outside and inside where the fit begins, over that of the even force; chosen, the fit moves them.
OUTSIDE, INSIDE = 0.03, (1.0, 2.0)
#: Samples that a force must remember to be asked: how large a quicker one is, its innovations tell.
SLOW = 5.0
#: Ratio of the sizes inside and outside from which a force is uneven: variances four to one.
LEAST_RATIO = 2.0
MOST_RATIO = 20.0  # above it the size elsewhere is a matter of rounding


@dataclass(frozen=True, kw_only=True)
class UnevenForce:
    """A random force that acts mostly in one part of the motion.

    Parameters
    ----------
    where : str
        The connection.
    at : str
        The part of the motion in words.
    ratio : float
        Standard deviation there over that elsewhere.
    gain : float, nats
        By which the likelihood rises, the price for the choice of this part paid.
    """

    where: str
    at: str
    ratio: float
    gain: float

    @property
    def sentence(self) -> str:
        """What it says."""
        times = f"{self.ratio:.2g} times" if self.ratio < MOST_RATIO else f"more than {MOST_RATIO:.0f} times"
        return (
            f"A force that differs from record to record acts at {self.where}, {times} as large at {self.at} as "
            "elsewhere: something is there that the model lacks, for a disturbance from outside does not know where "
            "the machine is."
        )

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {"where": self.where, "at": self.at, "ratio": min(self.ratio, MOST_RATIO), "log_likelihood": self.gain}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Regime:
    """A part of the motion, and how much every sample belongs to it: from zero to one, (N,) for each record."""

    what: str
    weights: list[np.ndarray]


def uneven_random_forces(likelihood: StageLikelihood) -> tuple[UnevenForce, ...]:
    """Return the random forces that act mostly in one part of the motion.

    The force is replaced by two of the same memory, one of them times a step over position or speed of the connection
    that it acts at: what it belongs to is there.  It is uneven if the likelihood rises by more than a further process
    must earn, the choice of the step included.

    Parameters
    ----------
    likelihood : StageLikelihood
    """
    fitted, linearised = likelihood.noise, likelihood.linearised
    columns, std, offset = record_columns(linearised, fitted.records, likelihood.held)
    model, every = fitted.model, _regimes(likelihood)
    step = float(np.median(np.concatenate([np.diff(c.record.time) for c in columns])))
    uneven = []
    for k, process in enumerate(model.processes):
        if process.source < 0 or process.at_standstill or process.memory < SLOW * step:
            continue
        regimes = every.get(process.where, [])
        price = PROCESS_PRICE + float(np.log(max(2 * len(regimes), 1)))
        trials = [t for regime in regimes for t in _trials(columns, model, k, regime)]
        if not trials:
            continue
        gains = [restricted_log_likelihood(t.columns, t.model, std, offset) - fitted.log_likelihood for t in trials]
        if max(gains) < price - PROCESS_PRICE:
            continue
        best = trials[int(np.argmax(gains))]
        records = [c.record for c in best.columns]
        whole = fitted_noise(linearised, records, best.columns, std, offset, best.model, grow=False, reduce=False)
        outside, more = whole.model.processes[k].std, whole.model.processes[-1].std
        ratio = float(np.hypot(outside, more)) / max(outside, 1e-300)
        gain = whole.log_likelihood - fitted.log_likelihood - price
        if ratio >= LEAST_RATIO and gain > 0.0:
            uneven.append(UnevenForce(where=process.where, at=best.regime.what, ratio=ratio, gain=gain))
    clearest: dict[str, UnevenForce] = {}  # several processes may make up one force
    for force in sorted(uneven, key=lambda u: u.gain):
        clearest[force.where] = force
    return tuple(clearest.values())


@dataclass(frozen=True, eq=False, kw_only=True)
class _Trial:
    regime: _Regime
    columns: list[RecordColumns]
    model: NoiseModel


def _trials(columns: Sequence[RecordColumns], model: NoiseModel, k: int, regime: _Regime) -> Iterator[_Trial]:
    """Yield the noise models in which one process is larger in a regime than elsewhere."""
    process = model.processes[k]
    records = [c.record.with_modulated([process.source], [w]) for c, w in zip(columns, regime.weights, strict=True)]
    modulated = [replace(c, record=r) for c, r in zip(columns, records, strict=True)]
    new = records[0].gamma0.shape[2] - 1
    for inside in INSIDE:
        processes = list(model.processes)
        processes[k] = replace(process, std=OUTSIDE * process.std)
        processes.append(replace(process, source=new, std=inside * process.std))
        yield _Trial(regime=regime, columns=modulated, model=replace(model, processes=tuple(processes)))


def _regimes(likelihood: StageLikelihood) -> dict[str, list[_Regime]]:
    """Return the parts of the motion of every connection: above and below some of its positions and speeds."""
    linearised, records = likelihood.linearised, likelihood.noise.records
    regimes: dict[str, list[_Regime]] = {}
    for place in linearised.system.places:
        (position, unit_of_position), (rate, unit_of_rate), _ = place.motion_names()
        of_position = "an angle" if position == "angle" else f"a {position}"
        asked = ((of_position, position, unit_of_position), ("a speed", rate, unit_of_rate))
        for what, own, unit in asked:
            signals = [_along(likelihood, i, r, f"place.{place.name}.{own}") for i, r in enumerate(records)]
            pooled = np.concatenate(signals)
            width = WIDTH * float(np.ptp(pooled))
            if not width > 0.0:
                continue
            for share in EDGES:
                edge = float(np.quantile(pooled, share))
                text = quantity_text(edge, unit)
                above = [0.5 * (1.0 + np.tanh(0.5 * (s - edge) / width)) for s in signals]
                regimes.setdefault(place.name, []).extend(
                    (
                        _Regime(what=f"{what} of {place.name} above {text}", weights=above),
                        _Regime(what=f"{what} of {place.name} below {text}", weights=[1.0 - a for a in above]),
                    )
                )
    return regimes


def _along(likelihood: StageLikelihood, i: int, record: LinearRecord, name: str) -> np.ndarray:
    """Return a signal of the nominal run at the samples of a linearised record."""
    linearised = likelihood.linearised
    time = np.asarray(linearised.experiments[i].record.time)
    return np.interp(record.time, time, linearised.nominal_outputs(i)[name])
