"""Files as loggers write them: each format, written by the format's own library, gives the numbers that went in."""

from __future__ import annotations

import json

import numpy as np
import pytest

from estimation import ReadRules, RecordError, read_record
from estimation.files.optional_library import library

#: A fast channel at 100 Hz and a slow one at 10 Hz, which begins 3 ms later.
FAST = np.arange(200) * 0.01
SLOW = 0.003 + np.arange(20) * 0.1
FORCE = np.sin(7.0 * FAST)
TEMPERATURE = 20.0 + 3.0 * SLOW**2
ASKED = {"columns": {"F": "force", "T": "temperature"}, "units": {"F": "N", "T": "K"}}


def check(record, rtol=1e-12):
    """The fast channel on its grid, the slow one at its own instants, nothing thrown away, units as stated."""
    np.testing.assert_allclose(np.diff(record.time), 0.01, rtol=1e-6)
    force, temperature = record.signals["F"], record.signals["T"]
    first = round((0.003 - 0.0) / 0.01 + 0.5)  # the grid begins where both were measured
    np.testing.assert_allclose(force.values, 1e3 * FORCE[first : first + len(force.values)], rtol=rtol, atol=1e-9)
    np.testing.assert_allclose(temperature.own.values, TEMPERATURE + 273.15, rtol=rtol)
    np.testing.assert_allclose(np.diff(temperature.own.time), 0.1, rtol=1e-6)
    # the two clocks agree: the slow channel's first sample is 3 ms after the fast one's first
    np.testing.assert_allclose(record.time[0] - temperature.own.time[0], 0.007, atol=1e-7)
    assert any("compared at its own instants" in line for line in record.log)


def test_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(FORCE, FAST, unit="kN", name="force")])
        file.append([asammdf.Signal(TEMPERATURE, SLOW, unit="°C", name="temperature")])
        file.save(tmp_path / "run.mf4")
    record = read_record(tmp_path / "run.mf4", **ASKED)
    check(record)
    assert record.origin is not None
    with pytest.raises(RecordError, match="no channel 'forc'; nearest: 'force'"):
        read_record(tmp_path / "run.mf4", columns={"F": "forc"})


def test_tdms_waveforms(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    began = np.datetime64("2024-03-01T10:00:00", "us")
    channels = [
        nptdms.ChannelObject(
            "rig",
            name,
            values,
            properties={
                "unit_string": unit,
                "wf_increment": step,
                "wf_start_offset": offset,
                "wf_start_time": began,
                "wf_samples": len(values),
            },
        )
        for name, values, unit, step, offset in (
            ("force", FORCE, "kN", 0.01, 0.0),
            ("temperature", TEMPERATURE, "degC", 0.1, 0.003),
        )
    ]
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment(channels)
    record = read_record(tmp_path / "run.tdms", **ASKED)
    check(record)
    assert record.origin == 1709287200_000000000


def test_tdms_with_a_time_channel(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    stamps = np.datetime64("2024-03-01T10:00:00", "us") + np.arange(200) * np.timedelta64(10_000, "us")
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("rig", "when", stamps), nptdms.ChannelObject("rig", "force", FORCE)])
    record = read_record(tmp_path / "run.tdms", time="when", columns={"F": "force"})
    np.testing.assert_allclose(record.time, FAST, atol=1e-9)
    np.testing.assert_array_equal(record.signals["F"].values, FORCE)
    with pytest.raises(RecordError, match="no waveform properties"):
        read_record(tmp_path / "run.tdms", columns={"F": "force"})


