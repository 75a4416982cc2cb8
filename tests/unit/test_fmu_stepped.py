"""A unit that offers Co-Simulation alone: stepped from sample to sample, derivatives by differences of whole runs."""

from __future__ import annotations

import re
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import multibody.library as lib
from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.questions.plausibility import check_problem
from discrepancy.rigs.axis_model import build as axis_model
from estimation.response.run_differences import derivatives_of_runs
from multibody import Model
from multibody.base.errors import SimulationError
from multibody.fmi.compiler import c_compiler
from multibody.fmi.component import Fmu, Gap
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import read_unit
from multibody.machine.model import System
from multibody.solvers.problem import Directions

pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

T_END, STEP = 0.05, 1e-3  # s
#: Of a range.  FMI 2.0 gives inputs their slopes, so that what is left is the error of both integrations; FMI 3.0 holds
#: them, and steps are halved until that changes less than 1e-3.
CLOSE = {"2.0": 1e-6, "3.0": 1e-3}
CONNECTION = {"guide": {"force": "F_ext", "motion": "carriage.position", "rate": "carriage.velocity"}}
STUDY = """
[model]
fmu = "axis.fmu"

[uncertain]
"carriage.m" = { std = 1.0 }

[inputs]
"reference.position" = "r"

[outputs]
"motor.torque" = { column = "torque", noise = 1e-4 }

[records]
time = "t"
identify = ["run.csv"]
"""


def pushed_axis() -> Model:
    """Return the axis with an input for a force on its carriage."""
    model = axis_model()
    push = model.add("push", lib.ForceSource())
    model.connect(push.flange, "carriage.flange")
    model.input("F_ext", push.force, default=0.0)
    return model


def edit(path: Path, pattern: str, new: str) -> None:
    """Change the model description of a unit."""
    with zipfile.ZipFile(path) as file:
        content = {name: file.read(name) for name in file.namelist()}
    before = content["modelDescription.xml"].decode()
    after = re.sub(pattern, new, before, flags=re.DOTALL)
    assert after != before
    content["modelDescription.xml"] = after.encode()
    with zipfile.ZipFile(path, "w") as file:
        for name, data in content.items():
            file.writestr(name, data)


def without_model_exchange(path: Path) -> Path:
    edit(path, r"<ModelExchange.*?</ModelExchange>|<ModelExchange[^>]*/>", "")
    return path


@pytest.fixture(scope="module")
def axis() -> System:
    return pushed_axis().build()


@pytest.fixture(scope="module", params=("2.0", "3.0"))
def version(request: Any) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def unit(version: str, axis: System, tmp_path_factory: Any) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "axis.fmu"
    return without_model_exchange(axis.to_fmu(path, fmi_version=version))


@pytest.fixture
def second(axis: System, tmp_path: Path) -> Path:
    return without_model_exchange(axis.to_fmu(tmp_path / "axis.fmu", fmi_version="2.0"))


def plant_of(path: Path, **connections: Any) -> Model:
    model = Model("plant")
    plant = model.add("plant", Fmu(path, **connections))
    model.input("reference.position", plant.reference_position)
    return model


def inputs() -> dict[str, Any]:
    times = np.arange(0.0, T_END + STEP, STEP)
    return {"reference.position": (times, 2e-3 * np.sin(np.pi * times / T_END) ** 2)}


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.max(np.abs(one - other)) / np.ptp(other))


def test_it_moves_as_the_machine_that_it_was_made_from(version: str, unit: Path, axis: System) -> None:
    own = axis.simulate(T_END, step=STEP, inputs=inputs(), rtol=1e-9, atol=1e-12)
    model = plant_of(unit)
    read = model.build().simulate(T_END, step=STEP, inputs=inputs())
    assert model.stepped_part == "plant"
    for name in (*axis.state_names, "motor.torque"):
        assert apart(read[f"plant.{name.replace('.', '_')}"], own[name]) < CLOSE[version], name


def with_friction(model: Model, *nodes: str) -> System:
    friction = model.add("extra", lib.CoulombFriction(coulomb=30.0))
    model.connect(*nodes, friction.b)
    model.connect(friction.a, model.ground)
    return model.build()


def test_an_effect_acts_back_at_a_connection(unit: Path, axis: System) -> None:
    own = with_friction(pushed_axis(), "carriage.flange").simulate(T_END, step=STEP, inputs=inputs())
    model = plant_of(unit, connections=CONNECTION)
    gap = model.add("guide", Gap())
    model.connect("plant.guide", gap.b)
    model.connect(gap.a, model.ground)
    read = with_friction(model, "guide.b").simulate(T_END, step=STEP, inputs=inputs())
    without = axis.simulate(T_END, step=STEP, inputs=inputs())
    at, name = "plant.motor_torque", "motor.torque"
    assert apart(without[name], own[name]) > 0.1
    assert apart(read[at], own[name]) < 5e-3  # steps are halved until that changes less than 1e-3


