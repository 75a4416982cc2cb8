"""The fit of a stage: a problem's model with some effects in it, calibrated and evaluated on the records held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.residual.windows import crop, samples_needed
from discrepancy.stages.fitted_machine import machine_with_effects
from discrepancy.stages.stage import Stage
from estimation.fit.calibrate import calibrate, evaluate, simulated_at
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.problem.problem import Problem
    from estimation.fit.calibration import Calibration
    from estimation.response.experiment import Experiment
    from multibody.machine.model import Model

__all__ = ["FittedValues", "fitted_stage", "with_validation"]

#: Shares of the records to which strengths are fitted one after another where the effect of a disturbance accumulates:
#: the model without the effect is right at their beginning, and its error at their end points nowhere.  Doubling from
#: an eighth is chosen.
GROWING_PARTS = (0.125, 0.25, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class FittedValues:
    """The result of an earlier fit.

    Parameters
    ----------
    parameters : mapping of str to float
    own : sequence of ndarray
        Each record's own unknowns.
    scale : mapping of str to float
        Scales of the outputs.
    not_excited : tuple of str, optional
        Parameters that no output depends on; default: it is not known.
    """

    parameters: Mapping[str, float]
    own: Sequence[np.ndarray]
    scale: Mapping[str, float]
    not_excited: tuple[str, ...] | None = None


def fitted_stage(
    problem: Problem,
    origin: Model,
    name: str,
    effects: tuple[Effect, ...],
    start: Stage | None,
    noise: Mapping[str, float],
    *,
    calibrated: bool = True,
    trial: bool = False,
    from_prior: bool = False,
    begin: Mapping[str, float] | None = None,
    values: FittedValues | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Stage:
    """Fit the model with some effects in it and evaluate it on the records held out.

    Parameters
    ----------
    problem : Problem
        Model, records and uncertain parameters, prepared for the mode of the residual.
    origin : Model
        The machine as the user gave it, which the stage's own machine is built from.
    name : str
    effects : tuple of Effect
    start : Stage or None
        Where the fit begins.
    noise : mapping of str to float
        Noise floor of each output.
    calibrated : bool
        False keeps the uncertain parameters at their given values.
    trial : bool
        A quicker fit, without the records held out.
    from_prior : bool
        Begin at the given values of the uncertain parameters and the initial states that the sensors show.
    begin : mapping of str to float, optional
        Values of parameters where the fit begins; default: those of ``start``.
    values : FittedValues, optional
        The result of an earlier fit: nothing is fitted to the records for identification then.
    progress : callable
    """
    stated = {p.name: p.value for p in problem.uncertain}
    if from_prior:
        effects = tuple(_with_stated_spring(e, stated) for e in effects)
    model = problem.model
    for effect in effects:
        model = effect.added_to(model)
    measured = problem.identify[0].outputs
    system = model.build(probes=True)
    slim = model.build(probes=True, outputs=measured)
    sensors = tuple(s for e in effects if (s := e.sensor_error()) is not None)
    parameters = list(problem.uncertain) if calibrated else []
    if begin is None:
        begin = start.identify.to_dict() if start is not None else {}
    own = start.identify.own_values if start is not None else None
    scale = start.identify.scale if trial and start is not None else None
    if from_prior:
        begin, own = {k: v for k, v in begin.items() if k not in stated}, None
    if values is not None:
        begin, own, scale = dict(values.parameters), list(values.own), dict(values.scale)
    base = system.parameter_vector(stated)
    for effect in effects:
        parameters += effect.uncertain()
    fit = partial(
        calibrate,
        slim,
        noise=noise,
        sensors=sensors,
        base=base,
        scale=scale,
    )
    shapes = _shapes_never_fitted(effects, begin) if values is None else frozenset()
    if shapes:
        held = [p for p in parameters if p.name not in shapes]
        accumulates = start is not None and start.disturbance is not None
        for share in GROWING_PARTS if accumulates else (1.0,):
            part = [_first_part(e, share) for e in problem.identify]
            first = fit(part, held, start=[begin.get(p.name, p.value) for p in held], own=own, rounds=1)
            if not first.at_bound:
                begin, own = {**begin, **first.to_dict()}, first.own_values
    start_values = [begin.get(p.name, p.value) for p in parameters]
    if trial and values is not None and values.not_excited is not None:
        calibration = simulated_at(
            slim,
            problem.identify,
            parameters,
            values=start_values,
            own=values.own,
            scale=values.scale,
            not_excited=values.not_excited,
            sensors=sensors,
            base=base,
        )
    else:
        calibration = fit(
            problem.identify,
            parameters,
            start=start_values,
            own=own,
            hold=values is not None,
            progress=None if trial else progress,
        )
    p = base.copy()
    for key, value in calibration.to_dict().items():
        if not key.startswith("sensor."):
            p[system.index("parameter", key)] = value
    fitted = tuple(e.with_values(calibration.to_dict()) for e in effects)
    sensors = tuple(s for e in fitted if (s := e.sensor_error()) is not None)
    validation = None
    if problem.validate and not trial:
        evaluated = partial(evaluate, slim, calibration=calibration, noise=noise, sensors=sensors, base=base)
        validation = _of_those_that_can_be_simulated(evaluated, problem.validate)
    of_model = {} if calibrated else dict(stated)
    of_model |= {k: v for k, v in calibration.to_dict().items() if not k.startswith("sensor.")}
    machine = None
    if not trial:
        units = {n: system.unit(n) for n in measured}
        machine = machine_with_effects(origin, fitted, of_model, sensors, units)
    return Stage(
        name=name,
        model=model.with_values(of_model),
        system=system,
        slim=slim,
        effects=fitted,
        identify=calibration,
        validate=validation,
        sensors=sensors,
        p=p,
        noise=noise,
        machine=machine,
    )


def _with_stated_spring(effect: Effect, stated: Mapping[str, float]) -> Effect:
    """Return an effect that takes back what a spring of the machine does, with the stiffness that is stated for that.

    It was made with the stiffness of a model that lacks it, which may be far softer to make up for a play.
    """
    spring = stated.get(f"{effect.where}.stiffness")
    if spring is None or effect.definition.needs != "stiffness" or "stiffness" not in effect.shape:
        return effect
    return replace(effect, shape={**effect.shape, "stiffness": spring})


def _of_those_that_can_be_simulated(
    evaluated: Callable[[Sequence[Experiment]], Calibration], records: Sequence[Experiment]
) -> Calibration | None:
    """Return the evaluation of the records held out that the model can be simulated on; None where there are none.

    What only one record cannot be simulated on is no reason to lose the others, and the run.
    """
    try:
        return evaluated(records)
    except SimulationError:
        if len(records) == 1:
            return None
    kept = [one for one in records if _of_those_that_can_be_simulated(evaluated, [one]) is not None]
    return evaluated(kept) if kept else None


def with_validation(problem: Problem, stage: Stage) -> Stage:
    """Return a stage evaluated on the records held out, its parameters as they are."""
    if not problem.validate:
        return stage
    base = stage.system.parameter_vector({p.name: p.value for p in problem.uncertain})
    validation = evaluate(
        stage.slim, problem.validate, stage.identify, noise=stage.noise, sensors=stage.sensors, base=base
    )
    return replace(stage, validate=validation)


def _shapes_never_fitted(effects: Sequence[Effect], begin: Mapping[str, float]) -> frozenset[str]:
    """Return the shapes of laws that are not in the model where the fit begins.

    Their strengths are fitted first.  A strength from a linear prediction is coarse, and beside a coarse strength a
    shape runs into a minimum of its own: the order of an angle's harmonic turns its phase along the whole record.
    """
    names = (e.parameter_name(shape) for e in effects for shape in e.definition.free_shapes)
    return frozenset(name for name in names if name not in begin)


def _first_part(experiment: Experiment, share: float) -> Experiment:
    """Return an experiment on the first part of its record, which is never too short for a fit."""
    record, time = experiment.record, experiment.time
    least = samples_needed(experiment.preparation, record.rate) / record.rate
    stop = float(time[0] + max(share * (time[-1] - time[0]), least))
    if stop >= time[-1]:
        return experiment
    return crop(replace(experiment, preparation=replace(experiment.preparation, stop=stop)))
