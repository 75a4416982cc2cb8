"""The page of the catalogue of effects and its pictures, written from the kinds themselves."""

from __future__ import annotations

import inspect
import io
import re
from collections.abc import Callable

import numpy as np

from discrepancy.drawing.figure_style import AFTER, BEFORE
from discrepancy.effects.alike import taken_for
from discrepancy.effects.built_in_kinds import BUILT_IN_KINDS
from discrepancy.effects.effect import law_class
from discrepancy.effects.kinds import SHIPPED, Kind, kinds
from discrepancy.effects.law_along_motion import law_forces
from discrepancy.effects.shape_grids import MotionRange
from discrepancy.effects.signal_errors import signal_error
from discrepancy.effects.stated_values import STATED_KINDS
from estimation.response.sensors import SensorError, apply_sensors
from multibody.declare.signature import written_docstring
from multibody.library.laws import leakage, pipe_flow, radiated, voltage_drop

PICTURES = "images/catalogue"

INTRO = """# Catalogue of effects

What a diagnosis asks for, written from the catalogue itself. A kind is a component with a strength, and strength zero
is exactly absence. It is asked only where the machine has a place for it. A force that none of them describes is
searched for as a curve ([unknown force](../method/unknown-force.md)). Effects of gear stages are on a page of their own
([faults of gears](gear-faults.md)); yours are a file away ([add an effect](../howto/add-effect.md)).

In the laws, $x$, $v$ and $t$ are position, speed and time, the first side against the second; the force acts on the
first side ([sign conventions](sign-conventions.md)). In the pictures the dashed line is the machine without the effect.
"""

GROUPS: dict[str, tuple[str, Callable[[Kind], bool]]] = {
    "Between two parts that move": (
        "Asked at every connection, and at every inertia against the ground; each for sliding and for turning.",
        lambda k: k.at == "connection",
    ),
    "Sensors": ("Asked at every measured output.", lambda k: k.at == "sensor"),
    "Inputs and controllers": (
        "Asked at every recorded input, and at what control gives to the machine.",
        lambda k: k.at in ("input", "signal"),
    ),
    "Inside a part": (
        "Asked at every part of these classes whose strength is zero.",
        lambda k: k.at == "parameter" and not k.stated,
    ),
    "Values that are stated wrongly": (
        "Asked at every part of these classes whose value calibration does not move; absence is the stated value.",
        lambda k: k.stated,
    ),
}
NEEDS = {
    "stiffness": "a spring of its own",
    "load": "a part that brings a known force there",
    "ground": "an inertia against the ground",
    "dry friction": "a dry friction in the model",
    "viscous friction": "a friction per speed in the model",
}
SENSOR_LAWS = {
    "offset": "reading = true value + offset",
    "gain": "reading = (1 + gain)·true value",
    "delay": "reading = true value at t − delay",
    "drift": "reading = true value + drift·t",
    "lag": "lag · rate of reading = true value − reading",
}
INPUT_LAWS = {
    "offset": "input = recorded + offset",
    "gain": "input = (1 + gain)·recorded",
    "delay": "input = recorded at t − delay",
    "lag": "output = input − lag/filter·(input − z), filter · rate of z = input − z; lag = filter is a low-pass of "
    "first order, lag = 2·filter nearly a delay",
}
RANGE = MotionRange(-0.1, 0.1, 0.3, scale=50.0, duration=6.0, step=0.02)
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


def catalogue_page() -> str:
    """Return the page."""
    parts = [INTRO]
    for title, (what, belongs) in GROUPS.items():
        parts += [f"## {title}", what]
        parts += [_entry(kind) for kind in shown() if belongs(kind)]
    return "\n\n".join(parts) + "\n"


def shown() -> list[Kind]:
    """Return the kinds that the page shows: those of every machine."""
    names = [*SHIPPED, *(kind.name for kind in (*BUILT_IN_KINDS, *STATED_KINDS))]
    return [kinds()[name] for name in names if not kinds()[name].free_form]


def pictures() -> dict[str, str]:
    """Return the picture of every kind as SVG, by its path in the docs."""
    return {f"{PICTURES}/{kind.name}.svg": _picture(kind) for kind in shown()}


def law_of(kind: Kind) -> str:
    """Return the law of a kind in words, from the class that holds it."""
    if kind.at == "sensor":
        return SENSOR_LAWS[kind.law]
    if kind.at in ("input", "signal"):
        return INPUT_LAWS[kind.law]
    holder = kind.component_class if kind.at == "parameter" else law_class(kind, "translation")
    if kind.at == "parameter":
        names = [f"{s}{ending}" for s in kind.strengths for ending in (e for _, e in kind.sides or (("", ""),))]
        return "; ".join(f"`{n}`, {holder.declarations[n].meaning}" for n in names)
    base = next(c for c in holder.__mro__ if vars(c).get("__doc__"))
    first = inspect.cleandoc(written_docstring(base)).split("\n\n")
    shown = first[0] if "F = " in first[0] or len(first) < 2 else " ".join(p for p in first if "F = " in p) or first[0]
    return " ".join(shown.split())


def _entry(kind: Kind) -> str:
    text = kind.text
    lines = [
        f"### {text.title[:1].upper()}{text.title[1:]}",
        f"![{text.title}](../{PICTURES}/{kind.name}.svg){{ width=420 }}",
        f"`{kind.name}`. {text.what}",
        f"- **Law**: {law_of(kind)}",
        f"- **Strength**: {', '.join(f'`{s}`' for s in kind.strengths)}{_fitted(kind)}",
    ]
    if where := _asked(kind):
        lines.append(f"- **Asked where there is** {where}")
    lines += [f"- **Causes**: {text.causes}", f"- **A record that shows it**: {text.confirm}"]
    if alike := taken_for(kind.name):
        conditions: dict[str, list[str]] = {}
        for other, where in alike:
            conditions.setdefault(where, []).append(f"[{_title(other)}](#{_anchor(other)})")
        told = "; ".join(f"{', '.join(names)} ({where})" for where, names in conditions.items())
        lines.append(f"- **Taken for**: {told}")
    head, items = lines[:3], lines[3:]
    return "\n\n".join([*head, "\n".join(items)])


def _fitted(kind: Kind) -> str:
    return f"; then fitted: {', '.join(f'`{s}`' for s in kind.free_shapes)}" if kind.free_shapes else ""


def _asked(kind: Kind) -> str:
    if kind.at == "parameter":
        classes = kind.component if isinstance(kind.component, tuple) else (kind.component,)
        return " or ".join(f"a `{cls.__name__}`" for cls in classes if cls is not None)
    found = [NEEDS[kind.needs]] if kind.needs else []
    found += ["a temperature in the model"] if kind.signal == "temperature" else []
    found += [{True: "a spring", False: "no spring"}[kind.elastic]] if kind.elastic is not None and not found else []
    return " and ".join(found)


def _title(name: str) -> str:
    return kinds()[name].text.title


def _anchor(name: str) -> str:
    """Return the anchor that the site gives to a heading."""
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", _title(name)).strip().lower())


# -------------------------------------------------------------------- pictures


def _picture(kind: Kind) -> str:
    import matplotlib
    from matplotlib.figure import Figure

    fixed = {"svg.hashsalt": kind.name, "svg.fonttype": "path", "font.size": 9.0}
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


def _draw_law(kind: Kind, panels) -> None:
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


def _draw_signal(kind: Kind, panels) -> None:
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


def _draw_part(kind: Kind, panels) -> None:
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
