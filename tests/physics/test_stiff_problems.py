"""Standard stiff problems: their reference values, and what a stiff method and the default cost."""

from __future__ import annotations

import numpy as np
import pytest
from reference_problems import NOT_STIFF, STIFF, make

from multibody import Component, Input, Model, Parameter, State
from multibody.solvers import Automatic, DormandPrince54, NativeProblem, Rodas5P, integrate
from multibody.solvers.automatic import in_words

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


@pytest.mark.parametrize("method", [Rodas5P, Automatic])
@pytest.mark.parametrize("case", STIFF)
def test_reference_value_is_reached(case, method):
    name, p, x0, end, reference, atol = STIFF[case]
    done = integrate(make(name, p, len(x0)), (0.0, end), x0, [end], method, rtol=1e-7, atol=atol)
    assert done.success, done.message
    # The test set asks for about as many correct digits as the tolerance has; two of seven may be lost over
    # the whole interval, where errors of the phase of the relaxation oscillations add up.
    np.testing.assert_allclose(done.y[:, -1], reference, rtol=1e-5)


@pytest.mark.parametrize(("case", "digits"), [("pleiades", 4), ("arenstorf orbit", 3)])
def test_reference_value_is_reached_without_stiffness(case, digits):
    # close encounters magnify errors, by about 1e4 (Pleiades) and 1e8 (Arenstorf): so few digits are left of rtol
    name, p, x0, end, reference, _ = NOT_STIFF[case]
    done = integrate(make(name, p, len(x0)), (0.0, end), x0, [end], rtol=1e-12, atol=1e-12)
    assert np.max(np.abs(done.y[:, -1] - reference)) < 10.0**-digits


def test_colours_give_the_same_result_with_fewer_derivatives():
    name, p, x0, end, reference, atol = STIFF["hires"]
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
        bare = NativeProblem(rhs=whole.rhs, p=whole.p, table=whole.table, n=2)

        def later():
            calls.append(mu)
            return whole

        integrate(bare, (0.0, 20.0), [2.0, 0.0], [20.0], rtol=1e-5, atol=1e-8, stiff_problem=later)
        return calls

    assert asked(1.0) == []
    assert asked(1000.0) == [1000.0]


class Lag(Component):
    """Follows a wave at a rate that changes by orders of magnitude, as a body does that comes to rest in friction."""

    rate = Input("1/s", "how fast it follows")
    frequency = Parameter(2000.0, "rad/s", "of the wave")
    wave = State("m", "what is followed", 0.0)
    quarter_later = State("m", "the wave a quarter of its period later", 1.0)
    position = State("m", "what follows", 0.0)

    def equations(self):
        self.der.wave = self.frequency * self.quarter_later
        self.der.quarter_later = -self.frequency * self.wave
        self.der.position = self.rate * (self.wave - self.position)


def test_the_default_does_not_wait_where_a_stiff_method_that_did_not_pay_begins_to():
    # At 3e4/s accuracy lets steps be hardly longer than stability does: the stiff method is tried, and does not pay.
    model = Model("lag")
    lag = model.add("lag", Lag())
    model.input("rate", lag.rate)
    system = model.build()

    def evaluations(method, begin, end):
        rate = [0.0, 1.0, 1.000001, 1.1], [3e4, 3e4, 3e6, 3e6]
        start = {"lag.wave": np.sin(2000.0 * begin), "lag.quarter_later": np.cos(2000.0 * begin)}
        options = {"initial": start, "method": method, "rtol": 1e-5, "atol": 1e-8}
        return system.simulate((begin, end), inputs={"rate": tuple(map(np.array, rate))}, **options).statistics["nfev"]

    best = evaluations("DormandPrince54", 0.0, 1.0) + evaluations("Rodas5P", 1.0, 1.1)
    # a fifth more: three trials of up to eighty explicit steps each, and some hundred steps until it is noticed
    assert evaluations("Automatic", 0.0, 1.1) < 1.2 * best
