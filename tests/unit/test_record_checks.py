"""Broken recordings: each kind of fault is refused or warned of, with file, column, row and what to do."""

from __future__ import annotations

import gc
import gzip
from pathlib import Path

import numpy as np
import pytest

from estimation import Record, RecordError, read_record, read_records
from estimation.files.read_rules import ReadRules
from estimation.files.record_checks import grid_deviation

ASKED = {"time": "time_s", "columns": {"x": "x_mm", "F": "F_N"}, "units": {"x": "m", "F": "N"}}
COUNT = 60


def table(count: int = COUNT) -> dict[str, np.ndarray]:
    t = np.arange(count) * 0.01
    return {"time_s": t, "x_mm": 10.0 * np.sin(7.0 * t), "F_N": 100.0 * np.cos(5.0 * t) + t}


def text(columns: dict[str, np.ndarray]) -> list[str]:
    rows = zip(*columns.values(), strict=True)
    return [",".join(columns), *(",".join(f"{each:.9g}" for each in row) for row in rows)]


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def with_cell(line: int, column: int, cell: str) -> list[str]:
    """A sound file with one cell replaced; lines are counted from 1 as an editor does."""
    lines = text(table())
    cells = lines[line - 1].split(",")
    cells[column] = cell
    lines[line - 1] = ",".join(cells)
    return lines


def swapped_rows() -> list[str]:
    lines = text(table())
    lines[9], lines[10] = lines[10], lines[9]
    return lines


def with_gap(seconds: float) -> list[str]:
    columns = table()
    columns["time_s"][30:] += seconds
    return text(columns)


def jittered(share: float) -> dict[str, np.ndarray]:
    columns = table()
    columns["time_s"] = columns["time_s"] + 0.01 * share * np.where(np.arange(COUNT) % 2, 1.0, -1.0)
    return columns


def changed(**columns: np.ndarray) -> list[str]:
    return text({**table(), **columns})


