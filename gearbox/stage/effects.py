"""Effects that a gear stage may lack, as kinds of the catalogue: what its components have in them at severity zero.

Importing this registers them; a stage built with ``imperfect=True`` and ``bearing_defects=True`` then offers them.
"""

from __future__ import annotations

from discrepancy.effects.kinds import Kind, KindText, register
from gearbox.parts.bearings import BearingBushing
from gearbox.parts.mesh import HelicalMesh
from gearbox.parts.shafts import GearShaft
from multibody.declare.component import Component

__all__ = ["GEAR_KINDS"]

_GEARS = (("gear_1", "_1"), ("gear_2", "_2"))
_LOBES = ("lobes_cos", "lobes_sin", "lobes3_cos", "lobes3_sin", "lobes4_cos", "lobes4_sin")


def _teeth(part: Component, ending: str) -> list[dict[str, float]]:
    """Return the numbers of a gear's teeth, each as a shape to try."""
    return [{"damaged": float(k)} for k in range(int(part.values[f"teeth{ending}"]))]


GEAR_KINDS = (
    Kind(name="eccentricity", at="parameter", law="HelicalMesh", strengths=("runout_x", "runout_y"), text=KindText(
        "an eccentric gear", "The teeth run out of true with their shaft, or their pitch error has one wave.",
        "A gear bored or mounted off its centre, a bent shaft, a worn seat.",
        "Turn the gear by hand with a dial gauge on a pin between its teeth: the reading changes once a turn."),
        component=HelicalMesh, sides=_GEARS),
    Kind(name="pitch_error", at="parameter", law="HelicalMesh", strengths=_LOBES, text=KindText(
        "an error of pitch", "The spacing of the teeth has two to four waves around the gear; a first wave "
        "is an eccentric gear's.",
        "Clamping while the gear was cut, distortion in hardening, a split blank, an uneven cutting machine.",
        "Measure the cumulative pitch error on a gear tester: less its first wave, it has two to four maxima."),
        component=HelicalMesh, sides=_GEARS),
    Kind(name="tooth_defect", at="parameter", law="HelicalMesh", strengths=("crack",), text=KindText(
        "a damaged tooth", "One tooth is softer than the others, or gone.",
        "A crack at the root, a chipped or missing tooth, a large spall.",
        "Look at the teeth; average the vibration over turns of that shaft: one place of the turn stands out."),
        one_sided=True, component=HelicalMesh, sides=_GEARS, component_shapes=_teeth),
    Kind(name="mesh_stiffness_variation", at="parameter", law="HelicalMesh",
         strengths=("variation", "variation_sin"), text=KindText(
        "a stiffness of the teeth that varies over the turn", "The teeth of one side of the gear are stiffer.",
        "A web with holes or ribs, a rim of uneven thickness, hardening that is not even.",
        "Compare the amplitude of the mesh line over the turn at high and at low load: it follows the load."),
        component=HelicalMesh, sides=_GEARS),
    Kind(name="mesh_backlash", at="parameter", law="HelicalMesh", strengths=("added_backlash",), text=KindText(
        "more backlash", "The teeth have more room between them than in the model.",
        "Wear, thin teeth, axes too far apart.",
        "Hold one gear and rock the other with a dial gauge on a tooth."),
        one_sided=True, component=HelicalMesh),
    Kind(name="misalignment", at="parameter", law="HelicalMesh", strengths=("misalignment",), text=KindText(
        "misaligned axes", "The flanks carry at one end of the face only.",
        "Seats out of line, a housing that gives way, a wrong helix correction.",
        "Colour the flanks and run loaded for a moment: the pattern stands at one end."),
        component=HelicalMesh),
    Kind(name="profile_error", at="parameter", law="HelicalMesh",
         strengths=("profile_slope", "profile_form"), text=KindText(
        "an error of the profile", "The flanks have too much or too little material towards the ends of the path.",
        "Wear of the cutter, a wrong pressure angle, missing tip relief.",
        "Measure the profile on a gear tester."),
        component=HelicalMesh),
    Kind(name="wear", at="parameter", law="HelicalMesh", strengths=("wear",), text=KindText(
        "worn flanks", "Material is gone where the flanks slide, none at the pitch line.",
        "Dirty or missing oil, too little surface hardness.",
        "Look at the flanks: a step at the pitch line; measure the profile."),
        one_sided=True, component=HelicalMesh),
    Kind(name="unbalance", at="parameter", law="GearShaft", strengths=("unbalance_x", "unbalance_y"), text=KindText(
        "an unbalance", "The centre of mass lies off the axis of the shaft.",
        "A part added on one side, a bent shaft, a coupling that is not centred.",
        "Run at two speeds without load: the vibration at the shaft's frequency grows with the square of the speed."),
        component=GearShaft),
    Kind(name="bearing_clearance", at="parameter", law="BearingBushing", strengths=("clearance",), text=KindText(
        "play in a bearing", "The shaft moves freely before the bearing carries it.",
        "Wear, a wrong clearance class, a loose seat.",
        "Lift the shaft at the bearing with a dial gauge on it."),
        one_sided=True, component=BearingBushing),
    Kind(name="bearing_defect", at="parameter", law="BearingBushing",
         strengths=("outer_pit", "inner_pit", "element_pit"), text=KindText(
        "a damaged bearing", "A ring or a rolling element has a pit that is rolled over again and again.",
        "Fatigue, dirt, standstill marks, current through the bearing.",
        "Look at the envelope spectrum: lines at the passing frequency of the ring or the element."),
        component=BearingBushing),
)  # fmt: skip

for _kind in GEAR_KINDS:
    register(_kind)
