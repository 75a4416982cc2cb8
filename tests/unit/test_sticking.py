"""A connection that sticks and slips: simulations, derivatives and transitions there stay cheap and agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.residual.tolerances import LEAST_EVALUATIONS, with_tolerances
from discrepancy.rigs.axis import axis_case
from estimation.response import experiment as module
from estimation.response.perturbations import InputPerturbation, PerturbationResponse, cheaper_by_transition_matrices
from multibody.base.errors import SimulationError


@pytest.fixture(scope="module")
def sticking():
    """One record of the axis with dry friction at its elastic coupling: rates of 2e6/s while it sticks."""
    problem = axis_case(2000).problem(seed=1)
    place = next(p for p in problem.model.places() if p.name == "coupling")
    friction = Effect.at_place("coulomb_friction", place, strengths={"coulomb": 0.26}, shape={"v_s": 2.5e-3})
    experiment = problem.identify[0]
    system = friction.added_to(problem.model).build(probes=True, outputs=experiment.outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    return problem, experiment, system, p


def perturbations(experiment):
    t = np.array(experiment.record.time)
    bell = np.exp(-(((t - t.mean()) / 0.1) ** 2))  # begins with 1e-390
    return [InputPerturbation(f"probe.{where}", f) for where in ("coupling", "motor") for f in (np.sin(5 * t), bell)]


def test_derivatives_cost_few_evaluations_more(sticking):
    _, experiment, system, p = sticking
    for rtol in (1e-5, 2e-6, 3e-7, 1e-7):  # half a million where the stiff stretches are overlooked
        assert replace(experiment, rtol=rtol).respond(system, p).evaluations < 100_000
    alone = experiment.respond(system, p).evaluations
    assert alone < 100_000
    assert experiment.respond(system, p, perturbations=perturbations(experiment)).evaluations < 5 * alone


def test_transitions_agree_with_the_integrated_derivatives(sticking, monkeypatch):
    _, experiment, system, p = sticking
    given = perturbations(experiment)
    monkeypatch.setattr("estimation.response.experiment.cheaper_by_transition_matrices", lambda *_: False)
    integrated = experiment.respond(system, p, perturbations=given).derivatives
    experiment = replace(experiment, rtol=1e-5)  # the outputs may be less exact than what the transitions need
    channels = tuple(dict.fromkeys(q.channel for q in given))
    found = PerturbationResponse.along(experiment.simulation(system, p), channels)
    carried = experiment._prepared(found.outputs, found(given), (), [], []).derivatives
    size = np.linalg.norm(integrated, axis=(0, 1))
    assert np.all(np.linalg.norm(carried - integrated, axis=(0, 1)) < 0.02 * size)


def test_kept_transitions_serve_a_few_perturbations_too(sticking):
    _, experiment, system, p = sticking
    experiment = replace(experiment)  # nothing kept
    given, x0 = perturbations(experiment), experiment.start_vector(system)
    assert not cheaper_by_transition_matrices(system, given[:1], np.size(experiment.record.time))
    integrated = experiment.respond(system, p, x0, perturbations=given[:1])
    assert integrated.evaluations > 0
    kept = experiment.perturbation_response(system, p, x0, given)
    assert kept.serves(given[:1])
    carried = experiment.respond(system, p, x0, perturbations=given[:1])
    np.testing.assert_array_equal(
        carried.derivatives, experiment._prepared(kept.outputs, kept(given[:1]), (), [], []).derivatives
    )
    assert experiment.respond(system, 1.01 * p, x0, perturbations=given[:1]).evaluations > 0  # of another model
    assert not kept.serves([InputPerturbation("reference.position", given[0].values)])
    assert not kept.serves([])  # a simulation without directions is another thing


def test_a_simulation_with_too_many_evaluations_is_given_up(sticking):
    problem, experiment, system, p = sticking
    bounded = with_tolerances(problem).identify[0]
    assert bounded.max_evaluations > LEAST_EVALUATIONS
    assert bounded.respond(system, p).evaluations < bounded.max_evaluations  # one that sticks is still simulated
    with pytest.raises(SimulationError, match=r"more than the 100 allowed by then, came only to t ="):
        replace(experiment, max_evaluations=100).respond(system, p)


def test_matrices_that_do_not_fit_into_memory_are_no_choice(sticking, monkeypatch):
    _, experiment, system, p = sticking
    given = [InputPerturbation("probe.motor", np.sin(k * np.array(experiment.record.time))) for k in range(1, 30)]
    carried = experiment.respond(system, p, perturbations=given)
    monkeypatch.setenv("VTSDT_MEMORY", "0.001")
    assert not cheaper_by_transition_matrices(system, given, np.size(experiment.record.time))
    integrated = replace(experiment, rtol=1e-8).respond(system, p, perturbations=given)
    assert integrated.evaluations > 0
    np.testing.assert_allclose(integrated.outputs, carried.outputs, rtol=1e-3, atol=1e-5 * np.ptp(carried.outputs))


@pytest.mark.parametrize("at_once", [1, 7, 64])
def test_how_many_are_in_memory_at_a_time_changes_nothing(sticking, monkeypatch, at_once):
    _, experiment, system, p = sticking
    given = [InputPerturbation("probe.motor", np.sin(k * np.array(experiment.record.time))) for k in range(1, 30)]
    whole = experiment.respond(system, p, perturbations=given)
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    parts = experiment.respond(system, p, perturbations=given)
    np.testing.assert_allclose(parts.derivatives, whole.derivatives, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(parts.outputs, whole.outputs)


def test_more_threads_than_perturbations_change_nothing(sticking):
    _, experiment, system, p = sticking
    given = [InputPerturbation("probe.motor", np.sin(k * np.array(experiment.record.time))) for k in range(1, 30)]
    assert cheaper_by_transition_matrices(system, given, np.size(experiment.record.time))
    one, many = (experiment.respond(system, p, perturbations=given, workers=w).derivatives for w in (1, 64))
    np.testing.assert_allclose(many, one, rtol=1e-12, atol=1e-15)
