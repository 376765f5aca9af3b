"""Specialise kernels for the sizes of a model: loops of known length written out, known indices as numbers.

A card keeps in registers what is addressed by known indices; an array that is indexed by a variable lies in memory, and
of a filter's step more time goes into memory than into arithmetic. On a processor all that is needed lies in the first
cache, and loops are as good. What is computed, and in which order, stays as it is written.

This is a partial evaluator (Jones, Gomard and Sestoft 1993) for the Python that kernels consist of: of each value it
knows a number, the shape of an array, the parts of a tuple, or nothing; a function is copied for what is known of its
arguments.
"""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

from harness.common.errors import ModelError
from harness.cuda.known import Knowledge, Known, Number, Parts, Shape

LIMIT = 30_000
"""Nodes of syntax that loops within each other may be written out to; longer ones stay loops."""

LONGEST = 16
"""Passes of a loop that is written out: a covariance of more states has no room in the registers of a thread."""


class Specialised:
    """A module of kernels in the making, each function copied for what is known of its arguments.

    Args:
        module: Generated source for cards, imported.
    """

    def __init__(self, module: ModuleType) -> None:
        self._functions: dict[tuple[str, str], tuple[ast.FunctionDef, ModuleType]] = {}
        self._sizes: dict[tuple[str, str], int] = {}
        self._sources: set[str] = set()
        self._copies: dict[Any, tuple[str, Known]] = {}
        self.imports: dict[str, str] = {}
        self.written: list[str] = []
        self.tables: list[np.ndarray[Any, Any]] = [np.empty(0)]
        self._module = module

    def function_of(self, name: str, home: ModuleType) -> tuple[ast.FunctionDef, ModuleType] | None:
        """Return the source of a function that a name means in a module, if it is one of those for cards."""
        made = vars(home).get(name)
        function = getattr(made, "py_func", getattr(made, "fn", None))
        owner = None if function is None else inspect.getmodule(function)
        if owner is None or function is None or not hasattr(owner, "WRITTEN_FOR_CARDS"):
            return None
        if owner.__name__ not in self._sources:
            self._sources.add(owner.__name__)
            for node in ast.parse(inspect.getsource(owner)).body:
                if isinstance(node, ast.FunctionDef):
                    self._functions[owner.__name__, node.name] = node, owner
        return self._functions.get((owner.__name__, function.__name__))

    def size(self, node: ast.FunctionDef, home: ModuleType) -> int:
        """Return the nodes of a function and of those it calls."""
        key = home.__name__, node.name
        if key not in self._sizes:
            self._sizes[key] = 0
            self._sizes[key] = self.nodes(node.body, home)
        return self._sizes[key]

    def nodes(self, body: Sequence[ast.AST], home: ModuleType) -> int:
        """Return the nodes of statements and of the functions they call."""
        total = 0
        for node in (n for statement in body for n in ast.walk(statement)):
            total += 1
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                function = self.function_of(node.func.id, home)
                total += self.size(*function) if function else 0
        return total

    def copy_of(self, node: ast.FunctionDef, home: ModuleType, arguments: tuple[Known, ...]) -> tuple[str, Known]:
        """Return the name of the copy of a function for what is known of its arguments, and what it returns."""
        key = home.__name__, node.name, arguments
        if key not in self._copies:
            name = f"{node.name}_{len(self._copies)}" if arguments else node.name
            self._copies[key] = name, None
            made = _Copy(self, home, dict(zip((a.arg for a in node.args.args), arguments, strict=False)))
            body = made.statements(node.body)
            whole = copy.deepcopy(node)
            whole.name, whole.body = name, body or [ast.Pass()]
            results = [n.value for statement in body for n in ast.walk(statement) if isinstance(n, ast.Return)]
            arrays = isinstance(made.returned(), (Shape, Parts))
            hands_over = arrays or any(isinstance(r, ast.Attribute) for r in results)
            whole.decorator_list = [ast.Name("inlined" if hands_over else "forced", ast.Load())]
            self.written.append(ast.unparse(ast.fix_missing_locations(whole)))
            self._copies[key] = name, made.returned()
        return self._copies[key]

    def need(self, name: str, home: ModuleType) -> None:
        """Import what a name means in a module, if it means anything there."""
        if name not in vars(home):
            return
        value = vars(home)[name]
        if isinstance(value, ModuleType):
            line = f"import {value.__name__} as {name}"
        else:
            owner = getattr(value, "__module__", None) or home.__name__
            attribute = getattr(value, "__name__", name)
            owned = vars(importlib.import_module(owner)).get(attribute) is value
            place, what = (owner, attribute) if owned else (home.__name__, name)
            line = f"from {place} import {what} as {name}"
        if self.imports.setdefault(name, line) != line:
            raise ModelError(
                f"{home.__name__}: '{name}' means something else elsewhere ({self.imports[name]}); rename it"
            )


