"""The updated reference model compared with measured trips, with the metrics of González et al. 2020, Table 3."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.signals.metrics import pearson, rmse
from estimation.signals.preparation import low_pass
from multibody.base.gravity import STANDARD_GRAVITY
from multibody.base.progress import Progress, Step, shown_in_notebooks, silent
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.files.trip_records import read_without_study
from vtsdt.lift.lift import Lift

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from estimation.files.record import Record

__all__ = [
    "COLUMNS",
    "TABLE_3",
    "UNITS",
    "TripComparison",
    "compare_trips",
    "read_measured_trips",
    "with_measured_masses",
    "with_rail",
]

#: Columns of the virtual lift by quantity; a settings file can name others.
COLUMNS = {
    "omega_ref": "pulley_speed_ref_rad_per_s",
    "tau_L": "gear_loss_torque_Nm",
    "payload": "payload_kg",
    "omega": "pulley_speed_rad_per_s",
    "i_q": "current_q_A",
    "F_c": "tension_c_N",
    "F_cw": "tension_cw_N",
    "a_c": "cabin_acceleration_m_per_s2",
    "z_c": "cabin_height_mm",
}
UNITS = {
    "omega_ref": "rad/s",
    "tau_L": "N*m",
    "payload": "kg",
    "omega": "rad/s",
    "i_q": "A",
    "F_c": "N",
    "F_cw": "N",
    "a_c": "m/s**2",
    "z_c": "m",
}
#: Quantities of Table 3: (name, unit, the paper's RMSE, its correlation).
TABLE_3 = (
    ("F_cw", "N", 5.75, 0.63),
    ("i_q", "A", 0.03, 0.98),
    ("F_fric", "N", 1.45, 0.72),
    ("F_c", "N", 4.8, 0.63),
    ("a_c", "m/s²", 0.33, 0.59),
    ("alpha", "rad/s²", 2.39, 0.87),
)
#: Low-pass of measurement and model alike, and of the friction, Hz.
LOW_PASS, FRICTION_LOW_PASS = 60.0, 5.0
_DEFAULTS = {"tau_L": 0.0, "payload": 0.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class TripComparison:
    """One trip, measured and simulated, on the times of the record.

    Parameters
    ----------
    name : str
    time : ndarray, shape (n,), s
    measured, model : dict of ndarray
        Quantities of Table 3, low-passed alike, and ``z_c`` and ``v_c``.
    metrics : dict
        Root mean square difference and correlation by quantity.
    loss : (float, float), J
        Energy lost in the cabin's guides, from the measurement as the paper does it, and in the model.
    """

    name: str
    time: np.ndarray
    measured: dict[str, np.ndarray]
    model: dict[str, np.ndarray]
    metrics: dict[str, tuple[float, float]]
    loss: tuple[float, float]

    def to_frame(self) -> pandas.DataFrame:
        """Return Table 3 of this trip."""
        import pandas

        rows = [(n, u, *self.metrics[n]) for n, u, _, _ in TABLE_3]
        return pandas.DataFrame(rows, columns=["quantity", "unit", "RMSE", "correlation"])

    def plot(self) -> Figure:
        """Draw measurement and model over time (Fig. 11)."""
        from matplotlib.figure import Figure

        shown = {
            "F_c": "F_c [N]",
            "F_cw": "F_cw [N]",
            "i_q": "i_q [A]",
            "a_c": "z̈_c [m/s²]",
            "F_fric": "F_fric [N]",
            "alpha": "α [rad/s²]",
        }
        figure = Figure(figsize=(8.4, 8.0), layout="constrained")
        for axis, (name, label) in zip(figure.subplots(6, 1, sharex=True), shown.items(), strict=True):
            axis.plot(self.time, self.measured[name], color="black", linewidth=1.4, label="measured")
            axis.plot(self.time, self.model[name], color="#D55E00", linewidth=0.9, label="model")
            axis.set_ylabel(label)
            axis.grid(color="#eeeeee")
            rms, rho = self.metrics[name]
            axis.set_title(f"RMSE {rms:.3g}, ρ {rho:.2f}", loc="right", fontsize=8, pad=2)
        figure.axes[0].legend(fontsize="small", ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
        figure.axes[-1].set_xlabel("time [s]")
        return figure


def read_measured_trips(
    paths: Sequence[Path], time: str = "time_s", columns: Mapping[str, str] | None = None
) -> list[Record]:
    """Read measured trips.

    Parameters
    ----------
    paths : sequence of Path
    time : str
        Its column.
    columns : mapping of str to str, optional
        Quantity to column; default: as the virtual lift writes them.

    Raises
    ------
    RecordError
        With every fault of every file.
    """
    wanted = {**COLUMNS, **dict(columns or {})}
    return list(
        read_without_study(
            list(paths),
            time=time,
            columns=wanted,
            units=dict(UNITS),
            may_be_constant=("omega_ref", "payload", "tau_L"),
            defaults=dict(_DEFAULTS),
        )
    )


def with_rail(parameters: LiftParameters, rail: ProfileTable | None) -> LiftParameters:
    """Return a lift with the estimated rail as the cabin's right rail; the other profiles of its guide are straight."""
    if rail is None:
        return parameters
    return dataclasses.replace(
        parameters,
        cabin_guide=dataclasses.replace(
            parameters.cabin_guide, right_x=rail.profile, left_x=None, left_y=None, right_y=None
        ),
    )


