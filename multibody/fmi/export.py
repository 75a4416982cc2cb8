"""A system written out as a Functional Mock-up Unit: C source, model description, and a library for this platform.

Specification: FMI 2.0.4 and FMI 3.0.1, Modelica Association.  A unit offers Model Exchange and Co-Simulation.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from multibody.base.cache import digest_of
from multibody.fmi.compiler import binary_folder, c_compiler, compile_library
from multibody.fmi.errors import FmuError
from multibody.fmi.scratch_folder import ScratchFolder
from multibody.system.compiled import CompiledSystem
from multibody.system.equilibrium import equilibrium
from multibody.system.narrow_features import step_limits
from multibody.system.trajectory import Trajectory

__all__ = ["FMI_VERSIONS", "to_fmu"]

FMI_VERSIONS = ("2.0", "3.0")
_OWN = ("instance.h", "dormand_prince.h")
#: A zip file notes when its members were written; the same model gives the same bytes.
_WRITTEN = (1980, 1, 1, 0, 0, 0)
_EVENTS = (
    "The model has no events: end stops, backlash and friction are continuous laws with a transition of finite width, "
    "as their parameters say."
)


def to_fmu(
    system: CompiledSystem,
    path: str | Path,
    *,
    fmi_version: str = "3.0",
    parameters: Mapping[str, float] | np.ndarray | None = None,
    initial: Mapping[str, float] | np.ndarray | None = None,
    at_equilibrium: bool = False,
    binary: bool | None = None,
    reference: Trajectory | None = None,
) -> Path:
    """Write a system as an FMU for Model Exchange and Co-Simulation.

    The unit has C source and needs no Python where it runs; it can be compiled for other platforms from
    ``sources/buildDescription.xml``.  Its variables are the system's states, inputs, parameters (the points of tables
    among them, one by one) and outputs, in SI.  An output that is a state is shown once.  In a step of Co-Simulation
    the Dormand-Prince pair integrates with a relative tolerance of 1e-8, however stiff the model is.

    Parameters
    ----------
    system : CompiledSystem
    path : str or Path
        File to be written; its folder must exist.
    fmi_version : {"3.0", "2.0"}
    parameters, initial : mapping or ndarray, optional
        Values that replace the system's own, by name, SI: what the unit starts with.
    at_equilibrium : bool
        Start at rest, near ``initial``.
    binary : bool, optional
        True needs a C compiler, False writes source alone; by default there is a library where a compiler is found.
    reference : Trajectory, optional
        A simulation of the system, which is put beside the unit as reference results (FMI-LS-REF).  The unit starts
        with its parameters and its first state, where ``parameters`` and ``initial`` are not given.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    FmuError
        If the version is unknown, an input is delayed, a component is itself a foreign unit, something has no form in
        C, fmpy (its C headers) or a compiler is missing, the reference starts otherwise than the unit.
    ModelError
        With every unknown parameter or state.
    SimulationError
        If there is no equilibrium.
    """
    from multibody.fmi.c_model import RELATIVE_TOLERANCE, model_header
    from multibody.fmi.description import Description, build_description, model_description
    from multibody.fmi.reference_results import reference_files
    from multibody.fmi.variables import variables_of

    path = Path(path)
    if reference is not None and reference.system is system:
        parameters = reference.p if parameters is None else parameters
        initial = reference.states[0] if initial is None and not at_equilibrium else initial
    p, x = system.parameter_vector(parameters), system.state_vector(initial)
    compiler = None if binary is False else c_compiler()
    _check(system, path, fmi_version, p, binary, compiler)
    if at_equilibrium:
        x = equilibrium(system, parameters=p, guess=x).state
    _check_reference(system, path, p, x, reference)
    known = set(system.state_names)
    shown = tuple(
        k for k, q in enumerate(system.outputs) if q.name not in known and system.index("output", q.name) == k
    )
    variables = variables_of(system, x, p, shown)
    identifier = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    source = f"fmi{fmi_version[0]}.c"
    files = {f"sources/{name}": text for name, text in _library_sources(fmi_version, source).items()}
    limits = step_limits(system, p)
    unsigned = model_header(system, variables, shown, limits, "")
    token = "{" + digest_of(fmi_version, unsigned, *files.values()) + "}"
    files["sources/model.h"] = model_header(system, variables, shown, limits, token)
    about = Description(
        name=system.name,
        identifier=identifier if re.match(r"[A-Za-z_]", identifier) else f"m_{identifier}",
        token=token,
        text=_EVENTS,
        version=_version(),
        source=source,
        start_time=0.0 if reference is None else float(reference.times[0]),
        stop_time=None if reference is None else float(reference.times[-1]),
    )
    content = {name: text.encode() for name, text in files.items()}
    content["modelDescription.xml"] = model_description(about, variables, fmi_version)
    if fmi_version == "3.0":
        content["sources/buildDescription.xml"] = build_description(about)
    if reference is not None:
        content |= reference_files(system, reference, variables, shown, RELATIVE_TOLERANCE)
    if compiler is not None:
        folder, ending = binary_folder(fmi_version)
        content[f"binaries/{folder}/{about.identifier}{ending}"] = _compiled(compiler, files, source)
    _write(path, content)
    return path


def _check(
    system: CompiledSystem, path: Path, fmi_version: str, p: np.ndarray, binary: bool | None, compiler: object
) -> None:
    faults = []
    if fmi_version not in FMI_VERSIONS:
        faults.append(f"there is no FMI version '{fmi_version}' here: take one of {', '.join(FMI_VERSIONS)}")
    delayed = [name for name, k in system.input_delays.items() if p[k] != 0.0]
    faults += [f"input '{n}' is delayed, and an FMU does not keep the past of its inputs: delay it" for n in delayed]
    faults += [
        f"component '{name}' is evaluated by Python alone and has no form in C: leave it out"
        for name, part in system.model.components.items()
        if part.only_python or part.steps_itself
    ]
    if importlib.util.find_spec("fmpy") is None:
        faults.append("the C headers of the standard come with fmpy: pip install 'vtsdt[fmi]'")
    if binary and compiler is None:
        faults.append("no C compiler is found: install one, name it in CC, or write source alone (binary=False)")
    if not path.parent.is_dir():
        faults.append(f"the folder '{path.parent}' does not exist")
    if faults:
        raise FmuError(f"'{system.name}' cannot be written as '{path.name}':\n" + "\n".join(f"  - {f}" for f in faults))


def _check_reference(
    system: CompiledSystem, path: Path, p: np.ndarray, x: np.ndarray, reference: Trajectory | None
) -> None:
    """Refuse a reference that is of another system, or that starts otherwise than the unit."""
    if reference is None:
        return
    if reference.system is not system:
        raise FmuError(
            f"'{path.name}': the reference is a run of another build of '{reference.system.name}': simulate the system "
            "that is exported"
        )
    faults = []
    for names, own, given in (
        (system.parameter_names, p, reference.p),
        (system.state_names, x, reference.states[0]),
    ):
        faults += [
            f"'{name}' is {b:g} in the reference and {a:g} in the unit: give both the same"
            for name, a, b in zip(names, own, given, strict=True)
            if a != b
        ]
    if faults:
        lines = "\n".join(f"  - {f}" for f in faults)
        raise FmuError(f"'{path.name}': the reference starts otherwise than the unit:\n{lines}")


def _library_sources(fmi_version: str, source: str) -> dict[str, str]:
    """Return the C files that are the same in every unit: the project's and the standard's headers."""
    own = importlib.resources.files("multibody.fmi") / "sources"
    texts = {name: (own / name).read_text(encoding="utf-8") for name in (source, *_OWN)}
    headers = importlib.resources.files("fmpy") / "c-code"
    platform = "fmi2TypesPlatform.h" if fmi_version == "2.0" else "fmi3PlatformTypes.h"
    v = fmi_version[0]
    for name in (f"fmi{v}Functions.h", f"fmi{v}FunctionTypes.h", platform):
        texts[name] = (headers / name).read_text(encoding="utf-8")
    return texts


def _compiled(compiler: list[str], files: dict[str, str], source: str) -> bytes:
    with ScratchFolder() as folder:
        for name, text in files.items():
            (folder.path / Path(name).name).write_text(text, encoding="utf-8")
        library = folder.path / "library"
        compile_library(compiler, folder.path / source, library)
        return library.read_bytes()


def _write(path: Path, content: dict[str, bytes]) -> None:
    part = path.with_name(path.name + ".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in sorted(content.items()):
            file.writestr(zipfile.ZipInfo(name, _WRITTEN), data, zipfile.ZIP_DEFLATED)
    part.replace(path)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("vtsdt")
    except PackageNotFoundError:
        return "(not installed)"
