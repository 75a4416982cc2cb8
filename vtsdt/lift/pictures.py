"""Pictures of a lift: diagram of its components, plots and animation of a trip, mode shapes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.lift.modes import modes_along_trip
from vtsdt.lift.schematic import Schematic

if TYPE_CHECKING:
    from multibody.machine.model import Model
    from multibody.system.trajectory import Trajectory
    from vtsdt.lift.lift import Lift

__all__ = ["animate_trip", "diagram", "mode_shapes", "trip_strip"]

_PLACES = {
    "cabin_guide": (0.0, 1.0),
    "cabin": (1.0, 1.0),
    "counterweight": (3.0, 1.0),
    "counterweight_guide": (4.0, 1.0),
    "ropes": (2.0, 2.0),
    "pulley": (2.0, 3.0),
    "support": (3.0, 3.6),
    "machine": (1.0, 3.6),
    "control": (0.0, 3.6),
    "reference": (0.0, 2.6),
    "accelerometer": (1.0, 0.0),
    "payload": (0.0, 0.0),
    "rope": (1.0, 2.0),
    "ground": (4.0, 3.0),
}
_STYLE = {
    "frame": ("tab:blue", "-"),
    "translation": ("tab:green", "-"),
    "rotation": ("tab:red", "-"),
    "electrical": ("tab:orange", "-"),
    "signal": ("dimgray", "--"),
}
_STRIP = (("z_c", "z_cw"), ("v_c",), ("zdd_c",), ("F_c", "F_cw"), ("fric_c", "fric_cw"), ("i_q", "i_d"), ("z_m",))


def diagram(model: Model, axes: Any = None) -> Any:
    """Draw a model as its graph: components as boxes, connections as lines by domain; returns the figure."""
    import matplotlib.pyplot as plt

    if axes is None:
        _, axes = plt.subplots(figsize=(9, 6), layout="constrained")
    edges = _edges(model)
    names = list(model.components)
    if any("ground" in pair for pair in edges):
        names.append("ground")
    at = _positions(names)
    used: set[str] = set()
    for (a, b), domains in edges.items():
        for k, domain in enumerate(sorted(domains)):
            colour, line = _STYLE[domain]
            shift = 0.04 * (k - 0.5 * (len(domains) - 1))
            (x0, y0), (x1, y1) = at[a], at[b]
            label = domain if domain not in used else None
            used.add(domain)
            axes.plot([x0 + shift, x1 + shift], [y0 + shift, y1 + shift], line, color=colour, label=label, zorder=1)
    for name in names:
        kind = type(model.components[name]).__name__ if name in model.components else ""
        label = f"{name}\n({kind})" if kind else name
        axes.text(
            *at[name],
            label,
            ha="center",
            va="center",
            fontsize=8,
            zorder=2,
            bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": "black"},
        )
    for name, entry in model.inputs.items():
        for target in entry.targets:
            owner = model.find(target)
            if owner is not None:
                x, y = at[owner[0]]
                axes.annotate(
                    name,
                    (x, y),
                    (x - 0.45, y - 0.42),
                    fontsize=8,
                    color="dimgray",
                    arrowprops={"arrowstyle": "->", "color": "dimgray"},
                    zorder=1,
                )
    axes.margins(0.15)
    axes.set_axis_off()
    axes.set_title(model.name)
    axes.legend(fontsize="small", loc="lower right")
    return axes.figure


def _edges(model: Model) -> dict[tuple[str, str], set[str]]:
    edges: dict[tuple[str, str], set[str]] = {}
    for connection in model.connections:
        owners = []
        domain = "signal"
        for end in connection:
            port = model.find(end)
            owners.append(port[0] if port else "ground")
            if port is not None:
                domain = getattr(port[1].declarations.get(port[2]), "domain", domain) or domain
        for other in owners[1:]:
            if other != owners[0]:
                edges.setdefault((owners[0], other), set()).add(domain)
    return edges


def _positions(names: list[str]) -> dict[str, tuple[float, float]]:
    """Return positions: those of the lift's components are fixed, others lie on a circle around them."""
    unknown = [n for n in names if n not in _PLACES]
    angles = np.linspace(0.0, 2.0 * np.pi, max(len(unknown), 1), endpoint=False)
    circle = [(2.0 + 3.2 * float(np.cos(a)), 2.0 + 2.6 * float(np.sin(a))) for a in angles]
    around = dict(zip(unknown, circle, strict=False))
    return {n: _PLACES.get(n) or around[n] for n in names}


