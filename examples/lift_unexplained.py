"""Effects that the lift's paper leaves unexplained, hidden in a virtual lift and searched for: contacts, controller.

The virtual lift has 37 states, and the model under test is the same lift with nominal parameters.  One of four trips is
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
from vtsdt import LiftParameters, LiftRig

SEED = 9400
TRIPS = 4
#: Parameters of the rig that the model does not know, over the nominal ones.
CONTACT = {"cabin_guide.stiffness": 0.6, "cabin_guide.damping": 2.0}
CONTROLLER = {"control.K_pomega": 0.75, "control.T_iomega": 1.4}
#: Standard deviation of a vaguely known parameter, as a share.
VAGUE = 0.5


@dataclass(frozen=True)
class ChangedLift(LiftRig):
    """A virtual lift with some parameters other than in its drawings.

    Parameters
    ----------
    changed : mapping of str to float
        Factor on the nominal value, by the parameter's name.
    """

    changed: Mapping[str, float] = field(default_factory=dict)

    def true_parameters(self, perturbed: Mapping[str, float]) -> LiftParameters:
        """Return the true parameters of the rig's lift."""
        return super().true_parameters({**perturbed, **{n: f * nominal(n) for n, f in self.changed.items()}})


def nominal(name: str) -> float:
    """Return the value of a parameter in the drawings."""
    section, _, key = name.partition(".")
    return float(getattr(getattr(LiftParameters.bench(), section), key))


def problem_of(**settings: object) -> Problem:
    """Return recordings of a virtual lift, and the reference model under test."""
    rig = ChangedLift(seed=SEED, trips=TRIPS, under_test="reference", **settings)  # type: ignore[arg-type]
    return replace(rig.case(), offsets=("a_c",)).problem(seed=SEED)


def knowing(problem: Problem, names: Mapping[str, float]) -> Problem:
    """Return the problem with some parameters known vaguely."""
    kept = tuple(q for q in problem.uncertain if q.name not in names)
    system = problem.model.build()
    units = dict(zip(system.parameter_names, (p.unit for p in system.parameters), strict=True))
    more = [UncertainParameter(name=n, value=nominal(n), std=VAGUE * nominal(n), min=0.0, unit=units[n]) for n in names]
    return replace(problem, uncertain=(*kept, *more))


def diagnose(title: str, problem: Problem) -> Conclusion:
    """Diagnose a problem and print the conclusion and the errors on the trip held out."""
    study = Study(problem, progress=lambda text: print(f"    {text}", file=sys.stderr))
    conclusion = study.diagnose()
    print(f"\n## {title}\n\n{conclusion.sentence}\n")
    for warning in conclusion.warnings:
        print(f"- {warning}")
    print(study.to_frame()["validate"].to_string(float_format="{:.4g}".format))
    fit = study.stages[-1].identify
    for q, value, std in zip(fit.parameters, fit.values, fit.std, strict=True):
        if q.name in (*CONTACT, *CONTROLLER):
            print(f"{q.name} = {value:.4g} ± {std:.2g} {q.unit}, drawn as {nominal(q.name):.4g}")
    return conclusion


def contact() -> None:
    """Contacts of the shoes that are softer and better damped than stated."""
    problem = problem_of(changed=CONTACT)
    diagnose("contacts stated too well", problem)
    diagnose("contacts known vaguely", knowing(problem, CONTACT))


def controller() -> None:
    """A speed controller with other gains."""
    problem = problem_of(changed=CONTROLLER)
    diagnose("controller as drawn", problem)
    diagnose("controller known vaguely", knowing(problem, CONTROLLER))


CASES = {"contact": contact, "controller": controller}


if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        CASES[name]()
