"""Make the figures of the pages about the lift: ``python docs/images/lift_figures.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from vtsdt import Lift, energy_balance, modes_along_trip
from vtsdt.lift import diagram, mode_shapes, one_dimensional_against_reference, trip_strip
from vtsdt.parts.guide import face

HERE = Path(__file__).parent


def contact_law(path: Path) -> None:
    """Draw the force of a flange over its depth at several rates."""
    depth = np.linspace(-1e-4, 3e-4, 801)
    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for rate in (-0.03, 0.0, 0.03):
        axes.plot(depth * 1e3, [face(d, rate, 1.262e4, 120.0, 5e-5) for d in depth], label=f"{rate * 1e3:g} mm/s")
    axes.set_xlabel("depth beyond the clearance [mm]")
    axes.set_ylabel("normal force [N]")
    axes.legend(title="rate", fontsize="small")
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Write all figures into the folder of this file."""
    lift = Lift.reference(profile=True)
    contact_law(HERE / "lift-contact.png")
    diagram(lift).savefig(HERE / "lift-diagram.png", dpi=90)
    trip_strip(lift.trip("up")).savefig(HERE / "lift-trip.png", dpi=90)
    mode_shapes(lift).savefig(HERE / "lift-mode-shapes.png", dpi=80)
    heights = np.linspace(0.0, 1.9, 20)
    figure = modes_along_trip(Lift.reference(name="reference"), heights).plot()
    modes_along_trip(Lift.one_dimensional(name="1D"), heights).plot(figure.axes[0])
    figure.savefig(HERE / "lift-modes.png", dpi=90)
    one_dimensional_against_reference().plot().savefig(HERE / "lift-reduction.png", dpi=70)
    energy_balance(lift).plot().savefig(HERE / "lift-energy.png", dpi=90)


if __name__ == "__main__":
    main()
