"""What a fitted gain error says where it is no small error: the opposite sign, another power of ten."""

from __future__ import annotations

import math

__all__ = ["gain_in_words"]

SAME = 0.05  # relative distance up to which a factor counts as the round one: a calibration is seldom worse; chosen
KNOWN_HALF_WIDTH = (
    0.3  # relative half width of the interval up to which a factor is known; powers of ten are far apart; chosen
)


def gain_in_words(gain: float, low: float, high: float) -> str:
    """Return what a relative gain error means, or an empty text where it is no round factor.

    Parameters
    ----------
    gain : float
        The reading is (1 + gain) times the true value.
    low, high : float
        Its interval.

    Examples
    --------
    >>> gain_in_words(-2.003, -2.01, -1.99)
    'with the opposite sign'
    >>> gain_in_words(998.0, 990.0, 1006.0)
    'off by a factor of 1000'
    >>> gain_in_words(-1.0095, -1.0105, -1.0085)
    'with the opposite sign and off by a factor of 1/100'
    >>> gain_in_words(0.03, 0.02, 0.04), gain_in_words(9.0, -3.0, 21.0)
    ('', '')
    """
    factor, half = 1.0 + gain, 0.5 * (high - low)
    if not math.isfinite(factor) or not math.isfinite(half) or factor == 0.0 or half > KNOWN_HALF_WIDTH * abs(factor):
        return ""
    power = round(math.log10(abs(factor)))
    if abs(abs(factor) / 10.0**power - 1.0) > max(SAME, half / abs(factor)):
        return ""
    parts = ["with the opposite sign"] if factor < 0.0 else []
    if power:
        parts.append(f"off by a factor of {'' if power > 0 else '1/'}{10 ** abs(power)}")
    return " and ".join(parts)
