"""One record beside one simulation, as the study gives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.drawing.figure_style import BEFORE, MEASURED, drawing, label, new_figure, thinned, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_figure"]


@drawing
def check_figure(
    record: str,
    time: np.ndarray,
    measured: np.ndarray,
    model: np.ndarray,
    outputs: Sequence[str],
    units: Sequence[str],
) -> Figure:
    """Draw every output of a record with the model's.

    Parameters
    ----------
    record : str
        Name of the record.
    time : ndarray, shape (n,), s
    measured, model : ndarray, shape (n, n_channels)
    outputs, units : sequence of str
    """
    figure, axes = new_figure(len(outputs), 1, height=2.2, width=8.0)
    for c, a in enumerate(np.ravel(axes)):
        a.plot(*thinned(time, measured[:, c]), label="measured", **MEASURED)
        a.plot(*thinned(time, model[:, c]), label="model as given", **BEFORE)
        a.set_ylabel(wrapped(label(outputs[c], units[c])))
        a.set_title(f"{outputs[c]} on '{record}'")
        a.set_xlabel("time [s]")
        a.legend(loc="best")
    return figure