def with_measured_masses(parameters: LiftParameters, records: Sequence[Record]) -> LiftParameters:
    """Return a lift with masses of cabin and counterweight from the tensions before the trips begin.

    They are the median over all trips of (tension at rest)/g, less the load.  Friction at rest, which has either sign,
    causes an error of its size over g, which is smaller over trips up and down.
    """
    masses: dict[str, list[float]] = {"cabin": [], "counterweight": []}
    for record in records:
        at_rest = np.asarray(record.signals["omega_ref"].values) == 0.0
        count = int(np.argmin(at_rest)) if not at_rest.all() else at_rest.size  # samples before it moves
        if count < 5:
            continue
        rest = {n: float(np.median(np.asarray(record.signals[n].values)[:count])) for n in ("F_c", "F_cw", "payload")}
        masses["cabin"].append(rest["F_c"] / STANDARD_GRAVITY - rest["payload"])
        masses["counterweight"].append(rest["F_cw"] / STANDARD_GRAVITY)
    if not masses["cabin"]:
        return parameters
    changed: dict[str, Any] = {
        side: dataclasses.replace(getattr(parameters, side), mass=float(np.median(values)))
        for side, values in masses.items()
    }
    return dataclasses.replace(parameters, **changed)


@shown_in_notebooks
def compare_trips(
    records: Sequence[Record],
    parameters: LiftParameters | None = None,
    rail: ProfileTable | None = None,
    *,
    progress: Progress = silent,
) -> list[TripComparison]:
    """Simulate measured trips with the updated reference model and compare the signals.

    Inputs of the model are the measured speed reference, the gear's loss torque and the load.  Friction is not measured
    but follows from tension and acceleration, m (z̈ + g) − F_c, below 5 Hz; for the model likewise.

    Parameters
    ----------
    records : sequence of Record
        From `read_measured_trips`.
    parameters : LiftParameters, optional
    rail : ProfileTable, optional
        Estimated profile.
    progress : callable, optional
    """
    given = with_rail(parameters or LiftParameters.bench(), rail)
    lift = Lift.reference(given, payload=(0.0, 0.0, 0.0, 0.0))
    names = ("omega", "i_q", "F_c", "F_cw", "a_c", "z_c", "v_c", "fric_c")
    system = lift.build(outputs=list(names))
    comparisons = []
    for k, record in enumerate(records):
        progress(Step(f"simulate trip {k + 1} of {len(records)}", k, len(records)))
        t = np.asarray(record.time, dtype=float)
        t = t - t[0]
        signal = {n: np.asarray(s.values, dtype=float) for n, s in record.signals.items()}
        load = float(np.median(signal["payload"]))
        lift.payload = (load, 0.0, 0.0, 0.0)
        height = float(np.clip(signal["z_c"][:20].mean(), 0.0, given.hoistway.travel))
        run = lift.trip(
            inputs={"omega_ref": (t, signal["omega_ref"]), "tau_L": (t, signal["tau_L"])},
            height=height,
            until=float(t[-1]),
            step=None,
            times=t,
            system=system,
            parameters={"payload.mass": load},
        )
        comparisons.append(_compare(record.name, t, signal, run, given.cabin.mass + load))
    return comparisons


def _compare(name: str, t: np.ndarray, signal: dict[str, np.ndarray], run: Any, mass: float) -> TripComparison:
    def smooth(values: np.ndarray, cutoff: float = LOW_PASS) -> np.ndarray:
        return np.asarray(low_pass(t, values, cutoff))

    quantities = []
    for source in (signal, {n: np.asarray(run[n]) for n in ("omega", "i_q", "F_c", "F_cw", "a_c", "z_c")}):
        friction = mass * (source["a_c"] + STANDARD_GRAVITY) - source["F_c"]
        quantities.append(
            {
                **{n: smooth(source[n]) for n in ("F_c", "F_cw", "i_q", "a_c")},
                "F_fric": smooth(friction, FRICTION_LOW_PASS),
                "alpha": np.gradient(smooth(source["omega"]), t),
                "z_c": source["z_c"],
                "v_c": np.gradient(smooth(source["z_c"], FRICTION_LOW_PASS), t),
            }
        )
    measured, model = quantities
    metrics = {n: (rmse(measured[n], model[n]), pearson(measured[n], model[n])) for n, *_ in TABLE_3}
    measured_loss = -float(np.trapezoid(measured["F_fric"] * measured["v_c"], t))
    model_loss = -float(np.trapezoid(run["fric_c"] * run["v_c"], t))
    return TripComparison(
        name=name, time=t, measured=measured, model=model, metrics=metrics, loss=(measured_loss, model_loss)
    )
