"""Rails that were not surveyed: errors of the reference model without them, and with rails estimated by three sensors.

A virtual lift has rough rails; the model under test assumes straight ones.  `vtsdt.alignment.align` estimates from
tension, height and acceleration of the trips for fitting how hard the guides press over height.  The estimate becomes
the rails of the model; all models are calibrated and compared with the trips held out.  The model with the true rails
shows the best that can be reached.  Run it with

    python examples/lift_roughness.py
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from discrepancy import Study
from discrepancy.rigs.case import Case
from estimation.files.record import Record
from vtsdt import LiftParameters, LiftRig
from vtsdt.alignment import Alignment, align, prepare
from vtsdt.rig.models import build
from vtsdt.rig.rails import rail_tables

SEED = 9410
TRIPS = 8  # the last quarter is held out
#: Signals that show how hard a guide presses, for cabin and counterweight, which accelerate in opposite directions.
SENSORS = {
    "cabin": {"tension": ("F_c", 1.0), "height": ("cabin.z", 1.0), "acceleration": ("a_c", 1.0)},
    "counterweight": {"tension": ("F_cw", 1.0), "height": ("counterweight.z", 1.0), "acceleration": ("a_c", -1.0)},
}

Rails = Mapping[str, Mapping[str, list[float]]]


def aligned(case: Case, side: str) -> Alignment:
    """Return the alignment of the guide of cabin or counterweight, estimated from the trips for fitting."""
    lift = LiftParameters.bench()

    def as_measured(record: Record) -> Record:
        signals = {}
        for role, (name, sign) in SENSORS[side].items():
            signals[role] = replace(record.signals[name], values=sign * record.signals[name].values)
        return replace(record, signals=signals)

    if side == "counterweight":  # the filter treats it as a cabin without payload
        lift = replace(lift, cabin=lift.counterweight, cabin_guide=lift.counterweight_guide)
    return align([prepare(as_measured(r)) for r in case.identify], lift)


def rail_of(alignment: Alignment, side: str) -> Rails:
    """Return the estimate as a single rail that presses as hard as all rails."""
    height, deviation, _ = alignment.rail
    beyond = 0.5  # m outside the trips, where the deviation stays constant
    heights = [height[0] - beyond, *height, height[-1] + beyond]
    deltas = 1e3 * np.array([deviation[0], *deviation, deviation[-1]])
    return {f"{side}.right_x": {"height_m": heights, "delta_mm": deltas.tolist()}}


def calibrated(case: Case, rails: Rails) -> Study:
    """Return the study of the reference model on these rails, calibrated."""
    given = replace(case, model=build("reference", rails=rails), offsets=("a_c",))
    study = Study(given.problem(seed=SEED), progress=lambda text: print(f"    {text}", file=sys.stderr))
    study.compare()
    return study


def main() -> pd.DataFrame:
    """Print the errors on the trips held out, in SI: straight rails, estimated rails, true rails."""
    rig = LiftRig(seed=SEED, trips=TRIPS, under_test="reference", only_express=True)
    case = rig.case()
    estimated: dict[str, Rails] = {}
    for side in SENSORS:
        alignment = aligned(case, side)
        print(f"{side}: {alignment}")
        estimated[side] = rail_of(alignment, side)
    models: dict[str, Rails] = {
        "straight": {},
        "cabin's estimated": estimated["cabin"],
        "both estimated": {**estimated["cabin"], **estimated["counterweight"]},
        "as they are": rail_tables(rig.profiles),
    }
    columns = {}
    for name, rails in models.items():
        stage = calibrated(case, rails).stages[-1]
        columns[name] = pd.Series(stage.rmse("validate"))
        fit = stage.identify
        shifts = {q.name: (v - q.value) / q.std for q, v in zip(fit.parameters, fit.values, strict=True)}
        worst = max(shifts, key=lambda n: abs(shifts[n]))
        print(f"rails {name}: {worst} is {shifts[worst]:+.1f} standard deviations from its stated value")
    table = pd.DataFrame(columns)
    table["noise floor"] = pd.Series(stage.noise)
    print(table.to_string(float_format="{:.4g}".format))
    return table


if __name__ == "__main__":
    main()
