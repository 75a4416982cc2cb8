"""Joint scores of two candidates, against least squares; what luck gives the best of all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.masking_pairs import APART, PairScores
from discrepancy.statistics.scan import scan

N, DT, BLOCKS = 300, 0.01, 8


def columns(rng, away: float):
    """Return two waves that are opposite but for a share, and a third and a fourth of two columns that are neither."""
    t = np.arange(N) * DT
    phase = rng.uniform(0.0, 2.0 * np.pi, (BLOCKS, 3))
    slow = [np.sin(2.0 * np.pi * 0.8 * t + p[0])[:, None, None] for p in phase]
    fast = [np.sin(2.0 * np.pi * 3.0 * t + p[1])[:, None, None] for p in phase]
    other = [np.sin(2.0 * np.pi * 1.7 * t + p[2])[:, None, None] for p in phase]
    two = [np.concatenate([rng.standard_normal((N, 1, 1)), o**3], axis=2) for o in other]
    return slow, [-s + away * f for s, f in zip(slow, fast, strict=True)], other, two


def scanned(seed=0, sizes=(0.0, 0.0), away=0.2, one_sided=(False, False), noise=1.0):
    rng = np.random.default_rng(seed)
    a, b, other, two = columns(rng, away)
    e = [sizes[0] * x[:, :, 0] + sizes[1] * y[:, :, 0] for x, y in zip(a, b, strict=True)]
    e = [x + noise * rng.standard_normal(x.shape) for x in e]
    candidates = [
        Candidate(kind="delay", where="input", sensitivities=(tuple(a),), one_sided=one_sided[0]),
        Candidate(kind="gain", where="loop", sensitivities=(tuple(b),), one_sided=one_sided[1]),
        Candidate(kind="wave", where="guide", sensitivities=(tuple(other),)),
        Candidate(kind="two", where="guide", sensitivities=(tuple(two),), strengths=("first", "second")),
    ]
    found = scan(
        Residual(e, DT, ("y",)),
        Sensitivities(names=[], blocks=[np.zeros((N, 1, 0))] * BLOCKS),
        candidates,
        whiten=False,
        noise_floor=[noise],
        seed=seed,
        draws=100,
    )
    return found, e, (a, b, other, two)


def partners_of_delay(scores):
    return {n for p in scores.with_partners("delay@input") for n in p.names} - {"delay@input"}


def test_joint_gain_and_amplitudes_are_those_of_least_squares():
    found, e, (a, b, other, two) = scanned(sizes=(2.0, 2.0))
    y = np.concatenate(e)[:, 0]
    whole = {"delay@input": a, "gain@loop": b, "wave@guide": other, "two@guide": two}
    pairs = PairScores(found).with_partners("two@guide") + PairScores(found).with_partners("delay@input")
    assert len(pairs) == 6
    for pair in pairs:
        A = np.concatenate([np.concatenate(whole[n])[:, 0] for n in pair.names], axis=1)
        x, left, *_ = np.linalg.lstsq(A, y)
        gain = (float(y @ y) - float(left[0])) / np.mean(y**2) / found.typical_inflation  # whitened by its rms
        assert pair.gain == pytest.approx(gain, rel=1e-6)
        assert np.concatenate([r.expected_strength for r in pair.rows]) == pytest.approx(x, rel=1e-6)


def test_two_effects_that_cancel_are_the_masking_pair():
    found, *_ = scanned(sizes=(2.0, 2.0), away=0.1)
    assert all(r.p_value > 0.02 for r in found.rows)  # nothing shows by itself
    scores = PairScores(found)
    best = scores.masking()[0]
    assert set(best.names) == {"delay@input", "gain@loop"}
    assert best.gain > 4.0 * sum(best.alone) > 0.0
    sizes = {r.name: float(r.expected_strength[0]) for r in best.rows}
    # The shared part is known badly: ± 0.29 each, by 1/(0.1·√(N·BLOCKS/2)) with noise 1.
    assert sizes == {n: pytest.approx(2.0, abs=0.9) for n in best.names}
    assert scores.p_value(best.gain, seed=1) < 1e-3


def test_effects_that_cannot_act_the_other_way_round_are_no_pair():
    found, *_ = scanned(sizes=(2.0, 2.0), one_sided=(True, True))
    assert set(PairScores(found).masking()[0].names) == {"delay@input", "gain@loop"}
    found, *_ = scanned(sizes=(-2.0, -2.0), one_sided=(True, False))
    assert all(set(p.names) != {"delay@input", "gain@loop"} for p in PairScores(found).masking())


def test_excluded_pairs_are_left_out():
    found, *_ = scanned(sizes=(2.0, 2.0))
    assert "gain@loop" in partners_of_delay(PairScores(found))
    scores = PairScores(found, lambda a, b: "gain" in (a.kind, b.kind))
    assert partners_of_delay(scores) == {"two@guide", "wave@guide"}
    assert all("gain@loop" not in p.names for p in scores.masking())


def test_nearly_identical_effects_are_no_pair():
    for away, is_pair in ((0.5 * APART**0.5, False), (3.0 * APART**0.5, True)):
        found, *_ = scanned(sizes=(2.0, 2.0), away=away)
        assert ("gain@loop" in partners_of_delay(PairScores(found))) is is_pair


def test_effects_that_add_up_are_no_masking_pair():
    found, *_ = scanned(sizes=(2.0, 0.0))
    assert not [p for p in PairScores(found).masking() if p.gain > 20.0]


def test_chance_gives_a_p_value_below_a_tenth_in_about_a_tenth_of_the_cases():
    trials, hits = 60, 0
    for seed in range(trials):
        scores = PairScores(scanned(seed=100 + seed, noise=1.0)[0])
        pairs = scores.masking()
        hits += bool(pairs) and scores.p_value(pairs[0].gain, seed=seed) < 0.1
    # 6 expected; 13 or more of 60 have a chance of 0.8 % if the rate is a tenth
    assert hits <= 12