def test_derivatives_of_whole_runs_are_those_of_the_machine(axis: System, second: Path) -> None:
    rows = [f"{0.001 * k:.3f},{2e-3 * np.sin(0.06 * k) ** 2:.9f},{0.01 * (k % 7):.3f}" for k in range(200)]
    (second.parent / "run.csv").write_text("t,r,torque\n" + "\n".join(rows) + "\n")
    (second.parent / "study.toml").write_text(STUDY)
    problem = read_problem(second.parent / "study.toml")
    record = problem.identify[0]
    names = ("carriage.m", "motor.J", "controller.k_v")
    names = tuple(n for n in names if n in axis.parameter_names)
    system = problem.model.build(outputs=record.outputs)
    ours = record.respond(system, system.p, parameters=[f"plant.{n.replace('.', '_')}" for n in names])
    exact = record.respond(axis, axis.p, parameters=names)
    for k, name in enumerate(names):
        # a central difference that changes the output by 1e-3 is wrong by the square of that and by both integrations
        assert apart(ours.derivatives[:, 0, k], exact.derivatives[:, 0, k]) < 2e-3, name


def study(second: Path, text: str) -> Path:
    rows = [f"{0.001 * k:.3f},{1e-6 * k:.7f},{0.01 * (k % 7):.3f}" for k in range(200)]
    (second.parent / "run.csv").write_text("t,r,torque\n" + "\n".join(rows) + "\n")
    path = second.parent / "study.toml"
    path.write_text(text)
    return path


def test_check_says_how_it_is_searched(second: Path) -> None:
    check = check_problem(read_problem(study(second, STUDY)), excitation=False)
    (fact,) = [f for f in check.facts if f.startswith("sensitivities of 'plant'")]
    assert "differences of whole runs" in fact
    assert "neither states nor rates, so that the search is by significance" in fact


@pytest.mark.parametrize(
    ("asked", "remedy"),
    [
        ('search = "evidence"', 'use search = "significance"'),
        ('residual = "prediction"', 'use residual = "simulation"'),
        ('residual = "inverse"', 'use residual = "simulation"'),
    ],
)
def test_what_it_cannot_be_asked_is_said(asked: str, remedy: str, second: Path) -> None:
    with pytest.raises(StudyError, match=f"{asked}.*neither states nor rates.*{remedy}.*Model Exchange"):
        read_problem(study(second, STUDY + f"[study]\n{asked}\n"))


def test_a_unit_with_state_events_is_stepped(axis: System, tmp_path: Path) -> None:
    path = axis.to_fmu(tmp_path / "axis.fmu", fmi_version="2.0")
    edit(path, 'numberOfEventIndicators="0"', 'numberOfEventIndicators="2"')
    assert read_unit(path).stepped
    edit(path, r"<CoSimulation.*?</CoSimulation>", "")
    with pytest.raises(FmuError, match=r"2 event indicators.*for Co-Simulation"):
        read_unit(path)


def test_neither_form_is_refused(second: Path) -> None:
    edit(second, r"<CoSimulation.*?</CoSimulation>", "")
    with pytest.raises(FmuError, match="neither Model Exchange nor Co-Simulation"):
        read_unit(second)


def test_steps_of_one_size_that_do_not_fit_the_samples(second: Path) -> None:
    edit(second, 'canHandleVariableCommunicationStepSize="true"', "")
    edit(second, '<DefaultExperiment startTime="0"', '<DefaultExperiment startTime="0" stepSize="0.0005"')
    system = plant_of(second).build()
    assert np.all(np.isfinite(system.simulate(T_END, step=STEP, inputs=inputs())["plant.motor_torque"]))
    with pytest.raises(SimulationError, match=r"steps of 0\.0005 s alone.*resample"):
        system.simulate(T_END, step=0.8e-3, inputs=inputs())


def test_functions_of_time_are_refused(second: Path) -> None:
    with pytest.raises(SimulationError, match=r"give inputs as numbers or \(times, values\)"):
        plant_of(second).build().simulate(T_END, inputs={"reference.position": np.sin})


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("begin > 0.0105 ? fmi2Error :", r"communication step of 0\.001 s at t = 0\.011 s"),
        ("begin > 0.0105 ? (abort(), fmi2OK) :", "ended by signal 6"),
    ],
)
def test_a_step_that_goes_wrong_is_told(body: str, said: str, second: Path) -> None:
    rebuilt(second, f"return {body} {STEP_CALL}")
    with pytest.raises(SimulationError, match=said):
        plant_of(second).build().simulate(T_END, step=STEP, inputs=inputs())


STEP_CALL = "STATUS[communication_step(m, begin, size)];"
#: A communication step by forward Euler, as tools take it that do not control their steps.
EULER = """
    need_rates(m);
    for (int i = 0; i < NX; i++) m->now.value[X + i] += size * m->now.value[DX + i];
    set_time(m, begin + size);
    return fmi2OK;"""


