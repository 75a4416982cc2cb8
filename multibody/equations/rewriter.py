"""The subset of Python in which equations are written: each construct is accepted, or refused with its line."""

from __future__ import annotations

import ast
import inspect
import math
import numbers
import re
from collections.abc import Callable
from typing import Any

from multibody.base.errors import EquationError
from multibody.base.parsing import expression
from multibody.base.spelling import nearest
from multibody.declare.declarations import Table
from multibody.equations import tables
from multibody.equations.scope import Scope
from multibody.equations.statements import constant, local_variable, variable

__all__ = ["Rewriter", "simplified"]

ARITY = {
    **dict.fromkeys(["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"], 1),
    **dict.fromkeys(["exp", "log", "sqrt", "fabs", "floor"], 1),
    **dict.fromkeys(["atan2", "hypot", "copysign", "pow"], 2),
}
BUILTIN_FUNCTIONS = frozenset({"abs", "min", "max"})
_TAKEN = BUILTIN_FUNCTIONS | {"math", "range", "self"}
_PLAIN = {
    "AsyncFor": "an asynchronous loop",
    "Assert": "assert",
    "Await": "await",
    "Delete": "del",
    "Dict": "a dict",
    "DictComp": "a dict comprehension",
    "FunctionDef": "a function inside the equations",
    "GeneratorExp": "a generator",
    "Import": "import",
    "ImportFrom": "import",
    "JoinedStr": "a text",
    "Lambda": "lambda",
    "List": "a list",
    "ListComp": "a list comprehension",
    "NamedExpr": "':='",
    "Return": "return",
    "Raise": "raise",
    "Set": "a set",
    "Slice": "a slice",
    "Starred": "'*'",
    "Subscript": "an index",
    "Try": "try",
    "While": "while",
    "With": "with",
    "Yield": "yield",
}
_ALLOWED = (
    ast.BinOp,
    ast.UnaryOp,
    ast.BoolOp,
    ast.Compare,
    ast.Constant,
    ast.Tuple,
    ast.operator,
    ast.unaryop,
    ast.boolop,
    ast.cmpop,
    ast.expr_context,
    ast.Pass,
)
_INSTEAD = "write it with numbers, names, + - * / ** %, if and calls of functions"
_OPERATORS = ast.Add | ast.Sub | ast.Mult | ast.Div | ast.Pow | ast.Mod
_COMPARISONS: dict[type, Callable[[Any, Any], bool]] = {
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b,
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Is: lambda a, b: a is b,
    ast.IsNot: lambda a, b: a is not b,
}


