"""The one-dimensional virtual lift with what González et al. 2020 name as causes of vibration that their model lacks.

"Namely, the controller's parameters, other guiding rail parameters, such as stiffness or damping, or noise in the
model's input, i.e. ω_ref. Also, the vibrations induced by the guiding system, e.g. due to roughness or bumps in the
guiding rails" (section IV-D).  In one dimension a rail acts as a vertical force that belongs to the cabin's height.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.recording import Channel
from estimation.response.sensors import SensorError
from multibody.machine.model import Model
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig.one_dimensional import PlainLiftRig
from vtsdt.rig.parts import RailJoints, RailWave

__all__ = ["VibratingLiftRig", "broad_band"]


@dataclass(frozen=True, kw_only=True)
class VibratingLiftRig(PlainLiftRig):
    """The rig of a one-dimensional lift that vibrates; other settings are those of `vtsdt.rig.rig.LiftRig`.

    Parameters
    ----------
    waves : tuple of (float, float, float)
        Roughness of the rail: wavelength (m), phase (rad) and amplitude of the force (N) of each wave.
    joints : float, N
        Largest force of a joint.
    speed_gain : float
        Factor on the gain of the speed control, which the model does not know.
    reference_noise : float, rad/s
        Standard deviation of white noise on the recorded speed reference.
    """

    waves: tuple[tuple[float, float, float], ...] = ()
    joints: float = 0.0
    speed_gain: float = 1.0
    reference_noise: float = 0.0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All recorded channels."""
        return tuple(
            dataclasses.replace(c, noise=self.reference_noise) if c.signal == "omega_ref" else c
            for c in super().channels
        )

    def true_parameters(self, perturbed: Mapping[str, float]) -> LiftParameters:
        """Return the true parameters and rails of the rig's lift."""
        gain = self.speed_gain * self.parameters.control.K_pomega
        return super().true_parameters({**perturbed, "control.K_pomega": gain})

    def _hiding(
        self, model: Model, hidden: Sequence[Hidden], errors: Sequence[SensorError]
    ) -> tuple[Model, list[SensorError]]:
        rail, recorded = super()._hiding(model, hidden, errors)
        for k, (length, phase, level) in enumerate(self.waves):
            wave = rail.add(f"rail_wave_{k + 1}", RailWave(length=length, phase=phase, level=level))
            rail.connect(wave.axis, "cabin.z_axis")
        if self.joints:
            part = rail.add("rail_joints", RailJoints(level=self.joints))
            rail.connect(part.axis, "cabin.z_axis")
        return rail, recorded


def broad_band(
    rms: float, count: int, shortest: float, longest: float, rng: np.random.Generator
) -> tuple[tuple[float, float, float], ...]:
    """Return waves of equal size whose lengths are drawn evenly in wave number, with phases drawn.

    Parameters
    ----------
    rms : float, N
        Root mean square of the force of all together.
    count : int
    shortest, longest : float, m
    rng : Generator
    """
    numbers = rng.uniform(1.0 / longest, 1.0 / shortest, count)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    level = rms * float(np.sqrt(2.0 / count))
    return tuple((float(1.0 / n), float(p), level) for n, p in zip(numbers, phases, strict=True))
