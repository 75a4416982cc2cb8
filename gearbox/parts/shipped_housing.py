"""The housing that ships with the gear stage: a box of plates, its modes from finite elements, and rigid on mounts."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from gearbox.parts.housing_modes import ModeSet, read_modes, rigid_modes

__all__ = ["PLACES", "box_modes", "rigid_box"]

#: The mode file of the box.
BOX = Path(__file__).parents[1] / "files" / "data" / "box.toml"
#: Seats and sensors from the middle between the shafts' ends, m: axes at x = -57.5 and 79 mm, end walls at z = ±87 mm,
#: floor at y = -125 mm.
PLACES = {
    "input_low": (-0.0575, 0.0, -0.087),
    "input_high": (-0.0575, 0.0, 0.087),
    "output_low": (0.079, 0.0, -0.087),
    "output_high": (0.079, 0.0, 0.087),
    "input_seat": (-0.0575, 0.03, 0.087),
    "output_seat": (0.079, 0.03, 0.087),
    "base": (0.02, -0.125, 0.087),
}


@lru_cache(maxsize=1)
def box_modes() -> ModeSet:
    """Return the modes of the shipped box; its file says how they were computed.

    It is written anew by ``python -m gearbox.parts.shipped_housing``, with the extra ``[fem]``.
    """
    return read_modes(BOX)


@lru_cache(maxsize=1)
def rigid_box() -> ModeSet:
    """Return the same box as a rigid body on four mounts."""
    return rigid_modes(28.0, (0.35, 0.55, 0.62), PLACES, 4.0e7, 0.14)


def _main() -> None:
    from gearbox.parts.housing_fem import box_housing_modes
    from gearbox.parts.housing_modes import write_modes

    write_modes(box_housing_modes(PLACES, 16, name="box of plates"), BOX)


if __name__ == "__main__":
    _main()
