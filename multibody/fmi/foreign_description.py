"""What a foreign unit says of itself: read, checked, and refused with what is wrong.  None of its code runs here."""

from __future__ import annotations

import hashlib
import math
import re
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path, PurePosixPath
from typing import Any

from multibody.base.units import UnitError, same_dimension, si_factor
from multibody.fmi.compiler import binary_folder
from multibody.fmi.errors import FmuError

__all__ = ["ForeignUnit", "ForeignVariable", "read_unit"]

_REALS = ("Real", "Float64")
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True, kw_only=True)
class ForeignVariable:
    """A real variable of a foreign unit, or an element of one that is an array.

    Parameters
    ----------
    name, unit, meaning : str
        Its own name, and the SI unit in which it is used here.  An element has its indices in it: ``A[2,1]``.
    own : str
        The name in the model here: letters, digits and single underscores.
    reference : int
    factor, offset : float
        Value in SI = factor · value of the unit + offset.
    start : float
        In SI.
    computed : bool
        Whether the unit computes its start value: the description has none, or an approximate one.
    min, max : float or None
        In SI.
    tunable : bool
        Whether a parameter may be set while the unit runs.
    depends_on : tuple of int or None
        References of inputs that an output depends on; None where the unit does not say.
    element, size : int
        Place in the array, row by row, and number of its elements.  All elements have one reference and stand together.
    """

    name: str
    own: str
    unit: str
    meaning: str
    reference: int
    factor: float = 1.0
    offset: float = 0.0
    start: float = 0.0
    computed: bool = False
    min: float | None = None
    max: float | None = None
    tunable: bool = False
    depends_on: tuple[int, ...] | None = None
    element: int = 0
    size: int = 1


@dataclass(frozen=True, kw_only=True)
class CommunicationSteps:
    """What a unit for Co-Simulation says of its communication steps.

    Parameters
    ----------
    size : float or None
        The step that it asks for, s.
    fixed : bool
        Whether every step must have this size.
    slopes : bool
        Whether inputs can have first derivatives in a step (FMI 2.0).
    """

    size: float | None = None
    fixed: bool = False
    slopes: bool = False


@dataclass(frozen=True, kw_only=True)
class ForeignUnit:
    """A unit for Model Exchange, or one that can only be stepped (Co-Simulation).

    Parameters
    ----------
    path : Path
    digest : str
        Of the file.
    fmi_version, name : str
    states, inputs, parameters, outputs : tuple of ForeignVariable
        Outputs that are states are left out.  A unit that is stepped shows no states.
    rates : tuple of int
        References of the states' rates.
    derivatives : bool
        Whether the unit has directional derivatives.
    exact_parameters : bool
        Whether they hold along parameters, too: the standard does not ask for that, units written here have it.
    ignored : tuple of str
        Variables that cannot be used here (whole numbers, texts, numbers of 32 bits), by name.
    stepped : bool
        Whether it is used in Co-Simulation: it has no Model Exchange, or one with events.
    communication : CommunicationSteps
        What it says of its communication steps.
    """

    path: Path
    digest: str
    fmi_version: str
    name: str
    states: tuple[ForeignVariable, ...]
    inputs: tuple[ForeignVariable, ...]
    parameters: tuple[ForeignVariable, ...]
    outputs: tuple[ForeignVariable, ...]
    rates: tuple[int, ...]
    derivatives: bool
    exact_parameters: bool
    ignored: tuple[str, ...]
    stepped: bool = False
    communication: CommunicationSteps = CommunicationSteps()

    @property
    def sensitivities(self) -> str:
        """From which derivatives sensitivities come, as a sentence's part."""
        if self.stepped:
            return (
                "differences of whole runs: the unit is stepped (Co-Simulation) and shows neither states nor rates, so "
                "that the search is by significance, on simulations of whole records"
            )
        if not self.derivatives:
            return "central differences; the unit has no directional derivatives"
        if self.exact_parameters:
            return "the unit's own directional derivatives"
        return "the unit's own directional derivatives for states and inputs, central differences for parameters"


