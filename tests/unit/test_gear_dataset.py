"""Labelled data sets: what a plan holds, files and labels, going on after an interruption, plans that make no sense."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas
import pytest

from gearbox.files.errors import GearError
from gearbox.rig import dataset
from gearbox.rig.dataset import DatasetPlan, write_dataset
from gearbox.rig.rig import GearRig
from gearbox.stage.faults import FAULTS, combined, damageable, fault
from gearbox.stage.stage import GearStage

SMALL = DatasetPlan(
    labels=("healthy", "unbalance@output_shaft"),
    severities=(0.5,),
    speeds=(1000.0, 1006.0),
    repeats=2,
    duration=0.02,
    rate=2000.0,
)


class _Run:
    """Stands in for a simulation."""

    times = np.arange(40) / 2000.0

    def __getitem__(self, name: str) -> np.ndarray:
        return np.zeros(40)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, float]]:
    asked: list[dict[str, float]] = []

    def simulate(self: GearStage, speed: float, torque: float, duration: float, **options: object) -> _Run:
        asked.append(dict(options["parameters"]))  # type: ignore[call-overload]
        return _Run()

    monkeypatch.setattr(GearStage, "simulate", simulate)
    return asked


def test_a_plan_holds_every_combination() -> None:
    samples = list(SMALL.samples())
    assert len(samples) == 2 * 2 * 2
    assert len({s.name for s in samples}) == len(samples)
    assert samples == list(SMALL.samples())
    default = DatasetPlan()
    assert {s.label for s in default.samples()} == {"healthy", *FAULTS}


def test_files_and_labels_belong_together(tmp_path: Path, quick: list[dict[str, float]]) -> None:
    labels = write_dataset(tmp_path / "data", SMALL)
    assert (tmp_path / "data" / "README.txt").read_text(encoding="utf-8").startswith("Synthetic")
    read = pandas.read_csv(tmp_path / "data" / "labels.csv")
    assert list(read["file"]) == list(labels["file"])
    for _, row in read.iterrows():
        frame = pandas.read_parquet(tmp_path / "data" / str(row["file"]))
        assert len(frame) == 40
        assert "a_base_y [m/s**2]" in frame
    assert quick[0] == {}
    assert quick[-1]["output_shaft.unbalance"] == pytest.approx(0.5 * FAULTS["unbalance"].size)


def test_an_interrupted_data_set_goes_on(tmp_path: Path, quick: list[dict[str, float]]) -> None:
    def stop(text: str) -> None:
        if "3 of" in text:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_dataset(tmp_path / "data", SMALL, progress=stop)
    first = {p.name: p.read_bytes() for p in (tmp_path / "data" / "signals").iterdir()}
    assert len(first) == 3
    write_dataset(tmp_path / "data", SMALL)
    assert len(quick) == 8  # none made twice
    after = {p.name: p.read_bytes() for p in (tmp_path / "data" / "signals").iterdir()}
    assert len(after) == 8
    assert all(after[name] == content for name, content in first.items())


def test_another_plan_and_a_foreign_folder_are_refused(tmp_path: Path, quick: list[dict[str, float]]) -> None:
    write_dataset(tmp_path / "data", SMALL)
    with pytest.raises(GearError, match="another plan"):
        write_dataset(tmp_path / "data", DatasetPlan(labels=("healthy",)))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("precious", encoding="utf-8")
    with pytest.raises(GearError, match="not empty"):
        write_dataset(tmp_path / "mine", SMALL)


def test_csv_files_can_be_read_as_records(
    tmp_path: Path, quick: list[dict[str, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = DatasetPlan(labels=("healthy",), duration=0.02, rate=2000.0, format="csv.gz")
    labels = write_dataset(tmp_path / "data", plan)
    frame = pandas.read_csv(tmp_path / "data" / str(labels["file"][0]))
    assert frame["time [s]"].iloc[1] == pytest.approx(1 / 2000.0)
    assert frame["a_base_x [m/s**2]"].std() == pytest.approx(plan.noise, rel=0.5)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"labels": ("eccentricty",)}, "did you mean 'eccentricity'"),
        ({"labels": ("wear@input_gear",)}, "cannot be at 'input_gear'"),
        ({"severities": (0.0,)}, "above zero"),
        ({"labels": ("tooth_crack",), "severities": (2.0,)}, "less than nothing"),
        ({"speeds": ()}, "speeds is empty"),
        ({"format": "hdf"}, "take 'parquet'"),
        ({"rate": -1.0, "repeats": 0}, "repeats is 0"),
        ({"manufacturing": 1.0}, "give its seed as rig"),
        ({"rig": -1, "housing": "soft"}, "housing is 'soft'"),
    ],
)
def test_plans_that_make_no_sense_are_refused(changes: dict[str, object], told: str) -> None:
    with pytest.raises(GearError, match=told):
        DatasetPlan(**changes)  # type: ignore[arg-type]


def test_faults_can_be_combined_unless_they_clash() -> None:
    stage = damageable(GearStage.paper(housing="clamped"))
    values = combined([fault("eccentricity", "input_gear", 0.1), fault("wear")])
    assert values["mesh.eccentricity_1"] == pytest.approx(5e-6)
    assert values["mesh.wear"] == pytest.approx(20e-6)
    assert set(values) < {f"{n}.{k}" for n, c in stage.components.items() for k in c.values}
    with pytest.raises(GearError, match="at once"):
        combined([fault("spall", "input_gear", tooth=1), fault("tooth_crack", "input_gear", tooth=2)])
    assert dataset.paper_stage().structure.imperfect


def test_a_rig_has_its_own_contact_and_errors_and_a_fault_comes_on_top(
    tmp_path: Path, quick: list[dict[str, float]]
) -> None:
    plan = dataclasses.replace(
        SMALL, labels=("healthy", "misalignment"), repeats=1, rig=3, manufacturing=1.0, housing="clamped",
        parameters={"e_F": 2.1},
    )  # fmt: skip
    write_dataset(tmp_path / "data", plan)
    sound, damaged = quick[0], quick[-1]
    true = GearRig(seed=3).true_values()
    assert sound["mesh.K"] == pytest.approx(true["K"])
    assert sound["mesh.e"] == 2.1  # given, in the place of the rig's
    assert sound["mesh.misalignment"] > 0.0
    added = 0.5 * FAULTS["misalignment"].size
    assert damaged["mesh.misalignment"] == pytest.approx(sound["mesh.misalignment"] + added)
    assert {n for n in sound if sound[n] != damaged[n]} == {"mesh.misalignment"}
    again = json.loads((tmp_path / "data" / "plan.json").read_text(encoding="utf-8"))
    assert (again["rig"], again["manufacturing"], again["parameters"]) == (3, 1.0, {"e_F": 2.1})


def test_recordings_are_those_of_the_damaged_stage(tmp_path: Path) -> None:
    """Nothing stands in for the simulation here: an eccentric gear shakes the housing at other places of the turn."""
    plan = DatasetPlan(
        labels=("healthy", "eccentricity@input_gear"), severities=(1.0,), noise=0.0, duration=0.06, rate=6400.0
    )
    labels = write_dataset(tmp_path / "data", plan)
    sound, damaged = (pandas.read_parquet(tmp_path / "data" / name) for name in labels["file"])
    cycle = 6400.0 / (1000.0 / 60.0 * 32)  # 12 samples of one tooth
    assert cycle == 12.0

    def changes(frame: pandas.DataFrame) -> float:
        seen = frame["a_base_y [m/s**2]"].to_numpy()
        return float(np.std(seen[12:] - seen[:-12]) / np.std(seen))

    assert changes(sound) < 2e-2  # it repeats with the mesh, but for what is left of the start
    assert changes(damaged) > 2 * changes(sound)


@pytest.mark.slow
def test_every_fault_runs_at_full_severity_over_speeds_and_loads(tmp_path: Path) -> None:
    plan = DatasetPlan(severities=(1.0,), speeds=(600.0, 1000.0), torques=(50.0, 150.0), duration=0.1)
    labels = write_dataset(tmp_path / "data", plan)
    assert len(labels) == 4 * (1 + len(FAULTS))
    for name in labels["file"]:
        assert np.isfinite(pandas.read_parquet(tmp_path / "data" / name).to_numpy()).all()


def test_the_command_writes_labelled_recordings(tmp_path: Path, quick: list[dict[str, float]], capsys) -> None:
    from gearbox.rig.command import main

    words = ["--severities", "0.5", "1", "--speeds", "1000", "1006", "--loads", "50", "--repeats", "2"]
    assert main(["--faults", "wear", "eccentricity", *words, "--out", str(tmp_path / "data"), "--quiet"]) == 0
    read = pandas.read_csv(tmp_path / "data" / "labels.csv")
    assert read["label"].value_counts().to_dict() == {"wear": 8, "eccentricity": 8, "healthy": 4}
    assert set(read["speed_rpm"]) == {1000.0, 1006.0}
    assert len(quick) == len(read)


def test_labelled_recordings_go_with_no_other_choice_of_what_is_hidden(tmp_path: Path) -> None:
    from discrepancy.rigs.recording import BenchError
    from gearbox.rig.command import main

    with pytest.raises(BenchError, match="leave out --hide"):
        main(["--faults", "wear", "--hide", "tooth_crack", "--out", str(tmp_path / "data")])
    with pytest.raises(GearError, match="there is no such kind"):
        main(["--faults", "waer", "--out", str(tmp_path / "data")])
