"""The statistics of a history: known run lengths, rates as stated, closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kstest, norm, t

from operation.statistics.change_size import change_size
from operation.statistics.control_chart import control_chart, decision_limit, mean_run_length
from operation.statistics.fleet_level import fleet_prior, outliers, share_level
from operation.statistics.large_step import large_step
from operation.statistics.local_level import between_records, local_level, without_prior
from operation.statistics.prediction_errors import prediction_errors
from operation.statistics.recursive_residuals import recursive_residuals, standardised_residuals

DAY = 86400.0


@pytest.mark.parametrize(
    ("limit", "shift", "published"),
    # D. C. Montgomery, Introduction to Statistical Quality Control, 6th ed., table 9.3 (k = 1/2): two sides for no
    # shift (half of one side's), one side's for a shift, where the other does not matter.
    [(4.0, 0.0, 2 * 168.0), (5.0, 0.0, 2 * 465.0), (4.0, 1.0, 8.38), (5.0, 1.0, 10.4), (5.0, 2.0, 4.01)],
)
def test_run_lengths_are_the_published_ones(limit, shift, published):
    assert mean_run_length(limit, shift=shift) == pytest.approx(published, rel=0.005)  # printed to three digits


def test_the_limit_gives_the_run_length_that_was_asked_for():
    assert mean_run_length(decision_limit(465.0)) == pytest.approx(930.0, rel=1e-4)
    with pytest.raises(ValueError, match="between false alarms"):
        decision_limit(1.0)


def test_residuals_are_the_t_test_of_each_value_against_those_before():
    y = np.random.default_rng(0).normal(5.0, 2.0, 12)
    u = standardised_residuals(y)
    assert np.isnan(u[:4]).all()
    before = y[:9]
    ratio = (y[9] - before.mean()) / (before.std(ddof=1) * np.sqrt(1.0 + 1.0 / 9.0))
    assert u[9] == pytest.approx(float(norm.ppf(t.cdf(ratio, 8))), abs=1e-9)
    rng = np.random.default_rng(1)
    many = np.concatenate([standardised_residuals(rng.standard_normal(30) * 7.0 + 3.0)[4:] for _ in range(300)])
    assert kstest(many, "norm").pvalue > 0.01


def test_residuals_with_covariates_do_not_depend_on_what_these_explain():
    rng = np.random.default_rng(2)
    load = rng.uniform(0.0, 4.0, 200)
    noise = rng.standard_normal(200)
    u = standardised_residuals(3.0 + 0.8 * load + noise, load[:, None])
    v = standardised_residuals(-1.0 + 50.0 * load + noise, load[:, None] * 1e3)
    assert u[5:] == pytest.approx(v[5:], abs=1e-6)
    assert kstest(u[10:], "norm").pvalue > 0.01
    constant = standardised_residuals(noise, np.ones((200, 1)))
    assert constant[5:] == pytest.approx(standardised_residuals(noise)[5:], abs=1e-6)


def test_false_alarms_come_as_often_as_stated():
    """200 series of 365 records at one false alarm in 200 records: as many as that, within 3 standard errors.

    The chart starts anew after each alarm, so the alarms of a series are nearly a Poisson process; the first records
    of each start, which only estimate, make it late, never early.
    """
    rng, count, length, rate = np.random.default_rng(3), 200, 365, 200.0
    alarms = sum(len(control_chart(rng.normal(2.0, 5.0, length), rate)) for _ in range(count))
    expected = count * length / rate
    assert 0.6 * expected < alarms < expected + 3.0 * np.sqrt(expected)


def test_correlated_records_alarm_less_than_twice_as_often_as_stated():
    """As above, each value correlated with the last by 0.5: without taking that off, five times as often."""
    rng, count, length, rate = np.random.default_rng(3), 200, 365, 200.0
    values = lfilter([1.0], [1.0, -0.5], rng.standard_normal((count, length + 50)))[:, 50:]
    alarms = sum(len(control_chart(y, rate)) for y in values)
    assert 0.5 * count * length / rate < alarms < 2.0 * count * length / rate


def test_the_correlation_is_that_of_the_series_whatever_steps_it_has():
    rng = np.random.default_rng(8)
    u = lfilter([1.0], [1.0, -0.5], np.sqrt(0.75) * rng.standard_normal(3050))[50:]
    errors = prediction_errors(u + 3.0 * (np.arange(3000) % 1000 > 500))
    steady = np.arange(3000) % 1000 < 500
    steady[:50] = False
    e = errors[steady]
    assert np.std(e) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(0.0, abs=0.08)  # three standard errors
    # a series that starts anew knows the correlation from before; what is missing are the differences across the start
    assert prediction_errors(u[1000:1010], [u[:1000]])[1:] == pytest.approx(prediction_errors(u)[1001:1010], abs=0.01)


@pytest.mark.parametrize(("size", "within"), [(1.0, 30), (2.0, 10), (-2.0, 10)])
def test_a_shift_is_found_and_its_time_and_size_are_stated(size, within):
    found, since, sizes = [], [], []
    for seed in range(40):
        y = np.random.default_rng(seed).standard_normal(150)
        y[100:] += size
        changes = [c for c in control_chart(y, 2000.0) if c.found >= 100]
        if changes:
            found.append(changes[0].found - 99)
            since.append(changes[0].since - 100)
            first = change_size(np.arange(150) * DAY, y, changes[0].since)
            sizes.append(first.size)
            assert changes[0].up == (size > 0.0)
    assert len(found) >= 38
    assert np.median(found) <= within
    assert abs(np.median(since)) <= 3
    assert np.median(sizes) == pytest.approx(size, abs=0.2)


@pytest.mark.parametrize("before", [8, 12, 30])
def test_a_large_step_after_few_records_is_found_at_its_third(before):
    """Twenty deviations; the sum alone, which measures it by a spread that the step widens, finds it late or never."""
    for seed in range(20):
        y = np.random.default_rng(seed).standard_normal(before + 12)
        y[before:] -= 20.0
        first = control_chart(y, 16000.0)[0]
        assert first.found <= before + 2
        assert not first.up
        found, since, up, _ = large_step(*recursive_residuals(y), np.zeros(y.size), 1e-5)
        assert (found, since, up) == (before + 2, before, False)


def test_one_record_or_two_far_off_are_no_large_step():
    for count in (1, 2):
        y = np.random.default_rng(5).standard_normal(60)
        y[20 : 20 + count] += 30.0
        w, squares, degrees = recursive_residuals(y)
        assert large_step(w, squares, degrees, np.zeros(60), 1e-5) is None


def test_large_steps_by_chance_are_as_rare_as_stated():
    """200 000 records at one in 1000; the windows overlap and each record must be far, so that there are fewer."""
    rng, seen = np.random.default_rng(11), 0
    for _ in range(1000):
        w, squares, degrees = recursive_residuals(rng.standard_normal(200))
        seen += large_step(w, squares, degrees, np.zeros(200), 1e-3) is not None
    assert 20 < seen < 200  # 20: it is no test that never finds anything


def test_a_ramp_is_told_from_a_step():
    rng, days = np.random.default_rng(5), np.arange(120) * DAY
    noise = 0.3 * rng.standard_normal(120)
    step = change_size(days, noise + 2.0 * (np.arange(120) >= 60), 60)
    ramp = change_size(days, noise + np.clip((np.arange(120) - 59.5) * 0.05, 0.0, None), 60)
    assert step.shape == "at once"
    assert step.interval()[0] < 2.0 < step.interval()[1]
    assert ramp.shape == "growing"
    assert ramp.per_day == pytest.approx(0.05, rel=0.1)
    assert change_size(days, noise, 119).shape == "not known"


def test_the_local_level_is_bayes_rule():
    times, values, stds = np.arange(3.0), np.array([2.0, 4.0, 3.0]), np.array([1.0, 2.0, np.inf])
    level = local_level(times, values, stds, (0.0, 1.0), drift=0.0, between=0.0)
    assert level.mean[0] == pytest.approx(1.0)
    assert level.mean[1] == pytest.approx((2.0 * 1.0 + 0.25 * 4.0) / 2.25)
    assert level.std[1] == pytest.approx(2.25**-0.5)
    assert level.std[2] == level.std[1]
    moved = local_level(times, values, stds, (0.0, 1.0), drift=0.5, between=0.0)
    assert moved.std[2] == pytest.approx(np.hypot(moved.std[1], 0.5))
    assert local_level(times, values, stds, (0.0, np.inf), 0.0, 0.0).mean[0] == 2.0


def test_a_record_that_only_repeats_the_prior_says_nothing():
    _, std = without_prior(1.0, 0.999, 1.0, 1.0)
    assert std == np.inf
    assert without_prior(1.5, 0.5, 7.0, np.inf) == (1.5, 0.5)


def test_the_spread_between_records_is_found_beside_a_drift_and_a_jump():
    rng = np.random.default_rng(6)
    values = 0.8 * rng.standard_normal(400) + np.linspace(0.0, 6.0, 400) + 10.0 * (np.arange(400) > 200)
    stds = np.full(400, 0.3)
    values += 0.3 * rng.standard_normal(400)
    assert between_records(values, stds) == pytest.approx(0.8, rel=0.15)
    assert between_records(values[:2], stds[:2]) == 0.0


def test_the_prior_of_a_fleet_covers_and_names_who_lies_outside():
    covered, spreads = 0, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        stds = rng.uniform(0.2, 1.5, 25)
        values = rng.normal(10.0, 2.0, 25) + stds * rng.standard_normal(25)
        prior = fleet_prior(values, stds)
        spreads.append(prior.spread)
        covered += prior.spread_interval[0] <= 2.0 <= prior.spread_interval[1]
    assert np.mean(spreads) == pytest.approx(2.0, rel=0.08)
    assert covered >= 52  # 57 of 60 on the average; 52 or fewer have a probability of 2 %
    rng = np.random.default_rng(9)
    values, stds = rng.normal(0.0, 1.0, 30), np.full(30, 0.3)
    assert outliers(values, stds) == []
    values[7] += 9.0
    assert [k for k, _ in outliers(values, stds)] == [7]
    assert fleet_prior(np.array([3.0, 3.0, 3.0]), np.ones(3)).spread == 0.0
    with pytest.raises(ValueError, match="2 machines are too few"):
        fleet_prior(np.ones(2), np.ones(2))


def test_the_level_of_a_share_is_the_papers_tenth_of_fourteen():
    level, (low, high) = share_level(np.arange(1.0, 15.0))
    assert level == 10.0
    assert low < level < high
    with pytest.raises(ValueError, match="too few"):
        share_level(np.ones(2))