def file_digest(path: Path) -> str:
    """Return a digest of a file's bytes.

    Raises
    ------
    FmuError
        If it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise FmuError(f"'{path}': cannot be read: {error.strerror or error}") from error


def read_unit(path: str | Path) -> ForeignUnit:
    """Read and check the description of a unit.

    Raises
    ------
    FmuError
        With every fault that is found: not a zip file, a path in it that climbs out, no library for this platform,
        neither Model Exchange nor Co-Simulation, events without Co-Simulation, names that stand for two variables.
    """
    path = Path(path).absolute()
    return _read(path, file_digest(path))


@lru_cache(maxsize=16)
def _read(path: Path, digest: str) -> ForeignUnit:
    names = _members(path)
    try:
        import fmpy
    except ImportError as error:
        raise FmuError(f"'{path.name}': foreign units need fmpy: pip install 'vtsdt[fmi]'") from error
    try:
        described = fmpy.read_model_description(str(path), validate=False)
    except Exception as error:
        raise FmuError(f"'{path.name}': modelDescription.xml cannot be read: {_first_line(error)}") from error
    faults = _faults(described, names)
    if faults:
        raise FmuError(f"'{path.name}' cannot be used:\n" + "\n".join(f"  - {f}" for f in faults))
    return _unit(path, digest, described)


def _members(path: Path) -> list[str]:
    try:
        with zipfile.ZipFile(path) as file:
            names = file.namelist()
            bad = file.testzip()
    except (zipfile.BadZipFile, OSError, NotImplementedError) as error:
        raise FmuError(
            f"'{path.name}': is no FMU, an FMU is a zip file ({_first_line(error)}): export it again"
        ) from error
    if bad is not None:
        raise FmuError(f"'{path.name}': the file is damaged at '{bad}'")
    for name in names:
        parts = PurePosixPath(name.replace("\\", "/")).parts
        if ".." in parts or name.startswith(("/", "\\")) or (parts and ":" in parts[0]):
            raise FmuError(f"'{path.name}': '{name}' would be written outside the folder of the unit: it is not opened")
    if "modelDescription.xml" not in names:
        raise FmuError(f"'{path.name}': has no modelDescription.xml")
    return names


def _faults(described: Any, names: list[str]) -> list[str]:
    version = str(described.fmiVersion)
    if version != "2.0" and not version.startswith("3."):
        return [f"it is of FMI {version}: 2.0 and 3.0 can be read"]
    if described.modelExchange is None and described.coSimulation is None:
        return ["it has neither Model Exchange nor Co-Simulation: export it with one of them"]
    faults = []
    used = described.coSimulation if _is_stepped(described) else described.modelExchange
    folder, ending = binary_folder("2.0" if version == "2.0" else "3.0")
    library = f"binaries/{folder}/{used.modelIdentifier}{ending}"
    if library not in names:
        there = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
        has = f"it has libraries for {', '.join(there)}" if there else "it has none at all"
        faults.append(f"there is no library for this platform ('{library}'): {has}")
    if not _is_stepped(described) and (indicators := _event_indicators(described)):
        faults.append(
            f"it has {indicators} event indicators, and state events are not followed here: export it for "
            "Co-Simulation, where the unit follows them itself"
        )
    seen: set[str] = set()
    faults += [
        f"array '{v.name}' has {_count(v)} elements and {len(str(v.start).split())} start values"
        for v in described.modelVariables
        if v.type in _REALS and v.start is not None and len(str(v.start).split()) not in (1, _count(v))
    ]
    double = [v.name for v in described.modelVariables if v.name in seen or seen.add(v.name)]  # type: ignore[func-returns-value]
    if double:
        faults.append(f"two variables have the name {', '.join(map(repr, double[:5]))}")
    if empty := [v.valueReference for v in described.modelVariables if not v.name or not v.name.strip()]:
        faults.append(f"the variable with the reference {empty[0]} has no name")
    if any(u.variable.derivative is None for u in described.derivatives):
        faults.append("a rate does not say whose it is")
    return faults


def _count(v: Any) -> int:
    return math.prod(v.shape or ())


def _event_indicators(described: Any) -> int:
    second = str(described.fmiVersion) == "2.0"
    return int(described.numberOfEventIndicators or 0) if second else len(described.eventIndicators)


def _is_stepped(described: Any) -> bool:
    """Tell whether a unit is used in Co-Simulation: where its Model Exchange is absent, or has state events."""
    if described.coSimulation is None:
        return False
    return described.modelExchange is None or _event_indicators(described) > 0


def _communication(described: Any) -> CommunicationSteps:
    given = described.coSimulation
    asked = getattr(given, "fixedInternalStepSize", None) or getattr(described.defaultExperiment, "stepSize", None)
    return CommunicationSteps(
        size=float(asked) if asked else None,
        fixed=not given.canHandleVariableCommunicationStepSize,
        slopes=str(described.fmiVersion) == "2.0" and bool(given.canInterpolateInputs),
    )


def _unit(path: Path, digest: str, described: Any) -> ForeignUnit:
    units = {u.name: u for u in described.unitDefinitions}
    names = _OwnNames()
    usable = [v for v in described.modelVariables if v.type in _REALS]
    stepped = _is_stepped(described)
    rates = [] if stepped else described.derivatives
    states = [u.variable.derivative for u in rates]
    of_states = {v.valueReference for v in states}
    on: dict[int, tuple[int, ...] | None] = {}
    inputs = [v for v in usable if v.causality == "input"]
    of_inputs = {v.valueReference for v in inputs}
    for unknown in described.outputs:
        known = unknown.dependencies
        on[unknown.variable.valueReference] = (
            None if known is None else tuple(v.valueReference for v in known if v.valueReference in of_inputs)
        )

    def made(variables: Any) -> tuple[ForeignVariable, ...]:
        return tuple(x for v in variables for x in _elements(v, units, names, on.get(v.valueReference)))

    derivatives = not stepped and _has_derivatives(path)
    kinds = ("input", "parameter", "output")
    left = [v.name for v in described.modelVariables if v.causality in kinds and v.type not in _REALS]
    return ForeignUnit(
        path=path,
        digest=digest,
        fmi_version=str(described.fmiVersion),
        name=described.modelName,
        states=made(states),
        inputs=made(inputs),
        parameters=made(v for v in usable if v.causality == "parameter"),
        outputs=made(v for v in usable if v.causality == "output" and v.valueReference not in of_states),
        rates=tuple(u.variable.valueReference for u in rates),
        derivatives=derivatives,
        exact_parameters=derivatives and str(described.generationTool or "").startswith("vtsdt "),
        ignored=tuple(left),
        stepped=stepped,
        communication=_communication(described) if stepped else CommunicationSteps(),
    )


def _has_derivatives(path: Path) -> bool:
    """Tell whether a unit has directional derivatives; fmpy (0.3.32) does not know the attribute of FMI 3.0."""
    with zipfile.ZipFile(path) as file:
        exchange = ET.fromstring(file.read("modelDescription.xml")).find("ModelExchange")
    given = {} if exchange is None else exchange.attrib
    names = ("providesDirectionalDerivative", "providesDirectionalDerivatives")
    return any(given.get(name) in ("true", "1") for name in names)


def _elements(
    v: Any, units: dict[str, Any], names: _OwnNames, depends_on: tuple[int, ...] | None
) -> Iterator[ForeignVariable]:
    """Yield a variable, or the elements of an array row by row."""
    text = v.unit or (v.declaredType.unit if v.declaredType is not None else None) or ""
    unit, factor, offset = _si(text, units.get(text))

    def si(value: Any) -> float | None:
        return None if value is None else float(value) * factor + offset

    shape = tuple(v.shape or ())
    places = list(product(*(range(1, n + 1) for n in shape)))  # one, without indices, for what is no array
    starts = str(v.start).split() if v.start is not None else [None]
    starts = starts * len(places) if len(starts) == 1 else starts
    for k, (place, start) in enumerate(zip(places, starts, strict=True)):
        name = f"{v.name}[{','.join(map(str, place))}]" if place else v.name
        yield ForeignVariable(
            name=name,
            own=names.take(name),
            unit=unit,
            meaning=" ".join((v.description or v.name).split()),
            reference=v.valueReference,
            factor=factor,
            offset=offset,
            start=si(start) or 0.0,
            computed=v.start is None or v.initial == "approx",
            min=si(v.min),
            max=si(v.max),
            tunable=v.variability == "tunable",
            depends_on=depends_on,
            element=k,
            size=len(places),
        )


def _si(text: str, definition: Any) -> tuple[str, float, float]:
    """Return the SI unit of a foreign one, and factor and offset to it; a unit that nobody defines is left as it is."""
    written = re.sub(r"(?<=[A-Za-z])\.(?=[A-Za-z])", "*", text)
    base = getattr(definition, "baseUnit", None)
    if base is None:
        try:
            factor = si_factor(written)
        except UnitError:
            return "", 1.0, 0.0
        return (written, 1.0, 0.0) if factor == 1.0 else (_dimension(written), factor, 0.0)
    powers = {b: int(getattr(base, b, 0) or 0) for b in _BASES}
    unit = _product(powers)
    factor, offset = float(base.factor or 1.0), float(base.offset or 0.0)
    try:
        if factor == 1.0 and offset == 0.0 and si_factor(written) == 1.0 and same_dimension(written, unit or "1"):
            unit = written
    except UnitError:
        pass
    return unit, factor, offset


def _dimension(text: str) -> str:
    from multibody.base.units import base_exponents

    return _product(base_exponents(text))


def _product(powers: dict[str, int]) -> str:
    """Return a product of base units as text.

    Examples
    --------
    >>> _product({"kg": 1, "m": 1, "s": -2})
    'kg*m/s**2'
    """

    def one(base: str, power: int) -> str:
        return base if power == 1 else f"{base}**{power}"

    top = "*".join(one(b, n) for b, n in powers.items() if n > 0)
    below = "".join(f"/{one(b, -n)}" for b, n in powers.items() if n < 0)
    return (top or ("1" if below else "")) + below


class _OwnNames:
    """Gives each foreign name one of letters, digits and single underscores that no other has."""

    def __init__(self) -> None:
        self._taken = {"path", "connections", "time", "der", "zero"}

    def take(self, name: str) -> str:
        """Return the name to be used for a foreign one: ``body.x[1]`` becomes ``body_x_1``."""
        own = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_") or "variable"
        own = own if own[0].isalpha() else f"v_{own}"
        unique, k = own, 2
        while unique in self._taken:
            unique, k = f"{own}_{k}", k + 1
        self._taken.add(unique)
        return unique


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
