"""Energy balance of a trip by component, and the energies of González et al. 2020, Table 4."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.declare.declarations import Power
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift
from vtsdt.lift.speed_reference import trip_sign

if TYPE_CHECKING:
    import pandas

    from multibody.system.trajectory import Trajectory

__all__ = ["EnergyBalance", "TripEnergy", "corrective_actions", "energy_balance"]


@dataclass(frozen=True)
class TripEnergy:
    """The energies of Table 4.

    Parameters
    ----------
    E_c, E_cw : float, J
        Lost in the guides of cabin and counterweight (positive).
    E_cb : float, J
        Potential energy that cabin and counterweight give up (positive) or gain.
    E_m : float, J
        Absorbed by the machine at its shaft (positive: it brakes).
    """

    E_c: float
    E_cw: float
    E_cb: float
    E_m: float

    @property
    def net(self) -> float:
        """Potential energy given up less what both guides lose, J: taken by the machine (positive) or given by it."""
        return self.E_cb - self.E_c - self.E_cw

    @property
    def E_in(self) -> float:
        """Energy introduced, J: by the masses where they give up potential energy, by the machine where it motors."""
        return max(self.E_cb, 0.0) + max(-self.net, 0.0)

    @property
    def E_out(self) -> float:
        """Energy received, J: by the masses where they gain potential energy, by the machine where it brakes."""
        return max(-self.E_cb, 0.0) + max(self.net, 0.0)

    @property
    def eta_t(self) -> float:
        """Overall efficiency E_out / E_in, from 0 to 1; NaN where nothing is introduced.

        González et al. 2020, section IV-D: the input comes from "the electric machine or the positive change in
        potential energy".  The machine's energy is that of the balance of potential energy and guide losses, `net`:
        the paper's six values follow it to 0.01 points, and do not follow its printed E_m.  What ropes, support and
        motion take up is left out; in `energy_balance` it is E_cb - E_c - E_cw - E_m.

        Examples
        --------
        >>> braking = TripEnergy(E_c=13.87, E_cw=7.71, E_cb=41.84, E_m=20.25)
        >>> motoring = TripEnergy(E_c=13.87, E_cw=7.71, E_cb=-41.84, E_m=-63.43)
        >>> f"{braking.eta_t:.4f} {motoring.eta_t:.4f}"
        '0.4842 0.6597'
        """
        return self.E_out / self.E_in if self.E_in > 0.0 else float("nan")


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energy of a trip by component and kind.

    Parameters
    ----------
    run : Trajectory
        With the energies integrated along with the motion.
    rows : tuple of (component, quantity, kind, J)
        Kind is stored, lost or supplied.
    """

    run: Trajectory
    rows: tuple[tuple[str, str, str, float], ...]
    trip: TripEnergy

    @property
    def residual(self) -> np.ndarray:
        """Stored plus lost minus supplied since the start, J, over time; zero except for rounding and tolerances."""
        total = self.run["energy.stored"] + self.run["energy.lost"] - self.run["energy.supplied"]
        return total - total[0]

    @property
    def closure(self) -> float:
        """Largest residual over the change in potential energy of cabin and counterweight."""
        return float(np.abs(self.residual).max() / abs(self.trip.E_cb))

    def to_frame(self) -> pandas.DataFrame:
        """Return the rows as a table."""
        import pandas

        return pandas.DataFrame(self.rows, columns=["component", "quantity", "kind", "energy [J]"])

    def plot(self, axes: Any = None) -> Any:
        """Draw stored, lost and supplied energy by component as bars; returns the figure.

        Cabin and counterweight share a bar: each alone is an order of magnitude larger than the rest.
        """
        import matplotlib.pyplot as plt
        from matplotlib.patches import Patch

        others = [r for r in self.rows if r[1] != "potential_energy" and abs(r[3]) > 1e-3 * abs(self.trip.E_cb)]
        shown = [("cabin and counterweight", "potential_energy", "stored", -self.trip.E_cb), *others]
        if axes is None:
            _, axes = plt.subplots(figsize=(7, 0.4 * len(shown) + 1), layout="constrained")
        colours = {"stored": "tab:blue", "lost": "tab:red", "supplied": "tab:green"}
        names, shades = [f"{c}.{q}" for c, q, _, _ in shown], [colours[k] for _, _, k, _ in shown]
        axes.barh(names, [e for *_, e in shown], color=shades)
        axes.invert_yaxis()
        axes.legend(handles=[Patch(color=c, label=k) for k, c in colours.items()], fontsize="small")
        axes.set_xlabel("energy over the trip [J]")
        return axes.figure


