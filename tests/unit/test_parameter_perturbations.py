"""Perturbations of parameters, by state-transition matrices, compared with their integrated derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.rigs.axis import axis_case
from estimation.response.perturbations import (
    InputPerturbation,
    ParameterPerturbation,
    cheaper_by_transition_matrices,
)


@pytest.fixture(scope="module")
def rubbing():
    """One record of the axis, and friction of no strength at its guide."""
    problem = axis_case(2000).problem(seed=1)
    place = next(p for p in problem.model.places() if p.name == "guide")
    friction = Effect.at_place("coulomb_friction", place, strengths={"coulomb": 0.0}, shape={"v_s": 2.5e-3})
    experiment = problem.identify[0]
    system = friction.added_to(problem.model).build(probes=True, outputs=experiment.outputs)
    return experiment, system, system.parameter_vector({q.name: q.value for q in problem.uncertain}), friction


def test_changes_agree_with_the_integrated_derivatives(rubbing):
    experiment, system, p, friction = rubbing
    names = {n.rpartition(".")[2]: n for n in friction.parameters()}
    others = [n for n in system.parameter_names if n.endswith((".mass", ".m", ".J", ".damping"))][:4]
    assert others
    changes = [ParameterPerturbation(n) for n in others]
    changes += [ParameterPerturbation(names["coulomb"], ((names["v_s"], v),)) for v in (2.5e-3, 0.05)]
    carried = experiment.respond(system, p, perturbations=changes).derivatives
    for k, change in enumerate(changes):
        own = p.copy()
        for name, value in change.evaluated_at:
            own[system.index("parameter", name)] = value
        exact = experiment.respond(system, own, parameters=[change.parameter]).derivatives[:, :, 0]
        assert np.linalg.norm(exact) > 0.0
        assert np.linalg.norm(carried[:, :, k] - exact) < 0.01 * np.linalg.norm(exact)
    assert np.linalg.norm(carried[:, :, -1] - carried[:, :, -2]) > 0.1 * np.linalg.norm(carried[:, :, -1])


def test_changes_and_input_perturbations_share_their_transitions_in_any_order(rubbing):
    experiment, system, p, friction = rubbing
    experiment = replace(experiment)  # nothing kept
    x0, time = experiment.start_vector(system), np.array(experiment.record.time)
    shape, strength = sorted(friction.parameters(), key=lambda n: n.endswith("coulomb"))
    mixed = [
        ParameterPerturbation(strength, ((shape, 0.05),)),
        InputPerturbation("probe.guide", np.sin(time)),
        ParameterPerturbation(strength),
    ]
    kept = experiment.perturbation_response(system, p, x0, mixed)
    assert kept.channels == (
        "probe.guide",
        ParameterPerturbation(strength),
        ParameterPerturbation(strength, ((shape, 0.05),)),
    )
    assert experiment.perturbation_response(system, p, x0, mixed[::-1]) is kept
    whole = kept(mixed)
    for k, one in enumerate(mixed):
        np.testing.assert_allclose(whole[:, :, k], kept([one])[:, :, 0], rtol=1e-9, atol=1e-15)
    samples = np.size(experiment.record.time)
    assert not cheaper_by_transition_matrices(
        system, [ParameterPerturbation(n) for n in system.parameter_names], samples
    )  # each is a column of its own


def test_parameters_and_start_values_do_not_go_with_changes(rubbing):
    experiment, system, p, friction = rubbing
    with pytest.raises(ValueError, match="ParameterPerturbation"):
        experiment.respond(
            system,
            p,
            parameters=[next(iter(friction.parameters()))],
            perturbations=[ParameterPerturbation("guide.mass")],
        )
