"""Channels at rates and on clocks of their own: compared at their own instants, nothing thrown away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import noise_floors, read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.residual.residual_mode import prepared_problem
from estimation import ReadRules, RecordError, calibrate, read_record
from multibody import Model

MODEL = """
from multibody import Model
from multibody.library import ForceSource, Mass, SpringDamper


def build():
    model = Model("oscillator")
    mass, spring, push = (
        model.add("mass", Mass(m=2.0)),
        model.add("spring", SpringDamper(stiffness=150.0, damping=6.0)),
        model.add("push", ForceSource()),
    )
    model.connect(mass.flange, spring.b, push.flange)
    model.connect(spring.a, model.ground)
    model.input("push", push.force)
    return model
"""
TRUTH = {"mass.m": 2.0, "spring.stiffness": 180.0, "spring.damping": 5.0}
NOISE = {"mass.position": 2e-5, "mass.velocity": 4e-4}
FAST = np.arange(2400) * 0.005


def measured(late: float = 0.0, seed: int = 3):
    """Force and position at 200 Hz; speed at 13 Hz by a logger whose stamps are too small by ``late``."""
    scope: dict = {}
    exec(compile(MODEL, "model", "exec"), scope)
    model: Model = scope["build"]()
    slow = 0.0137 + np.arange(150) / 13.0
    push = 20.0 * np.sin(2.0 * FAST + 0.15 * FAST**2)
    fine = np.unique(np.concatenate([FAST, slow]))
    run = (
        model.with_values(TRUTH)
        .build()
        .simulate((0.0, float(FAST[-1])), inputs={"push": (FAST, push)}, times=fine, rtol=1e-9, atol=1e-12)
    )
    names = list(run.system.output_names)
    y = {n: run.outputs[:, names.index(n)] for n in NOISE}
    rng = np.random.default_rng(seed)
    position = np.interp(FAST, fine, y["mass.position"]) + NOISE["mass.position"] * rng.standard_normal(FAST.size)
    speed = np.interp(slow, fine, y["mass.velocity"]) + NOISE["mass.velocity"] * rng.standard_normal(slow.size)
    return push, position, slow - late, speed


def write(folder: Path, late: float = 0.0, together: bool = False, extra: str = "") -> Path:
    push, position, slow, speed = measured(late)
    (folder / "model.py").write_text(MODEL)
    if together:  # one table with empty cells, as a logger of several rates exports it
        rows = [(t, f"{t:.6f},{f:.6f},{x:.9f},") for t, f, x in zip(FAST, push, position, strict=True)]
        rows += [(t, f"{t:.6f},,,{v:.9f}") for t, v in zip(slow, speed, strict=True)]
        text = "time_s,push_N,x_m,v_m_per_s\n" + "\n".join(line for _, line in sorted(rows)) + "\n"
        (folder / "run.csv").write_text(text)
        files = '["run.csv"]'
    else:
        table = np.column_stack([FAST, push, position])
        np.savetxt(folder / "motion.csv", table, "%.9f", ",", header="time_s,push_N,x_m", comments="")
        table = np.column_stack([1e3 * slow, speed])
        np.savetxt(folder / "speed.csv", table, "%.9f", ",", header="t [ms],v_m_per_s", comments="")
        files = '[["motion.csv", "speed.csv"]]'
    study = folder / "study.toml"
    study.write_text(
        '[model]\nbuild = "model.py:build"\n'
        '[uncertain]\n"spring.stiffness" = { std = 50.0 }\n"spring.damping" = { std = 3.0 }\n'
        '[inputs]\n"push" = "push_N"\n'
        '[outputs]\n"mass.position" = "x_m"\n"mass.velocity" = "v_m_per_s"\n'
        "[records]\ntime = "
        + ('"time_s"' if together else '{ "speed.csv" = "t [ms]", "*" = "time_s" }')
        + f"\nidentify = {files}\n{extra}"
    )
    return study


def std_of(fit, name: str) -> float:
    return float(fit.std[[p.name for p in fit.parameters].index(name)])


def fitted(study: Path):
    problem = read_problem(study)
    prepared = prepared_problem(problem)
    assert prepared.mode == "simulation"
    floors = noise_floors(problem.identify, problem.noise)
    return problem, calibrate(problem.model.build(), problem.identify, problem.uncertain, noise=floors), floors


@pytest.mark.parametrize("together", [True, False], ids=["one table", "two files"])
def test_each_channel_is_compared_at_its_own_instants(tmp_path, together):
    problem, fit, floors = fitted(write(tmp_path, together=together))
    (experiment,) = problem.identify
    speed = experiment.record.signals["mass.velocity"]
    assert (
        len(experiment.record.time) == 2293
    )  # from 0.0137 s to 0.0137 + 149/13 s: the time that both loggers have in common
    assert len(speed.own.time) == np.sum((measured()[2] >= FAST[0]) & (measured()[2] <= FAST[-1]))
    for name in ("spring.stiffness", "spring.damping"):
        assert abs(fit[name] - TRUTH[name]) < 4.0 * std_of(fit, name), name
    # the noise is that of the samples: a staircase on the grid would show none.  At 13 Hz the motion counts with it
    assert floors["mass.position"] == pytest.approx(NOISE["mass.position"], rel=0.1)
    assert floors["mass.velocity"] > NOISE["mass.velocity"]


def test_a_model_is_interpolated_to_the_instants_exactly_for_cubics():
    from estimation.files.record import OwnSamples
    from estimation.response.own_instants import at_own_instants

    grid = np.arange(40) * 0.1
    own = OwnSamples(np.array([0.0, 0.033, 1.25, 1.3, 3.89]), np.zeros(5))
    taken = at_own_instants(grid, {0: own})[0](grid**3 - grid)
    at = own.time[own.nearest(grid)]
    np.testing.assert_allclose(taken, at**3 - at, atol=1e-12)  # a cubic through four points is exact up to rounding
    assert sorted(set(at)) == own.time.tolist()


def test_a_constant_clock_offset_is_fitted(tmp_path):
    late = 0.040
    problem, fit, _ = fitted(write(tmp_path, late, extra='[clocks]\n"speed.csv" = { fit = true }\n'))
    (clock,) = problem.identify[0].clocks
    assert (clock.files, clock.outputs) == ("speed.csv", ("mass.velocity",))
    assert clock.added + fit.fits[0].own[clock.name] == pytest.approx(late, abs=2e-3)
    assert abs(fit["spring.stiffness"] - TRUTH["spring.stiffness"]) < 4.0 * std_of(fit, "spring.stiffness")
    given = write(tmp_path, late, extra='[clocks]\n"speed.csv" = { offset = 0.040 }\n')
    _, stated, _ = fitted(given)
    assert abs(stated["spring.damping"] - TRUTH["spring.damping"]) < 4.0 * std_of(stated, "spring.damping")


@pytest.mark.parametrize("late", [0.9, -1.7])
def test_a_clock_that_is_off_by_more_than_a_swing_is_found(tmp_path, late):
    """The speed swings once in 1.5 to 3 s: a fit that begins at zero would end at another swing.

    Ends at which the model would be asked for times that no input covers are left out: nothing biases the parameters.
    """
    problem, fit, _ = fitted(write(tmp_path, late, extra='[clocks]\n"speed.csv" = { fit = true }\n'))
    (experiment,) = problem.identify
    (clock,) = experiment.clocks
    assert clock.added == pytest.approx(late, abs=0.1)
    assert clock.added + fit.fits[0].own[clock.name] == pytest.approx(late, abs=2e-3)
    for name in ("spring.stiffness", "spring.damping"):
        assert abs(fit[name] - TRUTH[name]) < 4.0 * std_of(fit, name), name
    residual = fit.fits[0].residual[:, experiment.outputs.index("mass.velocity")]
    assert np.max(np.abs(residual)) < 6.0 * NOISE["mass.velocity"]


def test_what_own_instants_do_not_allow_is_refused(tmp_path):
    study = write(tmp_path, extra='[study]\nsearch = "evidence"\n')
    with pytest.raises(StudyError, match="search by evidence does not know"):
        read_problem(study)
    problem = read_problem(write(tmp_path, extra='[study]\nresidual = "prediction"\n'))
    with pytest.raises(StudyError, match='residual = "prediction"'):
        prepared_problem(problem)
    study = write(tmp_path, extra='[clocks]\n"motion.csv" = { fit = true }\n')
    with pytest.raises(StudyError, match="the inputs push come from this logger"):
        read_problem(study)
    study = write(tmp_path, extra='[clocks]\n"speed.csv" = { offset = 1000.0 }\n')
    with pytest.raises(RecordError, match="no time in common"):
        read_problem(study)


def test_a_column_that_two_loggers_have_must_be_told_apart(tmp_path):
    for name, sign in (("a.csv", 1), ("b.csv", -1)):
        rows = "".join(f"{k * 0.1:.1f},{sign * k},{sign * k * k}\n" for k in range(40))
        (tmp_path / name).write_text(f"t,x_m,only_{name[0]}_m\n{rows}")
    paths = [[tmp_path / "a.csv", tmp_path / "b.csv"]]
    asked = {"time": "t", "columns": {"x": "x_m", "a": "only_a_m"}}
    with pytest.raises(RecordError, match=r"'x_m' stands in a.csv, b.csv: say which is meant with file"):
        read_record(paths[0], **asked)
    record = read_record(paths[0], **asked, files={"x": "b.csv"})
    assert record.signals["x"].values[2] == -2.0
    with pytest.raises(RecordError, match=r"a.csv, b.csv: there is no column 'y_m'; nearest: 'x_m'"):
        read_record(paths[0], time="t", columns={"y": "y_m"})


def test_jittering_stamps_are_kept_on_request(tmp_path):
    rng = np.random.default_rng(0)
    t = np.arange(300) * 0.01 + 0.003 * rng.random(300)
    x = np.sin(3.0 * t)
    (tmp_path / "a.csv").write_text("t,x_m\n" + "".join(f"{a:.7f},{b:.9f}\n" for a, b in zip(t, x, strict=True)))
    with pytest.raises(RecordError, match='uneven = "own instants"'):
        read_record(tmp_path / "a.csv", time="t", columns={"x": "x_m"})
    record = read_record(tmp_path / "a.csv", time="t", columns={"x": "x_m"}, rules=ReadRules(uneven="own instants"))
    assert np.ptp(np.diff(record.time)) < 1e-9
    np.testing.assert_allclose(record.signals["x"].own.values, x[: len(record.signals["x"].own.values)], atol=1e-9)
    assert len(record.signals["x"].own.values) >= 299


def test_loggers_in_different_time_zones_meet(tmp_path):
    for name, hour, zone, step in (("a.csv", 10, "+00:00", 1), ("b.csv", 12, "+02:00", 5)):
        rows = "".join(f"2024-06-01T{hour}:00:{k:02d}{zone},{k * k}\n" for k in range(0, 60, step))
        (tmp_path / name).write_text(f"when,{name[0]}_m\n{rows}")
    record = read_record([tmp_path / "a.csv", tmp_path / "b.csv"], time="when", columns={"a": "a_m", "b": "b_m"})
    np.testing.assert_allclose(record.signals["b"].own.time, np.arange(0.0, 60.0, 5.0), atol=1e-9)  # stamps in ns
    np.testing.assert_array_equal(record.signals["a"].values[:3], [0.0, 1.0, 4.0])
