"""Other methods asked about resampled residuals of a small machine."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pysindy")
pytest.importorskip("sklearn")

from discrepancy.validation import linear_axes
from discrepancy.validation.peer_methods import REGRESSION_METHODS, THRESHOLDS, versions
from discrepancy.validation.resampled import SCHEMES, Resampled, ResamplingData
from discrepancy.validation.resampled_peers import (
    THRESHOLD,
    read_resampled_peers,
    resampled_case,
    resampled_peers,
    resampled_peers_page,
)


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(3)
    axis = linear_axes.make_axis(rng, 1, 12.0, 0.01)
    case = linear_axes.make_case(axis, "mixed", rng)
    every = linear_axes.candidates(axis)
    return ResamplingData.of_arrays(case.residual, case.sensitivities, every, every[:1], [0.0, 0.0], SCHEMES[:1])


@pytest.mark.parametrize("name", REGRESSION_METHODS)
def test_each_sees_a_strong_effect_on_the_residual(given, name):
    c = next(c for c in given.candidates if not c.one_sided)
    column = c.sensitivities[0][0][:, :, 0]
    made = given.draw(1000)[1]
    tied = made.blocks[0] + 5.0 * np.std(made.blocks[0]) / np.std(column) * column
    case = resampled_case(given, type(made)([tied], made.dt, made.channels))
    assert c.name in REGRESSION_METHODS[name](case).named


def test_run_goes_on_and_is_told_beside_ours(given, tmp_path):
    first = resampled_peers(given, 1, tmp_path, seed=1000)
    lines = (tmp_path / "resampled_peers.jsonl").read_text()
    both = resampled_peers(given, 2, tmp_path, seed=1000)
    assert (tmp_path / "resampled_peers.jsonl").read_text().startswith(lines)
    assert [t.number for t in both] == [1000, 1001]
    assert both == read_resampled_peers(tmp_path / "resampled_peers.jsonl")
    assert list(first[0].answers) == list(REGRESSION_METHODS)
    assert len(both[0].thresholds) == len({*THRESHOLDS, THRESHOLD})
    few, many = (len(both[0].thresholds[f"{t:g}"]) for t in (max(THRESHOLDS), min(THRESHOLDS)))
    assert few <= many
    ours = [Resampled(number=k, scheme=SCHEMES[0], plain="", whitened="", curves="", p=0.5) for k in (1000, 1001)]
    text = resampled_peers_page(both, ours, versions(), "today")
    assert all(f"| {name} | " in text for name in REGRESSION_METHODS)
    assert "| this program | 0 | 2 |" in text
