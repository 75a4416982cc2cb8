"""Effects that a component has in it, with strengths at zero, are candidates like any other."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import Kind, KindText, kinds, register
from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from multibody import Component, Model, Output, Parameter, Translation
from multibody.library import Damper, ForceSource, Mass


class TwoSprings(Component):
    """Two springs in one part, each of which can harden."""

    stiffness = Parameter(400.0, "N/m", "of each")
    hard_1 = Parameter(0.0, "N/m**3", "hardening of the first")
    hard_2 = Parameter(0.0, "N/m**3", "hardening of the second, about its own middle")
    middle_2 = Parameter(0.0, "m", "middle of the second")
    a = Translation("one end")
    b = Translation("other end")
    pull = Output("N", "on the first end")

    def equations(self):
        x = self.b.position - self.a.position
        y = x - self.middle_2
        self.pull = 2.0 * self.stiffness * x + self.hard_1 * x * x * x + self.hard_2 * y * y * y
        self.a.force = self.pull
        self.b.force = -self.pull


KIND = Kind(
    name="test_hardening",
    at="parameter",
    law="TwoSprings",
    strengths=("hard",),
    text=KindText("hardening", "", "", ""),
    component=TwoSprings,
    sides=(("first", "_1"), ("second", "_2")),
    component_shapes=lambda part, ending: [{"middle": m} for m in (0.05, 0.1)] if ending == "_2" else [{}],
)
if KIND.name not in kinds():
    register(KIND)


@cache
def oscillator() -> Model:
    model = Model("oscillator")
    body = model.add("body", Mass(m=2.0))
    springs = model.add("springs", TwoSprings())
    damper = model.add("damper", Damper(damping=6.0))
    force = model.add("force", ForceSource())
    model.connect(springs.b, damper.b, force.flange, body.flange)
    model.connect(springs.a, damper.a, model.ground)
    model.input("push", force.force)
    return model


def record(name: str, hidden: dict[str, float], seed: int) -> Record:
    rng = np.random.default_rng(seed)
    time = np.arange(700) * 6e-3
    push = sum(60.0 * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.4, 1.1, 2.3, 3.1))
    run = oscillator().build().simulate(float(time[-1]), inputs={"push": (time, push)}, parameters=hidden, times=time)
    x = run["body.position"] + 2e-4 * rng.standard_normal(time.size)
    signals = {
        "push": RecordedSignal(values=push, unit="N", column="push", measured_unit="N"),
        "body.position": RecordedSignal(values=x, unit="m", column="x", measured_unit="m"),
    }
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


@pytest.mark.parametrize(
    ("side", "hidden"),
    [
        pytest.param("first", {"springs.hard_1": 4000.0}, marks=pytest.mark.slow),
        ("second", {"springs.hard_2": 4000.0, "springs.middle_2": 0.05}),
        ("", {}),
    ],
)
def test_a_built_in_effect_is_found_where_it_is(side: str, hidden: dict[str, float]) -> None:
    model = oscillator()
    groups = [
        make_experiments(model, [record(n, hidden, k) for n, k in names], ["push"], ["body.position"])
        for names in ([("a", 1), ("b", 2)], [("c", 3)])
    ]
    uncertain = (
        UncertainParameter(name="damper.damping", value=6.0, std=1.0, min=0.0, max=50.0, unit="N*s/m"),
        UncertainParameter(name="springs.stiffness", value=400.0, std=40.0, min=1.0, max=4000.0, unit="N/m"),
    )
    problem = Problem(
        name="springs",
        model=model,
        uncertain=uncertain,
        identify=groups[0],
        validate=groups[1],
        max_effects=1,
        residual="simulation",
        include=("test_hardening@*", "coulomb_friction@*", "sensor_*"),
    )
    study = Study(problem)
    conclusion = study.diagnose()
    if not side:
        assert conclusion.verdict == "nothing missing"
        return
    effect = study.stage.effects[0]
    assert str(effect) == f"test_hardening@springs.{side}"
    assert effect.strengths["hard"] == pytest.approx(4000.0, rel=0.1)
    assert effect.shape.get("middle", 0.0) == hidden.get("springs.middle_2", 0.0)


def test_strength_zero_is_absence_and_names_are_the_components() -> None:
    effect = Effect(kind="test_hardening", where="springs.second", strengths={"hard": 0.0}, shape={"middle": 0.05})
    assert effect.parameters() == {"springs.hard_2": 0.0, "springs.middle_2": 0.05}
    assert effect.unit("hard") == "N/m**3"
    time = np.linspace(0.0, 1.0, 50)
    inputs = {"push": (time, 10.0 * np.sin(9.0 * time))}
    runs = [m.build().simulate(1.0, inputs=inputs, times=time) for m in (oscillator(), effect.added_to(oscillator()))]
    assert np.array_equal(runs[0]["body.position"], runs[1]["body.position"])
