"""A system written out as an FMU: valid, compiled without a warning, and the same machine in all four forms."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import multibody.library as lib
from discrepancy.rigs.axis_model import build as axis_model
from discrepancy.stages.fitted_machine import machine_with_effects
from estimation.response.sensors import SensorError
from multibody import Model
from multibody.base.errors import ModelError
from multibody.compile.c_source import c_source
from multibody.compile.emitter.units import unit_of_text
from multibody.fmi.compiler import c_compiler
from multibody.fmi.component import Fmu
from multibody.fmi.errors import FmuError
from multibody.machine.model import System
from vtsdt.cli.arguments import CommandError
from vtsdt.cli.export_fmu import main as export_fmu

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

VERSIONS = ("2.0", "3.0")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def axis() -> System:
    return axis_model(coulomb=30.0).build()


@pytest.fixture(scope="module", params=VERSIONS)
def unit(request: Any, axis: System, tmp_path_factory: Any) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "axis.fmu"
    return axis.to_fmu(path, fmi_version=request.param)


def _benchmark() -> Any:
    spec = importlib.util.spec_from_file_location("fmu_benchmark", ROOT / "benchmarks" / "fmu.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


benchmark = _benchmark()
forms = sys.modules["fmu_forms"]
real, set_real, step = forms.real, forms.set_real, forms.step


def compared(system: System, path: Path, until: float, step: float, **run: Any) -> dict[str, float]:
    """Return the largest deviation of a state or output, as a share of its range, for both forms of a unit."""
    case = forms.Case(until=until, step=step, **run)
    return {form: max(forms.deviations(forms.beside(system, path, form, case)).values()) for form in forms.FORMS}


def test_description_is_valid(unit: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit)) == []


@pytest.mark.peers
def test_fmutool_finds_nothing(unit: Path) -> None:
    found = benchmark.fmutool_findings(unit)
    if found is None:
        pytest.skip("needs fmutool: pip install 'vtsdt[peers]'")
    assert found == []


def test_description_holds_units_bounds_and_structure(axis: System, unit: Path) -> None:
    described = fmpy.read_model_description(str(unit))
    by_name = {v.name: v for v in described.modelVariables}
    mass = by_name["carriage.m"]
    assert (mass.causality, mass.variability, mass.unit) == ("parameter", "tunable", "kg")
    assert float(mass.start) == 40.0
    assert all(by_name[n].start is not None and by_name[n].nominal for n in axis.state_names)
    assert {u.variable.name for u in described.derivatives} == {f"der({n})" for n in axis.state_names}
    known = {u.variable.name: {d.name for d in u.dependencies} for u in described.derivatives}
    for i, row in enumerate(axis.state_names):
        on = {axis.state_names[j] for j in np.flatnonzero(axis.sparsity[i])}
        assert known[f"der({row})"] & set(axis.state_names) == on


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_bounds_of_states_travel(version: str, tmp_path: Path) -> None:
    model = Model("oven")
    body = model.add("body", lib.HeatCapacity(capacity=10.0, loss_conductance=1.0))
    heater = model.add("heater", lib.HeatSource())
    model.connect(heater.port, body.port)
    model.input("heat", heater.heat, default=0.0)
    path = model.build().to_fmu(tmp_path / "oven.fmu", fmi_version=version, binary=False)
    state = next(v for v in fmpy.read_model_description(str(path)).modelVariables if v.name == "body.temperature")
    assert (float(state.min), state.max) == (0.0, None)
    below = lib.HeatCapacity(capacity=10.0, temperature=-1.0)
    assert below.faults == ["start value 'temperature' is -1 K, below its least value 0: temperature; choose more"]


def test_dependencies_on_inputs_are_those_of_the_jacobian(axis: System, unit: Path) -> None:
    described = fmpy.read_model_description(str(unit))
    x = np.full(len(axis.states), 0.1)
    by_input = axis.jacobian("u", 0.0, x)
    known = {u.variable.name: {d.name for d in u.dependencies} for u in described.derivatives}
    acting = {(axis.state_names[i], axis.input_names[j]) for i, j in np.argwhere(by_input)}
    assert acting
    assert [(row, name) for row, name in acting if name not in known[f"der({row})"]] == []


def test_axis_is_the_same_in_every_form(axis: System, unit: Path) -> None:
    times = np.linspace(0.0, 1.0, 1001)
    reference = 0.1 * np.sin(2.0 * np.pi * times) ** 2
    errors = compared(axis, unit, 1.0, 1e-3, inputs={"reference.position": (times, reference)})
    assert max(errors.values()) < 1e-4, errors  # the bound


@pytest.mark.parametrize("version", VERSIONS)
def test_pendulum_is_the_same_in_every_form(version: str, tmp_path: Path) -> None:
    from runpy import run_path

    model = run_path(str(ROOT / "examples/pendulum/pendulum.py"))["build"]()
    system = model.build()
    start = dict.fromkeys(system.state_names, 0.0) | {system.state_names[0]: np.pi + 1.0}
    path = system.to_fmu(tmp_path / "pendulum.fmu", fmi_version=version, initial=start)
    errors = compared(system, path, 3.0, 1e-2, initial=start)
    assert max(errors.values()) < 1e-4, errors


@pytest.mark.parametrize("version", VERSIONS)
def test_tables_are_parameters_and_can_be_changed(version: str, tmp_path: Path) -> None:
    model = Model("pulled")
    body = model.add("body", lib.Mass(m=2.0))
    pull = model.add("pull", lib.ForceSource())
    signal = model.add("signal", lib.TableReference(points=([0.0, 0.5, 1.0], [0.0, 3.0, 1.0]), unit="N"))
    model.connect(signal.output, pull.force)
    model.connect(pull.flange, body.flange)
    system = model.build()
    path = system.to_fmu(tmp_path / "pulled.fmu", fmi_version=version)
    changed = {"signal.points.y[1]": 9.0}
    true = system.simulate(1.0, step=0.01, parameters=changed)
    assert abs(true["body.position"][-1] - system.simulate(1.0)["body.position"][-1]) > 0.1
    for form in forms.FORMS:
        result = fmpy.simulate_fmu(
            str(path), fmi_type=form, stop_time=1.0, output_interval=0.01, start_values=changed, relative_tolerance=1e-8
        )
        assert np.allclose(result["body.position"], true["body.position"], atol=1e-6)


@pytest.mark.parametrize("version", VERSIONS)
def test_compiles_without_a_warning(version: str, axis: System, tmp_path: Path) -> None:
    assert benchmark.warnings(axis.to_fmu(tmp_path / "axis.fmu", fmi_version=version, binary=False)) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_a_unit_with_a_broken_power_is_a_name_alone(version: str, tmp_path: Path) -> None:
    from runpy import run_path

    from fmpy.validation import validate_fmu

    model = run_path(str(ROOT / "examples/clamp/clamp.py"))["build"]()
    path = model.build().to_fmu(tmp_path / "clamp.fmu", fmi_version=version, binary=False)
    described = fmpy.read_model_description(str(path))
    units = {u.name: u.baseUnit for u in described.unitDefinitions}
    assert any(v.unit == "m**3/(s*Pa**0.5)" for v in described.modelVariables)
    assert units["m**3/(s*Pa**0.5)"] is None
    assert units["m**3/s"] is not None
    assert validate_fmu(str(path)) == []


def test_a_loop_whose_counter_is_not_read_is_c() -> None:
    text = "def f(t, x, out):\n    a = t\n    for _ in range(3):\n        a = 2.0 * a\n    out[0] = a\n"
    source = c_source(unit_of_text(text, "f"), "f", ("float", "floats", "floats"), "f")
    assert "v__" not in source


# ---------------------------------------------------------------- the functions of the standard, one by one


@pytest.fixture
def instances(unit: Path, tmp_path: Path) -> Any:
    """Give a function that makes instances of a unit, side by side, and free them all at the end."""
    folder = fmpy.extract(str(unit), str(tmp_path / "unit"))
    described = fmpy.read_model_description(folder)
    made = []

    def instance(form: str = "CoSimulation") -> Any:
        fmu = fmpy.instantiate_fmu(folder, described, fmi_type=form)
        made.append(fmu)
        if described.fmiVersion == "2.0":
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        return fmu

    yield instance
    for fmu in made:
        fmu.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)


def states(axis: System) -> list[int]:
    return list(range(1, 1 + len(axis.states)))


def test_state_is_saved_sent_and_put_back(axis: System, instances: Any) -> None:
    fmu, other = instances(), instances()
    u = 1 + 2 * len(axis.states)
    set_real(fmu, [u], [0.05])
    step(fmu, 0.0, 0.1)
    names = ("getFMUstate", "setFMUstate", "freeFMUstate", "serializeFMUstate", "deSerializeFMUstate")
    if not hasattr(fmu, "getFMUstate"):
        names = ("getFMUState", "setFMUState", "freeFMUState", "serializeFMUState", "deserializeFMUState")
    get, put, free, write, _ = (getattr(fmu, n) for n in names)
    saved = get()
    step(fmu, 0.1, 0.1)
    once = real(fmu, *states(axis))
    put(saved)
    step(fmu, 0.1, 0.1)
    assert real(fmu, *states(axis)) == once  # bit for bit: the integrator's memory is part of the state
    sent = getattr(other, names[4])(write(saved))
    getattr(other, names[1])(sent)
    step(other, 0.1, 0.1)
    assert real(other, *states(axis)) == once
    free(saved)
    getattr(other, names[2])(sent)


def test_reset_starts_again(axis: System, instances: Any) -> None:
    fmu = instances()
    start = real(fmu, *states(axis))
    u = 1 + 2 * len(axis.states)
    set_real(fmu, [u], [0.05])
    step(fmu, 0.0, 0.2)
    first = real(fmu, *states(axis))
    assert first != start
    fmu.reset()
    if hasattr(fmu, "setupExperiment"):
        fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    assert real(fmu, *states(axis)) == start
    set_real(fmu, [u], [0.05])
    step(fmu, 0.0, 0.2)
    assert real(fmu, *states(axis)) == first


def test_instances_do_not_touch_each_other(axis: System, instances: Any) -> None:
    many = [instances() for _ in range(20)]
    u = 1 + 2 * len(axis.states)
    for k, fmu in enumerate(many):
        set_real(fmu, [u], [0.01 * k])
    for fmu in many:
        step(fmu, 0.0, 0.1)
    ends = [real(fmu, *states(axis)) for fmu in many]
    alone = instances()
    set_real(alone, [u], [0.01 * 7])
    step(alone, 0.0, 0.1)
    assert ends[7] == real(alone, *states(axis))
    assert len({tuple(e) for e in ends}) == len(many)


def test_directional_derivatives_are_the_exact_ones(axis: System, instances: Any) -> None:
    fmu = instances("ModelExchange")
    n, n_u = len(axis.states), len(axis.inputs)
    fmu.enterContinuousTimeMode()
    x = np.linspace(-0.1, 0.2, n)
    if hasattr(fmu, "getReal"):
        fmu.setContinuousStates(x.ctypes.data_as(fmpy.fmi2.POINTER(fmpy.fmi2.fmi2Real)), n)
    else:
        fmu.setContinuousStates(x.ctypes.data_as(fmpy.fmi3.POINTER(fmpy.fmi3.fmi3Float64)), n)
    rates = list(range(1 + n, 1 + 2 * n))
    for wrt, first, count in (("x", 1, n), ("u", 1 + 2 * n, n_u), ("p", 1 + 2 * n + n_u, len(axis.parameters))):
        exact = axis.jacobian(wrt, 0.0, x)
        for j in range(count):
            column = fmu.getDirectionalDerivative(rates, [first + j], [1.0])
            assert np.allclose(column, exact[:, j], rtol=1e-12, atol=1e-12)


def status_of(call: Any, *arguments: Any) -> int:
    with pytest.raises(Exception) as caught:  # noqa: PT011 - fmpy raises its own exception with the status
        call(*arguments)
    return int(caught.value.status)  # type: ignore[attr-defined]


def test_wrong_use_is_answered_with_error(axis: System, instances: Any) -> None:
    error = 3  # fmi2Error and fmi3Error
    fmu = instances()
    assert status_of(fmu.enterInitializationMode) == error
    assert status_of(step, fmu, 0.0, -0.1) == error
    assert status_of(step, fmu, 5.0, 0.1) == error
    assert status_of(real, fmu, 10**6) == error
    assert status_of(set_real, fmu, [0], [1.0]) == error  # time
    assert status_of(set_real, fmu, [1], [1.0]) == error  # a state, once the simulation runs
    assert status_of(set_real, fmu, [1 + len(axis.states)], [1.0]) == error  # a rate
    assert status_of(set_real, fmu, [1 + 2 * len(axis.states)], [float("nan")]) == error
    fmu.terminate()
    assert status_of(step, fmu, 0.0, 0.1) == error
    exchange = instances("ModelExchange")
    exchange.enterContinuousTimeMode()
    assert status_of(exchange.enterContinuousTimeMode) == error
    assert status_of(set_real, exchange, [2 + 2 * len(axis.states)], [1.0]) == error  # a parameter between events


def test_a_step_that_cannot_be_taken_is_discarded(axis: System, instances: Any) -> None:
    fmu = instances()
    set_real(fmu, [1 + 2 * len(axis.states)], [1e308])
    assert status_of(step, fmu, 0.0, 0.1) == 2  # fmi2Discard and fmi3Discard


def test_a_thousand_cycles_leave_nothing_behind(axis: System, tmp_path: Path) -> None:
    path = axis.to_fmu(tmp_path / "axis.fmu", fmi_version="2.0", binary=False)
    flags = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    try:
        program = benchmark.cycles(path, tmp_path, flags)
    except RuntimeError as error:
        pytest.skip(f"the compiler has no address sanitizer: {error}")
    run = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_valgrind_finds_nothing_after_a_thousand_cycles_of_the_lift(version: str, tmp_path: Path) -> None:
    system, case = benchmark.MACHINES["lift"]()
    path = system.to_fmu(tmp_path / "lift.fmu", fmi_version=version, initial=case.initial, binary=False)
    said = benchmark.cycles_under_valgrind(path, tmp_path)
    if said is None:
        pytest.skip("needs valgrind (the package of that name in Debian)")
    assert said == ""


# ---------------------------------------------------------------- what is refused, and options


def test_a_saved_stage_is_exported_by_command_with_its_sensor_errors(tmp_path: Path) -> None:
    errors = [
        SensorError("motor.torque", kind, value) for kind, value in (("gain", 0.1), ("delay", 2e-3), ("lag", 1e-3))
    ]
    stage = machine_with_effects(axis_model(coulomb=30.0), (), {"carriage.m": 43.0}, errors, {"motor.torque": "N*m"})
    saved = stage.save(tmp_path / "1.json")
    out = tmp_path / "stage.fmu"
    assert export_fmu([str(saved), "--out", str(out), "--quiet"]) == 0
    start = {v.name: v.start for v in fmpy.read_model_description(str(out)).modelVariables}
    assert float(start["carriage.m"]) == 43.0
    assert float(start["sensor.motor.torque.gain"]) == 0.1
    times = np.arange(0.0, 0.1 + 1e-9, 1e-3)
    inputs = {"reference.position": (times, 2e-3 * (times / 0.1) ** 2)}
    assert max(compared(stage.build(), out, 0.1, 1e-3, inputs=inputs).values()) < 1e-4


def test_results_that_are_no_model_are_told(tmp_path: Path) -> None:
    results = tmp_path / "diagnosis.json"
    results.write_text('{"schema": 1, "verdict": "effect found"}')
    for given, error in ((tmp_path, CommandError), (results, ModelError)):
        with pytest.raises(error, match=r"stages/K\.json"):
            export_fmu([str(given), "--out", str(tmp_path / "x.fmu")])


def test_a_component_without_c_is_named(axis: System, tmp_path: Path) -> None:
    model = Model("plant")
    model.add("plant", Fmu(axis.to_fmu(tmp_path / "axis.fmu")))
    with pytest.raises(FmuError, match="component 'plant' is evaluated by Python alone"):
        model.build().to_fmu(tmp_path / "again.fmu")


def test_missing_compiler_is_told(axis: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("multibody.fmi.export.c_compiler", lambda: None)
    with pytest.raises(FmuError, match="no C compiler is found"):
        axis.to_fmu(tmp_path / "axis.fmu", binary=True)
    path = axis.to_fmu(tmp_path / "axis.fmu")
    names = zipfile.ZipFile(path).namelist()
    assert "sources/buildDescription.xml" in names
    assert not any(n.startswith("binaries/") for n in names)


def test_all_faults_are_listed_at_once(tmp_path: Path) -> None:
    model = axis_model().with_input_error("reference.position", delay=0.01)
    with pytest.raises(FmuError) as caught:
        model.build().to_fmu(tmp_path / "missing" / "axis.fmu", fmi_version="4.0")
    text = str(caught.value)
    assert "version '4.0'" in text
    assert "'reference.position' is delayed" in text
    assert "folder" in text


def test_equilibrium_start(tmp_path: Path) -> None:
    model = Model("hanging")
    body = model.add("body", lib.Mass(m=2.0))
    spring = model.add("spring", lib.Spring(stiffness=200.0))
    pull = model.add("pull", lib.ForceSource())
    model.connect(spring.b, body.flange, pull.flange)
    model.connect(spring.a, model.ground)
    model.input("force", pull.force)
    path = model.build().to_fmu(tmp_path / "hanging.fmu", at_equilibrium=True, initial={"body.position": 0.3})
    described = fmpy.read_model_description(str(path))
    start = {v.name: v.start for v in described.modelVariables}
    assert abs(float(start["body.position"])) < 1e-9


def test_same_model_gives_the_same_file(axis: System, tmp_path: Path) -> None:
    first, second = (axis.to_fmu(tmp_path / d / "axis.fmu", binary=False) for d in _folders(tmp_path))
    assert first.read_bytes() == second.read_bytes()


def _folders(tmp_path: Path) -> tuple[str, str]:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    return "a", "b"


# ---------------------------------------------------------------- all machines


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", benchmark.MACHINES)
def test_every_machine_is_the_same_in_every_form(name: str, version: str, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    system, case = benchmark.MACHINES[name]()
    path = system.to_fmu(tmp_path / "unit.fmu", fmi_version=version, initial=case.initial)
    assert validate_fmu(str(path)) == []
    assert benchmark.warnings(path) == []
    for form in forms.FORMS:
        found = forms.deviations(forms.beside(system, path, form, case))
        assert max(found.values()) < benchmark.BOUND, (form, max(found, key=found.__getitem__))
