"""The virtual lift for a 1D model that lacks nothing: the lift itself is one-dimensional.

A lift with all 37 states has what no 1D model has: guides that damp and stick.  Here that lift only says which forces
rub along the guides and in the gear; a 1D lift with the true parameters moves under them, and is what is recorded.
Nothing disturbs the lift that says so.  A force that rubs reacts to what disturbs: as a recorded input it would carry
the disturbance into the model, and what the model then makes of it looks like a damping that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.rig import Run
from estimation.response.sensors import SensorError
from multibody.base.progress import Progress
from multibody.machine.model import Model
from vtsdt.lift.lift import Lift
from vtsdt.rig.models import weigh
from vtsdt.rig.parts import disturbed, dressed
from vtsdt.rig.rig import BEFORE, SENSED, LiftRig, seen_by, sources

__all__ = ["PlainLiftRig"]

_RUBS = ("tau_L", "friction_c", "friction_cw")
_MOVES = tuple(n for n in SENSED if n not in _RUBS)


@dataclass(frozen=True)
class PlainLiftRig(LiftRig):
    """The rig of the lift with a one-dimensional lift in it; settings as of `vtsdt.rig.rig.LiftRig`."""

    def record(
        self,
        perturbed: Mapping[str, float],
        hidden: Sequence[Hidden],
        errors: Sequence[SensorError],
        names: Sequence[str],
        progress: Progress,
    ) -> tuple[Model, list[Run]]:
        """Return the true lift, and a run of it for each name."""
        given = self.true_parameters(perturbed)
        guided, plain = Lift.reference(given, payload=(0.0, 0.0, 0.0, 0.0)), Lift.one_dimensional(given)
        weighed = plain.copy()
        weigh(weighed)
        true_model, recorded = self._hiding(weighed, hidden, errors)
        rubbing = dressed(guided.copy(), self.regularisation).build(outputs=sources(_RUBS))
        moving = disturbed(true_model).build(outputs=sources(_MOVES))
        stamps, fine = self.logger.stamps(self.duration), self.logger.fine_grid(self.duration, BEFORE)
        still = {"disturbance.force": (fine[[0, -1]], np.zeros(2))}
        found: list[Run] = []
        for k, name in enumerate(names):
            progress(f"trip {k + 1} of {len(names)}")
            rubs = seen_by(self._run(guided, rubbing, k, fine, (), **still), _RUBS)
            inputs = {n: (fine, v) for n, v in rubs.items()}
            inputs["payload"] = (fine[[0, -1]], np.full(2, self.trip(k).load))
            run = self._run(plain, moving, k, fine, hidden, **inputs)
            seen = {**rubs, **seen_by(run, _MOVES)}
            found.append((name, stamps, self._logged(k, stamps, fine, seen, recorded)))
        return true_model, found
