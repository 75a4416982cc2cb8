"""A foreign unit as a component: its states, inputs, parameters and outputs in a model of components."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from multibody.assembly.equation_set import Assembly, Quantity
from multibody.base.spelling import nearest
from multibody.compile.hosts import ASKS
from multibody.declare.component import Component
from multibody.declare.declarations import (
    Declaration,
    Input,
    Option,
    Output,
    Parameter,
    State,
    Translation,
)
from multibody.equations.statements import variable
from multibody.fmi.answering import OUTPUTS, RATES, SLOPES, VERSION
from multibody.fmi.communication import given_name, heard_name, stepped_run
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign import start_states
from multibody.fmi.foreign_description import ForeignUnit, ForeignVariable, read_unit
from multibody.system.compiled import CompiledSystem
from multibody.system.stepped import SteppedRun

__all__ = ["Fmu", "Gap", "sensitivity_sources"]

_KEYS = ("force", "motion", "rate")


class Fmu(Component):
    """A model from another tool (an FMU, FMI 2.0 or 3.0).

    A unit for Model Exchange is integrated with the rest of the model.  One for Co-Simulation alone, or whose Model
    Exchange has state events, is stepped from sample to sample: it has no states here, and sensitivities come from
    differences of whole runs.

    Its states, inputs, parameters and outputs are those of the unit, in SI, under their own names with an underscore in
    the place of every other character: ``body.x[1]`` is ``body_x_1``.  An input that nothing drives keeps its start
    value.  A state that its description gives no start value starts where the unit's own initialization puts it, with
    the parameters of the description.  The unit runs in a process of its own, which compiles the equations around
    it and integrates them; evaluated elsewhere, one after another, they are plain Python.

    Parameters
    ----------
    path : str or Path
        The file.
    connections : mapping, optional
        For each flange that the unit is to have its force input and the outputs (or states) that are its motion along
        this force: ``{"guide": {"force": "F_ext", "motion": "s", "rate": "v"}}``.  The flange has no acceleration:
        what depends on it (an added mass) cannot act there.
    given
        Parameters, by name.

    Attributes
    ----------
    sensitivities : str
        From which derivatives sensitivities come: the unit's own, or differences.

    Raises
    ------
    FmuError
        If the file cannot be used, with every reason.
    """

    path = Option("", "the file")
    connections = Option("", "flanges, as 'guide: force=F_ext motion=s rate=v; ...'")

    def __init__(
        self, path: str | Path = "", connections: Mapping[str, Mapping[str, str]] | str = "", **given: Any
    ) -> None:
        text = connections if isinstance(connections, str) else _text(connections)
        super().__init__(path=str(Path(path).absolute()), connections=text, **given)

    def _decide_declarations(self) -> None:
        unit = read_unit(str(self.options["path"]))
        self.digest = unit.digest
        self.sensitivities = unit.sensitivities
        self.steps_itself = unit.stepped
        self.only_python = not unit.stepped
        chosen: dict[str, Declaration] = dict(self.declarations)

        def add(name: str, item: Declaration) -> None:
            object.__setattr__(item, "name", name)
            chosen[name] = item

        for v in unit.parameters:
            add(v.own, Parameter(v.start, v.unit, v.meaning, min=v.min, max=v.max))
        for v, start in zip(unit.states, _starts(unit), strict=True):
            add(v.own, State(v.unit, v.meaning, start, min=v.min, max=v.max))
        for v in unit.inputs:
            add(v.own, Input(v.unit, v.meaning, v.start))
        for v in unit.outputs:
            add(v.own, Output(v.unit, v.meaning))
        for flange in _flanges(str(self.options["connections"]), unit):
            add(flange.name, Translation(f"where '{flange.force.name}' acts", prescribed=True))
        self.declarations = chosen

    def assemble(self, owner: str, work: Assembly) -> None:
        """Add the statements that ask the unit; an output that does not depend on an input does not wait for it."""
        unit = read_unit(str(self.options["path"]))
        flanges = _flanges(str(self.options["connections"]), unit)
        used = {v.own: variable(owner, v.own) for v in (*unit.states, *unit.inputs, *unit.parameters)}
        for flange in flanges:
            own = flange.force.own
            used[own] = f"{variable(owner, own)}___total"
            reaction = variable(owner, flange.name, "reaction")
            work.add(f"{used[own]} = {variable(owner, own)} - {reaction}", owner)
            for what, shown in (("position", flange.motion), ("velocity", flange.rate)):
                work.add(f"{variable(owner, flange.name, what)} = {variable(owner, shown.own)}", owner)
            work.add(f"{variable(owner, flange.name, 'acceleration')} = 0.0", owner)
        if unit.stepped:
            self._step(owner, work, unit, used)
            return
        for k, (wanted, on, members) in enumerate(_groups(unit)):
            kernel, answer = f"k_fmu_{owner.replace('.', '_')}_{k}", variable(owner, f"_answer_{k}")
            kernels: dict[str, Any] = work.kernels
            kernels[kernel], kernels[f"{kernel}_shown"] = _Asks(unit, wanted, k), _Shows(unit, k)
            given = [
                repr(v.start) if v in unit.inputs and v.reference not in on else used[v.own]
                for v in (*unit.states, *unit.inputs, *unit.parameters)
            ]
            work.add(f"{answer} = {kernel}({', '.join(['t', *given])})", owner)
            for i in members:
                of_state = i < len(unit.states)
                own = unit.states[i].own if of_state else unit.outputs[i - len(unit.states)].own
                target = variable(owner, "_der", own) if of_state else variable(owner, own)
                work.add(f"{target} = {kernel}_shown({answer}, {float(i)!r})", owner)

    def _step(self, owner: str, work: Assembly, unit: ForeignUnit, used: Mapping[str, str]) -> None:
        """Add what is heard of a unit that is stepped, and what it is given; see `multibody.fmi.communication`."""
        for v in unit.outputs:
            heard = f"{variable(owner, v.own)}___heard"
            work.inputs.append(
                Quantity(name=heard_name(owner, v.own), unit=v.unit, meaning=f"{v.name} of the unit", variable=heard)
            )
            work.add(f"{variable(owner, v.own)} = {heard}", owner)
        for v in unit.inputs:
            shown = f"{variable(owner, v.own)}___given"
            work.add(f"{shown} = {used[v.own]}", owner)
            work.output(given_name(owner, v.own), v.unit, f"{v.name}, as the unit is given it", shown)

    def needed_outputs(self, owner: str) -> list[str]:
        """Return the outputs without which a model with this unit cannot be simulated."""
        unit = read_unit(str(self.options["path"]))
        return [given_name(owner, v.own) for v in unit.inputs] if unit.stepped else []

    def stepped_run(self, system: CompiledSystem, owner: str, *given: Any, **options: Any) -> SteppedRun:
        """Simulate a model with this unit; arguments as of `multibody.fmi.communication.stepped_run`."""
        return stepped_run(system, read_unit(str(self.options["path"])), owner, *given, **options)


class Gap(Component):
    """Two flanges with nothing between them: a place where an effect can act."""

    a = Translation("one side")
    b = Translation("the other side")

    def equations(self) -> None:
        """State that no force acts."""
        self.a.force = 0.0  # type: ignore[misc, attr-defined]
        self.b.force = 0.0  # type: ignore[misc, attr-defined]


def sensitivity_sources(components: Mapping[str, Component]) -> dict[str, str]:
    """Return, for each foreign unit among a model's components, from which derivatives its sensitivities come."""
    return {name: part.sensitivities for name, part in components.items() if isinstance(part, Fmu)}


