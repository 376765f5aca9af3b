"""Kernel functions as C: each for the kinds and shapes of arguments that it is called with, behind those it calls."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numpy as np

from harness.engine.c99 import values as v
from harness.engine.c99.expressions import Printed
from harness.engine.c99.functions import C_TYPES, Function, Names, ReturnsArrays, parameters_of
from harness.engine.c99.statements import printed, without_unread
from harness.engine.c99.values import Array, NotPrintable, Parts, Root, Scalar, Value, flat


class Program:
    """C functions in the making.

    Args:
        title: Of whom errors speak: the estimator.

    Attributes:
        texts: Text of each table and C function by its name, those that others need first.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self.texts: dict[str, str] = {}
        self._syntax: dict[FunctionType, ast.FunctionDef] = {}
        self._printed: dict[Any, Printed] = {}
        self._inner: set[FunctionType] = set()
        self._tables: dict[int, tuple[np.ndarray[Any, Any], Array]] = {}
        self._names: set[str] = set()
        self._at_work: list[FunctionType] = []

    def needed(self, lines: Sequence[str]) -> list[str]:
        """Return the text of the tables and functions that some lines need, those that others need first."""
        mentioned = set(_WORDS.findall("\n".join(lines)))
        kept = []
        for name, text in reversed(self.texts.items()):
            if name in mentioned:
                kept.append(text)
                mentioned |= set(_WORDS.findall(text))
        return kept[::-1]

    def syntax(self, function: FunctionType) -> ast.FunctionDef:
        """Return the syntax of a function."""
        if function not in self._syntax:
            node = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
            assert isinstance(node, ast.FunctionDef)
            self._syntax[function] = node
        return self._syntax[function]

    def table(self, name: str, values: np.ndarray[Any, Any]) -> Array:
        """Return a table of constants."""
        if id(values) not in self._tables:
            kind: v.Kind = "bool" if values.dtype == bool else "int" if values.dtype.kind in "iu" else "real"
            new = self._name(name)
            numbers = [v.number(each.item()).text for each in values.reshape(-1)]
            lines = textwrap.wrap(", ".join(numbers), 112, break_on_hyphens=False) or ["0"]
            head = f"static const {'int' if kind == 'bool' else kind} {new}[{max(values.size, 1)}] = {{"
            self.texts = {new: "\n".join([head, *(f"    {line}" for line in lines), "};"]), **self.texts}
            self._tables[id(values)] = values, Array(kind, values.shape, Root(new, constant=True), v.whole(0), values)
        return self._tables[id(values)][1]

    def function(self, function: FunctionType, arguments: Sequence[Value]) -> Printed | None:
        """Return a C function for such arguments; ``None`` where its statements stand where it is called.

        Raises:
            NotPrintable: If there is none.
        """
        if function in self._inner:
            return None
        key = function, tuple(map(_kinds, arguments))
        if key not in self._printed:
            with self.inside(function):
                try:
                    self._printed[key] = self._print(function, arguments)
                except ReturnsArrays:
                    self._inner.add(function)
                    return None
        return self._printed[key]

    @contextmanager
    def inside(self, function: FunctionType) -> Iterator[None]:
        """Say of what goes wrong in a function where it is; refuse one that calls itself."""
        if function in self._at_work:
            raise NotPrintable(f"{self._title}: '{function.__name__}' calls itself, which generated C does not")
        self._at_work.append(function)
        try:
            yield
        except NotPrintable as error:
            if str(error).startswith(self._title):
                raise
            raise NotPrintable(f"{self._title}: kernel '{function.__name__}', {error}") from error
        finally:
            self._at_work.pop()

    def _print(self, function: FunctionType, arguments: Sequence[Value]) -> Printed:
        names = Names()
        roots: list[Root | None] = []
        syntax = self.syntax(function)
        parameters = [
            parameters_of(value, a.arg, names, roots) for a, value in zip(syntax.args.args, arguments, strict=True)
        ]
        body = Function(self, function, names, parameters, False)
        body.print()
        statements = without_unread(body.statements)
        leaves = [leaf for argument in arguments for leaf in flat(argument)]
        mentioned = {name for each in statements for name in each.mentions()}
        taken = {i: root for i, root in enumerate(roots) if root is not None and root.name in mentioned}
        written = [i for i, root in taken.items() if root.written]
        acts = bool(written)
        name = self._name(f"k_{function.__name__.lstrip('_')}")
        head = ", ".join(_declared(leaves[i], root) for i, root in taken.items()) or "void"
        types = names.types | {r.name: "real *" for r in names.pointers if r.written}
        lines = [
            f"/* {_first_line(syntax)} */",
            f"static {C_TYPES[body.kind] if body.kind else 'void'} {name}({head}) {{",
            *printed(statements, types),
            "}",
        ]
        if acts or body.kind:
            self.texts[name] = "\n".join(lines)
        static = body.returned.pop() if len(body.returned) == 1 else None
        return Printed(name, body.kind, tuple(taken), tuple(written), acts, static)

    def _name(self, wanted: str) -> str:
        name, number = wanted, 1
        while name in self._names:
            number += 1
            name = f"{wanted}_{number}"
        self._names.add(name)
        return name

    def statements(
        self, function: FunctionType, arguments: Sequence[Value], make_array: Any = None
    ) -> tuple[Value, list[str]]:
        """Return what a function returns, and the lines of its statements for arguments that have places in C."""
        names = Names()
        body = Function(self, function, names, arguments, True, make_array)
        with self.inside(function):
            result = body.print()
        kept = without_unread(body.statements)
        types = names.types | {r.name: "real *" for r in names.pointers if r.written}
        return result, printed(kept, types)


def _first_line(syntax: ast.FunctionDef) -> str:
    text = ast.get_docstring(syntax) or syntax.name
    return " ".join(text.split("\n\n")[0].split()).replace("*/", "* /").replace("``", "")


def _declared(leaf: Scalar | Array, root: Root) -> str:
    if isinstance(leaf, Array):
        return f"{'' if root.written else 'const '}real *{root.name}"
    return f"{C_TYPES[leaf.kind]} {root.name}"


def _kinds(value: Value) -> Any:
    """Return what a function is printed for: kinds, shapes, and numbers that are known."""
    if isinstance(value, Parts):
        return value.fields, tuple(map(_kinds, value.parts))
    if isinstance(value, Array):
        table = None if value.table is None else (value.root.name, value.offset.text)
        return value.kind, value.shape, table
    if isinstance(value, Scalar):
        return value.kind, None if value.kind == "real" else value.static
    return None


_WORDS = re.compile(r"[A-Za-z_]\w*")
_REAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])")


def in_single_precision(text: str) -> str:
    """Return C text with numbers of single precision."""
    return _REAL.sub(r"\1F", text)
