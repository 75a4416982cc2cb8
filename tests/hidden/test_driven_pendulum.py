"""A pendulum that hangs calmly in its first record and goes over the top in the others, by an offset of its torque."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.residual.prepared_problem import PreparedProblem
from discrepancy.residual.residual_mode import problem_in_windows
from discrepancy.study.history import restore, save_history
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibration import UncertainParameter
from multibody import Model
from multibody.library import Pendulum, RotaryViscousFriction, TorqueSource

DT = 0.005
INCLUDE = ("constant_force@*", "input_offset@*", "coulomb_friction@*", "linear_stiffness@*", "sensor_offset@*")


def driven(viscous: float = 0.01) -> Model:
    """A pendulum that a torque drives over the top now and then."""
    model = Model("pendulum")
    drive = model.add("drive", TorqueSource())
    rod = model.add("rod", Pendulum(J=0.05, m=0.5, arm=0.3))
    pivot = model.add("pivot", RotaryViscousFriction(viscous=viscous))
    model.connect(drive.flange, rod.flange, pivot.b)
    model.connect(pivot.a, model.ground)
    model.input("drive.torque", drive.torque)
    return model


def study_of(offset: float) -> Study:
    """The amplifier of the real machine adds a constant torque, in N*m; its bearing is not the one in the model."""
    model, rng = driven(), np.random.default_rng(4)
    time = np.arange(0.0, 10.0, DT)
    records = []
    for k, size in enumerate((0.08, 0.3, 0.3)):  # a calm record first, from which nobody sees what the others do
        tones = [np.sin(w * time + phase) for w, phase in zip((2.1, 3.3, 4.7), rng.uniform(0.0, 6.0, 3), strict=True)]
        torque = size * np.minimum(time / 0.5, 1.0) * sum(tones)
        given = {"drive.torque": (time, torque + offset)}
        run = driven(0.0115).build().simulate(time[-1], inputs=given, times=time, rtol=1e-10, method="DOP853")
        angle = run["rod.angle"] + 3e-4 * rng.standard_normal(time.size)
        signals = {
            "drive.torque": RecordedSignal(values=torque, unit="N*m", column="u", measured_unit="N*m"),
            "rod.angle": RecordedSignal(values=angle, unit="rad", column="y", measured_unit="rad"),
        }
        records.append(Record(name=f"run{k}", path=Path(f"run{k}.csv"), time=time, signals=signals))
    experiments = make_experiments(model, records, ("drive.torque",), ("rod.angle",))
    uncertain = (UncertainParameter(name="pivot.viscous", value=0.01, std=0.003, min=0.0, unit="N*m*s/rad"),)
    return Study(
        Problem(
            name="pendulum",
            model=model,
            uncertain=uncertain,
            identify=experiments[:2],
            validate=experiments[2:],
            include=INCLUDE,
        )
    )


@pytest.fixture(scope="module")
def found():
    study = study_of(0.05)
    return study, study.diagnose()


def test_an_offset_is_found_window_by_window(found):
    study, conclusion = found
    assert conclusion.residual_mode == "prediction", "the wild records count, not only the first"
    # a constant torque at the pivot is the same thing
    assert str(conclusion.accepted[0].effect) in ("input_offset@drive.torque", "constant_force@pivot")
    assert len(conclusion.accepted) == 1
    assert abs(next(iter(study.stages[-1].effects[0].strengths.values()))) == pytest.approx(0.05, rel=0.1)


def test_without_an_offset_nothing_is_named():
    assert study_of(0.0).diagnose().verdict == "nothing missing"


def test_simulations_that_end_far_from_their_records_give_way_to_windows(tmp_path):
    study = study_of(0.05)
    assert problem_in_windows(study.given, {"rod.angle": 0.1}) is None, "10 % of a radian: they follow"
    cut = problem_in_windows(study.given, {"rod.angle": 1.5})
    assert cut is not None
    assert cut.mode == "prediction"
    assert "simulations of whole records differ from rod.angle by 150% of its spread" in cut.reason
    study.prepared = PreparedProblem(study.given, "simulation", "as if the records were calm")
    assert study.cut_into_windows({"rod.angle": 1.5})
    assert study.in_windows_instead
    _ = study.stage
    path = save_history(study, tmp_path / "history.json")
    again = study_of(0.05)
    restore(again, path)
    assert (again.mode, again.mode_reason) == ("prediction", cut.reason)
    assert again.stages[-1].rmse("identify") == pytest.approx(study.stages[-1].rmse("identify"), rel=1e-6)