class _Asks:
    """A function for equations that brings its own text and that of its tangent (`called_functions.kernel_sources`).

    It asks the unit, and returns what `_Shows` takes values from.
    """

    returned = 1

    def __init__(self, unit: ForeignUnit, wanted: int, place: int) -> None:
        names = [f"a{k}" for k in range(len(unit.states) + len(unit.inputs) + len(unit.parameters))]
        dots = [f"{n}_dot" for n in names]
        self._file = f"({str(unit.path)!r}, {unit.digest!r})"
        plain = ["t", *names]
        self._plain = _question(plain, plain, f"{wanted}, {place}", "answer")
        both = [*plain, *dots]
        self._tangent = _question([*plain, "t_dot", *dots], both, f"{wanted + SLOPES}, {place}", "answer, answer")

    def text(self, name: str) -> str:
        """Return the text of the function under a name."""
        of_unit = f"{name}_key = key_of{self._file}\n{name}_host = host_of{self._file}\n"
        return f"{ASKS}# {VERSION}\n{of_unit}def {name}{self._plain.format(name)}"

    def tangent_text(self, name: str) -> str:
        """Return the text of its tangent under a name."""
        return f"def {name}{self._tangent.format(name.removesuffix('_tangent'))}"


class _Shows:
    """A function for equations, as `_Asks`: a value of an answer."""

    returned = 1

    def __init__(self, unit: ForeignUnit, place: int) -> None:
        self._place, self._count = place, len(unit.states) + len(unit.outputs)

    def text(self, name: str) -> str:
        """Return the text of the function under a name."""
        return f"def {name}(answer, k):\n    return shown(answer, {self._place}, int(k))\n"

    def tangent_text(self, name: str) -> str:
        """Return the text of its tangent under a name."""
        value = f"shown(answer_dot, {self._place}, int(k))"
        slope = f"slope_shown(answer_dot, {self._place}, int(k), {self._count})"
        return f"def {name}(answer, k, answer_dot, k_dot):\n    return {value}, {slope}\n"


