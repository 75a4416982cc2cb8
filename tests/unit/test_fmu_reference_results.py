"""Reference results beside an exported unit (FMI-LS-REF): another tool finds them, and the unit repeats them."""

from __future__ import annotations

import hashlib
import re
import sys
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import numpy as np
import pytest

from discrepancy.rigs.axis_model import build as axis_model
from multibody.base.errors import SimulationError
from multibody.fmi.compiler import c_compiler
from multibody.fmi.errors import FmuError
from multibody.machine.model import System
from multibody.system.trajectory import Trajectory
from vtsdt.cli.arguments import CommandError
from vtsdt.cli.export_fmu import main as export_fmu

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fmu_forms as forms  # noqa: E402 - beside the benchmarks, not installed

FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"
NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"
#: What the layered standard allows, by its table of roles.
ROLES = re.compile(
    "document|requirement|specification|model|parameter|system|testcase|"
    "experiment(/(smoke-test|validation|uncertainty-analysis))?|result|method|rationale|report|request|delivery|"
    "configuration|signature|serialized-state(/.*)?|meta-data|other"
)
UNTIL, STEP = 0.2, 1e-3  # s


@pytest.fixture(scope="module")
def axis() -> System:
    return axis_model(coulomb=30.0).build()


@pytest.fixture(scope="module")
def run(axis: System) -> Trajectory:
    times = np.arange(0.0, UNTIL + STEP / 2, STEP)
    inputs = {"reference.position": (times, 2e-3 * np.sin(np.pi * times / UNTIL) ** 2)}
    return axis.simulate(
        UNTIL, times=times, inputs=inputs, parameters={"carriage.m": 43.0}, initial={"carriage.position": 1e-4}
    )


@pytest.fixture(scope="module", params=("2.0", "3.0"))
def unit(request: Any, axis: System, run: Trajectory, tmp_path_factory: Any) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "axis.fmu"
    return axis.to_fmu(path, fmi_version=request.param, reference=run)


def content(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def related(path: Path) -> list[ET.Element]:
    return ET.fromstring(content(path)[f"{FOLDER}fmi-ls-manifest.xml"]).findall("Related")


def table(path: Path, name: str, tmp_path: Path) -> np.ndarray:
    """Return a table as FMPy reads it, which follows the rules of the FMI Cross-Check."""
    file = tmp_path / "table.csv"
    file.write_bytes(content(path)[urljoin(FOLDER, name)])
    return fmpy.util.read_csv(file)


def test_the_manifest_says_what_is_there(unit: Path) -> None:
    root = ET.fromstring(content(unit)[f"{FOLDER}fmi-ls-manifest.xml"])
    assert root.tag == "fmiReferences"
    assert root.attrib == {
        f"{NAMESPACE}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
        f"{NAMESPACE}fmi-ls-version": "1.0.0-alpha.1",
        f"{NAMESPACE}fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
    }
    listed = root.findall("Related")
    assert {r.get("role") for r in listed} == {"experiment/smoke-test", "result", "other"}
    assert all(ROLES.fullmatch(r.attrib["role"]) for r in listed)
    there = {n for n in content(unit) if n.startswith("extra/")}
    assert there == {FOLDER + r.attrib["source"] for r in listed} | {f"{FOLDER}fmi-ls-manifest.xml"}
    for r in listed:
        assert r.get("checksumType") == "SHA3-256"
        assert hashlib.sha3_256(content(unit)[FOLDER + r.attrib["source"]]).hexdigest() == r.get("checksum")


def test_the_unit_is_still_valid(unit: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit)) == []
    described = fmpy.read_model_description(str(unit))
    assert float(described.defaultExperiment.stopTime) == UNTIL
    start = {v.name: v.start for v in described.modelVariables}
    assert float(start["carriage.m"]) == 43.0
    assert float(start["carriage.position"]) == 1e-4