def test_hdf5_with_a_time_in_each_group(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["motor/time"], file["motor/force"] = FAST, FORCE
        file["motor/force"].attrs["unit"] = "kN"
        file["oil/time"], file["oil/temperature"] = SLOW, TEMPERATURE
        file["oil/temperature"].attrs["units"] = b"degC"
        file["motor/both"] = np.column_stack([FORCE, -FORCE])
    asked = {**ASKED, "columns": {"F": "motor/force", "T": "oil/temperature"}}
    check(read_record(tmp_path / "run.h5", time="time", **asked))
    record = read_record(tmp_path / "run.h5", time="motor/time", columns={"b": "motor/both[1]"})
    np.testing.assert_array_equal(record.signals["b"].values, -FORCE)
    with pytest.raises(RecordError, match="different numbers of samples"):
        read_record(tmp_path / "run.h5", time="motor/time", **asked)


def test_excel_with_preamble_and_units(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    for row in (["Rig 3"], ["Operator", "N. N."], [], ["time", "force"], ["s", "kN"]):
        sheet.append(row)
    for t, f in zip(FAST, FORCE, strict=True):
        sheet.append([float(t), float(f)])
    book.save(tmp_path / "run.xlsx")
    record = read_record(tmp_path / "run.xlsx", time="time", columns={"F": "force"}, units={"F": "N"})
    np.testing.assert_allclose(record.time, FAST, rtol=1e-12)
    np.testing.assert_allclose(record.signals["F"].values, 1e3 * FORCE, rtol=1e-12)


def test_excel_dates(tmp_path):
    import datetime

    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["when", "force [N]"])
    for k in range(30):
        book.active.append([datetime.datetime(2024, 3, 1, 10) + datetime.timedelta(seconds=2 * k), k * 0.5])
    book.save(tmp_path / "run.xlsx")
    record = read_record(tmp_path / "run.xlsx", time="when", columns={"F": "force [N]"}, units={"F": "N"})
    np.testing.assert_allclose(record.time, 2.0 * np.arange(30), atol=1e-6)
    assert record.origin == 1709287200_000000000


def test_universal_file(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "run.uff"))
    for name, values, step, first, unit in (
        ("force", FORCE, 0.01, 0.0, "kN"),
        ("temperature", TEMPERATURE, 0.1, 0.003, "degC"),
    ):
        data = pyuff.prepare_58(
            binary=0,
            func_type=1,
            rsp_node=1,
            rsp_dir=3,
            ref_dir=3,
            ref_node=1,
            data=values,
            x=first + step * np.arange(len(values)),
            id1=name,
            rsp_ent_name=name,
            ref_ent_name="none",
            abscissa_spacing=1,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=13,
            orddenom_spec_data_type=13,
            ordinate_axis_units_lab=unit,
            return_full_dict=False,
        )
        data.update(abscissa_inc=step, abscissa_min=first)
        file.write_sets(data, mode="add")
    check(read_record(tmp_path / "run.uff", **ASKED), rtol=1e-5)  # the format writes six significant digits


def test_matlab_7_3_and_tables(tmp_path):
    matio = pytest.importorskip("matio")
    pd = pytest.importorskip("pandas")
    table = pd.DataFrame({"time": FAST, "force": FORCE})
    for version in ("v7", "v7.3"):
        path = tmp_path / f"run_{version}.mat"
        matio.save_to_mat(str(path), {"rig": table, "plain": -FORCE[:, None]}, version=version)
        record = read_record(path, time="rig.time", columns={"F": "rig.force", "p": "plain"})
        np.testing.assert_allclose(record.time, FAST, rtol=1e-12)
        np.testing.assert_array_equal(record.signals["F"].values, FORCE)
        np.testing.assert_array_equal(record.signals["p"].values, -FORCE)


def test_matlab_structures_with_times_of_their_own(tmp_path):
    import scipy.io

    groups = {"motor": {"t": FAST, "force_kN": FORCE}, "oil": {"t": SLOW, "temperature_degC": TEMPERATURE}}
    scipy.io.savemat(tmp_path / "run.mat", groups)
    asked = {**ASKED, "columns": {"F": "motor.force_kN", "T": "oil.temperature_degC"}}
    check(read_record(tmp_path / "run.mat", time="t", **asked))


