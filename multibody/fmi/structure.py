"""On which states and inputs each rate and each output depends, read from the generated text."""

from __future__ import annotations

import ast

from multibody.base.parsing import parse

__all__ = ["dependencies"]

Sources = frozenset[tuple[str, int]]
_NOTHING: Sources = frozenset()


def dependencies(text: str, name: str, arrays: tuple[str, ...] = ("x", "u")) -> dict[int, Sources]:
    """Return for each element that a generated function writes the elements of its arguments that it depends on.

    Parameters
    ----------
    text : str
        Python source (see `multibody.compile.generate.Source`).
    name : str
        The function in it; its last argument is what is written.
    arrays : tuple of str
        The arguments that count.

    Returns
    -------
    dict
        ``{2: {("x", 0), ("u", 1)}}``: element 2 depends on ``x[0]`` and ``u[1]``.

    Examples
    --------
    >>> text = "def f(t, x, u, p, dx):\\n    a = u[0]\\n    b = 2.0 * x[1] + a\\n    dx[0] = b\\n    dx[1] = p[0]\\n"
    >>> {k: sorted(v) for k, v in dependencies(text, "f").items()}
    {0: [('u', 0), ('x', 1)], 1: []}
    """
    function = next(n for n in parse(text).body if isinstance(n, ast.FunctionDef) and n.name == name)
    reader = _Reader(arrays, function.args.args[-1].arg)
    reader.block(function.body, _NOTHING)
    return reader.written


class _Reader:
    """Walks through statements in order; what stands in a branch depends on its condition as well."""

    def __init__(self, arrays: tuple[str, ...], result: str) -> None:
        self.arrays, self.result = arrays, result
        self.known: dict[str, Sources] = {}
        self.written: dict[int, Sources] = {}

    def of(self, node: ast.AST) -> Sources:
        match node:
            case ast.Subscript(value=ast.Name(id=array), slice=ast.Constant(value=int(k))) if array in self.arrays:
                return frozenset({(array, k)})
            case ast.Name(id=name):
                return self.known.get(name, _NOTHING)
        return _NOTHING.union(*(self.of(child) for child in ast.iter_child_nodes(node)))

    def block(self, nodes: list[ast.stmt], condition: Sources) -> None:
        for node in nodes:
            match node:
                case ast.Assign(targets=targets, value=value):
                    sources = self.of(value) | condition
                    for target in targets:
                        self._assign(target, sources, bool(condition))
                case ast.AugAssign(target=target, value=value):
                    self._assign(target, self.of(value) | condition, True)
                case ast.If(test=test, body=body, orelse=orelse):
                    inside = condition | self.of(test)
                    before = dict(self.known)
                    self.block(body, inside)
                    after, self.known = self.known, before
                    self.block(orelse, inside)
                    for name, sources in after.items():
                        self.known[name] = self.known.get(name, _NOTHING) | sources
                case ast.For(body=body) | ast.While(body=body):
                    while True:  # what a turn leaves behind enters the next
                        before = dict(self.known)
                        self.block(body, condition)
                        for name, sources in before.items():
                            self.known[name] = self.known.get(name, _NOTHING) | sources
                        if self.known == before:
                            break

    def _assign(self, target: ast.expr, found: Sources, add: bool) -> None:
        match target:
            case ast.Tuple(elts=elts):
                for part in elts:
                    self._assign(part, found, add)
            case ast.Name(id=name):
                self.known[name] = found | (self.known.get(name, _NOTHING) if add else _NOTHING)
            case ast.Subscript(value=ast.Name(id=self.result), slice=ast.Constant(value=int(k))):
                self.written[k] = found | (self.written.get(k, _NOTHING) if add else _NOTHING)
