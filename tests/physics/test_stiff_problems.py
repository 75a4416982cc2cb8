"""Standard stiff problems at their published reference values.

Reference values: Mazzia and Magherini, Test Set for Initial Value Problem Solvers, release 2.4, University of
Bari, 2008 (computed there in extended precision with tolerances of 1e-18); problems from Hairer and Wanner,
Solving Ordinary Differential Equations II, IV.10.
"""

from __future__ import annotations

import numpy as np
import pytest

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import Automatic, DormandPrince54, NativeProblem, Rodas5P, integrate
from multibody.solvers.automatic import in_words

SOURCE = """
def van_der_pol(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = ((1.0 - x[0] * x[0]) * x[1] * p[1] - x[0]) * p[0]


def van_der_pol_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = ((1.0 - x[0] * x[0]) * x_dot[1] * p[1] - 2.0 * x[0] * x_dot[0] * x[1] * p[1] - x_dot[0]) * p[0]


def robertson(t, x, u, p, dx):
    slow = 0.04 * x[0]
    back = 1e4 * x[1] * x[2]
    fast = 3e7 * x[1] * x[1]
    dx[0] = -slow + back
    dx[1] = slow - back - fast
    dx[2] = fast


def robertson_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    slow = 0.04 * x_dot[0]
    back = 1e4 * (x_dot[1] * x[2] + x[1] * x_dot[2])
    fast = 6e7 * x[1] * x_dot[1]
    out[0] = -slow + back
    out[1] = slow - back - fast
    out[2] = fast


def oregonator(t, x, u, p, dx):
    dx[0] = 77.27 * (x[1] + x[0] * (1.0 - 8.375e-6 * x[0] - x[1]))
    dx[1] = (x[2] - (1.0 + x[0]) * x[1]) / 77.27
    dx[2] = 0.161 * (x[0] - x[2])


def oregonator_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    inner = 1.0 - 8.375e-6 * x[0] - x[1]
    out[0] = 77.27 * (x_dot[1] + x_dot[0] * inner + x[0] * (-8.375e-6 * x_dot[0] - x_dot[1]))
    out[1] = (x_dot[2] - x_dot[0] * x[1] - (1.0 + x[0]) * x_dot[1]) / 77.27
    out[2] = 0.161 * (x_dot[0] - x_dot[2])


def hires(t, x, u, p, dx):
    both = 280.0 * x[5] * x[7]
    dx[0] = -1.71 * x[0] + 0.43 * x[1] + 8.32 * x[2] + 0.0007
    dx[1] = 1.71 * x[0] - 8.75 * x[1]
    dx[2] = -10.03 * x[2] + 0.43 * x[3] + 0.035 * x[4]
    dx[3] = 8.32 * x[1] + 1.71 * x[2] - 1.12 * x[3]
    dx[4] = -1.745 * x[4] + 0.43 * x[5] + 0.43 * x[6]
    dx[5] = -both + 0.69 * x[3] + 1.71 * x[4] - 0.43 * x[5] + 0.69 * x[6]
    dx[6] = both - 1.81 * x[6]
    dx[7] = -both + 1.81 * x[6]


def hires_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    both = 280.0 * (x_dot[5] * x[7] + x[5] * x_dot[7])
    out[0] = -1.71 * x_dot[0] + 0.43 * x_dot[1] + 8.32 * x_dot[2]
    out[1] = 1.71 * x_dot[0] - 8.75 * x_dot[1]
    out[2] = -10.03 * x_dot[2] + 0.43 * x_dot[3] + 0.035 * x_dot[4]
    out[3] = 8.32 * x_dot[1] + 1.71 * x_dot[2] - 1.12 * x_dot[3]
    out[4] = -1.745 * x_dot[4] + 0.43 * x_dot[5] + 0.43 * x_dot[6]
    out[5] = -both + 0.69 * x_dot[3] + 1.71 * x_dot[4] - 0.43 * x_dot[5] + 0.69 * x_dot[6]
    out[6] = both - 1.81 * x_dot[6]
    out[7] = -both + 1.81 * x_dot[6]
"""

HIRES_PATTERN = np.array(
    [
        [1, 1, 1, 0, 0, 0, 0, 0],
        [1, 1, 0, 0, 0, 0, 0, 0],
        [0, 0, 1, 1, 1, 0, 0, 0],
        [0, 1, 1, 1, 0, 0, 0, 0],
        [0, 0, 0, 0, 1, 1, 1, 0],
        [0, 0, 0, 1, 1, 1, 1, 1],
        [0, 0, 0, 0, 0, 1, 1, 1],
        [0, 0, 0, 0, 0, 1, 1, 1],
    ],
    dtype=bool,
)