class Rewriter(ast.NodeTransformer):
    """Turn a method's body into statements over global names, refusing what the subset does not have.

    Parameters
    ----------
    scope : Scope
        What names stand for.
    function : callable
        The method or kernel.
    local_names : set of str
        Names that the body itself assigns.
    file, first_line
        Where the body stands.
    local_scope : str
        Keeps local names of different methods of a component apart.
    coupling : bool
        Whether the method is a coupling, which gives positions.
    """

    def __init__(
        self,
        scope: Scope,
        function: Callable[..., Any],
        local_names: set[str],
        file: str,
        first_line: int,
        local_scope: str = "",
        coupling: bool = False,
    ):
        self.scope = scope
        self.globals = function.__globals__  # type: ignore[attr-defined]
        self.closure = inspect.getclosurevars(function).nonlocals
        self.locals = local_names
        self.file = file
        self.first_line = first_line
        self.local_scope = local_scope
        self.coupling = coupling

    def where(self, node: ast.AST) -> str:
        """Return component, class, file and line of a node."""
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return f"{self.scope.name} ({type(self.scope.component).__name__}, {self.file}:{line})"

    def refuse(self, node: ast.AST, why: str) -> EquationError:
        """Return the error that says why a node cannot stand in equations."""
        return EquationError(f"{self.where(node)}: {why}: '{ast.unparse(node).splitlines()[0]}'")

    def statement(self, node: ast.stmt) -> list[ast.stmt]:
        """Return a statement of the subset, rewritten; its whole numbers become real ones."""
        out = [_Real().visit(n) for n in as_list(self.visit(node))]
        for part in out:
            for inner in ast.walk(part):
                if isinstance(inner, ast.Constant) and not isinstance(inner.value, bool | int | float):
                    raise self.refuse(node, f"{inner.value!r} is not a number: write one")
        return out

    # ---------------------------------------------------------------- names and numbers

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        path: list[str] = []
        inner: ast.expr = node
        while isinstance(inner, ast.Attribute):
            path.insert(0, inner.attr)
            inner = inner.value
        if isinstance(inner, ast.Name) and inner.id == "self":
            value = self.scope.attribute(path, self.where(node))
            if isinstance(node.ctx, ast.Store):
                why = self.scope.why_not_assigned(path, self.coupling)
                if why:
                    raise self.refuse(node, why)
            return ast.Name(value.id, node.ctx) if isinstance(value, ast.Name) else value
        if isinstance(inner, ast.Name) and inner.id == "math" and len(path) == 1 and hasattr(math, path[0]):
            number = getattr(math, path[0])
            if isinstance(number, float) and number == number:
                return constant(number)
        raise self.refuse(node, "only attributes of self and of math can be used in equations: use one of these")

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.locals:
            return ast.Name(self.local_name(node), node.ctx)
        if node.id not in self.globals and node.id not in self.closure:
            known = [*self.locals, *(n for n in self.globals if not n.startswith("__"))]
            hint = nearest(node.id, known) or ", or use self.… for what the component declares"
            raise self.refuse(node, f"'{node.id}' is not defined: give it a value first{hint}")
        value = self.closure.get(node.id, self.globals.get(node.id))
        if isinstance(value, bool | numbers.Real) and value == value:
            return constant(value)
        raise self.refuse(
            node, f"'{node.id}' is a {type(value).__name__}: equations can use numbers only; call a function for more"
        )

    def local_name(self, node: ast.Name) -> str:
        """Return the global name of a local one."""
        if node.id in _TAKEN:
            raise self.refuse(node, f"'{node.id}' is the name of a function: give the variable another name")
        return local_variable(self.scope.name, self.local_scope, node.id)

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return constant(node.value) if isinstance(node.value, int | float) else node

    # ---------------------------------------------------------------- calls

    def visit_Call(self, node: ast.Call) -> ast.expr:
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.refuse(node, "calls in equations take plain positional arguments")
        func = node.func
        if isinstance(func, ast.Attribute) and func.attr == "slope" and (curve := self._curve(func.value)) is not None:
            if len(node.args) != 1:
                raise self.refuse(node, "the slope of a table takes one argument")
            return self.table_call(curve.name, curve, self.visit(node.args[0]), slope=True)
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name):
            if func.value.id == "math":
                return self._math_call(node, func)
            if func.value.id == "self":
                table = self.scope.component.declarations.get(func.attr)
                if not isinstance(table, Table) or len(node.args) != 1:
                    raise self.refuse(
                        node,
                        "only a declared table can be called on self, with one argument: write a plain function",
                    )
                return self.table_call(func.attr, table, self.visit(node.args[0]))
            if func.attr in ARITY:
                raise self.refuse(node, f"write math.{func.attr} in equations")
        if isinstance(func, ast.Name) and func.id not in self.locals:
            if func.id in BUILTIN_FUNCTIONS:
                self._count(
                    node,
                    func.id,
                    *((len(node.args) == 1, "1") if func.id == "abs" else (len(node.args) > 1, "2 or more")),
                )
                return ast.Call(ast.Name(func.id, ast.Load()), self._arguments(node), [])
            kernel = self.closure.get(func.id, self.globals.get(func.id))
            kernel = getattr(kernel, "py_func", kernel)  # decorated with numba's njit
            if inspect.isfunction(kernel):
                takes = kernel.__code__.co_argcount
                self._count(node, func.id, len(node.args) == takes, str(takes))
                name = ast.Name(self.kernel_name(func.id, kernel), ast.Load())
                return ast.Call(name, self._arguments(node), [])
        called = ast.unparse(func)
        hint = nearest(called, [*BUILTIN_FUNCTIONS, *(n for n, f in self.globals.items() if inspect.isfunction(f))])
        raise self.refuse(
            node,
            "only math.*, abs, min, max, tables and plain functions can be called: write what it does with these"
            f"{hint}",
        )

    def _math_call(self, node: ast.Call, func: ast.Attribute) -> ast.expr:
        if func.attr not in ARITY:
            raise self.refuse(node, f"math.{func.attr} is not available in equations: use one of {', '.join(ARITY)}")
        takes = ARITY[func.attr]
        self._count(node, f"math.{func.attr}", len(node.args) == takes, str(takes))
        return ast.Call(func, self._arguments(node), [])

    def _arguments(self, node: ast.Call) -> list[ast.expr]:
        return [self.visit(a) for a in node.args]

    def _count(self, node: ast.Call, name: str, fits: bool, wanted: str) -> None:
        if not fits:
            given = f"{name} is called with {len(node.args)} argument{'' if len(node.args) == 1 else 's'}"
            raise self.refuse(node, f"{given}, and must have {wanted}")

    def kernel_name(self, name: str, kernel: Callable[..., Any]) -> str:
        """Return the name of a called function in the generated source; different functions get different names."""
        file = kernel.__code__.co_filename.replace("\\", "/").rpartition("/")[2].removesuffix(".py")
        base = f"f_{re.sub(r'[^0-9a-zA-Z]', '_', file)}_{name}"
        unique, count = base, 1
        while self.scope.kernels.get(unique, kernel) is not kernel:
            count += 1
            unique = f"{base}_{count}"
        self.scope.kernels[unique] = kernel
        return unique

    def _curve(self, node: ast.expr) -> Table | None:
        """Return the table that ``self.<name>`` is, if it is one."""
        if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self"):
            return None
        item = self.scope.component.declarations.get(node.attr)
        return item if isinstance(item, Table) else None

    def table_call(self, name: str, table: Table, argument: ast.expr, slope: bool = False) -> ast.expr:
        """Return the call that evaluates a table, or its slope."""
        if table.interpolation == "linear":
            kernel = tables.linear_rate if slope else tables.linear
        else:
            kernel = tables.cubic_rate if slope else tables.cubic
        kernel_name = f"k_tables_{kernel.__name__}"
        self.scope.kernels[kernel_name] = kernel
        start, size = (ast.Name(variable(self.scope.name, name, what), ast.Load()) for what in ("_start", "_size"))
        return ast.Call(ast.Name(kernel_name, ast.Load()), [ast.Name("p", ast.Load()), start, size, argument], [])

    # ---------------------------------------------------------------- statements

    def _body(self, nodes: list[ast.stmt]) -> list[ast.stmt]:
        return [out for item in nodes for out in as_list(self.visit(item))]

    def visit_If(self, node: ast.If) -> Any:
        test = simplified(self.visit(node.test))
        if isinstance(test, ast.Constant):
            return self._body(node.body if test.value else node.orelse)
        self._decidable(node, test)
        return ast.If(test, self._body(node.body) or [ast.Pass()], self._body(node.orelse))

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        test = simplified(self.visit(node.test))
        if isinstance(test, ast.Constant):
            return self.visit(node.body if test.value else node.orelse)
        self._decidable(node, test)
        return ast.IfExp(test, self.visit(node.body), self.visit(node.orelse))

    def _decidable(self, node: ast.AST, test: ast.expr) -> None:
        for inner in ast.walk(test):
            if isinstance(inner, ast.In | ast.NotIn | ast.Is | ast.IsNot):
                raise self.refuse(node, "'in' and 'is' can only compare options")
            if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                raise self.refuse(node, f"'{inner.value}' can only be compared with an option")

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        for value in node.values:
            if isinstance(value, ast.Constant) and not isinstance(value.value, bool):
                raise self.refuse(node, "'and' and 'or' join conditions, not numbers")
        return ast.BoolOp(node.op, [self.visit(v) for v in node.values])

    def visit_For(self, node: ast.For) -> ast.stmt:
        call = node.iter
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name) or call.func.id != "range":
            raise self.refuse(node, "a loop must be 'for i in range(...)' with a fixed count")
        if node.orelse or not isinstance(node.target, ast.Name):
            raise self.refuse(node, "a loop counts one name and has no 'else'")
        bounds = [self.visit(a) for a in call.args]
        if not 1 <= len(bounds) <= 3 or not all(_whole(b) for b in bounds):
            raise self.refuse(node, "the count of a loop must be a whole number or an option")
        count = ast.Call(ast.Name("range", ast.Load()), bounds, [])
        return ast.For(self.visit(node.target), count, self._body(node.body) or [ast.Pass()], [])

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:
        target = node.targets[0]
        if len(node.targets) != 1:
            raise self.refuse(node, "assign to one name at a time")
        if isinstance(target, ast.Tuple):
            names = [isinstance(t, ast.Name | ast.Attribute) for t in target.elts]
            if not all(names) or not isinstance(node.value, ast.Tuple | ast.Call):
                raise self.refuse(node, "several names take the results of one call, or as many expressions")
            if isinstance(node.value, ast.Tuple) and len(node.value.elts) != len(names):
                raise self.refuse(node, f"{len(node.value.elts)} expressions for {len(names)} names")
        elif isinstance(node.value, ast.Tuple):
            raise self.refuse(node, "one name cannot hold several values")
        if isinstance(node.value, ast.BoolOp) and not all(map(_is_condition, node.value.values)):
            raise self.refuse(node, "'and' and 'or' join conditions, not numbers: use 'a if … else b'")
        value = self.visit(node.value)
        return ast.Assign([self.visit(target)], value)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        if not isinstance(node.target, ast.Name | ast.Attribute):
            raise self.refuse(node, "assign to one name at a time")
        before = expression(ast.unparse(node.target))
        whole = ast.Assign([node.target], ast.BinOp(before, node.op, node.value))
        for inner in ast.walk(before):
            ast.copy_location(inner, node)
        return self.visit_Assign(ast.fix_missing_locations(ast.copy_location(whole, node)))

    def visit_Expr(self, node: ast.Expr) -> Any:
        if isinstance(node.value, ast.Constant):
            return None  # a docstring
        raise self.refuse(node, "a line must assign something: write name = … or remove it")

    def generic_visit(self, node: ast.AST) -> Any:
        if not isinstance(node, _ALLOWED):
            kind = type(node).__name__
            raise self.refuse(node, f"{_PLAIN.get(kind, kind)} is outside the subset for equations: {_INSTEAD}")
        if isinstance(node, ast.BinOp) and not isinstance(node.op, _OPERATORS):
            raise self.refuse(node, f"this operator is outside the subset for equations: {_INSTEAD}")
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Invert):
            raise self.refuse(node, f"'~' is outside the subset for equations: {_INSTEAD}")
        return super().generic_visit(node)


