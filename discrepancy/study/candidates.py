"""The candidates of a stage as a person picks among them: scores, what each is predicted to change, effects by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of, simpler_in
from discrepancy.search.scoring import score_candidates
from discrepancy.search.state import SearchState
from discrepancy.stages.stage import Stage
from discrepancy.statistics.blocks import Candidate
from discrepancy.statistics.scan_result import ScanResult, ScanRow
from discrepancy.statistics.whitened import raw_residual, scaled_by_rms
from multibody.base.spelling import nearest

__all__ = ["Candidates", "Prediction", "candidates_of", "named_effect"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Prediction:
    """What an effect is expected to change, from the linearised model: no simulation, no fit.

    Parameters
    ----------
    name : str
        ``kind@where``.
    outputs : tuple of str
    records : tuple of str
        Identification records.
    times : tuple of ndarray, shape (n,), s
        Of each record, at the samples of the scan.
    before, after : tuple of ndarray, shape (n, n_outputs)
        Residual of each record as it is, and with the effect at its expected strength and everything recalibrated.
    """

    name: str
    outputs: tuple[str, ...]
    records: tuple[str, ...]
    times: tuple[np.ndarray, ...]
    before: tuple[np.ndarray, ...]
    after: tuple[np.ndarray, ...]

    def rmse(self) -> dict[str, tuple[float, float]]:
        """Return the root mean square error of every output before and after, over all records, SI."""
        old, new = (np.sqrt(np.mean(np.concatenate(b) ** 2, axis=0)) for b in (self.before, self.after))
        return {name: (float(a), float(b)) for name, a, b in zip(self.outputs, old, new, strict=True)}


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """Every candidate of a stage with its score.

    Parameters
    ----------
    stage : Stage
    scan : ScanResult
        Without refits; the best first.
    refused : tuple of (Entry, str)
        What these records cannot answer for, and why.
    """

    stage: Stage
    scan: ScanResult
    refused: tuple[tuple[Entry, str], ...]
    _by_name: Mapping[str, Candidate]
    _predictions: dict[str, Prediction] = field(default_factory=dict, repr=False)

    def row(self, name: str) -> ScanRow:
        """Return the score of ``kind@where``.

        Raises
        ------
        KeyError
            If it is no candidate of this stage, with the reason where it is known.
        """
        for row in self.scan.rows:
            if row.name == name:
                return row
        for entry, why in self.refused:
            if entry.name == name:
                raise KeyError(f"'{name}' is no candidate of '{self.stage.name}': {why}")
        raise KeyError(f"'{name}' is no candidate of '{self.stage.name}'{nearest(name, list(self._by_name))}")

    def weights(self) -> dict[str, float]:
        """Return the relative weight of each candidate and of "nothing" (key ``""``), which add up to one.

        From the expected changes of BIC, as if one of them were true: an order of likelihood among single effects, not
        the probability that a diagnosis gives after refits.
        """
        names = [row.name for row in self.scan.rows]
        delta = np.array([0.0, *(row.delta_bic for row in self.scan.rows)])
        delta = np.where(np.isfinite(delta), delta, np.inf)
        weight = np.exp(-0.5 * (delta - np.min(delta)))
        return dict(zip(["", *names], (weight / weight.sum()).tolist(), strict=True))

    def effect(self, name: str) -> Effect:
        """Return the effect that a candidate stands for, at its expected strength."""
        candidate, effects = self._by_name[self.row(name).name], self.stage.effects
        entry: Entry = candidate.info["entry"]
        return effect_of(entry, self.row(name), effects, simpler_in(effects, entry.kind.name, entry.where))

    def predict(self, name: str) -> Prediction:
        """Return what a candidate is expected to change: a least-squares step of its strength and all parameters."""
        if name not in self._predictions:
            self._predictions[name] = self._predicted(name)
        return self._predictions[name]

    def _predicted(self, name: str) -> Prediction:
        row = self.row(name)
        candidate = self._by_name[name]
        shape = next((k for k, s in enumerate(candidate.shapes) if dict(s) == dict(row.shape)), 0)
        problem = self.stage.weighted_problem()
        residual, sensitivities = problem.residual(), problem.sensitivities()
        one = replace(candidate, sensitivities=(candidate.sensitivities[shape],), shapes=(candidate.shapes[shape],))
        scaled = scaled_by_rms(residual, sensitivities, [one])
        there = bool(scaled.columns.groups) and np.any(row.expected_strength)
        after = raw_residual(scaled, residual, sensitivities, [one], [0] if there else [])
        before = list(residual.blocks)
        for i, weighting in enumerate(residual.weighting):
            before[i], after[i] = weighting.inverse(before[i]), weighting.inverse(after[i])
        experiments = problem.experiments
        return Prediction(
            name=name,
            outputs=tuple(residual.channels),
            records=tuple(e.name for e in experiments),
            times=tuple(e.time for e in experiments),
            before=tuple(before),
            after=tuple(after),
        )


def candidates_of(state: SearchState, include: Sequence[str] | None = None) -> Candidates:
    """Return the candidates of the latest stage with their scores; computed once for a stage.

    Parameters
    ----------
    state : SearchState
    include : sequence of str, optional
        Shell patterns over ``kind`` or ``kind@where``; default: those of the study.
    """
    stage, problem = state.stage, state.problem
    patterns = tuple(include if include is not None else problem.include)

    def scored() -> Candidates:
        scans, candidates, refused = score_candidates(
            stage,
            include=patterns,
            exclude=problem.exclude if include is None else (),
            level=problem.level,
            seed=problem.seed + len(state.stages),
            progress=state.progress,
        )
        return Candidates(stage=stage, scan=scans[0], refused=tuple(refused), _by_name={c.name: c for c in candidates})

    return stage.once(("candidates", patterns), scored)


def named_effect(
    state: SearchState, name: str, strength: float | Mapping[str, float] | None, shape: Mapping[str, float] | None
) -> tuple[Effect, tuple[Effect, ...]]:
    """Return the effect of a name such as ``"coulomb_friction@guide"``, and the simpler ones that it replaces.

    Parameters
    ----------
    state : SearchState
    name : str
    strength : float or mapping, optional
        Of the effect, SI: one value for all strengths of its kind, or one for each.  Default: as the scan expects it.
    shape : mapping, optional
        Other parameters of its law; those not given are as the scan found them best.

    Raises
    ------
    KeyError
        If there is no such candidate at this stage.
    ValueError
        If the effect has no strength or parameter of a given name; all faults.
    """
    kind, at, where = name.partition("@")
    if not at or not kind or not where:
        raise KeyError(f"'{name}': give kind@where, such as 'coulomb_friction@guide'")
    known = candidates_of(state)
    if name not in {row.name for row in known.scan.rows}:  # the study's settings may exclude it
        every = candidates_of(state, include=[name])
        names = {row.name for row in every.scan.rows} | {entry.name for entry, _ in every.refused}
        known = every if name in names else known
    effect = known.effect(name)
    own: dict[str, float] = {}
    if strength is not None:
        own = dict(strength) if isinstance(strength, Mapping) else dict.fromkeys(effect.strengths, strength)
    faults = [f"no strength '{k}'{nearest(k, effect.strengths)}" for k in own if k not in effect.strengths]
    faults += [f"no parameter '{k}'{nearest(k, effect.shape)}" for k in shape or {} if k not in effect.shape]
    faults += [
        f"'{k}' is {value!r}: give a finite number, in SI"
        for k, value in {**own, **(shape or {})}.items()
        if not (isinstance(value, int | float | np.number) and np.isfinite(value))
    ]
    if faults:
        raise ValueError(f"{name}: {'; '.join(faults)}")
    effect = replace(effect, strengths={**effect.strengths, **own}, shape={**effect.shape, **(shape or {})})
    return effect, tuple(simpler_in(state.stage.effects, kind, where))
