"""The reduced models compared with the reference (González et al. 2020, section III-A, Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.system.trajectory import Trajectory
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

__all__ = ["Reduction", "cabin_against_reference", "one_dimensional_against_reference"]


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model compared with the reference on one trip.

    Parameters
    ----------
    reference, reduced : Trajectory
    errors : dict
        By signal: RMS difference over the standard deviation of the reference's signal.
    """

    reference: Trajectory
    reduced: Trajectory
    errors: dict[str, float]

    def plot(self) -> Any:
        """Draw the signals of both models and their differences; returns the figure."""
        import matplotlib.pyplot as plt

        names = list(self.errors)
        figure, axes = plt.subplots(
            len(names), 2, sharex=True, squeeze=False, figsize=(10, 1.9 * len(names) + 0.5), layout="constrained"
        )
        t = self.reference.times
        for row, name in zip(axes, names, strict=True):
            unit = self.reference.unit(name) or "1"
            row[0].plot(t, self.reference[name], label="reference", linewidth=1.0)
            row[0].plot(t, self.reduced[name], "--", label="reduced", linewidth=1.0)
            row[1].plot(t, self.reduced[name] - self.reference[name], linewidth=0.8, color="tab:red")
            row[0].set_ylabel(f"{name} [{unit}]")
            row[1].set_ylabel(f"difference [{unit}]")
        axes[0, 0].legend(fontsize="small")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        return figure


def _errors(reference: Trajectory, reduced: Trajectory, names: tuple[str, ...]) -> dict[str, float]:
    return {n: float(np.sqrt(np.mean((reduced[n] - reference[n]) ** 2)) / np.std(reference[n])) for n in names}


def one_dimensional_against_reference(
    parameters: LiftParameters | None = None, direction: str = "up", **options: Any
) -> Reduction:
    """Simulate the same trip with the reference and the 1D model; the reference's friction is input of the 1D model."""
    options = {"rtol": 1e-8, "atol": 1e-11, **options}
    start = 0.0 if direction == "up" else (parameters or LiftParameters.bench()).hoistway.travel
    full = Lift.reference(parameters, start=start, profile=True).trip(direction, **options)
    friction = {n: (full.times, full[n]) for n in ("fric_c", "fric_cw")}
    reduced = Lift.one_dimensional(parameters, start=start, profile=True).trip(
        direction,
        interpolation="cubic",
        inputs={"friction_c": friction["fric_c"], "friction_cw": friction["fric_cw"]},
        **options,
    )
    names = ("zdd_c", "zdd_cw", "F_c", "F_cw", "i_q", "omega", "z_c")
    return Reduction(full, reduced, _errors(full, reduced, names))


def cabin_against_reference(
    parameters: LiftParameters | None = None, direction: str = "up", **options: Any
) -> Reduction:
    """Simulate the same trip with the reference and the cabin model; the reference's tension is input of the cabin.

    The cabin alone is a free integrator: an error of 0.1 % in the tension makes it drift by about 0.17 m in 6 s.
    """
    options = {"rtol": 1e-8, "atol": 1e-11, **options}
    start = 0.0 if direction == "up" else (parameters or LiftParameters.bench()).hoistway.travel
    full = Lift.reference(parameters, start=start, profile=True).trip(direction, **options)
    reduced = Lift.cabin(parameters, start=start).trip(
        direction,
        interpolation="cubic",
        guess={"cabin.z": float(full["z_c"][0])},
        inputs={"F_c": (full.times, full["F_c"])},
        **options,
    )
    return Reduction(full, reduced, _errors(full, reduced, ("zdd_c", "v_c", "z_c", "fric_c", "Nsum_c")))
