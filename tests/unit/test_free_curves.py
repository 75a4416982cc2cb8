"""Columns of free curves: made once, along with those of the laws."""

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
    """Return a function that confronts the recalibrated stage with its records, nothing being worked out before."""
    stage = small_study.stages[1]

    def begin():
        for fit in stage.identify.fits:
            fit.experiment.clear_cache()
        return stage.without_results().linearised_problem(Preparation(decimate=5, low_pass_hz=20.0))

    return begin


@pytest.fixture
def transitions(monkeypatch):
    """Return the list of the channels of all transitions that are worked out from now on."""
    found, real = [], PerturbationResponse.along

    def told(simulation, channels):
        found.append(channels)
        return real(simulation, channels)

    monkeypatch.setattr(PerturbationResponse, "along", told)
    return found


def arrays(candidates):
    return {c.name: c.columns[0] for c in candidates}


def test_a_scan_makes_the_columns_of_the_curves_too(anew, transitions, monkeypatch):
    monkeypatch.setattr("estimation.response.experiment.KEPT_BYTES", 0)  # as of a machine with many states
    facts = anew()
    entries = catalogue(facts.system, facts.experiments[0].outputs, ("reference.speed",), include=["local_bump@*"])
    laws, _ = candidate_sensitivities(facts, entries, curves=True)
    count = len(transitions)
    assert count == len(facts.experiments)
    curves = free_curve_candidates(facts, facts.system.places)
    one = free_curve_candidates(facts, facts.system.places[:1])
    assert len(transitions) == count
    assert {c.where for c in one} == {facts.system.places[0].name}
    for name, blocks in arrays(one).items():
        for block, whole in zip(blocks, arrays(curves)[name], strict=True):
            np.testing.assert_array_equal(block, whole)

    alone = anew()
    expected = arrays(free_curve_candidates(alone, alone.system.places))
    assert len(transitions) == 2 * count
    assert arrays(curves).keys() == expected.keys()
    for name, blocks in expected.items():
        for block, made in zip(blocks, arrays(curves)[name], strict=True):
            np.testing.assert_allclose(made, block, rtol=1e-12, atol=1e-12 * np.max(np.abs(block)))

    plain = anew()
    without, _ = candidate_sensitivities(plain, entries)
    assert len(transitions) == 3 * count
    for name, blocks in arrays(without).items():
        for block, made in zip(blocks, arrays(laws)[name], strict=True):
            np.testing.assert_allclose(made, block, rtol=1e-12, atol=1e-12 * np.max(np.abs(block)))