@pytest.mark.parametrize("form", forms.FORMS)
def test_the_unit_repeats_them_from_the_files_alone(form: str, unit: Path, axis: System, tmp_path: Path) -> None:
    (entry,) = [r for r in related(unit) if r.attrib["role"].startswith("experiment")]
    (experiment,) = ET.fromstring(content(unit)[FOLDER + entry.attrib["source"]]).findall("Experiment")
    stop, step, tolerance = (float(experiment.attrib[n]) for n in ("stopTime", "stepSize", "tolerance"))
    given, true = (table(unit, experiment.find(n).attrib["source"], tmp_path) for n in ("Stimuli", "References"))  # type: ignore[union-attr]
    names = [n for n in true.dtype.names if n != "time"]
    described, fmu = forms.opened(unit, form, tolerance)
    by_name = {v.name: v.valueReference for v in described.modelVariables}
    outputs = {v.name for v in described.modelVariables if v.causality == "output"}
    assert set(names) == outputs
    inputs = {n: (given["time"], given[n]) for n in given.dtype.names if n != "time"}
    case = forms.Case(until=stop, step=step, inputs=inputs)
    loop = forms.LOOPS[form]
    states = [by_name[n] for n in axis.state_names]
    times = true["time"]
    found = loop(fmu, described, [by_name[n] for n in names], states, times, case, (tolerance, tolerance * 1e-3))
    fmu.terminate()
    fmu.freeInstance()
    runs = forms.Beside(
        true=np.column_stack([true[n] for n in names]), found=found, names=tuple(names), native_time=0.0, unit_time=0.0
    )
    away, allowed = forms.deviations(runs), dict.fromkeys(names, 1e-4)  # the bound
    if form == "CoSimulation" and described.fmiVersion == "3.0":
        # which holds inputs over a step, where those of the experiment run straight: everything comes up to a step late
        allowed |= {
            n: float(np.max(np.abs(np.diff(true[n]))) / np.ptp(true[n])) for n in names if np.ptp(true[n]) > 0.0
        }
    assert all(away[n] <= allowed[n] for n in names), {n: (away[n], allowed[n]) for n in names}


def test_a_run_that_starts_otherwise_is_refused(axis: System, run: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"'carriage\.m' is 43 in the reference and 41 in the unit"):
        axis.to_fmu(tmp_path / "axis.fmu", reference=run, parameters={"carriage.m": 41.0})
    with pytest.raises(FmuError, match=r"'carriage\.position' is 0\.0001 in the reference and 0 in the unit"):
        axis.to_fmu(tmp_path / "axis.fmu", reference=run, at_equilibrium=True)
    with pytest.raises(FmuError, match="another build"):
        axis_model().build().to_fmu(tmp_path / "axis.fmu", reference=run)
    assert list(tmp_path.iterdir()) == []


def test_the_command_takes_a_table_or_seconds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{0.01 * k:.2f},{1e-5 * k:.6f}" for k in range(11))
    (tmp_path / "drive.csv").write_text(f"time,reference.position\n{rows}\n")
    out = tmp_path / "axis.fmu"
    assert export_fmu(["axis", "--out", str(out), "--reference", str(tmp_path / "drive.csv")]) == 0
    assert "and reference results" in capsys.readouterr().out
    driven = table(out, "inputs.csv", tmp_path)
    assert driven["reference.position"][-1] == pytest.approx(1e-4)
    assert export_fmu(["axis", "--out", str(out), "--reference", "0.05", "--source-only", "--quiet"]) == 0
    assert table(out, "results.csv", tmp_path)["time"][-1] == 0.05


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ("nothing.csv", CommandError, "there is no file"),
        ("-1", CommandError, "positive number of seconds"),
        ("back.csv", CommandError, "must increase"),
    ],
)
def test_what_the_command_refuses(given: str, error: type[Exception], said: str, tmp_path: Path) -> None:
    (tmp_path / "back.csv").write_text("time,reference.position\n0.0,0.0\n0.0,0.1\n")
    name = given if given == "-1" else str(tmp_path / given)
    with pytest.raises(error, match=said):
        export_fmu(["axis", "--out", str(tmp_path / "axis.fmu"), f"--reference={name}"])


def test_a_reference_that_cannot_be_simulated_writes_nothing(axis: System, run: Trajectory, tmp_path: Path) -> None:
    from dataclasses import replace

    inputs = run.inputs.copy()
    inputs[5:] = 1e200
    with pytest.raises(SimulationError):
        axis.to_fmu(tmp_path / "axis.fmu", reference=replace(run, inputs=inputs))
    assert list(tmp_path.iterdir()) == []
