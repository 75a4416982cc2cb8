"""A sensor that is read with the opposite sign or in other units is told in those words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.report.write import write_report
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from multibody import Model
from multibody.library import ForceSource, Mass, SpringDamper


def mount() -> Model:
    model = Model("mount")
    body = model.add("body", Mass(m=2.0))
    spring = model.add("mount", SpringDamper(stiffness=800.0, damping=8.0))
    push = model.add("push", ForceSource())
    model.connect(body.flange, spring.b, push.flange)
    model.connect(spring.a, model.ground)
    model.input("force", push.force)
    return model


def record(name: str, factor: float, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    time = np.arange(600) * 5e-3
    force = sum(9.0 * np.sin(2.0 * np.pi * f * time + rng.uniform(0.0, 6.0)) for f in (0.7, 2.3, 3.4))
    run = mount().build().simulate(float(time[-1]), inputs={"force": (time, force)}, times=time)
    signals = {"force": RecordedSignal(values=force, unit="N", column="force", measured_unit="N")}
    for output, unit, size, by in (("body.position", "m", 1e-4, 1.0), ("body.velocity", "m/s", 2e-3, factor)):
        read = by * (run[output] + size * rng.standard_normal(time.size))
        signals[output] = RecordedSignal(values=read, unit=unit, column=output, measured_unit=unit)
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-1.0, "measured with the opposite sign"),
        pytest.param(1000.0, "measured off by a factor of 1000", marks=pytest.mark.slow),
    ],
)
def test_the_answer_and_the_report_say_so(factor: float, words: str, tmp_path: Path) -> None:
    groups = [
        make_experiments(mount(), [record(f"run{k}", factor, k) for k in those], ["force"], list(OUTPUTS))
        for those in ((0, 1, 2), (3,))
    ]
    uncertain = (UncertainParameter(name="body.m", value=2.0, std=0.05, min=0.1, max=9.0, unit="kg"),)
    problem = Problem(
        name="mount",
        model=mount(),
        uncertain=uncertain,
        identify=groups[0],
        validate=groups[1],
        residual="simulation",
        max_effects=1,
        include=("sensor_*", "coulomb_friction@*"),
    )
    conclusion = Study(problem).diagnose()
    assert words in conclusion.sentence
    if factor < 0.0:
        write_report(conclusion, tmp_path)
        assert words.removeprefix("measured ") in (tmp_path / "report.html").read_text(encoding="utf-8")


OUTPUTS = ("body.position", "body.velocity")