REFUSED = {
    "empty file": ([""], ["broken.csv: the file is empty"]),
    "comments only": (["# nothing", "# here"], ["the file is empty"]),
    "no data": (["time_s,x_mm,F_N"], ["header but no data"]),
    "one row": (text(table(1)), ["only one row of data (line 2)"]),
    "no header": (text(table())[1:], ["line 1: no header"]),
    "lines above, no header": (["Rig 5", *text(table())[1:]], ["'Rig 5' does not look like a header", "skip_rows"]),
    "spaces": (["time_s x_mm F_N", "0 1 2"], ["separate columns by comma, semicolon or tab"]),
    "missing column": (["time_s,x_m,F_N", "0,1,2", "1,2,3"], ["no column 'x_mm'; nearest: 'x_m'"]),
    "two missing columns": (["time,x_m,F_N", "0,1,2"], ["no column 'time_s'", "no column 'x_mm'"]),
    "same name twice": (["time_s,x_mm,x_mm,F_N", "0,1,2,3"], ["2 columns are called 'x_mm'"]),
    "text": (with_cell(7, 2, "off"), ["column 'F_N', line 7: 'off' is not a number"]),
    "unit row": (with_cell(2, 1, "mm"), ["line 2: 'mm' is not a number: if it is a unit, write it"]),
    "thousands": (with_cell(5, 1, '"1,234.5"'), ["line 5: '1,234.5' is not a number", "thousands"]),
    "clock time": (with_cell(5, 0, "10:15:03.2"), ["column 'time_s', line 5", "give time as a number"]),
    "hexadecimal": (with_cell(5, 1, "0x1F"), ["line 5: '0x1F' is not a number"]),
    "underscored": (with_cell(5, 1, "1_000"), ["line 5: '1_000' is not a number"]),
    "nan": (with_cell(9, 1, "NaN"), ["column 'x_mm', line 9: value NaN or empty, 1.67 %", "drop_nan"]),
    "empty cell": (with_cell(9, 2, ""), ["column 'F_N', line 9: value NaN or empty"]),
    "inf": (with_cell(9, 2, "-inf"), ["column 'F_N', line 9: value infinite"]),
    "too large": (with_cell(9, 2, "1e999"), ["column 'F_N', line 9: value infinite"]),
    "nan in time": (with_cell(9, 0, "nan"), ["column 'time_s', line 9: value NaN or empty"]),
    "whole column empty": (changed(F_N=np.full(COUNT, np.nan)), ["column 'F_N': every value is missing"]),
    "time stands": (with_cell(8, 0, "0.05"), ["line 8: same time stamp as the row", "drop_duplicates"]),
    "time backwards": (swapped_rows(), ["line 11: time runs backwards", "trip ="]),
    "gap": (with_gap(2.0), ["gaps after line 31, the longest 2.01 s", 'gaps = "split"']),
    "irregular": (text(jittered(0.2)), ["irregular sampling", "% of a step", "resample = "]),
    "sample missing": (text(table())[:20] + text(table())[21:], ["irregular sampling", "after line 20"]),
    "cut line": ([*text(table()), "0.60,1.2"], ["line 62: 2 cells where", "last line is incomplete"]),
    "decimal commas": (["time_s,x_mm,F_N", "0,0,1,5,2,5", "0,1,1,5,2,5"], ["6 cells where", "semicolons"]),
    "copied column": (changed(F_N=table()["x_mm"]), ["'x_mm' and 'F_N': the same numbers in every row"]),
    "constant in all": (changed(F_N=np.full(COUNT, 3.0)), ["column 'F_N': constant at 3 in every record"]),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_broken_file_is_refused_and_named(tmp_path, kind):
    lines, told = REFUSED[kind]
    path = write(tmp_path / "broken.csv", lines) if lines != [""] else tmp_path / "broken.csv"
    if lines == [""]:
        path.touch()
    with pytest.raises(RecordError) as refused:
        read_records([path], **ASKED)
    assert "broken.csv" in str(refused.value)
    for each in told:
        assert each in str(refused.value)


RAW = {
    "binary": (b"\x00\x01\x02" * 50, "holds binary data"),
    "not gzip": (b"time_s,x_mm,F_N\n0,1,2\n", "not a gzip file although its name says so"),
    "cut gzip": (gzip.compress("\n".join(text(table())).encode())[:-40], "damaged or cut off"),
}


@pytest.mark.parametrize("kind", RAW)
def test_unreadable_bytes_are_refused(tmp_path, kind):
    content, told = RAW[kind]
    path = tmp_path / ("broken.csv" if kind == "binary" else "broken.csv.gz")
    path.write_bytes(content)
    with pytest.raises(RecordError, match=told):
        read_records([path], **ASKED)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.xls", b"PK", "unknown kind of file: save it as one of .csv"),
        ("a.xlsx", b"PK", "not a readable Excel file"),
        ("a.h5", b"HDF", "not a readable HDF5 file"),
        ("a.mf4", b"MDF     4.10" + b" " * 200, "not a readable MDF file"),
        ("a.tdms", b"TDSm", "not a readable TDMS file"),
        ("a.uff", b"    -1\n    58\n", "holds no time response"),
        ("a.mcap", b"\x89MCAP0", "not readable as an MCAP file"),
        ("a.bag", b"#ROSBAG V2.0\n", "not readable as a ROS bag"),
        ("a.parquet", b"PAR1 but not really", "not a readable Parquet file"),
        ("a.mat", b"MATLAB 5.0 MAT-file, cut" + b" " * 200, "not a readable MATLAB file"),
        ("a.mat", b"MATLAB 7.3 MAT-file" + b" " * 600, "save it with save|not a readable"),
    ],
)
def test_foreign_files_are_refused(tmp_path, name, content, told):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=told):
        read_records([tmp_path / name], **ASKED)


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_damaged_mdf_file_leaves_nothing_that_fails_later(tmp_path):
    pytest.importorskip("asammdf")
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10" + b" " * 200)
    with pytest.raises(RecordError, match="not a readable MDF file"):
        read_records([tmp_path / "a.mf4"], **ASKED)
    gc.collect()


def test_missing_file_names_the_nearest(tmp_path):
    write(tmp_path / "run_01.csv", text(table()))
    with pytest.raises(RecordError, match=r"no such file; nearest: 'run_01.csv'"):
        read_records([tmp_path / "run_1.csv"], **ASKED)
    with pytest.raises(RecordError, match="is a folder"):
        read_records([tmp_path], **ASKED)


def test_wrong_unit_names_both(tmp_path):
    path = write(tmp_path / "a.csv", text(table()))
    with pytest.raises(RecordError, match=r"column 'F_N': 'N' cannot be converted to 'm/s'"):
        read_records([path], **{**ASKED, "units": {"x": "m", "F": "m/s"}})
    with pytest.raises(RecordError, match=r"column 'x_mm'.*'s'"):
        read_records([path], time="x_mm", columns={"F": "F_N"})


def test_faults_of_all_files_are_told_at_once(tmp_path):
    paths = [
        write(tmp_path / "a.csv", with_cell(7, 2, "off")),
        write(tmp_path / "b.csv", text(table())),
        write(tmp_path / "c.csv", swapped_rows()),
    ]
    with pytest.raises(RecordError) as refused:
        read_records([*paths, tmp_path / "d.csv"], **ASKED)
    assert [each.split(",")[0].split(":")[0].split("/")[-1] for each in refused.value.faults] == [
        "a.csv",
        "c.csv",
        "d.csv",
    ]
    assert str(refused.value).startswith("3 faults in the recordings")


