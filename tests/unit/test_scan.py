"""Projection, scores, spectra, p-values and held-out gains against what they must equal."""

import numpy as np
import pytest

from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities, with_candidate
from discrepancy.statistics.null_distribution import P_FLOOR, tail_p
from discrepancy.statistics.projection import Layout, project
from discrepancy.statistics.scan import held_out_gain, scan
from discrepancy.statistics.score import make_scorer, prepare_columns
from discrepancy.statistics.whitening import identity
from discrepancy.validation import linear_axes


def small(seed=0, n=(120, 90), p=3):
    rng = np.random.default_rng(seed)
    e = [rng.standard_normal((m, 2)) for m in n]
    F = [rng.standard_normal((m, 2, p)) for m in n]
    Z = [rng.standard_normal((m, 2, 1)) for m in n]
    return rng, e, F, Z


def test_projection_equals_augmented_least_squares():
    _, e, F, _ = small()
    std, off = np.array([0.1, np.inf, 0.3]), np.array([0.05, 0.0, -0.2])
    nuis = [np.ones((120, 2, 1)), None]
    sens = Sensitivities(names=["a", "b", "c"], blocks=F, prior_std=std, prior_offset=off, nuisance=nuis)
    w = identity([1.0, 1.0], ["x", "y"], 0.01)
    lay = Layout((120, 90), 2, 2)
    proj = project(w, sens, lay)
    got = proj.remove(lay.stack(w, e, np.array([0.5, -0.2 / 0.3])))
    # The same by one dense least squares with prior rows and the nuisance as a fourth column.
    A = np.zeros((lay.n_rows, 4))
    A[: lay.n_data, :3] = np.concatenate([f.reshape(-1, 3) for f in F])
    A[:240, 3] = 1.0
    A[lay.n_data, 0], A[lay.n_data + 1, 2] = 1 / 0.1, 1 / 0.3
    b = np.concatenate([np.concatenate([x.reshape(-1) for x in e]), [0.5, -0.2 / 0.3]])
    np.testing.assert_allclose(got, b - A @ np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-10)


def test_score_equals_the_drop_of_a_full_fit():
    _, e, F, Z = small(1)
    sens = Sensitivities(names=["a", "b", "c"], blocks=F)
    w = identity([1.0, 1.0], ["x", "y"], 0.01)
    lay = Layout((120, 90), 2)
    proj = project(w, sens, lay)
    cols = prepare_columns([(0, 0, False, lay.stack(w, Z))], proj)
    scorer = make_scorer(cols, proj, 0.01)
    r = proj.remove(lay.stack(w, e))
    s = scorer(r[:, None])
    A = np.concatenate([f.reshape(-1, 3) for f in F])
    B = np.column_stack([A, np.concatenate([z.reshape(-1) for z in Z])])
    y = np.concatenate([x.reshape(-1) for x in e])
    small_fit, full = (np.linalg.lstsq(M, y, rcond=None) for M in (A, B))
    assert s.score[0, 0] == pytest.approx(float(small_fit[1][0] - full[1][0]), rel=1e-9)
    assert scorer.strength(0, s.amplitude[:, 0])[0][0] == pytest.approx(full[0][3], rel=1e-9)


def test_a_law_of_two_strengths_is_scored_though_a_parameter_does_what_both_together_do():
    """Friction that differs with direction, beside a friction that the records know ten thousand times better."""
    _, e, F, _ = small(4)
    forward = [f[:, :, :1] * (np.arange(len(f)) % 2)[:, None, None] for f in F]
    backward = [f[:, :, :1] - g for f, g in zip(F, forward, strict=True)]
    both = [np.concatenate([a, b], axis=2) for a, b in zip(forward, backward, strict=True)]
    size = float(np.sqrt(sum(np.sum(f[:, :, 0] ** 2) for f in F)))
    stated = np.array([1e4 / size, np.inf, np.inf])
    sens = Sensitivities(names=["a", "b", "c"], blocks=F, prior_std=stated, prior_offset=np.zeros(3))
    w = identity([1.0, 1.0], ["x", "y"], 0.01)
    lay = Layout((120, 90), 2, 1)
    proj = project(w, sens, lay)
    cols = prepare_columns([(0, 0, False, lay.stack(w, both))], proj)
    assert not cols.dropped
    scorer = make_scorer(cols, proj, 0.01)
    strength = scorer.strength(0, scorer(proj.remove(lay.stack(w, e))[:, None]).amplitude[:, 0])[0]
    A = np.zeros((lay.n_rows, 5))
    A[: lay.n_data, :3] = np.concatenate([f.reshape(-1, 3) for f in F])
    A[: lay.n_data, 3:] = np.concatenate([z.reshape(-1, 2) for z in both])
    A[-1, 0] = 1.0 / stated[0]
    full = np.linalg.lstsq(A, lay.stack(w, e), rcond=1e-15)[0]
    assert strength[0] - strength[1] == pytest.approx(full[3] - full[4], rel=1e-6)


