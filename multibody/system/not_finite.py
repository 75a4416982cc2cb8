"""Where a value that is not finite is born: the component, the equation, the values in it, and what to do."""

from __future__ import annotations

import ast
import builtins
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.solvers.limits import RUNAWAY

if TYPE_CHECKING:
    from multibody.system.compiled import CompiledSystem

__all__ = ["not_finite", "not_finite_beyond"]

#: Values of an equation that a message shows.
SHOWN = 6
#: Characters of an equation that a message shows.
LONGEST = 160
#: Sizes of trial steps beyond a state where a solver came to a stop, s: what lies ahead within them is found.
AHEAD = 10.0 ** np.arange(-12.0, 1.0, 0.5)


@dataclass(frozen=True, kw_only=True)
class _Assignment:
    """One statement that was carried out: what it assigned, and what came of it."""

    origin: str
    text: str
    names: tuple[str, ...]
    reads: tuple[str, ...]
    fault: str


def not_finite(
    system: CompiledSystem, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray, function: str = "rhs"
) -> str:
    """Return in a sentence which equation gives a value that is not finite; empty where all are finite.

    The equations are carried out one by one, as they stand in the source.

    Parameters
    ----------
    system : CompiledSystem
    t : float, s
    x : ndarray, shape (n,)
    u : ndarray, shape (n_u,)
    p : ndarray, shape (n_p,)
    function : {"rhs", "outputs"}
    """
    for kind, values, group in (
        ("state", x, system.states),
        ("input", u, system.inputs),
        ("parameter", p, system.parameters),
    ):
        for k in np.flatnonzero(~np.isfinite(np.asarray(values, dtype=float)))[:1]:
            return f"{kind} '{group[int(k)].name}' is {values[int(k)]:g} at t = {t:.6g} s: give it a finite value"
    run = _carried_out(system.texts[function], t, x, u, p)
    by_name = {name: step for step in run.steps for name in step.names}
    faulty = next((step for step in run.steps if step.fault == "nan"), None) or next(
        (step for step in run.steps if step.fault), None
    )
    if faulty is None:
        return ""
    seen = set()
    while faulty.text not in seen:  # what reads such a value is not where it is born
        seen.add(faulty.text)
        earlier = next((by_name[n] for n in faulty.reads if n in by_name and by_name[n].fault), None)
        if earlier is None or earlier is faulty:
            break
        faulty = earlier
    return _sentence(faulty, run.values, t)


