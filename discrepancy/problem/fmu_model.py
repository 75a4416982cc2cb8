"""The model of a study that names an FMU: the unit as a component, with a place for effects at each connection."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from discrepancy.problem.study_file import StudyError, StudyFile
from multibody.fmi.component import Fmu, Gap
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import ForeignUnit, read_unit
from multibody.machine.model import Model

__all__ = ["fmu_model", "with_model_names"]

#: The unit's name in the model: its parameter ``body.m`` is ``plant.body_m``.
_PLANT = "plant"


def fmu_model(study: StudyFile) -> Model:
    """Return the model of a study with ``[model] fmu``.

    Inputs and outputs have the unit's own names.  An input that the study does not name keeps its start value.

    Raises
    ------
    StudyError
        If the unit or a connection cannot be used.
    """
    unit = _unit(study)
    connections = {
        name: {"force": c.force, "motion": c.motion, "rate": c.rate} for name, c in study.connections.items()
    }
    model = Model(unit.name)
    try:
        plant = model.add(_PLANT, Fmu(unit.path, connections=connections))
    except FmuError as error:
        raise StudyError([f"{study.path.name}, [connections]: {error}"]) from error
    for name in connections:
        gap = model.add(name, Gap())
        model.connect(gap.b, getattr(plant, name))
        model.connect(gap.a, model.ground)
    for v in unit.inputs:
        if v.name in study.inputs:
            model.input(v.name, f"{_PLANT}.{v.own}")
    for v in (*unit.states, *unit.outputs):
        model.output(v.name, f"{_PLANT}.{v.own}")
    return model


def with_model_names(study: StudyFile) -> StudyFile:
    """Return a study whose parameters and states have the names of the model in place of those of the unit."""
    if not study.model.fmu:
        return study
    unit = _unit(study)
    names = {v.name: f"{_PLANT}.{v.own}" for v in (*unit.parameters, *unit.states)}

    def known(entries: Any) -> dict[str, Any]:
        return {names.get(name, name): value for name, value in entries.items()}

    initial = replace(
        study.initial,
        values=known(study.initial.values),
        free=tuple(names.get(n, n) for n in study.initial.free),
    )
    return replace(study, uncertain=known(study.uncertain), initial=initial)


def _unit(study: StudyFile) -> ForeignUnit:
    try:
        return read_unit(study.path.parent / study.model.fmu)
    except FmuError as error:
        raise StudyError([f"{study.path.name}, [model] fmu: {error}"]) from error
