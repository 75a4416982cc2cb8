"""The machine of a stage as a model to save: with the effects, the fitted values and the errors of the sensors."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from discrepancy.effects.sensor_errors import FaultySensor
from discrepancy.residual.prescribed_motion import free_motions
from multibody.declare.declarations import Output

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from estimation.response.sensors import SensorError
    from multibody.machine.model import Model

__all__ = ["machine_with_effects"]

_log = logging.getLogger(__name__)


def machine_with_effects(
    given: Model,
    effects: Sequence[Effect],
    values: Mapping[str, float],
    sensors: Sequence[SensorError] = (),
    units: Mapping[str, str] | None = None,
) -> Model:
    """Return the machine with its effects, so that it can be saved, loaded and simulated without the study.

    A study that compares forces along a given motion works on a copy in which that motion is prescribed; the effects
    are added here to the machine that was handed in.

    Parameters
    ----------
    given : Model
        As the study's builder returned it.
    effects : sequence of Effect
    values : mapping of str to float
        Fitted values by name, SI; those that the machine does not have (an input of the prescribed motion) are left
        out.
    sensors : sequence of SensorError
        Become components between a quantity and the output that reads it.  The output keeps its name where it has one
        of its own; a state that is measured under the state's name is read as ``reading.<state>``.
    units : mapping of str to str, optional
        Units of the measured outputs.
    """
    model = given
    for effect in effects:
        if effect.definition.at == "input" and effect.where not in given.inputs:
            continue
        model = effect.added_to(model)
    known = set(model.build().parameter_names)
    model = model.with_values({k: v for k, v in values.items() if k in known})
    for output in dict.fromkeys(s.output for s in sensors):
        errors = {s.kind: s.value for s in sensors if s.output == output and s.value}
        if errors:
            model = _with_sensor(model, output, errors, (units or {}).get(output, "1"))
    return model


def _with_sensor(model: Model, output: str, errors: dict[str, float], unit: str) -> Model:
    other = model.copy()
    source = other.outputs.get(output, output)
    endpoint = other.find(source)
    if endpoint is None:
        return model  # an output that only the study's copy has, such as the force that a prescribed motion needs
    name = f"sensor.{output}"
    late, slow = errors.pop("delay", 0.0), errors.pop("lag", 0.0)
    given = errors | ({"delay": late} if late > 0.0 else {}) | ({"lag": slow} if slow > 0.0 else {})
    if not isinstance(endpoint[1].declarations.get(endpoint[2]), Output):
        source = _measured(other, source)
        if not source:
            _log.warning("the error of the sensor of '%s' is not in the saved model: %s", output, errors)
            return model
    other.add(name, FaultySensor(unit=unit or "1", late=late > 0.0, slow=slow > 0.0, **given))
    other.connect(source, f"{name}.true")
    if output in other.outputs:
        other.redirect_output(output, f"{name}.reading")
    else:
        other.output(f"reading.{output}", f"{name}.reading")
    return other


def _measured(model: Model, state: str) -> str:
    """Put an ideal sensor on the flange whose motion a state is, and return its output; empty for another state."""
    from multibody.library import AngleSensor, PositionSensor, SpeedSensor, VelocitySensor

    sensors = {"translation": (PositionSensor, VelocitySensor), "rotation": (AngleSensor, SpeedSensor)}
    for states, (_, port, domain) in free_motions(model, model.build()).items():
        if state in states:
            cls = sensors[domain][states.index(state)]
            model.add(f"ideal.{state}", cls())
            model.connect(f"ideal.{state}.flange", port)
            name = next(n for n, q in cls.declarations.items() if isinstance(q, Output))
            return f"ideal.{state}.{name}"
    return ""
