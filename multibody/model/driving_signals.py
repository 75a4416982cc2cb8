"""The signals by which control acts on a machine."""

from __future__ import annotations

from multibody.declare.declarations import Input, Output, Port
from multibody.model.graph import ModelGraph

__all__ = ["driving_signals"]


def driving_signals(model: ModelGraph) -> dict[str, list[str]]:
    """Return the outputs of signal blocks that feed parts with ports, and the inputs that they feed.

    What a controller gives to a motor is one; what a sensor gives to a controller is none.

    Examples
    --------
    >>> from multibody import Model
    >>> from multibody.library import PI, TorqueSource
    >>> model = Model("drive")
    >>> control, motor = model.add("control", PI(k_p=1.0, k_i=0.0)), model.add("motor", TorqueSource())
    >>> model.connect(control.output, motor.torque)
    >>> driving_signals(model)
    {'control.output': ['motor.torque']}
    """
    signals: dict[str, list[str]] = {}
    for ends in model.connections:
        places = [(end, location) for end in ends if (location := model.find(end)) is not None]
        sources = [
            end
            for end, at in places
            if isinstance(at.component.declarations.get(at.item), Output)
            and at.component.of_kind(Input)
            and not at.component.of_kind(Port)
        ]
        driven = [
            end
            for end, at in places
            if isinstance(at.component.declarations.get(at.item), Input) and at.component.of_kind(Port)
        ]
        if sources and driven:
            signals.setdefault(sources[0], []).extend(driven)
    return signals
