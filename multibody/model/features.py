"""The signals of a model that say how fast its narrow features pass by (see `ModelGraph.feature`)."""

from __future__ import annotations

from collections.abc import Container

from multibody.declare.declarations import Output
from multibody.model.graph import ModelGraph

__all__ = ["feature_outputs", "speed_signals"]


def speed_signals(model: ModelGraph, known: Container[str]) -> tuple[str, ...]:
    """Return the signals among those known at whose speeds the features of a model pass by, each once."""
    owned = (
        f"{owner}.{speed}"
        for owner, component in model.components.items()
        for speed in component.features.values()
        if speed != "time"
    )
    named = (speed for _, speed in model.features.values())
    return tuple(name for name in dict.fromkeys([*owned, *named]) if name in known)


def feature_outputs(model: ModelGraph) -> list[str]:
    """Return the outputs that a simulation needs to keep its steps short enough for the components' features."""
    return [
        f"{owner}.{name}"
        for owner, component in model.components.items()
        for pair in component.features.items()
        for name in pair
        if isinstance(component.declarations.get(name), Output)
    ]
