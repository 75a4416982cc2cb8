"""Remove an effect that later ones have made redundant."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from discrepancy.effects.effect import Effect
from discrepancy.search.fits_on_trial import TrialFit
from discrepancy.search.model_comparison import bic_difference
from discrepancy.stages.stage import Stage

__all__ = ["find_redundant_effect"]


def find_redundant_effect(
    stages: Sequence[Stage], fit: TrialFit, progress: Callable[[str], None]
) -> tuple[Stage, Effect] | None:
    """Return the last stage without an effect that later ones made redundant, and that effect; else None."""
    last = stages[-1]
    if len(last.effects) < 2:
        return None
    for k, effect in enumerate(last.effects[:-1]):
        rest = tuple(e for j, e in enumerate(last.effects) if j != k)
        progress(f"is {effect} still needed?")
        try:
            without = fit(last.name, rest, last)
        except RuntimeError as error:  # the model needs it to follow its inputs at all
            progress(f"without {effect} the machine could not be simulated: {error}")
            continue
        if bic_difference(last, without) > 0.0:
            return without, effect
    return None