def test_lambda_is_one_for_white_noise_on_average():
    rng, _, F, Z = small(2, n=(400, 300))
    sens = Sensitivities(names=["a", "b", "c"], blocks=F)
    w = identity([1.0, 1.0], ["x", "y"], 0.01)
    lay = Layout((400, 300), 2)
    proj = project(w, sens, lay)
    slow = [np.cumsum(z, axis=0) for z in Z]
    cols = prepare_columns([(0, 0, False, lay.stack(w, Z)), (1, 0, False, lay.stack(w, slow))], proj)
    scorer = make_scorer(cols, proj, 0.01)
    E = proj.remove(rng.standard_normal((lay.n_rows, 400)))
    lam = scorer(E).inflation
    # The slow column has about ten degrees of freedom: standard error of the mean of 400 is sqrt(2/10/400) =
    # 0.022.
    np.testing.assert_allclose(lam.mean(axis=1), 1.0, atol=0.08)


def test_lambda_follows_the_noise_where_the_candidate_acts():
    rng = np.random.default_rng(3)
    n = 2000
    t = np.arange(n) * 0.01
    slow, fast = np.sin(2 * np.pi * 0.3 * t), np.sin(2 * np.pi * 20 * t)
    w = identity([1.0], ["x"], 0.01)
    lay = Layout((n,), 1)
    proj = project(w, Sensitivities(names=[], blocks=[np.zeros((n, 1, 0))]), lay)
    cols = prepare_columns([(0, 0, False, slow[:, None]), (1, 0, False, fast[:, None])], proj)
    scorer = make_scorer(cols, proj, 0.01)
    from scipy.signal import lfilter

    E = lfilter([1.0], [1.0, -0.9], rng.standard_normal((n + 200, 300)), axis=0)[200:]
    s = scorer(E)
    # AR(1) with 0.9: spectrum 1/|1 − 0.9 exp(−iω)|².
    want = [1 / abs(1 - 0.9 * np.exp(-2j * np.pi * f * 0.01)) ** 2 for f in (0.3, 20.0)]
    np.testing.assert_allclose(s.inflation.mean(axis=1)[1], max(want[1], 0.5), rtol=0.15)  # floor, band of 12 %
    np.testing.assert_allclose(s.inflation.mean(axis=1)[0], want[0], rtol=0.15)


def test_two_amplitudes_and_signs():
    rng = np.random.default_rng(4)
    n = 400
    z = rng.standard_normal((n, 1, 2))
    w = identity([1.0], ["x"], 0.01)
    lay = Layout((n,), 1)
    proj = project(w, Sensitivities(names=[], blocks=[np.zeros((n, 1, 0))]), lay)
    Z = lay.stack(w, [z])
    cols = prepare_columns([(0, 0, True, Z)], proj)
    scorer = make_scorer(cols, proj, 0.01)
    E = np.column_stack([Z @ [1.0, 2.0], Z @ [1.0, -2.0], Z @ [-1.0, -2.0]])
    s = scorer(E)
    assert s.score[0, 0] == pytest.approx(float(E[:, 0] @ E[:, 0]))
    raw = scorer.strength(0, s.amplitude[:, 1])[0]
    assert raw[1] == pytest.approx(0.0, abs=1e-9)
    assert raw[0] == pytest.approx(max(0.0, float(Z[:, 0] @ E[:, 1] / (Z[:, 0] @ Z[:, 0]))))
    assert s.score[0, 2] == pytest.approx(0.0, abs=1e-9)


def test_tail_p_counts_then_extrapolates_and_has_a_floor():
    rng = np.random.default_rng(5)
    draws = rng.exponential(size=400)
    assert tail_p(draws, np.array([0.0]))[0] == 1.0
    assert tail_p(draws, np.array([2.0]))[0] == pytest.approx((1 + np.sum(draws >= 2)) / 401)
    far = tail_p(draws, np.array([12.0, 1e4]))
    # The true tail is exp(−12). The base of the extrapolation is a sample quantile of 10 % with a relative
    # error of 15 %, the scale is an upper limit: between half and, over nine scales, a few hundred times the
    # truth.
    assert 0.5 * np.exp(-12.0) < far[0] < 300 * np.exp(-12.0)
    assert far[1] == P_FLOOR


def axis_case(hidden=(), n_rec=3, disturbance="ar2", seed=11):
    rng = np.random.default_rng(seed)
    axis = linear_axes.make_axis(rng, n_rec, duration=4.0)
    return axis, linear_axes.make_case(axis, disturbance, rng, hidden)


def test_refusals_say_why():
    _, case = axis_case()
    shapes = [b.shape for b in case.residual.blocks]
    dead = Candidate(kind="dead", where="x", sensitivities=(tuple(np.zeros((*s, 1)) for s in shapes),))
    twin = Candidate(kind="twin", where="x", sensitivities=(tuple(b[:, :, :1] for b in case.sensitivities.blocks),))
    sens = Sensitivities(names=case.sensitivities.names, blocks=case.sensitivities.blocks)
    r = scan(case.residual, sens, [dead, twin], draws=50)
    assert "not excited" in r.refused["dead@x"]
    assert "imitate" in r.refused["twin@x"]
    assert not r.nothing_missing
    assert "these would not be seen" in r.verdict


