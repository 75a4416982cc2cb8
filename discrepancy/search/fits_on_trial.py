"""Fits on trial: of a model with other effects, and of one candidate from several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.search.model_comparison import bic_difference
from discrepancy.stages.stage import Stage
from multibody.base.errors import ModelError

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanRow

__all__ = ["EffectFit", "TrialFit", "best_fit", "fit_on_trial", "fits_of_candidate", "fitted_present"]


class TrialFit(Protocol):
    """Fit a stage on trial, given its name, its effects, and the stage from which the fit begins."""

    def __call__(self, name: str, effects: tuple[Effect, ...], start: Stage, /) -> Stage: ...


class EffectFit(Protocol):
    """Add an effect to a stage's model, replacing others, and fit everything again on trial.

    With ``from_prior`` the fit begins from the parameters as stated, else from those of the stage's fit.
    """

    def __call__(self, effect: Effect, instead_of: Sequence[Effect] = (), from_prior: bool = False) -> Stage: ...


def fit_on_trial(
    fit: TrialFit, name: str, effects: tuple[Effect, ...], start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None, with a message, where the machine cannot be simulated or built.

    Parameters
    ----------
    fit : TrialFit
    name : str
        Of the stage.
    effects : tuple of Effect
        All that its model is to have.
    start : Stage
        From which the fit begins.
    progress : callable
    """
    try:
        return fit(name, effects, start)
    except (RuntimeError, ModelError) as error:
        progress(f"{' and '.join(map(str, effects))} could not be simulated: {error}")
        return None


def fitted_present(
    fit: TrialFit, name: str, effects: tuple[Effect, ...], new: int, start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None if it cannot be simulated, or sets one of the last ``new`` to zero.

    Other parameters as of `fit_on_trial`.
    """
    stage = fit_on_trial(fit, name, effects, start, progress)
    return stage if stage is not None and _are_present(stage.effects[-new:]) else None


def _are_present(effects: Sequence[Effect]) -> bool:
    """Tell whether each effect has a strength that is not zero, as zero is absence."""
    return all(any(e.strengths.values()) for e in effects)


def fits_of_candidate(
    refit: EffectFit,
    entry: Entry,
    row: ScanRow,
    shapes: Sequence[Mapping[str, float]],
    effects: Sequence[Effect],
    simpler: Sequence[Effect] = (),
    *,
    from_prior: bool = False,
) -> list[Callable[[], Stage]]:
    """Return the fits of one candidate: from the parameters as fitted, and from the parameters as stated.

    Calibration of a model without a backlash replaces it by other parameters as well as possible, by a softer spring
    for instance, and from there no small step leads to the backlash.  So for a law that is not linear in its strength
    fits also begin at the strengths of the scan, with the parameters as stated.

    Parameters
    ----------
    refit : EffectFit
    entry : Entry
        Of the catalogue.
    row : ScanRow
        Of the scan: the expected strengths.
    shapes : sequence of mapping
        Shape parameters of the scan.
    effects : sequence of Effect
        Already in the model.
    simpler : sequence of Effect
        Those of them that the candidate replaces.
    from_prior : bool
        Whether the fit of a linear law begins from the stated parameters as well.
    """
    expected = effect_of(entry, row, effects, simpler)
    fits: list[Callable[[], Stage]] = [partial(refit, expected, simpler)]
    if entry.kind.linear:
        starts = [expected] if from_prior else []
    else:
        sizes = sorted({float(s["amplitude"]) for s in shapes if s.get("amplitude", 0.0) > 0.0})
        starts = [replace(expected, strengths=dict.fromkeys(expected.strengths, z)) for z in sizes] or [expected]
    return [*fits, *(partial(refit, start, simpler, from_prior=True) for start in starts)]


def best_fit(
    fits: Sequence[Callable[[], Stage]], stage: Stage, progress: Callable[[str], None]
) -> Stage | ModelError | None:
    """Return the best of some fits; None if none can be simulated, the error if the model cannot be built.

    A fit that sets every strength of its effect to zero explains nothing: the law would have to act with the sign that
    it cannot have, such as a sensor that is early.

    Parameters
    ----------
    fits : sequence of callable
        Each returns a stage.
    stage : Stage
        With which they are compared.
    progress : callable
    """
    fitted: list[Stage] = []
    for fit in fits:
        try:
            fitted.append(fit())
        except RuntimeError as error:  # a simulation that fails is a bad explanation, not the end of the search
            progress(f"it could not be simulated: {error}")
        except ModelError as error:  # such as an algebraic loop: this model cannot answer for the candidate
            return error
    present = [s for s in fitted if _are_present(s.effects[-1:])]
    return min(present, key=lambda s: bic_difference(s, stage), default=None)
