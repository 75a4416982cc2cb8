"""An effect matters from the size that moves an output by its sensor's noise; noise is shared with simpler models."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discrepancy.evidence import proposals
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import lost_to_means
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.predictive import shift_over_noise, simulation_errors
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.innovations.noise_model import NoiseModel, Process


def test_the_shift_is_what_a_simulation_without_the_effect_shows(small_study) -> None:
    """A hundredth of the friction, so that the outputs are linear in it."""
    stage = small_study.stages[-1]
    likelihood = StageLikelihood(stage=stage.without_results())
    (effect,) = stage.effects
    part = 0.01
    small = type(effect)(**{**vars(effect), "strengths": {k: part * v for k, v in effect.strengths.items()}})
    p, shifts = np.array(stage.p), []
    less = p.copy()
    for name, value in effect.strengths.items():
        less[stage.slim.index("parameter", effect.parameter_name(name))] = (1.0 - part) * value
    for fit in stage.identify.fits:
        one, other = (fit.experiment.respond_with_own(stage.slim, q, fit.own).outputs for q in (p, less))
        noise = np.array([stage.noise[c] for c in fit.experiment.outputs])
        noise = noise / np.sqrt(fit.experiment.preparation.average)
        shifts.append(np.max(np.abs(one - other) / noise))
    assert shift_over_noise(likelihood, small) == pytest.approx(max(shifts), rel=0.05)
    assert shift_over_noise(likelihood, effect) == pytest.approx(shift_over_noise(likelihood, small) / part, rel=1e-9)


def test_errors_of_a_model_as_it_stands_are_those_of_its_simulation(small_study) -> None:
    """Fitted to the other blocks each time they are larger, because it stands where all blocks together put it."""
    stage = small_study.stages[-1]
    likelihood = StageLikelihood(stage=stage.without_results())
    stands, again = (np.sum(simulation_errors(likelihood, fitted_again=f), axis=0) for f in (False, True))
    linearised = likelihood.linearised
    used = [b[~mask] for b, mask in zip(linearised.residual().blocks, likelihood.left_out, strict=True)]
    expected = sum(np.sum(b**2, axis=0) + len(b) * lost_to_means(linearised) for b in used)
    np.testing.assert_allclose(stands, expected, rtol=1e-12)
    scale = np.array([stage.identify.scale[c] for c in stage.outputs])
    assert np.sum(again / scale**2) > np.sum(stands / scale**2)


def tried(key: tuple[str, ...], total: float) -> TriedModel:
    evidence: Any = SimpleNamespace(total=total)
    likelihood: Any = SimpleNamespace()
    return TriedModel(key=key, likelihood=likelihood, evidence=evidence)


@pytest.mark.parametrize("behind", [POLICY.reach - 1.0, POLICY.reach + 1.0])
def test_a_model_far_below_a_simpler_one_is_given_its_noise(behind: float, monkeypatch: pytest.MonkeyPatch) -> None:
    state: Any = SimpleNamespace()
    models = TriedModels(state)
    for key, total in (((), 0.0), (("a",), 50.0), (("c",), 90.0)):
        models.models[key] = tried(key, total)
    shared: list[tuple[str, ...]] = []
    monkeypatch.setattr(models, "with_noise_of", lambda source, model: shared.append(source.key))
    models.share_noise_of_simpler(tried(("a", "b"), 50.0 - behind))
    assert shared == ([("a",)] if behind > POLICY.reach else [])


@pytest.mark.parametrize(("memory", "listed"), [(0.05, []), (0.5, ["constant_force@rail"])])
def test_the_mean_of_a_slow_random_force_is_tried(
    memory: float, listed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    force = Process(where="rail", source=0, channel=-1, memory=memory, std=1.0)
    noise = SimpleNamespace(model=NoiseModel(noise=(0.1,), processes=(force,)))
    likelihood: Any = SimpleNamespace(noise=noise, duration=1.0)
    names = ["viscous_friction@rail", "constant_force@rail", "constant_force@bearing"]
    ranked = [SimpleNamespace(name=n, expected_strength=np.ones(1), at_one_shape=None) for n in names]
    own: Any = SimpleNamespace(ranked=ranked, noise=np.ones(1))
    nothing = SimpleNamespace(offset=-100.0, able=[], likeliest_pair=((), -np.inf))
    monkeypatch.setattr(proposals._Scoring, "under", lambda *_: nothing)
    found, _ = proposals._in_place_of_random(likelihood, own, lambda text: None)
    assert [c.name for each in found for c in each] == listed
