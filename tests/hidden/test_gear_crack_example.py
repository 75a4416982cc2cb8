"""The example that follows a growing tooth crack: what it averages, what it measures, which tooth it names."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

PATH = Path(__file__).resolve().parents[2] / "examples" / "gear_crack.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("gear_crack", PATH)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def test_an_average_over_turns_keeps_what_belongs_to_one_gear(example):
    visit = example.visits(24, 0)[3]
    turns = visit.angle / (2.0 * np.pi) + visit.speed / 60.0 * np.arange(5000) / example.RATE
    of_gear_1 = np.tile(np.sin(2.0 * np.pi * 5.0 * turns), len(example.CHANNELS))
    kept = {gear: example.averaged_over_turns(of_gear_1, visit, gear) for gear in example.TEETH}
    # Bins of a 352nd of a turn take (5 π / 352)² / 6 of a wave of five periods; a fraction of a turn is left over.
    assert np.std(kept["1"]) == pytest.approx(np.sqrt(0.5), rel=0.02)
    # Over six turns of gear 2, in each of which there are 6.875 of the periods: Dirichlet's kernel at an eighth.
    assert np.std(kept["2"]) < np.sqrt(0.5) / (6.0 * np.sin(np.pi / 8.0))


@pytest.mark.slow
def test_the_tooth_and_its_size_are_found(example, monkeypatch):
    from gearbox import GearStage

    stage, visit = GearStage.paper(imperfect=True), example.visits(24, 0)[19]
    monkeypatch.setattr(example, "TEETH", {"1": 10, "2": 10})
    measured = example.recorded(stage, visit)
    known = {n: v for n, v in visit.truth.items() if n in example.FITTED}
    (best, gear, tooth, _), second, *_ = example.damaged_tooth(stage, [(visit, measured)], known)
    assert (gear, tooth) == ("1", example.TOOTH)
    assert best > 5.0 * second[0]
    found = example.judged(stage, visit, measured, {**known, "mesh.damaged_1": float(tooth)}, gear)
    # Three waves of the gears that the model lacks: 0.035 at most in a year of visits.
    assert abs(found.quantities["mesh.crack_1"].value - visit.crack) < 0.04
