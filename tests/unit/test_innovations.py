"""Innovations: the whitening is that of the dense covariance; the likelihood does not depend on order or units."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import (
    PROCESS_PRICE,
    RecordColumns,
    fit_noise,
    restricted_log_likelihood,
    restricted_log_likelihoods,
    restricted_score,
)
from discrepancy.innovations.noise_model import NoiseModel, Process, innovation_weighting

STEP, STIFFNESS, DAMPING = 0.02, 40.0, 1.5
NO_PRIOR = np.array([np.inf, np.inf])
NO_OFFSET = np.zeros(2)
SPREAD = np.array([0.05, 0.3])


def oscillator(count: int) -> LinearRecord:
    """Return an oscillator of unit mass with a force as its input; position and speed are measured."""
    from scipy.linalg import expm

    a = np.zeros((4, 4))  # state, force, and the rate of the force between two samples
    a[0, 1], a[1, 0], a[1, 1], a[1, 2], a[2, 3] = 1.0, -STIFFNESS, -DAMPING, 1.0, 1.0
    whole = expm(a * STEP)
    phi, held, ramp = whole[:2, :2], whole[:2, 2:3], whole[:2, 3:4] / STEP
    return LinearRecord(
        time=STEP * np.arange(count),
        observed=np.ones(count, dtype=bool),
        phi=np.repeat(phi[None], count - 1, axis=0),
        gamma0=np.repeat((held - ramp)[None], count - 1, axis=0),
        gamma1=np.repeat(ramp[None], count - 1, axis=0),
        c=np.repeat(np.eye(2)[None], count, axis=0),
        d=np.zeros((count, 2, 1)),
        left_out=np.zeros(count, dtype=bool),
    )


#: Forces of first order, that swing, and that have a rate of change.
FORCES = [{}, {"frequency": 4.0}, {"smooth": True}]


def noise_model(force: float = 0.8, drift: float = 0.002, **how: Any) -> NoiseModel:
    return NoiseModel(
        noise=(0.003, 0.02),
        processes=(
            Process(where="spring", source=0, channel=-1, memory=0.3, std=force, **how),
            Process(where="position", source=-1, channel=0, memory=0.1, std=drift),
        ),
        correlation=np.array([[1.0, 0.4], [0.4, 1.0]]),
    )


def dense_covariance(record: LinearRecord, model: NoiseModel) -> np.ndarray:
    """Return the covariance of all outputs by propagating unit forces, without any filter."""
    count, n_c = record.c.shape[:2]
    force, drift = model.processes
    response = np.zeros((count, n_c, count))
    for k in range(count):
        x = np.zeros(2)
        for t in range(count):
            response[t, :, k] = record.c[t] @ x
            if t + 1 < count:
                x = record.phi[t] @ x + record.gamma0[t, :, 0] * (t == k) + record.gamma1[t, :, 0] * (t + 1 == k)
    apart = np.abs(record.time[:, None] - record.time[None])
    flat = response.reshape(count * n_c, count)
    kind = 1.0 + apart / force.memory if force.smooth else np.cos(2.0 * np.pi * force.frequency * apart)
    total = flat @ (force.std**2 * np.exp(-apart / force.memory) * kind) @ flat.T
    total += np.kron(drift.std**2 * np.exp(-apart / drift.memory), np.diag([1.0, 0.0]))
    return total + np.kron(np.eye(count), model.noise_covariance())


def columns_of(record: LinearRecord, seed: int, model: NoiseModel) -> RecordColumns:
    rng = np.random.default_rng(seed)
    count = record.time.size
    root = np.linalg.cholesky(dense_covariance(record, model))
    shared = np.stack([np.sin(3.0 * record.time), np.cos(7.0 * record.time)], axis=1)[:, None, :] * np.ones((1, 2, 1))
    shared[:, 1] *= 2.0
    return RecordColumns(
        record=record,
        residual=(root @ rng.standard_normal(2 * count)).reshape(count, 2),
        shared=shared,
        own=np.exp(-record.time)[:, None, None] * np.ones((1, 2, 1)),
        spread=SPREAD,
    )


def without_unknowns(record: LinearRecord, residual: np.ndarray) -> RecordColumns:
    none = np.zeros((*residual.shape, 0))
    return RecordColumns(record=record, residual=residual, shared=none, own=none, spread=SPREAD)


@pytest.mark.parametrize("how", FORCES)
def test_the_filter_whitens_as_the_dense_covariance_does(how: dict[str, Any]) -> None:
    record, model = oscillator(40), noise_model(**how)
    covariance = dense_covariance(record, model)
    weighting = innovation_weighting(record, model)
    white = weighting(np.eye(80).reshape(40, 2, 80)).reshape(80, 80)
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(80), atol=1e-9)
    assert weighting.log_det == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1], abs=1e-8)
    np.testing.assert_allclose(white, np.tril(white), atol=1e-12)  # innovations know the past only


def test_the_restricted_likelihood_is_that_of_the_dense_covariance() -> None:
    record, model = oscillator(40), noise_model()
    one = columns_of(record, 1, model)
    inverse = np.linalg.inv(dense_covariance(record, model))
    e = one.residual.ravel()
    f = np.concatenate([one.shared, one.own], axis=2).reshape(80, 3)
    # own unknowns are scaled so that one moves the outputs by their spread, and that is its prior's deviation
    f[:, 2] /= np.sqrt(np.mean(np.sum((one.own[:, :, 0] / SPREAD) ** 2, axis=1)))
    normal = f.T @ inverse @ f
    normal[2, 2] += 1.0
    right = f.T @ inverse @ e
    expected = (
        -0.5 * (e @ inverse @ e - right @ np.linalg.solve(normal, right))
        + 0.5 * np.linalg.slogdet(inverse)[1]
        - 0.5 * np.linalg.slogdet(normal)[1]
    )
    assert restricted_log_likelihood([one], model, NO_PRIOR, NO_OFFSET) == pytest.approx(expected, abs=1e-6)


def test_another_residual_under_the_same_noise_and_derivatives_needs_no_other_filter() -> None:
    model, prior = noise_model(), (NO_PRIOR, NO_OFFSET)
    one = columns_of(oscillator(40), 1, model)
    other = replace(one, residual=one.residual**2)
    there = one.filtered(model).with_residual(other.residual)
    expected = restricted_log_likelihood([other], model, *prior)
    assert restricted_log_likelihoods([there], [prior]) == [pytest.approx(expected, abs=1e-9)]


@pytest.mark.parametrize("how", FORCES)
def test_the_likeliest_course_of_a_force_is_that_of_the_dense_covariance(how: dict[str, Any]) -> None:
    """Of both processes together: what they change in the outputs is their part of the covariance, times Σ⁻¹ e."""
    record, model = oscillator(60), noise_model(**how)
    residual = np.random.default_rng(5).standard_normal((60, 2)) * SPREAD
    weighting = innovation_weighting(record, model)
    courses = weighting.courses(weighting(residual))
    changed = record.response(courses[:, :1], np.array([0]))[:, :, 0]
    changed[:, 0] += courses[:, 1]
    dense = dense_covariance(record, model)
    latent = dense - np.kron(np.eye(60), model.noise_covariance())
    np.testing.assert_allclose(changed.ravel(), latent @ np.linalg.solve(dense, residual.ravel()), atol=1e-9)


@pytest.mark.parametrize("how", FORCES)
@pytest.mark.parametrize("left_out", [slice(0, 0), slice(20, 31)])
def test_the_score_is_the_slope_of_the_likelihood(left_out: slice, how: dict[str, Any]) -> None:
    """With correlated noise, a force, a drift, a second record, and unknowns of both sorts."""
    mask = np.zeros(60, dtype=bool)
    mask[left_out] = True
    record, model = oscillator(60).without(mask), noise_model(**how)
    records = [replace(columns_of(record, seed, model), record=record) for seed in (1, 2)]
    prior, offset = np.array([0.01, np.inf]), np.array([0.02, 0.0])
    value, score = restricted_score(records, model, prior, offset)
    assert value == restricted_log_likelihood(records, model, prior, offset)

    def slope(what: str, k: int) -> float:
        def likelihood(factor: float) -> float:
            if what == "noise":
                noise = tuple(s * factor if i == k else s for i, s in enumerate(model.noise))
                changed = replace(model, noise=noise)
            else:
                processes = list(model.processes)
                processes[k] = replace(processes[k], **{what: getattr(processes[k], what) * factor})
                changed = replace(model, processes=tuple(processes))
            return restricted_log_likelihood(records, changed, prior, offset)

        return (likelihood(np.exp(1e-4)) - likelihood(np.exp(-1e-4))) / 2e-4

    for what in ("noise", "std", "memory", "frequency"):
        expected = [slope(what, k) for k in range(2)]
        np.testing.assert_allclose(getattr(score, what), expected, rtol=1e-5, atol=1e-5, err_msg=what)


def test_a_covariance_that_is_not_positive_has_no_likelihood() -> None:
    one = columns_of(oscillator(40), 1, noise_model())
    impossible = replace(noise_model(), correlation=np.array([[1.0, 1.5], [1.5, 1.0]]), processes=())
    assert restricted_log_likelihood([one], impossible, NO_PRIOR, NO_OFFSET) == -np.inf
    assert restricted_score([one], impossible, NO_PRIOR, NO_OFFSET)[0] == -np.inf


def test_an_own_unknown_that_the_record_hardly_determines_does_not_change_the_likelihood() -> None:
    """With dry friction a record soon no longer depends on the initial speed."""
    record, model = oscillator(40), noise_model()
    one = columns_of(record, 1, model)
    values = []
    for share in (1e-6, 1e-9, 1e-12):
        hardly = one.own + share * np.sin(11.0 * record.time)[:, None, None]
        own = np.concatenate([one.own, hardly], axis=2)
        values.append(restricted_log_likelihood([replace(one, own=own)], model, NO_PRIOR, NO_OFFSET))
    np.testing.assert_allclose(values, values[-1], atol=1e-3)


def test_the_order_of_records_does_not_matter() -> None:
    record, model = oscillator(60), noise_model()
    records = [columns_of(record, seed, model) for seed in (1, 2, 3)]
    forwards, backwards = (restricted_log_likelihood(r, model, NO_PRIOR, NO_OFFSET) for r in (records, records[::-1]))
    assert forwards == pytest.approx(backwards, abs=1e-8)


def test_the_order_of_outputs_does_not_matter() -> None:
    record, model = oscillator(60), noise_model()
    one = columns_of(record, 1, model)
    turned = replace(
        one,
        record=replace(record, c=np.ascontiguousarray(record.c[:, ::-1]), d=np.ascontiguousarray(record.d[:, ::-1])),
        residual=one.residual[:, ::-1],
        shared=one.shared[:, ::-1],
        own=one.own[:, ::-1],
        spread=SPREAD[::-1],
    )
    force, drift = model.processes
    other = NoiseModel(
        noise=model.noise[::-1], processes=(force, replace(drift, channel=1)), correlation=model.correlation
    )
    assert restricted_log_likelihood([turned], other, NO_PRIOR, NO_OFFSET) == pytest.approx(
        restricted_log_likelihood([one], model, NO_PRIOR, NO_OFFSET), abs=1e-8
    )


def test_differences_do_not_depend_on_units() -> None:
    record, model = oscillator(60), noise_model()
    one = columns_of(record, 1, model)
    unit = np.array([1000.0, 1.0])  # the position in millimetres
    scaled = replace(
        one,
        record=replace(record, c=record.c * unit[:, None], d=record.d * unit[:, None]),
        residual=one.residual * unit,
        shared=one.shared * unit[:, None],
        own=one.own * unit[:, None],
        spread=SPREAD * unit,
    )

    def in_millimetres(m: NoiseModel) -> NoiseModel:
        force, drift = m.processes
        return replace(
            m, noise=(1000.0 * m.noise[0], m.noise[1]), processes=(force, replace(drift, std=1000.0 * drift.std))
        )

    other = noise_model(force=0.3, drift=0.001)
    plain = [restricted_log_likelihood([one], m, NO_PRIOR, NO_OFFSET) for m in (model, other)]
    milli = [restricted_log_likelihood([scaled], in_millimetres(m), NO_PRIOR, NO_OFFSET) for m in (model, other)]
    assert plain[0] - plain[1] == pytest.approx(milli[0] - milli[1], abs=1e-7)


def test_a_record_of_sensor_noise_may_be_split_in_two() -> None:
    """With a latent force the second half starts anew and knows less; without one nothing is lost."""
    record = oscillator(60)
    model = replace(noise_model(), processes=())
    whole = replace(columns_of(record, 1, noise_model()), own=np.zeros((60, 2, 0)))
    halves = [
        RecordColumns(
            record=replace(
                record,
                time=record.time[part],
                observed=record.observed[part],
                left_out=record.left_out[part],
                phi=record.phi[:29],
                gamma0=record.gamma0[:29],
                gamma1=record.gamma1[:29],
                c=record.c[part],
                d=record.d[part],
            ),
            residual=whole.residual[part],
            shared=whole.shared[part],
            own=whole.own[part],
            spread=SPREAD,
        )
        for part in (slice(0, 30), slice(30, 60))
    ]
    together, apart = (restricted_log_likelihood(r, model, NO_PRIOR, NO_OFFSET) for r in ([whole], halves))
    assert together == pytest.approx(apart, abs=1e-8)


def test_the_noise_of_a_record_is_estimated() -> None:
    record, truth = oscillator(1500), noise_model(drift=0.0)
    rng = np.random.default_rng(5)
    # by simulation, not by the filter under test
    decay = np.exp(-STEP / 0.3)
    force, x = np.zeros(1500), np.zeros(2)
    force[0] = 0.8 * rng.standard_normal()
    outputs = np.zeros((1500, 2))
    for k in range(1499):
        force[k + 1] = decay * force[k] + 0.8 * np.sqrt(1.0 - decay**2) * rng.standard_normal()
        x = record.phi[k] @ x + record.gamma0[k, :, 0] * force[k] + record.gamma1[k, :, 0] * force[k + 1]
        outputs[k + 1] = x
    outputs += rng.standard_normal((1500, 2)) @ np.linalg.cholesky(truth.noise_covariance()).T
    one = without_unknowns(record, outputs)
    memories = (0.04, 0.3, 3.0)
    candidates = [Process(where="spring", source=0, channel=-1, memory=m, std=0.1) for m in memories]
    candidates += [Process(where="position", source=-1, channel=0, memory=m, std=0.003) for m in memories[1:]]
    model, _ = fit_noise([one], np.zeros(0), np.zeros(0), np.array([1e-3, 1e-2]), candidates)
    assert model.noise[0] == pytest.approx(0.003, rel=0.1)
    assert model.noise[1] == pytest.approx(0.02, rel=0.1)
    of_force = [q for q in model.processes if q.where == "spring"]
    assert np.sqrt(sum(q.std**2 for q in of_force)) == pytest.approx(0.8, rel=0.25)
    assert model.correlation is not None
    assert model.correlation[0, 1] == pytest.approx(0.4, abs=0.1)


def test_white_noise_gets_no_latent_force() -> None:
    """In 40 records of white noise alone a process is added in at most two: it must be worth four nats."""
    record = oscillator(200)
    candidates = [Process(where="spring", source=0, channel=-1, memory=m, std=0.1) for m in (0.04, 0.4)]
    added = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal((200, 2)) * np.array([0.003, 0.02])
        one = without_unknowns(record, noise)
        model, _ = fit_noise([one], np.zeros(0), np.zeros(0), np.array([1e-3, 1e-2]), candidates)
        added += bool(model.processes)
    assert added <= 2


def test_a_process_that_no_longer_earns_its_price_is_taken_out() -> None:
    """A neighbour's force and drift, in white noise: the fit begins at their sizes, and ends without them."""
    record = oscillator(400)
    noise = np.random.default_rng(5).standard_normal((400, 2)) * np.array([0.003, 0.02])
    one, floor = without_unknowns(record, noise), np.array([1e-3, 1e-2])
    start = replace(noise_model(), correlation=None)

    def fitted(reduce: bool) -> tuple[NoiseModel, float]:
        return fit_noise([one], np.zeros(0), np.zeros(0), floor, [], start, grow=False, reduce=reduce)

    (reduced, likelihood), (kept, before) = fitted(True), fitted(False)
    assert len(kept.processes) == 2
    assert reduced.processes == ()
    assert likelihood > before - 2 * PROCESS_PRICE
    np.testing.assert_allclose(reduced.noise, [0.003, 0.02], rtol=0.1)  # of 400 samples: 1/√800 is 3.5 %


