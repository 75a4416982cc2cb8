"""What the example of fault data does with features and labels; its sets take minutes and are not made here."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

PATH = Path(__file__).resolve().parents[2] / "examples" / "gear_faults.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("gear_faults", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_healthy_reference_of_each_load_is_taken_off_and_not_judged(example) -> None:
    rows = [
        {"label": label, "severity": severity, "speed_rpm": 1000.0, "torque_Nm": load, "input_seat_y size": size + load}
        for load in (75.0, 150.0)
        for label, severity, size in (("healthy", 0.0, 1.0), ("healthy", 0.0, 1.5), ("wear", 0.5, 4.0))
    ]
    table = pd.DataFrame(rows)
    values, labels = example.split(table, relative=True)
    assert labels.tolist() == ["healthy", "wear"] * 2
    assert values.ravel() == pytest.approx([0.5, 3.0, 0.5, 3.0])
    plain, _ = example.split(table, relative=False)
    assert plain.ravel() == pytest.approx([76.5, 79.0, 151.5, 154.0])


def test_a_rare_label_counts_as_much_as_a_frequent_one(example) -> None:
    matrix = pd.DataFrame([[1, 1], [0, 8]])
    assert example.balanced(matrix) == pytest.approx(0.75)


def test_features_see_a_sideband(example) -> None:
    rate, t = 12800.0, np.arange(6400) / 12800.0
    mesh, f_2 = 1000.0 / 60.0 * 32.0, 1000.0 / 60.0 * 32.0 / 44.0
    plain = np.cos(2.0 * np.pi * mesh * t)
    modulated = (1.0 + 0.2 * np.cos(2.0 * np.pi * f_2 * t)) * plain
    sound, faulty = (
        example.features(pd.DataFrame(dict.fromkeys(example.CHANNELS, y)), 1000.0, 150.0, rate)
        for y in (plain, modulated)
    )
    name = "input_seat_y sidebands of shaft 2"
    # Of the mesh line alone −30 dB leak into them in half a second; two lines of a tenth of it are −14 dB.
    assert sound[name] < -25.0
    assert faulty[name] > -18.0