def test_swapped_columns_between_files_are_refused(tmp_path):
    columns = table()
    columns["F_N"] *= 1000.0
    swapped = {"time_s": columns["time_s"], "x_mm": columns["F_N"] * 1.1, "F_N": columns["x_mm"] * 0.9}
    paths = [write(tmp_path / "a.csv", text(columns)), write(tmp_path / "b.csv", text(swapped))]
    with pytest.raises(RecordError, match=r"b.csv, columns 'F_N' and 'x_mm': look swapped"):
        read_records(paths, time="time_s", columns={"x": "x_mm", "F": "F_N"}, measured_units={"x": "", "F": ""})


def warnings_of(records: tuple[Record, ...]) -> str:
    return "\n".join(line for each in records for line in each.warnings)


def test_foreign_scale_and_rate_are_warned_of(tmp_path):
    other = table()
    other["x_mm"] = other["x_mm"] * 5000.0
    other["time_s"] = other["time_s"] * 2.0
    paths = [write(tmp_path / "a.csv", text(table())), write(tmp_path / "b.csv", text(other))]
    told = warnings_of(read_records(paths, **ASKED))
    assert "b.csv, column 'x_mm': its largest value is 5e+03 times that in a.csv" in told
    assert "different sampling rates (a 100 Hz, b 50 Hz)" in told


def test_clipping_is_warned_of_but_rest_is_not(tmp_path):
    t = np.arange(400) * 0.01
    wave = 10.0 * np.sin(3.0 * t)
    rest = 10.0 * (1.0 - np.cos(np.minimum(t, np.pi)))  # travels to its largest value and stands there
    for values, expected in (
        (np.clip(wave, -8.0, 8.0), True),
        (wave, False),
        (rest, False),
        (np.sign(wave), False),
        (np.round(5.0 * np.sin(0.9 * t)), False),  # an encoder of ten steps, turning back slowly
        (np.clip(np.round(5.0 * wave), -31.0, 31.0), True),
    ):
        path = write(tmp_path / "a.csv", text({"time_s": t, "x_mm": values}))
        record = read_record(path, time="time_s", columns={"x": "x_mm"})
        assert ("clipped at" in warnings_of((record,))) is expected
        assert any(line.startswith("warning: ") for line in record.log) is expected


def test_constant_channel_of_one_record_is_warned_of(tmp_path):
    still = write(tmp_path / "still.csv", changed(F_N=np.full(COUNT, 3.0)))
    told = warnings_of(read_records([write(tmp_path / "a.csv", text(table())), still], **ASKED))
    assert "still.csv, column 'F_N': constant at 3 from line 2 to 61" in told
    # An input may stand still in every record.
    assert len(read_records([still], **ASKED, may_be_constant=("F",))) == 1


def test_nan_rows_are_left_out_only_when_allowed(tmp_path):
    lines = with_cell(9, 1, "NaN")
    path = write(tmp_path / "a.csv", lines)
    with pytest.raises(RecordError, match="irregular sampling"):
        read_records([path], **ASKED, rules=ReadRules(drop_nan=True))
    (record,) = read_records([path], **ASKED, rules=ReadRules(drop_nan=True, resample=100.0))
    assert any("left out line 9 with missing" in line for line in record.log)
    assert any("interpolated linearly" in line for line in record.log)
    assert len(record.time) == COUNT
    # Linear interpolation errs by at most h²/8 max|x''| = 0.02²/8 · 0.01 · 49 m.
    np.testing.assert_allclose(record.signals["x"].values, 1e-3 * table()["x_mm"], atol=0.02**2 / 8 * 0.49 + 1e-10)


def test_nan_at_the_end_is_left_out_without_interpolation(tmp_path):
    path = write(tmp_path / "a.csv", with_cell(61, 1, ""))
    (record,) = read_records([path], **ASKED, rules=ReadRules(drop_nan=True))
    assert len(record.time) == COUNT - 1


def test_duplicates_are_left_out_only_when_allowed(tmp_path):
    lines = text(table())
    lines.insert(9, lines[8])
    path = write(tmp_path / "a.csv", lines)
    (record,) = read_records([path], **ASKED, rules=ReadRules(drop_duplicates=True))
    assert len(record.time) == COUNT
    assert any("left out line 10 with the time stamp of the row before" in line for line in record.log)


def test_gaps_split_or_are_bridged_only_when_allowed(tmp_path):
    path = write(tmp_path / "a.csv", with_gap(2.0))
    parts = read_records([path], **ASKED, rules=ReadRules(gaps="split"))
    assert [(each.name, len(each.time)) for each in parts] == [("a part 1", 30), ("a part 2", 30)]
    assert all("cut at 1 gap" in each.log for each in parts)
    with pytest.raises(RecordError, match="gaps after"):
        read_records([path], **ASKED, rules=ReadRules(resample=100.0))
    (bridged,) = read_records([path], **ASKED, rules=ReadRules(resample=100.0, longest_gap=3.0))
    assert len(bridged.time) == COUNT + 200
    with pytest.raises(RecordError, match="holds 2 records"):
        read_record(path, **ASKED, rules=ReadRules(gaps="split"))