def not_finite_beyond(system: CompiledSystem, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """Return the same for the states just ahead of one at which a solver came to a stop; empty where all are finite."""
    if (largest := int(np.argmax(np.abs(x)))) >= 0 and abs(x[largest]) > RUNAWAY:
        q = system.states[largest]
        return (
            f"state '{q.name}' has reached {x[largest]:.3g} {q.unit} at t = {t:.6g} s: the model runs away; check the "
            "sign of its feedback, stiffness and damping, and its start values"
        )
    rate = system.rhs(t, x, u, p)
    if not np.all(np.isfinite(rate)):
        return not_finite(system, t, x, u, p)
    for step in AHEAD:
        ahead = x + step * rate
        if not np.all(np.isfinite(ahead)):
            return ""
        if not np.all(np.isfinite(system.rhs(t + step, ahead, u, p))):
            return not_finite(system, t + step, ahead, u, p)
    return ""


@dataclass
class _Run:
    steps: list[_Assignment]
    values: dict[str, Any]


def _carried_out(text: str, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> _Run:
    """Carry out the statements of a generated function one by one, in plain Python."""
    module = ast.parse(text)
    function = module.body[-1]
    assert isinstance(function, ast.FunctionDef)
    scope: dict[str, Any] = {"__builtins__": builtins, "math": math}
    exec(compile(ast.Module(module.body[:-1], []), "<equations>", "exec"), scope)
    arrays = (np.asarray(a, dtype=np.float64) for a in (x, u, p))
    scope.update(zip([a.arg for a in function.args.args], (np.float64(t), *arrays, {}), strict=True))
    lines = text.splitlines()
    steps: list[_Assignment] = []
    with np.errstate(all="ignore"):
        for statement in function.body:
            if isinstance(statement, ast.Return):
                break
            names = tuple(dict.fromkeys(_assigned(statement)))
            fault = ""
            try:
                exec(compile(ast.Module([statement], []), "<equations>", "exec"), scope)
            except (ArithmeticError, ValueError) as error:
                fault = f"{type(error).__name__}: {error}"
                scope.update(dict.fromkeys(names, np.float64(np.nan)))
            worst = [scope[n] for n in names if isinstance(scope.get(n), float) and not math.isfinite(scope[n])]
            if not fault and worst:
                fault = "nan" if any(math.isnan(v) for v in worst) else "inf"
            reads = tuple(
                dict.fromkeys(n.id for n in ast.walk(statement) if isinstance(n, ast.Name) and n.id not in names)
            )
            steps.append(
                _Assignment(
                    origin=_origin(lines, statement.lineno),
                    text=ast.unparse(statement),
                    names=names,
                    reads=reads,
                    fault=fault,
                )
            )
    return _Run(steps, scope)


def _assigned(statement: ast.stmt) -> Iterator[str]:
    for node in ast.walk(statement):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def _origin(lines: Sequence[str], number: int) -> str:
    """Return what the comment above a statement says, such as ``guide (ViscousFriction``."""
    for line in reversed(lines[: number - 1]):
        if line.lstrip().startswith("# "):
            return line.lstrip()[2:]
    return ""


def _sentence(step: _Assignment, values: dict[str, Any], t: float) -> str:
    part, _, kind = step.origin.partition(" (")
    where = f"component '{part}' ({kind.rstrip(')')})" if kind else f"'{part}'" if part else "the model"
    named = [n for n in step.reads if isinstance(values.get(n), float)]
    shown = ", ".join(f"{_readable(n, part)} = {values[n]:.4g}" for n in named[:SHOWN])
    text = _readable(step.text.splitlines()[0], part)
    text = text if len(text) <= LONGEST else text[:LONGEST] + " …"
    return (
        f"{where}: the equation '{text}' {_what(step, values)} at t = {t:.6g} s{f' with {shown}' if shown else ''}: "
        f"{_remedy(step, values)}"
    )


def _what(step: _Assignment, values: dict[str, Any]) -> str:
    if "ZeroDivision" in step.fault or _zero_divisor(step, values):
        return "divides by zero"
    if "math domain" in step.fault or "expected a" in step.fault:
        return "takes a root or a logarithm where there is none"
    if step.fault == "inf" or "Overflow" in step.fault or "range" in step.fault:
        return "is beyond the largest number"
    return "has no value (NaN)"


def _zero_divisor(step: _Assignment, values: dict[str, Any]) -> str:
    """Return the divisor that is zero, or an empty text."""
    for node in ast.walk(ast.parse(step.text)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div | ast.Mod):
            try:
                with np.errstate(all="ignore"):
                    divisor = eval(compile(ast.Expression(node.right), "<equations>", "eval"), values)
            except (ArithmeticError, ValueError, NameError):
                continue
            if divisor == 0.0:
                return ast.unparse(node.right)
    return ""


def _remedy(step: _Assignment, values: dict[str, Any]) -> str:
    divisor = _zero_divisor(step, values)
    if divisor:
        part = step.origin.partition(" (")[0]
        if divisor.startswith("_M__"):
            return f"give what moves at '{part}' a mass or an inertia above zero"
        return f"give '{_readable(divisor, part)}' a value other than zero, or keep the equation away from zero"
    if "math domain" in step.fault or "expected a" in step.fault:
        return "keep its argument inside the range, for instance by max(…, 0.0), or start elsewhere"
    return (
        "check the sizes of these values (a unit, a sign, a start value), or keep the equation inside its range by min "
        "and max"
    )


def _readable(text: str, part: str) -> str:
    """Return generated names as a user wrote them: ``guide__viscous`` as ``guide.viscous``."""
    text = re.sub(r"___local\d+__", "__", text)
    text = re.sub(r"(\w+?)___der__(\w+)", r"der(\1.\2)", text)
    text = re.sub(r"_M__(\w+?)___\w+", r"mass of \1", text)
    text = re.sub(r"(\w+?)___net\b", r"force on \1", text)
    text = re.sub(r"(\w+?)___F\b", r"force on \1", text)
    text = re.sub(r"\bf_\w+?_(\w+)\(", r"\1(", text)
    return re.sub(r"(?<=\w)__(?=\w)", ".", text)
