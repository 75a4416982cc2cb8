"""One stage of a study: a fitted model with its effects, its residuals on the records, and what is computed of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.sensitivities.disturbance import DisturbanceForce, accumulating_disturbance, weighted_residuals
from discrepancy.sensitivities.free_curve_scan import FreeCurveScan, free_curve_error_drops, scan_free_curves
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from estimation.signals.preparation import Preparation
from multibody.base.quantity_text import count_text, unit_text

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult
    from estimation.fit.calibrate import Calibration, Fit
    from estimation.response.sensors import SensorError
    from multibody.machine.model import Model, System

__all__ = ["AcceptedEffect", "RivalExplanation", "Stage", "comparable_residuals"]

Result = TypeVar("Result")

SCAN_ROWS = 6000  # samples × outputs of a scan; more costs time and, in coloured residuals, adds nothing


@dataclass(frozen=True, kw_only=True)
class RivalExplanation:
    """Another explanation of what an accepted effect explains.

    Parameters
    ----------
    kind, where : str
    delta_bic : float
        BIC of this explanation minus that of the accepted one, after full refits where both were refitted.
    refitted : bool
        True when the figure comes from a refit, False when from the linear scan.
    indistinguishable : bool
        True when these records do not distinguish the two.
    """

    kind: str
    where: str
    delta_bic: float
    refitted: bool
    indistinguishable: bool

    @property
    def names(self) -> tuple[str, ...]:
        """``kind@where`` of the effects that it consists of: ``"a with b@x"`` at y are a at y and b at x."""
        first, *more = self.kind.split(" with ")
        return f"{first}@{self.where}", *more


@dataclass(frozen=True, kw_only=True)
class AcceptedEffect:
    """Why an effect was added.

    Parameters
    ----------
    effect : Effect
    p_value : float
        Family-wise probability of such a score by chance, over all candidates.
    delta_bic : float
        Change of BIC by adding it, with the effective number of observations.
    rivals : tuple of RivalExplanation
        In the order of their BIC.
    masked_by : str
        ``kind@where`` of the other effect of a masking pair, which were added together.
    """

    effect: Effect
    p_value: float
    delta_bic: float
    rivals: tuple[RivalExplanation, ...] = ()
    masked_by: str = ""

    @property
    def ambiguous(self) -> bool:
        """True if these records do not distinguish another *kind* of effect from this one."""
        return any(r.indistinguishable and r.kind != self.effect.kind for r in self.rivals)


@dataclass(frozen=True, eq=False, kw_only=True)
class Stage:
    """A stage: as given, recalibrated, or with one more effect.

    What is computed of a stage (linearised problems, free curves, trial fits from it) is computed on first use and kept
    here; stages that differ only in ``accepted``, ``scan``, ``validate`` or ``notes`` share it.

    Parameters
    ----------
    name : str
        ``"as given"``, ``"recalibrated"`` or ``"+ kind@where"``.
    model : Model
        With its effects in it, at the fitted values.
    system : System
        Of that model, with probes and the outputs that show the motion of every place.
    slim : System
        The same with the measured outputs only: what is simulated again and again.
    effects : tuple of Effect
        Effects in the model, at the fitted values.
    accepted : AcceptedEffect or None
        Why the last effect was added.
    identify, validate : Calibration
        Fitted on the identification records; on the validation records only each record's own unknowns are fitted.
    sensors : tuple of SensorError
        Errors of sensors among the effects.
    p : ndarray
        Parameter vector.
    noise : mapping of str to float
        Noise floor of each output, SI.
    scan : ScanResult or None
        Scores of the candidates at this stage.
    notes : tuple of str
        What a reader should know about it.
    machine : Model or None
        The study's model with the effects, the fitted values and the sensors' errors: the model to save, also where
        ``model`` has its motion prescribed.  None for a trial fit.
    """

    name: str
    model: Model
    system: System
    slim: System
    effects: tuple[Effect, ...]
    accepted: AcceptedEffect | None = None
    identify: Calibration
    validate: Calibration | None = None
    sensors: tuple[SensorError, ...]
    p: np.ndarray
    noise: Mapping[str, float]
    scan: ScanResult | None = None
    notes: tuple[str, ...] = ()
    machine: Model | None = None
    _results: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the measured outputs."""
        return self.identify.fits[0].experiment.outputs

    @property
    def half_of_masking_pair(self) -> bool:
        """True where the effect that masks the accepted one is still to be added: alone it is half of an answer."""
        masked_by = self.accepted.masked_by if self.accepted is not None else ""
        return bool(masked_by) and masked_by not in map(str, self.effects)

    def fits(self, part: str) -> tuple[Fit, ...]:
        """Return the fits of ``"identify"`` or ``"validate"`` (empty when nothing is held out)."""
        calibration = self.identify if part == "identify" else self.validate
        return calibration.fits if calibration is not None else ()

    def rmse(self, part: str) -> dict[str, float]:
        """Return the root mean square error of every output over all records of a part, SI."""
        fits = self.fits(part)
        if not fits:
            return {}
        stacked = np.concatenate([f.residual for f in fits])
        return dict(zip(self.outputs, np.sqrt(np.mean(stacked**2, axis=0)).tolist(), strict=True))

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        fit = self.identify.fits[0]
        experiment, output = fit.experiment, self.outputs[0]
        units = {name: unit_text(self.system.unit(name)) or "1" for name in self.outputs}
        lines = {"measured": experiment.measured[:, 0], "model": fit.response.outputs[:, 0]}
        figure = small_figure(experiment.time, [(f"{output} [{units[output]}]", lines)])
        rows = [(name, f"{error:.4g}", units[name]) for name, error in self.rmse("identify").items()]
        effects = f"With {', '.join(map(str, self.effects))}." if self.effects else "Without effects."
        title = f"Stage '{self.name}'"
        header = ("output", "root mean square error", "unit")
        return notebook_view(title, rows, header=header, text=f"{effects} Record '{experiment.name}':", figure=figure)

    def __repr__(self) -> str:
        errors = ", ".join(f"{n}: {e:.4g} {self.system.unit(n)}" for n, e in self.rmse("identify").items())
        return f"Stage({self.name!r}, {count_text(len(self.effects), 'effect')}, RMS errors: {errors})"

    # ---------------------------------------------------------------- computed once

    def without_results(self) -> Stage:
        """Return the same stage with nothing computed of it yet."""
        return replace(self, _results={})

    def forget_results(self, but: Sequence[Stage]) -> None:
        """Free what was computed of this stage, unless it is one of some stages or shares its results with one."""
        if all(s._results is not self._results for s in but):
            self._results.clear()

    def once(self, key: Any, compute: Callable[[], Result]) -> Result:
        """Return something that is computed of this stage, once; ``key`` begins with a word of its own."""
        if key not in self._results:
            self._results[key] = compute()
        result: Result = self._results[key]
        return result

    @property
    def scan_preparation(self) -> Preparation:
        """The preparation for a scan: that of the study, decimated further where there are many samples."""
        fits = self.identify.fits
        given = fits[0].experiment.preparation
        rows = sum(f.residual.size for f in fits)
        factor = max(1, int(np.ceil(rows / SCAN_ROWS)))
        shortest = min(f.residual.shape[0] for f in fits)
        factor = min(factor, max(1, shortest // 200))
        if factor == 1:
            return given
        low_pass = given.low_pass_hz
        if low_pass is not None and not low_pass * 2 * factor * given.decimate < fits[0].experiment.record.rate:
            low_pass = None
        return Preparation(
            start=given.start, stop=given.stop, low_pass_hz=low_pass, decimate=given.decimate * factor, edge=given.edge
        )

    def linearised_problem(self, preparation: Preparation | None = None) -> LinearisedProblem:
        """Return the model linearised along its identification records.

        Parameters
        ----------
        preparation : Preparation, optional
            Default: `scan_preparation`.
        """
        preparation = preparation or self.scan_preparation
        return self.once(
            ("linearised problem", preparation),
            lambda: LinearisedProblem(
                system=self.system,
                slim=self.slim,
                calibration=self.identify,
                sensors=self.sensors,
                preparation=preparation,
                p=self.p,
                noise=self.noise,
            ),
        )

    def weighted_problem(self) -> LinearisedProblem:
        """Return the linearised problem, weighted where the effect of a disturbance accumulates along the records."""

        def weighted() -> LinearisedProblem:
            linearised = self.linearised_problem()
            disturbance = self.once("disturbance", lambda: accumulating_disturbance(linearised))
            return linearised.weighted_by(disturbance.weighting) if disturbance is not None else linearised

        return self.once("weighted problem", weighted)

    @property
    def disturbance(self) -> DisturbanceForce | None:
        """The disturbance that `weighted_problem` was weighted for; None where there is none or it was not computed."""
        return self._results.get("disturbance")

    def weighted_residuals(self, disturbance: DisturbanceForce) -> list[np.ndarray]:
        """Return each identification record's residual, weighted for a disturbance and free of calibration."""
        linearised = self.linearised_problem(disturbance.preparation)
        return self.once(("weighted residuals", disturbance), lambda: weighted_residuals(linearised, disturbance))

    def free_curve_scan(
        self,
        *,
        level: float,
        seed: int,
        where: Sequence[str] | None = None,
        progress: Callable[[str], None] = lambda text: None,
    ) -> FreeCurveScan:
        """Score free curves at all places, or at some, on the weighted problem."""

        def scanned() -> FreeCurveScan:
            count = sum(1 for p in self.system.places if where is None or p.name in where)
            progress(f"free curves at {count} places")
            return scan_free_curves(self.weighted_problem(), self.effects, level=level, seed=seed, where=where)

        return self.once(("free curve scan", level, seed, tuple(where) if where is not None else None), scanned)

    def free_curve_error_drops(self) -> dict[tuple[str, str], np.ndarray]:
        """Return the share of each output's residual energy that every free curve would take away.

        Returns
        -------
        dict of (str, str) to ndarray, shape (n_channels,)
            By place and argument.
        """
        return self.once("free curve drops", lambda: free_curve_error_drops(self.weighted_problem()))

    def trial_fit(self, name: str, effects: tuple[Effect, ...], fit: Callable[[], Stage]) -> Stage:
        """Return the trial fit of a model with some effects that begins at this stage; ``fit`` is called at most once.

        Effects count as equal when their values agree to nine digits: the same amplitude from a scan of other
        candidates differs by rounding.
        """
        values = tuple((e.over, *((k, f"{v:.9g}") for k, v in e.parameters().items())) for e in effects)
        return self.once(("trial fit", name, values), fit)


def comparable_residuals(one: Stage, other: Stage) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the residuals of two stages on the identification records, each a list of (n, n_channels).

    Where the effect of a disturbance accumulates along the records of either, both are weighted for it alike.
    """
    disturbance = other.disturbance or one.disturbance
    if disturbance is None:
        return [f.residual for f in one.identify.fits], [f.residual for f in other.identify.fits]
    return one.weighted_residuals(disturbance), other.weighted_residuals(disturbance)
