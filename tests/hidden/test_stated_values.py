"""A gain or a resistance that is not what the model says is found, and one that is calibrated is not asked."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.report.write import write_report
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from multibody import Model
from multibody.library import Inertia, TorqueSource
from multibody.library.control import PI
from multibody.library.electrical import DCMotorDrive
from multibody.library.sensors import SpeedSensor

OUTPUTS = ["rotor.speed", "motor.i"]
NOISE = {"rotor.speed": 0.02, "motor.i": 0.01}
STATED = {"control.k_p": 0.4, "motor.R": 0.8, "motor.k_t": 0.1}


@cache
def drive() -> Model:
    """A motor whose speed is controlled by its voltage, under a load that is recorded."""
    model = Model("drive")
    motor = model.add("motor", DCMotorDrive(R=STATED["motor.R"], L=2e-3, k_t=STATED["motor.k_t"]))
    rotor = model.add("rotor", Inertia(J=4e-4))
    load = model.add("load", TorqueSource())
    control = model.add("control", PI(k_p=STATED["control.k_p"], k_i=4.0, input_unit="rad/s", output_unit="V"))
    gauge = model.add("gauge", SpeedSensor())
    model.connect(motor.flange, rotor.flange, load.flange, gauge.flange)
    model.input("reference", control.reference)
    model.input("torque", load.torque)
    model.connect(control.measured, gauge.speed)
    model.connect(motor.voltage, control.output)
    return model


def record(name: str, true: dict[str, float], seed: int) -> Record:
    rng = np.random.default_rng(seed)
    time = np.arange(800) * 5e-3
    reference = 40.0 * np.cumsum(rng.uniform(-1.0, 1.0, 8))[np.minimum((time / 0.5).astype(int), 7)]
    torque = 0.05 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * time + rng.uniform(0, 6))
    given = {"reference": (time, reference), "torque": (time, torque)}
    run = drive().build().simulate(float(time[-1]), inputs=given, parameters=true, times=time, rtol=1e-8, atol=1e-10)
    signals = {
        "reference": RecordedSignal(values=reference, unit="rad/s", column="r", measured_unit="rad/s"),
        "torque": RecordedSignal(values=torque, unit="N*m", column="t", measured_unit="N*m"),
    }
    for output, unit in zip(OUTPUTS, ("rad/s", "A"), strict=True):
        values = run[output] + NOISE[output] * rng.standard_normal(time.size)
        signals[output] = RecordedSignal(values=values, unit=unit, column=output, measured_unit=unit)
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


def study_of(true: dict[str, float], *more: UncertainParameter) -> Study:
    groups = [
        make_experiments(drive(), [record(n, true, k) for n, k in names], ["reference", "torque"], OUTPUTS)
        for names in ([("a", 1), ("b", 2), ("c", 3)], [("d", 4)])
    ]
    uncertain = (UncertainParameter(name="rotor.J", value=4e-4, std=2e-5, min=1e-6, max=1e-2, unit="kg*m**2"), *more)
    return Study(
        Problem(
            name="drive",
            model=drive(),
            uncertain=uncertain,
            identify=groups[0],
            validate=groups[1],
            residual="simulation",
            seed=1,
        )
    )


@cache
def diagnosed(name: str, true: float) -> tuple[Study, Conclusion]:
    study = study_of({name: true})
    return study, study.diagnose()


@pytest.mark.parametrize(
    ("kind", "name", "factor"),
    [
        pytest.param("proportional_gain", "control.k_p", 1.3, marks=pytest.mark.slow),
        ("resistance", "motor.R", 1.25),
        pytest.param("torque_constant", "motor.k_t", 0.9, marks=pytest.mark.slow),
    ],
)
def test_a_value_that_is_stated_wrongly_is_found(kind: str, name: str, factor: float) -> None:
    true = factor * STATED[name]
    study, _ = diagnosed(name, true)
    owner, _, parameter = name.partition(".")
    assert [str(e) for e in study.stage.effects] == [f"{kind}@{owner}"]
    assert study.stage.effects[0].strengths[parameter] == pytest.approx(true, rel=0.02)
    assert study.stage.rmse("validate")["rotor.speed"] == pytest.approx(NOISE["rotor.speed"], rel=0.1)


def test_of_a_right_model_nothing_is_named() -> None:
    assert study_of({}).diagnose().verdict == "nothing missing"


def test_what_the_study_calibrates_is_left_to_calibration() -> None:
    study = study_of(
        {"motor.R": 1.0}, UncertainParameter(name="motor.R", value=0.8, std=0.3, min=0.01, max=10.0, unit="ohm")
    )
    conclusion = study.diagnose()
    assert conclusion.verdict == "nothing missing"
    assert study.stage.identify["motor.R"] == pytest.approx(1.0, rel=0.02)
    assert any((k, w) == ("resistance", "motor") and "imitate" in why for k, w, why in conclusion.refused)


def test_absence_is_the_stated_value_and_none_is_offered_without_one() -> None:
    system = drive().build(probes=True)
    entries = {e.name: e for e in catalogue(system, OUTPUTS, ["reference", "torque"])}
    assert entries["resistance@motor"].stated == (0.8,)
    same = Effect(kind="resistance", where="motor", strengths={"R": 0.8}).added_to(drive()).build()
    assert np.array_equal(same.p, drive().build().p)
    assert Effect(kind="resistance", where="motor", strengths={"R": 0.8}).unit("R") == "ohm"
    [moved] = Effect(kind="resistance", where="motor", strengths={"R": 0.8}).uncertain()
    assert (moved.name, moved.min) == ("motor.R", 0.0)
    without = Model("open")
    control = without.add("control", PI(k_p=0.0, k_i=1.0))
    without.input("reference", control.reference)
    without.input("measured", control.measured)
    names = {e.name for e in catalogue(without.build(probes=True), [], [])}
    assert "integral_gain@control" in names
    assert "proportional_gain@control" not in names


def test_the_report_tells_the_value_beside_the_stated_one(tmp_path: Path) -> None:
    _, conclusion = diagnosed("motor.R", 1.0)
    write_report(conclusion, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "another resistance at motor" in conclusion.sentence.lower()
    assert "the model states 0.800 ohm" in page
