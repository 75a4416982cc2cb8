"""From a row of a scan to the effect that it stands for, at the strength that the scan expects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import Kind, kind_named

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.statistics.scan_result import ScanRow

__all__ = ["DIFFERENCE", "FURTHEST_FACTOR", "contained", "differs_from", "effect_of", "simpler_in"]


class Scored(Protocol):
    """A candidate with the strength that a scan expects of it."""

    @property
    def kind(self) -> str:
        """Of effect."""
        ...

    @property
    def where(self) -> str:
        """Connection or signal."""
        ...

    @property
    def shape(self) -> Mapping[str, float]:
        """At which it fits best."""
        ...

    @property
    def expected_strength(self) -> np.ndarray:
        """One value for each strength of its kind."""
        ...


FURTHEST_FACTOR = 10.0  # times a stated value, or its inverse, to which a straight line from it is followed; chosen
DIFFERENCE = "difference"  # name of the one amplitude of a law with two sides where their mean is in the model already


def simpler_in(effects: Sequence[Effect], kind: str, where: str) -> list[Effect]:
    """Return the effects of a model that a candidate contains: it would stand in their place."""
    inside = kind_named(kind).contains
    return [e for e in effects if e.kind in inside and e.where == where]


def contained(a: ScanRow, b: ScanRow) -> bool:
    """Tell whether one of two candidates at the same place is a limit of the other."""
    if a.where != b.where:
        return False
    return a.kind in kind_named(b.kind).contains or b.kind in kind_named(a.kind).contains


def differs_from(effects: Sequence[Effect], kind: Kind, where: str) -> bool:
    """Tell whether only the difference between a law's two sides is new: what they share is in the model already."""
    return kind.by_direction and bool(simpler_in(effects, kind.name, where))


def effect_of(entry: Entry, row: Scored, effects: Sequence[Effect], instead_of: Sequence[Effect] = ()) -> Effect:
    """Return the effect that a row of a scan stands for, at its expected strength.

    Parameters
    ----------
    entry : Entry
    row : Scored
        Such as a row of a scan.
    effects : sequence of Effect
        What the model has already.
    instead_of : sequence of Effect
        Simpler laws in whose place it stands: it begins with their strength besides its own.
    """
    kind = entry.kind
    amplitude = np.atleast_1d(row.expected_strength)
    if amplitude.size < len(kind.strengths):
        amplitude = np.array([amplitude[0], -amplitude[0]])
    elif kind.one_sided:
        amplitude = np.maximum(amplitude, 1e-3 * max(float(np.max(np.abs(amplitude))), 1e-12))
    elif kind.stated:
        stated = np.array(entry.stated)
        amplitude = stated * np.clip(1.0 + amplitude / stated, 1.0 / FURTHEST_FACTOR, FURTHEST_FACTOR)
    strengths = dict(zip(kind.strengths, map(float, amplitude), strict=True))
    number = 1 + sum(1 for e in effects if e.kind == kind.name and e.where == entry.where)
    shape = {k: v for k, v in row.shape.items() if k != "amplitude"}
    if entry.place is None:
        return Effect(
            kind=kind.name, where=entry.where, strengths=strengths, shape=shape, number=number, domain=entry.domain
        )
    effect = Effect.at_place(
        kind.name,
        entry.place,
        where=entry.where,
        strengths=strengths,
        shape=shape,
        load=entry.load,
        number=number,
    )
    for other in instead_of:
        name, value = next(iter(other.strengths.items()))
        unit = other.unit(name)
        least = 0.0 if kind.one_sided else -np.inf
        more = {k: max(v + value, least) for k, v in effect.strengths.items() if effect.unit(k) == unit}
        effect = replace(effect, strengths={**effect.strengths, **more})
    return effect
