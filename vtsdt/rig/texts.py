"""Texts that are written with recordings of the virtual lift: study file, builder and README."""

from __future__ import annotations

from typing import TYPE_CHECKING

from discrepancy.rigs import texts as rig_texts
from multibody.base.quantity_text import count_text
from vtsdt.rig.parts import GearLoss
from vtsdt.rig.rig import ACCELEROMETER_OFFSET, BEFORE

if TYPE_CHECKING:
    from discrepancy.rigs.case import Case
    from vtsdt.rig.rig import LiftRig

__all__ = ["BUILDER", "configurations_readme", "readme", "study"]

#: Written with the recordings of a lift that has its own parameter file.
BUILDER = '''"""The model under test: a lift with the parameters in lift.toml."""

from pathlib import Path

from vtsdt.rig import models


def build(model="one_dimensional", rails=None):
    """Return the lift at rest at the bottom."""
    return models.build(model, str(Path(__file__).with_name("lift.toml")), rails)
'''
_STATES = {"one_dimensional": 17, "reference": 37, "cabin": 12}


def study(rig: LiftRig, case: Case, own: bool = False) -> str:
    """Return the study file of a case; ``own``: the lift has its own parameter file in the same folder."""
    lines = ["", "[model.arguments]", f'model = "{rig.under_test}"']
    for name, table in rig.model_arguments.get("rails", {}).items():
        lines += [f'[model.arguments.rails."{name}"]']
        lines += [f"{key} = {values}" for key, values in table.items()]
    build = "lift.py:build" if own else "vtsdt.rig.models:build"
    note = ["the control has settled before a record begins; the exact positions of the masses are unknown"]
    return rig_texts.study(case, "a lift", build, lines, start=note, offsets=("a_c",))


def readme(rig: LiftRig, case: Case, command: str) -> str:
    """Return the README of a case: that the data are synthetic and how they were made."""
    loss = GearLoss().values
    loads = ", ".join(f"{m:g}" for m in rig.payloads)
    if rig.rails is None:
        rails = "those of its parameter file"
    else:
        r = rig.rails
        rails = (
            f"each drawn over height in both directions (Matérn spectrum, ν = 3/2, correlation length {r.length:g} m): "
            f"right rails {1e3 * r.mean:.3g} mm towards the body, ± {1e3 * r.rms_x:.2g} mm; left rails ± "
            f"{1e3 * r.rms_x:.2g} mm; across ± {1e3 * r.rms_y:.2g} mm (root mean square)"
        )
    knows = {
        "one_dimensional": "Its inputs are the friction of the guides, which force cells under the shoes measure, the "
        "loss torque of the gear and the payload.",
        "reference": "Its input is the loss torque of the gear; it has the rails from a survey.",
        "cabin": "Its input is the tension of the rope; it has the rails from a survey.",
    }[rig.under_test]
    trips = (
        "All trips go from end to end, up and down alternately."
        if rig.only_express
        else "Up and down alternately; every third trip goes from end to end, the others have stops."
    )
    return f"""# Recordings of a virtual lift

**These data are synthetic.** They come from a simulation and not from a lift. They were made by
`{command}`; the same command gives the same files.

The machine: a scaled lift bench of {rig.parameters.hoistway.travel:g} m travel. A motor behind a planetary gear turns
the pulley, over which ropes carry cabin and counterweight, each between two guide rails. A speed loop around two
current loops follows a speed reference. The rig has 37 states; the model under test (`{rig.under_test}`) has
{_STATES[rig.under_test]}. {knows}

| file | content |
| --- | --- |
| `identify_*.csv.gz` | {count_text(len(case.identify), "trip")} for fitting and choosing |
| `validate_*.csv.gz` | {count_text(len(case.validate), "trip")} held out |
| `study.toml` | the study: `vtsdt diagnose study.toml --out diagnosis` |
| `truth.json` | what was done to the rig, for comparison afterwards; the study does not read it |

Each record lasts {rig.duration:g} s. {trips} Payloads, used in turn: {loads} kg.
Before a record the control has held the cabin for {BEFORE:g} s.

## How the rig differs from the model

- It may have effects that the model lacks, or none; they are in `truth.json`.
- Guides: {rails}.
- The gear loses {loss["dry"]:g} N m and {loss["viscous"]:g} N m s/rad, with a ripple of {loss["ripple"]:g} N m over
  {loss["order"]:g} waves in one radian of the pulley; a torque sensor measures the loss.
- The accelerometer has an offset, drawn with a standard deviation of {ACCELEROMETER_OFFSET:g} m/s²; the study
  estimates it.
- Its parameters were drawn from the priors in the study:

{rig_texts.prior_table(case.uncertain)}

{rig_texts.how_it_ran(rig, "cabin")}
{rig_texts.how_it_was_recorded(rig.logger, case.channels)}
"""


def configurations_readme(names: list[str], command: str) -> str:
    """Return the README of a set of configurations."""
    rows = "\n".join(f"| `{name}/` | trips, study, truth and README of one alignment |" for name in names)
    return f"""# Recordings of a virtual lift in {len(names)} configurations of its guides

**These data are synthetic.** They come from simulations and not from a lift. They were made by
`{command}`; the same command gives the same files.

The same lift with {len(names)} settings of its guides: mean and unevenness of the rails' deviation are drawn for
each. The drawn values are in `truth.json`, which no command reads.

| folder | content |
| --- | --- |
{rows}
"""
