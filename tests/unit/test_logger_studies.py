"""Ten files as loggers write them, each made by its format's own library, through ``vtsdt check`` and ``compare``."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vtsdt.cli import main

MODEL = """
from multibody import Model
from multibody.library import ForceSource, Mass, SpringDamper


def build():
    model = Model("shaker")
    mass = model.add("mass", Mass(m=3.0))
    spring = model.add("spring", SpringDamper(stiffness=800.0, damping=6.0))
    push = model.add("push", ForceSource())
    model.connect(mass.flange, spring.b, push.flange)
    model.connect(spring.a, model.ground)
    model.input("push.force", push.force)
    return model
"""

STUDY = """
[model]
build = "model.py:build"
[uncertain]
"spring.damping" = {{ std = 1.0, min = 0.0 }}
[inputs]
"push.force" = {{ {force} }}
[outputs]
"mass.position" = {{ {travel} }}
[records]
{time}
identify = ["{first}"]
validate = ["{second}"]
"""

STEP, NOISE = 0.01, 1e-5
TIME = np.arange(800) * STEP
BEGAN = np.datetime64("2024-03-01T10:00:00", "us")


def shaken(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Force in kN and travel in mm of 3 kg on 800 N/m with 6 N*s/m, by the exact steps of the linear equation."""
    from scipy.linalg import expm

    force = 20.0 * np.sin(2.0 * TIME + 0.15 * TIME**2 + seed)
    generator = np.zeros((4, 4))  # position, speed, force and its constant rate between two samples
    generator[0, 1], generator[1, :3], generator[2, 3] = 1.0, (-800.0 / 3.0, -2.0, 1.0 / 3.0), 1.0
    step, state, travel = expm(generator * STEP), np.zeros(4), np.zeros(TIME.size)
    for k in range(TIME.size - 1):
        state = step @ [state[0], state[1], force[k], (force[k + 1] - force[k]) / STEP]
        travel[k + 1] = state[0]
    return 1e-3 * force, 1e3 * (travel + NOISE * np.random.default_rng(seed).standard_normal(TIME.size))


#: what a study says of one format: time, force and travel
Said = dict[str, str]
NAMED = {"time": 'time = "time"', "force": 'column = "force", unit = "kN"', "travel": 'column = "travel", unit = "mm"'}
UNITS_IN_FILE = {"time": "", "force": 'column = "force"', "travel": 'column = "travel"'}


def mdf(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(force, TIME, unit="kN", name="force")])
        file.append([asammdf.Signal(travel, TIME, unit="mm", name="travel")])
        file.save(path)
    return UNITS_IN_FILE


def tdms(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    nptdms = pytest.importorskip("nptdms")
    waveform = {"wf_increment": STEP, "wf_start_offset": 0.0, "wf_start_time": BEGAN, "wf_samples": TIME.size}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("rig", "force", force, properties={"unit_string": "kN", **waveform}),
                nptdms.ChannelObject("rig", "travel", travel, properties={"unit_string": "mm", **waveform}),
            ]
        )
    return UNITS_IN_FILE


def hdf5(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["rig/time"], file["rig/force"], file["rig/travel"] = TIME, force, travel
        file["rig/force"].attrs["unit"], file["rig/travel"].attrs["unit"] = "kN", "mm"
    return {"time": 'time = "rig/time"', "force": 'column = "rig/force"', "travel": 'column = "rig/travel"'}


def excel(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["Rig 3"], ["Operator", "N. N."], [], ["time", "force", "travel"], ["s", "kN", "mm"]):
        book.active.append(row)
    for row in zip(TIME.tolist(), force.tolist(), travel.tolist(), strict=True):
        book.active.append(row)
    book.save(path)
    return {**UNITS_IN_FILE, "time": 'time = "time"'}


def uff58(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(path))
    for name, values, unit in (("force", force, "kN"), ("travel", travel, "mm")):
        data = pyuff.prepare_58(
            binary=1,
            func_type=1,
            rsp_node=1,
            rsp_dir=3,
            ref_dir=3,
            ref_node=1,
            data=values,
            x=TIME,
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
        data.update(abscissa_inc=STEP, abscissa_min=0.0)
        file.write_sets(data, mode="add")
    return UNITS_IN_FILE


def matlab_table(path: Path, force: np.ndarray, travel: np.ndarray, version: str = "v7") -> Said:
    matio = pytest.importorskip("matio")
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"time": TIME, "force_kN": force, "travel_mm": travel})
    matio.save_to_mat(str(path), {"rig": table}, version=version)
    return {"time": 'time = "rig.time"', "force": 'column = "rig.force_kN"', "travel": 'column = "rig.travel_mm"'}