class _Real(ast.NodeTransformer):
    """Turn whole numbers into real ones: compiled 1/2·k and 2**-1 of whole numbers differ from Python's.

    Exponents stay whole, because a whole power of a negative number is defined, and so do the bounds of loops.
    """

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        whole = isinstance(node.value, int) and not isinstance(node.value, bool)
        return ast.Constant(float(node.value)) if whole else node  # type: ignore[arg-type]

    def visit_BinOp(self, node: ast.BinOp) -> ast.BinOp:
        keeps = isinstance(node.op, ast.Pow) and _whole(node.right)
        return ast.BinOp(self.visit(node.left), node.op, node.right if keeps else self.visit(node.right))

    def visit_For(self, node: ast.For) -> ast.For:
        return ast.For(node.target, node.iter, [self.visit(n) for n in node.body], [])


def as_list(item: Any) -> list[Any]:
    """Return what a visitor returned as a list of statements."""
    if item is None or isinstance(item, ast.Pass):
        return []
    return item if isinstance(item, list) else [item]


def _whole(node: ast.expr) -> bool:
    inner = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
    return isinstance(inner, ast.Constant) and isinstance(inner.value, int) and not isinstance(inner.value, bool)


def _is_condition(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.Not)
    return isinstance(node, ast.Compare | ast.BoolOp) or (
        isinstance(node, ast.Constant) and isinstance(node.value, bool)
    )


