"""Kinds of the catalogue that components have in them: of motors, inverters, liquid and heat.

Such a component has the strength as a parameter that is zero unless it is given, so a part of a user's own that takes
`multibody.library.Leaky` or `multibody.library.WarmBody` as its base is asked, too.

Importing this registers them.
"""

from __future__ import annotations

from discrepancy.effects.kinds import Kind, KindText, register
from multibody.declare.component import Component
from multibody.library.electrical import PMSM, DCMotor, DCMotorDrive
from multibody.library.fluid import Leaky, Pipe
from multibody.library.thermal import WarmBody

__all__ = ["BUILT_IN_KINDS"]

#: Currents below which a drop of voltage fades, A: a signal relay's to a large motor's, three decades; chosen.
_CURRENTS = (1e-3, 1e-2, 1e-1, 1.0)


def _currents(name: str) -> list[dict[str, float]]:
    return [{name: current} for current in _CURRENTS]


def _brush_currents(part: Component, ending: str) -> list[dict[str, float]]:
    return _currents("i_brush")


def _dead_time_currents(part: Component, ending: str) -> list[dict[str, float]]:
    return _currents("i_dead")


BUILT_IN_KINDS = (
    Kind(
        name="brush_voltage_drop",
        at="parameter",
        law="DCMotor",
        strengths=("brush_drop",),
        text=KindText(
            "a voltage drop against the current (brushes)",
            "A voltage of nearly constant size that is lost against the current, whatever its size.",
            "Brushes and commutator, 0.5 V to 2 V for a pair; diodes; dead time of the bridge that feeds the motor.",
            "Hold the rotor and raise the voltage slowly: no current flows below the drop, then it rises with 1/R.",
        ),
        one_sided=True,
        component=(DCMotor, DCMotorDrive),
        component_shapes=_brush_currents,
    ),
    Kind(
        name="inverter_dead_time",
        at="parameter",
        law="PMSM",
        strengths=("dead_time_drop",),
        text=KindText(
            "a voltage drop by the inverter's dead time",
            "A voltage of constant size along the current vector that the inverter does not give.",
            "Dead time between the switches: link voltage times dead time times switching frequency, times 4/π.",
            "Hold the rotor and command a small current in steps: the voltage jumps where the current changes sign.",
        ),
        one_sided=True,
        component=PMSM,
        component_shapes=_dead_time_currents,
    ),
    Kind(
        name="laminar_leakage",
        at="parameter",
        law="Leaky",
        strengths=("leak",),
        text=KindText(
            "laminar leakage",
            "A flow in proportion to the pressure that is lost through a narrow gap.",
            "Worn pistons, seals and pump gaps; a drain that is not quite shut.",
            "Close the part in and let the pressure fall: it falls exponentially.",
        ),
        one_sided=True,
        component=Leaky,
    ),
    Kind(
        name="turbulent_leakage",
        at="parameter",
        law="Leaky",
        strengths=("leak_turbulent",),
        text=KindText(
            "turbulent leakage",
            "A flow with the root of the pressure that is lost through a hole or an open valve.",
            "A hole, a broken seal, a valve that does not close.",
            "Close the part in and let the pressure fall: its root falls in a straight line.",
        ),
        one_sided=True,
        component=Leaky,
    ),
    Kind(
        name="flow_loss",
        at="parameter",
        law="Pipe",
        strengths=("quadratic_loss",),
        text=KindText(
            "a pressure loss that grows with the square of the flow",
            "A pressure that is lost in proportion to the squared flow, beyond the laminar friction of the pipe.",
            "Bends, fittings, filters, valves that are partly shut; turbulent flow in a rough pipe.",
            "Compare constant flows: doubling the flow makes this part of the pressure four times larger.",
        ),
        one_sided=True,
        component=Pipe,
    ),
    Kind(
        name="heat_loss",
        at="parameter",
        law="WarmBody",
        strengths=("loss_conductance",),
        text=KindText(
            "heat lost to the surroundings",
            "A heat flow in proportion to the temperature above the surroundings.",
            "Convection, a mount that conducts heat, insulation that is wet or missing.",
            "Heat the part, switch off and let it cool: the temperature falls exponentially towards the surroundings.",
        ),
        one_sided=True,
        component=WarmBody,
    ),
    Kind(
        name="radiation_loss",
        at="parameter",
        law="WarmBody",
        strengths=("radiation",),
        text=KindText(
            "heat lost by radiation",
            "A heat flow with the fourth power of the absolute temperature.",
            "Hot surfaces without insulation, above some 100 °C.",
            "Let the part cool from a high temperature: at first it falls faster than the exponential of its end.",
        ),
        one_sided=True,
        component=WarmBody,
    ),
)

for _kind in BUILT_IN_KINDS:
    register(_kind)
