"""A foreign unit whose states, inputs and outputs are arrays (FMI 3.0): its elements are variables of their own."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import multibody.library as lib
from discrepancy.rigs.axis_model import build as axis_model
from multibody import Model
from multibody.fmi.compiler import c_compiler
from multibody.fmi.component import Fmu
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import read_unit
from multibody.machine.model import System

pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

T_END, STEP = 0.03, 1e-3  # s
#: References of the arrays: states, rates, inputs, parameters.
STATES, RATES, INPUTS, PARAMETERS = 1000, 1001, 1002, 1003
#: Each stands for the block of scalars that the unit has in its place.
EXPANDED = f"""
static size_t expanded(const fmi3ValueReference vr[], size_t n, unsigned out[])
{{
    static const unsigned begin[] = {{X, DX, U, P}}, end[] = {{DX, U, P, Y}};
    size_t k = 0;
    for (size_t i = 0; i < n; i++) {{
        if (vr[i] < {STATES}) {{ out[k++] = vr[i]; continue; }}
        for (unsigned r = begin[vr[i] - {STATES}]; r < end[vr[i] - {STATES}]; r++) out[k++] = r;
    }}
    return k;
}}

/* ---------------------------------------------------------------- values */
"""


@pytest.fixture(scope="module")
def axis() -> System:
    model = axis_model()
    push = model.add("push", lib.ForceSource())
    model.connect(push.flange, "carriage.flange")
    model.input("F_ext", push.force, default=0.0)
    return model.build()


@pytest.fixture(scope="module")
def unit(axis: System, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a unit of the axis in which states, rates, inputs and parameters are one array each."""
    path = axis.to_fmu(tmp_path_factory.mktemp("fmu") / "axis.fmu", binary=True)
    _rewrite(path, "sources/fmi3.c", _with_arrays)
    _rewrite(path, "modelDescription.xml", lambda text: _described_with_arrays(text, axis))
    folder = path.parent / "rebuilt"
    with zipfile.ZipFile(path) as file:
        file.extractall(folder)
        library = next(n for n in file.namelist() if n.startswith("binaries/"))
    command = [*c_compiler(), "-std=c99", "-fPIC", "-shared", "-o", str(folder / library), "fmi3.c", "-lm"]  # type: ignore[misc]
    subprocess.run(command, check=True, cwd=folder / "sources")
    with zipfile.ZipFile(path, "w") as file:
        for member in folder.rglob("*"):
            file.write(member, member.relative_to(folder))
    return path


def _rewrite(path: Path, name: str, change: Callable[[str], str]) -> None:
    with zipfile.ZipFile(path) as file:
        content = {n: file.read(n) for n in file.namelist()}
    before = content[name].decode()
    content[name] = change(before).encode()
    assert content[name].decode() != before
    with zipfile.ZipFile(path, "w") as file:
        for n, data in content.items():
            file.writestr(n, data)


def _with_arrays(text: str) -> str:
    heading = "/* ---------------------------------------------------------------- values */\n"
    values = "n == n_values && (!n || (vr && values))"
    into = "unsigned r[VALUES]; n = expanded(vr, n, r);"
    changes = {
        heading: EXPANDED,
        f'NEEDS({values}, "fmi3GetFloat64")': into,
        "STATUS[get_values(m, vr, n, values)]": "n == n_values ? STATUS[get_values(m, r, n, values)] : fmi3Error",
        f'NEEDS({values}, "fmi3SetFloat64")': into,
        "STATUS[set_values(m, vr, n, values)]": "n == n_values ? STATUS[set_values(m, r, n, values)] : fmi3Error",
        'NEEDS(n_seed == n_knowns && n_result == n_unknowns, "fmi3GetDirectionalDerivative")': (
            "unsigned a[VALUES], b[VALUES];\n"
            "    n_unknowns = expanded(unknowns, n_unknowns, a), n_knowns = expanded(knowns, n_knowns, b);\n"
            "    if (n_seed != n_knowns || n_result != n_unknowns) return fmi3Error;"
        ),
        "directional_derivative(m, unknowns, n_unknowns, knowns,": "directional_derivative(m, a, n_unknowns, b,",
    }
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    return text


