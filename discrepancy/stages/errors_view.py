"""What a notebook shows of several stages: the error of every output from stage to stage, and a small figure of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discrepancy.stages.stage import Stage
from multibody.base.notebook import notebook_view, small_figure
from multibody.base.quantity_text import unit_text

__all__ = ["errors_view"]

MOST_LINES = 4  # lines that stay apart in a small figure


def errors_view(title: str, stages: Sequence[Stage], text: str = "") -> str:
    """Return the HTML of a title, a sentence, and the errors of some stages, on held-out records where there are any.

    Parameters
    ----------
    title : str
    stages : sequence of Stage
        None at all before the first fit.
    text : str
    """
    if not stages:
        return notebook_view(title, text=f"{text} Nothing is fitted yet.")
    part, words = ("validate", "held out") if stages[0].fits("validate") else ("identify", "fitted")
    outputs = stages[0].outputs
    errors = {name: np.array([stage.rmse(part)[name] for stage in stages]) for name in outputs}
    units = {name: unit_text(stages[0].system.unit(name)) or "1" for name in outputs}
    header = (f"RMS error, {words}", *(f"{name} [{units[name]}]" for name in outputs))
    rows = [(stage.name, *(f"{errors[name][k]:.4g}" for name in outputs)) for k, stage in enumerate(stages)]
    if len(outputs) > MOST_LINES:  # stages side by side: a column for each of so many outputs would not fit
        columns = list(zip(header, *rows, strict=True))
        header, rows = columns[0], columns[1:]
    figure = None
    if len(stages) > 1:
        changed = {name: 100.0 * e / e[0] for name, e in errors.items() if e[0] > 0.0}
        most = sorted(changed, key=lambda name: -float(np.ptp(changed[name])))[:MOST_LINES]
        shown = {name: e for name, e in changed.items() if name in most}
        if len(shown) < len(outputs):
            text = f"{text} Drawn are the {len(shown)} of {len(outputs)} outputs whose error changed most.".strip()
        ticks = [_short(stage.name) for stage in stages]
        x = np.arange(len(stages), dtype=float)
        figure = small_figure(x, [("error [% of as given]", shown)], across="", marker="o", ticks=ticks)
    return notebook_view(title, rows, header=header, text=text, figure=figure)


def _short(name: str) -> str:
    """Return a stage's name in two lines where it is long."""
    return name.replace("@", "\n@") if len(name) > 18 else name
