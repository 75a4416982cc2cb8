"""Block-sandwich intervals: coverage under a coloured residual, units, number of blocks."""

import numpy as np
import pytest

from estimation.fit.intervals import block_sandwich, measure_coverage, split_blocks


def test_intervals_cover_with_a_coloured_residual():
    robust, white = measure_coverage(8, trials=200)
    # Bar of the method: 90 to 98 %. 200 trials of three parameters: standard error about 1.3 %.
    assert 0.90 < robust < 0.985
    assert white < 0.5


def test_interval_is_invariant_to_units_and_needs_blocks():
    rng = np.random.default_rng(0)
    J = [rng.standard_normal((50, 2)) for _ in range(6)]
    r = [rng.standard_normal(50) for _ in range(6)]
    a = block_sandwich(J, r)
    b = block_sandwich([j * [1e6, 1e-6] for j in J], r)
    np.testing.assert_allclose(a.std, b.std * [1e6, 1e-6], rtol=1e-6)
    assert a.dof == 5
    with pytest.raises(ValueError, match="two blocks"):
        block_sandwich(J[:1], r[:1])
    assert len(split_blocks([np.zeros((100, 2)), np.zeros((50, 2))], 6)) == 6


def test_blocks_of_many_unknowns_take_the_work_of_their_own(monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(0)
    common, own, windows, rows = 2, 3, 40, 20
    unknowns = common + own * windows
    jacobians, columns, whole = [], [], []
    for k in range(windows):
        columns.append(np.r_[0:common, common + own * k : common + own * (k + 1)])
        jacobians.append(rng.standard_normal((rows, common + own)))
        whole.append(np.zeros((rows, unknowns)))
        whole[-1][:, columns[-1]] = jacobians[-1]
    measured = rng.standard_normal(rows * windows)
    error = measured - np.concatenate(whole) @ np.linalg.lstsq(np.concatenate(whole), measured, rcond=None)[0]
    residuals = np.split(error, windows)
    expected = block_sandwich(whole, residuals).std[:common]
    sizes: list[int] = []
    svd = np.linalg.svd

    def counted(matrix: np.ndarray):
        sizes.append(len(matrix))
        return svd(matrix)

    monkeypatch.setattr(np.linalg, "svd", counted)
    found = block_sandwich(jacobians, residuals, columns=columns).std[:common]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert max(sizes) == common + own