def rebuilt(path: Path, body: str) -> None:
    """Compile a unit anew whose communication step is other code."""
    folder = path.parent / "spoilt"
    with zipfile.ZipFile(path) as file:
        file.extractall(folder)
    source = folder / "sources/fmi2.c"
    text = source.read_text()
    assert f"return {STEP_CALL}" in text
    source.write_text(text.replace(f"return {STEP_CALL}", body))
    library = next(p for p in (folder / "binaries").rglob("*.*") if p.is_file())
    command = [*c_compiler(), "-std=c99", "-fPIC", "-shared", "-o", str(library), str(source), "-lm"]  # type: ignore[misc]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(path, "w") as file:
        for member in folder.rglob("*"):
            file.write(member, member.relative_to(folder))


def damped(path: Path, viscous: float) -> Path:
    """Write a unit of a damped mass, 1 kg, that is pulled; it integrates by forward Euler."""
    model = Model("damped")
    body = model.add("body", lib.Mass(m=1.0))
    friction = model.add("friction", lib.ViscousFriction(viscous=viscous))
    pull = model.add("pull", lib.ForceSource())
    model.connect(body.flange, friction.b, pull.flange)
    model.connect(friction.a, model.ground)
    model.input("force", pull.force, default=0.0)
    without_model_exchange(model.build().to_fmu(path, fmi_version="2.0"))
    rebuilt(path, EULER)
    return path


DAMPED_STUDY = """
[model]
fmu = "damped.fmu"
[inputs]
"force" = "f"
[outputs]
"body.velocity" = { column = "v", noise = 1e-4 }
[records]
time = "t"
identify = ["run.csv"]
"""


@pytest.mark.parametrize(("viscous", "warned"), [(0.1, False), (8e4, True)])
def test_a_stiff_unit_that_integrates_by_forward_euler_is_warned_about(
    viscous: float, warned: bool, tmp_path: Path
) -> None:
    damped(tmp_path / "damped.fmu", viscous)
    rows = [f"{0.001 * k:.3f},{np.sin(0.02 * k):.6f},{np.sin(0.02 * k) / viscous:.9f}" for k in range(200)]
    (tmp_path / "run.csv").write_text("t,f,v\n" + "\n".join(rows) + "\n")
    (tmp_path / "study.toml").write_text(DAMPED_STUDY)
    check = check_problem(read_problem(tmp_path / "study.toml"), excitation=False)
    said = [w for w in check.warnings if "stepped 64 times between samples" in w and "forward Euler" in w]
    assert len(said) == warned, check.warnings


def test_a_run_does_not_depend_on_the_runs_before_it(second: Path) -> None:
    model = plant_of(second, connections=CONNECTION)
    gap = model.add("guide", Gap())
    model.connect("plant.guide", gap.b)
    model.connect(gap.a, model.ground)
    system = with_friction(model, "guide.b")
    at = "plant.carriage_velocity"

    def run(coulomb: float) -> np.ndarray:
        return system.simulate(T_END, step=STEP, inputs=inputs(), parameters={"extra.coulomb": coulomb})[at]

    strong = run(30.0)
    run(0.0)  # which needs no short steps
    assert np.array_equal(run(30.0), strong)


def test_it_cannot_be_exported_again(second: Path, tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="'plant' is evaluated by Python alone"):
        plant_of(second).build().to_fmu(tmp_path / "again.fmu")


def test_differences_keep_to_the_bounds_of_parameters() -> None:
    time = np.linspace(0.0, 1.0, 11)
    asked: list[float] = []

    def run(p: np.ndarray, x0: np.ndarray, extra: dict[int, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        asked.append(float(p[0]))
        added = sum((values for _, values in extra.values()), np.zeros(time.size))
        return (np.sin(time) + p[0] * time + x0[0] + 5.0 * added)[:, None]

    directions = Directions(
        x0_dot=np.array([[0.0], [1.0], [0.0]]),
        p_dot=np.array([[1.0], [0.0], [0.0]]),
        channel=np.array([-1, -1, 0]),
        shape_t=time,
        shape=np.column_stack([np.zeros((time.size, 2)), time]),
    )
    p, x0 = np.zeros(1), np.array([2.0])
    bounds = np.array([[0.0, np.nan]])
    found = derivatives_of_runs(run, run(p, x0, {}), p, x0, time, bounds, directions)[:, 0]
    assert min(asked) >= 0.0
    assert np.allclose(found, np.column_stack([time, np.ones(time.size), 5.0 * time]), rtol=1e-9)


def test_the_folder_goes_with_the_process(second: Path) -> None:
    from multibody.fmi import foreign

    plant_of(second).build().simulate(T_END, step=STEP, inputs=inputs())
    running = next(v for v in foreign._running.values() if v.path == second)
    running.stop()
    assert not running.folder.path.exists()
