"""Machine code from the subset does what plain Python does, and what numba makes of the same text."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from multibody.compile import native
from multibody.compile.calls import entry, inner, pointer, shift
from multibody.compile.emitter.kinds import Outside
from multibody.compile.emitter.program import Program
from multibody.compile.emitter.units import unit_of_text


def both(text: str, x, n: int = 1, p=(0.0,)) -> tuple[np.ndarray, np.ndarray]:
    """Return what compiled and plain Python write for the states x."""
    function = native.compile_text(text, "compiler", "rhs", 4)
    out, plain = np.full(n, -7.0), np.full(n, -7.0)
    x, p = np.array(x, dtype=float), np.array(p, dtype=float)
    function(0.5, x, np.zeros(1), p, out)
    function.python(0.5, x, np.zeros(1), p, plain)
    return out, plain


def rhs(*lines: str) -> str:
    return "import math\n\n\ndef rhs(t, x, u, p, dx):\n" + "".join(f"    {line}\n" for line in lines)


ARITHMETIC = rhs(
    "a = x[0]",
    "b = x[1]",
    "dx[0] = a + b * 3 - 1 / (1 + b * b)",
    "dx[1] = a % b if b != 0.0 else 0.0",
    "dx[2] = abs(a ** 3) + b ** 2",
    "dx[3] = (1.0 + a * a) ** -2",
    "dx[4] = min(a, b, 0.5)",
    "dx[5] = max(a, b)",
    "dx[6] = abs(a) - math.fabs(b)",
    "dx[7] = -a if a < b <= 1.0 else +b",
    "dx[8] = math.tanh(a) + math.atan2(a, b) + math.hypot(a, b)",
    "dx[9] = math.copysign(a, b) + math.floor(b)",
    "dx[10] = math.exp(-abs(a)) * math.sin(a) * math.cos(a)",
    "dx[11] = 1.0 if a > 0.0 and not b > 0.0 or a == b else t",
    "dx[12] = math.sqrt(abs(a)) ** 1.5 + math.pow(abs(b), 0.5)",
    "dx[13] = a ** 0 + b ** 1",
)
number = st.floats(-50.0, 50.0)


@given(number, number)
@settings(max_examples=200, deadline=None)
def test_arithmetic_and_conditions_are_those_of_python(a, b):
    compiled, plain = both(ARITHMETIC, [a, b], 14)
    np.testing.assert_allclose(compiled, plain, rtol=4e-15, atol=1e-300)


@given(st.integers(-20, 20), st.sampled_from([1, 2, 3, 7, -1, -3]))
@settings(max_examples=40, deadline=None)
def test_whole_numbers_divide_as_in_python(a, b):
    text = rhs(
        f"k = int(x[0])\n    dx[0] = k // {b}",
        f"dx[1] = k % {b}",
        "dx[2] = k / 4",
        "dx[3] = 2 * k - 1",
        "m = int(x[1])\n    dx[4] = k // m + round(0.5 * k)",
        "dx[5] = k % m",
    )
    compiled, plain = both(text, [float(a), float(b)], 6)
    np.testing.assert_array_equal(compiled, plain)


def test_loops_branches_breaks_and_swaps():
    text = rhs(
        "total = 0",
        "for i in range(2, 9, 3):",
        "    total = total + i * 0.5",
        "k = 0",
        "while True:",
        "    k += 1",
        "    if k == 3:",
        "        continue",
        "    if k > 6 or x[k] > 10.0:",
        "        break",
        "dx[0] = total",
        "dx[1] = k",
        "for j in range(7, 0, -2):",
        "    total -= j",
        "dx[2] = total",
        "dx[3], dx[4] = x[1], x[0]",
        "dx[3], dx[4] = dx[4], dx[3]",
        "i = 1",
        "if x[0] > 0.0:",
        "    i = 2.5",
        "dx[5] = i",
        "c = d = x[2]",
        "dx[5] += c - d",
        "flag = x[0] > 100.0",
        "flag = not flag",
        "dx[6] = 1.0 if flag else 2.0",
    )
    for x in ([1.0, 2.0, 3.0, 4.0, 11.0, 6.0, 7.0, 8.0], [-1.0] * 8):
        compiled, plain = both(text, x, 7)
        np.testing.assert_array_equal(compiled, plain)


def test_what_stands_behind_and_is_not_read_when_the_first_half_decides():
    text = rhs("dx[0] = 1.0 if p[0] > 5.0 and x[int(p[0])] > 0.0 else 2.0")
    # index 10**12 would leave the memory of the process
    function = native.compile_text(text.replace("p[0] > 5.0", "p[0] < 5.0"), "compiler", "rhs", 4)
    out = function(0.0, [1.0], [0.0], [1e12], np.empty(1))
    assert out[0] == 2.0


def test_results_of_several_values_pass_through_functions():
    text = (
        "def pair(a, b):\n    if a > b:\n        return a, 1\n    return b, 2.5\n\n\n"
        "def rhs(t, x, u, p, dx):\n    c, d = pair(x[0], x[1])\n    dx[0] = c\n    dx[1] = d\n"
    )
    for x in ([1.0, 2.0], [2.0, 1.0]):
        compiled, plain = both(text, x, 2)
        np.testing.assert_array_equal(compiled, plain)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_not_finite_numbers_compare_as_in_python(value):
    text = rhs(
        "dx[0] = min(x[0], 1.0)",
        "dx[1] = max(1.0, x[0])",
        "dx[2] = 1.0 if x[0] != x[0] else 0.0",
        "dx[3] = 1.0 if math.isfinite(x[0]) else 0.0",
        "dx[4] = 1.0 if x[0] < 2.0 else 0.0",
    )
    compiled, plain = both(text, [value], 5)
    np.testing.assert_array_equal(compiled, plain)


@pytest.mark.parametrize(
    "line",
    [
        "dx[0] = sum(x)",
        "dx[0] = [1.0][0]",
        "dx[0] = math.gamma(x[0])",
        "dx[0] = unknown",
        "dx[0] = x[0] @ x[0]",
        "y = 1.0 if x[0] > 0 else p",
        "for i in (1, 2):\n        dx[0] = i",
    ],
)
def test_what_is_outside_the_subset_is_refused(line):
    unit = unit_of_text(rhs(line), "text")
    with pytest.raises(Outside):
        Program().add(unit, "rhs", ("float", *["floats"] * 4), "f")


@entry
def mean_of_rows(values, out, skip):
    """Mean of each row but the first ``skip``."""
    rows, columns = values.shape[0], values.shape[1]
    data = pointer(values)
    for i in range(rows):
        if i < skip:
            continue
        out[i] = total(shift(data, i * columns), columns) / columns
    return rows


@entry
def several(values, k):
    """A number, a count and a condition."""
    return 0.5 * values[k], values.size, values[k] > 0.0


def test_entries_return_several_numbers():
    assert several(np.array([3.0, -4.0]), 0) == (1.5, 2, True)
    assert several(np.array([3.0, -4.0]), 1) == (-2.0, 2, False)


@inner
def total(data, count):
    """Sum."""
    found = 0.0
    for i in range(count):
        found += data[i]
    return found


def test_entries_take_arrays_and_say_what_they_cannot_take():
    values, out = np.arange(12.0).reshape(4, 3), np.zeros(4)
    assert mean_of_rows(values, out, 1) == 4
    np.testing.assert_array_equal(out, [0.0, 4.0, 7.0, 10.0])
    call = mean_of_rows.bound(values, out, 0)
    values += 1.0
    assert call() == 4
    np.testing.assert_array_equal(out, values.mean(axis=1))
    with pytest.raises(TypeError, match="contiguous"):
        mean_of_rows(values[:, ::2], out, 0)
    with pytest.raises(TypeError, match="float32"):
        mean_of_rows(values.astype(np.float32), out, 0)


@entry
def gamma_of(values, out):
    """The gamma function, which the subset does not have."""
    for i in range(values.size):
        out[i] = math.gamma(values[i])


def test_an_entry_outside_the_subset_is_refused_with_the_line():
    with pytest.raises(Outside, match="gamma"):
        gamma_of(np.array([5.0, 4.0]), np.zeros(2))


@pytest.mark.parametrize("kind", ["reference", "cabin"])
def test_every_function_of_the_lift_agrees_with_plain_python(kind):
    from vtsdt.lift.lift import Lift

    system = getattr(Lift, kind)().system
    rng = np.random.default_rng(5)
    n, n_u, n_p = len(system.states), len(system.inputs), len(system.parameters)
    for k in range(4):
        x = system.start + 1e-2 * rng.normal(size=n)
        seeds = (rng.normal(size=n), rng.normal(size=n_u), rng.normal(size=n_p))
        for name in ("rhs_function", "outputs_function", "rhs_tangent", "outputs_tangent"):
            function = getattr(system, name)
            size = n if name.startswith("rhs") else len(system.outputs)
            given = (x, system.u, system.p, *(seeds if name.endswith("tangent") else ()))
            plain = np.empty(size)
            function.python(0.1 * k, *given, plain)
            scale = 1e-12 * np.abs(plain).max()
            np.testing.assert_allclose(function(0.1 * k, *given, np.empty(size)), plain, rtol=1e-10, atol=scale)


def test_the_equations_of_a_trip_are_compiled_by_numba():
    code = (
        "import sys; from vtsdt.lift.lift import Lift; lift = Lift.cabin(); "
        "before = 'numba' in sys.modules; lift.trip('up', inputs={'F_c': 3000.0}, until=0.1); "
        "print(before, 'numba' in sys.modules, [m for m in ('pandas', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False True []"
