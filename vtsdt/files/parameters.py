"""The parameters of a lift, in SI, read from a TOML file and checked.

The shipped bench (``bench.toml``) states the origin of its numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from multibody.base.parameter_file import ParameterError, load_parameters, number
from vtsdt.files.rail_profile import RailProfile, read_profile

__all__ = [
    "BENCH",
    "BodyParameters",
    "ControlParameters",
    "GuideParameters",
    "HoistwayParameters",
    "LiftParameters",
    "MotorParameters",
    "ParameterError",
    "PulleyParameters",
    "RailProfile",
    "RopeParameters",
    "SupportParameters",
    "TripParameters",
]

#: The parameter file of the shipped bench.
BENCH = Path(__file__).with_name("data") / "bench.toml"


#: How a rail's profile is read from a section.
_RAIL = {"read": read_profile}


@dataclass(frozen=True, kw_only=True)
class BodyParameters:
    """Cabin or counterweight, from its origin (the middle of the floor)."""

    mass: float = number("kg", "mass", above=0.0)
    com: tuple[float, ...] = number("m", "centre of mass", size=3)
    inertia: tuple[float, ...] = number("kg*m**2", "principal inertia about the centre of mass", size=3, above=0.0)
    hitch: float = number("m", "height of the rope hitch")
    shoe_x: float = number("m", "shoes at x = ±shoe_x", above=0.0)
    shoe_low: float = number("m", "height of the lower shoes")
    shoe_high: float = number("m", "height of the upper shoes")


@dataclass(frozen=True, kw_only=True)
class GuideParameters:
    """Shoes on two rails."""

    stiffness: float = number("N/m", "contact stiffness of a flange", above=0.0)
    damping: float = number("N*s/m", "contact damping", least=0.0)
    clearance: float = number("m", "clearance of a flange", least=0.0)
    mu: float = number("", "friction coefficient", least=0.0, most=2.0)
    v_s: float = number("m/s", "speed below which friction fades", above=0.0, default=0.01)
    ramp: float = number("m", "depth over which damping sets in", above=0.0, default=5e-5)
    gap: float = number("m", "depth of the shoe's slot", above=0.0, default=8e-3)
    left_x: RailProfile | None = field(default=None, metadata=_RAIL)
    right_x: RailProfile | None = field(default=None, metadata=_RAIL)
    left_y: RailProfile | None = field(default=None, metadata=_RAIL)
    right_y: RailProfile | None = field(default=None, metadata=_RAIL)

    def profiles(self) -> dict[str, RailProfile]:
        """Return the profiles that are given, by name."""
        names = ("left_x", "right_x", "left_y", "right_y")
        return {n: p for n in names if (p := getattr(self, n)) is not None}

    def resampled_as(self, other: GuideParameters) -> GuideParameters:
        """Return the same rails with their points at the heights of another's, where both have a profile."""
        theirs = other.profiles()
        finer: dict[str, Any] = {n: p.resampled(theirs[n].height) for n, p in self.profiles().items() if n in theirs}
        return dataclasses.replace(self, **finer)

    def straightened(self, largest: float | None = None) -> GuideParameters:
        """Return guides whose deviations above ``largest`` (m) are taken to it; None: all rails straight."""
        if largest is None:
            return dataclasses.replace(self, left_x=None, right_x=None, left_y=None, right_y=None)
        clipped: dict[str, Any] = {n: p.clipped(largest) for n, p in self.profiles().items()}
        return dataclasses.replace(self, **clipped)


@dataclass(frozen=True, kw_only=True)
class RopeParameters:
    """Suspension ropes; lengths with the cabin at the bottom."""

    EA: float = number("N", "longitudinal stiffness of one rope", above=0.0)
    damping: float = number("N*s", "damping d of all ropes, d/L for a length L", least=0.0)
    lambda_m: float = number("kg/m", "longitudinal density of all ropes", least=0.0)
    L_0_c: float = number("m", "free length on the cabin's side", above=0.0)
    L_0_cw: float = number("m", "free length on the counterweight's side", above=0.0)
    n: float = number("", "number of ropes", least=1.0, default=1.0)


