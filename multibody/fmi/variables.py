"""The variables of an exported unit: names, units, start values, and the references under which C finds them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from multibody.assembly.equation_set import Quantity
from multibody.fmi.errors import FmuError
from multibody.fmi.structure import Sources, dependencies
from multibody.system.compiled import CompiledSystem

__all__ = ["Variable", "Variables", "variables_of"]

#: Names that are legal in the "structured" naming convention without quotation marks (FMI 3.0, 2.4.7.5.1).
_IDENTIFIER = r"[A-Za-z_]\w*(\[\d+\])?"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}(\.{_IDENTIFIER})*|der\({_IDENTIFIER}(\.{_IDENTIFIER})*\)", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One scalar variable.

    Parameters
    ----------
    reference : int
        Value reference: the index in the array of all values in ``instance.h``.
    name, unit, meaning : str
    causality : {"independent", "output", "local", "input", "parameter"}
    start : float or None
        None for what is computed.
    min, max, nominal : float or None
    derivative_of : int or None
        Reference of the state whose rate this is.
    depends_on : tuple of int
        References of the states and inputs that a rate or an output depends on.
    """

    reference: int
    name: str
    unit: str
    meaning: str
    causality: str
    start: float | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    derivative_of: int | None = None
    depends_on: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Variables:
    """All variables in the order of their references, group by group as in ``instance.h``."""

    time: Variable
    states: tuple[Variable, ...]
    rates: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    by_group: tuple[tuple[Variable, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        groups = ((self.time,), self.states, self.rates, self.inputs, self.parameters, self.outputs)
        object.__setattr__(self, "by_group", groups)

    @cached_property
    def all(self) -> tuple[Variable, ...]:
        """Every variable; the place in this tuple is the reference."""
        return tuple(v for group in self.by_group for v in group)

    @property
    def structured(self) -> bool:
        """Whether every name is legal in the naming convention "structured"."""
        return all(_STRUCTURED.fullmatch(v.name) for v in self.all)


def variables_of(system: CompiledSystem, start: np.ndarray, p: np.ndarray, shown: tuple[int, ...]) -> Variables:
    """Return the variables of a system.

    Parameters
    ----------
    system : CompiledSystem
    start, p : ndarray, shapes (n,), (n_p,)
        Start values of states and parameters.
    shown : tuple of int
        Indices of the outputs to be written out beside the states.
    """
    n, n_u, n_p = len(system.states), len(system.inputs), len(system.parameters)
    x0, dx0, u0 = 1, 1 + n, 1 + 2 * n
    p0 = u0 + n_u
    y0 = p0 + n_p
    at = {"x": x0, "u": u0}

    def references(sources: Sources) -> tuple[int, ...]:
        return tuple(sorted(at[array] + k for array, k in sources))

    of_rates, of_outputs = dependencies(system.texts["rhs"], "rhs"), dependencies(system.texts["outputs"], "outputs")
    states, rates = [], []
    for k, q in enumerate(system.states):
        nominal = float(abs(start[k])) or 1.0
        bounds = {"min": q.min, "max": q.max}
        states.append(_variable(q, x0 + k, "output", start=float(start[k]), nominal=nominal, **bounds))
        unit = f"({q.unit})/s" if q.unit else "1/s"
        rate = replace(q, name=f"der({q.name})", unit=unit, meaning=f"rate of {q.name}", min=None, max=None)
        depends = references(of_rates.get(k, frozenset()))
        rates.append(_variable(rate, dx0 + k, "local", derivative_of=x0 + k, depends_on=depends))
    outputs = []
    for k, i in enumerate(shown):
        depends = references(of_outputs.get(i, frozenset()))
        outputs.append(_variable(system.outputs[i], y0 + k, "output", depends_on=depends))
    made = Variables(
        time=Variable(reference=0, name="time", unit="s", meaning="time", causality="independent"),
        states=tuple(states),
        rates=tuple(rates),
        inputs=tuple(_variable(q, u0 + k, "input", start=q.value) for k, q in enumerate(system.inputs)),
        parameters=tuple(
            _variable(q, p0 + k, "parameter", start=float(p[k]), min=q.min, max=q.max)
            for k, q in enumerate(system.parameters)
        ),
        outputs=tuple(outputs),
    )
    return _with_own_names(made, system.name)


def _variable(q: Quantity, reference: int, causality: str, **given: object) -> Variable:
    return Variable(
        reference=reference,
        name=q.name,
        unit=q.unit,
        meaning=q.meaning,
        causality=causality,
        **given,  # type: ignore[arg-type]
    )


def _with_own_names(made: Variables, model: str) -> Variables:
    """Give outputs whose name is taken the ending ``_out``; refuse other names that two variables have."""
    taken = {v.name for group in made.by_group[:-1] for v in group}
    outputs = tuple(replace(v, name=f"{v.name}_out") if v.name in taken else v for v in made.outputs)
    made = replace(made, outputs=outputs)
    names = [v.name for v in made.all]
    if faults := sorted({f"'{n}'" for n in names if names.count(n) > 1}):
        raise FmuError(f"'{model}': two variables have the name {', '.join(faults)}: rename one of them")
    return made