def test_short_parts_between_gaps_are_warned_of(tmp_path):
    columns = table()
    columns["time_s"][30:] += 2.0
    columns["time_s"][34:] += 2.0
    path = write(tmp_path / "a.csv", text(columns))
    parts = read_records([path], **ASKED, rules=ReadRules(gaps="split"))
    assert [len(each.time) for each in parts] == [30, 26]
    assert "left out 1 part between gaps (4 rows)" in warnings_of(parts)


def test_resampling_cannot_fold_vibration(tmp_path):
    path = write(tmp_path / "a.csv", text(table()))
    with pytest.raises(RecordError, match="below half the rate of the file"):
        read_records([path], **ASKED, rules=ReadRules(resample=30.0))
    (record,) = read_records([path], **ASKED, rules=ReadRules(resample=80.0))
    assert "resampled below its own rate of 100 Hz" in warnings_of((record,))


def test_small_jitter_is_accepted_and_logged(tmp_path):
    columns = jittered(0.02)
    record = read_record(write(tmp_path / "a.csv", text(columns)), **ASKED)
    assert any("% of a step off an even grid" in line for line in record.log)
    # The stamps lie alternately 2 % of a step before and behind an even grid.
    assert grid_deviation(record.time) == pytest.approx(0.02, rel=0.1)


def test_faults_outside_the_window_do_not_matter(tmp_path):
    path = write(tmp_path / "a.csv", with_cell(9, 1, "NaN"))
    (record,) = read_records([path], **ASKED, rules=ReadRules(start=0.1, stop=0.4))
    assert (record.time[0], record.time[-1]) == (0.1, 0.4)
    assert any("outside the window" in line for line in record.log)
    with pytest.raises(RecordError, match=r"runs from 0 to 0\.59 s"):
        read_records([path], **ASKED, rules=ReadRules(start=5.0))


def test_a_trip_of_one_row_is_refused(tmp_path):
    columns = {"trip": np.append(np.zeros(COUNT - 1), 1.0), **table()}
    path = write(tmp_path / "a.csv", text(columns))
    with pytest.raises(RecordError, match=r"trip \[1\]: one row only, line 61"):
        read_records([path], **ASKED, rules=ReadRules(trip="trip"))
    with pytest.raises(RecordError, match="no column 'ride'"):
        read_records([path], **ASKED, rules=ReadRules(trip="ride"))


def test_unused_columns_may_hold_anything(tmp_path):
    lines = text(table())
    lines = [lines[0] + ",note,note", *(each + ",ok,,"[:4] for each in lines[1:])]
    record = read_record(write(tmp_path / "a.csv", lines), **ASKED)
    assert any("columns with the same name, not used here: note" in line for line in record.log)


def test_inputs_that_stand_still_in_every_record_are_told_once(tmp_path) -> None:
    for k, speed in enumerate((600.0, 900.0)):
        moving = {"t": np.arange(50) / 100.0, "y": np.sin(np.arange(50.0) + k)}
        still = {"rpm": np.full(50, speed), "load": np.full(50, 5.0)}
        write(tmp_path / f"{k}.csv", text({**moving, **still}))
    columns = {"speed": "rpm", "torque": "load", "out": "y"}
    paths = [tmp_path / f"{k}.csv" for k in range(2)]
    found = read_records(paths, time="t", columns=columns, may_be_constant=("speed", "torque"))
    told = [w for r in found for w in r.warnings]
    assert len(told) == 2
    assert len(set(told)) == 1
    assert told[0].startswith("'rpm', 'load': constant within each of the 2 recordings")
    assert any("column 'rpm': constant at" in line for line in found[1].log)
    one = read_records(paths[:1], time="t", columns=columns, may_be_constant=("speed", "torque"))
    assert len(one[0].warnings) == 2


def test_the_plateau_of_a_command_is_not_told_to_be_clipped(tmp_path):
    t = np.arange(400) * 0.01
    ramp = np.clip(np.abs(((t + 0.5) % 2.0) - 1.0) * 3.0, 0.5, 2.0)  # a trapezoid, entered steeply
    rows = "".join(f"{a:.2f},{b:.6f},{b + 0.001 * a:.6f}\n" for a, b in zip(t, ramp, strict=True))
    (tmp_path / "a.csv").write_text(f"t,u_V,x_m\n{rows}")
    asked = {"time": "t", "columns": {"u": "u_V"}}
    assert any("looks clipped" in line for line in read_record(tmp_path / "a.csv", **asked).warnings)
    assert read_record(tmp_path / "a.csv", **asked, driven={"u": "linear"}).warnings == ()