@dataclass(frozen=True)
class PulleyParameters:
    """Driving pulley."""

    R_p: float = number("m", "radius", above=0.0)
    J_p: float = number("kg*m**2", "inertia with gear and rotor", above=0.0)


@dataclass(frozen=True, kw_only=True)
class SupportParameters:
    """Machine support on four mounts."""

    mass: float = number("kg", "mass", above=0.0)
    J_A: float = number("kg*m**2", "inertia about x", above=0.0)
    J_B: float = number("kg*m**2", "inertia about y", above=0.0)
    stiffness: float = number("N/m", "stiffness of one mount", above=0.0)
    damping: float = number("N*s/m", "damping of one mount", least=0.0)
    mount_x: float = number("m", "mounts at x = ±mount_x", above=0.0)
    mount_y: float = number("m", "mounts at y = ±mount_y", above=0.0)
    arm: float = number("m", "x at which the ropes pull")


@dataclass(frozen=True, kw_only=True)
class MotorParameters:
    """Permanent-magnet motor, motor side, and its gear."""

    R: float = number("ohm", "phase resistance", above=0.0)
    L_d: float = number("H", "inductance along the magnet axis", above=0.0)
    L_q: float = number("H", "inductance across it", above=0.0)
    pole_pairs: float = number("", "pole pairs", least=1.0)
    psi: float = number("Wb", "flux linkage", above=0.0)
    K_T: float = number("N*m/A", "torque constant", above=0.0)
    gear: float = number("", "turns of the motor for one of the pulley", above=0.0, default=1.0)


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """Field-oriented control."""

    K_T: float = number("N*m/A", "torque constant that the controller knows", above=0.0)
    K_pomega: float = number("", "gain of the speed loop")
    T_iomega: float = number("s", "integration time of the speed loop", above=0.0)
    K_pq: float = number("V/A", "gain of the q loop")
    T_iq: float = number("s", "integration time of the q loop", above=0.0)
    K_pd: float = number("V/A", "gain of the d loop")
    T_id: float = number("s", "integration time of the d loop", above=0.0)


@dataclass(frozen=True)
class HoistwayParameters:
    """How far the cabin travels and where the rails begin and end."""

    travel: float = number("m", "travel", above=0.0)
    rail_bottom: float = number("m", "height at which the rails begin")
    rail_top: float = number("m", "height at which the rails end")


@dataclass(frozen=True, kw_only=True)
class TripParameters:
    """The speed reference of a trip from end to end."""

    speed: float = number("m/s", "largest speed", above=0.0)
    acceleration: float = number("m/s**2", "largest acceleration", above=0.0)
    jerk: float = number("m/s**3", "largest jerk; 0 makes a trapezoidal speed without limit of jerk", least=0.0)
    start: float = number("s", "when the reference begins to move", least=0.0, default=0.0)
    duration: float = number("s", "how long the record lasts", above=0.0, default=6.0)


