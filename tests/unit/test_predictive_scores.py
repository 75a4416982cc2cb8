"""Log predictive scores of blocks left out: the density given the others, wherever the model was linearised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from discrepancy.evidence import predictive
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
    for rows, score in zip(np.array_split(np.arange(COUNT), predictive.BLOCKS), scores, strict=True):
        rest = np.setdiff1d(np.arange(COUNT), rows)
        covariance = np.linalg.inv(f[rest].T @ f[rest] / NOISE**2 + np.diag(std**-2.0))
        mean = covariance @ f[rest].T @ e[rest] / NOISE**2
        density = multivariate_normal(f[rows] @ mean, f[rows] @ covariance @ f[rows].T + NOISE**2 * np.eye(rows.size))
        # the factor of the normal distribution is left out of all scores
        assert score == pytest.approx(density.logpdf(e[rows]) + 0.5 * rows.size * np.log(2.0 * np.pi), abs=1e-3)
