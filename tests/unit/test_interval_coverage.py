"""How often the true values lie in their 95 % intervals."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from discrepancy.validation.interval_coverage import coverage
from discrepancy.validation.trials import Trial, rates


def test_intervals_are_compared_with_the_truth():
    values = {"mass.m": (2.0, 0.1), "guide.viscous": (5.0, 0.1), "at.bound": (1.0, np.inf)}
    values["law.guide.force"] = (9.0, 1.0)
    fitted = SimpleNamespace(
        parameters=[SimpleNamespace(name=n) for n in values],
        std_of=lambda n: values[n][1],
        interval=lambda n: (values[n][0] - 2 * values[n][1], values[n][0] + 2 * values[n][1]),
    )

    class Law:
        strengths = ("force",)

        def parameter_name(self, name):
            return f"law.guide.{name}"

        def __str__(self):
            return "law@guide"

    truth = {
        "perturbed": {"mass.m": {"value": 2.1}, "guide.viscous": {"value": 6.0}, "at.bound": {"value": 1.0}},
        "effects": [{"kind": "law", "where": "guide", "parameters": {"force": {"value": 10.0}}}],
    }
    found = coverage(SimpleNamespace(identify=fitted, effects=(Law(),)), truth)
    assert found == (2, ("guide.viscous",))
    trial = Trial(
        suite="null", seed=1, hidden=(), verdict="nothing missing", found=(), inside=found[0], outside=found[1]
    )
    assert rates([trial])[1] == ("95 % intervals with the true value in them (1 trials)", 2, 3)
