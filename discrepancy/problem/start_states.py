"""Where each record starts: numbers, expressions of what was measured, and states at which the machine is at rest."""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping
from dataclasses import replace
from fnmatch import fnmatch
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.tables import StartValue
from estimation.files.record import Record
from estimation.response.experiment import Experiment
from multibody.base.errors import SimulationError
from multibody.base.parsing import expression
from multibody.base.spelling import nearest_or_choices
from multibody.system.equilibrium import equilibrium

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["at_rest", "expression_fault", "starts_of_record"]

#: Words that are no expression.
WORDS = ("free", "measured", "equilibrium")
#: Steps, in the state's unit, over which a position at rest is searched to both sides where the first guess feels
#: nothing, as a slack rope does; from a micrometre to some ten metres.
REACH = tuple(float(f"{m}e{k}") for k in range(-6, 2) for m in (1, 2, 5))
#: Passes over all states to be found before Newton's method has another try.
SWEEPS = 4


def _name(node: ast.expr) -> str | None:
    """Return the dotted name that a node stands for."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (before := _name(node.value)) is not None:
        return f"{before}.{node.attr}"
    return None


def expression_fault(text: str, signals: Collection[str]) -> str:
    """Return what is wrong with an expression of measured signals, or an empty text.

    Parameters
    ----------
    text : str
        Such as ``"2.3 - cabin.z"``: numbers, names of inputs and outputs of the study, + - * / and brackets.
    signals : collection of str
        Inputs and outputs of the study.
    """
    try:
        tree = expression(text)
    except (SyntaxError, ValueError):
        return f'must be a number in SI, "free", "measured", "equilibrium" or an expression, and is {text!r}'
    unknown = []
    for node in _parts(tree):
        name = _name(node)
        if name is not None:
            if name in signals:
                continue
            words = "" if node is not tree else ', nor "free", "measured" or "equilibrium"'
            known = signals if node is not tree else (*WORDS, *signals)
            unknown.append(f"'{name}' is no input or output of the study{words}{nearest_or_choices(name, known)}")
        elif not isinstance(node, ast.Constant) or type(node.value) not in (int, float):
            return (
                f"{text!r}: only numbers, names of inputs and outputs, + - * / and brackets can stand; remove the rest"
            )
    return "; ".join(dict.fromkeys(unknown))


def _parts(node: ast.expr) -> list[ast.expr]:
    """Return what an expression is made of, without the operations that are allowed."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.Mult | ast.Div):
        return [*_parts(node.left), *_parts(node.right)]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        return _parts(node.operand)
    return [node]


def _value(node: ast.expr, measured: Mapping[str, float]) -> float:
    name = _name(node)
    if name is not None:
        return measured[name]
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, measured)
        return -inner if isinstance(node.op, ast.USub) else inner
    assert isinstance(node, ast.BinOp)
    a, b = _value(node.left, measured), _value(node.right, measured)
    if isinstance(node.op, ast.Add):
        return a + b
    if isinstance(node.op, ast.Sub):
        return a - b
    return a * b if isinstance(node.op, ast.Mult) else (a / b if b != 0.0 else float("nan"))


def starts_of_record(values: Mapping[str, StartValue], record: Record) -> tuple[dict[str, float | str], list[str]]:
    """Return the start values of one record: numbers, or "measured" and "equilibrium", and what is wrong with them.

    Parameters
    ----------
    values : mapping
        As a study states them, expressions checked.
    record : Record
        Expressions take its first samples, in SI.
    """
    measured = {name: float(signal.values[0]) for name, signal in record.signals.items()}
    starts: dict[str, float | str] = {}
    faults = []
    for state, given in values.items():
        if isinstance(given, Mapping):
            patterns = given
            chosen = [v for pattern, v in patterns.items() if _is_of(pattern, record)]
            if not chosen:
                listed = ", ".join(f"'{p}'" for p in patterns)
                faults.append(
                    f"[initial] \"{state}\": no pattern fits the record '{record.name}': there are {listed}; add one, "
                    'or "*" for all others'
                )
                continue
            given = chosen[0]
        if isinstance(given, str) and given not in WORDS:
            number = _value(expression(given), measured)
            if not np.isfinite(number):
                faults.append(
                    f"[initial] \"{state}\": {given!r} is {number} at the start of '{record.name}': give an expression "
                    "that is a finite number there"
                )
            starts[state] = number
        else:
            starts[state] = given
    return starts, faults


def _is_of(pattern: str, record: Record) -> bool:
    return fnmatch(record.name, pattern) or fnmatch(record.path.name, pattern)


def at_rest(
    experiment: Experiment, system: System, states: Collection[str], p: np.ndarray, *, whole: bool = False
) -> Experiment:
    """Return the experiment with some states where the machine is at rest, the others at their start values.

    Parameters
    ----------
    experiment : Experiment
        Its start values are numbers or "measured", those of ``states`` aside.
    system : System
    states : collection of str
        Positions, angles, or other states.
    p : ndarray, shape (n_p,)
    whole : bool
        Whether every other state may come to rest, too, as near to its start value as possible.

    Raises
    ------
    SimulationError
        If there is no such position within some ten units of where the search begins, with the state's name.
    """
    begin = replace(experiment, start={k: v for k, v in experiment.start.items() if k not in states})
    x = begin.start_vector(system)
    inputs = dict(zip(system.input_names, begin.table(system)(float(begin.record.time[0]), p).ravel(), strict=True))
    speeds = {system.state_names[k]: system.state_names[v] for k, v in system.rate_states.items()}
    moving = {*states, *(speeds[n] for n in states if n in speeds)}
    hold = [] if whole else [n for n in system.state_names if n not in moving]

    def settled(guess: np.ndarray) -> np.ndarray | None:
        try:
            return np.array(equilibrium(system, inputs=inputs, parameters=p, guess=guess, hold=hold).state)
        except SimulationError:
            return None

    u = system.input_vector(inputs)
    rates = {n: system.index("state", speeds.get(n, n)) for n in states}
    for n in states:
        if n in speeds:
            x[system.index("state", speeds[n])] = 0.0
    rest = settled(x)
    for _ in range(SWEEPS if rest is None else 0):
        for n in states:
            x = _nulled(system, x, u, p, system.index("state", n), rates[n])
        rest = settled(x)
        if rest is not None:
            break
    if rest is None:
        raise SimulationError(
            f"record '{experiment.name}': [initial]: no {', '.join(states)} was found at which the machine is at rest "
            "with the other states at their start values: give a number, or check what carries it"
        )
    known = system.state_names if whole else states
    start = dict(experiment.start) | {n: float(rest[system.index("state", n)]) for n in known}
    return replace(experiment, start=start)


def _nulled(system: System, x: np.ndarray, u: np.ndarray, p: np.ndarray, state: int, rate: int) -> np.ndarray:
    """Return the state vector with one state moved to the nearest place where a rate changes its sign."""
    from scipy.optimize import brentq

    def of(value: float) -> float:
        trial = x.copy()
        trial[state] = value
        return float(system.rhs(0.0, trial, u, p)[rate])

    here = of(x[state])
    moved = x.copy()
    for step in REACH:
        for way in (-step, step):
            there = of(x[state] + way)
            if np.isfinite(there) and there * here <= 0.0 and there != here:
                moved[state] = brentq(of, *sorted((x[state], x[state] + way)))
                return moved
    return moved
