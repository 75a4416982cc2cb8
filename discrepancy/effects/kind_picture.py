"""The picture of a kind of effect, drawn from its own law."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.figure_style import AFTER, BEFORE
from discrepancy.effects.built_in_kinds import BUILT_IN_KINDS
from discrepancy.effects.kinds import Kind
from discrepancy.effects.law_along_motion import law_forces
from discrepancy.effects.shape_grids import MotionRange
from discrepancy.effects.signal_errors import signal_error
from discrepancy.effects.stated_values import STATED_KINDS
from estimation.response.sensors import SensorError, apply_sensors
from multibody.library.laws import leakage, pipe_flow, radiated, voltage_drop

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["has_picture", "kind_picture"]

RANGE = MotionRange(low=-0.1, high=0.1, speed=0.3, scale=50.0, duration=6.0, step=0.02)
TIME = np.linspace(0.0, 6.0, 601)
CURVES = {
    "brush_voltage_drop": ("current", "voltage lost", lambda x: np.array([voltage_drop(i, 0.6, 0.1) for i in x])),
    "inverter_dead_time": ("current", "voltage lost", lambda x: 0.6 * x / np.sqrt(x * x + 0.01)),
    "laminar_leakage": ("pressure", "leakage", lambda x: np.array([leakage(p, 0.7, 0.0, 0.01) for p in x])),
    "turbulent_leakage": ("pressure", "leakage", lambda x: np.array([leakage(p, 0.0, 0.7, 0.01) for p in x])),
    "flow_loss": ("pressure", "flow", lambda x: np.array([pipe_flow(p, 1.0, 2.0) for p in x])),
    "heat_loss": ("temperature above ambient", "heat lost", lambda x: 0.7 * x),
    "radiation_loss": (
        "temperature above ambient",
        "heat lost",
        lambda x: np.array([radiated(1.0 + t, 1.0, 0.25) for t in x]),
    ),
}


def has_picture(kind: Kind) -> bool:
    """Tell whether a kind can be drawn: a curve given by points cannot, nor can a part that others have written."""
    parts = {k.name for k in (*BUILT_IN_KINDS, *STATED_KINDS)}
    return not kind.free_form and (kind.at != "parameter" or kind.name in parts)


def kind_picture(kind: Kind) -> str:
    """Return the picture of a kind as SVG: what it does, and the machine without it as a dashed line.

    Parameters
    ----------
    kind : Kind
        One of which `has_picture` is true.
    """
    import matplotlib
    from matplotlib.figure import Figure

    fixed: Any = {"svg.hashsalt": kind.name, "svg.fonttype": "path", "font.size": 9.0}
    with matplotlib.rc_context(fixed):
        figure = Figure(figsize=(5.6, 1.9), layout="constrained")
        panels = figure.subplots(1, 2) if kind.at == "connection" else [figure.subplots()]
        (_draw_law if kind.at == "connection" else _draw_signal if kind.at != "parameter" else _draw_part)(kind, panels)
        for axes in panels:
            axes.set(xticks=[], yticks=[])
            axes.spines[["top", "right"]].set_visible(False)
        written = io.StringIO()
        figure.savefig(written, format="svg", metadata={"Date": None})
    return written.getvalue()


def _draw_law(kind: Kind, panels: Sequence[Axes]) -> None:
    """Force against speed and against position, over a few slow strokes of growing size."""
    w, grow = 2.0 * np.pi / 2.0, 0.4 + 0.6 * TIME / TIME[-1]
    size = 0.1 * (grow if kind.law in ("Hysteresis", "Slip", "Backlash") else np.ones_like(TIME))
    position = size * np.sin(w * TIME)
    motion = {
        "position": position,
        "velocity": np.gradient(position, TIME),
        "acceleration": np.gradient(np.gradient(position, TIME), TIME),
        "load": 1.0 + 0.8 * np.sin(0.61 * w * TIME) if kind.law_input == "load" else 293.15 + 3.0 * TIME,
    }
    grid = kind.shape_grid(RANGE)
    shape = {k: v for k, v in grid[len(grid) // 2].items() if k != "amplitude"} if grid[0] else {}
    if "order" in shape:
        shape["order"] = 2.0 * np.pi / 0.07  # three waves in the travel
    if "natural_frequency" in shape:
        shape["natural_frequency"] = 1.6 * w
    strengths = {s: 1.0 if k == 0 else 0.4 for k, s in enumerate(kind.strengths)}
    strengths |= {"gap": 0.1} if "gap" in strengths else {}
    force = law_forces(kind, TIME, motion, [shape], [strengths])[0]
    for axes, over, name in zip(panels, (motion["velocity"], position), ("speed", "position"), strict=True):
        axes.axhline(0.0, **BEFORE)
        axes.plot(over, force, **AFTER)
        axes.set(xlabel=name, ylabel="force")


def _draw_signal(kind: Kind, panels: Sequence[Axes]) -> None:
    """A step and a swing, and how they come through."""
    time = np.linspace(0.0, 3.0, 901)
    true = np.interp(time, [0.0, 0.5, 0.55, 1.3, 1.35, 3.0], [0.0, 0.0, 1.0, 1.0, 0.4, 0.4])
    true = true + 0.3 * np.sin(7.0 * time) * (time > 1.5)
    size = {"offset": 0.25, "gain": 0.3, "delay": 0.12, "drift": 0.2, "lag": 0.12}[kind.law]
    if kind.at == "sensor":
        error = SensorError("y", kind.law, size)
        changed = apply_sensors(("y",), time, true[:, None], np.zeros((time.size, 1, 0)), [error], ())[0][:, 0]
    elif kind.law == "delay":
        changed = np.interp(time - size, time, true)
    else:
        filter_time = (0.5 if kind.at == "signal" else 1.0) * size
        changed = true + size * signal_error(kind.law, time, true, filter_time)
    panels[0].plot(time, true, **BEFORE)
    panels[0].plot(time, changed, **AFTER)
    panels[0].set(xlabel="time", ylabel="reading" if kind.at == "sensor" else "input")


def _draw_part(kind: Kind, panels: Sequence[Axes]) -> None:
    """What a part takes or gives over what acts on it, without the effect and with it."""
    axes = panels[0]
    x = np.linspace(-1.0, 1.0, 401) if kind.name not in ("heat_loss", "radiation_loss") else np.linspace(0.0, 1.0, 201)
    if kind.name in CURVES:
        along, up, curve = CURVES[kind.name]
        axes.plot(x, x if kind.name == "flow_loss" else 0.0 * x, **BEFORE)
        axes.plot(x, curve(x), **AFTER)
    else:  # a factor that is not the stated one
        along, up = "what comes in", "what goes out"
        axes.plot(x, x, **BEFORE)
        axes.plot(x, 0.7 * x, **AFTER)
    axes.set(xlabel=along, ylabel=up)
