"""Reading files into records: the same SI numbers come back from every format and spelling."""

from __future__ import annotations

import gzip
import random
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from estimation import RecordError, read_record, read_records
from estimation.files.column_names import read_column_name, si_unit_of, to_si
from estimation.files.read_rules import ReadRules
from multibody.base.units import UnitError

# Spelling of a column, its SI unit, and the factor from the file's number to SI, by definition of the units
# (rpm = 2 pi / 60 rad/s, bar = 1e5 Pa, standard gravity 9.80665 m/s2).
SPELLINGS = [
    ("F_c [N]", "N", 1.0),
    ("force_kN", "N", 1e3),
    ("F (mN)", "N", 1e-3),
    ("load in kN", "N", 1e3),
    ("z [mm]", "m", 1e-3),
    ("z_mm", "m", 1e-3),
    ("position_ref_m", "m", 1.0),
    ("s [µm]", "m", 1e-6),
    ("a_m_per_s2", "m/s**2", 1.0),
    ("acc [m/s²]", "m/s**2", 1.0),
    ("acc [m/s2]", "m/s**2", 1.0),
    ("acc_m_s2", "m/s**2", 1.0),
    ("a [g_0]", "m/s**2", 9.80665),
    ("acc_g", "m/s**2", 9.80665),
    ("v_mm_per_s", "m/s", 1e-3),
    ("v [m/min]", "m/s", 1.0 / 60.0),
    ("v_km_h", "m/s", 1.0 / 3.6),
    ("w_rad_per_s", "rad/s", 1.0),
    ("w_rad_s", "rad/s", 1.0),
    ("speed (rpm)", "rad/s", np.pi / 30.0),
    ("speed_rpm", "rad/s", np.pi / 30.0),
    ("n [U/min]", "rad/s", np.pi / 30.0),
    ("w [deg/s]", "rad/s", np.pi / 180.0),
    ("phi_deg", "rad", np.pi / 180.0),
    ("phi [°]", "rad", np.pi / 180.0),
    ("phi [rev]", "rad", 2.0 * np.pi),
    ("T_Nm", "N*m", 1.0),
    ("T [mNm]", "N*m", 1e-3),
    ("torque [kN·m]", "N*m", 1e3),
    ("T_Nmm", "N*m", 1e-3),
    ("u_V", "V", 1.0),
    ("i_mA", "A", 1e-3),
    ("i [A]", "A", 1.0),
    ("p_bar", "Pa", 1e5),
    ("p [MPa]", "Pa", 1e6),
    ("duty_percent", "", 0.01),
    ("duty [%]", "", 0.01),
    ("ratio [-]", "", 1.0),
    ("c [N/mm]", "N/m", 1e3),
    ("m_g", "kg", 1e-3),
    ("plain", "N", 1.0),
    ("angle_a", "rad", 1.0),
    ("w (filtered)", "rad/s", 1.0),
    ("k_N_per_m", "N/m", 1.0),
    ("d_Nms_per_rad", "N*m*s", 1.0),
    ("q[0]", "m", 1.0),
]
TIMES = [
    ("time_s", 1.0),
    ("t [ms]", 1e-3),
    ("time_us", 1e-6),
    ("time_min", 60.0),
    ("t (h)", 3600.0),
    ("t", 1.0),
]


