"""A quantity over months as a small drawing: values, posterior with its interval, changes, the fleet's threshold."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from html import escape

import numpy as np

from multibody.base.quantity_text import quantity_text, readable_scale, unit_text
from operation.follow.watch import Trace

__all__ = ["trend_svg"]

WIDTH, HEIGHT = 300, 96
LEFT, RIGHT, TOP, BOTTOM = 38, 4, 18, 14  # numbers of the axis stand left of the field
#: Points that are drawn at most: more cannot be told apart at this size.
MOST = 400


def trend_svg(trace: Trace, threshold: float | None = None) -> str:
    """Return the drawing as SVG.

    Parameters
    ----------
    trace : Trace
    threshold : float, optional
        A level to compare with, in the trace's unit.
    """
    known = np.isfinite(trace.values)
    times, values = trace.times[known], trace.values[known]
    if times.size == 0:
        return ""
    every = max(1, times.size // MOST)
    times, values = times[::every], values[::every]
    shown = [values]
    if threshold is not None:
        shown.append(np.array([threshold]))
    low, high = float(min(map(np.min, shown))), float(max(map(np.max, shown)))
    margin = 0.08 * (high - low) or 0.05 * max(abs(high), 1e-12)
    low, high = low - margin, high + margin
    first, last = float(times[0]), float(max(times[-1], times[0] + 1.0))

    def x(t: float) -> float:
        return LEFT + (t - first) / (last - first) * (WIDTH - LEFT - RIGHT)

    def y(v: float) -> float:
        return TOP + (high - min(max(v, low), high)) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = [
        f'<svg class="trend" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(trace.name)} over time">',
        f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{HEIGHT - TOP - BOTTOM}" class="field"/>',
    ]
    if trace.level is not None and trace.kind == "parameter":
        mean, std = trace.level.mean[known][::every], trace.level.std[known][::every]
        ok = np.isfinite(mean) & np.isfinite(std)
        if np.any(ok):
            ahead = [f"{x(t):.1f},{y(m + 2 * s):.1f}" for t, m, s in zip(times[ok], mean[ok], std[ok], strict=True)]
            back = [f"{x(t):.1f},{y(m - 2 * s):.1f}" for t, m, s in zip(times[ok], mean[ok], std[ok], strict=True)]
            parts.append(f'<polygon points="{" ".join(ahead + back[::-1])}" class="band"/>')
    if threshold is not None:
        parts.append(
            f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(threshold):.1f}" y2="{y(threshold):.1f}" class="limit"/>'
        )
    for change in trace.changes:
        at = x(change.since)
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}" class="change"/>')
    parts += [f'<circle cx="{x(t):.1f}" cy="{y(v):.1f}" r="1.6"/>' for t, v in zip(times, values, strict=True)]
    factor, unit = readable_scale(max(abs(low), abs(high)), trace.unit)
    now = values[-1] / factor if factor else values[-1]
    label = (
        f"{now:.3g} {unit_text(unit)}".strip() if math.isfinite(now) else quantity_text(float(values[-1]), trace.unit)
    )
    name = trace.name if len(trace.name) < 40 else trace.name[:38] + "…"
    parts.append(f'<text x="{RIGHT}" y="12">{escape(name)}</text>')
    parts.append(f'<text x="{WIDTH - RIGHT}" y="12" text-anchor="end" class="now">{escape(label)}</text>')
    for value, at in ((high, TOP + 9), (low, HEIGHT - BOTTOM - 3)):
        parts.append(
            f'<text x="{LEFT - 4}" y="{at}" text-anchor="end" class="axis">{value / (factor or 1.0):.3g}</text>'
        )
    parts.append(f'<text x="{LEFT}" y="{HEIGHT - 3}" class="axis">{_day(first)}</text>')
    parts.append(f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 3}" text-anchor="end" class="axis">{_day(last)}</text>')
    return "".join([*parts, "</svg>"])


def _day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")
