"""Where a model fails: in which signal, when, along the travel, at which frequencies and connection.

These are descriptions for the engineer and decide nothing.  An entry is listed only if it is large compared with the
residual's own variation from block to block.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.questions.connections import LEAST_SHARE, examined_connections
from discrepancy.stages.residuals_along_motion import PlaceMotion, ResidualsAlongMotion, residuals_along_motion
from discrepancy.stages.stage import Stage
from estimation.signals.metrics import spectral_density
from multibody.base.quantity_text import quantity_text

__all__ = ["WhereItFails", "locate", "regimes_of"]

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
"""Standard errors from which a figure is listed: about one in 400 exceeds that by chance, with many blocks."""
_BINS = 12
_ABOVE = 3.0
"""Factor over the noise floor from which a frequency counts as above it."""


@dataclass(frozen=True, kw_only=True)
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
    why_no_connections : str
        Why the connections could not be examined, if so.
    """

    stage: str
    part: str
    signals: tuple[Entry, ...]
    regimes: tuple[Entry, ...]
    dependence: tuple[Entry, ...]
    frequencies: tuple[Entry, ...]
    connections: tuple[Entry, ...]
    why_no_connections: str = ""

    def to_dict(self) -> dict[str, list[Entry]]:
        """Return the lists as they stand in ``diagnosis.json``."""
        return {
            name: [dict(e) for e in getattr(self, name)]
            for name in ("signals", "regimes", "frequencies", "connections", "dependence")
        }

    def sentences(self) -> dict[str, list[str]]:
        """Return the sentences of each list."""
        return {name: [e["sentence"] for e in entries] for name, entries in self.to_dict().items()}

    def __repr__(self) -> str:
        lines = [f"Where '{self.stage}' fails ({self.part} records):"]
        for name, sentences in self.sentences().items():
            lines += [f"  {name}: {t}" for t in sentences[:6]]
        return "\n".join(lines)


def locate(stage: Stage, part: str = "identify") -> WhereItFails:
    """Locate the error of a stage's model.

    Parameters
    ----------
    stage : Stage
        Its system has probes.
    part : {"identify", "validate"}
        Records to examine.
    """
    residuals = residuals_along_motion(stage, part)
    connections, why_no_connections = examined_connections(residuals)
    return WhereItFails(
        stage=stage.name,
        part=part,
        signals=tuple(_signals(residuals)),
        regimes=tuple(_regimes(residuals)),
        dependence=tuple(_dependence(residuals)),
        frequencies=tuple(_frequencies(residuals)),
        connections=connections,
        why_no_connections=why_no_connections,
    )


# ---------------------------------------------------------------- signals


def _signals(residuals: ResidualsAlongMotion) -> list[Entry]:
    rms = np.sqrt(np.mean(residuals.values**2, axis=0))
    excess = np.maximum((rms / residuals.noise) ** 2 - 1.0, 0.0)
    share = excess / excess.sum() if excess.sum() > 0.0 else np.zeros_like(excess)
    entries = []
    for c in np.argsort(-share, kind="stable"):
        name, unit, known = residuals.outputs[c], residuals.units[c], residuals.stage.noise.get(residuals.outputs[c])
        ratio = float(rms[c] / residuals.noise[c]) if known else None
        if ratio is None:
            sentence = f"{name}: error {quantity_text(float(rms[c]), unit)}; its noise is not known."
        elif ratio <= 1.1:
            sentence = (
                f"{name}: error {quantity_text(float(rms[c]), unit)}, no more than the noise of the sensor "
                f"({quantity_text(known, unit)})."
            )
        else:
            sentence = (
                f"{name}: error {quantity_text(float(rms[c]), unit)}, {quantity_text(ratio, digits=2)} times the noise "
                f"of the sensor; {100 * share[c]:.0f} % of all error above noise is here."
            )
        entries.append(
            {
                "output": name,
                "unit": unit,
                "rmse": float(rms[c]),
                "noise": float(known) if known else None,
                "over_noise": ratio,
                "share": float(share[c]),
                "sentence": sentence,
            }
        )
    return entries


def _above_noise(residuals: ResidualsAlongMotion, column: int) -> bool:
    known = residuals.stage.noise.get(residuals.outputs[column])
    return not known or float(np.sqrt(np.mean(residuals.values[:, column] ** 2))) > 1.1 * known


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


