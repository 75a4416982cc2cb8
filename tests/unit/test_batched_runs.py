"""Batched runs are what each of them is alone, to the last bit."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from multibody.compile import native
from multibody.compile.batched_rates import batched_rhs
from multibody.inputs.table import InputTable
from multibody.solvers import Automatic, DormandPrince54, NativeProblem, groups, integrate
from multibody.solvers.batch import batch
from multibody.solvers.kernels.dormand_prince_batched import LANES

TEXT = """import math


def table(p, start, x):
    low, high = 0, 4
    while high - low > 1:
        middle = (low + high) // 2
        if p[start + middle] <= x:
            low = middle
        else:
            high = middle
    if x <= p[start]:
        return 0.0
    return p[start + low] * x


def limited(x, most):
    if x > most:
        share, over = most, True
    elif x < -most and x < 0.0:
        share, over = -most, True
    else:
        share = x
        over = False
    return share, 1.0 if over else 0.0


def rhs(t, x, u, p, dx):
    a, b = x[0], x[1]
    force, over = limited(a * u[0], p[0])
    total = 0.0
    for k in range(2):
        total += p[k] * x[k]
        if a > b:
            total -= 0.25 * k
            dx[3] = 2.0
        else:
            dx[3] = total
    if p[1] > 0.5 and not b > 0.0 or a == b:
        total = min(total, b, 0.5) + max(a, 0.0) ** 3
    dx[0] = b - total * math.tanh(a) + math.sin(t + b) * over
    dx[1] = -a + force - abs(b) ** 1.5 + math.sqrt(abs(a)) / (1.0 + b ** 2) + (1.0 + a * a) ** -2
    dx[2] = table(p, 2, x[2]) + a % 0.7 - math.copysign(0.1, b) + (t if a < b <= 1.0 else math.atan2(a, b))
    dx[2] -= math.floor(x[2]) + math.fabs(a) + (0.0 if math.isfinite(b) else 1.0)
    dx[3] -= x[3]
"""
P = np.array([0.7, 0.6, -1.0, -0.4, 0.2, 0.9, 1.5])


def batched(rhs, count, t, x, u, p):
    """Rates by the equations in lanes, shape (count, n)."""
    import ctypes

    address = batched_rhs(rhs, count)
    assert address
    columns = [np.ascontiguousarray(v.T) for v in (t[:, None], x, u, p)]
    out = np.full((x.shape[1], count), np.nan)
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(address)(*(v.ctypes.data for v in [*columns, out]))
    return out.T


@pytest.mark.parametrize("count", [3, 4, 8])
def test_equations_in_lanes_are_those_of_each_lane(count):
    rhs = native.compile_text(TEXT, "batched", "rhs", 4)
    rng = np.random.default_rng(0)
    for scale in (0.1, 1.0, 10.0):
        t, x = rng.normal(size=count), scale * rng.normal(size=(count, 4))
        u, p = rng.normal(size=(count, 1)), P + 0.3 * rng.normal(size=(count, P.size))
        x[0, 0] = x[0, 1]
        x[1, 1] = [np.nan, np.inf, -0.0][int(rng.integers(3))]
        together = batched(rhs, count, t, x, u, p)
        for j in range(count):
            np.testing.assert_array_equal(together[j], rhs(t[j], x[j], u[j], p[j], np.empty(4)), err_msg=str(j))


@pytest.mark.parametrize(
    "line",
    [
        "dx[0] = p[int(x[0])]",
        "while x[0] > p[0]:\n        dx[0] = 1.0",
        "k = 0\n    if x[0] > 0.0:\n        k = 1\n    dx[0] = p[k]",
        "dx[0] = 1.0\n    if x[0] > 0.0:\n        return",
        "dx[0] = 0.0\n    if x[0] > 0.0:\n        dx[0] = part(x[0])",
        "dx[0] = part(x[0]) if x[0] > 0.0 else 0.0",
    ],
)
def test_what_cannot_be_batched_is_left_to_each_run(line):
    text = f"def part(x):\n    return 2.0 * x\n\n\ndef rhs(t, x, u, p, dx):\n    {line}\n"
    assert batched_rhs(native.compile_text(text, "batched", "rhs", 4), 4) == 0


@pytest.mark.parametrize("machine", ["reference", "one_dimensional", "cabin"])
def test_rates_of_the_lift_in_lanes_are_those_of_each(machine):
    from vtsdt.lift.lift import Lift

    system = getattr(Lift, machine)().system
    rng, count = np.random.default_rng(1), LANES
    x = system.start + 1e-3 * rng.normal(size=(count, len(system.states)))
    u = system.u + 0.1 * rng.normal(size=(count, system.u.size))
    p = system.p * (1.0 + 0.01 * rng.normal(size=(count, system.p.size)))
    t = rng.random(count)
    together = batched(system.rhs_function, count, t, x, u, p)
    for j in range(count):
        alone = system.rhs_function(t[j], x[j], u[j], p[j], np.empty(x.shape[1]))
        np.testing.assert_array_equal(together[j], alone)


def test_contact_of_teeth_is_left_to_each_run_and_that_soon():
    from gearbox.stage.stage import GearStage

    assert batched_rhs(GearStage.paper().system.rhs_function, LANES) == 0


SWING = """import math


