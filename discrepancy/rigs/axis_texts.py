"""The texts written with the recordings of the virtual axis: the study file and the README."""

from __future__ import annotations

from typing import TYPE_CHECKING

from discrepancy.rigs import texts as rig_texts
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.questions.trip_plan import TripPlan
    from discrepancy.rigs.case import Case
    from discrepancy.rigs.rig import Rig

__all__ = ["readme", "study"]


def study(case: Case, coulomb: float | None = None, mass: float | None = None) -> str:
    """Return the study file of a case, with the arguments of its model that are not the usual ones."""
    given = [f"{n} = {v:g}" for n, v in (("mass", mass), ("coulomb", coulomb)) if v is not None]
    arguments = [f"arguments = {{ {', '.join(given)} }}"] if given else []
    note = ["the control has settled before a record begins"]
    return rig_texts.study(case, "a linear axis", "axis.py:build", arguments, start=note)


def readme(rig: Rig, plan: TripPlan, case: Case) -> str:
    """Return the README of a case: that the data are synthetic and how they were made."""
    planned = "" if plan.words == "as recorded" else f"\nThese trips were asked for ({plan}): {plan.words}.\n"
    return f"""# Recordings of a virtual axis

**These data are synthetic.** They come from a simulation and not from a machine. They were made by
`vtsdt bench axis` with seed {rig.seed}; the same command gives the same files.

The machine: a servo motor turns a ball screw through an elastic coupling; the screw moves a carriage on a
guide. A position loop around a speed loop, both on the motor's encoder, follows a position reference.

| file | what it is |
| --- | --- |
| `identify_*.csv.gz` | {count_text(len(case.identify), "trip")} for fitting and choosing |
| `validate_*.csv.gz` | {count_text(len(case.validate), "trip")} held out |
| `axis.py` | the model under test |
| `study.toml` | the study: `vtsdt diagnose study.toml --out diagnosis` |
| `truth.json` | what was done to the rig, for comparing afterwards; the study does not read it |

Each trip lasts {rig.duration:g} s and starts from home, where the control has already settled. It has
several moves of different length, speed (0.06 to 0.6 m/s) and direction, with holds between them.
{planned}
## How the rig differs from the model

- It may have effects that the model lacks, or none; `truth.json` says which.
- Its parameters were drawn from the priors in the study:

{rig_texts.prior_table(case.uncertain)}

{rig_texts.how_it_ran(rig, "carriage")}
{rig_texts.how_it_was_recorded(rig.logger, case.channels)}
"""
