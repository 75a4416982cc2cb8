"""What a search does not keep of every model that it tries: input tables of its own, nominal runs, matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.evidence.likelihood import StageLikelihood
from estimation.response.perturbations import InputPerturbation


@pytest.fixture
def likelihood(small_study):
    stage = small_study.stages[1]
    for fit in stage.identify.fits:
        fit.experiment.clear_cache()
    return StageLikelihood(stage=stage.without_results())


def test_models_on_the_same_records_share_their_input_tables(likelihood) -> None:
    fit = likelihood.stage.identify.fits[0]
    noisy = replace(fit.experiment, input_noise={fit.experiment.inputs[0]: 0.1})
    system = likelihood.linearised.slim
    table = noisy.without_input_noise().table(system)
    assert noisy.without_input_noise().input_noise == {}
    assert noisy.table(system) is table
    assert noisy.without_input_noise().with_preparation(noisy.preparation).table(system) is table


def test_what_was_dropped_is_computed_again_to_the_last_bit(likelihood) -> None:
    linearised = likelihood.linearised
    experiment, start = linearised.experiments[0], linearised.initial_state(0)
    force = InputPerturbation(f"probe.{linearised.system.places[0].name}", np.ones(experiment.record.time.size))
    runs, curves = linearised.nominal_outputs(0), linearised.free_curves()
    matrices = experiment.perturbation_response(linearised.slim, linearised.p, start, [force])
    assert experiment.perturbation_response(linearised.slim, linearised.p, start, [force]) is matrices
    likelihood.free_memory()
    for name, values in linearised.nominal_outputs(0).items():
        assert values.base is not runs[name].base
        np.testing.assert_array_equal(values, runs[name])
    assert linearised.free_curves() is not curves
    again = experiment.perturbation_response(linearised.slim, linearised.p, start, [force])
    assert again is not matrices
    np.testing.assert_array_equal(again([force]), matrices([force]))
