"""Log predictive scores of blocks left out: the density given the others, wherever the model was linearised."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from discrepancy.evidence import predictive
from discrepancy.evidence.predictive import PredictiveGain
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import RecordColumns
from discrepancy.innovations.noise_model import NoiseModel

COUNT, NOISE = 80, 0.1


def still(count: int) -> LinearRecord:
    """Return a record of a machine without motion: one output, and sensor noise."""
    return LinearRecord(
        time=np.arange(count, dtype=float),
        observed=np.ones(count, dtype=bool),
        phi=np.repeat(np.eye(1)[None], count - 1, axis=0),
        gamma0=np.zeros((count - 1, 1, 1)),
        gamma1=np.zeros((count - 1, 1, 1)),
        c=np.zeros((count, 1, 1)),
        d=np.zeros((count, 1, 1)),
        left_out=np.zeros(count, dtype=bool),
    )


def nearly_alike(seed: int) -> RecordColumns:
    """Return a residual with two parameters that almost stand for each other, as those of a calibrated model may do."""
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / COUNT
    one, other = np.sin(9.0 * t), np.sin(9.0 * t) + 0.02 * np.cos(20.0 * t)
    return RecordColumns(
        record=still(COUNT),
        residual=(0.5 * one + NOISE * rng.standard_normal(COUNT))[:, None],
        shared=np.stack([one, other], axis=1)[:, None, :],
        own=np.zeros((COUNT, 1, 0)),
        spread=np.ones(1),
    )


@pytest.mark.parametrize("moved", [0.3, 30.0])
def test_scores_do_not_depend_on_where_the_model_was_linearised(moved: float) -> None:
    one, model = nearly_alike(1), NoiseModel(noise=(NOISE,))
    std, offset, by = np.array([2.0, np.inf]), np.array([0.1, 0.0]), moved * np.array([1.0, -1.0])
    from_there = replace(one, residual=one.residual - one.shared @ by)
    here = predictive.scores_of_blocks([one], model, std, offset)
    there = predictive.scores_of_blocks([from_there], model, std, offset - by)
    np.testing.assert_allclose(there, here, atol=1e-3)  # nats: what the ridge of 1e-9 leaves of a move by 30


def test_scores_are_the_density_of_a_block_given_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predictive, "KEPT", 0.0)
    one, model = nearly_alike(2), NoiseModel(noise=(NOISE,))
    std = np.array([2.0, 3.0])
    f, e = one.shared[:, 0, :], one.residual[:, 0]
    scores = predictive.scores_of_blocks([one], model, std, np.zeros(2))
    for rows, score in zip(np.array_split(np.arange(COUNT), predictive.BLOCKS), scores.sum(axis=1), strict=True):
        rest = np.setdiff1d(np.arange(COUNT), rows)
        covariance = np.linalg.inv(f[rest].T @ f[rest] / NOISE**2 + np.diag(std**-2.0))
        mean = covariance @ f[rest].T @ e[rest] / NOISE**2
        density = multivariate_normal(f[rows] @ mean, f[rows] @ covariance @ f[rows].T + NOISE**2 * np.eye(rows.size))
        # the factor of the normal distribution is left out of all scores
        assert score == pytest.approx(density.logpdf(e[rows]) + 0.5 * rows.size * np.log(2.0 * np.pi), abs=1e-3)


@pytest.mark.parametrize("count", [COUNT, 20])
def test_a_model_without_parameters_and_a_short_record_have_scores_too(count: int) -> None:
    residual = NOISE * np.random.default_rng(5).standard_normal(count)
    empty = np.zeros((count, 1, 0))
    one = RecordColumns(record=still(count), residual=residual[:, None], shared=empty, own=empty, spread=np.ones(1))
    scores = predictive.scores_of_blocks([one], NoiseModel(noise=(NOISE,)), np.zeros(0), np.zeros(0))
    assert scores.sum() == pytest.approx(-0.5 * np.sum((residual / NOISE) ** 2) - count * np.log(NOISE))


def test_a_standard_error_is_nearly_the_spread_of_the_gain_also_of_what_shows_in_one_block() -> None:
    count, model = 800, NoiseModel(noise=(NOISE,))
    t = np.arange(count) / count
    bends = np.where(t < 7 / 8, 0.2, 1.0) * np.sin(300.0 * t)  # little, but for one stroke in eight
    both = np.stack([np.ones(count), bends], axis=1)[:, None, :]
    gains, of_parts, of_blocks = [], [], []
    for seed in range(200):
        residual = NOISE * (bends + np.random.default_rng(seed).standard_normal(count))
        one = RecordColumns(
            record=still(count),
            residual=residual[:, None],
            shared=both,
            own=np.zeros((count, 1, 0)),
            spread=np.ones(1),
        )
        other = replace(one, shared=both[:, :, :1])
        with_effect = predictive.scores_of_blocks([one], model, np.array([np.inf, 1.0]), np.zeros(2))
        without = predictive.scores_of_blocks([other], model, np.array([np.inf]), np.zeros(1))
        gain = predictive.gain_of_scores(with_effect, without)
        gains.append(gain.gain)
        of_parts.append(gain.standard_error)
        of_blocks.append(predictive.gain_of_scores(with_effect.sum(axis=1), without.sum(axis=1)).standard_error)
    # 1.4 and 3.0 times: an effect that shows in eight of 64 parts, or in one of eight blocks, counts as spread itself
    assert 0.9 < np.mean(of_parts) / np.std(gains) < 1.5
    assert np.mean(of_blocks) / np.std(gains) > 2.0


def calibrated(*, moved: float, std: float = 0.1, held: tuple[str, ...] = (), noise: float = NOISE) -> Any:
    """Return a model whose records ask for a parameter off its stated value, 0, and for the strength of an effect."""
    rng = np.random.default_rng(3)
    t = np.arange(COUNT) / COUNT
    shared = np.stack([np.sin(9.0 * t), np.cos(5.0 * t)], axis=1)[:, None, :]
    record = RecordColumns(
        record=still(COUNT),
        residual=noise * rng.standard_normal((COUNT, 1)),
        shared=shared,
        own=np.zeros((COUNT, 1, 0)),
        spread=np.ones(1),
    )
    effect = SimpleNamespace(
        strengths={"drag": 1.0}, definition=SimpleNamespace(free_shapes=()), parameter_name=lambda k: f"effect.{k}"
    )
    sens = SimpleNamespace(
        names=["mass", "effect.drag"], prior_std=np.array([std, 5.0]), prior_offset=np.array([-moved, 0.0])
    )
    return SimpleNamespace(
        linearised=SimpleNamespace(sensitivities=lambda: sens),
        held=held,
        stage=SimpleNamespace(effects=(effect,)),
        noise=SimpleNamespace(records=(), model=NoiseModel(noise=(noise,))),
        columns=([record], sens.prior_std, sens.prior_offset),
    )


def test_the_score_of_stated_values_is_their_density_given_the_records(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predictive, "KEPT", 0.0)
    monkeypatch.setattr(predictive, "record_columns", lambda linearised, records, held: here.columns)
    here = calibrated(moved=0.35)
    (record,), _, _ = here.columns
    f, e = record.shared[:, 0, :], record.residual[:, 0]
    covariance = np.linalg.inv(f.T @ f / NOISE**2 + np.diag([0.0, 5.0**-2]))
    mean = covariance @ f.T @ e / NOISE**2
    # the stated value lies 0.35 below where the record was linearised; its deviation is 0.1
    density = multivariate_normal(mean[0] / 0.1, covariance[0, 0] / 0.01 + 1.0)
    expected = density.logpdf(-3.5) + 0.5 * np.log(2.0 * np.pi)
    assert predictive.stated_score(here) == pytest.approx(expected, abs=1e-6)


def test_a_parameter_at_its_bound_is_scored_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    at_bound = calibrated(moved=0.35, held=("mass",))
    (record,), std, offset = at_bound.columns
    only_strength = [replace(record, shared=record.shared[:, :, 1:])], std[1:], offset[1:]
    monkeypatch.setattr(predictive, "record_columns", lambda linearised, records, held: only_strength)
    assert predictive.stated_score(at_bound) == pytest.approx(-0.5 * 3.5**2)


@pytest.mark.parametrize(("in_conflict", "stated"), [(True, 50.0), (False, 0.0)])
def test_stated_values_count_where_only_the_effect_keeps_them(
    monkeypatch: pytest.MonkeyPatch, in_conflict: bool, stated: float
) -> None:
    one, other = calibrated(moved=0.0), calibrated(moved=1.0)
    for model in (one, other):
        model.stage.identify = None
    monkeypatch.setattr(predictive, "needs_prior_conflict", lambda richer, poorer: in_conflict)
    monkeypatch.setattr(predictive, "predictive_scores", lambda model: np.zeros((8, 8)))
    monkeypatch.setattr(predictive, "stated_score", lambda model: 0.0 if model is one else -50.0)
    gain = predictive.predictive_gain(one, other)
    assert gain.stated == stated
    assert gain.exceeds(1.0) is in_conflict


def test_a_gain_that_stated_values_do_not_outweigh_is_none() -> None:
    assert not PredictiveGain(gain=-60.0, standard_error=5.0, blocks=8, parts=8, stated=50.0).exceeds(1.0)
    assert PredictiveGain(gain=-7.0, standard_error=2.0, blocks=8, parts=8, stated=90.0).exceeds(1.0)


def test_of_few_blocks_a_name_needs_more_standard_errors():
    """A level of 5 %: 1.65 of a normal distribution are 1.9 of eight blocks, and 6.3 of two."""
    gain = PredictiveGain(gain=18.5, standard_error=10.0, blocks=8, parts=8)
    assert gain.exceeds(1.645)
    assert not gain.exceeds_normal(1.645)
    assert PredictiveGain(gain=19.5, standard_error=10.0, blocks=8, parts=8).exceeds_normal(1.645)
    assert not PredictiveGain(gain=60.0, standard_error=10.0, blocks=2, parts=2).exceeds_normal(1.645)
