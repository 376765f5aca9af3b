"""What is known of a value before a kernel runs: a number, the shape of an array, the parts of a tuple, or nothing."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True)
class Number:
    """A known number."""

    value: Any


@dataclass(frozen=True)
class Shape:
    """An array of which the shape is known; of a table the numbers in it as well."""

    sizes: tuple[int | None, ...]
    table: int = 0  # among those of the whole: what is known has to be hashed


@dataclass(frozen=True)
class Parts:
    """A tuple, with the names of its fields if it has some."""

    parts: tuple[Known, ...]
    fields: tuple[str, ...] = ()


Known = Number | Shape | Parts | None

_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip

_PASS_ON = ("borrowed",)
"""Functions that return what they are given."""


class Functions(Protocol):
    """Functions that may be copied; see ``harness.cuda.specialise.Specialised``."""

    tables: list[np.ndarray[Any, Any]]

    def function_of(self, name: str, home: ModuleType) -> tuple[ast.FunctionDef, ModuleType] | None:
        """Return the source of a function."""

    def copy_of(self, node: ast.FunctionDef, home: ModuleType, arguments: tuple[Known, ...]) -> tuple[str, Known]:
        """Return the name of a copy and what is known of its result."""

    def need(self, name: str, home: ModuleType) -> None:
        """Import a name."""


class Knowledge:
    """What is known of the expressions of a function.

    Args:
        whole: The functions it may call.
        home: The module that it stands in.
        arguments: What is known of its arguments.
    """

    def __init__(self, whole: Functions, home: ModuleType, arguments: dict[str, Known]) -> None:
        self._whole, self._home, self._known = whole, home, arguments

    def know(self, node: ast.expr) -> Known:
        """Return what is known of an expression."""
        method = getattr(self, f"_know_{type(node).__name__}", None)
        return method(node) if method else None

    def _know_Constant(self, node: ast.Constant) -> Known:
        return Number(node.value) if isinstance(node.value, (bool, int, float)) else None

    def _know_Name(self, node: ast.Name) -> Known:
        if node.id in self._known:
            return self._known[node.id]
        value = vars(self._home).get(node.id)
        if isinstance(value, (bool, int, float)):
            return Number(value)
        if isinstance(value, np.ndarray):
            self._whole.need(node.id, self._home)
            for place, table in enumerate(self._whole.tables):
                if table is value:
                    return Shape(value.shape, place)
            self._whole.tables.append(value)
            return Shape(value.shape, len(self._whole.tables) - 1)
        return None

    def _know_Tuple(self, node: ast.Tuple) -> Known:
        return Parts(tuple(self.know(e) for e in node.elts))

    def _know_BinOp(self, node: ast.BinOp) -> Known:
        a, b, op = self.know(node.left), self.know(node.right), _OPERATORS.get(type(node.op))
        return Number(op(a.value, b.value)) if op and isinstance(a, Number) and isinstance(b, Number) else None

    def _know_UnaryOp(self, node: ast.UnaryOp) -> Known:
        a = self.know(node.operand)
        return Number(-a.value) if isinstance(a, Number) and isinstance(node.op, ast.USub) else None

    def _know_Compare(self, node: ast.Compare) -> Known:
        values = [self.know(each) for each in (node.left, *node.comparators)]
        if not all(isinstance(v, Number) for v in values):
            return None
        numbers = [v.value for v in values if isinstance(v, Number)]
        pairs = zip(node.ops, numbers, numbers[1:], strict=False)
        return Number(all(_OPERATORS[type(op)](a, b) for op, a, b in pairs))

    def _know_BoolOp(self, node: ast.BoolOp) -> Known:
        values = [self.know(v) for v in node.values]
        decided = isinstance(node.op, ast.Or)
        if any(isinstance(v, Number) and bool(v.value) == decided for v in values[:1]):
            return Number(decided)
        if all(isinstance(v, Number) for v in values):
            every = [bool(v.value) for v in values if isinstance(v, Number)]
            return Number(any(every) if decided else all(every))
        return None

    def _know_IfExp(self, node: ast.IfExp) -> Known:
        test = self.know(node.test)
        return self.know(node.body if test.value else node.orelse) if isinstance(test, Number) else None

    def _know_Attribute(self, node: ast.Attribute) -> Known:
        value = self.know(node.value)
        if isinstance(value, Shape) and node.attr == "shape":
            return Parts(tuple(None if n is None else Number(n) for n in value.sizes))
        if isinstance(value, Shape) and node.attr == "ndim":
            return Number(len(value.sizes))
        if isinstance(value, Parts) and node.attr in value.fields:
            return value.parts[value.fields.index(node.attr)]
        return None

    def _know_Subscript(self, node: ast.Subscript) -> Known:
        value = self.know(node.value)
        if isinstance(value, Parts):
            index = self.know(node.slice)
            return value.parts[index.value] if isinstance(index, Number) else None
        if not isinstance(value, Shape):
            return None
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if value.table:
            places = [self.know(i) for i in indices]
            if len(places) == len(value.sizes) and all(isinstance(p, Number) for p in places):
                return Number(
                    self._whole.tables[value.table][tuple(p.value for p in places if isinstance(p, Number))].item()
                )
            return None
        sizes = list(value.sizes)
        for axis in reversed(range(len(indices))):
            cut = indices[axis]
            if not isinstance(cut, ast.Slice):
                del sizes[axis]
                continue
            first = self.know(cut.lower) if cut.lower else Number(0)
            last = self.know(cut.upper) if cut.upper else (None if sizes[axis] is None else Number(sizes[axis]))
            both = isinstance(first, Number) and isinstance(last, Number) and cut.step is None
            sizes[axis] = last.value - first.value if both else None  # type: ignore[union-attr]
        return Shape(tuple(sizes))

    def _know_Call(self, node: ast.Call) -> Known:
        name = ast.unparse(node.func)
        if name == "cuda.local.array":
            return Shape(tuple(ast.literal_eval(node.args[0])))
        if name in _PASS_ON:
            values = [self.know(a) for a in node.args]
            return values[0] if len(values) == 1 else Parts(tuple(values))
        if name in ("reshaped", "shaped"):
            sizes = self.know(node.args[1])
            if isinstance(sizes, Parts):
                return Shape(tuple((p.value or None) if isinstance(p, Number) else None for p in sizes.parts))
            return None
        if name in ("max", "min", "int"):
            given = [self.know(a) for a in node.args]
            if all(isinstance(g, Number) for g in given):
                return Number({"max": max, "min": min, "int": int}[name](*(g.value for g in given)))  # type: ignore[operator, union-attr]
            return None
        if not isinstance(node.func, ast.Name):
            return None
        made = vars(self._home).get(node.func.id)
        if isinstance(made, type) and issubclass(made, tuple):
            return Parts(tuple(self.know(a) for a in node.args), tuple(getattr(made, "_fields", ())))
        function = self._whole.function_of(node.func.id, self._home)
        return self._whole.copy_of(*function, tuple(self.know(a) for a in node.args))[1] if function else None