def _jackknife_error(residuals: ResidualsAlongMotion, of: Callable[[np.ndarray], float]) -> float:
    """Standard error of a figure of rows, by leaving out one block at a time."""
    values = np.array([of(rows) for rows in residuals.jackknife()])
    values = values[np.isfinite(values)]
    n = len(values)
    return float(np.sqrt((n - 1) * np.var(values))) if n > 2 else float("inf")


def _regimes(residuals: ResidualsAlongMotion) -> list[Entry]:
    entries = []
    for motion in residuals.guides():
        for regime, inside in regimes_of(motion).items():
            # A regime that lies in one or two blocks gives no estimate of its spread.
            if sum(bool(inside[b].any()) for b in residuals.blocks) < 4 or inside.mean() < 0.01:
                continue
            for c in range(residuals.values.shape[1]):
                if _above_noise(residuals, c):
                    entry = _regime_entry(residuals, motion, regime, inside, c)
                    if entry is not None:
                        entries.append(entry)
    return sorted(entries, key=lambda e: -abs(np.log(max(e["relative"], 1e-300))))


def _regime_entry(
    residuals: ResidualsAlongMotion, motion: PlaceMotion, regime: str, inside: np.ndarray, c: int
) -> Entry | None:
    e = residuals.values[:, c]

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
    larger = abs(ratio) > _SURE * _jackknife_error(residuals, relative) and abs(ratio) > np.log(1.1)
    shifted = abs(centre) > _SURE * _jackknife_error(residuals, mean) and abs(centre) > 0.3 * rms
    if not (larger or shifted):
        return None
    name, unit, factor = residuals.outputs[c], residuals.units[c], float(np.exp(ratio))
    parts = []
    if larger:
        parts.append(f"the error is {quantity_text(factor, digits=2)} times its overall size")
    if shifted:
        side = "more" if centre > 0.0 else "less"
        parts.append(f"the machine reads {quantity_text(abs(centre), unit)} {side} than the model on average")
    sentence = f"{name}, {REGIMES[regime]} ({motion.name}): {' and '.join(parts)}."
    return {
        "regime": regime,
        "place": motion.name,
        "output": name,
        "unit": unit,
        "rms": rms,
        "relative": factor,
        "mean": float(centre),
        "louder": bool(larger),
        "shifted": bool(shifted),
        "time_share": float(inside.mean()),
        "sentence": sentence,
    }


# ---------------------------------------------------------------- position, speed, load, time


def _regressors(residuals: ResidualsAlongMotion) -> list[tuple[str, str, str, np.ndarray]]:
    """What the residual may depend on: (place, name, unit, values)."""
    from discrepancy.effects.catalogue import catalogue

    regressors = []
    for motion in residuals.guides():
        names = motion.place.motion_names()
        regressors.append((motion.name, "position", names[0][1], motion.position))
        regressors.append((motion.name, "speed", names[1][1], motion.speed))
    for entry in catalogue(residuals.stage.system, (), (), include=["load_dependent_friction@*"]):
        if entry.load and any(m.name == entry.where for m in residuals.guides()):
            regressors.append(
                (entry.where, "load", residuals.stage.system.unit(entry.load), _prepared(residuals, entry.load))
            )
    since = np.concatenate([t - t[0] for t in (f.experiment.time for f in residuals.linearised.calibration.fits)])
    regressors.append(("", "time", "s", since))
    return [f for f in regressors if np.ptp(f[3]) > 0.0]


def _prepared(residuals: ResidualsAlongMotion, output: str) -> np.ndarray:
    parts = []
    for i, experiment in enumerate(residuals.linearised.experiments):
        time, values = np.asarray(experiment.record.time), residuals.linearised.nominal_outputs(i)[output]
        parts.append(experiment.preparation.apply(time, values)[1])
    return np.concatenate(parts)


def _dependence(residuals: ResidualsAlongMotion) -> list[Entry]:
    entries = []
    for place, name, unit, x in _regressors(residuals):
        edges = np.linspace(x.min(), x.max(), _BINS + 1)
        bin_of = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
        for c in range(residuals.values.shape[1]):
            if not _above_noise(residuals, c):
                continue
            share = _cross_validated(residuals.values[:, c], bin_of, residuals)
            if share < LEAST_SHARE:
                continue
            entries.append(_dependence_entry(residuals, place, name, unit, edges, bin_of, c, share))
    return sorted(entries, key=lambda e: -e["share"])


