"""What a notebook shows of a result: a title, a short table, a sentence and a small figure, as one piece of HTML."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.thinning import extreme_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["notebook_view", "small_figure"]

#: Colours of Okabe and Ito that differ in lightness, and the dashes that tell lines apart without colour.
STYLES: tuple[tuple[str, Any], ...] = (("#000000", "-"), ("#D55E00", (0, (5, 1.6))), ("#0072B2", "-"), ("#009E73", ":"))
_TABLE = "border-collapse:collapse;margin:4px 0;font-size:90%;overflow-wrap:normal"
_CELL = "padding:1px 10px 1px 0;vertical-align:top"


def notebook_view(
    title: str,
    rows: Sequence[Sequence[str]] = (),
    *,
    header: Sequence[str] = (),
    text: str = "",
    figure: Figure | None = None,
) -> str:
    """Return the HTML of a result.

    Parameters
    ----------
    title : str
    rows : sequence of sequence of str
        Cells, line by line; the first is text, the others are aligned as numbers.
    header : sequence of str
        Of the columns.
    text : str
        A sentence below the title.
    figure : Figure, optional
    """
    parts = [f"<div style='max-width:min(52em,100%);overflow-wrap:anywhere'><strong>{escape(title)}</strong>"]
    if text:
        parts.append(f"<p style='margin:4px 0'>{escape(text)}</p>")
    lines = [_line("th", header)] if header else []
    lines += [_line("td", row) for row in rows]
    if lines:
        parts.append(
            f"<div style='overflow-x:auto;max-width:100%'><table style='{_TABLE}'>{''.join(lines)}</table></div>"
        )
    if figure is not None:
        buffer = io.BytesIO()
        figure.savefig(buffer, dpi=100)
        source = base64.b64encode(buffer.getvalue()).decode("ascii")
        alt = escape(title, quote=True)
        parts.append(f"<img style='max-width:100%' alt='{alt}' src='data:image/png;base64,{source}'>")
    return "".join(parts) + "</div>"


def _line(tag: str, cells: Sequence[str]) -> str:
    first, *others = cells
    whole = ";white-space:nowrap" if tag == "td" else ""  # a number in two lines is another number
    return (
        f"<tr><{tag} style='{_CELL};text-align:left'>{escape(first)}</{tag}>"
        + "".join(f"<{tag} style='{_CELL};text-align:right{whole}'>{escape(cell)}</{tag}>" for cell in others)
        + "</tr>"
    )


def small_figure(
    x: np.ndarray,
    panels: Sequence[tuple[str, Mapping[str, np.ndarray]]],
    *,
    across: str = "time [s]",
    marker: str = "",
    ticks: Sequence[str] = (),
) -> Figure:
    """Return a small figure of lines over one axis, made without pyplot.

    Parameters
    ----------
    x : ndarray, shape (n,)
    panels : sequence of (str, mapping of str to ndarray of shape (n,))
        One above the other: label of the vertical axis, and its lines.
    across : str
        Label of the horizontal axis.
    marker : str
        Of the points, where they are few.
    ticks : sequence of str
        Words at each x instead of its number.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 0.6 + 1.25 * len(panels)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for a, (label, lines) in zip(axes, panels, strict=True):
        for k, (name, y) in enumerate(lines.items()):
            rows = extreme_rows(y, 1500)
            colour, dashes = STYLES[k % len(STYLES)]
            a.plot(x[rows], y[rows], label=name, color=colour, linestyle=dashes, linewidth=1.1, marker=marker)
        a.set_ylabel(label, fontsize=8)
        a.tick_params(labelsize=8)
        a.grid(alpha=0.3)
        a.spines[["top", "right"]].set_visible(False)
        if len(lines) > 1:
            a.legend(fontsize=7, loc="best", frameon=False)
    axes[-1].set_xlabel(across, fontsize=8)
    if ticks:
        axes[-1].set_xticks(x, ticks, fontsize=7)
    return figure
