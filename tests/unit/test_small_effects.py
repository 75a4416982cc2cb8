"""Effects that are present but change little, and the rules for fits on trial."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.conclusion.conclude import _negligible
from discrepancy.conclusion.conclusion import NegligibleEffect
from discrepancy.conclusion.sentences import negligible_sentence
from discrepancy.effects.catalogue import catalogue
from discrepancy.search import omnibus
from discrepancy.search.decision import Decision
from discrepancy.search.model_comparison import is_relevant
from discrepancy.search.moves.add_one import _different
from discrepancy.search.moves.add_without_significance import _best_present
from discrepancy.search.policy import POLICY
from discrepancy.statistics.thresholds import LEVEL_SHARES
from discrepancy.statistics.verdicts import Verdict
from estimation.fit.calibrate import WEIGHT_CHANGE, calibrate

DRY = "coulomb_friction@guide"


def state_at(stage, irrelevant=()):
    """Return as much of a search as its conclusion about small effects needs, with the stage's scan as the last one."""
    decision = Decision(scans=(stage.scan,), reason="", irrelevant=tuple(irrelevant))
    return SimpleNamespace(decisions=[decision], stages=[stage], stage=stage)


def test_an_irrelevant_effect_is_listed_with_its_strength(small_study):
    _, calibrated, with_friction = small_study.stages
    found = calibrated.scan[DRY]
    kind, where, size, std, p, unit = _negligible(state_at(calibrated, [found]))[0]
    assert f"{kind}@{where}" == DRY
    assert size == pytest.approx(small_study.hidden.strengths["coulomb"], rel=0.2)
    assert std < 0.1 * size
    assert p < 1e-3
    assert unit == "N"
    present = _negligible(state_at(replace(calibrated, effects=with_friction.effects), [found]))
    assert DRY not in {f"{kind}@{where}" for kind, where, *_ in present}


def test_an_effect_rejected_for_another_reason_is_not_said_to_be_present(small_study):
    calibrated = small_study.stages[1]
    listed = {f"{kind}@{where}" for kind, where, *_ in _negligible(state_at(calibrated))}
    assert calibrated.scan[DRY].verdict is Verdict.MISSING  # significant: a refit that is no better, say, leaves it out
    assert DRY not in listed
    assert listed <= {r.name for r in calibrated.scan.rows if r.verdict is Verdict.NEGLIGIBLE}


def test_the_words_name_it_and_say_why_it_is_not_added():
    assert negligible_sentence(()) == ""
    sentence = negligible_sentence([NegligibleEffect("sensor_drift", "F_cw", 0.122, 0.0073, 1e-8, "N/s")])
    assert "sensor drift at F_cw is present (0.122 N/s ± 0.0073 N/s, p = 1e-08)" in sentence
    assert "below the noise floor" in sentence


def test_an_effect_of_which_the_scan_is_sure_needs_only_be_the_better_model(small_study):
    _, calibrated, with_friction = small_study.stages
    entries = {e.name: e for e in catalogue(calibrated.system, calibrated.outputs, ("reference.speed",))}
    above = {n: 100.0 * v for n, v in calibrated.noise.items()}
    small, with_friction = replace(calibrated, noise=above), replace(with_friction, noise=above)
    assert not is_relevant(with_friction, small)  # as the noise is now, the search passes over it
    fitted = []

    def refit(effect, instead_of=(), from_prior=False):
        fitted.append(str(effect))
        return with_friction if str(effect) == DRY else small

    found = _best_present(small, calibrated.scan, refit, entries, lambda _: None)
    assert found is not None
    assert str(found.accepted.effect) == DRY
    assert found.accepted.p_value == pytest.approx(min(1.0, LEVEL_SHARES * calibrated.scan[DRY].p_value))
    assert len(set(fitted)) <= POLICY.finalists
    assert _best_present(small, calibrated.scan, lambda *_, **__: small, entries, lambda _: None) is None


def test_a_trial_weighs_the_outputs_anew_until_their_weights_stay(small_study):
    calibrated = small_study.stages[1]
    system, moved = calibrated.slim, calibrated.identify
    experiments = [f.experiment for f in moved.fits]
    far_off = {n: v * (100.0 if n == "drive.force" else 1.0) for n, v in moved.scale.items()}
    found = calibrate(system, experiments, moved.parameters, noise=calibrated.noise, scale=far_off)
    for name, weight in moved.scale.items():
        assert abs(np.log(found.scale[name] / weight)) < 2 * WEIGHT_CHANGE
    for value, full, std in zip(found.values, moved.values, moved.std, strict=True):
        assert value == pytest.approx(full, abs=0.5 * std)


def test_what_one_record_alone_shows_does_not_reject_the_model(monkeypatch, small_study):
    def row(name, p, carries_over, verdict=Verdict.MISSING):
        return SimpleNamespace(name=name, p_value=p, carries_over=carries_over, verdict=verdict)

    rows = [
        row("of one record", 1e-4, False),
        row("negligible", 1e-5, True, Verdict.NEGLIGIBLE),
        row("lasting", 0.2, True),
    ]
    scan = SimpleNamespace(rows=tuple(rows), scorer=None)
    monkeypatch.setattr(omnibus, "scan", lambda *_, **__: scan)
    monkeypatch.setattr(omnibus, "generic_candidates", lambda *_: [])
    monkeypatch.setattr(omnibus, "_portmanteau", lambda _: (1.0, 1.0, ""))
    residual = SimpleNamespace(blocks=(np.zeros((10, 1)),))
    found = omnibus.omnibus(residual, None, {})
    assert (found.p, found.leading, found.rejects) == (0.2, "lasting", False)
    rows[0].carries_over = True
    assert omnibus.omnibus(residual, None, {}).rejects


def test_of_candidates_that_change_the_same_only_one_is_refitted():
    rows = [SimpleNamespace(name=f"offset@{w}", where=w) for w in ("load", "scale", "pulley", "guide")]
    twins = {"offset@load", "offset@scale"}

    def ties_of(name):
        alike = [SimpleNamespace(name=n, correlation=1.0) for n in twins - {name}] if name in twins else []
        near = [SimpleNamespace(name="offset@guide", correlation=0.99)]
        return SimpleNamespace(same_kind=(*alike, *near), other_kind=())

    scan = SimpleNamespace(ties_of=ties_of)
    assert [r.where for r in _different(scan, rows, [])] == ["load", "pulley", "guide"]
    known = [SimpleNamespace(where="scale")]  # something was found there already: of the two it is the likelier
    assert [r.where for r in _different(scan, rows, known)] == ["scale", "pulley", "guide"]
