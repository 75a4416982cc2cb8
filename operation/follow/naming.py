"""Which effect has come in: the search of a diagnosis on the records since the model stopped being right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from operation.follow.judge import with_priors
from operation.follow.watch import MachineState

if TYPE_CHECKING:
    import pandas

    from discrepancy.problem.problem import Problem

__all__ = ["NAMED_FROM", "name_effect", "problem_of_series", "reference_priors"]

#: Records that the search uses, the latest: enough for a statement, few enough for minutes.
NAMED_FROM = 4


def reference_priors(state: MachineState, before: float) -> dict[str, tuple[float, float]]:
    """Return what was known of each parameter before a time: its level, as sure as one record could be.

    Parameters
    ----------
    state : MachineState
    before : float, s
        The change point.
    """
    priors = {}
    for name, trace in state.traces.items():
        k = int(np.searchsorted(trace.times, before)) - 1
        if trace.kind == "parameter" and trace.level is not None and k >= 0:
            std = float(np.hypot(trace.level.std[k], trace.between))
            if np.isfinite(std) and std > 0.0:
                priors[name] = float(trace.level.mean[k]), std
    return priors


def problem_of_series(template: Problem, series: Sequence[tuple[str, pandas.DataFrame]]) -> Problem:
    """Return a problem like another one with records from the store.

    Parameters
    ----------
    template : Problem
        Of a record of the same machine.
    series : sequence of (str, DataFrame)
        Names and signals as `operation.follow.judge` keeps them.
    """
    like = template.identify[0]
    experiments = []
    for name, frame in series:
        for number, part in frame.groupby("record"):
            signals = {}
            for signal, given in like.record.signals.items():
                column = f"{signal} [{given.unit}]" if given.unit else signal
                if column in part:
                    signals[signal] = replace(given, values=part[column].to_numpy(dtype=float), own=None)
            record = replace(
                like.record, name=f"{name} {number}", time=part["time [s]"].to_numpy(dtype=float), signals=signals
            )
            experiments.append(replace(like, record=record))
    return replace(template, identify=tuple(experiments), validate=())


def name_effect(problem: Problem, priors: Mapping[str, tuple[float, float]], seed: int = 0) -> dict[str, Any]:
    """Search for what the model lacks on some records, and return verdict, sentence and effects as JSON values.

    Parameters
    ----------
    problem : Problem
    priors : mapping of str to (float, float)
        Of the parameters, from before the change: what has come in must not hide in them.
    seed : int
    """
    from discrepancy.report.diagnosis_json import to_diagnosis
    from discrepancy.study.study import Study

    study = Study(replace(with_priors(problem, dict(priors)), seed=seed))
    conclusion = study.diagnose()
    diagnosis = to_diagnosis(conclusion)
    kept = ("kind", "where", "parameters", "probability", "p_value")
    effects = [{k: e[k] for k in kept if k in e} for e in diagnosis["effects"]]
    return {"verdict": diagnosis["verdict"], "sentence": conclusion.sentence, "effects": effects}