def energy_balance(lift: Lift, direction: str = "up", **options: Any) -> EnergyBalance:
    """Simulate a trip and return its energy balance.

    Parameters
    ----------
    lift : Lift
        With drive; friction that is an input counts as lost.
    direction : {"up", "down"}
    options
        Further arguments of `vtsdt.lift.trip.simulate_trip`.
    """
    system = lift.build(energy=True)
    run = lift.trip(direction, system=system, **{"rtol": 1e-8, "atol": 1e-11, **options})
    t = run.times
    rows: list[tuple[str, str, str, float]] = []
    for name in system.output_names:
        owner, _, quantity = name.rpartition(".")
        component = lift.components.get(owner)
        if component is None:
            continue
        item = component.declarations.get(quantity)
        if isinstance(item, Power):
            kind = "lost" if item.kind == "loss" else "supplied"
            rows.append((owner, quantity, kind, float(np.trapezoid(run[name], t))))
        elif quantity.endswith("energy"):
            entry = (owner, quantity, "stored", float(run[name][-1] - run[name][0]))
            if entry not in rows:
                rows.append(entry)
    bodies = [f"{b}.potential_energy" for b in ("cabin", "counterweight", "payload") if b in lift.components]
    potential = -sum(float(run[n][-1] - run[n][0]) for n in bodies)
    losses = [float(np.trapezoid(run[f"{b}_guide.friction_loss"], t)) for b in ("cabin", "counterweight")]
    machine = -float(np.trapezoid(run["machine.torque"] * run["pulley.speed"], t))
    return EnergyBalance(run, tuple(rows), TripEnergy(losses[0], losses[1], potential, machine))


def corrective_actions(
    parameters: LiftParameters | None = None,
    *,
    threshold: float = 2.3e-3,
    lubrication: float = 0.9,
    direction: str = "up",
    **options: Any,
) -> dict[str, TripEnergy]:
    """Return the energies of a trip as it is, with straightened rails, with lubrication, and with both.

    González et al. 2020, Table 4, simulated columns.  What of the shipped bench was fitted to that table stands in
    `vtsdt.papers.table_4`.

    Parameters
    ----------
    threshold : float, m
        Deviations above it are reduced to it.
    lubrication : float
        Factor on both friction coefficients.
    direction : {"up", "down"}
    options
        Further arguments of `vtsdt.lift.trip.simulate_trip`.
    """
    as_is = parameters if parameters is not None else LiftParameters.bench()
    straight = as_is.straightened(threshold)
    # with tables of the same size all four cases have one structure, which is compiled once
    as_is = dataclasses.replace(
        as_is,
        cabin_guide=as_is.cabin_guide.resampled_as(straight.cabin_guide),
        counterweight_guide=as_is.counterweight_guide.resampled_as(straight.counterweight_guide),
    )
    cases = {
        "original": as_is,
        "straightened": straight,
        "lubrication": as_is.lubricated(lubrication),
        "both": straight.lubricated(lubrication),
    }
    start = 0.0 if trip_sign(direction) > 0 else as_is.hoistway.travel
    return {
        name: energy_balance(Lift.reference(given, profile=True, start=start), direction, **options).trip
        for name, given in cases.items()
    }
