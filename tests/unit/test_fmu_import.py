"""A foreign FMU as a component: the same machine as the native one, broken units refused, a process of its own."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import multibody.library as lib
from discrepancy.problem.problem import read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.questions.plausibility import check_problem
from discrepancy.rigs.axis_model import build as axis_model
from multibody import Model
from multibody.base.errors import SimulationError
from multibody.base.stopping import Stopped, stoppable
from multibody.fmi import foreign
from multibody.fmi.compiler import c_compiler
from multibody.fmi.component import Fmu, Gap
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import read_unit
from multibody.machine.model import System

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

ROOT = Path(__file__).resolve().parents[2]
CONNECTION = {"guide": {"force": "F_ext", "motion": "carriage.position", "rate": "carriage.velocity"}}
T_END, STEP = 0.03, 1e-3  # s: a question to the unit's process takes up to a millisecond on a busy machine


def pushed_axis() -> Model:
    """Return the axis with an input for a force on its carriage."""
    model = axis_model()
    push = model.add("push", lib.ForceSource())
    model.connect(push.flange, "carriage.flange")
    model.input("F_ext", push.force, default=0.0)
    return model


@pytest.fixture(scope="module")
def axis() -> System:
    return pushed_axis().build()


@pytest.fixture(scope="module", params=("2.0", "3.0"))
def unit(request: Any, axis: System, tmp_path_factory: Any) -> Path:
    return axis.to_fmu(tmp_path_factory.mktemp("fmu") / "axis.fmu", fmi_version=request.param)


@pytest.fixture(scope="module")
def good(axis: System, tmp_path_factory: Any) -> Path:
    return axis.to_fmu(tmp_path_factory.mktemp("good") / "axis.fmu", fmi_version="2.0")


@pytest.fixture
def second(good: Path, tmp_path: Path) -> Path:
    """Return a unit of FMI 2.0 that a test may spoil."""
    return Path(shutil.copy(good, tmp_path / "axis.fmu"))


def plant_of(path: Path, **connections: Any) -> Model:
    model = Model("plant")
    plant = model.add("plant", Fmu(path, **connections))
    model.input("reference.position", plant.reference_position)
    return model


def inputs() -> dict[str, Any]:
    times = np.arange(0.0, T_END + STEP, STEP)
    return {"reference.position": (times, 2e-3 * (times / T_END) ** 2)}


def test_read_back_it_moves_as_before(axis: System, unit: Path) -> None:
    own = axis.simulate(T_END, step=STEP, inputs=inputs())
    read = plant_of(unit).build().simulate(T_END, step=STEP, inputs=inputs())
    for name in (*axis.state_names, "motor.torque"):
        back = read[f"plant.{name.replace('.', '_')}"]
        assert np.allclose(back, own[name], rtol=1e-9, atol=1e-12), name


def test_exact_derivatives_come_back(axis: System, unit: Path) -> None:
    system = plant_of(unit).build()
    x = np.linspace(0.1, 0.3, len(axis.states))
    assert np.allclose(system.jacobian("x", 0.0, x), axis.jacobian("x", 0.0, x), rtol=1e-9, atol=1e-9)
    for name in axis.parameter_names:
        column = system.index("parameter", f"plant.{name.replace('.', '_')}")
        own = axis.jacobian("p", 0.0, x)[:, axis.index("parameter", name)]
        assert np.allclose(system.jacobian("p", 0.0, x)[:, column], own, rtol=1e-9, atol=1e-9), name


def test_without_derivatives_differences_serve(axis: System, second: Path) -> None:
    edit(second, lambda xml: xml.replace('providesDirectionalDerivative="true"', ""))
    assert not read_unit(second).derivatives
    system = plant_of(second).build()
    x = np.linspace(0.1, 0.3, len(axis.states))
    # central differences are right to the power 2/3 of the rounding
    own = axis.jacobian("x", 0.0, x)
    assert np.allclose(system.jacobian("x", 0.0, x), own, rtol=1e-6, atol=1e-7 * np.abs(own).max())


def test_a_unit_without_parameters_moves_as_before(axis: System, second: Path) -> None:
    parameter, constant = 'causality="parameter" variability="tunable"', 'causality="local" variability="constant"'
    edit(second, lambda xml: xml.replace(parameter, constant))
    assert not read_unit(second).parameters
    system = plant_of(second).build()
    run = system.simulate(T_END, step=STEP, inputs=inputs())
    own = axis.simulate(T_END, step=STEP, inputs=inputs())
    assert np.allclose(run["plant.carriage_position"], own["carriage.position"], rtol=1e-9, atol=1e-12)


def test_an_effect_acts_at_a_connection(unit: Path) -> None:
    native = pushed_axis()
    friction = native.add("extra", lib.ViscousFriction(viscous=5e4))
    native.connect(friction.b, "carriage.flange")
    native.connect(friction.a, native.ground)
    foreign_model = plant_of(unit, connections=CONNECTION)
    gap = foreign_model.add("guide", Gap())
    friction = foreign_model.add("extra", lib.ViscousFriction(viscous=5e4))
    foreign_model.connect("plant.guide", gap.b, friction.b)
    foreign_model.connect(gap.a, friction.a, foreign_model.ground)
    system = foreign_model.build()
    assert "guide" in {name for p in system.places for name in (p.name, *p.also)}
    own = native.build().simulate(T_END, step=STEP, inputs=inputs())
    read = system.simulate(T_END, step=STEP, inputs=inputs())
    assert np.allclose(read["plant.carriage_position"], own["carriage.position"], rtol=1e-6, atol=1e-9)
    without = pushed_axis().build().simulate(T_END, step=STEP, inputs=inputs())
    assert np.max(np.abs(without["carriage.position"] - own["carriage.position"])) > 1e-5


def test_units_of_the_other_tool_become_si(axis: System, second: Path) -> None:
    edit(second, lambda xml: xml.replace('<BaseUnit kg="1" />', '<BaseUnit kg="1" factor="0.001" />'))
    mass = next(v for v in read_unit(second).parameters if v.name == "carriage.m")
    assert (mass.unit, mass.factor) == ("kg", 1e-3)
    assert mass.start == pytest.approx(0.04)


def test_a_start_that_only_the_unit_knows_is_asked_for(axis: System, tmp_path: Path) -> None:
    path = axis.to_fmu(tmp_path / "axis.fmu", fmi_version="2.0", initial={"carriage.position": 0.003})

    def without(text: str) -> str:
        head, name, rest = text.partition('name="carriage.position"')
        rest = rest.replace('initial="exact"', 'initial="calculated"', 1).replace('start="0.003"', "", 1)
        return head + name + rest

    edit(path, without)
    start = {s.name: s.value for s in plant_of(path).build().states}
    assert start["plant.carriage_position"] == pytest.approx(0.003, abs=1e-15)


def test_model_is_saved_and_loaded(unit: Path, tmp_path: Path) -> None:
    model = plant_of(unit, connections=CONNECTION)
    model.connect("plant.guide", model.add("guide", Gap()).b)
    model.connect("guide.a", model.ground)
    back = Model.load(model.save(tmp_path / "model.json"))
    assert back.build().state_names == model.build().state_names


# ---------------------------------------------------------------- what is refused


def edit(path: Path, change: Callable[[str], str]) -> None:
    """Change the model description of a unit."""
    rewrite(path, {"modelDescription.xml": lambda data: change(data.decode()).encode()})


def rewrite(
    path: Path, changes: dict[str, Callable[[bytes], bytes | None]], extra: dict[str, bytes] | None = None
) -> None:
    with zipfile.ZipFile(path) as file:
        content = {name: file.read(name) for name in file.namelist()}
    before = dict(content)
    for name, data in before.items():
        for pattern, change in changes.items():
            if name.startswith(pattern):
                new = change(data)
                content.pop(name)
                if new is not None:
                    content[name] = new
    assert content != before or extra
    with zipfile.ZipFile(path, "w") as file:
        for name, data in {**content, **(extra or {})}.items():
            file.writestr(name, data)


def test_not_a_zip(tmp_path: Path) -> None:
    path = tmp_path / "plant.fmu"
    path.write_text("no zip")
    with pytest.raises(FmuError, match="is no FMU"):
        Fmu(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="cannot be read"):
        Fmu(tmp_path / "nothing.fmu")


@pytest.mark.parametrize("name", ["../../evil.so", "/etc/evil", "a\\..\\..\\evil"])
def test_path_that_climbs_out(name: str, second: Path) -> None:
    rewrite(second, {}, {name: b"x"})
    with pytest.raises(FmuError, match="outside the folder"):
        Fmu(second)


def test_no_description(second: Path) -> None:
    rewrite(second, {"modelDescription.xml": lambda _: None})
    with pytest.raises(FmuError, match=r"no modelDescription\.xml"):
        Fmu(second)


def test_spoilt_description(second: Path) -> None:
    edit(second, lambda xml: xml[: len(xml) // 2])
    with pytest.raises(FmuError, match="cannot be read"):
        Fmu(second)


def test_no_library(second: Path) -> None:
    rewrite(second, {"binaries/": lambda _: None})
    with pytest.raises(FmuError, match="it has none at all"):
        Fmu(second)


def test_other_platform(second: Path) -> None:
    rewrite(second, {"binaries/": lambda _: None}, {"binaries/vms64/axis.exe": b"x"})
    with pytest.raises(FmuError, match="it has libraries for vms64"):
        Fmu(second)


def test_all_faults_are_told_at_once(second: Path) -> None:
    def spoil(xml: str) -> str:
        xml = re.sub("<CoSimulation.*?</CoSimulation>", "", xml, flags=re.DOTALL)  # which would follow events itself
        return xml.replace('numberOfEventIndicators="0"', 'numberOfEventIndicators="3"').replace(
            'name="motor.J"', 'name="carriage.m"'
        )

    edit(second, spoil)
    with pytest.raises(FmuError) as caught:
        Fmu(second)
    assert "3 event indicators" in str(caught.value)
    assert "two variables have the name 'carriage.m'" in str(caught.value)


def test_library_that_is_none(second: Path) -> None:
    rewrite(second, {"binaries/": lambda _: b"no library"})
    with pytest.raises(SimulationError, match="refuses"):
        plant_of(second).build().rhs(0.0, np.zeros(5))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"force": "F_exit", "motion": "carriage.position", "rate": "carriage.velocity"}, "no input 'F_exit'.*F_ext"),
        ({"force": "F_ext", "motion": "carriage.position"}, "rate missing"),
        ({**CONNECTION["guide"], "mass": "x"}, "no key 'mass'"),
    ],
)
def test_connection_that_does_not_fit(given: dict[str, str], said: str, second: Path) -> None:
    with pytest.raises(FmuError, match=said):
        Fmu(second, connections={"guide": given})


def test_connection_with_the_name_of_a_variable(second: Path) -> None:
    with pytest.raises(FmuError, match=r"'carriage_position': .* has a variable of this name"):
        Fmu(second, connections={"carriage_position": CONNECTION["guide"]})


# ---------------------------------------------------------------- a process of its own


def replaced(path: Path, body: str) -> None:
    """Compile a unit anew whose rates are computed by other code."""
    folder = path.parent / "spoilt"
    with zipfile.ZipFile(path) as file:
        file.extractall(folder)
    source = folder / "sources/fmi2.c"
    text = source.read_text()
    assert "    return STATUS[get_rates(m, rates, n)];" in text
    source.write_text(text.replace("    return STATUS[get_rates(m, rates, n)];", body))
    library = next((folder / "binaries").rglob("axis.*"))
    command = [*c_compiler(), "-std=c99", "-fPIC", "-shared", "-o", str(library), str(source), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    data = library.read_bytes()
    rewrite(path, {"binaries/": lambda _: data})
    shutil.rmtree(folder)


def test_a_crash_is_told(second: Path) -> None:
    replaced(second, "    abort();")
    system = plant_of(second).build()
    with pytest.raises(SimulationError, match="ended by signal 6"):
        system.rhs(0.0, np.zeros(5))


def test_a_unit_that_hangs_is_stopped(second: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replaced(second, "    for (volatile int k = 0;; k++) {}\n    return fmi2OK;")
    system = plant_of(second).build()
    monkeypatch.setattr(foreign, "TIMEOUT", 1.0)
    with pytest.raises(SimulationError, match="has not answered for"):
        system.rhs(0.0, np.zeros(5))


SLOW = """    for (volatile long k = 0; k < 3000000; k++) {}
    return STATUS[get_rates(m, rates, n)];"""  # some milliseconds for each evaluation


def moved(system: System, until: float = T_END) -> np.ndarray:
    return np.array(system.simulate(until, step=STEP, inputs=inputs())["plant.carriage_position"])


def test_a_crash_while_it_integrates_is_told(second: Path) -> None:
    replaced(second, "    if (m->now.value[0] > 0.01) abort();\n    return STATUS[get_rates(m, rates, n)];")
    system = plant_of(second).build()
    for _ in range(2):  # the second time in a new process
        with pytest.raises(SimulationError, match="ended by signal 6"):
            moved(system)
    assert np.isfinite(moved(system, until=0.005)).all()


def test_a_hang_while_it_integrates_is_stopped(second: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loop = "for (volatile int k = 0;; k++) {}"
    replaced(second, f"    if (m->now.value[0] > 0.01) {loop}\n    return STATUS[get_rates(m, rates, n)];")
    system = plant_of(second).build()
    assert np.isfinite(moved(system, until=0.005)).all()
    monkeypatch.setattr(foreign, "TIMEOUT", 2.0)
    with pytest.raises(SimulationError, match="has not answered for"):
        moved(system)


def test_a_unit_that_refuses_while_it_integrates_is_told(second: Path) -> None:
    replaced(second, "    return m->now.value[0] > 0.01 ? fmi2Error : STATUS[get_rates(m, rates, n)];")
    with pytest.raises(SimulationError, match="refuses: it answers with status 3"):
        moved(plant_of(second).build())


def test_a_point_that_a_unit_discards_ends_the_step_and_not_the_run(axis: System, second: Path) -> None:
    once = "    static int k = 0;\n    if (++k == 50) return fmi2Discard;\n    return STATUS[get_rates(m, rates, n)];"
    replaced(second, once)
    own = axis.simulate(T_END, step=STEP, inputs=inputs())["carriage.position"]
    assert np.allclose(moved(plant_of(second).build()), own, atol=1e-4 * np.ptp(own))


def test_work_that_takes_long_is_no_hang_and_can_be_stopped(second: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replaced(second, SLOW)
    system = plant_of(second).build()
    moved(system, until=STEP)  # compiled
    monkeypatch.setattr(foreign, "TIMEOUT", 2.0)
    begun = time.monotonic()
    times = np.arange(0.0, 1000.0, 0.05)  # evaluations for minutes
    restless = {"reference.position": (times, 1e-3 * np.sin(20.0 * times))}
    with pytest.raises(Stopped, match="time limit"), stoppable(5.0):
        system.simulate(999.0, step=0.1, inputs=restless)
    assert 5.0 <= time.monotonic() - begun < 30.0
    assert np.isfinite(moved(system, until=STEP)).all()  # what was broken off is no answer to this


def test_threads_take_turns(unit: Path) -> None:
    system = plant_of(unit).build()
    alone = moved(system)
    with ThreadPoolExecutor(4) as threads:
        for found in threads.map(lambda _: moved(system), range(8)):
            assert np.array_equal(found, alone)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_has_a_unit_of_its_own(good: Path) -> None:
    system = plant_of(good).build()
    alone = moved(system)
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(moved(system), alone) else 1)
    assert np.array_equal(moved(system), alone)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_ctrl_c_is_for_the_one_who_asks(good: Path) -> None:
    system = plant_of(good).build()
    alone = moved(system)
    process = next(p for p in foreign._running.values() if p.path == good)
    process.process.send_signal(signal.SIGINT)
    assert np.array_equal(moved(system), alone)
    assert process.process.poll() is None


PLAIN = """
import sys
import numpy as np
from multibody import Model
from multibody.fmi.component import Fmu
model = Model("plant")
model.add("plant", Fmu(sys.argv[1]))
system = model.build()
x = np.linspace(0.1, 0.3, len(system.states))
run = system.simulate(2e-3, step=1e-3)
np.save(sys.argv[2], np.concatenate([run["plant.carriage_position"], system.jacobian("x", 0.0, x).ravel()]))
"""


def test_without_compilation_it_is_the_same(good: Path, tmp_path: Path) -> None:
    found = []
    for off in ("0", "1"):
        out = tmp_path / f"{off}.npy"
        environment = os.environ | {"NUMBA_DISABLE_JIT": off, "PYTHONPATH": str(ROOT)}
        subprocess.run([sys.executable, "-c", PLAIN, str(good), str(out)], check=True, env=environment)
        found.append(np.load(out))
    assert np.allclose(*found, rtol=1e-9, atol=1e-12)


ASKS = """
import sys
from pathlib import Path
from multibody.fmi.foreign import start_states
from multibody.fmi.foreign_description import file_digest
start_states(sys.argv[1], file_digest(Path(sys.argv[1])))
print("started", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("end", ["exits", "is killed", "is killed with the unit's process"])
def test_the_folder_of_a_unit_goes_however_its_user_ends(end: str, good: Path, tmp_path: Path) -> None:
    given: dict[str, Any] = {"env": os.environ | {"TMPDIR": str(tmp_path), "PYTHONPATH": str(ROOT)}, "text": True}
    command = [sys.executable, "-c", ASKS, str(good)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, start_new_session=True, **pipes, **given) as user:
        assert user.stdin is not None
        assert user.stdout is not None
        assert user.stderr is not None
        assert user.stdout.readline() == "started\n"
        assert len(list(tmp_path.iterdir())) == 1
        if end == "exits":
            user.stdin.close()
        elif end == "is killed":
            user.kill()
        else:
            os.killpg(user.pid, signal.SIGKILL)
        user.stderr.read()  # ends when the unit's process has ended, too
    if end == "is killed with the unit's process":
        assert len(list(tmp_path.iterdir())) == 1
        next_one = "from multibody.fmi.scratch_folder import ScratchFolder; ScratchFolder().remove()"
        subprocess.run([sys.executable, "-c", next_one], check=True, **given)
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- studies

STUDY = """
[model]
fmu = "axis.fmu"

[connections]
"guide" = { force = "F_ext", motion = "carriage.position", rate = "carriage.velocity" }

[uncertain]
"carriage.m" = { std = 1.0 }

[inputs]
"reference.position" = "r"

[outputs]
"motor.torque" = "torque"

[initial]
"motor.speed" = 0.0

[records]
time = "t"
identify = ["run.csv"]
"""


def study(second: Path, text: str = STUDY) -> Path:
    rows = [f"{0.001 * k:.3f},{1e-6 * k:.7f},{0.01 * (k % 7):.3f}" for k in range(200)]
    (second.parent / "run.csv").write_text("t,r,torque\n" + "\n".join(rows) + "\n")
    path = second.parent / "study.toml"
    path.write_text(text)
    return path


def test_study_names_an_fmu(second: Path) -> None:
    problem = read_problem(study(second))
    assert set(problem.model.inputs) == {"reference.position"}
    assert "motor.torque" in problem.model.outputs
    assert [q.name for q in problem.uncertain] == ["plant.carriage_m"]
    assert "guide" in {name for p in problem.model.places() for name in (p.name, *p.also)}


def test_it_is_said_which_derivatives_serve(second: Path) -> None:
    check = check_problem(read_problem(study(second)), excitation=False)
    assert "sensitivities of 'plant' come from the unit's own directional derivatives" in check.facts
    edit(second, lambda xml: xml.replace('generationTool="vtsdt ', 'generationTool="other '))
    assert "central differences for parameters" in read_unit(second).sensitivities
    edit(second, lambda xml: xml.replace('providesDirectionalDerivative="true"', ""))
    assert "no directional derivatives" in read_unit(second).sensitivities


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('fmu = "axis.fmu"', 'fmu = "axes.fmu"', "no file 'axes.fmu'.*axis.fmu"),
        ('fmu = "axis.fmu"', 'fmu = "axis.fmu"\nbuild = "a.py:b"', "names two models"),
        ('fmu = "axis.fmu"', 'fmu = ""', "names no model"),
        ('fmu = "axis.fmu"', 'fmu = "axis.fmu"\narguments = { a = 1 }', "arguments"),
        ('rate = "carriage.velocity"', 'rate = "carriage.speed"', "no output 'carriage.speed'"),
        ('force = "F_ext", ', "", "force"),
        ('"carriage.m" =', '"carriage.mm" =', "carriage.mm"),
    ],
)
def test_study_faults_are_named(before: str, after: str, said: str, second: Path) -> None:
    assert before in STUDY
    with pytest.raises(StudyError, match=said):
        read_problem(study(second, STUDY.replace(before, after)))


