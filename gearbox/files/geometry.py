"""Geometry of a pair of involute helical gears: radii, angles, path of contact, contact ratios, backlash.

Definitions follow ISO 21771 (formerly DIN 3960).  Lengths in m, angles in rad.  Indices 1 and 2 are the driving and the
driven gear, n the normal and t the transverse section, b the base circle, w the working pitch circle.

Along the line of action a point has the coordinate s, zero at the pitch point and growing in the direction in which
contact travels: it begins at the tip of gear 2 (``path_start`` < 0) and ends at the tip of gear 1 (``path_end`` > 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gearbox.files.errors import GearError

__all__ = ["GearPair", "corner_gap", "involute"]

Array = NDArray[np.float64]


def involute(angle: float) -> float:
    """Return the involute function tan α − α.

    Examples
    --------
    >>> round(involute(math.radians(20.0)), 6)
    0.014904
    """
    return math.tan(angle) - angle


def corner_gap(x: Array, tip: float, base: float, base_other: float, distance: float, angle: float) -> Array:
    """Return the gap between a tip corner and the other gear's flank outside the path of contact, m.

    The corner touches the flank where the path of contact ends.  When its gear has turned on (or is still short of it)
    by ``x`` along the line of action, the other gear turning along as the ratio asks, the gap is measured along the
    normal of the flank, in the transverse section.  It depends on the angle of the corner's own gear alone: for a fixed
    corner the gap changes in proportion to the other gear's angle, because the flank is an involute.

    Parameters
    ----------
    x : ndarray, m
        Distance from the end of the path, not negative.
    tip, base : float, m
        Tip and base radius of the gear with the corner.
    base_other : float, m
        Base radius of the other gear.
    distance, angle : float
        Centre distance in m, working transverse pressure angle in rad.
    """
    tangent = math.sqrt(tip**2 - base**2)
    # Seen with the corner's gear at the origin, the line of action runs from its base circle at the angle −α
    # in the direction t; the corner is at the end of the path, a length ``tangent`` from where the line touches.
    t = np.array([math.sin(angle), math.cos(angle)])
    corner = base * np.array([math.cos(angle), -math.sin(angle)]) + tangent * t
    turn = np.asarray(x, dtype=float) / base
    c, s = np.cos(turn), np.sin(turn)
    moved_x, moved_y = c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]
    # Seen from the other gear: its involute through that point, and where the involute then crosses the line.
    from_other = np.hypot(moved_x - distance, moved_y)
    length = np.sqrt(from_other**2 - base_other**2)
    toward = np.arctan2(moved_y, distance - moved_x)
    turned = toward - angle + np.arctan(length / base_other)
    crossing = distance * math.sin(angle) - (length - base_other * turned)
    return np.asarray(tangent + x - crossing)


@dataclass(frozen=True)
class ContactLines:
    """The lines of contact at some position of the gears.

    Parameters
    ----------
    roll : float
        Position in the mesh cycle, base pitches.
    s : tuple of (float, float)
        For each line its two ends along the line of action, m.
    z : tuple of (float, float)
        The same across the face width, m.
    """

    roll: float
    s: tuple[tuple[float, float], ...]
    z: tuple[tuple[float, float], ...]
    base_helix: float

    @property
    def length(self) -> float:
        """Sum of the lengths of the lines, m."""
        return sum(abs(b - a) for a, b in self.z) / math.cos(self.base_helix)


@dataclass(frozen=True, kw_only=True)
class GearPair:
    """Two external involute gears in mesh, in SI units and radians.

    Parameters
    ----------
    teeth_1, teeth_2 : int
        Of the driving and the driven gear.
    module : float, m
        Normal module.
    width : float, m
        Common face width.
    pressure_angle : float, rad
        Normal pressure angle of the basic rack.
    helix_angle : float, rad
        Of the driving gear; positive is right-handed.  The driven gear has the opposite hand.
    shift_1, shift_2 : float
        Profile shift coefficients.
    centre_distance : float, m, optional
        Default: the distance without backlash for the given profile shifts.
    backlash : float, m
        Circumferential backlash at the working pitch circle made by thinner teeth, beyond what the centre distance
        brings.
    addendum, dedendum : float
        Of the basic rack, in modules.
    relief_1, relief_2 : float, m
        Tip relief: how much the tip is set back, along the normal.
    relief_length_1, relief_length_2 : float, m
        Along the line of action; the relief grows with the square of the distance from its beginning.

    Raises
    ------
    GearError
        With everything that is wrong with the gears: interference, a contact ratio below one, pointed teeth, …

    Examples
    --------
    >>> pair = GearPair.paper()
    >>> round(pair.transverse_contact_ratio, 3), round(pair.overlap_ratio, 3)
    (1.639, 0.716)
    """

    teeth_1: int
    teeth_2: int
    module: float
    width: float
    pressure_angle: float = math.radians(20.0)
    helix_angle: float = 0.0
    shift_1: float = 0.0
    shift_2: float = 0.0
    centre_distance: float | None = None
    backlash: float = 0.0
    addendum: float = 1.0
    dedendum: float = 1.25
    relief_1: float = 0.0
    relief_2: float = 0.0
    relief_length_1: float = 3e-3
    relief_length_2: float = 3e-3

    def __post_init__(self) -> None:
        faults = _input_faults(self) or _mesh_faults(self)
        if faults:
            raise GearError(f"the gear pair {self.teeth_1}/{self.teeth_2}", faults)

    @staticmethod
    def paper(**changes: float) -> GearPair:
        """Return the pair of digital twin-assisted gearbox updating, Table 1."""
        given = {"teeth_1": 32, "teeth_2": 44, "module": 3.5e-3, "width": 35e-3, "helix_angle": math.radians(13.0)}
        return GearPair(**{**given, **changes})  # type: ignore[arg-type]

    # ---------------------------------------------------------------- angles

    @cached_property
    def transverse_module(self) -> float:
        """Transverse module m_n / cos β, m."""
        return self.module / math.cos(self.helix_angle)

    @cached_property
    def transverse_pressure_angle(self) -> float:
        """Transverse pressure angle α_t at the pitch circle, rad."""
        return math.atan(math.tan(self.pressure_angle) / math.cos(self.helix_angle))

    @cached_property
    def base_helix_angle(self) -> float:
        """Helix angle β_b at the base circle, rad; its sign is that of the driving gear's hand."""
        return math.atan(math.tan(self.helix_angle) * math.cos(self.transverse_pressure_angle))

    @cached_property
    def working_pressure_angle(self) -> float:
        """Working transverse pressure angle α_wt, rad."""
        if self.centre_distance is not None:
            ratio = self.reference_distance * math.cos(self.transverse_pressure_angle) / self.centre_distance
            return math.acos(min(ratio, 1.0))
        from scipy.optimize import brentq

        wanted = self._tight_involute
        return float(brentq(lambda a: involute(a) - wanted, 1e-9, 1.5, xtol=1e-15))

    @cached_property
    def _tight_involute(self) -> float:
        total = self.teeth_1 + self.teeth_2
        shift = 2.0 * (self.shift_1 + self.shift_2) * math.tan(self.pressure_angle) / total
        return involute(self.transverse_pressure_angle) + shift

    # ---------------------------------------------------------------- radii

    @property
    def ratio(self) -> float:
        """Speed of the driving gear over that of the driven one."""
        return self.teeth_2 / self.teeth_1

    @cached_property
    def pitch_radii(self) -> tuple[float, float]:
        """Reference pitch radii, m."""
        return 0.5 * self.teeth_1 * self.transverse_module, 0.5 * self.teeth_2 * self.transverse_module

    @cached_property
    def base_radii(self) -> tuple[float, float]:
        """Base radii, m."""
        c = math.cos(self.transverse_pressure_angle)
        return self.pitch_radii[0] * c, self.pitch_radii[1] * c

    @cached_property
    def tip_radii(self) -> tuple[float, float]:
        """Tip radii, m."""
        r, h = self.pitch_radii, self.addendum
        return r[0] + (h + self.shift_1) * self.module, r[1] + (h + self.shift_2) * self.module

    @cached_property
    def root_radii(self) -> tuple[float, float]:
        """Root radii, m."""
        r, h = self.pitch_radii, self.dedendum
        return r[0] - (h - self.shift_1) * self.module, r[1] - (h - self.shift_2) * self.module

    @cached_property
    def reference_distance(self) -> float:
        """Sum of the reference pitch radii, m."""
        return sum(self.pitch_radii)

    @cached_property
    def working_distance(self) -> float:
        """Centre distance, m."""
        c = math.cos(self.transverse_pressure_angle) / math.cos(self.working_pressure_angle)
        return self.reference_distance * c

    @cached_property
    def working_radii(self) -> tuple[float, float]:
        """Working pitch radii, m."""
        c = math.cos(self.working_pressure_angle)
        return self.base_radii[0] / c, self.base_radii[1] / c

    # ---------------------------------------------------------------- path of contact

    @cached_property
    def base_pitch(self) -> float:
        """Transverse base pitch, m: distance of neighbouring teeth along the line of action."""
        return math.pi * self.transverse_module * math.cos(self.transverse_pressure_angle)

    @cached_property
    def path_start(self) -> float:
        """Where the tip of gear 2 meets the line of action, m from the pitch point, negative."""
        return -self._beyond_pitch_point(1)

    @cached_property
    def path_end(self) -> float:
        """Where the tip of gear 1 leaves the line of action, m from the pitch point."""
        return self._beyond_pitch_point(0)

    def _beyond_pitch_point(self, gear: int) -> float:
        base = self.base_radii[gear]
        return math.sqrt(self.tip_radii[gear] ** 2 - base**2) - base * math.tan(self.working_pressure_angle)

    @cached_property
    def transverse_contact_ratio(self) -> float:
        """Length of the path of contact over the base pitch, ε_α."""
        return (self.path_end - self.path_start) / self.base_pitch

    @cached_property
    def overlap_ratio(self) -> float:
        """Overlap ratio ε_β: face width over axial pitch."""
        return self.width * abs(math.sin(self.helix_angle)) / (math.pi * self.module)

    @property
    def total_contact_ratio(self) -> float:
        """ε_γ = ε_α + ε_β."""
        return self.transverse_contact_ratio + self.overlap_ratio

    @cached_property
    def tooth_thicknesses(self) -> tuple[float, float]:
        """Transverse tooth thicknesses at the working pitch circles, before thinning for backlash, m."""
        turn = involute(self.transverse_pressure_angle) - involute(self.working_pressure_angle)
        thicknesses = []
        for teeth, radius, shift in zip(
            (self.teeth_1, self.teeth_2), self.working_radii, (self.shift_1, self.shift_2), strict=True
        ):
            half_angle = (math.pi + 4.0 * shift * math.tan(self.pressure_angle)) / (2.0 * teeth)
            thicknesses.append(2.0 * radius * (half_angle + turn))
        return thicknesses[0], thicknesses[1]

    @cached_property
    def circumferential_backlash(self) -> float:
        """Backlash at the working pitch circle, m."""
        pitch = 2.0 * math.pi * self.working_radii[0] / self.teeth_1
        left = pitch - sum(self.tooth_thicknesses)
        return self.backlash + (left if self.centre_distance is not None else 0.0)

    @property
    def normal_backlash(self) -> float:
        """Backlash along the normal of the flanks, m."""
        return self.circumferential_backlash * math.cos(self.working_pressure_angle) * math.cos(self.base_helix_angle)

    # ---------------------------------------------------------------- contact outside the path

    def gap(self, gear: int, x: Array) -> Array:
        """Return the transverse gap of a gear's tip corner (0: driving) beyond its end of the path: `corner_gap`."""
        return corner_gap(
            x,
            self.tip_radii[gear],
            self.base_radii[gear],
            self.base_radii[1 - gear],
            self.working_distance,
            self.working_pressure_angle,
        )

    def gap_coefficients(self, gear: int, reach: float = 4e-3) -> tuple[float, float]:
        """Return c₂, c₃ of the gap c₂x² + c₃x³ that fits `gap` up to ``reach`` (m), in 1/m and 1/m².

        Examples
        --------
        >>> [round(c, 1) for c in GearPair.paper().gap_coefficients(1)]
        [14.1, 492.9]
        """
        x = np.linspace(0.02, 1.0, 50) * reach
        columns = np.stack([np.ones_like(x), x], axis=1)
        coefficients = np.linalg.lstsq(columns, self.gap(gear, x) / x**2, rcond=None)[0]
        return float(coefficients[0]), float(coefficients[1])

    def reach(self, deflection: float) -> float:
        """Return how far beyond its path contact can go when the flanks are pressed in by ``deflection``, m."""
        reaches = []
        for gear in (0, 1):
            c2, c3 = self.gap_coefficients(gear)
            roots = np.roots([c3, c2, 0.0, -deflection])
            reaches.append(min(r.real for r in roots if abs(r.imag) < 1e-12 and r.real > 0.0))
        return max(reaches)

    # ---------------------------------------------------------------- lines of contact

    def contact_lines(self, roll: float) -> ContactLines:
        """Return the lines of contact of the unloaded gears.

        Parameters
        ----------
        roll : float
            Position in the mesh cycle in base pitches: at 0 a tooth of the driving gear touches at the pitch point in
            the middle of the face.
        """
        slope = math.tan(self.base_helix_angle)
        half = 0.5 * self.width
        reach = half * abs(slope)
        s_lines, z_lines = [], []
        first = math.ceil(roll - (self.path_end + reach) / self.base_pitch)
        last = math.floor(roll - (self.path_start - reach) / self.base_pitch)
        for tooth in range(first, last + 1):
            middle = (roll - tooth) * self.base_pitch
            if slope == 0.0:
                z = (-half, half)
            else:
                ends = sorted(((self.path_start - middle) / slope, (self.path_end - middle) / slope))
                z = (max(ends[0], -half), min(ends[1], half))
            if z[1] > z[0]:
                z_lines.append(z)
                s_lines.append((middle + slope * z[0], middle + slope * z[1]))
        return ContactLines(roll, tuple(s_lines), tuple(z_lines), self.base_helix_angle)

    def line_length(self, rolls: Array) -> Array:
        """Return the summed length of the lines of contact over the mesh cycle, m."""
        return np.array([self.contact_lines(float(r)).length for r in np.atleast_1d(rolls)])

    def mesh_frequency(self, speed: float) -> float:
        """Return the mesh frequency f_z = z₁ f_n1 in Hz for a speed of the driving gear in r/min (Eq. 3).

        Examples
        --------
        >>> round(GearPair.paper().mesh_frequency(1006.0), 1)
        536.5
        """
        return self.teeth_1 * speed / 60.0


def _input_faults(pair: GearPair) -> list[str]:
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


def _mesh_faults(pair: GearPair) -> list[str]:
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
