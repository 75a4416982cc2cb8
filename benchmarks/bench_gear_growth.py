"""Growth of the gear stage with modes, teeth and slices: one evaluation of the rates

Along a mesh cycle at Table 2's parameters.  Twice the teeth of half the module have twice the overlap, and so twice the
lines of contact.  Fixed slices of the face are the cross-check of the integrals along the moving line.  In each turn
the least of 30 passes counts.
"""

from __future__ import annotations

from collections.abc import Callable

from gear_runs import Rates, paper

from gearbox.files.parameters import StageParameters
from gearbox.parts.shipped_housing import box_modes
from gearbox.stage.stage import GearStage


def bench_paper() -> Callable[[], float]:
    """32/44 teeth, moving line of contact, 16 modes"""
    return Rates(paper())


def bench_modes_8() -> Callable[[], float]:
    """8 modes"""
    return Rates(GearStage.paper(modes=box_modes().first(8)))


def bench_modes_0() -> Callable[[], float]:
    """no modes: seats that stand still"""
    return Rates(GearStage.paper(housing="clamped"))


def bench_teeth() -> Callable[[], float]:
    """64/88 teeth of half the module"""
    gears = {"teeth_1": 64.0, "teeth_2": 88.0, "module": 1.75e-3}
    return Rates(GearStage(StageParameters.paper().replaced("gears", **gears)))


def bench_slices_16() -> Callable[[], float]:
    """16 fixed slices"""
    return Rates(GearStage.paper(slices=16))


def bench_slices_31() -> Callable[[], float]:
    """31 fixed slices"""
    return Rates(GearStage.paper(slices=31))


def bench_slices_62() -> Callable[[], float]:
    """62 fixed slices"""
    return Rates(GearStage.paper(slices=62))


def bench_imperfect() -> Callable[[], float]:
    """with all imperfections and bearing defects, all zero"""
    return Rates(GearStage.paper(imperfect=True, bearing_defects=True))
