"""Effects of a gear stage are candidates of the missing-effect loop, by exact derivatives at severity zero.

A whole diagnosis takes minutes (`test_gear_diagnosis.py`), as every direction is integrated at the pace of the mesh.
Here the two things that it stands on are tested: what is offered, and that the derivative is the right one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from discrepancy.effects.catalogue import catalogue
from discrepancy.problem.problem import make_experiments
from estimation.files.record import Record, RecordedSignal
from gearbox.stage.effects import GEAR_KINDS
from gearbox.stage.stage import GearStage

OUTPUTS = {"transmission_error": "m", "drive_torque": "N*m"}
SPEED, TORQUE = 300.0, 100.0


def test_a_gear_stage_offers_its_effects() -> None:
    rich = GearStage.paper(imperfect=True, bearing_defects=True)
    system = rich.build(outputs=["a_base_y"], compiled=False)
    found = {e.name for e in catalogue(system, ["a_base_y"], ["torque"])}
    assert {k.name for k in GEAR_KINDS} <= {name.partition("@")[0] for name in found}
    assert {"eccentricity@mesh.gear_2", "unbalance@input_shaft", "bearing_defect@output_high", "wear@mesh"} <= found
    plain = GearStage.paper().build(outputs=["a_base_y"], compiled=False)
    names = {e.kind.name for e in catalogue(plain, ["a_base_y"], ["torque"])}
    assert "eccentricity" not in names  # a stage built without imperfections has none to offer
    assert "unbalance" in names


def test_the_derivative_by_a_severity_is_that_of_the_simulation() -> None:
    stage = GearStage.torsional(housing="clamped", imperfect=True)
    model = stage.moving(SPEED, TORQUE)
    time = np.arange(100) * 5e-4
    given = {"speed": (SPEED * np.pi / 30, "rad/s"), "torque": (TORQUE, "N*m")}
    signals = {
        n: RecordedSignal(values=np.full(time.size, v), unit=unit, column=n, measured_unit=unit)
        for n, (v, unit) in given.items()
    }
    signals |= {
        n: RecordedSignal(values=np.zeros(time.size), unit=unit, column=n, measured_unit=unit)
        for n, unit in OUTPUTS.items()
    }
    experiment = make_experiments(
        model, [Record(name="a", path=Path("a.csv"), time=time, signals=signals)], list(given), list(OUTPUTS)
    )[0]
    system = model.build(outputs=list(OUTPUTS))
    names = ["mesh.runout_x_2", "mesh.lobes_cos_1", "mesh.misalignment"]
    steps = {"mesh.runout_x_2": 5e-7, "mesh.lobes_cos_1": 5e-7, "mesh.misalignment": 1e-5}
    exact = experiment.respond(system, system.p, parameters=names).derivatives
    for k, name in enumerate(names):
        sides = []
        for sign in (-1.0, 1.0):
            p = system.p.copy()
            p[system.index("parameter", name)] += sign * steps[name]
            sides.append(experiment.simulate(system, p, experiment.start_vector(system)))
        difference = (sides[1] - sides[0]) / (2.0 * steps[name])
        for c in range(len(OUTPUTS)):
            # the differences bend with the contact's exponent over the step of half a micrometre on 30
            error = np.sqrt(np.mean((exact[:, c, k] - difference[:, c]) ** 2))
            assert error < 0.03 * np.sqrt(np.mean(difference[:, c] ** 2)), (name, c)
