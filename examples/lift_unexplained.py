"""What the lift's paper leaves unexplained, put into a virtual lift and looked for: contacts, controller.

The virtual lift has 37 states, and the model under test is the same one as it should be.  Four trips, of which one is
held out.  Run it with

    python examples/lift_unexplained.py [CASE …]

for the cases ``contact`` and ``controller``, both if none is named; each takes some minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from discrepancy import Study
from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.problem.problem import Problem
from estimation.fit.calibrate import UncertainParameter
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig.rig import LiftRig

SEED = 9400
TRIPS = 4
#: What nobody told the model: in the rig, over what it should be.
CONTACT = {"cabin_guide.stiffness": 0.6, "cabin_guide.damping": 2.0}
CONTROLLER = {"control.K_pomega": 0.75, "control.T_iomega": 1.4}
#: Standard deviation that an engineer may state who does not know them, as a share.
VAGUE = 0.5


@dataclass(frozen=True)
class ChangedLift(LiftRig):
    """A virtual lift of which some parameters are not what its drawings say.

    Parameters
    ----------
    changed : mapping of str to float
        Factor on the nominal value, by the parameter's name.
    """

    changed: Mapping[str, float] = field(default_factory=dict)

    def true_parameters(self, perturbed: Mapping[str, float]) -> LiftParameters:
        """Return the numbers of the rig's lift."""
        return super().true_parameters({**perturbed, **{n: f * nominal(n) for n, f in self.changed.items()}})


def nominal(name: str) -> float:
    """Return a parameter as the drawings have it."""
    section, _, key = name.partition(".")
    return float(getattr(getattr(LiftParameters.bench(), section), key))


def problem_of(**settings: object) -> Problem:
    """Return recordings of a virtual lift, and the reference model under test."""
    rig = ChangedLift(seed=SEED, trips=TRIPS, under_test="reference", **settings)  # type: ignore[arg-type]
    return replace(rig.case(), offsets=("a_c",)).problem(seed=SEED)


def knowing(problem: Problem, names: Mapping[str, float]) -> Problem:
    """Return the study with some parameters vaguely known in place of exactly or nearly so."""
    kept = tuple(q for q in problem.uncertain if q.name not in names)
    system = problem.model.build()
    units = dict(zip(system.parameter_names, (p.unit for p in system.parameters), strict=True))
    more = [UncertainParameter(name=n, value=nominal(n), std=VAGUE * nominal(n), min=0.0, unit=units[n]) for n in names]
    return replace(problem, uncertain=(*kept, *more))


def told(title: str, problem: Problem) -> Conclusion:
    """Diagnose a study and print what it says and how the error held out falls."""
    study = Study(problem, progress=lambda text: print(f"    {text}", file=sys.stderr))
    conclusion = study.diagnose()
    print(f"\n## {title}\n\n{conclusion.sentence}\n")
    for warning in conclusion.warnings:
        print(f"- {warning}")
    print(study.to_frame()["validate"].to_string(float_format="{:.4g}".format))
    moved = study.stages[-1].identify
    for q, value, std in zip(moved.parameters, moved.values, moved.std, strict=True):
        if q.name in (*CONTACT, *CONTROLLER):
            print(f"{q.name} = {value:.4g} ± {std:.2g} {q.unit}, drawn as {nominal(q.name):.4g}")
    return conclusion


def contact() -> None:
    """Contacts of the shoes that are softer and better damped than stated."""
    problem = problem_of(changed=CONTACT)
    told("contacts stated too well", problem)
    told("contacts known vaguely", knowing(problem, CONTACT))


def controller() -> None:
    """A speed controller that somebody has tuned."""
    problem = problem_of(changed=CONTROLLER)
    told("controller as drawn", problem)
    told("controller known vaguely", knowing(problem, CONTROLLER))


CASES = {"contact": contact, "controller": controller}


if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        CASES[name]()