def test_same_seed_same_answer_and_table():
    axis, case = axis_case()
    cands = linear_axes.candidates(axis)
    a, b = (scan(case.residual, case.sensitivities, cands, draws=60, seed=3) for _ in range(2))
    assert a.to_frame().equals(b.to_frame())
    assert set(a.to_frame()["kind"]) >= {c.kind for c in cands}
    assert "visible" in repr(a)


def test_exact_tie_is_named_with_its_other_kind():
    hidden = [("constant_force", {}, [40.0])]
    axis, case = axis_case(hidden)
    cands = [c for c in linear_axes.candidates(axis) if c.kind in ("constant_force", "linear_stiffness")]
    copy = Candidate(
        kind="tilted_guide", where="guide", sensitivities=tuple(tuple(2 * b for b in s) for s in cands[0].sensitivities)
    )
    r = scan(case.residual, case.sensitivities, [*cands, copy], draws=100)
    assert r.ties is not None
    assert set(r.ties.names) == {"constant_force@guide", "tilted_guide@guide"}
    assert r.ties.ambiguous
    assert r.ties.other_kind[0].why == "exact"


def test_after_the_effect_is_in_it_is_no_longer_missing():
    hidden = [("stribeck_friction", {"speed": 0.04}, [40.0])]
    axis, case = axis_case(hidden)
    cands = linear_axes.candidates(axis)
    r = scan(case.residual, case.sensitivities, cands, draws=100)
    assert r.best is not None
    assert r.best.kind == "stribeck_friction"
    assert abs(r.best.expected_strength[0] - 40.0) < 4 * r.best.standard_error[0]
    best = next(c for c in cands if c.name == r.best.name)
    shape = [dict(s) for s in best.shapes].index(r.best.shape)
    again = scan(case.residual, with_candidate(case.sensitivities, best, shape), cands, draws=100)
    assert again.best is None


def test_faults_are_collected():
    ok = np.zeros((20, 1))
    with pytest.raises(ValueError, match=r"block 1.*not finite"):
        Residual([ok, np.full((20, 1), np.nan)], 0.1, ["a"])
    with pytest.raises(ValueError, match=r"at least 16.*|dt must be positive"):
        Residual([np.zeros((5, 1))], 0.1, ["a"])
    with pytest.raises(ValueError, match="prior_std"):
        Sensitivities(names=["a"], blocks=[np.zeros((20, 1, 1))], prior_std=[0.0])
    res = Residual([ok], 0.1, ["a"])
    bad = Candidate(kind="k", where="w", sensitivities=((np.zeros((19, 1, 1)),),))
    with pytest.raises(ValueError, match=r"k@w.*do not match"):
        scan(res, Sensitivities(names=[], blocks=[np.zeros((20, 1, 0))]), [bad])
    good = Candidate(kind="k", where="w", sensitivities=((np.zeros((20, 1, 1)),),))
    with pytest.raises(ValueError, match="given 2 times"):
        scan(res, Sensitivities(names=[], blocks=[np.zeros((20, 1, 0))]), [good, good])


def test_a_point_that_only_one_block_reaches_does_not_count_against_a_curve():
    """Of two columns the second acts in the last of eight blocks, and hardly in the others."""
    rng = np.random.default_rng(3)
    layout, n = Layout((200,) * 8, 1), 1600
    Z = np.zeros((n, 2))
    Z[:, 0] = np.sin(np.arange(n))
    Z[:1400, 1], Z[1400:, 1] = 1e-4 * rng.standard_normal(1400), rng.standard_normal(200)
    Z = np.linalg.qr(Z)[0]
    e = Z @ np.array([30.0, 20.0]) + rng.standard_normal(n)
    # the others determine the first amplitude: 30²/2; none determines the second, which costs next to nothing
    assert held_out_gain(Z, e, layout, 1.0) == pytest.approx(450.0, rel=0.25)


def test_a_disturbance_of_one_record_is_not_predicted_by_the_others():
    rng = np.random.default_rng(2)
    count, n = 3, 400
    layout = Layout((n,) * count, 1)
    shape = np.tile(np.sin(np.linspace(0.0, np.pi, n)), count)
    Z = (shape / np.linalg.norm(shape))[:, None]
    once = np.concatenate([2.0 * shape[:n], np.zeros((count - 1) * n)])  # a disturbance that lasts one record
    alone = held_out_gain(Z, once + rng.standard_normal(count * n), layout, 1.0)
    always = held_out_gain(Z, 2.0 * shape + rng.standard_normal(count * n), layout, 1.0)
    assert alone < 0.0 < always
