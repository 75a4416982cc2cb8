"""Rails that nobody surveyed: what the reference model lacks without them, and with the guide that three sensors show.

A virtual lift has rough rails; the model under test takes them for straight.  `vtsdt.alignment.align` estimates
from
tension, height and acceleration of the trips that may be used how hard the guides press over height, the model gets
that as its rails, and all are calibrated and laid beside trips that were not used.  The model with the rails as they
are says what more could be had.  Run it with

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
from vtsdt.alignment.estimate import align
from vtsdt.alignment.result import Alignment
from vtsdt.alignment.trips import prepare
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig.models import build
from vtsdt.rig.rails import rail_tables
from vtsdt.rig.rig import LiftRig

SEED = 9410
TRIPS = 8  # the last quarter is held out
#: What shows how hard a guide presses, of cabin and counterweight, which the ropes accelerate against each other.
SENSORS = {
    "cabin": {"tension": ("F_c", 1.0), "height": ("cabin.z", 1.0), "acceleration": ("a_c", 1.0)},
    "counterweight": {"tension": ("F_cw", 1.0), "height": ("counterweight.z", 1.0), "acceleration": ("a_c", -1.0)},
}

Rails = Mapping[str, Mapping[str, list[float]]]


def aligned(case: Case, side: str) -> Alignment:
    """Return the guide of cabin or counterweight as the sensors of the trips for fitting show it."""
    lift = LiftParameters.bench()

    def as_measured(record: Record) -> Record:
        signals = {}
        for role, (name, sign) in SENSORS[side].items():
            signals[role] = replace(record.signals[name], values=sign * record.signals[name].values)
        return replace(record, signals=signals)

    if side == "counterweight":  # to the filter it is a cabin that nobody enters
        lift = replace(lift, cabin=lift.counterweight, cabin_guide=lift.counterweight_guide)
    return align([prepare(as_measured(r)) for r in case.identify], lift)


def rail_of(found: Alignment, side: str) -> Rails:
    """Return the estimate as one rail that presses as hard as all of them do."""
    height, deviation, _ = found.rail
    beyond = 0.5  # m: no trip was there; the rail goes on as it ends
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
    """Print the errors on the trips held out, in SI: rails taken for straight, estimated, and as they are."""
    rig = LiftRig(seed=SEED, trips=TRIPS, under_test="reference", only_express=True)
    case = rig.case()
    estimated: dict[str, Rails] = {}
    for side in SENSORS:
        found = aligned(case, side)
        print(f"{side}: {found}")
        estimated[side] = rail_of(found, side)
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
        told = {q.name: (v - q.value) / q.std for q, v in zip(fit.parameters, fit.values, strict=True)}
        worst = max(told, key=lambda n: abs(told[n]))
        print(f"rails {name}: {worst} is {told[worst]:+.1f} deviations from what is stated")
    table = pd.DataFrame(columns)
    table["noise floor"] = pd.Series(stage.noise)
    print(table.to_string(float_format="{:.4g}".format))
    return table


if __name__ == "__main__":
    main()