# name, parameters, start, end, reference, absolute tolerance at a relative tolerance of 1e-7
CASES = {
    "van_der_pol, mu = 1000": (
        "van_der_pol",
        (1.0, 1e3),
        [2.0, 0.0],
        2000.0,
        [0.1706167732170469e1, -0.8928097010248125e-3],
        1e-9,
    ),
    "van_der_pol, eps = 1e-6": (
        "van_der_pol",
        (1e6, 1.0),
        [2.0, 0.0],
        2.0,
        [0.1706167732170483e1, -0.8928097010247975],
        1e-9,
    ),
    "robertson": (
        "robertson",
        (0.0,),
        [1.0, 0.0, 0.0],
        1e11,
        [0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050],
        1e-17,
    ),
    "oregonator": (
        "oregonator",
        (0.0,),
        [1.0, 2.0, 3.0],
        360.0,
        [0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3],
        1e-9,
    ),
    "hires": (
        "hires",
        (0.0,),
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057],
        321.8122,
        [
            0.7371312573325668e-3,
            0.1442485726316185e-3,
            0.5888729740967575e-4,
            0.1175651343283149e-2,
            0.2386356198831331e-2,
            0.6238968252742796e-2,
            0.2849998395185769e-2,
            0.2850001604814231e-2,
        ],
        1e-12,
    ),
}


def make(name, p, n, **options):
    module = native.load_source(SOURCE, "stiff_problems")
    tangent = native.compile_tangent(module, f"{name}_tangent")
    return NativeProblem(native.compile_rhs(module, name), p, InputTable.constant([]), n, tangent, **options)


@pytest.mark.parametrize("method", [Rodas5P, Automatic])
@pytest.mark.parametrize("case", CASES)
def test_reference_value_is_reached(case, method):
    name, p, x0, end, reference, atol = CASES[case]
    done = integrate(make(name, p, len(x0)), (0.0, end), x0, [end], method, rtol=1e-7, atol=atol)
    assert done.success, done.message
    # The test set asks for about as many correct digits as the tolerance has; two of seven may be lost over
    # the whole interval, where errors of the phase of the relaxation oscillations add up.
    np.testing.assert_allclose(done.y[:, -1], reference, rtol=1e-5)


def test_colours_give_the_same_result_with_fewer_derivatives():
    name, p, x0, end, reference, atol = CASES["hires"]
    # Found by hand: columns of one colour meet in no row of the pattern.
    colours = np.array([0, 1, 2, 0, 1, 2, 3, 4])
    for colour in range(5):
        assert HIRES_PATTERN[:, colours == colour].sum(axis=1).max() <= 1
    prob = make(name, p, 8, colours=colours, pattern=HIRES_PATTERN)
    assert prob.owners().shape == (5, 8)
    done = integrate(prob, (0.0, end), x0, [end], Rodas5P, rtol=1e-7, atol=atol)
    np.testing.assert_allclose(done.y[:, -1], reference, rtol=1e-5)


def test_work_does_not_follow_stiffness_for_the_stiff_method_only():
    # Prothero and Robinson's idea on van der Pol's slow phase: from mu = 100 to 1000 the explicit method's
    # step is limited by stability to about 3.3/(3 mu), the implicit one's by accuracy only.
    work = {}
    for method in (DormandPrince54, Rodas5P, Automatic):
        for mu in (100.0, 1000.0):
            prob = make("van_der_pol", (1.0, mu), 2)
            work[method, mu] = integrate(prob, (0.0, 50.0), [2.0, 0.0], [50.0], method, rtol=1e-5, atol=1e-8).nfev
    assert work[DormandPrince54, 1000.0] > 5 * work[DormandPrince54, 100.0]
    assert work[Rodas5P, 1000.0] < 1.5 * work[Rodas5P, 100.0]
    # The default pays for noticing: steps up to the edge of stability, then fifteen on it, 6 evaluations each.
    assert work[Automatic, 1000.0] < work[Rodas5P, 1000.0] + 6 * 40
    assert work[Automatic, 1000.0] < work[DormandPrince54, 1000.0] / 5


def test_the_default_says_when_it_was_stiff_and_goes_back():
    history = []
    mild = make("van_der_pol", (1.0, 1.0), 2)
    integrate(mild, (0.0, 50.0), [2.0, 0.0], [50.0], rtol=1e-5, atol=1e-8, history=history)
    assert [name for _, name in history] == ["explicit"]
    history.clear()
    stiff = make("van_der_pol", (1.0, 1000.0), 2)
    done = integrate(stiff, (0.0, 50.0), [2.0, 0.0], [50.0], rtol=1e-5, atol=1e-8, history=history)
    assert [name for _, name in history][:2] == ["explicit", "stiff"]
    assert done.nlu > 0
    assert "stiff for" in in_words(history, 50.0)


def test_a_late_tangent_is_asked_for_only_by_a_stiff_problem():
    def asked(mu):
        calls = []
        whole = make("van_der_pol", (1.0, mu), 2)
        bare = NativeProblem(whole.rhs, whole.p, whole.table, 2)

        def later():
            calls.append(mu)
            return whole

        integrate(bare, (0.0, 20.0), [2.0, 0.0], [20.0], rtol=1e-5, atol=1e-8, stiff_problem=later)
        return calls

    assert asked(1.0) == []
    assert asked(1000.0) == [1000.0]
