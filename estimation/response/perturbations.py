"""Small additions whose effect on a machine's outputs is asked for: to an input over time, to a parameter for good."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Change", "Push"]


@dataclass(frozen=True, eq=False)
class Push:
    """A small extra signal on a model input over time, whose effect on the outputs is asked for.

    Parameters
    ----------
    channel : str
        Model input, for instance ``"probe.guide"``.
    values : ndarray, shape (nt,)
        On the record's time grid.
    """

    channel: str
    values: np.ndarray


@dataclass(frozen=True)
class Change:
    """A small change of a parameter that lasts, whose effect on the outputs is asked for per unit of it.

    Parameters
    ----------
    parameter : str
        Not how late an input is.
    beside : tuple of (str, float)
        Parameters that have other values meanwhile.  Without the change the machine must move alike with them: they
        give an effect that is absent its shape.
    """

    parameter: str
    beside: tuple[tuple[str, float], ...] = ()