def _described_with_arrays(text: str, axis: System) -> str:
    root = ET.fromstring(text)
    variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
    assert variables is not None
    assert structure is not None
    n, n_u, n_p = len(axis.states), len(axis.inputs), len(axis.parameters)
    first = {STATES: 1, RATES: 1 + n, INPUTS: 1 + 2 * n, PARAMETERS: 1 + 2 * n + n_u}
    count = {STATES: n, RATES: n, INPUTS: n_u, PARAMETERS: n_p}
    given = {
        STATES: {"name": "x", "causality": "output", "initial": "exact", "variability": "continuous"},
        RATES: {"name": "der(x)", "causality": "local", "variability": "continuous", "derivative": str(STATES)},
        INPUTS: {"name": "u", "causality": "input", "variability": "continuous"},
        PARAMETERS: {"name": "p", "causality": "parameter", "initial": "exact", "variability": "tunable"},
    }
    by_reference = {int(v.attrib["valueReference"]): v for v in variables}
    for array, attributes in given.items():
        members = [by_reference[first[array] + k] for k in range(count[array])]
        for member in members:
            variables.remove(member)
        if array != RATES:
            attributes |= {"start": " ".join(m.get("start", "0.0") for m in members)}
        made = ET.SubElement(variables, "Float64", {"valueReference": str(array), **attributes})
        ET.SubElement(made, "Dimension", start=str(count[array]))
    for entry in list(structure):
        for name in ("dependencies", "dependenciesKind"):
            entry.attrib.pop(name, None)
        if int(entry.attrib["valueReference"]) < first[PARAMETERS] + n_p:
            structure.remove(entry)
    rest = list(structure)
    structure[:] = [
        ET.Element("Output", valueReference=str(STATES)),
        *(e for e in rest if e.tag == "Output"),
        ET.Element("ContinuousStateDerivative", valueReference=str(RATES)),
        ET.Element("InitialUnknown", valueReference=str(RATES)),
        *(e for e in rest if e.tag == "InitialUnknown"),
    ]
    return ET.tostring(root, encoding="unicode")


def plant_of(path: Path) -> Model:
    model = Model("plant")
    plant = model.add("plant", Fmu(path))
    model.input("reference.position", plant.u_1)
    return model


def test_the_changed_unit_is_valid(unit: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit)) == []


def test_elements_are_variables_with_the_values_of_the_description(unit: Path, axis: System) -> None:
    described = read_unit(unit)
    assert described.ignored == ()
    assert [v.name for v in described.inputs] == [f"u[{k + 1}]" for k in range(len(axis.inputs))]
    assert [v.start for v in described.parameters] == axis.p.tolist()
    assert len(described.states) == len(axis.states)


def test_it_moves_as_the_machine_that_it_was_made_from(unit: Path, axis: System) -> None:
    times = np.arange(0.0, T_END + STEP, STEP)
    inputs = {"reference.position": (times, 2e-3 * (times / T_END) ** 2)}
    mass = axis.index("parameter", "carriage.m")
    own = axis.simulate(T_END, step=STEP, inputs=inputs, parameters={"carriage.m": 44.0})
    changed = {f"plant.p_{mass + 1}": 44.0}
    read = plant_of(unit).build().simulate(T_END, step=STEP, inputs=inputs, parameters=changed)
    for k, name in enumerate(axis.state_names):
        assert np.allclose(read[f"plant.x_{k + 1}"], own[name], rtol=1e-9, atol=1e-12), name
    unchanged = axis.simulate(T_END, step=STEP, inputs=inputs)["carriage.position"]
    assert np.max(np.abs(unchanged - own["carriage.position"])) > 1e-6


def test_exact_derivatives_come_back(unit: Path, axis: System) -> None:
    system = plant_of(unit).build()
    x = np.linspace(0.1, 0.3, len(axis.states))
    assert np.allclose(system.jacobian("x", 0.0, x), axis.jacobian("x", 0.0, x), rtol=1e-9, atol=1e-9)
    own = axis.jacobian("p", 0.0, x)
    columns = [system.index("parameter", f"plant.p_{k + 1}") for k in range(len(axis.parameters))]
    assert np.allclose(system.jacobian("p", 0.0, x)[:, columns], own, rtol=1e-9, atol=1e-9)


def test_start_values_that_do_not_fit_are_refused(unit: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.fmu"
    path.write_bytes(unit.read_bytes())
    two = 'start="0.0 0.0"'
    _rewrite(path, "modelDescription.xml", lambda text: text.replace(two, 'start="0.0 0.0 0.0"'))
    with pytest.raises(FmuError, match="array 'u' has 2 elements and 3 start values"):
        read_unit(path)