def test_a_process_that_is_needed_stays() -> None:
    record, model = oscillator(400), noise_model()
    one = columns_of(record, 8, model)
    fitted, _ = fit_noise([one], NO_PRIOR, NO_OFFSET, np.array([1e-3, 1e-2]), [], model, grow=False)
    assert "spring" in [q.where for q in fitted.processes]


def test_samples_that_are_left_out_do_not_count() -> None:
    """The likelihood is that of the dense covariance of the samples that remain."""
    record, model = oscillator(60), noise_model()
    left_out = np.zeros(60, dtype=bool)
    left_out[20:31] = True
    partly = record.without(left_out)
    weighting = innovation_weighting(partly, model)
    rng = np.random.default_rng(3)
    y = rng.standard_normal((60, 2))
    white = weighting(y)
    assert not np.any(white[left_out])
    kept = np.repeat(~left_out, 2)
    covariance = dense_covariance(record, model)[np.ix_(kept, kept)]
    flat = y.ravel()[kept]
    assert np.sum(white**2) == pytest.approx(flat @ np.linalg.solve(covariance, flat), rel=1e-9)
    assert weighting.log_det == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1], rel=1e-9)
    other = y.copy()
    other[left_out] += 100.0
    np.testing.assert_array_equal(weighting(other), white)
    columns = columns_of(record, 3, model)
    without = replace(columns, record=partly)
    changed = replace(without, residual=columns.residual + 50.0 * left_out[:, None])
    values = [restricted_log_likelihood([c], model, NO_PRIOR, NO_OFFSET) for c in (without, changed)]
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    assert len(without.innovations(model)[0]) == 60 - 11


