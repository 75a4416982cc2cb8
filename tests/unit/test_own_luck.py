"""Each candidate against its own luck, and intervals against what is true."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.stages.interval_coverage import coverage
from discrepancy.statistics import scan as scanning
from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.null import Null, Pieces
from discrepancy.validation.trials import Trial, rates

CANDIDATES, DRAWS, SCALE = 30, 400, 4.0


def luck(rng, draws):
    """Return surprises as a perfect calibration would give them, but for the first candidate, whose tail is longer."""
    u = rng.exponential(size=(CANDIDATES, draws))
    u[0] *= SCALE
    return u


@pytest.fixture(scope="module")
def null():
    return Null(luck(np.random.default_rng(1), DRAWS), np.ones(CANDIDATES), Pieces(((0, 0, 100),), 0.1, 0.01))


def test_luck_is_called_luck_as_often_as_the_level_says(null):
    fresh = luck(np.random.default_rng(2), 2000)
    p = np.array([np.min(null.p_value(u)) for u in fresh.T])
    for level in (0.02, 0.1):
        # three deviations of the 2000 new cases and of the quantile of the 400 draws
        assert abs(np.mean(p < level) - level) < 3.0 * np.sqrt(level * (1.0 - level) * (1 / 2000 + 1 / DRAWS))


def test_a_long_tail_does_not_hide_the_others(null):
    u = np.zeros(CANDIDATES)
    u[5] = 14.0  # luck of one in 10⁶ for this candidate
    assert null.p_value(u)[5] < 0.001
    assert np.mean(null.single.max(axis=0) >= u[5]) > 0.02  # by the long tail alone
    u = np.zeros(CANDIDATES)
    u[0] = 14.0  # for the one with the long tail that is luck of e^-3.5
    assert null.p_value(u)[0] > 0.1


def test_what_is_critical_has_the_level(null):
    least = null.critical(0.05)
    assert least[0] > 2.0 * np.median(least[1:])
    given = null.own.surprise(least[:, None])[:, 0]
    np.testing.assert_allclose(given, np.quantile(null.maxima, 0.95), rtol=1e-12)


def test_a_scan_without_candidates_has_no_luck():
    empty = Null(np.zeros((0, DRAWS)), np.zeros(0), Pieces(((0, 0, 100),), 0.1, 0.01))
    assert empty.maxima.shape == (DRAWS,)
    assert empty.critical(0.02).size == 0


def slow(rng, size, memory):
    kernel = np.exp(-0.5 * (np.arange(-3 * memory, 3 * memory + 1) / memory) ** 2)
    return np.convolve(rng.standard_normal(size + 6 * memory), kernel, mode="valid")[:size]


def removed(seed):
    """Return what a scan with curves of 17 points takes out of slow noise that is loud in motion."""
    rng, n, records = np.random.default_rng(seed), 240, 3
    share = np.arange(n) / n
    loud = np.where((share > 0.2) & (share < 0.7), 1.0, 0.15)
    noise = [(loud * slow(rng, n, 8))[:, None] + 0.05 * rng.standard_normal((n, 1)) for _ in range(records)]

    def points():
        return np.stack([loud * slow(rng, n, 6) for _ in range(17)], axis=1)[:, None]

    curves = [Candidate("curve", f"place {k}", ([points() for _ in range(records)],)) for k in range(12)]
    known = Sensitivities(["a"], [np.ones((n, 1, 1))] * records)
    return scanning.scan(Residual(noise, 0.025, ["y"]), known, curves, draws=200, seed=1, whiten=False).removed


def test_curves_are_taken_out_of_slow_noise_less_often_than_laws_would_be(monkeypatch):
    seeds = (1, 2, 4)  # of 0 to 5 a curve is taken out of 0 and 3 still, and by the rule for laws out of all six
    assert [removed(k) for k in seeds] == [()] * 3
    monkeypatch.setattr(scanning, "FEW_COLUMNS", 17)  # by the rule for laws
    assert all(removed(k) for k in seeds)


def test_intervals_are_held_against_the_truth():
    values = {"mass.m": (2.0, 0.1), "guide.viscous": (5.0, 0.1), "at.bound": (1.0, np.inf)}
    values["law.guide.force"] = (9.0, 1.0)
    fitted = SimpleNamespace(
        parameters=[SimpleNamespace(name=n) for n in values],
        std_of=lambda n: values[n][1],
        interval=lambda n: (values[n][0] - 2 * values[n][1], values[n][0] + 2 * values[n][1]),
    )

    class Law:
        strengths = ("force",)

        def parameter_name(self, name):
            return f"law.guide.{name}"

        def __str__(self):
            return "law@guide"

    truth = {
        "perturbed": {"mass.m": {"value": 2.1}, "guide.viscous": {"value": 6.0}, "at.bound": {"value": 1.0}},
        "effects": [{"kind": "law", "where": "guide", "parameters": {"force": {"value": 10.0}}}],
    }
    found = coverage(SimpleNamespace(identify=fitted, effects=(Law(),)), truth)
    assert found == (2, ("guide.viscous",))
    trial = Trial("null", 1, (), "nothing missing", (), inside=found[0], outside=found[1])
    assert rates([trial])[1] == ("95 % intervals with the true value in them (1 trials)", 2, 3)