def simplified(test: ast.expr) -> ast.expr:
    """Return a condition without the parts that options decide before the simulation.

    Examples
    --------
    >>> ast.unparse(simplified(ast.parse("2 > 1 and x > 0", mode="eval").body))
    'x > 0'
    """
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        inner = simplified(test.operand)
        return ast.Constant(not inner.value) if isinstance(inner, ast.Constant) else ast.UnaryOp(test.op, inner)
    if isinstance(test, ast.BoolOp):
        decides = isinstance(test.op, ast.Or)  # the value that decides the whole
        left: list[ast.expr] = []
        for value in map(simplified, test.values):
            if not isinstance(value, ast.Constant):
                left.append(value)
            elif bool(value.value) is decides:
                return ast.Constant(decides)
        if not left:
            return ast.Constant(not decides)
        return left[0] if len(left) == 1 else ast.BoolOp(test.op, left)
    if isinstance(test, ast.Compare):
        try:
            values = [ast.literal_eval(v) for v in (test.left, *test.comparators)]
        except ValueError:
            return test
        pairs = zip(values, test.ops, values[1:], strict=False)
        return ast.Constant(all(_COMPARISONS[type(op)](a, b) for a, op, b in pairs))
    try:
        return ast.Constant(bool(ast.literal_eval(test)))
    except ValueError:
        return test
