"""``modelDescription.xml`` and ``buildDescription.xml`` of FMI 2.0 and 3.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass

from multibody.base.units import UnitError, base_exponents, si_factor
from multibody.fmi.c_model import RELATIVE_TOLERANCE
from multibody.fmi.variables import Variable, Variables

__all__ = ["Description", "build_description", "model_description"]


@dataclass(frozen=True, kw_only=True)
class Description:
    """What stands at the top of a model description.

    Parameters
    ----------
    name, identifier, token : str
        The model's name, the same as a C identifier, and the GUID or instantiation token.
    text : str
        One paragraph.
    version : str
        Of the program that writes the unit.
    source : str
        The file to be compiled.
    start_time : float, s
    stop_time : float, s, optional
        Of the experiment that is proposed.
    """

    name: str
    identifier: str
    token: str
    text: str
    version: str
    source: str
    start_time: float = 0.0
    stop_time: float | None = None


def model_description(about: Description, variables: Variables, fmi_version: str) -> bytes:
    """Return the text of ``modelDescription.xml``.

    Parameters
    ----------
    about : Description
    variables : Variables
    fmi_version : {"2.0", "3.0"}
    """
    return _text(_version_2(about, variables) if fmi_version == "2.0" else _version_3(about, variables))


def build_description(about: Description) -> bytes:
    """Return the text of ``sources/buildDescription.xml`` (FMI 3.0)."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=about.identifier)
    sources = ET.SubElement(build, "SourceFileSet", language="C99")
    ET.SubElement(sources, "SourceFile", name=about.source)
    return _text(root)


def _version_2(about: Description, variables: Variables) -> ET.Element:
    root = _root(about, variables, "2.0", guid=about.token, numberOfEventIndicators="0")
    common = {
        "modelIdentifier": about.identifier,
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    exchange = ET.SubElement(root, "ModelExchange", common)
    simulation = ET.SubElement(
        root,
        "CoSimulation",
        common,
        canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="true",
    )
    for kind in (exchange, simulation):
        ET.SubElement(ET.SubElement(kind, "SourceFiles"), "File", name=about.source)
    _units(root, variables)
    _experiment(root, about)
    listed = ET.SubElement(root, "ModelVariables")
    for v in variables.all:
        scalar = ET.SubElement(listed, "ScalarVariable", _attributes(v))
        real = {"derivative": str(v.derivative_of + 1)} if v.derivative_of is not None else {}
        ET.SubElement(scalar, "Real", _numbers(v) | real)
    structure = ET.SubElement(root, "ModelStructure")

    def add(group: str, members: Iterable[Variable], *, with_kind: bool = True) -> None:
        members = tuple(members)
        if members:
            node = ET.SubElement(structure, group)
            for v in members:
                on = _depends(v)
                kinds = {"dependenciesKind": " ".join(["dependent"] * len(on))} if with_kind else {}
                given = {"dependencies": " ".join(str(r + 1) for r in on)} | kinds
                ET.SubElement(node, "Unknown", {"index": str(v.reference + 1)} | given)

    add("Outputs", (*variables.states, *variables.outputs))
    add("Derivatives", variables.rates)
    # parameters matter as well at the start, so that nothing is said of dependencies there
    if members := (*variables.rates, *variables.outputs):
        node = ET.SubElement(structure, "InitialUnknowns")
        for v in members:
            ET.SubElement(node, "Unknown", index=str(v.reference + 1))
    return root


def _version_3(about: Description, variables: Variables) -> ET.Element:
    root = _root(about, variables, "3.0", instantiationToken=about.token)
    common = {
        "modelIdentifier": about.identifier,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    }
    ET.SubElement(root, "ModelExchange", common)
    ET.SubElement(root, "CoSimulation", common, canHandleVariableCommunicationStepSize="true")
    _units(root, variables)
    _experiment(root, about)
    listed = ET.SubElement(root, "ModelVariables")
    for v in variables.all:
        own = {"derivative": str(v.derivative_of)} if v.derivative_of is not None else {}
        ET.SubElement(listed, "Float64", _attributes(v) | _numbers(v) | own)
    structure = ET.SubElement(root, "ModelStructure")

    def add(kind: str, members: Iterable[Variable], *, known: bool = True) -> None:
        for v in members:
            given = {"valueReference": str(v.reference)}
            if known:
                on = _depends(v)
                given |= {
                    "dependencies": " ".join(map(str, on)),
                    "dependenciesKind": " ".join(["dependent"] * len(on)),
                }
            ET.SubElement(structure, kind, given)

    add("Output", (*variables.states, *variables.outputs))
    add("ContinuousStateDerivative", variables.rates)
    add("InitialUnknown", (*variables.rates, *variables.outputs), known=False)
    return root


def _depends(v: Variable) -> tuple[int, ...]:
    """Return what a variable depends on: a state that is shown depends on itself."""
    return (v.reference,) if v.start is not None else v.depends_on


def _root(about: Description, variables: Variables, fmi_version: str, **given: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi_version,
            "modelName": about.name,
            "description": about.text,
            "generationTool": f"vtsdt {about.version}",
            "variableNamingConvention": "structured" if variables.structured else "flat",
            **given,
        },
    )


def _experiment(root: ET.Element, about: Description) -> None:
    end = {} if about.stop_time is None else {"stopTime": repr(about.stop_time)}
    given = {"startTime": repr(about.start_time).removesuffix(".0"), **end, "tolerance": repr(RELATIVE_TOLERANCE)}
    ET.SubElement(root, "DefaultExperiment", given)


def _attributes(v: Variable) -> dict[str, str]:
    initial = "exact" if v.start is not None and v.causality != "input" else "calculated"
    return {
        "name": v.name,
        "valueReference": str(v.reference),
        "causality": v.causality,
        "variability": "tunable" if v.causality == "parameter" else "continuous",
        **({} if v.causality in ("independent", "input") else {"initial": initial}),
        **({"description": v.meaning} if v.meaning else {}),
    }


def _numbers(v: Variable) -> dict[str, str]:
    given = {"min": v.min, "max": v.max, "nominal": v.nominal, "start": v.start}
    unit = {"unit": v.unit} if _is_unit(v.unit) else {}
    return unit | {key: repr(float(value)) for key, value in given.items() if value is not None}


def _is_unit(unit: str) -> bool:
    if not unit:
        return False
    try:
        si_factor(unit)
    except UnitError:
        return False
    return True


def _units(root: ET.Element, variables: Variables) -> None:
    """Define every unit by its SI base units; the standard has no broken powers, such a unit is a name alone."""
    node = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in variables.all if _is_unit(v.unit)}):
        own = ET.SubElement(node, "Unit", name=unit)
        try:
            exponents = {base: str(power) for base, power in base_exponents(unit).items()}
        except UnitError:
            continue
        factor = si_factor(unit)
        ET.SubElement(own, "BaseUnit", exponents | ({"factor": repr(factor)} if factor != 1.0 else {}))


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
