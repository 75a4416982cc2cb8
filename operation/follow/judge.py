"""What one record says, by itself: parameters with their deviations, misfit, checks, signals that are not measured.

Nothing of earlier records enters, so that records may come in any order, twice, and be judged on any computer; what
they say together is `operation.follow.watch`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.problem.study_file import StudyError
from estimation.files.faults import RecordError
from estimation.signals.preparation import SignalError
from multibody.base.errors import SimulationError
from operation.follow.settings import FollowSettings
from operation.statistics.local_level import without_prior
from operation.store.judgement import Judgement, Quantity

if TYPE_CHECKING:
    import pandas

    from discrepancy.problem.problem import Problem
    from discrepancy.stages.stage import Stage
    from estimation.files.record import Record

__all__ = ["Judged", "StudyJudge", "with_priors"]

#: Errors that belong to a record and not to the program.
OF_THE_RECORD = (RecordError, SignalError, StudyError, SimulationError)


@dataclass(frozen=True, eq=False)
class Judged:
    """A judgement with the signals that it is about."""

    judgement: Judgement
    series: pandas.DataFrame | None = None


def misfit_name(output: str) -> str:
    """Return the name of the quantity that says how far the model misses an output."""
    return f"misfit of {output}"


def with_priors(problem: Problem, priors: dict[str, tuple[float, float]]) -> Problem:
    """Return a problem whose uncertain parameters have other priors, such as those of a fleet.

    Parameters
    ----------
    problem : Problem
    priors : mapping of str to (float, float)
        Mean and standard deviation by parameter; bounds stay.
    """
    uncertain = tuple(
        replace(u, value=float(np.clip(priors[u.name][0], u.min, u.max)), std=priors[u.name][1])
        if u.name in priors
        else u
        for u in problem.uncertain
    )
    return replace(problem, uncertain=uncertain)


def content_key(records: Sequence[Record]) -> str:
    """Return a digest of the signals of records: the same for a file that was renamed or compressed."""
    digest = hashlib.sha256()
    for record in records:
        digest.update(np.ascontiguousarray(record.time, dtype=float).tobytes())
        for name in sorted(record.signals):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(record.signals[name].values, dtype=float).tobytes())
    return digest.hexdigest()


class StudyJudge:
    """Judges records of the machine that a study describes.

    Parameters
    ----------
    study : str or Path
        The study file.
    settings : FollowSettings
    """

    def __init__(self, study: str | Path, settings: FollowSettings):
        self.study, self.settings = Path(study), settings

    def __call__(self, path: Path, at: float) -> Judged:
        """Judge a recording.

        Parameters
        ----------
        path : Path
        at : float, s
            When it was recorded, since 1970.

        Returns
        -------
        Judged
            With ``refused`` where it could not be judged.
        """
        from discrepancy.problem.problem import read_problem

        try:
            problem = read_problem(self.study, recordings=[path])
        except OF_THE_RECORD as error:
            key = "refused-" + hashlib.sha256(path.read_bytes()).hexdigest()
            return Judged(Judgement(key=key, name=path.name, at=at, refused=str(error)))
        return self.of_problem(problem, path.name, at)

    def of_problem(self, problem: Problem, name: str, at: float) -> Judged:
        """Judge the records of a problem, which are taken together."""
        records = [e.record for e in problem.identify]
        key = content_key(records)
        try:
            quantities, checks = self._quantities(problem)
        except OF_THE_RECORD as error:
            return Judged(Judgement(key=key, name=name, at=at, refused=str(error)), _series(records))
        duration = sum(float(r.time[-1] - r.time[0]) for r in records)
        judgement = Judgement(key=key, name=name, at=at, duration=duration, quantities=quantities, checks=checks)
        return Judged(judgement, _series(records))

    def _quantities(self, problem: Problem) -> tuple[dict[str, Quantity], dict[str, Any]]:
        from discrepancy.study.study import Study

        stage = Study(problem).stage
        fit = stage.identify
        quantities: dict[str, Quantity] = {}
        for u, value, std in zip(fit.parameters, fit.values, fit.std, strict=True):
            prior = (u.value, u.std) if np.isfinite(u.std) else (u.value, np.inf)
            alone, own = without_prior(float(value), float(std), *prior)
            quantities[u.name] = Quantity(value=alone, std=own, unit=u.unit, kind="parameter")
        for output, size in stage.rmse("identify").items():
            quantities[misfit_name(output)] = Quantity(value=size, unit=stage.system.unit(output), kind="misfit")
        for signal in self.settings.conditions:
            values = [e.record.signals[signal] for e in problem.identify if signal in e.record.signals]
            if not values:
                raise StudyError([f"[follow] conditions: no record has a signal '{signal}': name an input or output"])
            mean = float(np.mean(np.concatenate([np.asarray(v.values) for v in values])))
            quantities[f"mean {signal}"] = Quantity(value=mean, unit=values[0].unit, kind="condition")
        for name, signal_values in _virtual(stage, self.settings.virtual).items():
            unit = stage.system.unit(name)
            quantities[f"largest {name}"] = Quantity(
                value=float(np.max(np.abs(signal_values))), unit=unit, kind="virtual"
            )
            quantities[f"rms {name}"] = Quantity(
                value=float(np.sqrt(np.mean(signal_values**2))), unit=unit, kind="virtual"
            )
        return quantities, _checks(stage) if self.settings.checks else {}


def _checks(stage: Stage) -> dict[str, Any]:
    """Return the predictive checks of a diagnosis for a fitted stage."""
    from discrepancy.evidence.checks import checks_by_output, predictive_checks
    from discrepancy.evidence.likelihood import StageLikelihood

    checks = predictive_checks(StageLikelihood(stage=stage))
    by_output = checks_by_output(checks, stage.identify.fits)
    for output, check in by_output.items():
        check["passed"] = all(c.passed for c in checks if c.output == output)
    return by_output


def _virtual(stage: Stage, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return outputs of the fitted model that are not measured, over all records."""
    if not names:
        return {}
    known = stage.model.build().output_names
    if unknown := [n for n in names if n not in known]:
        from multibody.base.spelling import nearest

        raise StudyError([f"[follow] virtual: the model has no output '{n}'{nearest(n, known)}" for n in unknown])
    system = stage.model.build(outputs=list(names))
    p = system.parameter_vector({n: float(stage.p[stage.system.index("parameter", n)]) for n in system.parameter_names})
    runs: dict[str, list[np.ndarray]] = {n: [] for n in names}
    for f in stage.identify.fits:
        e = f.experiment
        x0 = e.start_vector(system)
        for name in e.free:
            x0[system.index("state", name)] = f.own[name]
        run = system.simulate(
            (float(e.record.time[0]), float(e.record.time[-1])),
            inputs={n: (e.record.time, e.record.signals[n].values) for n in e.inputs},
            initial=x0,
            parameters=p,
            times=e.record.time,
        )
        for n in names:
            runs[n].append(run[n])
    return {n: np.concatenate(parts) for n, parts in runs.items()}


def _series(records: Sequence[Record]) -> pandas.DataFrame:
    """Return the signals of records as a table, in SI, with the number of each."""
    import pandas

    parts = []
    for number, record in enumerate(records):
        columns: dict[str, Any] = {"record": np.full(len(record.time), number), "time [s]": record.time}
        columns |= {f"{n} [{s.unit}]" if s.unit else n: s.values for n, s in record.signals.items()}
        parts.append(pandas.DataFrame(columns))
    return pandas.concat(parts, ignore_index=True)