def test_mcap_of_json(tmp_path):
    writer_module = pytest.importorskip("mcap.writer")
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = writer_module.Writer(stream)
        writer.start()
        schema = writer.register_schema(name="rig", encoding="jsonschema", data=b'{"type": "object"}')
        topics = {n: writer.register_channel(topic=n, message_encoding="json", schema_id=schema) for n in ("/a", "/b")}
        for topic, times, values in (("/a", FAST, FORCE), ("/b", SLOW, TEMPERATURE)):
            for t, v in zip(times, values, strict=True):
                when = 1709287200_000000000 + round(t * 1e9)
                data = json.dumps({"state": {"value": float(v)}, "name": "x"}).encode()
                writer.add_message(channel_id=topics[topic], log_time=when, publish_time=when, data=data)
        writer.finish()
    asked = {"columns": {"F": "/a.state.value", "T": "/b.state.value"}, "units": {"F": "N", "T": "K"}}
    record = read_record(tmp_path / "run.mcap", **asked, measured_units={"F": "kN", "T": "degC"})
    check(record)


def test_mcap_and_bag_of_ros_messages(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    assert highlevel is not None
    times = [1709287200_000000000 + round(t * 1e9) for t in FAST]
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["std_msgs/msg/Float64MultiArray"]
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer2(tmp_path / "two", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/motor", kind.__msgtype__, typestore=store)
        for t, f in zip(times, FORCE, strict=True):
            message = kind(layout=layout, data=np.array([f, 2.0 * f]))
            bag.write(connection, t, store.serialize_cdr(message, kind.__msgtype__))
    path = next((tmp_path / "two").glob("*.mcap"))
    record = read_record(path, columns={"F": "/motor.data[1]"})
    np.testing.assert_allclose(record.time, FAST, atol=1e-9)
    np.testing.assert_array_equal(record.signals["F"].values, 2.0 * FORCE)
    old = get_typestore(Stores.ROS1_NOETIC)
    kind = old.types["sensor_msgs/msg/JointState"]
    header, stamp = old.types["std_msgs/msg/Header"], old.types["builtin_interfaces/msg/Time"]
    with Writer1(tmp_path / "run.bag") as bag:
        connection = bag.add_connection("/joints", kind.__msgtype__, typestore=old)
        for t, f in zip(times, FORCE, strict=True):
            message = kind(
                header=header(seq=0, stamp=stamp(sec=t // 10**9, nanosec=t % 10**9), frame_id=""),
                name=["one"],
                position=np.array([f]),
                velocity=np.array([]),
                effort=np.array([]),
            )
            # logged late and unevenly: the stamp in the header is what counts
            bag.write(connection, t + 1000 + (t // 1000) % 5000000, old.serialize_ros1(message, kind.__msgtype__))
    record = read_record(tmp_path / "run.bag", columns={"q": "/joints.position[0]"})
    np.testing.assert_allclose(record.time, FAST, atol=1e-9)
    np.testing.assert_array_equal(record.signals["q"].values, FORCE)


def test_a_library_that_is_not_installed_is_named_with_its_extra(tmp_path):
    with pytest.raises(RecordError, match=r"run\.mf4: is an MDF file, which needs the library .*vtsdt\[mdf\]"):
        library("no_such_library_of_ours", tmp_path / "run.mf4", "an MDF file", "mdf")


def lines(header: list[str], times: list[str]) -> str:
    body = [f"{t},{k * 0.5}" for k, t in enumerate(times)]
    return "\n".join([*header, *body]) + "\n"


EVEN = [f"{k * 0.1:.1f}" for k in range(20)]


@pytest.mark.parametrize(
    "header",
    [
        ["Rig 3", "Operator: N. N.", "", "time,force", "s,kN"],
        ["time,force [kN]"],
        ["Logger;v2;;;", "Start;10:00", "time,force", "[s],[kN]"],
        ["Project,Rig 3", "Serial,17", "time,force (kN)"],
    ],
)
def test_csv_preamble_and_row_of_units(tmp_path, header):
    (tmp_path / "a.csv").write_text(lines(header, EVEN))
    column = "force" if header[-1] in ("s,kN", "[s],[kN]") else header[-1].split(",")[1]
    record = read_record(tmp_path / "a.csv", time="time", columns={"F": column}, units={"F": "N"})
    np.testing.assert_allclose(record.signals["F"].values, 500.0 * np.arange(20), rtol=1e-12)
    np.testing.assert_allclose(record.time, np.arange(20) * 0.1, rtol=1e-12)


def test_csv_skip_rows(tmp_path):
    (tmp_path / "a.csv").write_text(lines(["Gain,Offset", "3,4", "5,6", "7,8", "9,10", "11,12", "time,F_N"], EVEN))
    with pytest.raises(RecordError, match="no column 'time'"):
        read_record(tmp_path / "a.csv", time="time", columns={"F": "F_N"})
    rules = ReadRules(skip_rows=6)
    assert len(read_record(tmp_path / "a.csv", time="time", columns={"F": "F_N"}, rules=rules).time) == 20


@pytest.mark.parametrize(
    ("write", "origin"),
    [
        (lambda k: f"2024-03-01T10:00:{k // 10:02d}.{k % 10}00Z", 1709287200),
        (lambda k: f"2024-03-01 11:00:{k // 10:02d}.{k % 10}+01:00", 1709287200),
        (lambda k: f"01.03.2024 10:00:{k // 10:02d}.{k % 10}", 1709287200),
        (lambda k: f"2024/03/01 10:00:{k // 10:02d}.{k % 10}", 1709287200),
        (lambda k: f"3/21/2024 10:00:{k // 10:02d}.{k % 10}", 1711015200),
        (lambda k: f"23:59:{58 + k // 10:02d}.{k % 10}" if k < 20 else f"00:00:00.{k % 10}", None),
        (lambda k: f"{1709287200 + k // 10}.{k % 10}", 1709287200),
    ],
)
def test_csv_calendar_time(tmp_path, write, origin):
    (tmp_path / "a.csv").write_text(lines(["when,F_N"], [write(k) for k in range(25)]))
    record = read_record(tmp_path / "a.csv", time="when", columns={"F": "F_N"})
    np.testing.assert_allclose(record.time, np.arange(25) * 0.1, atol=3e-7)  # doubles near 1.7e9 s are 2.4e-7 s apart
    assert record.origin == (None if origin is None else origin * 10**9)
    assert any("begin at 0" in line or "since the first" in line for line in record.log)


def test_csv_epoch_in_milliseconds(tmp_path):
    (tmp_path / "a.csv").write_text(lines(["t_ms,F_N"], [str(1709287200000 + 10 * k) for k in range(20)]))
    record = read_record(tmp_path / "a.csv", time="t_ms", columns={"F": "F_N"})
    np.testing.assert_allclose(record.time, np.arange(20) * 0.01, atol=1e-12)  # whole milliseconds are exact


def test_csv_time_zone_and_ambiguous_dates(tmp_path):
    (tmp_path / "a.csv").write_text(lines(["when,F_N"], [f"2024-03-01T11:00:{k:02d}" for k in range(20)]))
    rules = ReadRules(time_zone="Europe/Berlin")
    assert read_record(tmp_path / "a.csv", time="when", columns={"F": "F_N"}, rules=rules).origin == 1709287200 * 10**9
    with pytest.raises(RecordError, match="time zone 'Europe/Atlantis'"):
        read_record(tmp_path / "a.csv", time="when", columns={"F": "F_N"}, rules=ReadRules(time_zone="Europe/Atlantis"))
    (tmp_path / "b.csv").write_text(lines(["when,F_N"], [f"03/04/2024 10:00:{k:02d}" for k in range(20)]))
    with pytest.raises(RecordError, match="day/month or month/day"):
        read_record(tmp_path / "b.csv", time="when", columns={"F": "F_N"})
    rules = ReadRules(time_format="%d/%m/%Y %H:%M:%S")
    record = read_record(tmp_path / "b.csv", time="when", columns={"F": "F_N"}, rules=rules)
    assert record.origin == 1712138400 * 10**9
