"""Sections of records that are too long to be used whole: where they lie and start, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments, read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.problem.tables import MOST_ROWS
from discrepancy.residual.sections import SECTIONS, in_sections
from discrepancy.study.history import fingerprint
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.signals.preparation import Preparation
from multibody import Model
from multibody.base.progress import silent
from multibody.inputs.table import InputTable
from multibody.library import CoulombFriction, ForceSource, Mass, Spring, ViscousFriction
from multibody.system.simulate import simulate

DT = 0.005
ROWS = 12_000


def oscillator(coulomb: float = 0.0) -> Model:
    model = Model("oscillator")
    carriage, drive = model.add("carriage", Mass(m=2.0)), model.add("drive", ForceSource())
    guide, spring = model.add("guide", ViscousFriction(viscous=3.0)), model.add("spring", Spring(stiffness=200.0))
    model.connect(carriage.flange, drive.flange, guide.a, spring.a)
    model.connect(guide.b, spring.b, model.ground)
    model.input("drive.force", drive.force)
    if coulomb:
        rub = model.add("rub", CoulombFriction(coulomb=coulomb, v_s=5e-3))
        model.connect(rub.a, carriage.flange)
        model.connect(rub.b, model.ground)
    return model


def motion(rows: int, seed: int, coulomb: float = 0.0):
    """Return time, force and the states of a run."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(rows)
    force = np.convolve(rng.standard_normal(rows), np.ones(40) / 2.0, mode="same")
    inputs = InputTable.from_columns(time, {"drive.force": force})
    return time, force, simulate(oscillator(coulomb).build(), (0.0, time[-1]), inputs=inputs, times=time)


def record(name: str, rows: int, seed: int, coulomb: float = 0.0) -> Record:
    time, force, run = motion(rows, seed, coulomb)
    position = run["carriage.position"] + 1e-4 * np.random.default_rng(seed + 100).standard_normal(rows)
    signals = {
        "drive.force": RecordedSignal(values=force, unit="N", column="force", measured_unit="N"),
        "carriage.position": RecordedSignal(values=position, unit="m", column="x", measured_unit="m"),
    }
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


def problem(*records: Record, most_rows: int = 4_000, **options) -> Problem:
    def experiments(of):
        return make_experiments(oscillator(), of, ["drive.force"], ["carriage.position"], **options)

    return Problem(
        name="oscillator",
        model=oscillator(),
        uncertain=(),
        identify=experiments(records[:-1]),
        validate=experiments(records[-1:]),
        most_rows=most_rows,
    )


@pytest.fixture(scope="module")
def long_record() -> Record:
    return record("long", ROWS, 1)


def rows_of(given: Record, part: Record) -> tuple[int, int]:
    begin = int(np.searchsorted(given.time, part.time[0]))
    np.testing.assert_array_equal(given.time[begin : begin + len(part.time)], part.time)
    return begin, begin + len(part.time)


def test_sections_are_apart_and_spread_over_a_record(long_record):
    found = in_sections(problem(long_record, long_record), silent)
    for part in (found.identify, found.validate):
        ends = [rows_of(long_record, e.record) for e in part]
        assert (ends[0][0], ends[-1][1]) == (0, ROWS)
        assert {b - a for a, b in ends} == {4_000 // SECTIONS}
        gaps = [b - a for (_, a), (b, _) in pairwise(ends)]
        assert len(gaps) == SECTIONS - 1
        assert min(gaps) > 0
        assert max(gaps) - min(gaps) <= 1


def test_rows_are_shared_by_the_long_records(long_record):
    short = record("short", 2_000, 2)
    found = in_sections(problem(long_record, short, long_record, long_record), silent)
    lengths = [len(e.record.time) for e in found.identify]
    assert lengths == [250] * SECTIONS + [2_000] + [250] * SECTIONS
    assert [len(e.record.time) for e in found.validate] == [500] * SECTIONS


def test_where_sections_lie_does_not_depend_on_what_was_measured(long_record):
    other = record("long", ROWS, 7)
    names = [[e.name for e in in_sections(problem(r, r), silent).identify] for r in (long_record, other)]
    assert names[0] == names[1]


def test_a_section_starts_where_the_machine_is_and_its_start_is_fitted(long_record):
    found = in_sections(problem(long_record, long_record), silent)
    run = motion(ROWS, 1)[2]
    for e in found.identify[1:]:
        first = rows_of(long_record, e.record)[0]
        assert set(e.free) == {"carriage.position", "carriage.velocity"}
        for name in e.free:
            assert float(e.start[name]) == pytest.approx(run[name][first], abs=0.1 * np.std(run[name]))
    assert found.identify[0].free == problem(long_record, long_record).identify[0].free


def test_only_the_rows_between_start_and_stop_count(long_record):
    inside = Preparation(start=10.0, stop=10.0 + 3_000 * DT)
    given = problem(long_record, long_record, preparation=inside)
    assert in_sections(given, silent) is given
    wider = problem(long_record, long_record, preparation=replace(inside, stop=50.0))
    ends = [rows_of(long_record, e.record) for e in in_sections(wider, silent).identify]
    assert (ends[0][0], ends[-1][1]) == (2_000, 10_001)


def test_records_within_the_limit_stay_as_they_are(long_record):
    given = problem(long_record, long_record, most_rows=ROWS)
    assert in_sections(given, silent) is given


def test_what_was_done_is_said_with_the_key_that_changes_it(long_record):
    warning = in_sections(problem(long_record, long_record), silent).warnings[0]
    assert warning.startswith("long has 12000 rows: 8 sections of 500 rows")
    assert "[study] most_rows" in warning


def test_a_search_in_sections_names_the_friction():
    study = Study(problem(record("a", ROWS, 3, 1.0), record("b", ROWS, 4, 1.0)))
    conclusion = study.diagnose()
    assert [s.accepted.effect.kind for s in study.accepted_stages] == ["coulomb_friction"]
    assert any("8 sections of 500 rows" in w for w in conclusion.warnings)
    assert len(study.stage.identify.fits) == SECTIONS
    assert len(study.source.identify) == 1, "the records themselves are kept"


def test_a_history_belongs_to_one_limit(long_record):
    given = problem(long_record, long_record, most_rows=MOST_ROWS)
    assert fingerprint(Study(given)) != fingerprint(Study(replace(given, most_rows=20_000)))


def test_too_few_rows_are_refused(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[model]\nbuild = "m.py:build"\n[study]\nmost_rows = 500\n', encoding="utf-8")
    with pytest.raises(StudyError, match=r"\[study\] most_rows: is 500, and must be at least 10000"):
        read_problem(path)
