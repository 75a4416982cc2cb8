"""The result of a simulation: named signals with units over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.quantity_text import count_text, unit_text
from multibody.base.spelling import nearest
from multibody.system.compiled import CompiledSystem

if TYPE_CHECKING:
    import pandas

__all__ = ["Trajectory"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """States, inputs and outputs of a simulated machine at given times.

    Parameters
    ----------
    system : CompiledSystem
        What was simulated.
    times : ndarray, shape (nt,), s
    states : ndarray, shape (nt, n)
    inputs : ndarray, shape (nt, n_u)
    p : ndarray, shape (n_p,)
        Parameters of the run.
    statistics : dict
        Method, number of evaluations, steps, the largest step and why.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass, Spring
    >>> model = Model("oscillator")
    >>> body = model.add("body", Mass(m=1.0, position=0.1))
    >>> spring = model.add("spring", Spring(stiffness=100.0))
    >>> model.connect(spring.a, model.ground)
    >>> model.connect(spring.b, body.flange)
    >>> run = model.build().simulate(1.0, rtol=1e-8)
    >>> bool(abs(run["body.position"][-1] - 0.1 * np.cos(10.0)) < 1e-6)
    True
    """

    system: CompiledSystem = field(repr=False)
    times: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    p: np.ndarray
    statistics: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def outputs(self) -> np.ndarray:
        """All outputs, shape (nt, n_y), computed on first access."""
        return self.system.outputs_along(self.times, self.states, self.inputs, self.p)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return one signal, shape (nt,): an output, a state, or an input."""
        indices = self.system._index
        if name in indices["state"]:
            return self.states[:, indices["state"][name]]
        if name in indices["output"]:
            return self.outputs[:, indices["output"][name]]
        if name in indices["input"]:
            return self.inputs[:, indices["input"][name]]
        known = [*self.system.output_names, *self.system.input_names]
        raise KeyError(f"'{self.system.name}' has no signal '{name}'{nearest(name, known)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all signals: inputs, then outputs (states among them)."""
        return (*self.system.input_names, *self.system.output_names)

    def unit(self, name: str) -> str:
        """Return the unit of a signal."""
        return self.system.unit(name)

    def to_frame(self, names: Iterable[str] | None = None) -> pandas.DataFrame:
        """Return signals as a DataFrame indexed by time in s, columns named ``name [unit]``."""
        import pandas

        chosen = list(names) if names is not None else list(dict.fromkeys(self.names))
        data = {f"{n} [{self.unit(n) or '1'}]": self[n] for n in chosen}
        return pandas.DataFrame(data, index=pandas.Index(self.times, name="time [s]"))

    def plot(self, names: Iterable[str] | None = None, axes: Any = None) -> Any:
        """Draw signals over time, one panel for each unit; returns the figure.

        Parameters
        ----------
        names : iterable of str, optional
            Signals; default: the states.
        axes : sequence of matplotlib axes, optional
            Panels to draw into, one for each unit.
        """
        import matplotlib.pyplot as plt

        chosen = list(names) if names is not None else list(self.system.state_names)
        panels: dict[str, list[str]] = {}
        for name in chosen:
            panels.setdefault(self.unit(name), []).append(name)
        if axes is None:
            figure, grid = plt.subplots(
                len(panels),
                1,
                sharex=True,
                squeeze=False,
                figsize=(8, 2.2 * len(panels) + 0.6),
                layout="constrained",
            )
            axes = grid[:, 0]
        else:
            axes = np.atleast_1d(axes)
            if len(axes) != len(panels):
                raise ValueError(
                    f"{len(panels)} units need {len(panels)} panels, {len(axes)} given: {', '.join(panels)}"
                )
            figure = axes[0].figure
        for axis, (unit, members) in zip(axes, panels.items(), strict=True):
            for name in members:
                axis.plot(self.times, self[name], label=name, linewidth=1.0)
            quantity = members[0].rsplit(".", 1)[-1] if len({m.rsplit(".", 1)[-1] for m in members}) == 1 else "value"
            axis.set_ylabel(f"{quantity} [{unit or '1'}]")
            axis.legend(fontsize="small", loc="upper right")
            axis.grid(alpha=0.3)
        axes[-1].set_xlabel("time [s]")
        return figure

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        names = self.system.state_names or self.system.output_names
        panels: dict[str, dict[str, np.ndarray]] = {}
        for name in names:
            lines = panels.setdefault(f"[{unit_text(self.unit(name)) or '1'}]", {})
            if len(lines) < 3:
                lines[name] = self[name]
        named = [(f"{next(iter(y))} {label}" if len(y) == 1 else label, y) for label, y in panels.items()]
        t = self.times
        rows = [
            ("samples", f"{t.size} from {t[0]:g} s to {t[-1]:g} s"),
            ("states, inputs, outputs", f"{self.states.shape[1]}, {self.inputs.shape[1]}, {len(self.system.outputs)}"),
            ("method", str(self.statistics.get("method", "?"))),
        ]
        figure = small_figure(t, named[:3]) if named else None
        return notebook_view(f"Simulation of '{self.system.name}'", rows, figure=figure)

    def __repr__(self) -> str:
        t = self.times
        method = self.statistics.get("method", "?")
        return (
            f"Trajectory({self.system.name!r}: {t.size} samples from {t[0]:g} s to {t[-1]:g} s, "
            f"{count_text(len(self.system.output_names), 'output')}, {method})"
        )
