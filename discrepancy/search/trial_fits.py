"""Fits on trial with one effect more: where they begin, and which of several for one candidate is kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

from discrepancy.effects.from_scan_row import effect_of
from discrepancy.search.model_comparison import bic_difference
from discrepancy.stages.stage import Stage
from multibody.base.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Callable

    from discrepancy.effects.catalogue import Entry
    from discrepancy.effects.effect import Effect
    from discrepancy.statistics.scan_result import ScanRow

__all__ = ["Fit", "Refit", "best_of", "fits_with", "tried"]


class Fit(Protocol):
    """Fits a stage on trial, given its name, its effects, and the stage from where it begins."""

    def __call__(self, name: str, effects: tuple[Effect, ...], start: Stage, /) -> Stage: ...


def tried(
    fit: Fit, name: str, effects: tuple[Effect, ...], start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None, saying why, where the machine cannot be simulated or built with them."""
    try:
        return fit(name, effects, start)
    except (RuntimeError, ModelError) as error:
        progress(f"{' and '.join(map(str, effects))} could not be simulated: {error}")
        return None


class Refit(Protocol):
    """Adds an effect to a stage's model in the place of others, and fits everything again.

    With ``stated`` the fit begins where the parameters were stated, else where the stage's fit has put them.
    """

    def __call__(self, effect: Effect, instead_of: Sequence[Effect] = (), stated: bool = False) -> Stage: ...


def fits_with(
    refit: Refit,
    entry: Entry,
    row: ScanRow,
    shapes: Sequence[Mapping[str, float]],
    effects: Sequence[Effect],
    simpler: Sequence[Effect] = (),
    *,
    anew: bool = False,
) -> list[Callable[[], Stage]]:
    """Return the fits with one candidate: from where the parameters are, and anew from where they were stated.

    A play that is missing in the model has been replaced by other parameters as well as they can, by a softer spring
    for instance, and from there no small step leads to the play.  So for a law that is not linear in its strength fits
    begin at the strengths that the scan has looked at as well, with the parameters as stated.

    Parameters
    ----------
    refit : Refit
    entry : Entry
        Of the catalogue.
    row : ScanRow
        What the scan expects.
    shapes : sequence of mapping
        That the scan has looked at.
    effects : sequence of Effect
        That the model has already.
    simpler : sequence of Effect
        Those of them in whose place the candidate is put.
    anew : bool
        Whether the fit of a linear law begins from the stated parameters as well.
    """
    expected = effect_of(entry, row, effects, simpler)
    fits: list[Callable[[], Stage]] = [partial(refit, expected, simpler)]
    if entry.kind.linear:
        starts = [expected] if anew else []
    else:
        sizes = sorted({float(s["secant"]) for s in shapes if s.get("secant", 0.0) > 0.0})
        starts = [replace(expected, strengths=dict.fromkeys(expected.strengths, z)) for z in sizes] or [expected]
    return [*fits, *(partial(refit, start, simpler, stated=True) for start in starts)]


def best_of(
    fits: Sequence[Callable[[], Stage]], stage: Stage, progress: Callable[[str], None]
) -> Stage | ModelError | None:
    """Return the best of some fits; None if none can be simulated, the error if the model cannot be built.

    A fit that puts every strength of its effect to nothing explains nothing: the law would have to act the other way
    round than it can, as a sensor that is early.

    Parameters
    ----------
    fits : sequence of callable
        Each returns a fitted stage.
    stage : Stage
        That they all begin from.
    progress : callable
    """
    found: list[Stage] = []
    for fit in fits:
        try:
            found.append(fit())
        except RuntimeError as error:  # a simulation that fails is a bad explanation, not the end of the search
            progress(f"it could not be simulated: {error}")
        except ModelError as error:  # say an algebraic loop: these records cannot speak about it in this model
            return error
    there = [s for s in found if not s.effects or any(s.effects[-1].strengths.values())]
    return min(there, key=lambda s: bic_difference(s, stage), default=None)