def trip_strip(run: Trajectory) -> Any:
    """Draw position, speed, acceleration, tension, friction and current of a trip over time; returns the figure."""
    import matplotlib.pyplot as plt

    rows = [[n for n in row if n in run.names] for row in _STRIP]
    rows = [row for row in rows if row]
    figure, axes = plt.subplots(
        len(rows), 1, sharex=True, squeeze=False, figsize=(8, 1.5 * len(rows) + 0.6), layout="constrained"
    )
    for axis, row in zip(axes[:, 0], rows, strict=True):
        for name in row:
            axis.plot(run.times, run[name], label=name, linewidth=1.0)
        axis.set_ylabel(f"[{run.unit(row[0]) or '1'}]")
        axis.legend(fontsize="small")
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def mode_shapes(lift: Lift, height: float = 0.0, *, vertical: bool = True, size: float = 0.08) -> Any:
    """Draw mode shapes about the state at rest in front view, the largest motion ``size`` m.

    Motion along y and tilt about x (phi_A, roll) are not visible in front view; the title names the strongest state.
    """
    import matplotlib.pyplot as plt

    modes = modes_along_trip(lift, np.array([height])).modes[0]
    rest = lift.equilibrium(height)
    chosen = np.flatnonzero(modes.vertical == vertical)
    figure, grid = plt.subplots(1, len(chosen), squeeze=False, figsize=(2.6 * len(chosen), 6), layout="constrained")
    moving = {n: k for k, n in enumerate(modes.states) if n in _DRAWN}
    for axes, k in zip(grid[0], chosen, strict=True):
        shape = modes.shapes[k]
        lengths = [shape[j] * _DRAWN[n] for n, j in moving.items()]
        largest = max(lengths, key=abs)
        # rotated so that the largest motion is real: the shape at its greatest amplitude
        scaled = {n: float((shape[j] / largest).real) * size for n, j in moving.items()}
        drawing = Schematic(lift, axes, exaggeration=1.0)
        height_of = {n: rest[n] if n.endswith(".z") else 0.0 for n in moving}
        drawing.show({n: scaled[n] + height_of[n] for n in moving}, angle=scaled.get("pulley.angle", 0.0))
        strongest = modes.states[int(np.argmax(modes.participation[k]))]
        axes.set_title(f"{modes.frequency[k]:.2f} Hz\n{strongest}", fontsize="small")
        axes.set_xlabel("x [m]")
    return figure


#: States that are drawn, and the length in m that one unit of each moves.
_DRAWN = {
    "cabin.x": 1.0,
    "cabin.z": 1.0,
    "cabin.pitch": 0.3,
    "counterweight.x": 1.0,
    "counterweight.z": 1.0,
    "counterweight.pitch": 0.3,
    "pulley.angle": 0.1,
    "support.plate_position": 1.0,
    "support.position": 1.0,
    "support.tilt_A_angle": 0.14,
    "support.tilt_B_angle": 0.16,
}


def animate_trip(
    lift: Lift, run: Trajectory, path: str | Path | None = None, *, frames: int = 120, exaggeration: float = 20.0
) -> Any:
    """Animate a trip; with a path the animation is written (``.gif`` by Pillow, ``.mp4`` by ffmpeg).

    Returns
    -------
    matplotlib.animation.FuncAnimation
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    figure, axes = plt.subplots(figsize=(5, 7), layout="constrained")
    drawing = Schematic(lift, axes, exaggeration)
    rows = np.linspace(0, run.times.size - 1, frames).astype(int)
    names = [n for n in run.system.state_names if not n.startswith("energy.")]

    def draw(frame: int) -> list[Any]:
        row = rows[frame]
        axes.set_title(f"{run.times[row]:.2f} s")
        return drawing.show({n: float(run.states[row, k]) for k, n in enumerate(names)})

    draw(0)
    rate = (frames - 1) / (run.times[-1] - run.times[0])
    animation = FuncAnimation(figure, draw, frames=frames, interval=1e3 / rate, blit=False)
    if path is not None:
        path = Path(path)
        animation.save(path, writer="pillow" if path.suffix == ".gif" else "ffmpeg", fps=rate)
        plt.close(figure)
    return animation
