"""One second of signal of the gear stage: 32/44 teeth, both gears with six motions, 16 modes, 58 states

All 21 outputs at 10 kHz; the static start and 0.15 s in which it dies away are included.  The tolerances are those that
a stage takes by itself (rtol 1e-4, atol 1e-8).  Three points of Table 3: the start (Table 2), the paper's updated point
(Table 4), and the corner with K 4.3e5, C_D 860, e_F 2.5.  The contact damper is what limits explicit steps: one real
eigenvalue of -5e4, -2.7e5 and -5.5e5 1/s, where the largest of the others is 1.7e4 1/s.
"""

from __future__ import annotations

from collections.abc import Callable

from gear_runs import Second


def bench_start() -> Callable[[], None]:
    """Table 2"""
    return Second("Table 2")


def bench_updated() -> Callable[[], None]:
    """updated point"""
    return Second("updated")


def bench_updated_explicit() -> Callable[[], None]:
    """updated point, explicit"""
    return Second("updated", "DormandPrince54")


def bench_corner() -> Callable[[], None]:
    """corner"""
    return Second("corner")


def bench_corner_explicit() -> Callable[[], None]:
    """corner, explicit"""
    return Second("corner", "DormandPrince54")