class _Copy(Knowledge, ast.NodeTransformer):
    """Writes the statements of one copy of a function."""

    def __init__(self, whole: Specialised, home: ModuleType, arguments: dict[str, Known]) -> None:
        super().__init__(whole, home, arguments)
        self._nodes = whole.nodes
        self._returned: list[Known] = []
        self._times = 1

    def returned(self) -> Known:
        """Return what is known of the result: nothing where there are several."""
        return self._returned[0] if len(set(self._returned)) == 1 else None

    def statements(self, body: Sequence[ast.stmt]) -> list[ast.stmt]:
        """Return statements rewritten; those behind a return or break that is certain are left out."""
        written: list[ast.stmt] = []
        for statement in body:
            written += self._statement(copy.deepcopy(statement))
            if written and isinstance(written[-1], (ast.Return, ast.Break, ast.Continue)):
                break
        return written

    def _statement(self, node: ast.stmt) -> list[ast.stmt]:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return []
        if isinstance(node, ast.If):
            return self._if(node)
        if isinstance(node, ast.For):
            return self._for(node)
        if isinstance(node, ast.While):
            return self._loop(node, node.body)
        if isinstance(node, ast.Assign) and self._is_idle(node):
            return [ast.Expr(self.visit(node.value))]
        if isinstance(node, ast.Assign):
            value = self.know(node.value)
            node.value = self.visit(node.value)
            for target in node.targets:
                self._assign(target, value)
            node.targets = [self._target(t) for t in node.targets]
            return [node]
        if isinstance(node, ast.AugAssign):
            node.value = self.visit(node.value)
            if isinstance(node.target, ast.Name):
                self._known[node.target.id] = None
            else:
                node.target = self._target(node.target)
            return [node]
        if isinstance(node, ast.Return):
            self._returned.append(self.know(node.value) if node.value else None)
        return [self.generic_visit(node)]  # type: ignore[list-item]

    def _is_idle(self, node: ast.Assign) -> bool:
        """Return whether an assignment leaves its names as they are: its function returns what it is given."""
        call, target = node.value, node.targets[0]
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name) or not isinstance(target, ast.Tuple):
            return False
        function = self._whole.function_of(call.func.id, self._home)
        if not function or [ast.unparse(e) for e in target.elts] != [ast.unparse(a) for a in call.args]:
            return False
        last = function[0].body[-1]
        given = ast.Tuple([ast.Name(a.arg, ast.Load()) for a in function[0].args.args], ast.Load())
        return isinstance(last, ast.Return) and last.value is not None and ast.unparse(last.value) == ast.unparse(given)

    def _target(self, node: Any) -> Any:
        """Write what is assigned to: names stay, indices are rewritten."""
        if isinstance(node, ast.Tuple):
            node.elts = [self._target(e) for e in node.elts]
            return node
        return node if isinstance(node, ast.Name) else self.generic_visit(node)

    def _assign(self, target: ast.expr, value: Known) -> None:
        if isinstance(target, ast.Name):
            self._known[target.id] = value
        elif isinstance(target, ast.Tuple):
            parts = value.parts if isinstance(value, Parts) else (None,) * len(target.elts)
            for each, part in zip(target.elts, parts, strict=True):
                self._assign(each, part)

    def _if(self, node: ast.If) -> list[ast.stmt]:
        test = self.know(node.test)
        if isinstance(test, Number):
            # a function whose result is known is called for what else it does
            called = [ast.Expr(self.visit(node.test))] if isinstance(node.test, ast.Call) else []
            return [*called, *self.statements(node.body if test.value else node.orelse)]
        node.test = self.visit(node.test)
        before = dict(self._known)
        node.body = self.statements(node.body) or [ast.Pass()]
        self._known, there = before, self._known
        node.orelse = self.statements(node.orelse)
        self._known = {n: k for n, k in self._known.items() if n in there and there[n] == k}
        return [node]

    def _for(self, node: ast.For) -> list[ast.stmt]:
        bounds = [self.know(a) for a in node.iter.args] if isinstance(node.iter, ast.Call) else [None]
        if isinstance(node.target, ast.Name) and bounds and all(isinstance(b, Number) for b in bounds):
            steps = range(*(b.value for b in bounds))  # type: ignore[union-attr]
            cost = self._times * len(steps) * self._nodes(node.body, self._home)
            if cost <= LIMIT and len(steps) <= LONGEST:
                written_out = self._written_out(node, steps)
                if written_out is not None:
                    return written_out
        node.iter = self.visit(node.iter)
        return self._loop(node, node.body)

    def _written_out(self, node: ast.For, steps: range) -> list[ast.stmt] | None:
        """Return the passes of a loop one behind the other; nothing if it may be left by an unknown condition."""
        before, times = dict(self._known), self._times
        written: list[ast.stmt] = []
        self._times *= max(1, len(steps))
        breaks = False
        for value in steps:
            assert isinstance(node.target, ast.Name)
            self._known[node.target.id] = Number(value)
            body = self.statements(node.body)
            if body and isinstance(body[-1], ast.Break):
                body, breaks = body[:-1], True
            elif body and isinstance(body[-1], ast.Continue):
                body = body[:-1]
            if _leaves(body):
                self._known, self._times = before, times
                return None
            written += body
            if breaks:
                break
        self._times = times
        return written

    def _loop(self, node: Any, body: Sequence[ast.stmt]) -> list[ast.stmt]:
        """Write a loop that stays one: what its body changes is known only if it is the same in each pass."""
        names = {n.id for s in body for n in ast.walk(s) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        if isinstance(node, ast.For) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
            self._known[node.target.id] = None
        while True:
            before = dict(self._known)
            written = self.statements(body)
            changed = [n for n in names if before.get(n) is not None and self._known.get(n) != before.get(n)]
            if not changed:
                break
            self._known = before | dict.fromkeys(changed)
        node.body = written or [ast.Pass()]
        if isinstance(node, ast.While):
            node.test = self.visit(node.test)
        self._known |= {n: None for n in names if before.get(n) is None}
        return [node]

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Write a known number, or import what the name means."""
        if isinstance(node.ctx, ast.Load):
            value = self.know(node)
            if isinstance(value, Number) and isinstance(value.value, (bool, int, float)):
                return ast.Constant(value.value)
            if node.id not in self._known:
                self._whole.need(node.id, self._home)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """Write a known number of a table."""
        value = self.know(node) if isinstance(node.ctx, ast.Load) else None
        return ast.Constant(value.value) if isinstance(value, Number) else self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """Write the value that is taken, where that is known."""
        test = self.know(node.test)
        if isinstance(test, Number):
            return self.visit(node.body if test.value else node.orelse)
        return self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Write a known whole number; others are computed where they always were."""
        value = self.know(node)
        if isinstance(value, Number) and isinstance(value.value, (bool, int)):
            return ast.Constant(value.value)
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Write a known truth value."""
        value = self.know(node)
        return ast.Constant(value.value) if isinstance(value, Number) else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Call the copy of a function for what is known of its arguments."""
        if isinstance(node.func, ast.Name) and node.func.id not in self._known:
            function = self._whole.function_of(node.func.id, self._home)
            if function:
                name, _ = self._whole.copy_of(*function, tuple(self.know(a) for a in node.args))
                return ast.Call(ast.Name(name, ast.Load()), [self.visit(a) for a in node.args], [])
        return self.generic_visit(node)


def _leaves(body: Sequence[ast.stmt]) -> bool:
    """Return whether statements may leave the loop that they stand in."""
    for statement in body:
        if isinstance(statement, (ast.Break, ast.Continue)):
            return True
        if isinstance(statement, ast.If) and (_leaves(statement.body) or _leaves(statement.orelse)):
            return True
    return False


def specialised(module: ModuleType, entry: str) -> str:
    """Return the source of a module with one function of another, and all it calls, specialised."""
    whole = Specialised(module)
    function = whole.function_of(entry, module)
    assert function is not None
    whole.copy_of(*function, ())
    lines = [
        "from __future__ import annotations",
        "from harness.cuda.compiling import forced, inlined",
        "import numba.cuda as cuda",
        "from numba import float64",
        *(line for name, line in sorted(whole.imports.items()) if name not in ("cuda", "float64")),
    ]
    return "\n".join(lines) + "\n\n\n" + "\n\n\n".join(whole.written) + "\n"
