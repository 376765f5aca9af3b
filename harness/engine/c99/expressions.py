"""Expressions of a kernel as C."""

from __future__ import annotations

import ast
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any, Protocol

import numpy as np
from numba.core.dispatcher import Dispatcher

from harness.engine.c99 import values as v
from harness.engine.c99.statements import Statement
from harness.engine.c99.values import Array, NotPrintable, Parts, Scalar, Value, number
from harness.engine.simd import lanes, memory

PRIMITIVES = {
    id(getattr(lanes, name)): name
    for name in (
        "absolute", "any_of", "copysign", "exponent_of", "floor", "fma", "get", "is_nan", "power_of_two", "put",
        "select", "splat", "sqrt",
    )
} | {id(memory.borrowed): "borrowed", id(memory.retain): "retain"}  # fmt: skip
"""What is machine code in Python, by the object that kernels call."""

IN_C = {
    "absolute": ("real_abs", 1), "copysign": ("real_copysign", 2), "exponent_of": ("exponent_of", 1),
    "floor": ("real_floor", 1), "fma": ("real_fma", 3), "power_of_two": ("power_of_two", 1), "sqrt": ("real_sqrt", 1),
}  # fmt: skip
"""C function and number of arguments, of those that compute a number from numbers."""

_SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_RELATIONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


@dataclass(frozen=True)
class Printed:
    """A C function.

    Attributes:
        name: In C.
        kind: Of what it returns; ``None`` if it returns nothing.
        leaves: Places of the numbers and arrays in its arguments, flattened, that it takes.
        written: Those of them that it writes.
        acts: Whether it does anything but return a number.
        static: What it returns, where that is known when it is printed.
    """

    name: str
    kind: v.Kind | None
    leaves: tuple[int, ...]
    written: tuple[int, ...]
    acts: bool
    static: bool | int | float | None = None


class Program(Protocol):
    """What functions are printed into; see ``harness.engine.c99.program``."""

    def table(self, name: str, values: np.ndarray[Any, Any]) -> Array:
        """Return a table of constants."""

    def syntax(self, function: FunctionType) -> ast.FunctionDef:
        """Return the syntax of a function."""

    def function(self, function: FunctionType, arguments: Sequence[Value]) -> Printed | None:
        """Return a C function for such arguments; ``None`` where its statements stand where it is called."""

    def inside(self, function: FunctionType) -> AbstractContextManager[None]:
        """Say of what goes wrong in a function where it is."""


