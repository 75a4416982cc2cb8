"""One stage of a study: a model with its effects, fitted, beside the records it was fitted to and those held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.effects.effect import Effect

if TYPE_CHECKING:
    from discrepancy.statistics.scan import ScanResult
    from estimation.fit.calibrate import Calibration, Fit
    from estimation.response.experiment import SensorError
    from multibody.model.model import Model
    from multibody.system.system import System

__all__ = ["Accepted", "Rival", "Stage"]


@dataclass(frozen=True)
class Rival:
    """Another explanation of what an accepted effect explains.

    Parameters
    ----------
    kind, where : str
    delta_bic : float
        BIC of this explanation minus that of the accepted one, after full refits where both were refitted.
    refitted : bool
        True when the figure comes from a refit, False when from the linear scan.
    indistinguishable : bool
        True when these records cannot tell the two apart.
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


@dataclass(frozen=True)
class Accepted:
    """Why an effect was added.

    Parameters
    ----------
    effect : Effect
    p_value : float
        Family-wise probability of a score like this by luck, over all candidates.
    delta_bic : float
        Change of BIC by adding it, with the effective number of observations.
    rivals : tuple of Rival
        In the order of their BIC.
    hidden_by : str
        ``kind@where`` of the other effect, of two that hide each other and were added together.
    """

    effect: Effect
    p_value: float
    delta_bic: float
    rivals: tuple[Rival, ...] = ()
    hidden_by: str = ""

    @property
    def ambiguous(self) -> bool:
        """True if another *kind* of effect cannot be told from this one."""
        return any(r.indistinguishable and r.kind != self.effect.kind for r in self.rivals)


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage: as given, recalibrated, or with one more effect.

    Parameters
    ----------
    name : str
        ``"as given"``, ``"recalibrated"`` or ``"+ kind@where"``.
    model : Model
        With its effects in it, at the fitted values.
    system : System
        Of that model, with probes and the outputs that tell the motion of every place.
    slim : System
        The same with the measured outputs only: what is simulated again and again.
    effects : tuple of Effect
        Effects in the model, at the fitted values.
    accepted : Accepted or None
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
        What the scan of this stage found.
    notes : tuple of str
        What a reader should know about it.
    machine : Model or None
        What the study was given, with the effects, the fitted values and the sensors' errors: the model to save, also
        where ``model`` has its motion prescribed.  None for a trial.
    worked_out : dict
        What is asked of this machine more than once: its columns, its free curves, refits from here.
    """

    name: str
    model: Model
    system: System
    slim: System
    effects: tuple[Effect, ...]
    accepted: Accepted | None
    identify: Calibration
    validate: Calibration | None
    sensors: tuple[SensorError, ...]
    p: np.ndarray
    noise: Mapping[str, float]
    scan: ScanResult | None = None
    notes: tuple[str, ...] = field(default=())
    machine: Model | None = None
    worked_out: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the measured outputs."""
        return self.identify.fits[0].experiment.outputs

    @property
    def half(self) -> bool:
        """True where the effect that hides the accepted one is still to come: alone it is half of an answer."""
        hidden_by = self.accepted.hidden_by if self.accepted is not None else ""
        return bool(hidden_by) and hidden_by not in map(str, self.effects)

    def fits(self, part: str) -> tuple[Fit, ...]:
        """Return the fits of ``"identify"`` or ``"validate"`` (empty when nothing is held out)."""
        found = self.identify if part == "identify" else self.validate
        return found.fits if found is not None else ()

    def rmse(self, part: str) -> dict[str, float]:
        """Return the root mean square error of every output over all records of a part, SI."""
        fits = self.fits(part)
        if not fits:
            return {}
        stacked = np.concatenate([f.residual for f in fits])
        return dict(zip(self.outputs, np.sqrt(np.mean(stacked**2, axis=0)).tolist(), strict=True))