def rhs(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = -p[0] * math.sin(x[0]) - p[1] * x[1] + u[0] + u[1] * x[0]
    if x[0] > p[3]:
        dx[1] -= 400.0 * (x[0] - p[3])


def speeds(t, x, u, p, out):
    out[0] = x[1]
"""


@pytest.fixture
def swing():
    """A pendulum with an end stop, a measured and a held input, of which the first is late."""
    times = np.linspace(0.0, 2.0, 81)
    rng = np.random.default_rng(4)
    table = InputTable.from_columns(
        times, {"a": np.cumsum(rng.normal(size=81)), "b": np.sign(np.sin(9.0 * times))}, {"b": "hold"}, {"a": 2}
    )
    rhs = native.compile_text(SWING, "swing", "rhs", 4)
    return NativeProblem(rhs=rhs, p=[9.0, 0.2, 0.013, 0.4], table=table, n=2)


@pytest.fixture
def at_once(monkeypatch):
    """Lanes from the first group on, and what is known of the groups that went through them."""
    seen = []
    advance = DormandPrince54.advance_batched

    def noted(self, address, numbers, *given):
        seen.append(len(numbers))
        advance(self, address, numbers, *given)

    monkeypatch.setattr(groups, "COMPILATION", -1.0)
    monkeypatch.setattr(DormandPrince54, "advance_batched", noted)
    return seen


def changed(problem, count, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield replace(problem, p=problem.p * (1.0 + 0.3 * rng.random(problem.p.size))), rng.normal(size=2)


@pytest.mark.parametrize("method", [Automatic, DormandPrince54])
@pytest.mark.parametrize("count", [4, 37])
def test_each_batched_run_is_as_alone(swing, at_once, method, count):
    t = np.linspace(0.0, 2.0, 301)
    options = dict(method=method, rtol=1e-5, atol=1e-8)
    done = list(batch(changed(swing, count), (0.0, 2.0), t, 2, **options))
    assert sum(at_once) >= count - 3
    for run, (problem, start) in zip(done, changed(swing, count), strict=True):
        np.testing.assert_array_equal(run.y, integrate(problem, (0.0, 2.0), start, t, **options).y)


def test_runs_of_very_different_length_share_lanes(swing, at_once):
    t = np.linspace(0.0, 2.0, 41)
    many = list(changed(swing, 24, seed=3))
    for k in (0, 9, 23):  # a hundred times the steps
        problem, start = many[k]
        many[k] = replace(problem, p=problem.p * [1e4, 1.0, 1.0, 1.0]), start
    options = dict(method=DormandPrince54, rtol=1e-6, atol=1e-9)
    for run, (problem, start) in zip(batch(many, (0.0, 2.0), t, 1, **options), many, strict=True):
        np.testing.assert_array_equal(run.y, integrate(problem, (0.0, 2.0), start, t, **options).y)
    assert sum(at_once) >= 20


def test_what_passes_by_shortens_the_steps_of_its_own_run_alone(swing, at_once):
    speeds = native.compile_text(SWING, "swing", "speeds", 4)
    narrow = replace(swing, speeds=speeds, widths=np.array([0.02]))
    many = [(narrow if k % 3 else swing, start) for k, (_, start) in enumerate(changed(swing, 12))]
    t = np.linspace(0.0, 2.0, 11)
    options = dict(method=DormandPrince54, rtol=1e-2, atol=1e-3)
    for run, (problem, start) in zip(batch(many, (0.0, 2.0), t, 2, **options), many, strict=True):
        np.testing.assert_array_equal(run.y, integrate(problem, (0.0, 2.0), start, t, **options).y)
    assert sum(at_once) >= 9


def test_runs_that_fail_leave_the_others_of_their_lanes_as_they_are(swing, at_once):
    blown = replace(swing, p=swing.p * [-1e8, 1.0, 1.0, 1e9])
    broken = native.compile_text(
        "def rhs(t, x, u, p, dx):\n    dx[0] = x[1]\n    dx[1] = -p[0] / (1.5 - t) ** 2\n", "swing", "rhs", 4
    )
    many = [(problem, start) for problem, start in changed(swing, 12)]
    many[5] = blown, many[5][1]
    many[7] = replace(swing, rhs=broken), many[7][1]  # other equations: one after another
    t = np.linspace(0.0, 2.0, 21)
    options = dict(method=DormandPrince54, rtol=1e-4, atol=1e-7)
    done = list(batch(many, (0.0, 2.0), t, 1, **options))
    assert [run.index for run in done] == list(range(12))
    for run, (problem, start) in zip(done, many, strict=True):
        alone = integrate(problem, (0.0, 2.0), start, t, **options)
        assert run.success == alone.success
        np.testing.assert_array_equal(run.y, alone.y)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_the_default_method_changes_methods_in_a_batch_as_it_does_alone(at_once, rtol):
    from multibody.system.simulate import input_table, native_problem
    from vtsdt.lift.lift import Lift

    lift = Lift.one_dimensional()
    system, rng = lift.system, np.random.default_rng(2)
    table = input_table(system, {"omega_ref": lift.speed_reference("up"), "friction_c": 0.0, "friction_cw": 0.0})
    problem = native_problem(system, system.p, table, tangent=True)
    many = [
        (replace(problem, p=system.p * (1.0 + 0.01 * rng.normal(size=system.p.size))), system.start) for _ in range(11)
    ]
    t, changes = np.linspace(0.0, 4.0, 401), 0
    for run, (one, start) in zip(batch(many, (0.0, 4.0), t, 2, rtol=rtol), many, strict=True):
        history = []
        np.testing.assert_array_equal(run.y, integrate(one, (0.0, 4.0), start, t, rtol=rtol, history=history).y)
        changes += len(history) - 1
    assert changes >= 11
    assert sum(at_once) > 11  # runs came back to the lanes


def test_long_runs_are_looked_at_for_stiffness_and_go_on(swing, at_once, monkeypatch):
    from multibody.solvers import automatic

    monkeypatch.setattr(automatic, "LOOK", 16)
    monkeypatch.setattr(groups, "LOOK", 16)
    tangent = native.compile_text(
        "import math\n\n\ndef rhs_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):\n    out[0] = x_dot[1]\n"
        "    out[1] = -p[0] * math.cos(x[0]) * x_dot[0] - p[1] * x_dot[1] + u[1] * x_dot[0]\n"
        "    if x[0] > p[3]:\n        out[1] -= 400.0 * x_dot[0]\n",
        "swing",
        "rhs_tangent",
        7,
    )
    many = list(changed(replace(swing, tangent=tangent), 14))
    t = np.linspace(0.0, 2.0, 41)
    options = dict(rtol=1e-6, atol=1e-9)
    for run, (problem, start) in zip(batch(many, (0.0, 2.0), t, 2, **options), many, strict=True):
        np.testing.assert_array_equal(run.y, integrate(problem, (0.0, 2.0), start, t, **options).y)
    assert sum(at_once) > 3 * 14


def test_stiff_runs_leave_their_lanes(at_once):
    text = "def rhs(t, x, u, p, dx):\n    dx[0] = -p[0] * (x[0] - u[0])\n"
    tangent = "def rhs_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):\n" + (
        "    out[0] = -p[0] * (x_dot[0] - u_dot[0]) - p_dot[0] * (x[0] - u[0])\n"
    )
    stiff = NativeProblem(
        rhs=native.compile_text(text, "decay", "rhs", 4),
        p=[5e4],
        table=InputTable.constant([1.0]),
        n=1,
        tangent=native.compile_text(tangent, "decay", "rhs_tangent", 7),
    )
    many = [(replace(stiff, p=[5e4 + k]), np.array([0.1 * k])) for k in range(80)]
    t = np.linspace(0.0, 1.0, 11)
    for run, (problem, start) in zip(batch(many, (0.0, 1.0), t, 1, rtol=1e-5), many, strict=True):
        np.testing.assert_array_equal(run.y, integrate(problem, (0.0, 1.0), start, t, rtol=1e-5).y)
    assert sum(at_once) > 70  # but for a few left over at the end


WITHOUT_MEMORY = """
import resource, sys
import numpy as np
from multibody import Model
from multibody.library import Mass, Spring
from multibody.solvers.batch import batch
from multibody.system.simulate import input_table, native_problem

model = Model("oscillator")
body, spring = model.add("body", Mass(m=2.0, position=0.1)), model.add("spring", Spring(stiffness=50.0))
model.connect(spring.a, model.ground)
model.connect(spring.b, body.flange)
system = model.build()
p = system.parameter_vector(None)
problem = native_problem(system, p, input_table(system, None))
runs = [(problem, system.start)] * 200
times = np.linspace(0.0, 50.0, 101)
before = [run.y for run in batch(runs, (0.0, 50.0), times, workers=1)]
pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (4 << 20),) * 2)
after = [run.y for run in batch(runs, (0.0, 50.0), times, workers=8)]
assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of address space are those of Linux")
def test_runs_end_where_no_thread_gets_memory() -> None:
    run = subprocess.run([sys.executable, "-c", WITHOUT_MEMORY], capture_output=True, text=True, timeout=120)
    assert run.stdout == "done\n", run.stderr
