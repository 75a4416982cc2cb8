"""Statements, and whole functions, as LLVM text."""

from __future__ import annotations

import ast

from multibody.compile.emitter.expressions import Expressions
from multibody.compile.emitter.inference import store_counts
from multibody.compile.emitter.kinds import INT, NOTHING, TRUTH, Array, Kind, Lanes, Truths, Value, llvm_type

__all__ = ["FunctionWriter"]


class FunctionWriter(Expressions):
    """Writes one function for given kinds of arguments; see `Expressions`."""

    def write(self, symbol: str, linkage: str, words: str = "") -> str:
        """Return the function's text; ``words`` are further attributes."""
        node = self.kinds.node
        body = [n for n in node.body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))]
        counts = store_counts(body)
        parameters = []
        for k, argument in enumerate(node.args.args):
            kind, name = self.kinds.of[argument.arg], f"%a{k}"
            parameters.append(f"{llvm_type(kind)} {name}")
            shape: tuple[str, ...] = ()
            if isinstance(kind, Array):
                shape = tuple(f"{name}s{d}" for d in range(kind.dimensions))
                parameters += [f"i64 {s}" for s in shape]
            value = Value(kind, name, shape)
            if counts.get(argument.arg):
                self._slot(argument.arg, kind)
                self._store(argument.arg, value, node)
            else:
                self.values[argument.arg] = value
        for name, count in counts.items():
            if count > 1 and name not in self.slots:
                self._slot(name, self.kinds.of[name])
        self._loops: list[tuple[str, str]] = []
        if not self._block(body):
            self._return(None, node)
        returns = llvm_type(self.kinds.returns)
        head = f"define {linkage} {returns} @{symbol}({', '.join(parameters)}) nounwind {words}{{"
        allocas = [f"  {s.name} = alloca {llvm_type(s.kind)}" for s in self.slots.values()]
        return "\n".join([head, "entry:", *allocas, *self.lines, "}"])

    def _slot(self, name: str, kind: Kind) -> None:
        self.slots[name] = Value(kind, f"%m{len(self.slots)}")

    def _store(self, name: str, value: Value, node: ast.AST) -> None:
        slot = self.slots.get(name)
        if slot is None:
            self.values[name] = self.to(value, self.kinds.of[name], node)
            return
        value = self.to(value, slot.kind, node)
        if self._mask is not None:
            before = self.emit(slot.kind, f"load {llvm_type(slot.kind)}, ptr {slot.name}")
            value = self._masked(value, before, node)
        self.lines.append(f"  store {llvm_type(slot.kind)} {value.name}, ptr {slot.name}")

    def _masked(self, value: Value, before: Value, node: ast.AST) -> Value:
        """Return a value in the lanes that count, and what was there before in the others."""
        assert self._mask is not None
        if not isinstance(value.kind, Lanes | Truths):
            raise self.refuse(node, f"{value.kind} assigned under a condition that differs from lane to lane")
        return self.select(self._mask, value, before, value.kind)

    def _assign(self, target: ast.expr, value: Value, node: ast.AST) -> None:
        if isinstance(target, ast.Name):
            self._store(target.id, value, node)
        elif isinstance(target, ast.Subscript):
            place = self.place(target)
            value = self.to(value, place.kind, node)
            if self._mask is not None:
                load = f"load {llvm_type(place.kind)}, ptr {place.name}{self.access(place.kind)}"
                value = self._masked(value, self.emit(place.kind, load), node)
            self.lines.append(
                f"  store {llvm_type(place.kind)} {value.name}, ptr {place.name}{self.access(place.kind)}"
            )
        else:
            raise self.refuse(node, "only names and elements can be assigned")

    def _block(self, nodes: list[ast.stmt]) -> bool:
        """Write statements; return whether they always leave (return, break, continue)."""
        return any(self._statement(node) for node in nodes)

    def _statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                if isinstance(value, ast.Tuple):
                    parts = [self.value(v) for v in value.elts]
                else:
                    parts = self.parts(self.value(value), len(targets))
                for target, part in zip(targets, parts, strict=True):
                    self._assign(target, part, node)
            case ast.Assign(targets=targets, value=value):
                result = self.value(value)
                for target in targets:
                    self._assign(target, result, node)
            case ast.AugAssign(target=target, op=op, value=value):
                reading = ast.copy_location(_read(target), node)
                self._assign(target, self.arithmetic(op, self.value(reading), self.value(value), node), node)
            case ast.If():
                return self._if(node)
            case ast.For():
                self._for(node)
            case ast.While():
                self._while(node)
            case ast.Return(value=value):
                self._everywhere(node)
                self._return(value, node)
                return True
            case ast.Break() | ast.Continue():
                self._everywhere(node)
                self.jump(self._loops[-1][isinstance(node, ast.Continue)])
                return True
            case ast.Expr(value=value):
                if not isinstance(value, ast.Constant):
                    self.value(value)
            case ast.Pass():
                pass
            case _:
                raise self.refuse(node, f"{type(node).__name__} is outside the subset")
        return False

    def _everywhere(self, node: ast.AST) -> None:
        if self._mask is not None:
            raise self.refuse(node, "some lanes would leave and others not")

    def _return(self, value: ast.expr | None, node: ast.AST) -> None:
        kind = self.kinds.returns
        if kind == NOTHING:
            self.lines.append("  ret void")
        elif value is None:
            self.lines.append("  unreachable")  # every path has returned
        else:
            result = self.to(self.value(value), kind, node)
            self.lines.append(f"  ret {llvm_type(kind)} {result.name}")

    def _if(self, node: ast.If) -> bool:
        test = self.truth(node.test)
        if isinstance(test.kind, Truths):
            return self._if_in_lanes(test, node)
        yes, no, end = self.fresh("yes"), self.fresh("no"), self.fresh("end")
        self.lines.append(f"  br i1 {test.name}, label %{yes}, label %{no if node.orelse else end}")
        leaves = True
        for label, body in ((yes, node.body), (no, node.orelse)):
            if not body:
                leaves = False
                continue
            self.begin(label)
            if not self._block(body):
                self.jump(end)
                leaves = False
        if not leaves:
            self.begin(end)
        return leaves

    def _if_in_lanes(self, test: Value, node: ast.If) -> bool:
        """Write both branches, each of which counts in its lanes only."""
        around = self._mask
        opposite = self.both(test, Value(TRUTH, "true"), "xor", node)
        for holds, body in ((test, node.body), (opposite, node.orelse)):
            if body:
                self._mask = holds if around is None else self.both(around, holds, "and", node)
                self._block(body)
        self._mask = around
        return False

    def _for(self, node: ast.For) -> None:
        if self._mask is not None:
            raise self.refuse(node, "what some lanes would go round all of them would: too dear")
        call = node.iter
        words = ("range", "independent")
        if (
            not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in words)
            or node.orelse
        ):
            raise self.refuse(node, "a loop goes over range(...)")
        noted = call.func.id == "independent"
        outer, end_note = self._access, ""
        bounds = [self.to(self.value(a), INT, node) for a in call.args]
        start, stop = (Value(INT, "0"), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = bounds[2] if len(bounds) == 3 else Value(INT, "1", whole=1)
        if not step.whole or not isinstance(node.target, ast.Name):
            raise self.refuse(node, "the step of a loop is a number")
        counter, before = f"%{self.fresh('c')}", self.label
        head, body, after, end = (self.fresh(w) for w in ("head", "body", "after", "end"))
        self.jump(head)
        self.begin(head)
        following = f"{counter}n"
        self.lines.append(f"  {counter} = phi i64 [ {start.name}, %{before} ], [ {following}, %{after} ]")
        test = self.emit(TRUTH, f"icmp {'slt' if step.whole > 0 else 'sgt'} i64 {counter}, {stop.name}")
        self.lines.append(f"  br i1 {test.name}, label %{body}, label %{end}")
        self.begin(body)
        self._store(node.target.id, Value(INT, counter), node)
        self._loops.append((end, after))
        if noted:
            self._access, end_note = self.program.independent_loop()
        if not self._block(node.body):
            self.jump(after)
        self._access = outer
        self._loops.pop()
        self.begin(after)
        self.lines.append(f"  {following} = add nsw i64 {counter}, {step.name}")
        self.lines.append(f"  br label %{head}{end_note}")
        self.begin(end)

    def _while(self, node: ast.While) -> None:
        if node.orelse:
            raise self.refuse(node, "a loop has no 'else'")
        head, body, end = (self.fresh(w) for w in ("head", "body", "end"))
        self.jump(head)
        self.begin(head)
        test = self.truth(node.test)
        if test.kind != TRUTH:
            raise self.refuse(node, "some lanes would go on and others not")
        self.lines.append(f"  br i1 {test.name}, label %{body}, label %{end}")
        self.begin(body)
        self._loops.append((end, head))
        if not self._block(node.body):
            self.jump(head)
        self._loops.pop()
        self.begin(end)


def _read(target: ast.expr) -> ast.expr:
    if isinstance(target, ast.Name):
        return ast.Name(target.id, ast.Load())
    if isinstance(target, ast.Subscript):
        return ast.Subscript(target.value, target.slice, ast.Load())
    return target
