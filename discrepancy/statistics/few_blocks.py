"""What a standard error says that is itself known from a few blocks only."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm, t

__all__ = ["in_normal_errors"]


def in_normal_errors(errors: float, blocks: int) -> float:
    """Return the multiple of a standard error that is as improbable as so many of a normal distribution.

    Parameters
    ----------
    errors : float
        Standard errors of a normal distribution.
    blocks : int
        From whose spread the standard error of their sum or mean was computed (Student's t).

    Examples
    --------
    >>> round(in_normal_errors(2.0, 4), 2), round(in_normal_errors(1.645, 8), 2)
    (3.31, 1.89)
    """
    return float(t.ppf(norm.cdf(errors), blocks - 1)) if blocks > 1 else np.inf
