"""Where a model fails: in which signal, when, along the travel, at which frequencies and connection.

These are descriptions for the engineer; they choose nothing.  What is listed stands out against the
residual's own variation from block to block; what does not is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.questions.connections import connections_or_why
from discrepancy.stages.residuals_along_motion import PlaceMotion, ResidualsAlongMotion, residuals_along_motion
from discrepancy.stages.stage import Stage
from estimation.signals.metrics import spectral_density
from multibody.base.quantity_text import quantity_text

__all__ = ["REGIMES", "WhereItFails", "locate", "regimes_of"]

Entry = dict[str, Any]

REGIMES = {
    "at rest": "while the machine stands still",
    "starting": "while it gathers speed",
    "constant speed": "at constant speed",
    "braking": "while it slows down",
    "forward": "in forward motion",
    "backward": "in backward motion",
    "low speed": "at low speed",
}
_STILL, _SLOW, _STEADY = 0.02, 0.2, 0.1
"""Rest and low speed as shares of the 95th percentile of speed; steady, of that of acceleration."""
_SURE = 3.0
"""Standard errors from which something counts: about one figure in 400 by luck, with many blocks."""
_LEAST_SHARE = 0.05
_BINS = 12
_ABOVE = 3.0
"""Factor over the noise floor from which a frequency counts as standing above it."""


@dataclass(frozen=True)
class WhereItFails:
    """Where a stage fails; every entry is a dict of plain values with a ``sentence``.

    Attributes
    ----------
    stage, part : str
    signals : tuple of dict
        Share of the error above the noise floor for each output, largest first.
    regimes : tuple of dict
        Residual in each state of motion relative to the whole, where that is significant.
    dependence : tuple of dict
        Mean residual in bins of position, speed, load and time, where it varies.
    frequencies : tuple of dict
        Bands in which the residual stands above the noise floor.
    connections : tuple of dict
        How much of the residual a force at each place would explain.
    untold : str
        Why nothing is said of the connections, if so.
    """

    stage: str
    part: str
    signals: tuple[Entry, ...]
    regimes: tuple[Entry, ...]
    dependence: tuple[Entry, ...]
    frequencies: tuple[Entry, ...]
    connections: tuple[Entry, ...]
    untold: str = ""

    def to_dict(self) -> dict[str, list[Entry]]:
        """Return the lists as they stand in ``diagnosis.json``."""
        return {
            name: [dict(e) for e in getattr(self, name)]
            for name in ("signals", "regimes", "frequencies", "connections", "dependence")
        }

    def sentences(self) -> dict[str, list[str]]:
        """Return what to say, list by list."""
        return {name: [e["sentence"] for e in entries] for name, entries in self.to_dict().items()}

    def __repr__(self) -> str:
        lines = [f"Where '{self.stage}' fails ({self.part} records):"]
        for name, told in self.sentences().items():
            lines += [f"  {name}: {t}" for t in told[:6]]
        return "\n".join(lines)


def locate(stage: Stage, part: str = "identify") -> WhereItFails:
    """Say where the model of a stage fails.

    Parameters
    ----------
    stage : Stage
        Its system has probes.
    part : {"identify", "validate"}
        Records to look at.
    """
    facts = residuals_along_motion(stage, part)
    return WhereItFails(
        stage.name,
        part,
        tuple(_signals(facts)),
        tuple(_regimes(facts)),
        tuple(_dependence(facts)),
        tuple(_frequencies(facts)),
        *connections_or_why(facts),
    )


# ---------------------------------------------------------------- signals


def _signals(facts: ResidualsAlongMotion) -> list[Entry]:
    rms = np.sqrt(np.mean(facts.values**2, axis=0))
    excess = np.maximum((rms / facts.noise) ** 2 - 1.0, 0.0)
    share = excess / excess.sum() if excess.sum() > 0.0 else np.zeros_like(excess)
    found = []
    for c in np.argsort(-share, kind="stable"):
        name, unit, known = facts.outputs[c], facts.units[c], facts.stage.noise.get(facts.outputs[c])
        ratio = float(rms[c] / facts.noise[c]) if known else None
        if ratio is None:
            told = f"{name}: error {quantity_text(float(rms[c]), unit)}; its noise is not known."
        elif ratio <= 1.1:
            told = (
                f"{name}: error {quantity_text(float(rms[c]), unit)}, no more than the noise of the sensor "
                f"({quantity_text(known, unit)})."
            )
        else:
            told = (
                f"{name}: error {quantity_text(float(rms[c]), unit)}, {quantity_text(ratio, digits=2)} times the noise "
                f"of the sensor; {100 * share[c]:.0f} % of all error above noise is here."
            )
        found.append(
            {
                "output": name,
                "unit": unit,
                "rmse": float(rms[c]),
                "noise": float(known) if known else None,
                "over_noise": ratio,
                "share": float(share[c]),
                "sentence": told,
            }
        )
    return found


def _above_noise(facts: ResidualsAlongMotion, column: int) -> bool:
    known = facts.stage.noise.get(facts.outputs[column])
    return not known or float(np.sqrt(np.mean(facts.values[:, column] ** 2))) > 1.1 * known


# ---------------------------------------------------------------- regimes


def regimes_of(motion: PlaceMotion) -> dict[str, np.ndarray]:
    """Return when a place is in each state of motion, boolean arrays of shape (n,)."""
    v, a = motion.speed, motion.acceleration
    fast = max(float(np.quantile(np.abs(v), 0.95)), 1e-300)
    hard = max(float(np.quantile(np.abs(a), 0.95)), 1e-300)
    moving = np.abs(v) > _STILL * fast
    steady = np.abs(a) < _STEADY * hard
    return {
        "at rest": ~moving,
        "starting": moving & ~steady & (v * a > 0.0),
        "constant speed": moving & steady,
        "braking": moving & ~steady & (v * a < 0.0),
        "forward": moving & (v > 0.0),
        "backward": moving & (v < 0.0),
        "low speed": moving & (np.abs(v) < _SLOW * fast),
    }


def _jackknife_error(facts: ResidualsAlongMotion, of: Callable[[np.ndarray], float]) -> float:
    """Standard error of a figure of rows, by leaving out one block at a time."""
    values = np.array([of(rows) for rows in facts.jackknife()])
    values = values[np.isfinite(values)]
    n = len(values)
    return float(np.sqrt((n - 1) * np.var(values))) if n > 2 else float("inf")


def _regimes(facts: ResidualsAlongMotion) -> list[Entry]:
    found = []
    for motion in facts.guides():
        for regime, inside in regimes_of(motion).items():
            # A regime that lies in one or two blocks tells nothing about its spread.
            if sum(bool(inside[b].any()) for b in facts.blocks) < 4 or inside.mean() < 0.01:
                continue
            for c in range(facts.values.shape[1]):
                if _above_noise(facts, c):
                    entry = _regime_entry(facts, motion, regime, inside, c)
                    if entry is not None:
                        found.append(entry)
    return sorted(found, key=lambda e: -abs(np.log(max(e["relative"], 1e-300))))


def _regime_entry(
    facts: ResidualsAlongMotion, motion: PlaceMotion, regime: str, inside: np.ndarray, c: int
) -> Entry | None:
    e = facts.values[:, c]

    def relative(rows: np.ndarray) -> float:
        part = e[rows][inside[rows]]
        whole = float(np.mean(e[rows] ** 2))
        return 0.5 * float(np.log(np.mean(part**2) / whole)) if part.size and whole > 0.0 else float("nan")

    def mean(rows: np.ndarray) -> float:
        part = e[rows][inside[rows]]
        return float(np.mean(part)) if part.size else float("nan")

    everything = np.arange(len(e))
    ratio, centre = relative(everything), mean(everything)
    rms = float(np.sqrt(np.mean(e[inside] ** 2)))
    louder = abs(ratio) > _SURE * _jackknife_error(facts, relative) and abs(ratio) > np.log(1.1)
    shifted = abs(centre) > _SURE * _jackknife_error(facts, mean) and abs(centre) > 0.3 * rms
    if not (louder or shifted):
        return None
    name, unit, factor = facts.outputs[c], facts.units[c], float(np.exp(ratio))
    said = []
    if louder:
        said.append(f"the error is {quantity_text(factor, digits=2)} times its overall size")
    if shifted:
        side = "more" if centre > 0.0 else "less"
        said.append(f"the machine reads {quantity_text(abs(centre), unit)} {side} than the model on average")
    told = f"{name}, {REGIMES[regime]} ({motion.name}): {' and '.join(said)}."
    return {
        "regime": regime,
        "place": motion.name,
        "output": name,
        "unit": unit,
        "rms": rms,
        "relative": factor,
        "mean": float(centre),
        "louder": bool(louder),
        "shifted": bool(shifted),
        "time_share": float(inside.mean()),
        "sentence": told,
    }


# ---------------------------------------------------------------- position, speed, load, time


def _regressors(facts: ResidualsAlongMotion) -> list[tuple[str, str, str, np.ndarray]]:
    """What the residual may depend on: (place, name, unit, values)."""
    from discrepancy.effects.catalogue import catalogue

    found = []
    for motion in facts.guides():
        names = motion.place.motion_names()
        found.append((motion.name, "position", names[0][1], motion.position))
        found.append((motion.name, "speed", names[1][1], motion.speed))
    for entry in catalogue(facts.stage.system, (), (), include=["load_dependent_friction@*"]):
        if entry.load and any(m.name == entry.where for m in facts.guides()):
            found.append(
                (entry.where, "load", facts.stage.system.unit(entry.load), _prepared(facts, entry.load))
            )
    since = np.concatenate([t - t[0] for t in (f.experiment.time for f in facts.linearised.calibration.fits)])
    found.append(("", "time", "s", since))
    return [f for f in found if np.ptp(f[3]) > 0.0]


def _prepared(facts: ResidualsAlongMotion, output: str) -> np.ndarray:
    parts = []
    for i, experiment in enumerate(facts.linearised.experiments):
        time, values = np.asarray(experiment.record.time), facts.linearised.nominal_outputs(i)[output]
        parts.append(experiment.preparation.apply(time, values)[1])
    return np.concatenate(parts)


def _dependence(facts: ResidualsAlongMotion) -> list[Entry]:
    found = []
    for place, name, unit, x in _regressors(facts):
        edges = np.linspace(x.min(), x.max(), _BINS + 1)
        bin_of = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
        for c in range(facts.values.shape[1]):
            if not _above_noise(facts, c):
                continue
            share = _cross_validated(facts.values[:, c], bin_of, facts)
            if share < _LEAST_SHARE:
                continue
            found.append(_dependence_entry(facts, place, name, unit, edges, bin_of, c, share))
    return sorted(found, key=lambda e: -e["share"])


def _cross_validated(e: np.ndarray, bin_of: np.ndarray, facts: ResidualsAlongMotion) -> float:
    """Share of the variance that bin means from other blocks explain; luck gives zero or less."""
    e = e - e.mean()
    count = np.array([np.bincount(bin_of[b], minlength=_BINS) for b in facts.blocks], dtype=float)
    total = np.array([np.bincount(bin_of[b], weights=e[b], minlength=_BINS) for b in facts.blocks])
    others = np.maximum(count.sum(axis=0) - count, 1e-300)
    means = (total.sum(axis=0) - total) / others
    gain = float(np.sum(2.0 * means * total - means**2 * count))
    return gain / max(float(e @ e), 1e-300)


def _dependence_entry(
    facts: ResidualsAlongMotion,
    place: str,
    name: str,
    unit: str,
    edges: np.ndarray,
    bin_of: np.ndarray,
    c: int,
    share: float,
) -> Entry:
    e = facts.values[:, c]
    count = np.bincount(bin_of, minlength=_BINS)
    seen = count >= 5
    mean = np.bincount(bin_of, weights=e, minlength=_BINS) / np.maximum(count, 1)
    centre = 0.5 * (edges[1:] + edges[:-1])
    top, low = int(np.argmax(np.where(seen, mean, -np.inf))), int(np.argmin(np.where(seen, mean, np.inf)))
    output, out_unit = facts.outputs[c], facts.units[c]
    of = f"{name} of {place}" if place else "time"
    told = (
        f"{output}: the mean error goes with the {of} ({100 * share:.0f} % of it): "
        f"{quantity_text(float(mean[low]), out_unit)} around "
        f"{quantity_text(float(centre[low]), unit)}, {quantity_text(float(mean[top]), out_unit)} around "
        f"{quantity_text(float(centre[top]), unit)}."
    )
    return {
        "place": place or None,
        "over": name,
        "unit": unit,
        "output": output,
        "output_unit": out_unit,
        "share": float(share),
        "bins": [float(v) for v in centre[seen]],
        "mean": [float(v) for v in mean[seen]],
        "count": [int(v) for v in count[seen]],
        "sentence": told,
    }


# ---------------------------------------------------------------- frequencies


def _frequencies(facts: ResidualsAlongMotion) -> list[Entry]:
    found = []
    fits = facts.linearised.calibration.fits
    rate = float(1.0 / np.median(np.diff(fits[0].experiment.time)))
    shortest = min(len(f.experiment.time) for f in fits)
    preparation = fits[0].experiment.preparation
    cutoff = preparation.cutoff(float(fits[0].experiment.record.rate))
    band = min(cutoff or np.inf, 0.5 * rate)
    for c, name in enumerate(facts.outputs):
        if not facts.stage.noise.get(name) or not _above_noise(facts, c):
            continue
        spectra = [spectral_density(f.residual[:, c], rate, 8.0 * rate / shortest) for f in fits]
        frequency = spectra[0][0]
        density = np.average([s[1] for s in spectra], axis=0, weights=[len(f.experiment.time) for f in fits])
        # White noise behind a low-pass lies below its cutoff.
        floor = float(facts.noise[c]) ** 2 / band
        found += _bands(name, facts.units[c], frequency, density, floor, band)
    return sorted(found, key=lambda e: -e["share"])


def _bands(
    name: str, unit: str, frequency: np.ndarray, density: np.ndarray, floor: float, top: float
) -> list[Entry]:
    """Contiguous runs of lines above the noise floor that hold a share of the excess worth telling."""
    inside = (frequency > 0.0) & (frequency <= top)
    frequency, density = frequency[inside], density[inside]
    excess = np.maximum(density - floor, 0.0)
    total = float(excess.sum())
    loud = density > _ABOVE * floor
    edges = np.flatnonzero(np.diff(np.concatenate([[False], loud, [False]]).astype(int)))
    found = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        share = float(excess[first:last].sum()) / total if total > 0.0 else 0.0
        if share < _LEAST_SHARE:
            continue
        peak = first + int(np.argmax(density[first:last]))
        low, high = float(frequency[first]), float(frequency[last - 1])
        span = f"up to {high:.3g} Hz" if first == 0 else f"from {low:.3g} to {high:.3g} Hz"
        told = (
            f"{name}: {100 * share:.0f} % of the error above noise lies {span}, most at "
            f"{frequency[peak]:.3g} Hz."
        )
        found.append(
            {
                "output": name,
                "unit": unit,
                "from_hz": 0.0 if first == 0 else low,
                "to_hz": high,
                "peak_hz": float(frequency[peak]),
                "share": share,
                "over_noise": float(np.sqrt(density[peak] / floor)),
                "sentence": told,
            }
        )
    return found