def _cross_validated(e: np.ndarray, bin_of: np.ndarray, residuals: ResidualsAlongMotion) -> float:
    """Share of the variance that bin means from other blocks explain; zero or less by chance."""
    e = e - e.mean()
    count = np.array([np.bincount(bin_of[b], minlength=_BINS) for b in residuals.blocks], dtype=float)
    total = np.array([np.bincount(bin_of[b], weights=e[b], minlength=_BINS) for b in residuals.blocks])
    others = np.maximum(count.sum(axis=0) - count, 1e-300)
    means = (total.sum(axis=0) - total) / others
    gain = float(np.sum(2.0 * means * total - means**2 * count))
    return gain / max(float(e @ e), 1e-300)


def _dependence_entry(
    residuals: ResidualsAlongMotion,
    place: str,
    name: str,
    unit: str,
    edges: np.ndarray,
    bin_of: np.ndarray,
    c: int,
    share: float,
) -> Entry:
    e = residuals.values[:, c]
    count = np.bincount(bin_of, minlength=_BINS)
    seen = count >= 5
    mean = np.bincount(bin_of, weights=e, minlength=_BINS) / np.maximum(count, 1)
    centre = 0.5 * (edges[1:] + edges[:-1])
    top, low = int(np.argmax(np.where(seen, mean, -np.inf))), int(np.argmin(np.where(seen, mean, np.inf)))
    output, out_unit = residuals.outputs[c], residuals.units[c]
    of = f"{name} of {place}" if place else "time"
    sentence = (
        f"{output}: the mean error depends on the {of} ({100 * share:.0f} % of it): "
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
        "sentence": sentence,
    }


# ---------------------------------------------------------------- frequencies


def _frequencies(residuals: ResidualsAlongMotion) -> list[Entry]:
    entries = []
    fits = residuals.linearised.calibration.fits
    rate = float(1.0 / np.median(np.diff(fits[0].experiment.time)))
    shortest = min(len(f.experiment.time) for f in fits)
    preparation = fits[0].experiment.preparation
    cutoff = preparation.cutoff(float(fits[0].experiment.record.rate))
    band = min(cutoff or np.inf, 0.5 * rate)
    for c, name in enumerate(residuals.outputs):
        if not residuals.stage.noise.get(name) or not _above_noise(residuals, c):
            continue
        spectra = [spectral_density(f.residual[:, c], rate, 8.0 * rate / shortest) for f in fits]
        frequency = spectra[0][0]
        density = np.average([s[1] for s in spectra], axis=0, weights=[len(f.experiment.time) for f in fits])
        # White noise behind a low-pass lies below its cutoff.
        floor = float(residuals.noise[c]) ** 2 / band
        entries += _bands(name, residuals.units[c], frequency, density, floor, band)
    return sorted(entries, key=lambda e: -e["share"])


def _bands(name: str, unit: str, frequency: np.ndarray, density: np.ndarray, floor: float, top: float) -> list[Entry]:
    """Contiguous runs of lines above the noise floor that contain a relevant share of the excess."""
    inside = (frequency > 0.0) & (frequency <= top)
    frequency, density = frequency[inside], density[inside]
    excess = np.maximum(density - floor, 0.0)
    total = float(excess.sum())
    above = density > _ABOVE * floor
    edges = np.flatnonzero(np.diff(np.concatenate([[False], above, [False]]).astype(int)))
    entries = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        share = float(excess[first:last].sum()) / total if total > 0.0 else 0.0
        if share < LEAST_SHARE:
            continue
        peak = first + int(np.argmax(density[first:last]))
        low, high = float(frequency[first]), float(frequency[last - 1])
        span = f"up to {high:.3g} Hz" if first == 0 else f"from {low:.3g} to {high:.3g} Hz"
        sentence = (
            f"{name}: {100 * share:.0f} % of the error above noise lies {span}, most at {frequency[peak]:.3g} Hz."
        )
        entries.append(
            {
                "output": name,
                "unit": unit,
                "from_hz": 0.0 if first == 0 else low,
                "to_hz": high,
                "peak_hz": float(frequency[peak]),
                "share": share,
                "over_noise": float(np.sqrt(density[peak] / floor)),
                "sentence": sentence,
            }
        )
    return entries