def _question(arguments: list[str], given: list[str], how: str, returned: str) -> str:
    """Return a function without its name that asks a unit; ``{0}`` stands for the name of its key."""
    lines = [
        f"given = room({len(given)})",
        *(f"given[{k}] = {name}" for k, name in enumerate(given)),
        f"answer = ask({{0}}_key, {how}, given)",
        f"return {returned}",
    ]
    return f"({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in lines)


def _starts(unit: ForeignUnit) -> list[float]:
    """Return the start values of the states: those of the description, and what the unit computes where it has none."""
    if not any(v.computed for v in unit.states):
        return [v.start for v in unit.states]
    computed = start_states(str(unit.path), unit.digest)
    return [c if v.computed else v.start for v, c in zip(unit.states, computed, strict=True)]


def _groups(unit: ForeignUnit) -> list[tuple[int, frozenset[int], tuple[int, ...]]]:
    """Return what is asked for at once: the rates, and outputs by the inputs that they depend on.

    Rates depend on all inputs, and so does an output that says nothing.
    """
    every = frozenset(v.reference for v in unit.inputs)
    groups: dict[frozenset[int], list[int]] = {}
    for k, v in enumerate(unit.outputs):
        on = every if v.depends_on is None else frozenset(v.depends_on)
        groups.setdefault(on, []).append(len(unit.states) + k)
    rates = [(RATES, every, tuple(range(len(unit.states))))] if unit.states else []
    return rates + [(OUTPUTS, on, tuple(members)) for on, members in groups.items()]


@dataclass(frozen=True)
class _Flange:
    name: str
    force: ForeignVariable
    motion: ForeignVariable
    rate: ForeignVariable


def _text(connections: Mapping[str, Mapping[str, str]]) -> str:
    return "; ".join(f"{name}: {' '.join(f'{k}={v}' for k, v in given.items())}" for name, given in connections.items())


def _flanges(text: str, unit: ForeignUnit) -> list[_Flange]:
    flanges, faults = [], []
    shown = {n: v for v in (*unit.states, *unit.outputs) for n in (v.name, v.own)}
    driven = {n: v for v in unit.inputs for n in (v.name, v.own)}
    taken = {v.own for v in (*unit.states, *unit.inputs, *unit.parameters, *unit.outputs)}
    for part in filter(None, (p.strip() for p in text.split(";"))):
        name, _, rest = part.partition(":")
        given = dict(word.partition("=")[::2] for word in rest.split())
        where = f"connection '{name}'"
        if name.strip() in taken:
            faults.append(f"{where}: '{unit.name}' has a variable of this name: give the place another")
        if missing := [k for k in _KEYS if k not in given]:
            faults.append(f"{where}: {' and '.join(missing)} missing: say which variable it is")
        faults += [f"{where}: there is no key '{k}'{nearest(k, _KEYS)}" for k in given if k not in _KEYS]
        variables = {}
        for key, kind, known in (("force", "input", driven), ("motion", "output", shown), ("rate", "output", shown)):
            if key in given and given[key] not in known:
                faults.append(f"{where}, {key}: '{unit.name}' has no {kind} '{given[key]}'{nearest(given[key], known)}")
            elif key in given:
                variables[key] = known[given[key]]
        if len(variables) == len(_KEYS):
            flanges.append(_Flange(name.strip(), **variables))
            for key in ("motion", "rate"):
                if variables[key] in unit.outputs and variables["force"].reference in _inputs_of(variables[key], unit):
                    faults.append(f"{where}, {key}: '{given[key]}' depends on the force at the same instant")
    if faults:
        raise FmuError(f"'{unit.path.name}' cannot be used:\n" + "\n".join(f"  - {f}" for f in faults))
    return flanges


def _inputs_of(v: ForeignVariable, unit: ForeignUnit) -> set[int]:
    return {i.reference for i in unit.inputs} if v.depends_on is None else set(v.depends_on)
