"""How figures look: colours that stay apart in grey and for the colour-blind, labels with units.

Figures are made without pyplot, so that nothing global is opened, changed or left behind.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from multibody.base.quantity_text import unit_text
from multibody.base.thinning import extreme_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "AFTER",
    "BEFORE",
    "FLOOR",
    "MEASURED",
    "drawing",
    "label",
    "new_figure",
    "noise_band",
    "plain_log",
    "thinned",
    "wants_log",
]

P = ParamSpec("P")

# Okabe and Ito's colours; their lightness differs, and every pair also differs in line style or marker.
MEASURED: dict[str, Any] = {"color": "#000000", "linewidth": 2.4, "linestyle": "-"}
BEFORE: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.1, "linestyle": (0, (5, 1.6))}
AFTER: dict[str, Any] = {"color": "#0072B2", "linewidth": 1.1, "linestyle": "-"}
FLOOR: dict[str, Any] = {"color": "#777777", "linewidth": 1.1, "linestyle": ":"}
WIDTH = 5.8
_RULES: Any = {
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "legend.fontsize": 9.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "font.family": "DejaVu Sans",
}


ACROSS, LEGEND = 24, 40  # characters beside an axis and in one of two columns under it


def drawing(make: Callable[P, Figure]) -> Callable[P, Figure]:
    """Let a function draw with this package's rules, and leave matplotlib's own as they were."""

    @wraps(make)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        import matplotlib

        with matplotlib.rc_context(_RULES):
            return make(*args, **kwargs)

    return drawn


def new_figure(
    rows: int, columns: int = 1, height: float = 2.3, width: float = WIDTH, **options: Any
) -> tuple[Figure, np.ndarray]:
    """Return a figure and its axes, shape (rows, columns), without pyplot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def label(name: str, unit: str) -> str:
    """Return a name with its unit in brackets."""
    return f"{name} [{unit_text(unit)}]" if unit else f"{name} [–]"


def wrapped(text: str, most: int = ACROSS) -> str:
    """Return a text on lines of at most so many characters where it can be cut: at spaces, else after points.

    Examples
    --------
    >>> wrapped("body_sensor.acceleration [m/s²]").splitlines()
    ['body_sensor.acceleration', '[m/s²]']
    >>> wrapped("needed.bearing.torque", 16).splitlines()
    ['needed.bearing.', 'torque']
    """
    parts = [p for word in text.split(" ") for p in _cut(word, most)]
    lines = [parts[0]]
    for part in parts[1:]:
        gap = "" if lines[-1].endswith(".") else " "
        if len(lines[-1]) + len(gap) + len(part) <= most:
            lines[-1] += gap + part
        else:
            lines.append(part)
    return "\n".join(lines)


def _cut(word: str, most: int) -> list[str]:
    """Return a word whole, or cut after its points if it is too long."""
    if len(word) <= most:
        return [word]
    *first, last = word.split(".")
    return [*(f"{p}." for p in first), last]


def wants_log(values: Any, factor: float = 8.0) -> bool:
    """Tell whether positive values span so much that a linear axis would hide the small ones."""
    v = np.asarray(values, dtype=float)
    v = v[np.isfinite(v) & (v > 0.0)]
    return bool(v.size > 1 and v.max() > factor * v.min())


def plain_log(axes: Axes, low: float, high: float) -> None:
    """Make the vertical axis logarithmic, with its numbers written out."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.set_ylim(low, high)
    subs = (1.0, 2.0, 5.0) if high < 60.0 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="minor", axis="y", alpha=0.4)


def thinned(time: np.ndarray, values: np.ndarray, most: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Return a series thinned for drawing: smallest and largest of each stretch, so no peak is lost."""
    rows = extreme_rows(values, most)
    return time[rows], values[rows]


def noise_band(axes: Axes, noise: float | None) -> None:
    """Draw the band of ±2 standard deviations of the noise."""
    if noise:
        axes.axhspan(
            -2.0 * noise,
            2.0 * noise,
            color="#cccccc",
            alpha=0.6,
            linewidth=0,
            label="±2 × noise of the sensor",
        )