# ---------------------------------------------------------------- units that others built


REFERENCE = Path(os.environ.get("VTSDT_REFERENCE_FMUS", "/nonexistent"))


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="VTSDT_REFERENCE_FMUS names no folder with the Reference-FMUs")
@pytest.mark.parametrize("name", ["Dahlquist", "VanDerPol"])
def test_reference_fmus_run(name: str) -> None:
    model = Model(name)
    model.add("plant", Fmu(REFERENCE / f"{name}.fmu"))
    run = model.build().simulate(1.0, step=0.1)
    if name == "Dahlquist":  # der(x) = -k x, x(0) = 1, k = 1
        assert np.allclose(run["plant.x"], np.exp(-run.times), rtol=1e-4)
    else:
        assert np.all(np.isfinite(run["plant.x0"]))


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="VTSDT_REFERENCE_FMUS names no folder with the Reference-FMUs")
def test_reference_fmu_with_events_is_stepped() -> None:
    model = Model("BouncingBall")
    model.add("plant", Fmu(REFERENCE / "BouncingBall.fmu"))
    run = model.build().simulate(3.0, step=0.01)
    assert model.stepped_part == "plant"
    assert np.min(run["plant.h"]) > -1e-3


def openmodelica() -> Path | None:
    """Return the folder of units by OpenModelica: that in the wheel of gemseo-fmu, or a given one; None if absent."""
    given = os.environ.get("VTSDT_OPENMODELICA_FMUS")
    found = importlib.util.find_spec("gemseo_fmu")
    inside = Path(found.origin).parent / "problems/fmu_files/linux" if found and found.origin else None
    return Path(given) if given else inside


