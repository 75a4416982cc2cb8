"""A model as text: its components with their values, its connections, inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence

from multibody.declare.declarations import Parameter, Port
from multibody.model.graph import ModelGraph

__all__ = ["describe"]


def describe(model: ModelGraph) -> str:
    """Return a table of a model's components with their values, its connections, inputs and outputs.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import Mass
    >>> model = Model("sledge")
    >>> body = model.add("body", Mass(m=2.0, position=0.1))
    >>> print(describe(model))
    sledge
    <BLANKLINE>
    component  class  value     number  unit  meaning
    body       Mass   m         2       kg    mass
                      free      True          False holds the body at its start position
                      position  0.1     m     position at the start
    """
    rows: list[Sequence[str]] = [("component", "class", "value", "number", "unit", "meaning")]
    for name, component in model.components.items():
        lines: list[tuple[str, str, str, str]] = []
        starts = component.start_declarations()
        for key, item in component.declarations.items():
            unit, meaning = getattr(item, "unit", ""), getattr(item, "meaning", "")
            if isinstance(item, Parameter) and key in component.values:
                lines.append((key, f"{component.values[key]:g}", unit, meaning))
            elif key in component.options:
                lines.append((key, f"{component.options[key]}", "", meaning))
            elif key in component.tables:
                x, y = component.tables[key]
                lines.append((key, f"{x.size} points", unit, f"{meaning}, from {y.min():g} to {y.max():g}"))
        lines += [(k, f"{v:g}", starts[k].unit, starts[k].meaning) for k, v in component.starts.items() if v]
        head = (name, type(component).__name__)
        for k, line in enumerate(lines or [("", "", "", "")]):
            rows.append((*(head if k == 0 else ("", "")), *line))
    text = [model.name, "", *_aligned(rows)]
    if model.connections:
        text += ["", "connected:"]
        text += ["  " + " – ".join(ends) for ends in model.connections]
    if unconnected := _unconnected_ports(model):
        text += ["", f"not connected: {', '.join(unconnected)}"]
    if model.inputs:
        text += ["", "inputs:"]
        text += [f"  {i.name} → {', '.join(i.targets) or 'nothing'}" for i in model.inputs.values()]
    if model.outputs:
        text += ["", "outputs:"]
        text += [f"  {name} = {source}" for name, source in model.outputs.items()]
    return "\n".join(text)


def _unconnected_ports(model: ModelGraph) -> list[str]:
    connected = {end for ends in model.connections for end in ends}
    return [
        f"{name}.{port}"
        for name, component in model.components.items()
        for port, item in component.of_kind(Port).items()
        if f"{name}.{port}" not in connected and not getattr(item, "inertia", None)
    ]


def _aligned(rows: list[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
