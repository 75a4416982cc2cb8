"""Numbers and probabilities in words for a mechanical engineer."""

from __future__ import annotations

import math

from discrepancy.stages.stage import RivalExplanation
from multibody.base.quantity_text import number_text, quantity_text, readable_scale

__all__ = [
    "chance_words",
    "interval_words",
    "ratio_words",
    "rival_words",
    "share_words",
]


def interval_words(value: float, low: float, high: float, unit: str) -> str:
    """Return a value with its interval, rounded to what the interval supports.

    Examples
    --------
    >>> interval_words(12.0123, 11.93, 12.09, "N")
    '12.01 N (95 % interval 11.93 to 12.09 N)'
    >>> interval_words(3.2, -100.0, 106.0, "N")
    '3.2 N (95 % interval −100 to 106 N: these records hardly determine it)'
    """
    half = 0.5 * (high - low)
    if not math.isfinite(half) or half <= 0.0:
        return f"{quantity_text(value, unit)} (no interval: these records do not determine it)"
    factor, text = readable_scale(max(abs(value), half), unit)
    lead = math.floor(math.log10(half / factor))
    places = max(0, (1 if half / factor < 3.0 * 10.0**lead else 0) - lead)
    if places > 9:
        return f"{quantity_text(value, unit, 9)} (95 % interval far narrower than the last digit)"
    a, b = (f"{x / factor:.{places}f}".replace("-", "−") for x in (low, high))
    uncertain = abs(value) < half
    v = number_text(value / factor, 2) if uncertain else f"{value / factor:.{places}f}".replace("-", "−")
    words = f"{v} {text} (95 % interval {a} to {b} {text}".rstrip() + ")"
    return (words[:-1] + ": these records hardly determine it)" if uncertain else words).replace("  ", " ")


def chance_words(p: float) -> str:
    """Return in words how probable such a result is by chance alone.

    Examples
    --------
    >>> chance_words(0.004)
    'by chance alone, such a result would occur in about one of 250 studies of a correct model'
    """
    if not math.isfinite(p):
        return "its probability by chance alone was not computed"
    if p < 1e-6:
        return "chance alone can be ruled out (probability below one in a million)"
    if p < 0.5:
        once = 1.0 / p
        size = round(once, 1 - math.floor(math.log10(once)))
        return (
            f"by chance alone, such a result would occur in about one of {f'{size:,.0f}'.replace(',', ' ')} studies "
            "of a correct model"
        )
    return "by chance alone, such a result would occur more often than not"


def ratio_words(before: float, after: float) -> str:
    """Return how an error changed, in words.

    Examples
    --------
    >>> ratio_words(10.0, 2.0), ratio_words(10.0, 9.99), ratio_words(1.0, 1.2)
    ('falls by 80 %', 'hardly changes', 'grows by 20 %')
    """
    if before <= 0.0:
        return "was zero before"
    change = after / before - 1.0
    if abs(change) < 0.005:
        return "hardly changes"
    return f"{'falls' if change < 0 else 'grows'} by {share_words(abs(change))}"


def share_words(share: float) -> str:
    """Return a share in per cent, without rounding almost all to all.

    Examples
    --------
    >>> share_words(0.5), share_words(0.99982), share_words(0.0004)
    ('50 %', '99.98 %', 'less than 0.1 %')
    """
    percent = 100.0 * share
    if percent >= 99.995:
        return "more than 99.99 %"
    if percent > 99.0:
        return f"{percent:.2f} %"
    if 0.0 <= percent < 0.1:
        return "less than 0.1 %"
    return f"{percent:.1f} %" if abs(percent) < 10.0 else f"{percent:.0f} %"


def rival_words(rival: RivalExplanation) -> str:
    """Return how much worse another explanation is, in words."""
    how = "" if rival.refitted else " (estimated; not fitted in full)"
    if rival.indistinguishable:
        return f"these records cannot distinguish it from the chosen one{how}"
    if not math.isfinite(rival.delta_bic):
        return f"worse{how}"
    if rival.delta_bic > 10.0:
        return f"clearly worse{how}"
    if rival.delta_bic > 3.0:
        return f"worse{how}"
    return f"slightly worse{how}"
