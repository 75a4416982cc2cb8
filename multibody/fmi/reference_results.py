"""Reference results beside a unit: an experiment, its inputs, and what came out of it here.

Specification: FMI Layered Standard References (FMI-LS-REF) 1.0.0-alpha.1, and the Experiments Format to which it
refers, Modelica Association.  Another tool repeats the experiment to see that the unit works there.
"""

from __future__ import annotations

import hashlib
import io
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from multibody.fmi.variables import Variables
from multibody.system.compiled import CompiledSystem
from multibody.system.simulate import simulate
from multibody.system.trajectory import Trajectory

__all__ = ["reference_files"]

_NAME, _VERSION = "org.fmi-standard.fmi-ls-ref", "1.0.0-alpha.1"
_DESCRIPTION = "Layered Standard providing information on related files included in an FMU."
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_FOLDER = f"extra/{_NAME}"
#: Tolerances with which the results are computed: tighter than those of the unit, so that a deviation is not theirs.
_RTOL, _ATOL = 1e-9, 1e-12
_INPUTS, _RESULTS, _EXPERIMENT = "inputs.csv", "results.csv", "experiment.exp"


def reference_files(
    system: CompiledSystem, run: Trajectory, variables: Variables, shown: Sequence[int], tolerance: float
) -> dict[str, bytes]:
    """Return the files of the layered standard, by their path in the unit.

    The run is simulated anew, tightly, with inputs that run straight between its times: what the files hold can be
    repeated from the files.

    Parameters
    ----------
    system : CompiledSystem
    run : Trajectory
        Its times, inputs, parameters and first state are the experiment.
    variables : Variables
        Those of the unit.
    shown : sequence of int
        Indices of the outputs that the unit has, in its order.
    tolerance : float
        Relative tolerance that the experiment asks for.

    Raises
    ------
    SimulationError
        If it cannot be simulated.
    """
    inputs = {name: (run.times, run.inputs[:, k]) for k, name in enumerate(system.input_names)}
    span = float(run.times[0]), float(run.times[-1])
    start = run.states[0]
    true = simulate(
        system, span, times=run.times, inputs=inputs, parameters=run.p, initial=start, rtol=_RTOL, atol=_ATOL
    )
    results = np.column_stack([true.states, true.outputs[:, list(shown)]])
    files = {_RESULTS: _csv(run.times, [v.name for v in (*variables.states, *variables.outputs)], results)}
    if variables.inputs:
        files[_INPUTS] = _csv(run.times, [v.name for v in variables.inputs], true.inputs)
    files[_EXPERIMENT] = _experiment(run, bool(variables.inputs), tolerance)
    files["fmi-ls-manifest.xml"] = _manifest(files)
    return {f"{_FOLDER}/{name}": data for name, data in files.items()}


def _csv(times: np.ndarray, names: Sequence[str], values: np.ndarray) -> bytes:
    """Return a table as the FMI Cross-Check writes it: names between quotation marks, time first, commas."""
    text = io.StringIO(newline="")
    text.write(",".join(f'"{name}"' for name in ("time", *names)) + "\n")
    np.savetxt(text, np.column_stack([times, values]), "%.17g", ",")
    return text.getvalue().encode()


def _experiment(run: Trajectory, driven: bool, tolerance: float) -> bytes:
    root = ET.Element("Experiments", name="reference results", description="Computed by the tool that wrote the unit.")
    steps = np.diff(run.times)
    step = float(steps.mean()) if steps.size and np.allclose(steps, steps.mean(), rtol=1e-6) else None
    given = {
        "name": "reference",
        "description": "Start values and parameters of the model description; inputs run straight between the rows.",
        "startTime": repr(float(run.times[0])),
        "stopTime": repr(float(run.times[-1])),
        "tolerance": repr(tolerance),
    }
    one = ET.SubElement(root, "Experiment", given | ({"stepSize": repr(step)} if step else {}))
    if driven:
        ET.SubElement(one, "Stimuli", source=_INPUTS, type="text/csv")
    ET.SubElement(one, "References", source=_RESULTS, type="text/csv")
    return _text(root)


def _manifest(files: dict[str, bytes]) -> bytes:
    ET.register_namespace("fmi-ls", _NAMESPACE)
    own = {"fmi-ls-name": _NAME, "fmi-ls-version": _VERSION, "fmi-ls-description": _DESCRIPTION}
    root = ET.Element("fmiReferences", {f"{{{_NAMESPACE}}}{key}": value for key, value in own.items()})
    known = {
        _EXPERIMENT: ("application/x-ma-hs-experiments", "experiment/smoke-test", "experiment to be repeated"),
        _INPUTS: ("text/csv", "other", "inputs of the experiment, SI"),
        _RESULTS: ("text/csv", "result", f"states and outputs in it, SI, integrated with {_RTOL:g}"),
    }
    for name, (kind, role, description) in known.items():
        if name in files:
            digest = hashlib.sha3_256(files[name]).hexdigest()
            given = {"type": kind, "source": name, "role": role, "description": description}
            ET.SubElement(root, "Related", given | {"checksum": digest, "checksumType": "SHA3-256"})
    return _text(root)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
