"""The virtual lift for a 1D model that lacks nothing: the lift itself is one-dimensional.

A lift with all 37 states has what no 1D model has: guides that damp and stick.  Here that lift only provides the
friction forces of the guides and the gear; a 1D lift with the true parameters moves under them and is recorded.  The
lift that provides the forces is undisturbed: friction reacts to a disturbance, so as a recorded input it would feed the
disturbance into the model, where its effect looks like missing damping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.rig import Run
from estimation.response.sensors import SensorError
from multibody.base.progress import Progress, Step
from multibody.machine.model import Model
from vtsdt.lift.lift import Lift
from vtsdt.rig.models import add_weighed_load
from vtsdt.rig.parts import with_disturbance, with_gear_loss
from vtsdt.rig.rig import BEFORE, SENSED, LiftRig, seen_by, sources

__all__ = ["PlainLiftRig"]

_FRICTION = ("tau_L", "friction_c", "friction_cw")
_MOTION = tuple(n for n in SENSED if n not in _FRICTION)


@dataclass(frozen=True)
class PlainLiftRig(LiftRig):
    """The rig of a one-dimensional lift; settings are those of `vtsdt.rig.rig.LiftRig`."""

    def record(
        self,
        perturbed: Mapping[str, float],
        hidden: Sequence[Hidden],
        errors: Sequence[SensorError],
        names: Sequence[str],
        progress: Progress,
    ) -> tuple[Model, list[Run]]:
        """Return the true lift and one run for each name."""
        given = self.true_parameters(perturbed)
        guided, plain = Lift.reference(given, payload=(0.0, 0.0, 0.0, 0.0)), Lift.one_dimensional(given)
        weighed = plain.copy()
        add_weighed_load(weighed)
        true_model, recorded = self._hiding(weighed, hidden, errors)
        friction_system = with_gear_loss(guided.copy(), self.regularisation).build(outputs=sources(_FRICTION))
        motion_system = with_disturbance(true_model).build(outputs=sources(_MOTION))
        stamps, fine = self.logger.stamps(self.duration), self.logger.fine_grid(self.duration, BEFORE)
        undisturbed = {"disturbance.force": (fine[[0, -1]], np.zeros(2))}
        runs: list[Run] = []
        for k, name in enumerate(names):
            progress(Step(f"trip {k + 1} of {len(names)}", k, len(names)))
            friction = seen_by(self._run(guided, friction_system, k, fine, (), **undisturbed), _FRICTION)
            inputs = {n: (fine, v) for n, v in friction.items()}
            inputs["payload"] = (fine[[0, -1]], np.full(2, self.trip(k).load))
            run = self._run(plain, motion_system, k, fine, hidden, **inputs)
            seen = {**friction, **seen_by(run, _MOTION)}
            runs.append((name, stamps, self._logged(k, stamps, fine, seen, recorded)))
        return true_model, runs
