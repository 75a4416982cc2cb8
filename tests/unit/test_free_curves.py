"""Sensitivities to free curves: computed once, together with those to the laws."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.effects.catalogue import catalogue
from discrepancy.sensitivities.candidates import candidate_sensitivities
from discrepancy.sensitivities.free_curve_scan import free_curve_candidates
from estimation.response.perturbations import PerturbationResponse
from estimation.signals.preparation import Preparation


@pytest.fixture
def anew(small_study):
    """Return a function that linearises the recalibrated stage along its records with nothing kept from before."""
    stage = small_study.stages[1]

    def begin():
        for fit in stage.identify.fits:
            fit.experiment.clear_cache()
        return stage.without_results().linearised_problem(Preparation(decimate=5, low_pass_hz=20.0))

    return begin


@pytest.fixture
def computed_matrices(monkeypatch):
    """Return the list of the channels of all state-transition matrices that are computed from now on."""
    found, real = [], PerturbationResponse.along

    def along(simulation, channels):
        found.append(channels)
        return real(simulation, channels)

    monkeypatch.setattr(PerturbationResponse, "along", along)
    return found


def arrays(candidates):
    return {c.name: c.sensitivities[0] for c in candidates}


def test_a_scan_computes_the_sensitivities_to_the_curves_too(anew, computed_matrices, monkeypatch):
    monkeypatch.setattr("estimation.response.experiment.KEPT_BYTES", 0)  # as of a machine with many states
    linearised = anew()
    outputs = linearised.experiments[0].outputs
    entries = catalogue(linearised.system, outputs, ("reference.speed",), include=["local_bump@*"])
    laws, _ = candidate_sensitivities(linearised, entries, curves=True)
    count = len(computed_matrices)
    assert count == len(linearised.experiments)
    curves = free_curve_candidates(linearised, linearised.system.places)
    one = free_curve_candidates(linearised, linearised.system.places[:1])
    assert len(computed_matrices) == count
    assert {c.where for c in one} == {linearised.system.places[0].name}
    for name, blocks in arrays(one).items():
        for block, whole in zip(blocks, arrays(curves)[name], strict=True):
            np.testing.assert_array_equal(block, whole)

    alone = anew()
    expected = arrays(free_curve_candidates(alone, alone.system.places))
    assert len(computed_matrices) == 2 * count
    assert arrays(curves).keys() == expected.keys()
    for name, blocks in expected.items():
        for block, made in zip(blocks, arrays(curves)[name], strict=True):
            np.testing.assert_allclose(made, block, rtol=1e-12, atol=1e-12 * np.max(np.abs(block)))

    plain = anew()
    without, _ = candidate_sensitivities(plain, entries)
    assert len(computed_matrices) == 3 * count
    for name, blocks in arrays(without).items():
        for block, made in zip(blocks, arrays(laws)[name], strict=True):
            np.testing.assert_allclose(made, block, rtol=1e-12, atol=1e-12 * np.max(np.abs(block)))
