"""The shapes that a scan tries of each kind of effect, from how far and how fast a connection moved."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

#: Parameters of a law beside its strengths, one set for each point of the grid.
Shapes = list[dict[str, float]]


@dataclass(frozen=True)
class MotionRange:
    """How far and how fast a connection moved in the records.

    Parameters
    ----------
    low, high : float
        Travel, m or rad.
    speed : float
        95th percentile of the absolute speed, m/s or rad/s.
    turns : bool
        True for a rotation.
    scale : float
        Stiffness of the connection's own spring where it has one, else 0.
    """

    low: float
    high: float
    speed: float
    _: KW_ONLY
    turns: bool = False
    scale: float = 0.0

    @property
    def centre(self) -> float:
        """Middle of the travel."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Half of the travel."""
        return max(0.5 * (self.high - self.low), 1e-300)

    @property
    def v_s(self) -> float:
        """Speed below which the sign of the speed is smoothed: a hundredth of the speed in the records."""
        return max(0.01 * self.speed, 1e-300)


def smooth_sign(m: MotionRange) -> Shapes:
    """Widths of the speed around rest within which dry friction fades."""
    return [{"v_s": f * m.v_s} for f in (0.3, 1.0, 3.0)]


def low_speeds(m: MotionRange) -> Shapes:
    """Speeds at which the extra friction of starting has faded."""
    return [{"v_stribeck": f * m.speed, "v_s": m.v_s} for f in (0.03, 0.08, 0.2, 0.5)]


def centred(m: MotionRange) -> Shapes:
    """Middle and half of the travel."""
    return [{"centre": m.centre, "half": m.half}]


def centred_sign(m: MotionRange) -> Shapes:
    """Middle and half of the travel, and where dry friction fades."""
    return [{"centre": m.centre, "half": m.half, "v_s": m.v_s}]


def centre(m: MotionRange) -> Shapes:
    """Middle of the travel."""
    return [{"centre": m.centre}]


def bends_about(m: MotionRange) -> Shapes:
    """About the middle of the travel and, where the connection has a spring, about where that has no force."""
    return [{"centre": c} for c in ((0.0, m.centre) if m.scale > 0.0 else (m.centre,))]


def spots(m: MotionRange) -> Shapes:
    """Places along the travel, close enough together to meet a spot of two widths."""
    widths = (0.05 * m.half, 0.15 * m.half)
    return [
        {"place": float(c), "width": float(w), "v_s": m.v_s}
        for w in widths
        for c in np.arange(m.low + 0.5 * w, m.high, 1.2 * w)
    ]


def orders(m: MotionRange) -> Shapes:
    """Whole orders per turn on a shaft; on a slide, wavelengths from half the travel downwards."""
    if m.turns and m.high - m.low > np.pi:
        return [{"order": float(k)} for k in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 36, 48)]
    count = 40
    return [{"order": float(np.pi * k / (2 * m.half) * 2)} for k in np.arange(1.0, count, 0.5)]


def displacements(m: MotionRange) -> Shapes:
    """Displacements before sliding, as shares of the travel."""
    return [{"x_s": f * m.half} for f in (0.003, 0.01, 0.03, 0.1)]


def spring(m: MotionRange) -> Shapes:
    """The stiffness of the connection itself."""
    return [{"stiffness": m.scale}]


def spring_gap(m: MotionRange) -> Shapes:
    """Plays from a twentieth of the travel up to all of its half, about no force and about the middle."""
    gaps = [f * m.half for f in (0.05, 0.2, 0.5, 1.0)]
    return [{"stiffness": m.scale, "centre": c, "amplitude": gap} for c in (0.0, m.centre) for gap in gaps]


def end_stops(m: MotionRange) -> Shapes:
    """From both ends of the travel inwards: at a hard stop that the model lacks the machine turns back, a soft one may
    begin anywhere, beyond the middle too.
    """
    ends = [(1.0, m.high), (-1.0, m.low)]
    inwards = (0.05, 0.2, 0.4, 0.8, 1.3)
    return [{"place": end - side * f * m.half, "side": side} for side, end in ends for f in inwards]
