"""Kinds of the catalogue for controllers and circuits: values that the model states and the machine does not have.

A connection may lack a force; a controller or a winding lacks nothing, it has another gain or another resistance than
its data sheet says.  The strength of such an effect is the parameter itself, and its absence is the value that the
model came with.  Parameters that the study names as uncertain are calibration's, and the scan refuses them here.

Importing this registers them.
"""

from __future__ import annotations

from discrepancy.effects.kinds import Kind, KindText, register
from multibody.declare.component import Component
from multibody.library.control import PI, CascadedController, PositionController, Proportional
from multibody.library.electrical import PMSM, DCMotor, DCMotorDrive, Resistor

__all__ = ["STATED_KINDS", "stated_kind"]


def stated_kind(
    name: str, component: type[Component] | tuple[type[Component], ...], parameter: str, text: KindText
) -> Kind:
    """Return a kind for a parameter of a component whose stated value may be wrong.

    Parameters
    ----------
    name : str
        Of the kind.
    component : type, or tuple of type
        Classes that have the parameter.
    parameter : str
    text : KindText
        For reports.

    Examples
    --------
    >>> from multibody.library import Spring
    >>> text = KindText("another spring", "The spring is not the one drawn.", "A wrong part.", "Weigh it out.")
    >>> stated_kind("wrong_spring", Spring, "stiffness", text).at
    'parameter'
    """
    classes = component if isinstance(component, tuple) else (component,)
    return Kind(
        name=name,
        at="parameter",
        law=classes[0].__name__,
        strengths=(parameter,),
        text=text,
        component=component,
        stated=True,
    )


_SETTINGS = "Somebody has tuned it, another parameter set is loaded, units or scaling differ from the model's."
_READ = "Read the parameters out of the controller, or record reference, measurement and output of the loop together."
STATED_KINDS = (
    stated_kind(
        "proportional_gain",
        (Proportional, PI),
        "k_p",
        KindText(
            "another proportional gain", "The controller answers more or less strongly than stated.", _SETTINGS, _READ
        ),
    ),
    stated_kind(
        "integral_gain",
        (PI, PositionController),
        "k_i",
        KindText(
            "another integral gain", "The controller's integral rises faster or slower than stated.", _SETTINGS, _READ
        ),
    ),
    stated_kind(
        "position_loop_gain",
        PositionController,
        "k_position",
        KindText(
            "another gain of the position loop",
            "The axis follows its reference more or less closely than stated.",
            _SETTINGS,
            _READ,
        ),
    ),
    stated_kind(
        "speed_loop_gain",
        PositionController,
        "k_speed",
        KindText(
            "another gain of the speed loop",
            "The speed loop answers more or less strongly than stated.",
            _SETTINGS,
            _READ,
        ),
    ),
    stated_kind(
        "current_loop_gain",
        CascadedController,
        "k_current",
        KindText(
            "another gain of the current loop",
            "The current loop answers more or less strongly than stated.",
            _SETTINGS,
            _READ,
        ),
    ),
    stated_kind(
        "resistance",
        (Resistor, DCMotor, DCMotorDrive, PMSM),
        "R",
        KindText(
            "another resistance",
            "A winding or resistor takes another voltage for its current than stated.",
            "Temperature (copper: 0.4 % per kelvin), a bad contact, a long cable, a partly shorted winding.",
            "Measure voltage and current at standstill, cold and warm.",
        ),
    ),
    stated_kind(
        "torque_constant",
        (DCMotor, DCMotorDrive),
        "k_t",
        KindText(
            "another torque constant",
            "The motor gives another torque for its current than stated.",
            "Magnets that are warm or weakened, another motor type, a constant in other units.",
            "Turn the motor from outside and measure the open-circuit voltage.",
        ),
    ),
    stated_kind(
        "magnet_flux",
        PMSM,
        "psi",
        KindText(
            "another flux of the magnets",
            "The motor gives another torque and voltage than stated.",
            "Magnets that are warm or weakened, another motor type, a peak value taken for an effective one.",
            "Turn the motor from outside and measure the open-circuit voltage.",
        ),
    ),
)

for _kind in STATED_KINDS:
    register(_kind)
