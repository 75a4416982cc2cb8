"""One case of a suite: a virtual machine with hidden effects, its diagnosis, and how far that is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from discrepancy.validation.trials import Trial, listed_as_negligible

__all__ = ["MACHINES", "TIMES_VISIBLE", "diagnosed", "hidden_trial", "machine_module", "null_trial"]

TIMES_VISIBLE = 3.0
MACHINES = {"axis": "discrepancy.validation.suite_axis"}


def machine_module(machine: str) -> Any:
    """Return the module of a virtual machine, with `case`, `sizes`, `names` and ``UNKNOWN`` as that of the axis.

    It may state the usual number of ``TRIALS``; ``SCALED = False`` hides effects at their usual size.
    """
    import importlib

    return importlib.import_module(MACHINES.get(machine, machine))


def diagnosed(suite: str, seed: int, hidden: Sequence[str], machine: str = "axis", **rig: Any) -> Trial:
    """Diagnose a case and compare the answer with the truth.

    Parameters
    ----------
    suite : str
        Of the trial.
    seed : int
    hidden : sequence of str
        ``kind@where``.
    machine : str
        As of `machine_module`.
    **rig
        Further settings of the machine's rig.
    """
    import time

    from discrepancy.study.study import Study
    from discrepancy.validation.interval_coverage import coverage

    begun = time.perf_counter()
    case = machine_module(machine).case(seed, list(hidden), **rig)
    study = Study(case.problem(seed=seed))
    conclusion = study.diagnose()
    accepted = [s.accepted for s in study.stages if s.accepted is not None]
    names = tuple(str(a.effect) for a in accepted)
    tied = [[n for r in a.rivals if r.indistinguishable for n in r.names] for a in accepted]
    truth = case.truth["effects"][0] if case.truth["effects"] else None
    ratio = math.nan
    if truth is not None and names and names[0] == f"{truth['kind']}@{truth['where']}":
        last = next((e for e in study.stages[-1].effects if str(e) == names[0]), None)
        if last is not None:
            given = {k: v.get("stated", 0.0) for k, v in truth["parameters"].items() if k in last.strengths}
            size = _size(truth)
            ratio = math.hypot(*(last.strengths[k] - v for k, v in given.items())) / size if size else math.nan
    unknown = conclusion.extra.get("unknown", {})
    inside, outside = coverage(study.stages[-1], case.truth) if sorted(names) == sorted(hidden) else (0, ())
    return Trial(
        suite=suite,
        seed=seed,
        hidden=tuple(hidden),
        verdict=conclusion.verdict,
        found=names,
        ties=tuple(tied[0]) if tied else (),
        ratio=ratio,
        seconds=time.perf_counter() - begun,
        note=listed_as_negligible(conclusion.negligible, hidden),
        over=str((truth or {}).get("over", "")),
        curve_over=conclusion.unknown.regressor if conclusion.unknown is not None else "",
        depends_on=str(unknown.get("depends_on") or ""),
        tied=tuple(dict.fromkeys(name for group in tied for name in group)),
        held_out=_held_out_ratio(study, hidden, names, case.truth["effects"]),
        inside=inside,
        outside=outside,
    )


def _held_out_ratio(
    study: Any, hidden: Sequence[str], named: Sequence[str], truth: Sequence[Mapping[str, Any]]
) -> float:
    """Return the held-out error over that of the model with exactly the hidden effects; nan where that has no fit."""
    import numpy as np

    from discrepancy.effects.catalogue import catalogue
    from discrepancy.effects.effect import Effect
    from multibody.base.errors import ModelError

    if not hidden or len(study.stages) < 2:
        return math.nan
    if set(hidden) == set(named):
        return 1.0
    start, experiment = study.stages[1], study.problem.identify[0]
    entries = {e.name: e for e in catalogue(start.system, experiment.outputs, experiment.inputs)}
    effects, bent = [], False
    for each in truth:
        entry = entries.get(f"{each['kind']}@{each['where']}")
        if entry is None:
            return math.nan
        true = {k: float(v["value"]) for k, v in each["parameters"].items()}
        strengths = {k: true.pop(k) for k in entry.kind.strengths}
        bent |= not entry.kind.linear  # a fit from parameters that imitate it would not reach it
        if entry.place is None:
            effects.append(Effect(kind=entry.kind.name, where=entry.where, strengths=strengths, shape=true))
        else:
            parts = {"strengths": strengths, "shape": true, "load": entry.load}
            effects.append(Effect.at_place(entry.kind.name, entry.place, **parts))
    try:
        best = study.fitted("truth", tuple(effects), start, start.noise, from_prior=bent).rmse("validate")
    except (RuntimeError, ModelError):
        return math.nan
    last = study.stages[-1].rmse("validate")
    return float(np.mean([last[n] / best[n] for n in last if best.get(n, 0.0) > 0.0]))


def null_trial(seed: int, machine: str = "axis") -> Trial:
    """Diagnose a correct model: any effect named is a false alarm."""
    return diagnosed("null", seed, (), machine)


@lru_cache(maxsize=8)
def _visible(seed: int, machine: str = "axis") -> dict[str, float]:
    """Return the smallest visible strength of every candidate on the records of a seed with nothing hidden."""
    from discrepancy.study.study import Study

    study = Study(machine_module(machine).case(seed).problem(seed=seed))
    scan = study.explain().scan
    return {r.name: float(r.smallest_visible_strength) for r in scan.rows}


def hidden_trial(seed: int, hidden: Sequence[str], suite: str = "kinds", machine: str = "axis") -> Trial:
    """Hide effects at three times their smallest visible strength, or at their usual size, and diagnose."""
    if not getattr(machine_module(machine), "SCALED", True):
        return diagnosed(suite, seed, hidden, machine)
    from discrepancy.effects.from_scan_row import FURTHEST_FACTOR

    visible = _visible(seed, machine)
    usual = machine_module(machine).sizes(seed, list(hidden))
    factors = []
    for effect in usual:
        name = f"{effect['kind']}@{effect['where']}"
        size = _size(effect)
        if name not in visible or not math.isfinite(visible[name]) or size == 0.0:
            note = "no smallest visible strength: the effect is refused on these records"
            return Trial(suite=suite, seed=seed, hidden=tuple(hidden), verdict="refused", found=(), note=note)
        stated = max((abs(v["stated"]) for v in effect["parameters"].values() if "stated" in v), default=math.inf)
        if TIMES_VISIBLE * visible[name] > FURTHEST_FACTOR * stated:
            note = f"these records would not show {FURTHEST_FACTOR:g} times the stated value"
            return Trial(suite=suite, seed=seed, hidden=tuple(hidden), verdict="refused", found=(), note=note)
        factors.append(TIMES_VISIBLE * visible[name] / size)
    return diagnosed(suite, seed, hidden, machine, strength=max(factors))


def _size(effect: Mapping[str, Any]) -> float:
    """Return the size of an effect from ``truth.json``: its strengths, less the stated values where there are any."""
    from discrepancy.effects.kinds import kind_named

    own = {k: v for k, v in effect["parameters"].items() if k in kind_named(effect["kind"]).every_strength}
    return math.hypot(*(v["value"] - v.get("stated", 0.0) for v in own.values()))
