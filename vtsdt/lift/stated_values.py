"""Parameters of a lift that may be stated wrongly: gains of its controller, its motor, contacts of its shoes.

Importing this module adds them to the catalogue of missing effects.  González et al. (2020) name parameters of the
controller and the stiffness and damping of the contacts as possible causes of vibration that their model does not show.
"""

from __future__ import annotations

from discrepancy.effects.kinds import KindText, register
from discrepancy.effects.stated_values import stated_kind
from vtsdt.parts.control import FieldOrientedControl
from vtsdt.parts.guide import GuidingSystem
from vtsdt.parts.machine import GearedPMSM

__all__ = []

_TUNED = "The drive was tuned again, another parameter set is loaded, units differ from the model's."
_READ = "Read the parameter set from the drive, or record a step of the reference."
_SHOES = "Another lining, ageing, hardened grease, a spring of another stiffness."
_PUSH = "Push the cabin against the rail at standstill and measure force and displacement."
LIFT_KINDS = (
    stated_kind(
        "speed_control_gain",
        FieldOrientedControl,
        "K_pomega",
        KindText(
            "another gain of the speed control",
            "The drive reacts more or less strongly to an error of speed.",
            _TUNED,
            _READ,
        ),
    ),
    stated_kind(
        "speed_control_time",
        FieldOrientedControl,
        "T_iomega",
        KindText(
            "another integration time of the speed control",
            "A lasting error of speed is corrected faster or more slowly.",
            _TUNED,
            _READ,
        ),
    ),
    stated_kind(
        "current_control_gain",
        FieldOrientedControl,
        "K_pq",
        KindText(
            "another gain of the current control", "The current follows its demand more or less closely.", _TUNED, _READ
        ),
    ),
    stated_kind(
        "motor_resistance",
        GearedPMSM,
        "R",
        KindText(
            "another resistance of the motor",
            "The winding needs another voltage for its current than stated.",
            "Temperature (copper: 0.4 % per kelvin), a bad contact, a partly shorted winding.",
            "Measure voltage and current at standstill, cold and warm.",
        ),
    ),
    stated_kind(
        "motor_flux",
        GearedPMSM,
        "psi",
        KindText(
            "another flux of the motor's magnets",
            "Speed induces another voltage than stated.",
            "Warm or weakened magnets, another motor type.",
            "Drive the motor externally and measure the open-circuit voltage.",
        ),
    ),
    stated_kind(
        "contact_stiffness",
        GuidingSystem,
        "stiffness",
        KindText("another stiffness of the shoes", "The shoes are softer or stiffer than stated.", _SHOES, _PUSH),
    ),
    stated_kind(
        "contact_damping",
        GuidingSystem,
        "damping",
        KindText(
            "another damping of the shoes",
            "The shoes damp lateral motion more or less than stated.",
            _SHOES,
            "Push the cabin sideways at standstill and measure how fast its oscillation decays.",
        ),
    ),
    stated_kind(
        "contact_clearance",
        GuidingSystem,
        "clearance",
        KindText(
            "another clearance of the shoes",
            "The shoes have more or less play on the rail than stated.",
            "Wear, thicker or thinner rails, an adjustment.",
            "Measure the play at several heights.",
        ),
    ),
)

for _kind in LIFT_KINDS:
    register(_kind)
