"""Where a model fails, on a machine of which it is known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from discrepancy.questions.locate import locate, regimes_of
from discrepancy.stages.residuals_along_motion import residuals_along_motion


@pytest.fixture(scope="module")
def before(small_study):
    return locate(small_study.stages[1])


@pytest.fixture(scope="module")
def held_out(small_study):
    return locate(small_study.stages[1], "validate")


def test_the_guide_is_where_the_force_is_missing(before, held_out) -> None:
    for found in (before, held_out):
        best, other = found.connections[:2]
        assert best["place"] == "guide"
        # The friction's law is in the span of the free force but for the smoothing at the reversal.
        assert best["share"] > 0.75
        assert other["share"] < 0.5
        # A force within the drive and one at the carriage are the same to sensors behind a prescribed motor.
        assert best["same_as"] == ["drive"]
        assert best["moves_with"] == []


def test_signals_share_the_error_above_noise(before) -> None:
    assert [s["output"] for s in before.signals] == ["drive.force", "carriage.position"]
    assert sum(s["share"] for s in before.signals) == pytest.approx(1.0, abs=1e-12)


def test_dry_friction_shows_with_speed_and_rest(before, held_out) -> None:
    over = {d["over"] for d in before.dependence if d["output"] == "drive.force"}
    assert "speed" in over
    assert "position" not in over
    # In the held-out record the machine rests with its drive wound up by friction, which the model cannot do.
    rest = [r for r in held_out.regimes if r["regime"] == "at rest" and r["output"] == "drive.force"]
    assert len(rest) == 1
    assert rest[0]["relative"] > 1.2
    assert 0.0 < rest[0]["time_share"] < 0.6


def test_a_good_model_fails_nowhere(small_study) -> None:
    for part in ("identify", "validate"):
        found = locate(small_study.stages[2], part)
        assert found.regimes == ()
        assert found.dependence == ()
        assert found.frequencies == ()
        assert all(c["share"] < 0.05 for c in found.connections)
        assert all("no more than the noise" in s["sentence"] for s in found.signals)


def test_frequencies_are_those_of_the_error(before) -> None:
    bands = [b for b in before.frequencies if b["output"] == "drive.force"]
    assert bands
    assert bands[0]["share"] > 0.9
    assert bands[0]["from_hz"] <= bands[0]["peak_hz"] <= bands[0]["to_hz"] <= 50.0
    assert sum(b["share"] for b in bands) <= 1.0 + 1e-12


def test_entries_are_plain_values_with_a_sentence(before) -> None:
    told = before.to_dict()
    assert set(told) == {"signals", "regimes", "frequencies", "connections", "dependence"}
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert all(e["sentence"].endswith(".") for entries in told.values() for e in entries)
    assert "guide" in repr(before)


def test_regimes_of_a_stroke(small_study) -> None:
    motion = residuals_along_motion(small_study.stages[1], "validate").guides()[0]
    assert motion.name == "guide"
    found = regimes_of(motion)
    assert not np.any(found["forward"] & found["backward"])
    apart = ("at rest", "starting", "constant speed", "braking")
    assert np.all(np.sum([found[r] for r in apart], axis=0) <= 1)
    assert np.all(np.abs(motion.speed[found["at rest"]]) < 0.02 * np.abs(motion.speed).max())


def test_a_part_without_records_is_refused(small_study) -> None:
    from dataclasses import replace

    with pytest.raises(ValueError, match="no records in part 'validate'"):
        locate(replace(small_study.stages[1], validate=None), "validate")