def write(path: Path, names: list[str], table: np.ndarray, dialect: str) -> None:
    """Write a table as a file of the kind that the path's ending and the dialect ask for."""
    if path.name.endswith(".parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table({name: table[:, k] for k, name in enumerate(names)}), path)
        return
    delimiter = {"comma": ",", "semicolon": ";", "decimal comma": ";", "tab": "\t", "tab comma": "\t"}[dialect]
    lines = ["# rig 3, channel list below", delimiter.join(names)]
    for row in table:
        cells = [repr(float(each)) for each in row]
        if dialect in ("decimal comma", "tab comma"):
            cells = [each.replace(".", ",") for each in cells]
        lines.append(delimiter.join(cells))
    lines.insert(len(lines) // 2 + 2, "# operator changed the load")
    text = "\r\n".join(lines) + "\r\n"
    raw = b"\xef\xbb\xbf" + text.encode()
    path.write_bytes(gzip.compress(raw) if path.name.endswith(".gz") else raw)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    chosen=st.lists(st.sampled_from(SPELLINGS), min_size=1, max_size=5, unique_by=lambda each: each[0]),
    time=st.sampled_from(TIMES),
    ending=st.sampled_from([".csv", ".csv.gz", ".parquet"]),
    dialect=st.sampled_from(["comma", "semicolon", "decimal comma", "tab", "tab comma"]),
    numbers=st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=12, max_size=40),
)
def test_same_si_numbers_from_every_spelling_and_format(tmp_path, chosen, time, ending, dialect, numbers):
    names = [time[0], *(each[0] for each in chosen)]
    assume(len(set(names)) == len(names))
    values = np.array(numbers)
    stamps = np.arange(len(values)) * 0.25
    # Each column is another multiple, so that a mix-up of columns cannot go unseen.
    table = np.column_stack([stamps, *(values * (k + 1) for k in range(len(chosen)))])
    path = tmp_path / f"table{ending}"
    write(path, names, table, dialect)
    record = read_record(
        path,
        time=time[0],
        columns={f"s{k}": each[0] for k, each in enumerate(chosen)},
        units={f"s{k}": each[1] for k, each in enumerate(chosen)},
    )
    # A conversion is one multiplication and one addition in double precision.
    np.testing.assert_allclose(record.time, stamps * time[1], rtol=1e-14)
    for k, (column, unit, factor) in enumerate(chosen):
        signal = record.signals[f"s{k}"]
        np.testing.assert_allclose(signal.values, values * (k + 1) * factor, rtol=1e-12, atol=0)
        assert (signal.unit, signal.column) == (unit, column)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 10_000),
    damage=st.sampled_from(
        [
            "drop row",
            "double row",
            "swap rows",
            "text",
            "empty",
            "inf",
            "cut off",
            "extra cell",
            "missing cell",
            "jump",
        ]
    ),
    row=st.integers(5, 34),
)
def test_damage_is_refused_with_its_line(tmp_path, seed, damage, row):
    rng = random.Random(seed)
    lines = ["time_s,force_N", *(f"{k * 0.01:.2f},{rng.uniform(-5, 5):.4f}" for k in range(40))]
    line = row  # index in the list; the line of the file is one more
    if damage == "drop row":
        del lines[line]
    elif damage == "double row":
        lines.insert(line, lines[line])
    elif damage == "swap rows":
        lines[line], lines[line + 1] = lines[line + 1], lines[line]
    elif damage in ("text", "empty", "inf"):
        lines[line] = lines[line].split(",")[0] + "," + {"text": "n.v.", "empty": "", "inf": "inf"}[damage]
    elif damage == "cut off":
        lines = [*lines[:line], lines[line].split(",")[0]]
    elif damage == "extra cell":
        lines[line] += ",1.0"
    elif damage == "missing cell":
        lines[line] = lines[line].split(",")[0]
    else:
        lines[line:] = [f"{float(each.split(',')[0]) + 3.0:.2f},{each.split(',')[1]}" for each in lines[line:]]
    path = tmp_path / "damaged.csv"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(RecordError) as refused:
        read_record(path, time="time_s", columns={"force": "force_N"}, units={"force": "N"})
    place = {"double row": line + 2, "swap rows": line + 2, "jump": line, "drop row": line}.get(damage, line + 1)
    assert re.search(rf"\blines? (\d+, )*{place}\b", str(refused.value))
    assert "damaged.csv" in str(refused.value)


def test_matlab_vectors_and_structures(tmp_path):
    import scipy.io

    t = np.arange(20) * 0.1
    content = {
        "time_s": t[:, None],
        "force_kN": t[None, :] ** 2,
        "gain": 3.0,
        "data": {"pos_mm": t, "note": "x"},
    }
    scipy.io.savemat(tmp_path / "run.mat", content)
    record = read_record(
        tmp_path / "run.mat",
        time="time_s",
        columns={"F": "force_kN", "x": "data.pos_mm"},
        units={"F": "N", "x": "m"},
    )
    np.testing.assert_array_equal(record.time, t)
    np.testing.assert_allclose(record.signals["F"].values, 1e3 * t**2, rtol=1e-15)
    np.testing.assert_allclose(record.signals["x"].values, 1e-3 * t, rtol=1e-15)


def test_matlab_faults_are_told_together(tmp_path):
    import scipy.io

    scipy.io.savemat(tmp_path / "run.mat", {"t": np.arange(20.0), "x": np.arange(19.0), "m": np.ones((5, 5))})
    with pytest.raises(RecordError) as refused:
        read_record(tmp_path / "run.mat", time="t", columns={"x": "x", "m": "m", "y": "y"})
    assert len(refused.value.faults) == 3
    assert "'t' 20, 'x' 19" in str(refused.value)
    assert "'m' has the shape (5, 5)" in str(refused.value)
    assert "no variable 'y'" in str(refused.value)


def test_temperature_has_an_offset():
    np.testing.assert_allclose(to_si(np.array([20.0]), "degC", "K"), 293.15)


def test_names_of_units_that_are_words_stay_words():
    for name in (
        "angle_a",
        "sensor_left",
        "role",
        "segment",
        "speed_min",
        "gear_in",
        "axis_x",
        "run_t",
        "cable_L",
    ):
        assert read_column_name(name).unit is None, name
    assert read_column_name("time_min", "s").unit == "min"
    assert read_column_name("speed_min", "m/s").unit is None


