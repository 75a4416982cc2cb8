"""Around the compiled methods: the choice of a method, batches."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import (
    Automatic,
    DormandPrince54,
    Exponential43,
    NativeProblem,
    Rodas5P,
    choose_method,
    integrate,
)
from multibody.solvers.batch import batch
from multibody.solvers.choose import jacobian, spectral_radius
from multibody.solvers.groups import MOST_RUNS
from multibody.solvers.kernels.dormand_prince_batched import LANES

# x' = A x + B u with A = p[0:9], B = p[9:15]; and a pendulum whose input is its third parameter late.
SOURCE = """
import math


def linear(t, x, u, p, dx):
    for i in range(3):
        dx[i] = p[9 + 2 * i] * u[0] + p[10 + 2 * i] * u[1]
        for j in range(3):
            dx[i] += p[3 * i + j] * x[j]


def linear_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    for i in range(3):
        out[i] = p[9 + 2 * i] * u_dot[0] + p[10 + 2 * i] * u_dot[1]
        for j in range(3):
            out[i] += p[3 * i + j] * x_dot[j] + p_dot[3 * i + j] * x[j]


def pendulum(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = -p[0] * math.sin(x[0]) - p[1] * x[1] + u[0] * x[0]


def pendulum_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = (
        -p_dot[0] * math.sin(x[0]) - p[0] * math.cos(x[0]) * x_dot[0] - p_dot[1] * x[1] - p[1] * x_dot[1]
        + u_dot[0] * x[0] + u[0] * x_dot[0]
    )
"""

A = np.array([[0.0, 1.0, 0.0], [-30.0, -2.0, 5.0], [1.0, 0.0, -8.0]])
B = np.array([[0.0, 0.0], [3.0, 0.0], [0.5, -2.0]])


def problem(name, p, table, n):
    module = native.load_source(SOURCE, "solver_tools")
    return NativeProblem(
        rhs=native.compile_rhs(module, name),
        p=p,
        table=table,
        n=n,
        tangent=native.compile_tangent(module, f"{name}_tangent"),
    )


def linear(matrix=A):
    p = np.concatenate([matrix.ravel(), B.ravel()])
    return problem("linear", p, InputTable.constant([0.3, -0.2]), 3)


def test_jacobian_by_colours_and_eigenvalues():
    np.testing.assert_array_equal(jacobian(linear(), 0.0, np.ones(3)), A)
    assert spectral_radius(linear(), 0.0, np.ones(3)) == pytest.approx(np.abs(np.linalg.eigvals(A)).max())


def test_choice_follows_stiffness():
    mild = choose_method(linear(), (0.0, 5.0), [1.0, 0.0, 0.0], rtol=1e-6)
    assert mild.method is DormandPrince54
    assert mild.reason.startswith("explicit: accuracy")
    assert mild.fastest == pytest.approx(np.abs(np.linalg.eigvals(A)).max())
    fast = A.copy()
    fast[2, 2] = -1e6
    stiff = choose_method(linear(fast), (0.0, 5.0), [1.0, 0.0, 0.0], rtol=1e-6)
    assert stiff.method is Rodas5P
    assert stiff.reason.startswith("stiff: stability limits explicit steps to 3.3e-06 s")
    work = {
        m: integrate(linear(fast), (0.0, 0.1), [1.0, 0.0, 0.0], method=m, rtol=1e-6).nfev
        for m in (DormandPrince54, Rodas5P)
    }
    assert work[DormandPrince54] > 100 * work[Rodas5P]


def test_choice_without_tangent_or_motion():
    prob = linear()
    bare = NativeProblem(rhs=prob.rhs, p=prob.p, table=prob.table, n=3)
    assert "no tangent" in choose_method(bare, (0.0, 1.0), np.zeros(3)).reason
    still = linear(np.zeros((3, 3)))
    assert choose_method(still, (0.0, 1.0), np.zeros(3)).method is DormandPrince54


def test_batch_gives_each_run_in_order_and_reports_failures():
    prob = linear()
    starts = np.random.default_rng(2).normal(size=(60, 3))
    starts[7, 0] = np.nan
    drawn = []

    def runs():
        for i, start in enumerate(starts):
            drawn.append(i)
            yield prob, start

    t = np.linspace(0.0, 0.5, 6)
    results = batch(runs(), (0.0, 0.5), t, workers=2, rtol=1e-9, atol=1e-11)
    first = next(results)
    # Constant memory: only what is needed to keep two threads busy has been drawn, in lanes or not.
    assert 8 <= len(drawn) <= 8 * LANES
    done = [first, *results]
    assert [run.index for run in done] == list(range(60))
    for run, start in zip(done, starts, strict=True):
        if run.index == 7:
            assert not run.success
            assert run.y.shape[0] == 3
            assert "finite" in run.message
        else:
            alone = integrate(prob, (0.0, 0.5), start, t, rtol=1e-9, atol=1e-11)
            np.testing.assert_array_equal(run.y, alone.y)


def test_batch_can_be_left_early():
    prob = linear()
    results = batch(((prob, np.ones(3)) for _ in range(10**9)), (0.0, 0.1), [0.1], workers=2)
    assert [next(results).index for _ in range(3)] == [0, 1, 2]
    results.close()


def test_batch_in_groups_is_the_same_to_the_last_bit_and_loses_no_run_to_another():
    prob = linear()
    rng = np.random.default_rng(5)
    starts, told = rng.normal(size=(400, 3)), []
    starts[[3, 250]] = np.inf
    stiff = linear(np.diag([-1.0, -2.0, -4e4]))  # the default method hands these over to the stiff one
    whole = [stiff if i % 97 == 5 else prob for i in range(400)]
    t = np.linspace(0.0, 0.2, 5)
    options = dict(rtol=1e-5, atol=1e-8)
    done = list(batch(zip(whole, starts, strict=True), (0.0, 0.2), t, 2, told.append, **options))
    assert [run.index for run in done] == list(range(400))
    assert [run.index for run in done if not run.success] == [3, 250]
    assert told[-1] == "run 400, 2 failed"
    for i in (0, 4, 5, 102, 200, 399):
        alone = integrate(whole[i], (0.0, 0.2), starts[i], t, **options)
        np.testing.assert_array_equal(done[i].y, alone.y)


def test_results_of_a_batch_that_are_kept_stay_as_they_were():
    prob = linear()
    starts = np.random.default_rng(6).normal(size=(300, 3))
    t = np.linspace(0.0, 0.2, 40)
    kept = {}
    for run in batch(((prob, x) for x in starts), (0.0, 0.2), t, 2, rtol=1e-5):
        if run.index % 7 == 0:
            kept[run.index] = run.y[1:]  # a view of a part is enough to keep it
    for index, part in kept.items():
        np.testing.assert_array_equal(part, integrate(prob, (0.0, 0.2), starts[index], t, rtol=1e-5).y[1:])


def owner(array):
    """The array in whose memory another one stands."""
    while array.base is not None:
        array = array.base
    return array


@pytest.fixture
def no_collector():
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("method", [Automatic, DormandPrince54, Exponential43, Rodas5P])
def test_a_solution_that_is_dropped_is_gone_without_the_garbage_collector(method, no_collector):
    stiff = linear(np.diag([-1.0, -2.0, -4e4]))
    solution = integrate(stiff, (0.0, 0.2), np.ones(3), np.linspace(0.0, 0.2, 50), method=method)
    memory = weakref.ref(owner(solution.y))
    assert memory() is not None
    del solution
    assert memory() is None


def test_a_batch_holds_no_more_results_after_many_runs_than_after_few(no_collector):
    plain, stiff = linear(), linear(np.diag([-1.0, -2.0, -4e4]))  # the second ends the long way, one by one
    t = np.linspace(0.0, 0.2, 2000)
    seen, most = {}, []
    for run in batch(((stiff if i % 3 else plain, np.ones(3)) for i in range(600)), (0.0, 0.2), t, 2):
        memory = owner(run.y)
        seen[id(memory)] = weakref.ref(memory)
        seen = {key: alive for key, alive in seen.items() if alive() is not None}
        most.append(sum(alive().nbytes for alive in seen.values()))
        del memory
    assert max(most) <= 2 * MOST_RUNS * t.nbytes * 3  # one group that was handed on, and the next


def test_runs_are_the_same_to_the_last_bit_from_time_to_time():
    table = InputTable.from_columns(np.linspace(0.0, 2.0, 201), {"a": np.random.default_rng(3).normal(size=201)})
    prob = problem("pendulum", [9.0, 0.1, 0.0], table, 2)
    for method in (DormandPrince54, Rodas5P):
        first, second = (integrate(prob, (0.0, 2.0), [1.0, 0.0], [0.5, 2.0], method=method) for _ in range(2))
        assert first.nfev == second.nfev
        np.testing.assert_array_equal(first.y, second.y)


def test_arrays_of_any_layout_compile_nothing_anew():
    prob = linear()
    t = np.linspace(0.0, 0.5, 11)
    wide = np.zeros((3, 4), order="F")
    wide[:, 1] = 1.0
    plain = integrate(prob, (0.0, 0.5), np.ones(3), t, method=DormandPrince54)
    told = []
    stop = native.on_compile(lambda name, seconds: told.append(name))
    spread = NativeProblem(rhs=prob.rhs, p=np.repeat(prob.p, 2)[::2], table=prob.table, n=3, tangent=prob.tangent)
    start = np.stack([np.ones(3), np.zeros(3)], axis=1)[:, 0]
    assert not start.flags.c_contiguous
    other = integrate(spread, (0.0, 0.5), start, np.repeat(t, 2)[::2], method=DormandPrince54, atol=wide[:, 1] * 1e-6)
    stop()
    assert told == []
    np.testing.assert_array_equal(other.y, plain.y)


def test_the_longest_step_is_told():
    prob = linear()
    free = integrate(prob, (0.0, 2.0), np.ones(3), [2.0], method=DormandPrince54)
    held = integrate(prob, (0.0, 2.0), np.ones(3), [2.0], method=DormandPrince54, max_step=0.01)
    assert held.longest_step <= 0.01 < free.longest_step
