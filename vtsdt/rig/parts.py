"""What the virtual lift has and no model under test: loss torque of its gear, rough rails, a disturbing force."""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Output, Parameter, Power, Rotation, Translation
from multibody.machine.model import Model

__all__ = ["GearLoss", "RailJoints", "RailWave", "with_disturbance", "with_gear_loss"]


class GearLoss(Component):
    """Loss torque of the planetary gear between motor and pulley: dry, viscous, and a ripple of the meshing teeth.

    torque = -(dry + viscous |ω| + ripple cos(order φ)) tanh(ω/ω_s), on the pulley (González et al. 2020, tau_L in
    Eq. 11: "computed using a torque sensor and used as input in the model").
    """

    dry = Parameter(0.5, "N*m", "level of dry friction", min=0.0)
    viscous = Parameter(0.05, "N*m*s/rad", "viscous part", min=0.0)
    ripple = Parameter(0.05, "N*m", "amplitude over the pulley's angle", min=0.0)
    order = Parameter(16.0, "1/rad", "waves in one radian of the pulley")
    omega_s = Parameter(0.05, "rad/s", "speed below which friction fades", min=1e-9)

    axis = Rotation("pulley")
    support = Rotation("inclination of the support about the same axis")
    torque = Output("N*m", "loss torque on the pulley")
    loss = Power(kind="loss", meaning="power lost in the gear")

    def equations(self):
        speed = self.axis.speed - self.support.speed
        size = self.dry + self.viscous * abs(speed) + self.ripple * math.cos(self.order * self.axis.angle)
        self.torque = -size * math.tanh(speed / self.omega_s)
        self.axis.torque = self.torque
        self.support.torque = -self.torque
        self.loss = -self.torque * speed


class RailWave(Component):
    """A wave of a rough rail: force = -level cos(2π z/length + phase)."""

    level = Parameter(0.0, "N", "amplitude of the force")
    length = Parameter(0.08, "m", "wavelength along the rail", min=1e-4)
    phase = Parameter(0.0, "rad", "phase at height zero")
    axis = Translation("vertical motion of the cabin")

    def equations(self):
        self.axis.force = -self.level * math.cos(2.0 * math.pi * self.axis.position / self.length + self.phase)


class RailJoints(Component):
    """Joints of a rail, one every ``pitch``: each resists over its width like exp(-s²/2)."""

    level = Parameter(0.0, "N", "largest force of a joint")
    pitch = Parameter(0.4, "m", "distance of the joints", min=1e-3)
    first = Parameter(0.1, "m", "height of one of them")
    width = Parameter(0.02, "m", "half width", min=1e-4)
    axis = Translation("vertical motion of the cabin")

    def equations(self):
        angle = math.pi * (self.axis.position - self.first) / self.pitch
        s = math.sin(angle) * self.pitch / (math.pi * self.width)
        self.axis.force = -self.level * math.exp(-0.5 * s * s)


def with_disturbance(model: Model) -> Model:
    """Return a lift with a disturbing force on the cabin."""
    from multibody.library import ForceSource

    rig = model.copy()
    source = rig.add("disturbance", ForceSource())
    rig.connect(source.flange, "cabin.z_axis")
    rig.input("disturbance.force", source.force)
    return rig


def with_gear_loss(model: Model, regularisation: float) -> Model:
    """Return the true lift with the losses of the gear and a disturbing force."""
    rig = with_disturbance(model)
    loss = rig.add("gear_loss", GearLoss())
    rig.connect(loss.axis, "pulley.axis")
    rig.connect(loss.support, "pulley.support")
    fading_speeds = {
        f"{g}.v_s": regularisation * rig.components[g].values["v_s"] for g in ("cabin_guide", "counterweight_guide")
    }
    return rig.with_values(fading_speeds)
