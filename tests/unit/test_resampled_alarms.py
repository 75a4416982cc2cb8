"""Scans of resampled residuals of a small machine: what alarms, what stays the same, what a run goes on with."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from discrepancy.statistics.whitened import rms_whitener, scaled_by_rms, whiten_all
from discrepancy.validation import linear_axes
from discrepancy.validation.peer_methods import REGRESSION_METHODS
from discrepancy.validation.resampled import SCHEMES, Resampled, ResamplingData, read_resampled, resampled_alarms
from discrepancy.validation.resampled_page import resampled_page
from discrepancy.validation.resampled_peers import ResampledPeers, resampled_case, resampled_peers_page

UNTIED = (SCHEMES[0], SCHEMES[2])
KINDS = ("constant_force", "local_bump", "angle_harmonic", "stribeck_friction")


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(3)
    axis = linear_axes.make_axis(rng, 1, 12.0, 0.01)
    case = linear_axes.make_case(axis, "ar2", rng)
    every = linear_axes.candidates(axis)
    some = [c for c in every if c.kind in KINDS] or every[:4]
    return ResamplingData.of_arrays(case.residual, case.sensitivities, some, some[:1], [0.0, 0.0], UNTIED)


def test_a_number_always_gives_the_same_residual(given):
    (scheme, first), (again, second) = given.draw(1001), given.draw(1001)
    assert scheme == again == UNTIED[1]
    assert np.array_equal(first.blocks[0], second.blocks[0])
    assert not np.array_equal(first.blocks[0], given.draw(1003)[1].blocks[0])


def test_calibration_is_projected_out_as_in_a_new_scan(given):
    made = given.draw(1000)[1]
    anew = whiten_all(rms_whitener(given.residual), made, given.sens, given.candidates)
    assert np.allclose(given.plain(made).e, anew.e, atol=1e-10 * np.linalg.norm(anew.e))
    free = given.plain(made, curves=True)
    assert np.allclose(free.e, anew.e, atol=1e-10 * np.linalg.norm(anew.e))
    assert len(free.columns.groups) < len(anew.columns.groups)


def test_a_residual_correlated_for_as_long_as_the_record_is_reported(given):
    assert given.caution == "", "12 s, and a disturbance that has forgotten all after a second"
    long = replace(given, memory=300.0)
    assert long.caution.startswith(
        "The residual is correlated over 3 s, and all records together last 12 s: 0.8 blocks"
    )
    trial = Resampled(number=1, scheme=SCHEMES[0], plain="", whitened="", curves="", p=0.4)
    text = resampled_page([trial], "study.toml", [], 0.02, "today", (0.0, 0.0), long.caution)
    assert long.caution in text


def test_an_interrupted_run_continues(given, tmp_path):
    first = resampled_alarms(given, 1, tmp_path, level=0.02, seed=1000)
    lines = (tmp_path / "resampled.jsonl").read_text()
    both = resampled_alarms(given, 2, tmp_path, level=0.02, seed=1000)
    assert (tmp_path / "resampled.jsonl").read_text().startswith(lines)
    assert both[:1] == first
    assert [t.number for t in read_resampled(tmp_path / "resampled.jsonl")] == [1000, 1001]


def test_an_effect_in_the_residual_is_an_alarm(given, tmp_path):
    """A scan that never alarmed would have the best rates of all."""
    column = given.candidates[0].sensitivities[0][0][:, :, 0]
    size = 3.0 * np.std(given.source[0]) / np.std(column)

    class Tied:
        def draw(self, number):
            scheme, made = given.draw(number)
            return scheme, type(made)([made.blocks[0] + size * column], made.dt, made.channels)

        def __getattr__(self, name):
            return getattr(given, name)

    trial = resampled_alarms(Tied(), 1, tmp_path, level=0.02, seed=1000)[0]
    assert trial.alarm
    assert json.loads((tmp_path / "resampled.jsonl").read_text())["plain"] == trial.plain


def test_a_masking_pair_in_the_residual_is_an_alarm(given, tmp_path):
    """The same for pairs: of two opposite effects only a share of a friction is left, and neither shows alone."""
    from discrepancy.statistics.blocks import Candidate

    other, one = (c.sensitivities[0] for c in given.candidates[:2])
    size = [float(np.std(c[0])) for c in (one, other)]
    opposite = tuple(-a / size[0] + 0.3 * b / size[1] for a, b in zip(one, other, strict=True))
    pair = [
        Candidate(kind="late", where="sensor", sensitivities=(one,)),
        Candidate(kind="stiff", where="loop", sensitivities=(opposite,)),
    ]
    two = ResamplingData.of_arrays(given.residual, given.sens, pair, given.curves, [0.0, 0.0], UNTIED)
    column = other[0][:, :, 0] / size[1]
    made = two.draw(1000)[1]

    class Tied:
        def draw(self, number):
            added = made.blocks[0] + np.std(two.source[0]) * column
            return UNTIED[0], type(made)([added], made.dt, made.channels)

        def __getattr__(self, name):
            return getattr(two, name)

    trial = resampled_alarms(Tied(), 1, tmp_path, level=0.02, seed=1000)[0]
    assert not trial.plain
    assert set(trial.pairs.split(" and ")) == {"late@sensor", "stiff@loop"}


def test_one_record_is_cut_into_four_to_leave_one_out(given):
    case = resampled_case(given, given.draw(1000)[1])
    n = given.residual.n_samples
    for seen in (case.plain, case.white):
        assert [t.start for t in seen.trips] == [0, n // 4, n // 2, 3 * n // 4]
        assert seen.trips[-1].stop == len(seen.e) == n
        assert np.allclose(np.linalg.norm(seen.X, axis=0), 1.0)
    anew = scaled_by_rms(given.residual, given.sens, given.candidates)
    assert len(anew.columns.groups) == len(case.plain.groups)


def test_criteria_need_no_further_programs(given):
    case = resampled_case(given, given.draw(1000)[1])
    aic, bic = (REGRESSION_METHODS[f"every candidate, {c}"](case) for c in ("AIC", "BIC"))
    names = {c.name for c in given.candidates}
    assert set(bic.named) <= set(aic.named) <= names


def test_page_counts_only_trials_of_both(tmp_path):
    from discrepancy.validation.resampled import Resampled

    ours = [
        Resampled(number=k, scheme=UNTIED[k % 2], plain="bump@guide" if k == 1 else "", whitened="", curves="", p=0.5)
        for k in range(4)
    ]
    said = {"loud": {"named": ["a@b", "c@d"], "ties": [], "seconds": 0.1}, "quiet": {"named": []}}
    theirs = [ResampledPeers(k, UNTIED[k % 2], said, {"0.1": ["a@b"] if k < 2 else []}) for k in range(5)]
    text = resampled_peers_page(theirs, ours, {"other": "1.0"}, "today")
    assert "numbers 0 to 3; other 1.0" in text
    assert "| this program | 1 | 4 | 25.0% | 4.6% to 69.9% | 0/2 | 1/2 | 1 | bump@guide 1 |" in text
    assert "| loud | 4 | 4 | 100.0% | 51.0% to 100.0% | 2/2 | 2/2 | 2 | a@b 4, c@d 4 |" in text
    assert "| quiet | 0 | 4 | 0.0% | 0.0% to 49.0% | 0/2 | 0/2 | – | – |" in text
    assert "| 0.1 | 2 | 4 | 50.0%" in text
