"""The problem that a study solves: a model, its uncertain parameters, and experiments to compare it with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from discrepancy.problem.candidate_patterns import check_patterns
from discrepancy.problem.clocks import found_offsets, with_margin
from discrepancy.problem.held_out import held_out_content
from discrepancy.problem.start_states import at_rest, starts_of_record
from discrepancy.problem.study_file import StudyError, StudyFile, StudyRecords, read_study
from discrepancy.problem.tables import MOST_ROWS, TIME_LIMIT
from estimation.files.record import Record
from estimation.fit.calibrate import UncertainParameter
from estimation.response.experiment import Experiment
from estimation.signals.metrics import LEAST_SAMPLES
from estimation.signals.preparation import Preparation, SignalError
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.problem.tables import StudyTable
    from multibody.machine.model import Model, System

__all__ = ["Problem", "make_experiments", "noise_floors", "read_model", "read_problem"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """Everything that a study starts from.

    Parameters
    ----------
    name : str
    model : Model
    uncertain : tuple of UncertainParameter
        Parameters that calibration may move.
    identify, validate : tuple of Experiment
        Records for fitting and choosing, and records that are never used for either.
    noise : mapping of str to float
        Noise of measured outputs where it is known, SI.
    include, exclude : tuple of str
        Shell patterns over candidates.
    level : float
        Chance, over all candidates of a step together, of naming an effect that is not there.
    seed : int
    max_effects : int
    residual : str
        ``"auto"``, ``"simulation"``, ``"prediction"`` or ``"inverse"``.
    path : Path or None
        The study file.
    warnings : tuple of str
    inputs : {"auto", "as recorded"}
        ``"auto"`` takes noise out of recorded inputs where it matters (`discrepancy.residual.input_noise`).
    search : {"auto", "significance", "evidence"}
        How models are compared: by steps (`discrepancy.search`) or by evidence (`discrepancy.evidence`); ``"auto"``: as
        `Study.searches_by_evidence` says.
    most_rows : int
        Of a record with more rows, sections are used (`discrepancy.residual.sections`).
    time_limit : float
        Processor time of a search after which nothing further is tried, s.
    """

    name: str
    model: Model
    uncertain: tuple[UncertainParameter, ...]
    identify: tuple[Experiment, ...]
    validate: tuple[Experiment, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    include: tuple[str, ...] = ("*",)
    exclude: tuple[str, ...] = ()
    level: float = 0.02
    seed: int = 0
    max_effects: int = 6
    residual: str = "auto"
    path: Path | None = None
    warnings: tuple[str, ...] = ()
    inputs: str = "auto"
    search: str = "auto"
    most_rows: int = MOST_ROWS
    time_limit: float = TIME_LIMIT


def make_experiments(
    model: Model,
    records: Sequence[Record],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    preparation: Preparation | None = None,
    start: Mapping[str, float | Literal["measured"]] | None = None,
    free: Sequence[str] | None = None,
    offsets: Sequence[str] = (),
    held: Sequence[str] = (),
) -> tuple[Experiment, ...]:
    """Return one experiment for each record: what drives the model, what is compared, and where it starts.

    Start values that are not given are estimated for each record, because a machine is seldom exactly where the model
    starts.

    Parameters
    ----------
    model : Model
    records : sequence of Record
    inputs, outputs : sequence of str
        Recorded model inputs and measured model outputs.
    preparation : Preparation, optional
    start : mapping, optional
        Start values of states, or ``"measured"``.
    free : sequence of str, optional
        States whose start is estimated; default: all that ``start`` does not fix with a number.
    offsets : sequence of str
        Outputs whose sensor may have an offset of its own in each record.
    held : sequence of str
        Inputs that keep their value until the next sample.
    """
    start = dict(start or {})
    if free is None or not free:
        fixed = {n for n, v in start.items() if not isinstance(v, str)}
        free = [n for n in model.build().state_names if n not in fixed and not n.startswith("energy.")]
    return tuple(
        Experiment(
            record=record,
            inputs=tuple(inputs),
            outputs=tuple(outputs),
            preparation=preparation or Preparation(),
            start=start,
            free=tuple(free),
            offsets=tuple(offsets),
            held=tuple(held),
        )
        for record in records
    )


def read_problem(
    path: str | Path,
    *,
    seed: int | None = None,
    max_effects: int | None = None,
    recordings: Sequence[Path] | None = None,
) -> Problem:
    """Read a study file, its model and its records, and check that they fit each other.

    Parameters
    ----------
    path : str or Path
    seed, max_effects : int, optional
        Replace those of the file.
    recordings : sequence of Path, optional
        Recordings of the same kind in place of the file's own; none is held out.

    Raises
    ------
    StudyError, RecordError, ModelError
        With all faults of the study, of the records or of the model.
    """
    study, model = read_model(path)
    if recordings is not None:
        study = replace(study, identify=tuple(recordings), validate=(), joined=())
    system = model.build()
    units = {
        "inputs": {q.name: q.unit for q in system.inputs},
        "outputs": {q.name: q.unit for q in system.outputs},
    }
    patterns = check_patterns(
        model.build(probes=True),
        tuple(study.outputs),
        tuple(study.inputs),
        study.candidates.include,
        study.candidates.exclude,
    )
    if patterns.faults:
        raise StudyError([f"{study.path.name}, {text}" for text in patterns.faults])
    records = study.read_records({**units["inputs"], **units["outputs"]})
    faults, doubts = held_out_content(records.identify, records.validate, tuple(study.outputs))
    if faults:
        raise StudyError([f"{study.path.name}, {text}" for text in faults])
    uncertain = _uncertain(study, system)
    identify, validate = _experiments(study, model, system, uncertain, records)
    p = system.parameter_vector({q.name: q.value for q in uncertain})
    if offsets := found_offsets((*identify, *validate), system, p):  # the parts then have other times in common
        records = study.read_records({**units["inputs"], **units["outputs"]}, offsets)
        identify, validate = _experiments(study, model, system, uncertain, records, offsets)
    identify, validate = (with_margin(part, (*identify, *validate)) for part in (identify, validate))
    if study.study.search == "evidence" and any(e.at_own_instants for e in (*identify, *validate)):
        raise StudyError(
            [
                f"{study.path.name}, [study] search: outputs have instants or clocks of their own, which the search by "
                'evidence does not know yet: use search = "significance", or resample in [records]'
            ]
        )
    if model.stepped_part and (asked := _not_of_stepped_units(study.study)):
        raise StudyError([f"{study.path.name}, {text}" for text in asked])
    if faults := [fault for e in (*identify, *validate) if (fault := _too_short(e))]:
        raise StudyError([f"{study.path.name}, {text}" for text in faults])
    of_records = dict.fromkeys(w for r in (*records.identify, *records.validate) for w in r.warnings)
    return Problem(
        name=study.path.stem if study.path.stem != "study" else study.path.parent.name,
        model=model,
        uncertain=uncertain,
        identify=identify,
        validate=validate,
        noise={n: column.noise for n, column in study.outputs.items() if column.noise is not None},
        include=tuple(study.candidates.include),
        exclude=tuple(study.candidates.exclude),
        level=study.study.level,
        seed=study.study.seed if seed is None else seed,
        max_effects=study.study.max_effects if max_effects is None else max_effects,
        residual=study.study.residual,
        path=study.path,
        warnings=(*study.warnings, *patterns.warnings, *doubts, *of_records),
        inputs=study.study.inputs,
        search=study.study.search,
        most_rows=study.study.most_rows,
        time_limit=study.study.time_limit,
    )


def _experiments(
    study: StudyFile,
    model: Model,
    system: System,
    uncertain: Sequence[UncertainParameter],
    records: StudyRecords,
    offsets: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[tuple[Experiment, ...], tuple[Experiment, ...]]:
    """Return the experiments for fitting and those held out, with their start values and clocks."""
    common: dict[str, Any] = {
        "inputs": tuple(study.inputs),
        "outputs": tuple(study.outputs),
        "preparation": study.preparation,
        "offsets": study.offsets.outputs,
        "held": tuple(n for n, column in study.inputs.items() if column.interpolation == "hold"),
    }
    identify, validate = (
        tuple(
            replace(e, clocks=study.fitted_clocks(e.record, offsets))
            for e in _with_starts(study, system, uncertain, make_experiments(model, part, **common))
        )
        for part in (records.identify, records.validate)
    )
    return identify, validate


def _not_of_stepped_units(study: StudyTable) -> list[str]:
    """Return what a study asks for that a unit that is stepped cannot answer."""
    asked = []
    if study.search == "evidence":
        asked.append(('search = "evidence"', 'search = "significance"'))
    if study.residual in ("prediction", "inverse"):
        asked.append((f'residual = "{study.residual}"', 'residual = "simulation"'))
    return [
        f"[study] {given}: the FMU is stepped (Co-Simulation) and shows neither states nor rates: use {remedy}, or "
        "export it for Model Exchange"
        for given, remedy in asked
    ]


def _fitted_starts(study: StudyFile, system: System) -> tuple[str, ...]:
    """Return the states whose start is estimated: all that are not given as numbers."""
    given = study.initial.values
    fixed = {
        name
        for name, value in given.items()
        if all(not isinstance(v, str) for v in (value.values() if isinstance(value, Mapping) else [value]))
    }
    return tuple(n for n in system.state_names if n not in fixed and not n.startswith("energy."))


def _with_starts(
    study: StudyFile, system: System, uncertain: Sequence[UncertainParameter], experiments: Sequence[Experiment]
) -> tuple[Experiment, ...]:
    """Return the experiments with the start values that the study states for each record."""
    p = system.parameter_vector({q.name: q.value for q in uncertain})
    free = study.initial.free or _fitted_starts(study, system)
    begun, faults = [], []
    for e in experiments:
        starts, wrong = starts_of_record(study.initial.values, e.record)
        faults += [f"{study.path.name}, {text}" for text in wrong]
        resting = [n for n, v in starts.items() if v == "equilibrium"]
        e = replace(e, start=starts, free=free)  # type: ignore[arg-type]
        begun.append(at_rest(e, system, resting, p) if resting and not wrong else e)
    if faults:
        raise StudyError(faults)
    return tuple(begun)


def _too_short(experiment: Experiment) -> str:
    """Return why a record cannot be compared, or an empty text."""
    try:
        left = len(experiment.time)
    except SignalError as error:
        return (
            f"[records]: '{experiment.record.path.name}': {error}: keep more of it, by start, stop, edge and decimate"
        )
    if left >= LEAST_SAMPLES:
        return ""
    rows = len(experiment.record.time)
    cause = "" if left == rows else f" of {rows} after start, stop, low_pass_hz, edge and decimate"
    return (
        f"[records]: '{experiment.record.path.name}' ({experiment.name}): has {count_text(left, 'row')}{cause}, at "
        f"least {LEAST_SAMPLES} are needed: name a longer recording{' or keep more of it' if cause else ''}"
    )


def read_model(path: str | Path) -> tuple[StudyFile, Model]:
    """Read a study file and its model, and check that the file's names are names of the model.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    StudyError, ModelError
        With all faults of the study or of the model.
    """
    from discrepancy.problem.fmu_model import with_model_names
    from discrepancy.problem.model import check_names, load_model
    from multibody.machine.model import Model

    study = with_model_names(read_study(path))
    model = load_model(study, Model)
    system = model.build()
    faults = check_names(
        study,
        parameters={q.name: q.unit for q in system.parameters},
        inputs={q.name: q.unit for q in system.inputs},
        outputs={q.name: q.unit for q in system.outputs},
        states={q.name: q.unit for q in system.states},
    )
    faults = (
        *faults,
        *(
            f"{study.path.name}, [inputs]: the model needs its input '{name}' ({system.unit(name)}): add "
            f'"{name}" = "column" to [inputs], or give the model a default for it'
            for name, declared in model.inputs.items()
            if declared.default is None and name not in study.inputs
        ),
    )
    if faults:
        raise StudyError(faults)
    return study, model


def _uncertain(study: StudyFile, system: System) -> tuple[UncertainParameter, ...]:
    parameters, faults = [], []
    for name, given in study.uncertain.items():
        q = system.parameters[system.index("parameter", name)]
        value = q.value if given.value is None else given.value
        low = -np.inf if q.min is None else q.min
        high = np.inf if q.max is None else q.max
        low = low if given.min is None else max(low, given.min)
        high = high if given.max is None else min(high, given.max)
        if not low <= value <= high:
            faults.append(
                f"[uncertain] '{name}': its value {value:g} {q.unit} lies outside its bounds [{low:g}, {high:g}]"
            )
            continue
        std = np.inf if given.std is None else given.std
        parameters.append(
            UncertainParameter(
                name=name, value=float(value), std=float(std), min=float(low), max=float(high), unit=q.unit
            )
        )
    if faults:
        raise StudyError(faults)
    return tuple(parameters)


def noise_floors(experiments: Sequence[Experiment], known: Mapping[str, float]) -> dict[str, float]:
    """Return the noise floor of every output: as given, else estimated from the records."""
    from estimation.signals.metrics import noise_floor, quantisation_step

    def quantisation(e: Experiment, name: str) -> float:
        """Return what rounding leaves after the low-pass, also where the machine stands still and no step is seen."""
        cutoff = e.preparation.cutoff(e.record.rate)
        share = 1.0 if cutoff is None else min(1.0, 2.0 * cutoff / e.record.rate)
        return float(quantisation_step(e.record.signals[name].samples)) * (share / 12.0) ** 0.5

    def noise(e: Experiment, c: int, name: str) -> float:
        own = e.record.signals[name].own  # samples that are repeated on the grid show no noise there
        return float(noise_floor(e.measured[:, c] if own is None else own.values).std)

    floors = {}
    for c, name in enumerate(experiments[0].outputs):
        if name in known:
            floors[name] = float(known[name])
        else:
            floors[name] = float(np.median([max(noise(e, c, name), quantisation(e, name)) for e in experiments]))
    return floors
