"""The patterns of a study's ``[candidates]`` against what its model offers: a misspelt one is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import discrepancy.effects.effect  # noqa: F401 - kinds inside components join the catalogue
from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.kinds import Kind, kinds
from multibody.base.spelling import nearest_or_choices

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["check_patterns"]


@dataclass(frozen=True)
class PatternCheck:
    """What is wrong with the patterns of ``[candidates]``.

    Attributes
    ----------
    faults : tuple of str
        Patterns that name no kind of effect or no place of this model, with the nearest names.
    warnings : tuple of str
        Patterns that name a kind which this model cannot have there.
    """

    faults: tuple[str, ...]
    warnings: tuple[str, ...]


def check_patterns(
    system: System, outputs: Sequence[str], inputs: Sequence[str], include: Sequence[str], exclude: Sequence[str]
) -> PatternCheck:
    """Compare patterns over ``kind`` or ``kind@where`` with the catalogue of a model.

    Parameters
    ----------
    system : System
        Built with probes.
    outputs, inputs : sequence of str
        Measured outputs and recorded inputs.
    include, exclude : sequence of str
        Shell patterns.
    """
    entries = catalogue(system, outputs, inputs)
    places = {name for e in entries for name in _places(e)}
    faults: list[str] = []
    warnings: list[str] = []
    for key, patterns in (("include", include), ("exclude", exclude)):
        for pattern in patterns:
            if any(e.matches(pattern) for e in entries):
                continue
            kind, at, where = pattern.partition("@")
            named = [name for name in kinds() if fnmatchcase(name, kind)]
            lead = f"[candidates] {key}: '{pattern}'"
            if not named:
                faults.append(f"{lead}: there is no kind of effect '{kind}'{nearest_or_choices(kind, kinds())}")
            elif at and not any(fnmatchcase(place, where) for place in places):
                faults.append(
                    f"{lead}: the model has no connection, part or signal '{where}'"
                    f"{nearest_or_choices(where, sorted(places))}"
                )
            elif key == "include":
                of_kind = sorted({e.where for e in entries if e.kind.name in named})
                missing = _what_is_missing(kinds()[named[0]], system)
                there = f"; it can be at {', '.join(of_kind)}" if of_kind else missing
                warnings.append(f"{lead} fits nothing of this model{there}: `vtsdt catalogue` lists what does")
    if not faults and not catalogue(system, outputs, inputs, include=include, exclude=exclude):
        faults.append(
            "[candidates]: no effect is left to look for"
            + ("".join(f"; {text.partition(': ')[2]}" for text in warnings) or ": include more, or exclude less")
        )
    return PatternCheck(tuple(faults), tuple(warnings))


def _what_is_missing(kind: Kind, system: System) -> str:
    """Return which part a kind of effect belongs to where the model lacks the part, or has it without the effect."""
    if kind.component is None:
        return ""
    classes = kind.component if isinstance(kind.component, tuple) else (kind.component,)
    strength = kind.strengths[0] + (kind.sides[0][1] if kind.sides else "")
    for name, component in system.model.components.items():
        if isinstance(component, classes) and strength not in component.values:
            return f"; '{name}' has it only with {type(component).declarations[strength].when}=True"
        if isinstance(component, classes):
            return f"; '{name}' has {strength} = {component.values[strength]:g}"
    parts = " or ".join(f"{c.__module__}.{c.__name__}" for c in classes)
    return f"; it is an effect of {parts}, and the model has none: build one into the model, or take the pattern out"


def _places(entry: Entry) -> tuple[str, ...]:
    return (entry.where, *(entry.place.also if entry.place is not None else ()))
