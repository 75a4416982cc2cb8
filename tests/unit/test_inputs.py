"""Tables of inputs: interpolation in Python and in compiled code, delays, checks."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from multibody.compile.native import NativeFunction
from multibody.inputs.table import InputError, InputTable
from multibody.solvers.kernels.field import inputs_along
from multibody.solvers.problem import NativeProblem

TIMES = np.array([0.0, 0.1, 0.25, 0.5, 1.0, 1.1])


def three_kinds(delays=None):
    rng = np.random.default_rng(3)
    columns = {kind: rng.normal(size=TIMES.size) for kind in ("hold", "linear", "cubic")}
    return InputTable.from_columns(TIMES, columns, {kind: kind for kind in columns}, delays)


def compiled(table, t, p=(0.0,)):
    """Inputs and rates by the lookup that the solvers use."""
    nowhere = NativeFunction(name="none", python=lambda *a: None, arrays=4, compiled=True, _made=(0, None))
    field = NativeProblem(rhs=nowhere, p=np.array(p), table=table, n=1).field()
    out, rate = np.empty((len(t), table.n_inputs)), np.empty((len(t), table.n_inputs))
    inputs_along(t, out, rate, field.numbers)
    return out, rate


def test_values_at_and_between_samples():
    table = InputTable.from_columns([0.0, 1.0, 3.0], {"h": [1.0, 2.0, 5.0], "l": [1.0, 2.0, 5.0]}, {"h": "hold"})
    np.testing.assert_array_equal(table([0.0, 0.5, 1.0, 2.0, 3.0])[:, 0], [1.0, 1.0, 2.0, 2.0, 5.0])
    np.testing.assert_allclose(table([0.0, 0.5, 1.0, 2.0, 3.0])[:, 1], [1.0, 1.5, 2.0, 3.5, 5.0], rtol=1e-15)
    # Constant beyond both ends, and no slope there.
    np.testing.assert_array_equal(table([-9.0, 9.0]), [[1.0, 1.0], [5.0, 5.0]])
    np.testing.assert_array_equal(table.derivative([-9.0, 9.0]), np.zeros((2, 2)))
    assert table(0.5).shape == (2,)


def test_cubic_is_exact_for_a_parabola_and_smooth():
    parabola = InputTable.from_columns(TIMES, {"a": 1.0 - 2.0 * TIMES + 3.0 * TIMES**2}, "cubic")
    t = np.linspace(0.01, 1.09, 57)
    np.testing.assert_allclose(parabola(t)[:, 0], 1.0 - 2.0 * t + 3.0 * t**2, rtol=0, atol=1e-14)
    np.testing.assert_allclose(parabola.derivative(t)[:, 0], -2.0 + 6.0 * t, rtol=0, atol=1e-13)
    rough = three_kinds()
    for knot in TIMES[1:-1]:
        left, right = rough.derivative([knot - 1e-9, knot + 1e-9])[:, 2]
        # The second derivative is below 1e3 here, so that 2e-9 s change the slope by less than 1e-5.
        assert abs(left - right) < 1e-5


@pytest.mark.parametrize("order", [1, -1, 0])
def test_compiled_lookup_is_the_same(order):
    table = three_kinds({"linear": 0, "cubic": 0, "hold": 0})
    t = np.concatenate([np.linspace(-0.3, 1.6, 401), TIMES + 0.07])
    t = np.random.default_rng(5).permutation(t) if order == 0 else np.sort(t)[::order].copy()
    p = np.array([0.07])
    out, rate = compiled(table, t, p)
    np.testing.assert_allclose(out, table(t, p), rtol=0, atol=1e-14)
    np.testing.assert_allclose(rate, table.derivative(t, p), rtol=0, atol=1e-12)


def test_delay_shifts_in_time():
    table = three_kinds({"linear": 1})
    p = np.array([9.0, 0.2])
    np.testing.assert_array_equal(table(0.6, p)[1], three_kinds()(0.6 - 0.2)[1])
    np.testing.assert_array_equal(table(0.6, p)[2], three_kinds()(0.6)[2])
    with pytest.raises(InputError, match="'linear' is delayed by a parameter"):
        table(0.6)


def test_constants():
    table = InputTable.constant({"force": 3.0, "gain": 4.0})
    assert table.names == ("force", "gain")
    np.testing.assert_array_equal(table([-1.0, 0.0, 1.0]), [[3.0, 4.0]] * 3)
    np.testing.assert_array_equal(compiled(table, np.array([0.0, 5.0]))[0], [[3.0, 4.0]] * 2)
    assert table.largest_step() == np.inf
    assert InputTable.constant([]).n_inputs == 0


def test_largest_step_looks_only_where_something_happens():
    times = np.array([0.0, 1.0, 1.001, 2.0, 2.5, 3.0])
    table = InputTable.from_columns(times, {"a": [1.0, 1.0, 1.0, 1.0, 2.0, 2.0]})
    assert table.largest_step() == 0.5
    assert InputTable.from_columns(times, {"a": np.arange(6.0)}).largest_step() == pytest.approx(0.001)


def test_values_cannot_be_changed_from_outside_and_survive_pickling():
    given = np.ones((2, 1))
    table = InputTable(times=[0.0, 1.0], values=given)
    given[:] = 7.0
    assert table.values[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        table.values[0, 0] = 2.0
    copy = pickle.loads(pickle.dumps(three_kinds({"cubic": 0})))
    assert copy.interpolation == ("hold", "linear", "cubic")
    np.testing.assert_array_equal(copy(0.3, np.array([0.1])), three_kinds({"cubic": 0})(0.3, np.array([0.1])))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: InputTable(times=[0.0, 1.0, 1.0], values=np.ones((3, 1))),
            "do not increase: 1 s follows 1 s at row 2",
        ),
        (lambda: InputTable(times=[0.0, np.nan], values=np.ones((2, 1))), "time 1 is not finite"),
        (lambda: InputTable(times=[], values=np.ones((0, 1))), "non-empty"),
        (lambda: InputTable(times=[0.0], values=np.ones((2, 1))), "1 times, but values has the shape"),
        (lambda: InputTable(times=[0.0], values=np.ones((1, 2)), names=("a",)), "2 inputs but 1 names"),
        (lambda: InputTable(times=[0.0], values=np.ones((1, 2)), names=("a", "a")), "appear twice: a"),
        (
            lambda: InputTable(times=[0.0], values=np.ones((1, 1)), names=("a",), interpolation="spline"),
            "'a': interpolation 'spline' is unknown",
        ),
        (
            lambda: InputTable.from_columns([0.0, 1.0], {"force": [1.0]}),
            "'force' has 1 values, but there are 2",
        ),
        (lambda: InputTable.from_columns([0.0], {"a": 1.0}, {"b": "hold"}), "'b' is given an interpolation"),
        (lambda: InputTable.from_columns([0.0], {"a": 1.0}, "hold", {"b": 1}), "'b' is given a delay"),
    ],
)
def test_faults_are_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_all_faults_at_once():
    with pytest.raises(InputError) as caught:
        InputTable(
            times=[0.0, 0.0],
            values=[[np.nan, 1.0], [1.0, np.inf]],
            names=("force", "speed"),
            interpolation=("hold", "bezier"),
        )
    for words in ("'force' is not finite in 1 rows, first row 0", "'speed' is not finite", "bezier", "row 1"):
        assert words in str(caught.value)


@pytest.mark.parametrize("share", [3e-3, 3e-5])
def test_motions_far_below_the_tolerance_end_no_steps(share):
    times = np.arange(3001) * 1e-3
    slow = np.sin(2.0 * np.pi * 0.3 * times)
    ripple = share * np.sin(2.0 * np.pi * 60.0 * times)  # 17 samples to a period: not resolved finely
    ends = InputTable.from_columns(times, {"a": slow + ripple}).kernel_for(1e-3)["breaks"]
    longest = np.diff(np.append(np.append(0.0, ends), 3.0)).max()
    if share > 1e-3:
        assert longest < 0.5 / 60.0  # half a period of the ripple
    else:
        assert longest > 5.0 / 60.0


def test_a_spike_is_never_passed_over():
    times = np.arange(3001) * 1e-3
    for width in (1, 3, 8, 20, 60):
        values = np.sin(2.0 * np.pi * 0.3 * times)
        values[1500 : 1500 + width] += 0.05 * np.hanning(width + 2)[1:-1]
        ends = InputTable.from_columns(times, {"a": values}).kernel_for(1e-2)["breaks"]
        inside = (ends > 1.499 - 1e-9) & (ends < 1.5 + 1e-3 * width + 1e-9)
        assert np.count_nonzero(inside) >= 1, width
