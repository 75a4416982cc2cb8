"""Noise of recorded inputs, which the lift's paper mentions as unexplained, added to a virtual lift.

The recorded friction of the guides is input of the 1D model.  Here these two load cells have noise of 0.5 N instead of
0.02 N.  The noise excites the model, and a search that assumes exact inputs may name effects that do not exist.  Each
lift is diagnosed twice: with the inputs as recorded, and with their noise removed, which is the default of a study.
Run it with

    python examples/lift_input_noise.py [SEED …]

A minute for each seed (default 9410).
"""

from __future__ import annotations

import sys
from dataclasses import replace

from discrepancy import Study
from vtsdt.rig import PlainLiftRig

NOISE = {"friction_c": 0.5, "friction_cw": 0.5}
TRIPS = 4
WAYS = ("as recorded", "auto")


def diagnose(seed: int) -> None:
    """Diagnose one lift both ways and print the named effects and the errors on the trip held out."""
    case = PlainLiftRig(seed=seed, trips=TRIPS, sensor_noise=NOISE).case()
    problem = replace(case, offsets=("a_c",)).problem(seed=seed)
    print(f"\n## Lift {seed}\n")
    for inputs in WAYS:
        study = Study(replace(problem, inputs=inputs))
        conclusion = study.diagnose()
        print(f"Inputs {inputs}. {conclusion.sentence}\n")
        errors = {n: study.stages[k].rmse("validate") for n, k in (("calibrated", 1), ("in the end", -1))}
        for name, error in errors.items():
            print(f"    {name}: {', '.join(f'{n} {v:.4g}' for n, v in error.items())} (SI)")
        print()


if __name__ == "__main__":
    for chosen in sys.argv[1:] or ["9410"]:
        diagnose(int(chosen))