def matlab_7_3(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    return matlab_table(path, force, travel, "v7.3")


def mcap(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    """A topic for each channel, JSON messages with the time of each in ns since 1970."""
    writing = pytest.importorskip("mcap.writer")
    with path.open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        schema = writer.register_schema(name="rig", encoding="jsonschema", data=b'{"type": "object"}')
        for name, values in (("/force", force), ("/travel", travel)):
            topic = writer.register_channel(topic=name, message_encoding="json", schema_id=schema)
            for t, value in zip(TIME, values, strict=True):
                when = 1709287200_000000000 + round(t * 1e9)
                data = json.dumps({"value": float(value)}).encode()
                writer.add_message(channel_id=topic, log_time=when, publish_time=when, data=data)
        writer.finish()
    return {
        "time": "",
        "force": 'column = "/force.value", unit = "kN"',
        "travel": 'column = "/travel.value", unit = "mm"',
    }


def csv(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    """A preamble, a row of units, dates, decimal commas."""
    rows = ["Rig 3;;", "Operator: N. N.;;", "", "time;force;travel", ";kN;mm"]
    began = datetime.datetime(2024, 3, 1, 10)
    for t, f, x in zip(TIME, force, travel, strict=True):
        stamp = began + datetime.timedelta(seconds=float(t))
        rows.append(f"{stamp:%d.%m.%Y %H:%M:%S.%f};{f:.12g};{x:.12g}".replace(".", ",").replace(",03,2024", ".03.2024"))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return {**UNITS_IN_FILE, "time": 'time = "time"\ntime_format = "%d.%m.%Y %H:%M:%S,%f"'}


def parquet(path: Path, force: np.ndarray, travel: np.ndarray) -> Said:
    pyarrow = pytest.importorskip("pyarrow")
    written = pytest.importorskip("pyarrow.parquet")
    written.write_table(pyarrow.table({"time": TIME, "force": force, "travel": travel}), path)
    return NAMED


WRITERS: dict[str, Callable[[Path, np.ndarray, np.ndarray], Said]] = {
    "mf4": mdf,
    "tdms": tdms,
    "h5": hdf5,
    "xlsx": excel,
    "uff": uff58,
    "mat": matlab_table,
    "v73.mat": matlab_7_3,
    "mcap": mcap,
    "csv": csv,
    "parquet": parquet,
}


@pytest.mark.parametrize("ending", WRITERS)
def test_a_study_on_a_loggers_files_is_checked_and_compared(ending, tmp_path, capsys):
    (tmp_path / "model.py").write_text(MODEL)
    for k, name in enumerate((f"monday.{ending}", f"tuesday.{ending}")):
        said = WRITERS[ending](tmp_path / name, *shaken(k))
    study = tmp_path / "study.toml"
    study.write_text(STUDY.format(first=f"monday.{ending}", second=f"tuesday.{ending}", **said))
    assert main(["check", str(study), "--out", str(tmp_path / "check")]) == 0, capsys.readouterr().err
    told = capsys.readouterr().out
    assert "'mass.position' follows the model: correlation 1.000" in told
    assert main(["compare", str(study), "--out", str(tmp_path / "out")]) == 0, capsys.readouterr().err
    stages = json.loads((tmp_path / "out/comparison.json").read_text())["stages"]
    # what is left is the noise of 800 samples: its size is known to 1/sqrt(2*800), four times of which is 10 %
    for part in ("identify", "validate"):
        assert stages[0][part]["mass.position"]["rmse"] == pytest.approx(NOISE, rel=0.1)
