"""Noise of recorded inputs, which the lift's paper names among what it leaves unexplained, put into a virtual lift.

The 1D model takes the friction of the guides as recorded.  Here those two load cells are noisy: 0.5 N for 0.02 N.
The noise shakes the model, and a search that takes the inputs for exact may name physics that is not there.  Every
lift is diagnosed twice, with the inputs as recorded and with the noise taken out of them as a study does by itself.
Run it with

    python examples/lift_input_noise.py [SEED …]

A minute for each seed (default 9410).
"""

from __future__ import annotations

import sys
from dataclasses import replace

from discrepancy import Study
from vtsdt.rig.one_dimensional import PlainLiftRig

NOISE = {"friction_c": 0.5, "friction_cw": 0.5}
TRIPS = 4
WAYS = ("as recorded", "auto")


def told(seed: int) -> None:
    """Diagnose one lift both ways and print what is named and how far off each is on the trip held out."""
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
        told(int(chosen))