@dataclass(frozen=True, kw_only=True)
class LiftParameters:
    """All numbers of a lift; see the classes of its parts.

    Examples
    --------
    >>> LiftParameters.bench().cabin.mass
    32.0
    """

    name: str
    cabin: BodyParameters
    counterweight: BodyParameters
    cabin_guide: GuideParameters
    counterweight_guide: GuideParameters
    ropes: RopeParameters
    pulley: PulleyParameters
    support: SupportParameters
    motor: MotorParameters
    control: ControlParameters
    hoistway: HoistwayParameters
    trip: TripParameters

    @staticmethod
    def bench() -> LiftParameters:
        """Return the parameters of the shipped bench."""
        return _bench()

    @staticmethod
    def load(path: str | Path) -> LiftParameters:
        """Read a lift's parameters from a TOML file.

        A file with ``extends = "bench"`` contains only what differs from the shipped bench.

        Raises
        ------
        ParameterError
            With every unknown, missing or impossible entry.
        FileNotFoundError
            If there is no such file.
        """
        return load_parameters(LiftParameters, path, "lift", {"bench": LiftParameters.bench})

    def straightened(self, largest: float | None = None) -> LiftParameters:
        """Return the lift with all rail deviations above ``largest`` (m) corrected to it; None: straight rails."""
        return dataclasses.replace(
            self,
            cabin_guide=self.cabin_guide.straightened(largest),
            counterweight_guide=self.counterweight_guide.straightened(largest),
        )

    def lubricated(self, factor: float) -> LiftParameters:
        """Return the lift with both friction coefficients times ``factor``."""
        guides = (self.cabin_guide, self.counterweight_guide)
        a, b = (dataclasses.replace(g, mu=g.mu * factor) for g in guides)
        return dataclasses.replace(self, cabin_guide=a, counterweight_guide=b)

    def faults(self) -> list[str]:
        """Return what does not fit together, each naming the part and the height."""
        return list(_misfits(self))


@lru_cache(maxsize=1)
def _bench() -> LiftParameters:
    return LiftParameters.load(BENCH)


def _misfits(lift: LiftParameters) -> Iterator[str]:
    hoistway = lift.hoistway
    if hoistway.rail_top <= hoistway.rail_bottom:
        yield (
            f"[hoistway] the rails end at {hoistway.rail_top:g} m, below their beginning at {hoistway.rail_bottom:g} m"
        )
        return
    for side in ("cabin", "counterweight"):
        body: BodyParameters = getattr(lift, side)
        guide: GuideParameters = getattr(lift, f"{side}_guide")
        if body.shoe_high <= body.shoe_low:
            yield f"[{side}] shoe_high ({body.shoe_high:g} m) must be above shoe_low ({body.shoe_low:g} m)"
            continue
        low, high = body.shoe_low, hoistway.travel + body.shoe_high
        if hoistway.rail_bottom > low:
            yield (
                f"[hoistway] the rails begin at {hoistway.rail_bottom:g} m, but the {side}'s lower shoes reach down to "
                f"{low:g} m: lower rail_bottom"
            )
        if hoistway.rail_top < high:
            yield (
                f"[hoistway] the rails end at {hoistway.rail_top:g} m, but the {side}'s upper shoes reach {high:g} m "
                "at the end of the travel: raise rail_top or shorten the travel"
            )
        if guide.clearance >= guide.gap:
            yield (
                f"[{side}_guide] the clearance {guide.clearance * 1e3:g} mm is not smaller than the gap of "
                f"{guide.gap * 1e3:g} mm: the shoe would not hold the rail (are the units right?)"
            )
        for name, profile in guide.profiles().items():
            yield from _profile_faults(f"[{side}_guide.{name}]", profile, low, high, guide)
    if lift.ropes.L_0_c <= hoistway.travel:
        yield (
            f"[ropes] L_0_c is {lift.ropes.L_0_c:g} m with the cabin at the bottom, so no rope is left on its side "
            f"after {lift.ropes.L_0_c:g} m of a travel of {hoistway.travel:g} m"
        )


def _profile_faults(name: str, profile: RailProfile, low: float, high: float, guide: GuideParameters) -> Iterator[str]:
    if profile.height[0] > low:
        yield f"{name} begins at {profile.height[0]:g} m, but the shoes reach down to {low:g} m: extend it"
    if profile.height[-1] < high:
        yield (
            f"{name} ends at {profile.height[-1]:g} m, but the shoes reach {high:g} m: the rail is shorter than "
            "the travel"
        )
    for h, d in zip(profile.height, profile.deviation, strict=True):
        if abs(d) > guide.gap:
            yield (
                f"{name} deviates by {d * 1e3:g} mm at {h:g} m, more than the shoe's gap of {guide.gap * 1e3:g} mm "
                "(are the units right?)"
            )
            return
