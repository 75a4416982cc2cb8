"""The shapes that a scan tries of each kind of effect, from how far and how fast a connection moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PERIODS = 3.0  # periods of a resonance in a record, below which it is a movement of its own; chosen
ROWS_PER_PERIOD = 4.0  # rows of the scan in a period, two being the least that can show one; chosen
DAMPING = 0.1  # damping ratio that the scan takes for a resonance: between a ringing part and a rubber mount; chosen

#: Parameters of a law beside its strengths, one set for each point of the grid.
Shapes = list[dict[str, float]]


@dataclass(frozen=True, kw_only=True)
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
    begin, duration, step : float
        First time of the records, length of one and time between its rows as the scan takes them, s; 0 where they are
        not known.
    """

    low: float
    high: float
    speed: float
    turns: bool = False
    scale: float = 0.0
    begin: float = 0.0
    duration: float = 0.0
    step: float = 0.0

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
    """Displacements before sliding that are a part of the travel."""
    return [{"x_s": f * m.half} for f in (0.03, 0.1)]


def small_displacements(m: MotionRange) -> Shapes:
    """Displacements before sliding up to a hundredth of the travel: of a friction that slides nearly everywhere."""
    return [{"x_s": f * m.half} for f in (0.001, 0.003, 0.01)]


def spring(m: MotionRange) -> Shapes:
    """The stiffness of the connection itself."""
    return [{"stiffness": m.scale}]


def spring_gap(m: MotionRange) -> Shapes:
    """Plays from a twentieth of the travel up to all of its half, about no force and about the middle."""
    gaps = [f * m.half for f in (0.05, 0.2, 0.5, 1.0)]
    return [{"stiffness": m.scale, "centre": c, "amplitude": gap} for c in (0.0, m.centre) for gap in gaps]


def pushes(m: MotionRange) -> Shapes:
    """Places along the travel as `spots` takes them, of a force that does not turn with the direction."""
    return [{k: v for k, v in shape.items() if k != "v_s"} for shape in spots(m)]


def end_stops(m: MotionRange) -> Shapes:
    """From both ends of the travel inwards: at a hard stop that the model lacks the machine turns back, a soft one may
    begin anywhere, beyond the middle too.
    """
    ends = [(1.0, m.high), (-1.0, m.low)]
    inwards = (0.05, 0.2, 0.4, 0.8, 1.3)
    return [{"place": end - side * f * m.half, "side": side} for side, end in ends for f in inwards]


def since_begin(m: MotionRange) -> Shapes:
    """Time from which a drift counts."""
    return [{"begin": m.begin}]


def since_begin_sign(m: MotionRange) -> Shapes:
    """Time from which a drift counts, and where dry friction fades."""
    return [{"begin": m.begin, "v_s": m.v_s}]


def spring_since_begin(m: MotionRange) -> Shapes:
    """Time from which the drift of a spring counts, about where it has no force."""
    return [{"begin": m.begin, "centre": 0.0}]


def low_loaded_speeds(m: MotionRange) -> Shapes:
    """Speeds at which the extra friction of starting under load has faded, as `low_speeds` but half as many."""
    return [{"v_stribeck": f * m.speed, "v_s": m.v_s} for f in (0.05, 0.2)]


def filters(m: MotionRange) -> Shapes:
    """Time constants of the filter behind a lag, from what rows can just show; a slow one is for the fit to find."""
    return [{"filter": f * m.step} for f in (2.0, 10.0)]


def fading_sign(m: MotionRange) -> Shapes:
    """Where dry friction fades, at one width."""
    return [{"v_s": m.v_s}]


def resonances(m: MotionRange) -> Shapes:
    """Natural frequencies between a few periods in a record and what its rows can show, close enough to meet one.

    A resonance of the damping ratio ζ is seen over ±ζ of its frequency, so neighbours stand 3 ζ apart, and the scan
    takes a large ζ, with which they are few; the fit goes on from there.
    """
    usual = m.speed / m.half
    low = 2.0 * np.pi * PERIODS / m.duration if m.duration > 0.0 else 3.0 * usual
    high = 2.0 * np.pi / (ROWS_PER_PERIOD * m.step) if m.step > 0.0 else 300.0 * usual
    count = max(2, int(np.ceil(np.log(max(high / low, 2.0)) / np.log1p(3.0 * DAMPING))) + 1)
    grid = np.geomspace(low, max(high, 2.0 * low), count)
    return [{"natural_frequency": float(w), "damping_ratio": DAMPING} for w in grid]
