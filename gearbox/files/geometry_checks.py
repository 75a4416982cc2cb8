"""What can be wrong with a gear pair, told with what to change."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gearbox.files.geometry import GearPair

__all__ = ["input_faults", "mesh_faults"]


def input_faults(pair: GearPair) -> list[str]:
    """Return the faults of the numbers by themselves."""
    faults = []
    for name in ("teeth_1", "teeth_2"):
        teeth = getattr(pair, name)
        if isinstance(teeth, bool) or int(teeth) != teeth or teeth < 5:
            faults.append(f"{name} is {teeth!r}: give a whole number of at least 5 teeth")
    for name in ("module", "width", "addendum", "dedendum", "relief_length_1", "relief_length_2"):
        value = getattr(pair, name)
        if not (math.isfinite(value) and value > 0.0):
            faults.append(f"{name} is {value:g}: give a positive number")
    for name in ("backlash", "relief_1", "relief_2"):
        value = getattr(pair, name)
        if not (math.isfinite(value) and value >= 0.0):
            faults.append(f"{name} is {value:g} m: give zero or more")
    if not math.radians(5.0) <= pair.pressure_angle <= math.radians(35.0):
        degrees = math.degrees(pair.pressure_angle)
        faults.append(f"pressure_angle is {degrees:.4g}°: give 5° to 35° (in rad: is the unit right?)")
    if not abs(pair.helix_angle) <= math.radians(45.0):
        degrees = math.degrees(pair.helix_angle)
        faults.append(f"helix_angle is {degrees:.4g}°: give −45° to 45° (in rad: is the unit right?)")
    return faults


def mesh_faults(pair: GearPair) -> list[str]:
    """Return what keeps two sound gears from running together."""
    tangent_limit = pair.reference_distance * math.cos(pair.transverse_pressure_angle)
    if pair.centre_distance is not None and pair.centre_distance <= tangent_limit:
        return [
            f"centre_distance is {_mm(pair.centre_distance)}, but the base circles alone need more than "
            f"{_mm(tangent_limit)}: move the gears apart"
        ]
    faults = []
    sine = pair.working_distance * math.sin(pair.working_pressure_angle)
    for gear, other in ((0, 1), (1, 0)):
        tangent = math.sqrt(max(pair.tip_radii[gear] ** 2 - pair.base_radii[gear] ** 2, 0.0))
        if tangent >= sine:
            faults.append(
                f"the tip of gear {gear + 1} (radius {_mm(pair.tip_radii[gear])}) reaches below the base circle of "
                f"gear {other + 1}, where there is no involute: the gears interfere; shift the profile of gear "
                f"{other + 1} outwards, shorten the addendum, or take more teeth"
            )
        clearance = pair.working_distance - pair.tip_radii[gear] - pair.root_radii[other]
        if clearance <= 0.0:
            faults.append(
                f"the tip of gear {gear + 1} cuts {_mm(-clearance)} into the root of gear {other + 1}: enlarge the "
                "centre distance or the dedendum"
            )
        if _tip_thickness(pair, gear) <= 0.0:
            faults.append(f"the teeth of gear {gear + 1} are pointed below their tip: reduce shift_{gear + 1}")
        if (limit := _undercut_limit(pair, gear)) > (pair.shift_1, pair.shift_2)[gear] + 1e-9:
            faults.append(
                f"gear {gear + 1} is undercut: its profile shift must be at least {limit:.3f} for "
                f"{(pair.teeth_1, pair.teeth_2)[gear]} teeth"
            )
    if pair.circumferential_backlash < -1e-9:
        faults.append(
            f"the teeth overlap by {_mm(-pair.circumferential_backlash)}: at the centre distance of "
            f"{_mm(pair.working_distance)} they have no room; enlarge it, reduce the profile shifts or add backlash"
        )
    if not any("interfere" in f for f in faults) and pair.transverse_contact_ratio < 1.0:
        faults.append(
            f"the transverse contact ratio is {pair.transverse_contact_ratio:.3f}, below one: between two teeth there "
            "would be moments without contact; reduce the centre distance or take higher teeth"
        )
    return faults


def _tip_thickness(pair: GearPair, gear: int) -> float:
    """Transverse tooth thickness at the tip, m."""
    from gearbox.files.geometry import involute

    at_tip = math.acos(min(pair.base_radii[gear] / pair.tip_radii[gear], 1.0))
    radius = pair.working_radii[gear]
    half_angle = pair.tooth_thicknesses[gear] / (2.0 * radius) + involute(pair.working_pressure_angle)
    return 2.0 * pair.tip_radii[gear] * (half_angle - involute(at_tip))


def _undercut_limit(pair: GearPair, gear: int) -> float:
    """Smallest profile shift at which a rack does not cut into the involute."""
    teeth = (pair.teeth_1, pair.teeth_2)[gear]
    return pair.addendum - teeth * math.sin(pair.transverse_pressure_angle) ** 2 / (2.0 * math.cos(pair.helix_angle))


def _mm(length: float) -> str:
    return f"{length * 1e3:.4g} mm"
