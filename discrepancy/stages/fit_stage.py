"""A stage: a study's model with some effects in it, fitted to the records and laid beside those held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.stages.export import machine_with_effects
from discrepancy.stages.stage import Stage
from estimation.fit.calibrate import calibrate, evaluate

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.problem.problem import Problem
    from multibody.machine.model import Model

__all__ = ["Held", "fitted_stage", "with_validation"]

#: Values of the parameters, each record's own unknowns, and scales of the outputs that an earlier fit has given.
Held = tuple[Mapping[str, float], Sequence[np.ndarray], Mapping[str, float]]


def fitted_stage(
    problem: Problem,
    origin: Model,
    name: str,
    effects: tuple[Effect, ...],
    start: Stage | None,
    noise: Any,
    *,
    move: bool = True,
    trial: bool = False,
    stated: bool = False,
    held: Held | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Stage:
    """Fit the model with some effects in it and lay it beside the held-out records.

    Parameters
    ----------
    problem : Problem
        Model, records and uncertain parameters as they are confronted.
    origin : Model
        The machine as the user gave it, which the stage's own machine is built from.
    name : str
    effects : tuple of Effect
    start : Stage or None
        Where the fit begins.
    noise : mapping
        Noise floor of each output.
    move : bool
        False leaves the uncertain parameters where they are.
    trial : bool
        A quicker fit, without the held-out records.
    stated : bool
        Begin where the uncertain parameters were stated, and the machine where the sensors put it.
    held : tuple, optional
        What an earlier fit has given: nothing is fitted to the records for identification then.
    progress : callable
    """
    model = problem.model
    for effect in effects:
        model = effect.added_to(model)
    measured = problem.identify[0].outputs
    system = model.build(probes=True)
    slim = model.build(probes=True, outputs=measured)
    sensors = tuple(s for e in effects if (s := e.sensor_error()) is not None)
    parameters = list(problem.uncertain) if move else []
    begun = start.identify.to_dict() if start is not None else {}
    own, scale = _own(start), start.identify.scale if trial and start is not None else None
    if stated:
        begun, own = {k: v for k, v in begun.items() if k not in {q.name for q in problem.uncertain}}, None
    if held is not None:
        begun, own, scale = dict(held[0]), list(held[1]), dict(held[2])
    base = system.parameter_vector({p.name: p.value for p in problem.uncertain})
    for effect in effects:
        parameters += effect.uncertain()
    first = [begun.get(p.name, p.value) for p in parameters]
    found = calibrate(
        slim,
        problem.identify,
        parameters,
        noise=noise,
        sensors=sensors,
        base=base,
        start=first,
        own=own,
        scale=scale,
        max_evaluations=20 if trial else 40,
        hold=held is not None,
        progress=None if trial else progress,
    )
    p = base.copy()
    for key, value in found.to_dict().items():
        if not key.startswith("sensor."):
            p[system.index("parameter", key)] = value
    fitted = tuple(e.with_values(found.to_dict()) for e in effects)
    sensors = tuple(s for e in fitted if (s := e.sensor_error()) is not None)
    beside = None
    if problem.validate and not trial:
        beside = evaluate(slim, problem.validate, found, noise=noise, sensors=sensors, base=base)
    values = {k: v for k, v in found.to_dict().items() if not k.startswith("sensor.")}
    given = {} if move else {q.name: q.value for q in problem.uncertain}
    machine = None
    if not trial:
        units = {n: system.unit(n) for n in measured}
        machine = machine_with_effects(origin, fitted, {**given, **values}, sensors, units)
    return Stage(
        name=name,
        model=model.with_values({**given, **values}),
        system=system,
        slim=slim,
        effects=fitted,
        identify=found,
        validate=beside,
        sensors=sensors,
        p=p,
        noise=noise,
        machine=machine,
    )


def with_validation(problem: Problem, stage: Stage) -> Stage:
    """Return a stage laid beside the held-out records as it is."""
    if not problem.validate:
        return stage
    base = stage.system.parameter_vector({p.name: p.value for p in problem.uncertain})
    held = evaluate(
        stage.slim, problem.validate, stage.identify, noise=stage.noise, sensors=stage.sensors, base=base
    )
    return replace(stage, validate=held)


def _own(stage: Stage | None) -> list[np.ndarray] | None:
    return [np.array(list(f.own.values())) for f in stage.identify.fits] if stage is not None else None