class Expressions(ABC):
    """Prints expressions of one function.

    Args:
        program: What the function is printed into.
        names: Global names of the module that it stands in.

    Attributes:
        variables: Values by the Python names of variables.
        statements: What has been printed.
    """

    def __init__(self, program: Program, names: Mapping[str, Any]) -> None:
        self._program, self._names = program, names
        self.variables: dict[str, Value] = {}
        self.statements: list[Statement] = []
        self._sure = True

    @abstractmethod
    def called(self, function: FunctionType, arguments: Sequence[Value]) -> Value:
        """Return the value of a call of a kernel function; see ``harness.engine.c99.functions``."""

    @abstractmethod
    def new_array(self, shape: tuple[int, ...], zero: bool, kind: v.Kind = "real") -> Array:
        """Return a new array; see ``harness.engine.c99.functions``."""

    @abstractmethod
    def keep_early(self, value: Value, mark: int) -> Value:
        """Read a value before the statements from a place on; see ``harness.engine.c99.functions``."""

    @abstractmethod
    def store(self, value: Scalar, place: Array) -> None:
        """Write a number; see ``harness.engine.c99.functions``."""

    def value(self, node: ast.expr) -> Value:
        """Return the value of an expression."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            raise NotPrintable(f"line {node.lineno} has '{ast.unparse(node)}', for which there is no C")
        result: Value = method(node)
        return result

    def values(self, nodes: Sequence[ast.expr]) -> list[Value]:
        """Return the values of expressions, each read before what the next ones do."""
        values: list[Value] = []
        for node in nodes:
            mark = len(self.statements)
            value = self.value(node)
            if len(self.statements) > mark:
                values = [self.keep_early(each, mark) for each in values[::-1]][::-1]
            values.append(value)
        return values

    def scalars(self, nodes: Sequence[ast.expr]) -> list[Scalar]:
        """Return the values of expressions that are numbers or truth values."""
        return [self._as_scalar(value, node) for value, node in zip(self.values(nodes), nodes, strict=True)]

    def scalar(self, node: ast.expr) -> Scalar:
        """Return the value of an expression that is a number or truth value."""
        return self._as_scalar(self.value(node), node)

    def _as_scalar(self, value: Value, node: ast.expr) -> Scalar:
        if isinstance(value, Array) and math.prod(value.shape) == 1 and len(value.shape) == 0:
            return value.element()
        if not isinstance(value, Scalar):
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' is no number")
        return value

    def size(self, node: ast.expr) -> int:
        """Return the value of an expression that is a whole number and known."""
        value = self.scalar(node)
        if not isinstance(value.static, int):
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' is not known before it runs")
        return int(value.static)

    def _array(self, node: ast.expr) -> Array:
        value = self.value(node)
        if not isinstance(value, Array):
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' is no array")
        return value

    def _of_Constant(self, node: ast.Constant) -> Value:
        if node.value is None:
            return None
        if isinstance(node.value, (bool, int, float)):
            return number(node.value)
        raise NotPrintable(f"line {node.lineno} has '{ast.unparse(node)}', which is no number")

    def _of_Name(self, node: ast.Name) -> Value:
        if node.id in self.variables:
            return self.variables[node.id]
        if node.id not in self._names:
            raise NotPrintable(f"line {node.lineno}: '{node.id}' has no value there")
        meaning = self._names[node.id]
        if node.id == "LANES" and meaning == lanes.LANES:
            return number(1)
        if isinstance(meaning, (bool, int, float)):
            return number(meaning)
        if isinstance(meaning, np.ndarray):
            return self._program.table(node.id, meaning)
        raise NotPrintable(f"line {node.lineno}: '{node.id}' is a {type(meaning).__name__}")

    def _of_Tuple(self, node: ast.Tuple) -> Value:
        return Parts(tuple(self.values(node.elts)))

    def _of_BinOp(self, node: ast.BinOp) -> Value:
        a, b = self.scalars([node.left, node.right])
        if type(node.op) in _SIGNS:
            return v.arithmetic(_SIGNS[type(node.op)], a, b)
        if isinstance(node.op, ast.BitAnd):
            return v.both(a, b)
        if isinstance(node.op, ast.BitOr):
            return v.either(a, b)
        if isinstance(node.op, ast.Mod):
            return v.remainder(a, b)
        if isinstance(node.op, ast.FloorDiv):
            return v.quotient(a, b)
        if isinstance(node.op, ast.Pow) and b.static == 0.5:
            return number(math.sqrt(a.static)) if a.static is not None else v.call("real_sqrt", "real", v.as_real(a))
        if isinstance(node.op, ast.Pow) and b.static == 2:
            return v.times(a, a)
        raise NotPrintable(f"line {node.lineno} has '{ast.unparse(node)}', for which there is no C")

    def _of_UnaryOp(self, node: ast.UnaryOp) -> Value:
        a = self.scalar(node.operand)
        if isinstance(node.op, ast.USub):
            return v.negative(a)
        if isinstance(node.op, (ast.Invert, ast.Not)):
            return v.inverse(a)
        return a

    def _of_Compare(self, node: ast.Compare) -> Value:
        result = number(True)
        left, *others = self.scalars([node.left, *node.comparators])
        for op, right in zip(node.ops, others, strict=True):
            if type(op) not in _RELATIONS:
                raise NotPrintable(f"line {node.lineno} has '{ast.unparse(node)}', for which there is no C")
            result = v.both(result, v.compare(_RELATIONS[type(op)], left, right))
            left = right
        return result

    def _of_BoolOp(self, node: ast.BoolOp) -> Value:
        join, decided = (v.either, True) if isinstance(node.op, ast.Or) else (v.both, False)
        result = self.scalar(node.values[0])
        for each in node.values[1:]:
            if result.static is not None and bool(result.static) == decided:
                return result
            result = join(result, self._unsure(each))
        return result

    def _unsure(self, node: ast.expr) -> Scalar:
        """Return the value of what is not always evaluated, which must not do anything else."""
        before, self._sure = self._sure, False
        value = self.scalar(node)
        self._sure = before
        return value

    def _of_IfExp(self, node: ast.IfExp) -> Value:
        test = self.scalar(node.test)
        if test.static is not None:
            return self.value(node.body if test.static else node.orelse)
        return v.choice(test, self._unsure(node.body), self._unsure(node.orelse))

    def _of_Attribute(self, node: ast.Attribute) -> Value:
        if isinstance(node.value, ast.Name) and isinstance(self._names.get(node.value.id), ModuleType):
            meaning = getattr(self._names[node.value.id], node.attr)
            if isinstance(meaning, (bool, int, float)):
                return number(meaning)
        value = self.value(node.value)
        if isinstance(value, Array) and node.attr == "shape":
            return Parts(tuple(map(number, value.shape)))
        if isinstance(value, Array) and node.attr == "ndim":
            return number(len(value.shape))
        if isinstance(value, Parts) and node.attr in value.fields:
            return value.parts[value.fields.index(node.attr)]
        raise NotPrintable(f"line {node.lineno}: nothing is known of '{ast.unparse(node)}'")

    def _of_Subscript(self, node: ast.Subscript) -> Value:
        value = self.value(node.value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if isinstance(value, Parts):
            return value.parts[self.size(indices[0])]
        if not isinstance(value, Array):
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node.value)}' is no array")
        *front, last = indices
        if not isinstance(last, ast.Slice):
            part = value.at([self.scalar(i) for i in indices])
            return part.element() if not part.shape else part
        part = value.at([self.scalar(i) for i in front])
        if last.step is not None:
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' takes steps")
        first = self.size(last.lower) if last.lower else 0
        return part.cut(first, self.size(last.upper) if last.upper else part.shape[0])

    def _of_Call(self, node: ast.Call) -> Value:
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' names its arguments")
        if isinstance(node.func, ast.Attribute):
            return self._method(node, node.func)
        assert isinstance(node.func, ast.Name)
        name, meaning = node.func.id, self._names.get(node.func.id)
        if isinstance(meaning, Dispatcher):
            meaning = meaning.py_func
        if isinstance(meaning, FunctionType):
            return self.called(meaning, self.values(node.args))
        if id(meaning) in PRIMITIVES:
            return self._primitive(PRIMITIVES[id(meaning)], node)
        if isinstance(meaning, type) and issubclass(meaning, tuple):
            return self._record(meaning, self.values(node.args))
        if name in ("max", "min", "abs", "int", "float") and meaning is None:
            return self._builtin(name, self.scalars(node.args))
        raise NotPrintable(f"line {node.lineno} calls '{name}', for which there is no C")

    def _record(self, meaning: Any, arguments: list[Value]) -> Parts:
        fields = meaning._fields
        rest = [meaning._field_defaults[f] for f in fields[len(arguments) :]]
        return Parts((*arguments, *rest), fields)

    def _method(self, node: ast.Call, function: ast.Attribute) -> Value:
        name = ast.unparse(function)
        if name in ("np.empty", "np.zeros") and len(node.args) == 1:
            sizes = self.value(node.args[0])
            parts = sizes.parts if isinstance(sizes, Parts) else (sizes,)
            shape = [p.static for p in parts if isinstance(p, Scalar) and isinstance(p.static, int)]
            if len(shape) != len(parts):
                raise NotPrintable(
                    f"line {node.lineno}: the sizes of '{ast.unparse(node)}' are not known before it runs"
                )
            return self.new_array(tuple(map(int, shape)), name == "np.zeros")
        if name == "np.sqrt":
            a = v.as_real(self.scalar(node.args[0]))
            return number(math.sqrt(a.static)) if a.static is not None else v.call("real_sqrt", "real", a)
        if function.attr == "reshape" and len(node.args) == 1:
            sizes = self.value(node.args[0])
            assert isinstance(sizes, Parts)
            return self._array(function.value).reshaped([int(p.static) for p in sizes.parts])  # type: ignore[union-attr, arg-type]
        raise NotPrintable(f"line {node.lineno} calls '{name}', for which there is no C")

    def _primitive(self, name: str, node: ast.Call) -> Value:
        if name == "get":
            array = self._array(node.args[0])
            return self._place(array, node.args[1:], node).element()
        if name == "put":
            number_, array = self.scalar(node.args[0]), self._array(node.args[1])
            self.store(v.as_real(number_), self._place(array, node.args[2:], node))
            return None
        if name == "borrowed":
            return self.value(node.args[0])
        if name == "retain":
            return None
        given = self.scalars(node.args)
        if name == "any_of":
            return given[0]
        if name == "select":
            return v.choice(given[0], v.as_real(given[1]), v.as_real(given[2]))
        reals = [v.as_real(a) for a in given]
        if name == "splat":
            return reals[0]
        if name == "is_nan":
            return v.compare("!=", reals[0], reals[0])
        function, count = IN_C[name]
        if len(reals) != count:
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' has {len(reals)} arguments")
        return v.call(function, "real", *reals)

    def _place(self, array: Array, indices: Sequence[ast.expr], node: ast.Call) -> Array:
        if len(indices) + 1 != len(array.shape) or array.shape[-1] != 1:
            raise NotPrintable(f"line {node.lineno}: '{ast.unparse(node)}' does not lead to a number")
        return array.at([self.scalar(i) for i in indices])

    def _builtin(self, name: str, given: list[Scalar]) -> Scalar:
        a = given[0]
        if all(each.static is not None for each in given):
            compute: Any = {"max": max, "min": min, "abs": abs, "int": int, "float": float}[name]
            return number(compute(*(each.static for each in given)))
        if name == "int":
            return a if a.kind == "int" else Scalar("int", f"(int) {a.within(v.UNARY)}", v.UNARY, None, a.reads)
        if name == "float":
            return v.as_real(a)
        if name == "abs":
            return v.call("real_abs", "real", v.as_real(a))
        for b in given[1:]:
            a = v.choice(v.compare(">" if name == "max" else "<", b, a), b, a)
        return a
