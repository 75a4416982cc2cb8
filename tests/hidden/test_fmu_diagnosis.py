"""A machine that was exported and read back is given the same diagnosis as the native model."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import multibody.library as lib
from discrepancy import Study
from discrepancy.rigs.axis_model import build
from multibody import Model
from multibody.fmi.compiler import c_compiler

pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

FORCE = 30.0  # N, of the dry friction that both models lack
STUDY = """
[model]
{model}
{connections}
[inputs]
"reference.position" = "reference_m"
[outputs]
"motor.torque" = {{ column = "torque_Nm", noise = 2e-3 }}
"carriage.position" = {{ column = "position_m", noise = 1e-6 }}
[records]
time = "time_s"
identify = ["a.csv"]
validate = ["b.csv"]
[candidates]
include = ["coulomb_friction@guide", "constant_force@guide"]
[study]
residual = "simulation"
search = "significance"
max_effects = 1
[initial]
"motor.angle" = 0.0
"motor.speed" = 0.0
"controller.integral" = 0.0
"carriage.position" = 0.0
"carriage.velocity" = 0.0
"""


def pushed_axis() -> Model:
    """Return the axis with an input for a force on its carriage."""
    model = build()
    push = model.add("push", lib.ForceSource())
    model.connect(push.flange, "carriage.flange")
    model.input("F_ext", push.force, default=0.0)
    return model


def write_records(folder: Path) -> None:
    """Write two records of the axis with dry friction in its guide."""
    system = build(coulomb=FORCE).build()
    rng = np.random.default_rng(3)
    times = np.arange(0.0, 0.4 + 1e-9, 4e-3)
    for name, amplitude in (("a", 6e-3), ("b", 4e-3)):
        reference = amplitude * np.sin(2.0 * np.pi * 2.5 * times) ** 2
        run = system.simulate(0.4, times=times, inputs={"reference.position": (times, reference)})
        torque = run["motor.torque"] + 2e-3 * rng.standard_normal(times.size)
        position = run["carriage.position"] + 1e-6 * rng.standard_normal(times.size)
        table = np.column_stack([times, reference, torque, position])
        np.savetxt(
            folder / f"{name}.csv", table, "%.9g", ",", header="time_s,reference_m,torque_Nm,position_m", comments=""
        )


def diagnosed(folder: Path, model: str, connections: str = "") -> Any:
    path = folder / f"{'foreign' if connections else 'native'}.toml"
    path.write_text(STUDY.format(model=model, connections=connections))
    return Study.from_file(path).diagnose()


def test_an_exported_axis_has_the_diagnosis_of_the_native_one(tmp_path: Path) -> None:
    write_records(tmp_path)
    pushed_axis().build().to_fmu(tmp_path / "axis.fmu")
    (tmp_path / "axis.py").write_text("from discrepancy.rigs.axis_model import build\n")
    native = diagnosed(tmp_path, 'build = "axis.py:build"')
    connection = '"guide" = { force = "F_ext", motion = "carriage.position", rate = "carriage.velocity" }'
    foreign = diagnosed(tmp_path, 'fmu = "axis.fmu"', f"[connections]\n{connection}")
    assert (native.verdict, foreign.verdict) == ("effect found", "effect found")
    (one,), (other,) = native.final.effects, foreign.final.effects
    assert (one.kind, one.where) == (other.kind, other.where) == ("coulomb_friction", "guide")
    assert one.strengths["coulomb"] == pytest.approx(FORCE, rel=0.1)
    assert other.strengths["coulomb"] == pytest.approx(one.strengths["coulomb"], rel=1e-3)
    ours, theirs = (d.final.rmse("validate") for d in (native, foreign))
    assert theirs == pytest.approx(ours, rel=1e-3)


@pytest.mark.slow  # 2 minutes: in a fit with the effect, each of some hundred runs takes a thousand communication steps
def test_a_unit_for_co_simulation_alone_has_the_diagnosis_of_the_machine(tmp_path: Path) -> None:
    write_records(tmp_path)
    path = pushed_axis().build().to_fmu(tmp_path / "axis.fmu", fmi_version="2.0")
    with zipfile.ZipFile(path) as file:
        content = {name: file.read(name) for name in file.namelist()}
    described = content["modelDescription.xml"].decode()
    stepped = re.sub("<ModelExchange.*?</ModelExchange>", "", described, flags=re.DOTALL)
    assert stepped != described
    with zipfile.ZipFile(path, "w") as file:
        for name, data in (content | {"modelDescription.xml": stepped.encode()}).items():
            file.writestr(name, data)
    connection = '"guide" = { force = "F_ext", motion = "carriage.position", rate = "carriage.velocity" }'
    study = STUDY.partition("[initial]")[0].format(model='fmu = "axis.fmu"', connections=f"[connections]\n{connection}")
    (tmp_path / "study.toml").write_text(study)
    found = Study.from_file(tmp_path / "study.toml").diagnose()
    assert found.verdict == "effect found"
    (effect,) = found.final.effects
    assert (effect.kind, effect.where) == ("coulomb_friction", "guide")
    assert effect.strengths["coulomb"] == pytest.approx(FORCE, rel=0.01)
    errors = found.final.rmse("validate")
    assert errors["motor.torque"] < 1.1 * 2e-3  # the noise of the records
    assert errors["carriage.position"] < 1.1 * 1e-6
