"""Model and measurement compared: the figures of agreement of every part, record and output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.comparison_figure import comparison_figure
from discrepancy.stages.stage import Stage
from estimation.signals.metrics import Agreement, agreement, coherence, spectral_density
from multibody.base.quantity_text import unit_text

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from estimation.fit.calibrate import Fit

__all__ = ["PARTS", "Comparison", "SignalComparison", "Work", "compare"]

PARTS = ("identify", "validate")
_MOTION = {"N": ("m", "m/s"), "N*m": ("rad", "rad/s")}
"""Units of position and speed that a force's or torque's work is taken along."""


@dataclass(frozen=True)
class Work:
    """Work of a force along a measured motion of the same record, J.

    Attributes
    ----------
    measured, model : float
        Measured force along the measured motion; modelled force along the modelled motion.
    along : str
        Output that gives the motion.
    """

    measured: float
    model: float
    along: str


@dataclass(frozen=True, eq=False, kw_only=True)
class SignalComparison:
    """One output of one record.

    Attributes
    ----------
    part : {"identify", "validate"}
    record, output, unit : str
    time : ndarray, shape (n,), s
    measured, model : ndarray, shape (n,), in ``unit``
        After the same window, filter and decimation.
    noise : float or None
        Noise floor, in ``unit``.
    figures : Agreement
    work : Work or None
        Only for forces and torques where a motion is measured too.
    """

    part: str
    record: str
    output: str
    unit: str
    time: np.ndarray
    measured: np.ndarray
    model: np.ndarray
    noise: float | None
    figures: Agreement
    work: Work | None = None

    @property
    def residual(self) -> np.ndarray:
        """Measured minus model."""
        return self.measured - self.model

    @property
    def rate(self) -> float:
        """Sampling rate, Hz."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    @property
    def over_noise(self) -> float | None:
        """RMSE divided by the noise floor: 1 is as good as the sensor allows."""
        return self.figures.rmse / self.noise if self.noise else None

    @property
    def energy_share(self) -> float:
        """Energy of the residual divided by the measured signal's about its mean; NaN if that is constant."""
        total = float(np.sum((self.measured - self.measured.mean()) ** 2))
        return float(np.sum(self.residual**2)) / total if total > 0.0 else float("nan")

    def spectrum(self, of: str = "residual", resolution: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return frequency (Hz) and density (unit²/Hz) of ``"residual"``, ``"measured"`` or ``"model"``."""
        return spectral_density(getattr(self, of), self.rate, resolution)

    def coherence(self, resolution: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return frequency (Hz) and coherence (0 to 1) of measurement and model."""
        return coherence(self.measured, self.model, self.rate, resolution)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that was compared in a stage.

    Attributes
    ----------
    stage : str
    signals : tuple of SignalComparison
        Every part, record and output.
    """

    stage: str
    signals: tuple[SignalComparison, ...]

    def __iter__(self) -> Iterator[SignalComparison]:
        return iter(self.signals)

    def of(
        self, part: str | None = None, record: str | None = None, output: str | None = None
    ) -> list[SignalComparison]:
        """Return the signals of a part, record or output."""
        return [
            s
            for s in self.signals
            if part in (None, s.part) and record in (None, s.record) and output in (None, s.output)
        ]

    def pooled(self, part: str) -> dict[str, Agreement]:
        """Return the figures of every output over all records of a part; empty without records."""
        pooled = {}
        for output in dict.fromkeys(s.output for s in self.of(part)):
            group = self.of(part, output=output)
            pooled[output] = agreement(
                np.concatenate([s.measured for s in group]),
                np.concatenate([s.model for s in group]),
                group[0].noise,
            )
        return pooled

    def to_frame(self) -> pd.DataFrame:
        """Return a row for every part, record and output; errors in the output's unit, work in J."""
        import pandas as pd

        rows = []
        for s in self.signals:
            f = s.figures
            rows.append(
                {
                    "part": s.part,
                    "record": s.record,
                    "output": s.output,
                    "unit": s.unit,
                    "rmse": f.rmse,
                    "nrmse": f.nrmse,
                    "pearson": f.pearson,
                    "cosine": f.cosine,
                    "max_error": f.max_error,
                    "bias": f.bias,
                    "noise": s.noise,
                    "over_noise": s.over_noise,
                    "share_above_noise": f.share_above_noise,
                    "energy_share": s.energy_share,
                    "work_measured": s.work.measured if s.work else None,
                    "work_model": s.work.model if s.work else None,
                }
            )
        return pd.DataFrame(rows)

    def plot(self, part: str = "identify", record: str | None = None) -> Figure:
        """Draw measurement, model, residual and its spectrum against the noise floor, for one record."""
        signals = self.of(part, record)
        if not signals:
            what = f"no record '{record}'" if record else "no record"
            known = sorted({(s.part, s.record) for s in self.signals})
            raise KeyError(f"there is {what} in part '{part}'; there are: {known}")
        return comparison_figure([s for s in signals if s.record == signals[0].record])

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        parts = [part for part in PARTS if self.of(part)]
        pooled = {part: self.pooled(part) for part in parts}
        worst = max(self.signals, key=lambda s: s.over_noise or s.figures.nrmse)
        rows = []
        for output in pooled[parts[0]]:
            unit = unit_text(self.of(output=output)[0].unit) or "1"
            cells = [f"{pooled[part][output].rmse:.4g} ({100.0 * pooled[part][output].nrmse:.3g} %)" for part in parts]
            rows.append((f"{output} [{unit}]", *cells))
        unit = f"[{unit_text(worst.unit) or '1'}]"
        signals = {"measured": worst.measured, "model": worst.model}
        panels = [(f"{worst.output} {unit}", signals), (f"residual {unit}", {"": worst.residual})]
        header = ("output", *("RMS error, fitted" if part == "identify" else "RMS error, held out" for part in parts))
        text = f"The worst: {worst.output} on record '{worst.record}'."
        title = f"Model '{self.stage}' against measurement"
        return notebook_view(title, rows, header=header, text=text, figure=small_figure(worst.time, panels))

    def __repr__(self) -> str:
        lines = [
            f"Comparison of '{self.stage}'",
            f"  {'part':9s} {'record':20s} {'output':22s} {'RMSE':>10s} {'unit':8s} {'/signal':>8s} "
            f"{'/noise':>8s} "
            f"{'Pearson':>8s}",
        ]
        for s in self.signals:
            over = "" if s.over_noise is None else f"{s.over_noise:.2f}"
            lines.append(
                f"  {s.part:9s} {s.record[:20]:20s} {s.output[:22]:22s} {s.figures.rmse:10.4g} {s.unit:8s} "
                f"{100 * s.figures.nrmse:6.1f} % {over:>8s} {s.figures.pearson:8.4f}"
            )
        return "\n".join(lines)


def compare(stage: Stage) -> Comparison:
    """Compare the model of a stage with all its records.

    Parameters
    ----------
    stage : Stage
        Fitted; the residuals of its calibrations are used as they are.

    Returns
    -------
    Comparison
    """
    signals = (s for part in PARTS for fit in stage.fits(part) for s in _signals_of(stage, part, fit))
    return Comparison(stage.name, tuple(signals))


def _signals_of(stage: Stage, part: str, fit: Fit) -> list[SignalComparison]:
    experiment = fit.experiment
    units = [stage.system.unit(n) for n in experiment.outputs]
    signals = []
    for c, (output, unit) in enumerate(zip(experiment.outputs, units, strict=True)):
        measured, model = experiment.measured[:, c], fit.response.outputs[:, c]
        noise = stage.noise.get(output) or None
        signals.append(
            SignalComparison(
                part=part,
                record=experiment.name,
                output=output,
                unit=unit,
                time=experiment.time,
                measured=measured,
                model=model,
                noise=noise,
                figures=agreement(measured, model, noise),
                work=_work(fit, units, c),
            )
        )
    return signals


def _work(fit: Fit, units: list[str], column: int) -> Work | None:
    """Work of a force along the first measured motion of its domain; None where none was measured."""
    if units[column] not in _MOTION:
        return None
    position, speed = _MOTION[units[column]]
    along = next((c for wanted in (position, speed) for c, u in enumerate(units) if u == wanted), None)
    if along is None:
        return None
    experiment = fit.experiment
    amounts: list[float] = []
    for y in (experiment.measured, fit.response.outputs):
        force = 0.5 * (y[1:, column] + y[:-1, column])
        if units[along] == position:
            path = np.diff(y[:, along])
        else:
            path = 0.5 * (y[1:, along] + y[:-1, along]) * np.diff(experiment.time)
        amounts.append(float(np.sum(force * path)))
    return Work(amounts[0], amounts[1], experiment.outputs[along])


def signal_entry(figures: Agreement) -> dict[str, Any]:
    """Return the figures of one output as they stand in ``diagnosis.json``."""
    return {
        "rmse": figures.rmse,
        "nrmse": figures.nrmse,
        "pearson": figures.pearson,
        "cosine": figures.cosine,
        "max_error": figures.max_error,
    }