OPENMODELICA = openmodelica()
needs_openmodelica = pytest.mark.skipif(
    OPENMODELICA is None or not OPENMODELICA.is_dir() or platform.system() != "Linux",
    reason="neither the wheel of gemseo-fmu is installed nor does VTSDT_OPENMODELICA_FMUS name a folder of its units",
)


@needs_openmodelica
@pytest.mark.parametrize(("name", "given"), [("MassSpringSystem", {}), ("Mass_Damper", {"f": 10.0})])
def test_openmodelica_units_move_as_fmpy_moves_them(name: str, given: dict[str, float]) -> None:
    assert OPENMODELICA is not None
    path = OPENMODELICA / f"{name}.fmu"
    model = Model(name)
    plant = model.add("plant", Fmu(path))
    for own, value in given.items():
        model.input(own, getattr(plant, own), default=value)
    run = model.build().simulate(0.5, step=0.05, rtol=1e-8)
    described = fmpy.read_model_description(str(path))
    states = [v.variable.derivative.name for v in described.derivatives]
    states += [v.name for v in described.modelVariables if v.causality == "output" and v.type == "Real"]
    true = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=0.5,
        output_interval=0.05,
        relative_tolerance=1e-8,
        start_values=given,
        output=states,
    )
    for state in states:
        own, spread = re.sub(r"\W", "_", state).strip("_"), float(np.ptp(true[state]))
        assert spread > 1e-3, state
        assert np.allclose(run[f"plant.{own}"], true[state], atol=1e-4 * spread), state


@needs_openmodelica
def test_openmodelica_unit_with_events_is_stepped() -> None:
    assert OPENMODELICA is not None
    model = Model("ramp")
    model.add("plant", Fmu(OPENMODELICA / "ramp.fmu"))
    run = model.build().simulate(2.0, step=0.05)
    assert model.stepped_part == "plant"
    assert np.allclose(run["plant.out"], np.minimum(run.times, 1.0), atol=1e-9)


@needs_openmodelica
def test_unit_without_model_exchange_is_stepped() -> None:
    assert OPENMODELICA is not None
    assert read_unit(OPENMODELICA / "FMU3Model.fmu").stepped
