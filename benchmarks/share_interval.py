"""The interval of a share that was counted."""

from __future__ import annotations

__all__ = ["share_interval"]


def share_interval(count: int, of: int) -> str:
    """Return the 95 % interval of Clopper and Pearson of a share, in percent."""
    from scipy.stats import beta

    low = beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return f"{100 * low:.1f} to {100 * high:.1f} %"