def test_a_force_at_a_standstill_acts_only_there() -> None:
    record = oscillator(40)
    still = np.zeros(40)
    still[10:16] = 1.0
    more = record.with_modulated([0], [still])
    assert more.gamma0.shape == (39, 2, 2)
    np.testing.assert_array_equal(more.gamma0[:, :, 1], record.gamma0[:, :, 0] * still[:-1, None])
    np.testing.assert_array_equal(more.gamma1[:, :, 1], record.gamma1[:, :, 0] * still[1:, None])
    force = Process(where="spring", source=1, channel=-1, memory=0.3, std=20.0, at_standstill=True)
    quiet = NoiseModel(noise=(0.003, 0.02))
    loud = replace(quiet, processes=(force,))
    before, after = (innovation_weighting(more, m).root for m in (quiet, loud))
    np.testing.assert_allclose(after[:10], before[:10], rtol=1e-12)
    assert np.all(after[12:16, 1, 1] < 0.5 * before[12:16, 1, 1]), "speeds are less certain there"


def test_a_state_that_grows_at_once_loses_nothing_of_the_covariance() -> None:
    """Where dry friction lets go, a state of the linearised machine grows by 1e5 and more from one sample to the next.

    If both states grow ten times as much, so do the deviations of the two outputs that tell of them, and nothing else.
    """

    def log_det(growth: float) -> float:
        record = oscillator(60)
        phi = record.phi.copy()
        phi[20] *= growth
        return innovation_weighting(replace(record, phi=phi), noise_model()).log_det

    for growth in (1e7, 1e8, 1e10):
        assert log_det(10.0 * growth) - log_det(growth) == pytest.approx(2.0 * np.log(10.0), abs=1e-3)
