"""Evaluate and draw the comfort of a recorded ride up a skyscraper.

The recording was made by others (see its PROVENANCE.md) and is read from the folder in VTSDT_DATA.  Run it with

    VTSDT_DATA=… python examples/ride_comfort.py ride.png
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from vtsdt import RideComfort, ride_comfort


def evaluate(data: Path) -> RideComfort:
    """Return the indicators of the part in which the telephone lay on the floor."""
    table = np.genfromtxt(data / "lift_ride" / "lift_ride.csv", delimiter=",", names=True)
    floor = table["phone_on_floor"] == 1
    return ride_comfort(table["time_s"][floor], table["specific_force_z_m_per_s2"][floor], name="ride up a skyscraper")


if __name__ == "__main__":
    if "VTSDT_DATA" not in os.environ:
        sys.exit("set VTSDT_DATA to the folder with the recordings")
    ride = evaluate(Path(os.environ["VTSDT_DATA"]))
    print(ride.to_frame().to_string(index=False))
    print("\n".join(ride.notes))
    if len(sys.argv) > 1:
        ride.plot().savefig(sys.argv[1], dpi=130)
