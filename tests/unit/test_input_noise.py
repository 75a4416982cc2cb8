"""Noise of recorded inputs: estimated from the record, judged by its effect, removed where it matters."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.residual import input_noise
from discrepancy.residual.input_noise import MATTERS, reduce_input_noise
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibration import UncertainParameter
from multibody import Model
from multibody.base.progress import silent
from multibody.library import Damper, ForceSource, Mass, Spring

STEP, FLOOR = 6e-3, 2e-4


@cache
def oscillator() -> Model:
    model = Model("oscillator")
    body, force = model.add("body", Mass(m=2.0)), model.add("force", ForceSource())
    spring, damper = model.add("spring", Spring(stiffness=400.0)), model.add("damper", Damper(damping=6.0))
    model.connect(spring.b, damper.b, force.flange, body.flange)
    model.connect(spring.a, damper.a, model.ground)
    model.input("push", force.force)
    return model


def record(name: str, noise: float, seed: int, jitter: float = 0.0) -> Record:
    """An oscillator pushed below 3.2 Hz, its push read with some noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(1000) * STEP
    push = sum(60.0 * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.4, 1.1, 2.3, 3.1))
    run = oscillator().build().simulate(float(time[-1]), inputs={"push": (time, push)}, times=time)
    x = run["body.position"] + FLOOR * rng.standard_normal(time.size)
    stamps = time + jitter * STEP * rng.uniform(-1.0, 1.0, time.size)
    read = push + noise * rng.standard_normal(time.size)
    return Record(
        name=name,
        path=Path(f"{name}.csv"),
        time=stamps,
        signals={
            "push": RecordedSignal(values=read, unit="N", column="push", measured_unit="N"),
            "body.position": RecordedSignal(values=x, unit="m", column="x", measured_unit="m"),
        },
    )


def problem_of(noise: float, jitter: float = 0.0, **settings: object) -> Problem:
    groups = [
        make_experiments(oscillator(), [record(n, noise, k, jitter) for n, k in names], ["push"], ["body.position"])
        for names in ([("a", 1), ("b", 2)], [("c", 3)])
    ]
    uncertain = (UncertainParameter(name="damper.damping", value=6.0, std=1.0, min=0.0, max=50.0, unit="N*s/m"),)
    return Problem(
        name="pushed",
        model=oscillator(),
        uncertain=uncertain,
        identify=groups[0],
        validate=groups[1],
        noise={"body.position": FLOOR},
        **settings,
    )  # type: ignore[arg-type]


def test_noise_that_matters_is_removed_and_reported() -> None:
    problem = problem_of(20.0)
    quiet, (found,) = reduce_input_noise(problem, silent)
    assert found.noise == pytest.approx(20.0, rel=0.1)
    assert 2 * 3.1 < found.cutoff < 10.0
    assert found.low_passed
    assert found.weighed
    assert 0.9 * found.made < found.left < found.made
    assert found.held_out
    assert found.after < found.before
    assert found.sentence.startswith("The recorded input push is noisy: ")
    for before, after in zip((*problem.identify, *problem.validate), (*quiet.identify, *quiet.validate), strict=True):
        assert "push: low-pass at" in after.record.log[-1]
        assert np.std(np.diff(after.record.signals["push"].values, 2)) < 0.2 * np.std(
            np.diff(before.record.signals["push"].values, 2)
        )
        np.testing.assert_array_equal(after.measured, before.measured)


def test_the_effect_of_noise_is_that_in_simulations() -> None:
    """The machine is linear: simulations with and without the noise differ by as much."""
    noisy, clean = problem_of(20.0), problem_of(0.0)
    _, (found,) = reduce_input_noise(noisy, silent)
    system = oscillator().build(outputs=["body.position"])
    both = ([e.simulate(system, system.p) for e in s.identify] for s in (noisy, clean))
    made = np.sqrt(np.mean([np.mean((a - b) ** 2) for a, b in zip(*both, strict=True)]))
    assert found.made == pytest.approx(made, rel=0.3)  # of two draws of a resonance that rings for a second


def test_noise_that_does_not_matter_stays() -> None:
    problem = problem_of(20.0)
    _, (found,) = reduce_input_noise(problem, silent)
    for times, stays in ((0.9, False), (1.1, True)):
        rough = replace(problem, noise={"body.position": times * found.made / MATTERS})
        assert (reduce_input_noise(rough, silent) == (rough, ())) is stays


@pytest.mark.parametrize("why", ["held", "uneven", "excitation", "uncertain"])
def test_inputs_stay_as_recorded(why: str) -> None:
    lines: list[str] = []
    problem = problem_of(0.1 if why == "uncertain" else 20.0, jitter=0.4 if why == "uneven" else 0.0)
    if why == "held":
        problem = replace(problem, identify=tuple(replace(e, held=("push",)) for e in problem.identify))
    if why == "excitation":  # what looks like noise really excites the machine
        problem = replace(problem, identify=tuple(_excited(e) for e in problem.identify))
    assert reduce_input_noise(problem, lines.append) == (problem, ())
    said = [line for line in lines if line.startswith("the inputs stay as recorded: ")]
    assert (lines[-1:] == said) if why == "uneven" else (lines == [])
    assert len(said) == (why == "uneven")


def _excited(experiment):
    system = oscillator().build(outputs=["body.position"])
    signals = dict(experiment.record.signals)
    x = experiment.simulate(system, system.p)[:, 0]
    signals["body.position"] = replace(signals["body.position"], values=x)
    return replace(experiment, record=replace(experiment.record, signals=signals))


def test_a_study_reduces_noise_unless_asked_not_to() -> None:
    problem = problem_of(
        20.0, residual="simulation", include=("coulomb_friction@*", "input_gain@*", "sensor_*"), max_effects=1
    )
    conclusion = Study(problem).diagnose()
    assert conclusion.verdict == "nothing missing"
    assert conclusion.sentence.endswith(
        "Noise of the recorded input push excites the simulation and is no missing effect; it was removed or weighted "
        "down."
    )
    assert any(w.startswith("The recorded input push is noisy") for w in conclusion.warnings)
    assert conclusion.extra["noisy_inputs"][0]["input"] == "push"
    as_recorded = Study(replace(problem, inputs="as recorded"))
    as_recorded.prepare()
    assert as_recorded.prepared is not None
    assert not as_recorded.prepared.noisy
    assert as_recorded.problem.identify[0].record is problem.identify[0].record


def test_a_record_without_unknowns_of_its_own_keeps_its_columns():
    block = np.arange(12.0).reshape(3, 2, 2)
    np.testing.assert_array_equal(input_noise._without_own(block, np.zeros((3, 2, 0))), block)
