"""Dry friction that was accepted at the wrong end of a stiff connection is moved by the exchange step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.from_scan_row import effect_of
from discrepancy.rigs.axis import axis_case
from discrepancy.search.moves.exchange import propose_exchange
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.study.study import Study

LATE = "sensor_delay@carriage.position"


def with_effect(study: Study, name: str) -> Stage:
    """Return the latest stage with an effect of its scan added, and add it to the stages."""
    before = study.stage
    experiment = before.identify.fits[0].experiment
    entries = {e.name: e for e in catalogue(before.system, experiment.outputs, experiment.inputs)}
    effect = effect_of(entries[name], before.scan[name], before.effects)
    stage = study.with_effect(effect)
    accepted = AcceptedEffect(effect=stage.effects[-1], p_value=0.001, delta_bic=-50.0)
    study.stages.append(replace(stage, accepted=accepted))
    return study.stage


@pytest.fixture(scope="module", params=["motor", "guide"])
def study(request):
    """Return a study of an axis with dry friction at the guide and a late sensor, which puts the friction somewhere."""
    place = request.param
    found = Study(axis_case(3, ["coulomb_friction@guide", LATE], trips=4).problem(seed=3))
    for name in (f"coulomb_friction@{place}", LATE):
        found.explain()  # makes the scan of the latest stage
        with_effect(found, name)
    return place, found


def test_the_friction_ends_where_it_acts(study):
    """The carriage follows the motor through a coupling, so friction at either looks nearly the same, but not quite."""
    place, search = study
    exchange = propose_exchange(search.stages, search.on_trial, search.progress)
    if place == "guide":
        assert exchange is None or str(exchange.old) != "coulomb_friction@guide"
        return
    assert exchange is not None
    assert (str(exchange.old), str(exchange.new)) == ("coulomb_friction@motor", "coulomb_friction@guide")
    assert exchange.index == 2
    assert exchange.improvement > DECISIVE_BIC
