"""Setting filters up: every fault is told at once, with its name; results show themselves."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import (
    FilterDivergence,
    FilterError,
    FilterModel,
    FilterSamples,
    Matern32,
    Noise,
    Prior,
    RandomWalk,
    TimeSeries,
    extended_kalman_filter,
    tune,
    unscented_kalman_filter,
)


@pytest.fixture(scope="module")
def system():
    from multibody import Model
    from multibody.library import ForceSource, Mass, Spring

    model = Model("oscillator")
    body = model.add("body", Mass(m=1.0))
    spring = model.add("spring", Spring(stiffness=100.0))
    push = model.add("push", ForceSource())
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    model.connect(push.flange, body.flange)
    model.input("force", push.force, default=0.0)
    return model.build()


def samples(count=50):
    times = np.arange(count) * 0.01
    return FilterSamples(times, np.zeros((count, 1)), 0.01 * np.cos(10.0 * times)[:, None])


def test_all_faults_of_a_model_are_told_at_once(system):
    with pytest.raises(FilterError) as told:
        FilterModel(
            system,
            ["body.positon"],
            [RandomWalk("spring.stifness"), RandomWalk("force"), RandomWalk("force")],
            steps={"body.speed": 1e-3},
        )
    text = str(told.value)
    for part in ("body.position", "spring.stiffness", "several states are called force", "'body.speed'"):
        assert part in text
    with pytest.raises(FilterError, match="nothing is measured"):
        FilterModel(system, [])


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: RandomWalk("a", rate=-1.0), "rate is -1"),
        (lambda: Matern32("a", time=0.0), "time is 0"),
        (lambda: RandomWalk({"a": 1.0, "b": -1.0}), "needs a name"),
    ],
)
def test_impossible_latent_quantities_are_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()


def test_impossible_noise_and_priors_are_refused(system):
    model = FilterModel(system, ["body.position"])
    with pytest.raises(FilterError) as told:
        Noise({"body.positon": 1.0}, {"body.velocity": 1.0}).of(model)
    assert "body.position" in str(told.value)
    assert "is not measured" in str(told.value)
    with pytest.raises(FilterError, match="must be positive"):
        Noise({}, {"body.position": 0.0}).of(model)
    with pytest.raises(FilterError, match="no covariance"):
        Noise(np.diag([1.0, -1.0]), {"body.position": 1.0}).of(model)
    with pytest.raises(FilterError, match="there is no state 'bdy'"):
        Prior({"bdy": 1.0}).of(model)


def test_impossible_samples_are_refused(system):
    with pytest.raises(FilterError, match=r"from row 1 .* to row 2"):
        FilterSamples(np.array([0.0, 0.1, 0.1]), np.zeros((3, 1)), np.zeros((3, 1)))
    with pytest.raises(FilterError, match="an input is missing in 1 rows, the first row 1"):
        FilterSamples(np.arange(3.0), np.array([0.0, np.nan, 0.0]), np.zeros(3))
    model = FilterModel(system, ["body.position", "body.acceleration"])
    with pytest.raises(FilterError, match="1 columns of readings, measured are"):
        extended_kalman_filter(model, samples(), Noise({}, {"body.position": 1.0, "body.acceleration": 1.0}))
    early, late = TimeSeries(np.arange(3.0), np.zeros(3)), TimeSeries(np.arange(3.0) + 10.0, np.zeros(3))
    with pytest.raises(FilterError, match="no time in common"):
        FilterSamples.merged({"y": early}, {"u": late})


def test_a_filter_that_diverges_says_when_and_what(system):
    stiff = FilterModel(system, ["body.position"], parameters={"spring.stiffness": 1e12})
    loose = Noise({}, {"body.position": 1e300})
    for method in (extended_kalman_filter, unscented_kalman_filter):
        with pytest.raises(FilterDivergence, match=r"diverged at .* s \(row \d+\): no finite value for body.position"):
            method(stiff, samples(), loose, Prior({"body.position": 0.01}, {"body.position": 1e-3}))
    # In steps that the machine's motion allows it does not.
    model = FilterModel(system, ["body.position"], parameters={"spring.stiffness": 1e6})
    extended_kalman_filter(
        model, samples(), loose, Prior({"body.position": 0.01}, {"body.position": 1e-3}), substeps=10
    )


def test_what_was_not_kept_is_asked_for(system):
    model = FilterModel(system, ["body.position"])
    run = extended_kalman_filter(model, samples(), Noise({}, {"body.position": 1e-6}))
    with pytest.raises(FilterError, match='keep="everything"'):
        run.smooth()
    with pytest.raises(FilterError, match="nothing is free"):
        tune(model, samples(), Noise({}, {"body.position": 1e-6}))


def test_results_show_themselves(system):
    model = FilterModel(system, ["body.position"], [Matern32("force", std=1.0, time=0.1)])
    run = extended_kalman_filter(
        model, samples(), Noise({}, {"body.position": 1e-6}), Prior({"body.position": 0.01}), keep="everything"
    )
    assert model.state_names == ("body.position", "body.velocity", "force", "force.rate1")
    assert model.unit("force.rate1") == "N/s"
    assert "50 instants, 50 with readings" in repr(run)
    table = run.smooth().to_frame(["force"])
    assert list(table.columns) == ["force [N]", "std force [N]"]
    figure = run.plot(["body.position", "force"])
    assert [axis.get_ylabel() for axis in figure.axes] == ["position [m]", "force [N]"]
    assert "autocorrelation" in run.consistency().plot().axes[0].get_ylabel()
    with pytest.raises(KeyError, match=r"body\.velocity"):
        run["body.velocty"]


def test_measured_outputs_that_are_states_or_rates_cost_no_evaluation(system):
    model = FilterModel(system, ["body.position", "body.acceleration", "spring.energy"])
    assert [kind for kind, _ in model.channels] == [0, 1, 2]
    x = np.array([0.1, -0.3, 0.0])
    run = extended_kalman_filter(
        FilterModel(system, ["body.position", "body.acceleration", "spring.energy"], [RandomWalk("force")]),
        FilterSamples(np.zeros(1), np.array([[2.0]]), np.zeros((1, 3))),
        Noise({}, np.ones(3)),
        Prior(x[:2]),
        keep="everything",
    )
    y = system.outputs_at(0.0, x[:2], np.array([2.0]))
    wanted = [y[system.index("output", name)] for name in model.measured]
    assert np.allclose(-run.innovations[0], wanted, atol=1e-14)
    assert np.allclose(run.kept["rows"][0], [[1, 0, 0], [-100, 0, 1], [10, 0, 0]], atol=1e-12)
