"""A missing law that the noise model can take for a random force: radiation of an oven, with and without its name."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def oven(tmp_path_factory):
    """The study of an oven that `vtsdt init` starts from one recording."""
    spec = importlib.util.spec_from_file_location("from_a_csv", ROOT / "examples" / "from_a_csv.py")
    example = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = example
    spec.loader.exec_module(example)
    return example, example.start(example.MACHINES[0], tmp_path_factory.mktemp("oven"))


def diagnosed(oven):
    example, study = oven
    example.run("diagnose", str(study), "--out", str(study.parent / "diagnosis"))
    return json.loads((study.parent / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))


def test_radiation_is_not_refused_because_the_loss_through_the_wall_resembles_it(oven):
    """Both are nearly proportional to the temperature; their difference is ten times the noise."""
    diagnosis = diagnosed(oven)
    assert [f"{e['kind']}@{e['where']}" for e in diagnosis["effects"]] == ["radiation_loss@body"]
    assert diagnosis["effects"][0]["parameters"]["radiation"]["value"] == pytest.approx(2.5e-9, rel=0.02)
    assert diagnosis["explained"] > 0.99


def test_a_force_slower_than_the_record_is_not_called_chance(oven):
    """Without radiation in the catalogue a drift of the surroundings explains the record, and predicts nothing."""
    example, study = oven
    text = study.read_text(encoding="utf-8")
    study.write_text(text + '\n[candidates]\ninclude = ["heat_loss@*", "sensor_lag@*"]\n', encoding="utf-8")
    diagnosis = diagnosed((example, study))
    assert diagnosis["effects"] == []
    assert diagnosis["verdict"] == "unknown effect"
    assert "more slowly than the records last" in diagnosis["sentence"]
