"""One kernel function, for arguments of known kinds and shapes, as statements of C."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from types import FunctionType
from typing import Any

from harness.engine.c99 import values as v
from harness.engine.c99.expressions import Expressions, Program
from harness.engine.c99.statements import Statement
from harness.engine.c99.values import Array, NotPrintable, Parts, Root, Scalar, Value, flat, mapped

C_WORDS = """auto bool break case char const continue default do double else enum extern float for goto if inline int
    long register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"""
RESERVED = frozenset(
    {
        *C_WORDS.split(),
        "true",
        "false",
        "real",
        "e",
        "power_of_two",
        "exponent_of",
        "y0",
        "y1",
        "yn",
        "j0",
        "j1",
        "jn",
        "gamma",
        "index",
    }
)
"""Names that a variable cannot have in C, or that would hide something."""

C_TYPES = {"bool": "bool", "int": "int", "real": "real"}


class Again(Exception):
    """A variable is assigned where it may or may not be, so it has to be one in C from the beginning."""


class ReturnsArrays(Exception):
    """A function returns arrays, or several numbers: C cannot, so its statements stand where it is called."""


class Unreachable(Exception):
    """What follows is never reached."""


class Names:
    """Names of the variables of a C function."""

    def __init__(self) -> None:
        self.types: dict[str, str] = {}
        self.taken: set[str] = set(RESERVED)
        self.pointers: list[Root] = []
        self.counters: set[str] = set()

    def new(self, wanted: str, kind: str) -> str:
        """Return a name that is not taken, like the one that is wanted."""
        wanted = wanted.lstrip("_") or "value"
        name, number = wanted, 1
        while name in self.taken or name in self.types or (kind and name in self.counters):
            number += 1
            name = f"{wanted}_{number}"
        self.taken.add(name)
        if kind:
            self.types[name] = kind
        return name


class Function(Expressions):
    """Prints the statements of a function.

    Args:
        program: What it is printed into.
        function: The function.
        names: Names of the C function that the statements stand in.
        arguments: Values of its arguments.
        is_inner: Whether its statements stand where it is called.
        make_array: Makes an array in another way than as a local variable.
    """

    def __init__(
        self,
        program: Program,
        function: FunctionType,
        names: Names,
        arguments: Sequence[Value],
        is_inner: bool,
        make_array: Callable[[tuple[int, ...], bool], Array] | None = None,
    ) -> None:
        super().__init__(program, function.__globals__)
        self._syntax, self._c, self._arguments = program.syntax(function), names, arguments
        self._is_inner, self._make_array = is_inner, make_array
        self._shared: dict[str, v.Kind | None] = {}  # Python names of one variable in C, with its kind
        self.result: Value = None
        self.kind: v.Kind | None = None
        self.returned: set[bool | int | float | None] = set()

    def print(self) -> Value:
        """Print the statements; return what the function returns, if they stand where it is called."""
        taken, types = set(self._c.taken), dict(self._c.types)
        for _ in range(1000):
            self._c.taken, self._c.types = set(taken), dict(types)
            self.statements, self._depth = [], 0
            self._variables_in_c: dict[str, str] = {}
            self.kind, self.result, self.returned, self._sure = None, None, set(), True
            parameters = [a.arg for a in self._syntax.args.args]
            if len(parameters) != len(self._arguments):
                raise NotPrintable(f"it is called with {len(self._arguments)} arguments in place of {len(parameters)}")
            self.variables = dict(zip(parameters, self._arguments, strict=True))
            for name in self._shared.keys() & self.variables.keys():
                self._set(name, self.variables[name])
            try:
                self._block(self._syntax.body)
                return self.result
            except Again:
                continue
            except Unreachable:
                return self.result
        raise NotPrintable("its variables change their kinds again and again")

    def _add(self, text: str, reads: frozenset[str], **more: Any) -> None:
        self.statements.append(Statement(text, reads, **more))

    def _block(self, body: Sequence[ast.stmt]) -> None:
        for node in body:
            method = getattr(self, f"_do_{type(node).__name__}", None)
            if method is None:
                raise NotPrintable(
                    f"line {node.lineno} has '{ast.unparse(node).splitlines()[0]}', for which there is no C"
                )
            method(node)

    @contextmanager
    def _within(self) -> Iterator[list[Statement]]:
        """Collect what is printed for a block that may run never or several times."""
        outside, self.statements = self.statements, []
        self._depth += 1
        yield self.statements
        self._depth -= 1
        self.statements = outside

    def _do_Pass(self, node: ast.Pass) -> None:
        pass

    def _do_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.value(node.value)

    def _do_Assign(self, node: ast.Assign) -> None:
        if len(node.targets) != 1:
            raise NotPrintable(f"line {node.lineno} assigns to several variables at once")
        self._assign(node.targets[0], self.value(node.value))

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        assert isinstance(node.target, ast.Name)
        self._assign(node.target, self._of_BinOp(_placed(node)))

    def _assign(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            if target.id != "_":
                self._bind(target.id, value)
            return
        if not isinstance(target, ast.Tuple) or not isinstance(value, Parts) or len(value.parts) != len(target.elts):
            raise NotPrintable(f"line {target.lineno} assigns to '{ast.unparse(target)}'")
        before: set[str] = set()
        parts = []
        for each, part in zip(target.elts, value.parts, strict=True):  # all are read before the first is assigned
            is_late = isinstance(part, Scalar) and part.reads & before
            parts.append(self._variable("next", part) if is_late else part)  # type: ignore[arg-type]
            before.add(self._variables_in_c.get(each.id, "") if isinstance(each, ast.Name) else "")
        for each, part in zip(target.elts, parts, strict=True):
            self._assign(each, part)

    def _bind(self, name: str, value: Value) -> None:
        """Give a variable a value: in C if it may be assigned several times, else where it needs a name there."""
        if name in self._shared:
            self._set(name, value)
            return
        if name in self.variables and self._depth > 0:
            self._share(name, value)
        self.variables[name] = mapped(value, partial(self._named, name))

    def _share(self, name: str, value: Value) -> None:
        if isinstance(value, Parts):
            raise NotPrintable(f"the tuple '{name}' is assigned again")
        self._shared[name] = value.kind if isinstance(value, Scalar) else None
        raise Again

    def _named(self, name: str, leaf: Scalar | Array) -> Scalar | Array:
        """Return a number or array under a name in C, if it is none that can stay as it is."""
        if isinstance(leaf, Array):
            return leaf if not leaf.offset.reads else self._pointer(name, leaf)
        is_name = leaf.text.isidentifier() and leaf.text not in self._variables_in_c.values()
        return leaf if leaf.static is not None or is_name else self._variable(name, leaf)

    def _variable(self, name: str, value: Scalar, acts: bool = False) -> Scalar:
        target = self._c.new(name, C_TYPES[value.kind])
        self._add(value.text, value.reads, target=target, needed=acts)
        return Scalar(value.kind, target, v.ATOM, None, frozenset([target]))

    def _pointer(self, name: str, array: Array) -> Array:
        target = self._c.new(name, "const real *")
        root = Root(target, behind=[array.root])
        self._c.pointers.append(root)
        self._add(array.address, array.reads, target=target, needed=False)
        array.root.use()
        return replace(array, root=root, offset=v.whole(0), table=None)

    def _set(self, name: str, value: Value) -> None:
        """Assign to a variable that is one in C."""
        if isinstance(value, Array):
            self._set_pointer(name, value)
            return
        if not isinstance(value, Scalar):
            raise NotPrintable(f"'{name}' is assigned what is no number")
        kind = self._shared[name]
        if kind is None or (kind != value.kind and not (kind == "real" and value.kind == "int")):
            if {kind, value.kind} == {"int", "real"}:
                self._shared[name] = "real"
                raise Again
            raise NotPrintable(f"'{name}' is assigned a number and something else")
        value = v.as_real(value) if kind == "real" else value
        if name not in self._variables_in_c:
            self._variables_in_c[name] = self._c.new(name, C_TYPES[value.kind])
        target = self._variables_in_c[name]
        self._add(value.text, value.reads, target=target, needed=False)
        self.variables[name] = Scalar(value.kind, target, v.ATOM, None, frozenset([target]))

    def _set_pointer(self, name: str, value: Array) -> None:
        before = self.variables.get(name)
        if name not in self._variables_in_c:
            pointer = self._pointer(name, value)
            self._variables_in_c[name] = pointer.root.name
            self.variables[name] = pointer
            return
        if not isinstance(before, Array) or before.shape != value.shape:
            raise NotPrintable(f"'{name}' is assigned arrays of different shapes")
        value.root.use()
        if before.root.written:
            value.root.write()
        before.root.behind.append(value.root)
        self._add(value.address, value.reads, target=before.root.name, needed=False)

    def _do_For(self, node: ast.For) -> None:
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise NotPrintable(f"line {node.lineno} loops over '{ast.unparse(call)}'")
        if node.orelse or not isinstance(node.target, ast.Name):
            raise NotPrintable(f"line {node.lineno} loops in a way for which there is no C")
        given = [self.scalar(a) for a in call.args]
        first, last = (v.whole(0), given[0]) if len(given) == 1 else (given[0], given[1])
        step = given[2].static if len(given) == 3 else 1
        if not isinstance(step, int) or step == 0:
            raise NotPrintable(f"line {node.lineno}: the step of '{ast.unparse(call)}' is not known")
        if first.static is not None and last.static is not None and not range(first.static, last.static, step):  # type: ignore[arg-type]
            return
        counter = self._c.new("pass" if node.target.id == "_" else node.target.id, "")
        self._c.counters.add(counter)
        if last.static is None and last.reads & set(self._variables_in_c.values()):
            last = self._variable("end", last)
        there = set(self.variables)
        self.variables[node.target.id] = Scalar("int", counter, v.ATOM, None, frozenset([counter]))
        with self._within() as body:
            self._guarded(node.body)
        self._c.taken.discard(counter)  # a loop that comes later may count with it, and nothing else
        for name in set(self.variables) - there - set(self._shared):
            del self.variables[name]
        sign, move = (
            ("<", "++" if step == 1 else f" += {step}") if step > 0 else (">", "--" if step == -1 else f" -= {-step}")
        )
        head = f"for (int {counter} = {first.text}; {counter} {sign} {last.within(v.SUM)}; {counter}{move})"
        self._add(head, (first.reads | last.reads) - {counter}, body=body)

    def _guarded(self, body: Sequence[ast.stmt]) -> None:
        with suppress(Unreachable):
            self._block(body)

    def _do_If(self, node: ast.If) -> None:
        test = self.scalar(node.test)
        if test.kind != "bool":
            test = v.compare("!=", test, v.whole(0))
        if test.static is not None:
            self._block(node.body if test.static else node.orelse)
            return
        with self._within() as body:
            self._guarded(node.body)
        with self._within() as otherwise:
            self._guarded(node.orelse)
        if body or otherwise:
            if not body:
                test, body, otherwise = v.inverse(test), otherwise, []
            self._add(f"if ({test.text})", test.reads, body=body, otherwise=otherwise)

    def _do_Break(self, node: ast.Break) -> None:
        self._add("break", frozenset())
        raise Unreachable

    def _do_Continue(self, node: ast.Continue) -> None:
        self._add("continue", frozenset())
        raise Unreachable

    def _do_Return(self, node: ast.Return) -> None:
        value = None if node.value is None else self.value(node.value)
        if self._is_inner:
            if self._depth > 0:
                raise NotPrintable(f"line {node.lineno} returns before the end, of a function that returns arrays")
            self.result = value
        elif isinstance(value, (Parts, Array)):
            raise ReturnsArrays
        elif value is None:
            self._add("return", frozenset())
        else:
            if self.kind is not None and self.kind != value.kind:
                value = v.as_real(value)
            self.kind = value.kind
            self.returned.add(value.static)
            self._add(f"return {value.text}", value.reads)
        raise Unreachable

    def new_array(self, shape: tuple[int, ...], zero: bool, kind: v.Kind = "real") -> Array:
        """Return a new array, a local variable unless the caller makes them."""
        if self._make_array is not None:
            return self._make_array(shape, zero)
        size = 1
        for n in shape:
            size *= n
        if not self._sure:
            raise NotPrintable("it makes an array within an expression under a condition")
        name = self._c.new("room", f"real[{max(size, 1)}]")
        if zero and size:
            self._add(
                f"for (int i = 0; i < {size}; i++)",
                frozenset(),
                body=[Statement(f"{name}[i] = 0.0", frozenset([name]))],
            )
        return Array("real", shape, Root(name), v.whole(0))

    def keep_early(self, value: Value, mark: int) -> Value:
        """Read a value before the statements from a place on, which may change it."""
        later = self.statements[mark:]
        del self.statements[mark:]  # in place: the block around it holds this very list
        kept = mapped(value, partial(self._read, "early"))
        self.statements += later
        return kept

    def _read(self, name: str, leaf: Scalar | Array) -> Scalar | Array:
        is_number = isinstance(leaf, Scalar) and leaf.static is None
        return self._variable(name, leaf) if is_number else leaf  # type: ignore[arg-type]

    def store(self, value: Scalar, place: Array) -> None:
        """Write a number."""
        place.root.write()
        self._add(f"{place.root.name}[{place.offset.text}] = {value.text}", place.reads | value.reads)

    def called(self, function: FunctionType, arguments: Sequence[Value]) -> Value:
        """Call a kernel function, or put its statements here if it returns arrays."""
        printed = self._program.function(function, arguments)
        if printed is None:
            return self._put_here(function, arguments)
        leaves = [leaf for argument in arguments for leaf in flat(argument)]
        texts: list[str] = []
        reads: frozenset[str] = frozenset()
        for place in printed.leaves:
            leaf = leaves[place]
            if isinstance(leaf, Array):
                leaf.root.use()
                if place in printed.written:
                    leaf.root.write()
                texts.append(leaf.address)
            else:
                texts.append(leaf.text)
            reads |= leaf.reads
        text = f"{printed.name}({', '.join(texts)})"
        if not printed.acts and printed.static is not None:
            return v.number(printed.static)
        if not printed.acts:
            return None if printed.kind is None else Scalar(printed.kind, text, v.ATOM, None, reads)
        if not self._sure:
            raise NotPrintable(f"it calls '{function.__name__}', which writes, within an expression under a condition")
        if printed.kind is None:
            self._add(text, reads)
            return None
        if printed.static is not None:
            self._add(f"(void) {text}", reads)
            return v.number(printed.static)
        returned = Scalar(printed.kind, text, v.ATOM, None, reads)
        return self._variable(f"of_{function.__name__.lstrip('_')}", returned, acts=True)

    def _put_here(self, function: FunctionType, arguments: Sequence[Value]) -> Value:
        if not self._sure:
            raise NotPrintable(
                f"it calls '{function.__name__}', which returns arrays, where that may or may not happen"
            )
        names = [a.arg for a in self._program.syntax(function).args.args]
        bound = [mapped(a, partial(self._named, name)) for name, a in zip(names, arguments, strict=True)]
        inner = Function(self._program, function, self._c, bound, True, self._make_array)
        with self._program.inside(function):
            result = inner.print()
        self.statements += inner.statements
        return result


def _placed(node: ast.AugAssign) -> ast.BinOp:
    assert isinstance(node.target, ast.Name)
    name = ast.Name(node.target.id, ast.Load(), lineno=node.lineno, col_offset=0)
    return ast.BinOp(name, node.op, node.value, lineno=node.lineno, col_offset=0)


def parameters_of(value: Value, name: str, names: Names, leaves: list[Root | None]) -> Value:
    """Return the value of an argument as a C function sees it.

    Args:
        value: As it is called.
        name: Of the parameter in Python.
        names: Of the function.
        leaves: Grows by the root of each array or number in it, ``None`` for what the function knows by itself.
    """
    if isinstance(value, Parts):
        fields = value.fields or [str(i) for i in range(len(value.parts))]
        parts = zip(value.parts, fields, strict=True)
        return Parts(tuple(parameters_of(p, f"{name}_{f}", names, leaves) for p, f in parts), value.fields)
    if value is None:
        return None
    is_table = isinstance(value, Array) and value.table is not None
    if is_table or (isinstance(value, Scalar) and value.static is not None and value.kind != "real"):
        leaves.append(None)
        return value
    root = Root(names.new(name, ""))
    leaves.append(root)
    if isinstance(value, Array):
        return Array(value.kind, value.shape, root, v.whole(0))
    return Scalar(value.kind, root.name, v.ATOM, None, frozenset([root.name]))
