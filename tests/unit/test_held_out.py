"""What is held out is another measurement: content decides, not the name or the bytes of a file."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.search.state import SearchState
from discrepancy.stages import fit_stage
from estimation import Record
from estimation.files.record import RecordedSignal
from estimation.files.shared_rows import RUN, near_copies, shared_rows
from multibody.base.errors import SimulationError

MODEL = """
from multibody import Model
from multibody.library import ForceSource, Mass, ViscousFriction

def build():
    model = Model("cart")
    body = model.add("body", Mass(m=2.0))
    drive = model.add("drive", ForceSource())
    guide = model.add("guide", ViscousFriction(viscous=3.0))
    model.connect(drive.flange, body.flange)
    model.connect(guide.a, body.flange)
    model.connect(guide.b, model.ground)
    model.input("force", drive.force)
    model.output("position", "body.position")
    return model
"""
STUDY = """
[model]
build = "cart.py:build"
[inputs]
force = "force_N"
[outputs]
position = "position_mm"
[records]
time = "time_s"
identify = ["a.csv"]
validate = ["b.csv"]
"""


def rows(seed: int, count: int = 400) -> np.ndarray:
    time = 0.01 * np.arange(count)
    force = np.sin(3.0 * time)  # the same command in every trip
    noise = 0.05 * np.random.default_rng(seed).standard_normal(count)
    return np.column_stack([time, force, 20.0 * np.sin(3.0 * time - 1.0) + noise])


def text(values: np.ndarray, form: str = "%.7g") -> str:
    lines = [",".join(form % v for v in row) for row in values]
    return "\n".join(["time_s,force_N,position_mm", *lines]) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cart.py").write_text(MODEL)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "a.csv").write_text(text(rows(1)))
    (tmp_path / "b.csv").write_text(text(rows(2)))
    return tmp_path


def faults(folder: Path) -> tuple[str, ...]:
    with pytest.raises(StudyError) as refused:
        read_problem(folder / "study.toml")
    return refused.value.faults


def test_a_repetition_of_the_same_trip_is_another_measurement(folder: Path) -> None:
    assert read_problem(folder / "study.toml").warnings == ()


def _later(values: np.ndarray) -> np.ndarray:
    return values + np.array([100.0, 0.0, 0.0])


COPIES = {
    "a blank line": lambda a: text(a).replace("\n", "\n\n", 1),
    "more digits": lambda a: text(a, "%.12g").replace(".0,", ".000,"),
    "a range of rows": lambda a: text(a[100:200]),
    "another clock": lambda a: text(_later(a)),
    "another command": lambda a: text(a * [1.0, 2.0, 1.0]),
    "half of it": lambda a: text(np.vstack([a[200:], rows(3)[:200] + np.array([4.0, 0.0, 0.0])])),
}


@pytest.mark.parametrize("copy", COPIES.values(), ids=COPIES)
def test_a_copy_is_not_held_out(folder: Path, copy) -> None:
    (folder / "b.csv").write_text(copy(np.loadtxt(folder / "a.csv", delimiter=",", skiprows=1)))
    (fault,) = faults(folder)
    assert "[records] validate: 'b.csv'" in fault
    assert "'a.csv', which is in identify" in fault
    assert "record again" in fault


def test_a_compressed_copy_is_not_held_out(folder: Path) -> None:
    with gzip.open(folder / "b.csv.gz", "wt") as stream:
        stream.write((folder / "a.csv").read_text())
    (folder / "study.toml").write_text(STUDY.replace("b.csv", "b.csv.gz"))
    (fault,) = faults(folder)
    assert "'b.csv.gz' is a copy of 'a.csv', which is in identify (400 rows" in fault


def test_a_copy_among_the_records_to_fit_would_count_twice(folder: Path) -> None:
    (folder / "c.csv").write_text(text(_later(rows(1))))
    (folder / "study.toml").write_text(STUDY.replace('["a.csv"]', '["a.csv", "c.csv"]'))
    (fault,) = faults(folder)
    assert "[records] identify: 'c.csv' is a copy of 'a.csv'" in fault
    assert "count twice" in fault


@pytest.mark.parametrize("form", ["%.4g", "%.6g"])
def test_a_copy_rounded_or_scaled_anew_is_a_warning(folder: Path, form: str) -> None:
    (folder / "b.csv").write_text(text(rows(1)[50:] * [1.0, 1.0, 1.001], form))
    (warning,) = read_problem(folder / "study.toml").warnings
    assert "'b.csv' has the noise of 'a.csv'" in warning


def record(values: np.ndarray) -> Record:
    signal = RecordedSignal(values=values, unit="m", column="x", measured_unit="m")
    return Record(name="r", path=Path("r.csv"), time=0.01 * np.arange(len(values)), signals={"x": signal})


def test_records_that_meet_through_a_third_are_compared() -> None:
    noise = np.random.default_rng(0).standard_normal(300)
    one, two, three = noise[:200], noise[100:300], noise[150:250]
    found = shared_rows([record(one), record(two), record(three)], ["x"])
    assert [(s.first, s.second, s.rows) for s in found] == [(0, 1, 100), (0, 2, 50), (1, 2, 100)]
    assert (found[0].start, found[0].stop) == (0.0, pytest.approx(0.99))


def test_a_machine_at_rest_repeats_itself_and_that_is_no_copy() -> None:
    rng = np.random.default_rng(1)
    still = np.zeros(500)
    moving = [np.concatenate([still, rng.standard_normal(200)]) for _ in range(2)]
    assert shared_rows([record(m) for m in moving], ["x"]) == []
    assert shared_rows([record(still[: RUN - 1])] * 2, ["x"]) == []


def test_a_search_for_equal_noise_that_would_take_minutes_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    import estimation.files.shared_rows as room

    two = [record(np.random.default_rng(k).standard_normal(100)) for k in (1, 1)]
    assert near_copies(two, ["x"], [(0, 1)]) == [(0, 1)]
    monkeypatch.setattr(room, "MOST_SAMPLES", 199)
    assert near_copies(two, ["x"], [(0, 1)]) is None


def test_a_record_that_cannot_be_simulated_costs_that_record_alone(folder: Path, monkeypatch) -> None:
    (folder / "c.csv").write_text(text(rows(9)))
    study = STUDY.replace('["b.csv"]', '["b.csv", "c.csv"]')
    (folder / "study.toml").write_text(study)
    real = fit_stage.evaluate

    def evaluate(system, experiments, **options):
        if any(e.name == "c" for e in experiments):
            raise SimulationError("the state grows without bound")
        return real(system, experiments, **options)

    monkeypatch.setattr(fit_stage, "evaluate", evaluate)
    state = SearchState(read_problem(folder / "study.toml"))
    assert [f.experiment.name for f in state.stage.fits("validate")] == ["b"]
    assert [[f.experiment.name for f in s.fits("validate")] for s in state.stages] == [["b"], ["b"]]
    (told,) = state.unanswered
    assert told.startswith(
        "held out, but not used: the model 'as given' cannot be simulated on c; leave the record out"
    )