@pytest.mark.parametrize(
    ("unit", "expected"), [("Hz", "rad/s"), ("percent", "rad"), ("rpm", "Hz"), ("N", "N*m"), ("kg", "N")]
)
def test_what_measures_something_else_is_refused(unit, expected):
    with pytest.raises(UnitError):
        to_si(np.ones(2), unit, expected)


def test_gram_or_gravity_must_be_said():
    with pytest.raises(UnitError, match="gram or gravity"):
        read_column_name("a [g]")
    assert read_column_name("a [g]", "m/s**2").unit == "g_0"
    assert read_column_name("a [g]", "kg").unit == "g"


def test_si_unit_is_derived_where_none_is_expected(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,T_Nm,flag\n" + "".join(f"{k},{k % 3},{k}\n" for k in range(12)))
    record = read_record(path, time="t", columns={"T": "T_Nm", "flag": "flag"})
    assert (record.signals["T"].unit, record.signals["flag"].unit) == ("N*m", "")
    assert any("flag: names no unit" in line for line in record.log)
    assert si_unit_of("kN/mm") == "N/m"


def test_unit_can_be_said_where_the_name_is_silent_or_wrong(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,phase_A\n" + "".join(f"{k},{k}\n" for k in range(12)))
    asked = {"time": "t", "columns": {"u": "phase_A"}, "units": {"u": "V"}}
    with pytest.raises(RecordError, match=r"'V' is asked for|cannot be converted to 'V'"):
        read_record(path, **asked)
    record = read_record(path, **asked, measured_units={"u": "mV"})
    assert record.signals["u"].values[-1] == pytest.approx(0.011, rel=1e-12)
    assert any("as the study says" in line for line in record.log)


def test_quoted_header_windows_text_and_latin_letters(tmp_path):
    path = tmp_path / "a.csv"
    text = '"Zeit [s]";"Kraft, links [kN]";"Winkel [°]"\r\n' + "".join(f"{k};{k},5;{k}\r\n" for k in range(12))
    path.write_bytes(text.encode("cp1252"))
    record = read_record(
        path,
        time="Zeit [s]",
        columns={"F": "Kraft, links [kN]", "w": "Winkel [°]"},
        units={"F": "N", "w": "rad"},
    )
    assert record.signals["F"].values[1] == 1500.0
    assert record.signals["w"].values[6] == pytest.approx(np.pi / 30, rel=1e-12)
    assert "not UTF-8: read as Windows-1252" in record.log


def test_trips_by_label_may_return(tmp_path):
    path = tmp_path / "trips.csv"
    rows = [(label, k) for label in ("up", "down", "up") for k in range(12)]
    path.write_text("trip,t,v_m_per_s\n" + "".join(f"{a},{k / 10},{k * k}\n" for a, k in rows))
    records = read_records([path], time="t", columns={"v": "v_m_per_s"}, rules=ReadRules(trip="trip"))
    assert [each.name for each in records] == ["trips[up]", "trips[down]", "trips[up, 2]"]
    assert all(len(each.time) == 12 for each in records)


def test_parquet_dates_and_flags_become_numbers(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = np.datetime64("2024-03-01T10:00:00", "ms") + np.arange(20) * np.timedelta64(20, "ms")
    on = np.arange(20) % 2 == 0
    pq.write_table(pa.table({"when": stamps, "on": on}), tmp_path / "a.parquet")
    record = read_record(tmp_path / "a.parquet", time="when", columns={"on": "on"})
    np.testing.assert_allclose(record.time, np.arange(20) * 0.02, atol=1e-12)
    np.testing.assert_array_equal(record.signals["on"].values, on.astype(float))
    assert "when: dates, read as seconds since the first" in record.log


def test_a_record_cannot_be_changed(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,x_m\n" + "".join(f"{k},{k}\n" for k in range(12)))
    record = read_record(path, time="t", columns={"x": "x_m"})
    with pytest.raises(ValueError, match="read-only"):
        record.signals["x"].values[0] = 1.0
    with pytest.raises(TypeError):
        record.signals["y"] = record.signals["x"]
    assert list(record.frame().columns) == ["x [m]"]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("where", ["at the end", "between"])
def test_lines_without_anything_are_no_rows_and_count_as_lines(tmp_path, end: str, where: str) -> None:
    lines = ["t_s,a_m", *(f"{0.1 * k:.1f},{k}" for k in range(20))]
    lines[10:10] = [""] if where == "between" else []
    path = tmp_path / "a.csv"
    path.write_bytes(end.join([*lines, "", ""]).encode())
    record = read_record(path, time="t_s", columns={"a": "a_m"})
    np.testing.assert_array_equal(record.signals["a"].values, np.arange(20.0))
    lines[15] = "1.3,none"
    path.write_bytes(end.join([*lines, "", ""]).encode())
    with pytest.raises(RecordError, match="line 16"):
        read_record(path, time="t_s", columns={"a": "a_m"})
