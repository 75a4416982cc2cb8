"""The whole loop on the gear rig with encoders, from recordings to a verdict; some two minutes of CPU time a case."""

from __future__ import annotations

import pytest

from discrepancy.study.study import Study
from gearbox.rig.encoders import make_encoders
from gearbox.rig.rig import GearRig


def diagnosed(folder, hide, seed):
    return Study.from_file(make_encoders(folder, hide, rig=GearRig(seed=seed))).diagnose()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_hidden_nothing_missing(tmp_path, seed) -> None:
    """The rig's shafts have six motions and other contact parameters: recalibration takes care of that."""
    found = diagnosed(tmp_path, [], seed)
    assert found.verdict == "nothing missing"
    refused = {(kind, where) for kind, where, _ in found.refused}
    assert {("unbalance", "input_shaft"), ("unbalance", "output_shaft")} <= refused  # encoders cannot speak of it


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "where", "seed"), [("output", "mesh.gear_2", 3), ("input", "mesh.gear_1", 4)])
def test_an_eccentric_gear_is_found_on_its_shaft(tmp_path, gear, where, seed) -> None:
    found = diagnosed(tmp_path, [f"eccentricity@{gear}_gear"], seed)
    assert found.verdict == "effect found"
    (effect,) = found.stages[-1].effects
    assert (effect.kind, effect.where) == ("eccentricity", where)
    before, after = (s.rmse("validate")["transmission_error"] for s in (found.stages[1], found.stages[-1]))
    assert after < 0.05 * before
    truth = GearRig(seed=seed).faults_of([f"eccentricity@{gear}_gear"])[0].size
    fitted = sum(v**2 for v in effect.strengths.values()) ** 0.5
    assert fitted == pytest.approx(truth, rel=0.05)


@pytest.mark.slow
def test_a_varying_stiffness_of_the_teeth_is_told_from_an_eccentric_gear(tmp_path) -> None:
    """Both move the encoders once a turn; they differ in how that goes with the load, if the exponent is not held."""
    found = diagnosed(tmp_path, ["mesh_stiffness_variation@output_gear"], 5)
    assert found.verdict == "effect found"
    first = found.stages[-1].effects[0]
    assert (first.kind, first.where) == ("mesh_stiffness_variation", "mesh.gear_2")
    truth = GearRig(seed=5).faults_of(["mesh_stiffness_variation@output_gear"])[0].size
    assert sum(v**2 for v in first.strengths.values()) ** 0.5 == pytest.approx(truth, rel=0.2)
