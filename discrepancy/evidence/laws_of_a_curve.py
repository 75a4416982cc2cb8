"""The laws of the catalogue that a free curve may be the sum of."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import orth
from scipy.optimize import lsq_linear

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.effects.law_along_motion import has_memory
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.proposals import parameter_of_same_law
from discrepancy.sensitivities.candidates import forces_along_motion
from discrepancy.sensitivities.linearised_problem import LinearisedProblem

__all__ = ["CurveLaws", "laws_of_curve", "laws_of_curves"]

#: Rows on which the force of a curve is compared with those of laws: many for each of its points, and soon done.
ROWS = 4000
#: Share of the largest singular value, or of a force, below which it is none but for rounding.
SMALLEST = 1e-6


@dataclass(frozen=True, kw_only=True)
class CurveLaws:
    """Laws that may stand in the place of a free curve.

    Parameters
    ----------
    effects : tuple of Effect
        At the strengths at which they come nearest.
    share : float
        Of the mean square of the curve's force along the records, beside what is fitted anyway, that they are.
    """

    effects: tuple[Effect, ...]
    share: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _LawForces:
    """The forces of a law along the motion of all records, in the shape that comes nearest to the curve.

    It is what `discrepancy.effects.from_scan_row.effect_of` makes an effect of.

    Parameters
    ----------
    entry : Entry
    shape : dict of str to float
    columns : ndarray, shape (n, k)
        At strengths of one.
    expected_strength : ndarray, shape (k,)
        Empty before the laws are fitted together.
    """

    entry: Entry
    shape: dict[str, float]
    columns: np.ndarray
    expected_strength: np.ndarray = field(default_factory=lambda: np.empty(0))

    def beside(self, base: np.ndarray) -> _LawForces:
        """Return what is new in the forces beside those of an orthonormal base."""
        return replace(self, columns=self.columns - base @ (base.T @ self.columns))

    @property
    def kind(self) -> str:
        """Of the law."""
        return self.entry.kind.name

    @property
    def where(self) -> str:
        """Place of the law."""
        return self.entry.where


def laws_of_curves(
    linearised: LinearisedProblem, effects: Sequence[Effect], entries: Sequence[Entry]
) -> list[tuple[Effect, tuple[Effect, ...], list[CurveLaws]]]:
    """Return each free curve of a model, what the model has beside it, and the laws that come nearest to it."""
    fitted = linearised.sensitivities().names
    found = []
    for curve in (e for e in effects if e.definition.free_form):
        rest = tuple(e for e in effects if e is not curve)
        found.append((curve, rest, laws_of_curve(linearised, curve, entries, fitted, rest)))
    return found


def laws_of_curve(
    linearised: LinearisedProblem,
    curve: Effect,
    entries: Sequence[Entry],
    fitted: Sequence[str],
    rest: Sequence[Effect],
) -> list[CurveLaws]:
    """Return the laws, one or two at once, whose force comes nearest to that of a free curve along the motion.

    A curve takes the place of several laws at once, of which each alone may explain little, and what is random beside
    that hides them from one another.

    Parameters
    ----------
    linearised : LinearisedProblem
        Of the model with the curve.
    curve : Effect
        Free form.
    entries : sequence of Entry
        The catalogue.
    fitted : sequence of str
        Parameters of the machine that are fitted: laws whose strength they are take part, and are not proposed.
    rest : sequence of Effect
        What the model has beside the curve.

    Returns
    -------
    list of CurveLaws
        The best single law, and the best pairs that differ in their force.
    """
    motion = next((c for c in linearised.free_curves() if c.place.name == curve.where), None)
    own = [e for e in entries if e.where == curve.where and e.kind.linear and not has_memory(e.kind)]
    if motion is None or not own:
        return []
    rows = _rows(linearised)
    force = np.concatenate([f[r] for f, r in zip(motion.forces_of(curve), rows, strict=True)])
    fitted_laws = [e for e in own if parameter_of_same_law(e, fitted)]
    parameters = [_in_shapes(linearised, e, rows)[0].columns for e in fitted_laws]
    beside = orth(np.hstack(parameters), rcond=SMALLEST) if parameters else np.zeros((force.size, 0))
    left = force - beside @ (beside.T @ force)
    there = {e.kind for e in rest if e.where == curve.where}
    laws = []
    for entry in own:
        if entry in fitted_laws or there & {entry.kind.name, *entry.kind.contains}:
            continue
        shapes = [law.beside(beside) for law in _in_shapes(linearised, entry, rows)]
        laws.append(min(shapes, key=lambda law: _fitted([law], left).error))
    groups = [*((law,) for law in laws), *itertools.combinations(laws, 2)]
    fits = sorted((f for g in groups if (f := _fitted(g, left)).all_act), key=lambda f: f.error)
    chosen: list[_Fit] = []
    for fit in fits:
        alike = [f for f in chosen if len(f.laws) == len(fit.laws)]
        if len(alike) < (POLICY.rivals if len(fit.laws) > 1 else 1) and not any(_same(fit, f) for f in alike):
            chosen.append(fit)
    chosen.sort(key=lambda f: len(f.laws))
    whole = float(left @ left)
    return [CurveLaws(effects=_as_effects(f, rest), share=1.0 - f.error / whole) for f in chosen]


def _rows(linearised: LinearisedProblem) -> list[slice]:
    """Return the rows of every record on which forces are compared."""
    count = sum(np.size(e.record.time) for e in linearised.experiments)
    return [slice(None, None, 1 + count // ROWS)] * len(linearised.experiments)


def _in_shapes(linearised: LinearisedProblem, entry: Entry, rows: Sequence[slice]) -> list[_LawForces]:
    """Return the forces of a law along all records in each of its shapes."""
    shapes = entry.kind.shape_grid(linearised.motion_range(entry)) or [{}]
    strengths = list(entry.kind.strengths)
    of_records = [
        forces_along_motion(
            linearised, entry, linearised.nominal_outputs(i), np.array(e.record.time), shapes, strengths
        )
        for i, e in enumerate(linearised.experiments)
    ]
    joined = [
        np.concatenate([np.column_stack(forces[k])[r] for forces, r in zip(of_records, rows, strict=True)])
        for k in range(len(shapes))
    ]
    return [_LawForces(entry=entry, shape=s, columns=c) for s, c in zip(shapes, joined, strict=True)]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fit:
    """Laws at the strengths at which they come nearest to a force, and what they leave of it.

    Parameters
    ----------
    laws : tuple of _LawForces
    strengths : tuple of ndarray
    force : ndarray, shape (n,)
        Their own.
    error : float
        Sum of squares that is left.
    """

    laws: tuple[_LawForces, ...]
    strengths: tuple[np.ndarray, ...]
    force: np.ndarray
    error: float

    @property
    def all_act(self) -> bool:
        """Whether each has a strength at all."""
        return all(map(np.any, self.strengths))


def _fitted(laws: Sequence[_LawForces], force: np.ndarray) -> _Fit:
    """Fit laws to a force, with the sign that their kind allows.

    Where several strengths do the same, they are the smallest that do.
    """
    columns = np.column_stack([law.columns for law in laws])
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    least = [0.0 if law.entry.kind.one_sided else -np.inf for law in laws for _ in law.entry.kind.strengths]
    small = SMALLEST * np.eye(size.size)
    fit = lsq_linear(
        np.vstack([columns / size, small]), np.append(force, np.zeros(size.size)), bounds=(least, np.inf), method="bvls"
    )
    ends = np.cumsum([law.columns.shape[1] for law in laws])[:-1]
    x = np.where(np.abs(fit.x) > SMALLEST * np.linalg.norm(force), fit.x, 0.0)
    own = (columns / size) @ x
    error = float(np.sum((force - own) ** 2))
    return _Fit(laws=tuple(laws), strengths=tuple(np.split(x / size, ends)), force=own, error=error)


def _same(one: _Fit, other: _Fit) -> bool:
    """Tell whether two sums of laws are the same force along the motion."""
    size = np.linalg.norm(one.force) * np.linalg.norm(other.force)
    return bool(one.force @ other.force >= POLICY.same_direction * size)


def _as_effects(fit: _Fit, rest: Sequence[Effect]) -> tuple[Effect, ...]:
    effects: list[Effect] = []
    for law, own in zip(fit.laws, fit.strengths, strict=True):
        effects.append(effect_of(law.entry, replace(law, expected_strength=own), (*rest, *effects)))
    return tuple(effects)
