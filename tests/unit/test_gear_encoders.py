"""The gear rig with encoders: recordings, a study that reads them, a model that starts as they do."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from discrepancy.problem.study_file import read_study
from gearbox.rig import encoders as rig_encoders
from gearbox.rig.encoders import build, make_encoders
from gearbox.rig.rig import GearRig


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One short recording and one held out, with an eccentric gear."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rig_encoders, "DURATION", 0.05)
        out = tmp_path_factory.mktemp("encoders")
        make_encoders(out, ["eccentricity@output_gear"], rig=GearRig(seed=3))
    return out


def test_the_study_reads_the_recordings(folder) -> None:
    study = read_study(folder / "study.toml")
    records = study.read_records({"speed": "rad/s", "torque": "N*m", "transmission_error": "m", "drive_torque": "N*m"})
    assert [len(records.identify), len(records.validate)] == [2, 1]
    read = records.identify[0].signals
    assert np.mean(read["speed"].values) == pytest.approx(600.0 * np.pi / 30.0)
    # micrometres in the file, metres in the record: some tens of them under load
    assert 1e-5 < np.mean(read["transmission_error"].values) < 1e-4
    # the torque of the load through the ratio, and friction
    assert np.mean(read["drive_torque"].values) == pytest.approx(100.0 * 32 / 44, rel=0.03)


def test_the_study_does_not_give_the_truth_away(folder) -> None:
    assert "eccentricity@output" not in (folder / "study.toml").read_text()
    truth = json.loads((folder / "truth.json").read_text())
    assert [e["kind"] for e in truth["effects"]] == ["eccentricity"]
    assert "synthetic" in (folder / "README.md").read_text()


def test_the_model_starts_where_the_recordings_do(folder) -> None:
    """Without the eccentric gear, the rig's teeth and the model's pass the pitch point at the same times."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rig_encoders, "DURATION", 0.05)
        patch.setattr(rig_encoders, "CONDITIONS", rig_encoders.CONDITIONS[2:])
        sound = folder / "sound"
        make_encoders(sound, rig=GearRig(seed=3))
    seen = pd.read_csv(sound / "validate_1.csv.gz")["transmission_error [um]"].to_numpy()
    times = np.arange(seen.size) / rig_encoders.RATE
    model, true = build(), GearRig(seed=3).true_values()
    run = model.build(outputs=["transmission_error"]).simulate(
        (0.0, float(times[-1])),
        inputs={"speed": 600.0 * np.pi / 30.0, "torque": 120.0},
        times=times,
        parameters={"mesh.K": true["K"], "mesh.C_D": true["C_D"], "mesh.e": true["e_F"]},
        rtol=1e-6,
    )
    mine = 1e6 * np.asarray(run["transmission_error"])
    late = times > 0.02
    period = round(rig_encoders.RATE / (10.0 * 32))  # samples of one tooth: ten turns a second, 32 teeth
    first = np.flatnonzero(late)[0]
    lags = np.arange(-period // 2, period // 2 + 1)
    last = seen.size - period
    along = [np.corrcoef(seen[first - k : last - k], mine[first:last])[0, 1] for k in lags]
    assert lags[int(np.argmax(along))] == 0  # to a sample, a sixth of a tooth
