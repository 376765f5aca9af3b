"""Values of a kernel while it is printed as C: numbers, arrays of static shape, and tuples of these."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, prod
from typing import Any, Literal

import numpy as np

from harness.common.errors import UserError

Kind = Literal["bool", "int", "real"]

ATOM, UNARY, PRODUCT, SUM, COMPARISON, EQUALITY, AND, OR, CHOICE = 9, 8, 7, 6, 5, 4, 3, 2, 1
"""How strongly the outermost operator of a C expression binds."""


class NotPrintable(UserError):
    """A kernel uses what cannot be printed as C."""


@dataclass(eq=False)
class Root:
    """Where arrays lie: a parameter, a local array, a member of the estimator, a table, or a pointer to one of these.

    Attributes:
        name: C expression of its address.
        used, written: Whether anything printed reads or writes it.
        behind: What a pointer variable points into.
        constant: Whether it is a table that nothing may write.
    """

    name: str
    used: bool = False
    written: bool = False
    behind: list[Root] = field(default_factory=list)
    constant: bool = False

    def use(self) -> None:
        """Note that it is read."""
        self.used = True

    def write(self) -> None:
        """Note that it is written."""
        if self.constant:
            raise NotPrintable(f"it writes to the table {self.name}")
        self.used = True
        if not self.written:
            self.written = True
            for each in self.behind:
                each.write()


@dataclass(frozen=True)
class Scalar:
    """A number or truth value.

    Attributes:
        kind: Of what type.
        text: C expression.
        binds: How strongly its outermost operator binds.
        static: Its value, where that is static when it is printed.
        reads: Names of the C variables in it.
    """

    kind: Kind
    text: str
    binds: int = ATOM
    static: bool | int | float | None = None
    reads: frozenset[str] = frozenset()

    def within(self, binds: int) -> str:
        """Return it as an operand of an operator that binds so strongly."""
        return self.text if self.binds >= binds else f"({self.text})"


@dataclass(frozen=True)
class Array:
    """An array of static shape, contiguous, with the axis of lanes of length one where numbers are lanes.

    Attributes:
        kind: Of its elements.
        shape: Lengths of its axes.
        root: Where it lies.
        offset: Of its first element there.
        table: Its elements, where these are static.
    """

    kind: Kind
    shape: tuple[int, ...]
    root: Root
    offset: Scalar
    table: np.ndarray[Any, Any] | None = field(default=None, compare=False)

    @property
    def address(self) -> str:
        """C expression of its address."""
        return self.root.name if self.offset.static == 0 else f"{self.root.name} + {self.offset.within(SUM + 1)}"

    @property
    def reads(self) -> frozenset[str]:
        """Names of the C variables in its address."""
        return self.offset.reads | {self.root.name}

    def at(self, indices: Sequence[Scalar]) -> Array:
        """Return the part at some leading indices."""
        stride, offset = prod(self.shape), self.offset
        for size, index in zip(self.shape, indices, strict=False):
            stride //= max(size, 1)
            offset = plus(offset, times(index, whole(stride)))
        places = [i.static for i in indices if isinstance(i.static, int)]
        table = self.table
        if table is not None:
            table = np.asarray(table[tuple(places)]) if len(places) == len(indices) else None
        return Array(self.kind, self.shape[len(indices) :], self.root, offset, table)

    def cut(self, first: int, last: int) -> Array:
        """Return the part from one index of the first axis to before another."""
        first, last, _ = slice(first, last).indices(self.shape[0])
        stride = prod(self.shape[1:])
        offset = plus(self.offset, whole(first * stride))
        table = None if self.table is None else self.table[first:last]
        return Array(self.kind, (max(last - first, 0), *self.shape[1:]), self.root, offset, table)

    def reshaped(self, shape: Sequence[int]) -> Array:
        """Return the same elements in another shape."""
        if prod(shape) != prod(self.shape):
            raise NotPrintable(f"it reshapes {self.shape} to {tuple(shape)}")
        return replace(self, shape=tuple(shape), table=None if self.table is None else self.table.reshape(shape))

    def element(self) -> Scalar:
        """Return the single element."""
        assert prod(self.shape) == 1
        self.root.use()
        value = None if self.table is None else self.table.reshape(-1)[0].item()
        text = f"{self.root.name}[{self.offset.text}]"
        if value is not None:
            return number(value)
        shown = Scalar(self.kind, text, ATOM, None, self.reads)
        return Scalar("bool", f"{text} != 0", EQUALITY, None, self.reads) if self.kind == "bool" else shown


@dataclass(frozen=True)
class Parts:
    """A tuple, with the names of its fields if it has some. It exists while kernels are printed, not in C."""

    parts: tuple[Value, ...]
    fields: tuple[str, ...] = ()


Value = Scalar | Array | Parts | None


def flat(value: Value) -> Iterator[Scalar | Array]:
    """Give the numbers and arrays of a value."""
    if isinstance(value, Parts):
        for part in value.parts:
            yield from flat(part)
    elif value is not None:
        yield value


def mapped(value: Value, change: Callable[[Scalar | Array], Scalar | Array]) -> Value:
    """Return a value with its numbers and arrays changed."""
    if isinstance(value, Parts):
        return Parts(tuple(mapped(part, change) for part in value.parts), value.fields)
    return None if value is None else change(value)


def whole(value: int) -> Scalar:
    """Return a static whole number."""
    return Scalar("int", str(value), ATOM if value >= 0 else UNARY, value)


def number(value: bool | int | float) -> Scalar:
    """Return a static number or truth value."""
    if isinstance(value, bool):
        return Scalar("bool", "true" if value else "false", ATOM, value)
    return whole(value) if isinstance(value, int) else real(value)


def real(value: float) -> Scalar:
    """Return a static real number."""
    if value != value:
        return Scalar("real", "(real) NAN", UNARY, value)
    if not isfinite(value):
        return Scalar("real", "(real) INFINITY" if value == inf else "-(real) INFINITY", UNARY, value)
    text = repr(float(value))
    return Scalar("real", text, UNARY if text.startswith("-") else ATOM, value)


def as_real(value: Scalar) -> Scalar:
    """Return a number as a real one."""
    if value.kind == "real":
        return value
    if value.kind == "bool":
        raise NotPrintable("it reckons with a truth value")
    if value.static is not None:
        return real(float(value.static))
    return Scalar("real", f"(real) {value.within(UNARY)}", UNARY, None, value.reads)


def alike(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar, Kind]:
    """Return two numbers of one kind, and that kind."""
    if a.kind == b.kind:
        return a, b, a.kind
    return as_real(a), as_real(b), "real"


_ARITHMETIC: dict[str, tuple[int, Callable[[Any, Any], Any]]] = {
    "+": (SUM, operator.add),
    "-": (SUM, operator.sub),
    "*": (PRODUCT, operator.mul),
    "/": (PRODUCT, operator.truediv),
}

_COMPARISONS: dict[str, tuple[int, Callable[[Any, Any], Any]]] = {
    "<": (COMPARISON, operator.lt),
    "<=": (COMPARISON, operator.le),
    ">": (COMPARISON, operator.gt),
    ">=": (COMPARISON, operator.ge),
    "==": (EQUALITY, operator.eq),
    "!=": (EQUALITY, operator.ne),
}


def arithmetic(sign: str, a: Scalar, b: Scalar) -> Scalar:
    """Return the result of one of the four operations, of numbers in the order in which they are written."""
    binds, compute = _ARITHMETIC[sign]
    a, b, kind = (as_real(a), as_real(b), "real") if sign == "/" else alike(a, b)
    if kind == "bool":
        raise NotPrintable("it reckons with truth values")
    if a.static is not None and b.static is not None and not (sign == "/" and b.static == 0):
        return number(compute(a.static, b.static))
    if kind == "int":
        neutral = {"+": 0, "-": 0, "*": 1}[sign]
        if b.static == neutral:
            return a
        if a.static == neutral and sign != "-":
            return b
    return Scalar(kind, f"{a.within(binds)} {sign} {b.within(binds + 1)}", binds, None, a.reads | b.reads)  # type: ignore[arg-type]


def plus(a: Scalar, b: Scalar) -> Scalar:
    """Return a sum."""
    return arithmetic("+", a, b)


def times(a: Scalar, b: Scalar) -> Scalar:
    """Return a product."""
    return whole(0) if b.static == 0 and b.kind == "int" else arithmetic("*", a, b)


def remainder(a: Scalar, b: Scalar) -> Scalar:
    """Return what is left of a whole number behind a division, of the sign of the divisor."""
    if a.kind != "int" or b.kind != "int" or not b.static or b.static < 0:
        raise NotPrintable("it takes a remainder of other than whole numbers, or for a divisor that is not known")
    if a.static is not None:
        return whole(int(a.static) % int(b.static))
    text = f"({a.within(PRODUCT)} % {b.text} + {b.text}) % {b.text}"
    return Scalar("int", text, PRODUCT, None, a.reads)


def quotient(a: Scalar, b: Scalar) -> Scalar:
    """Return the whole part of a quotient of whole numbers that are not negative."""
    if not isinstance(a.static, int) or not isinstance(b.static, int):
        raise NotPrintable("it divides whole numbers that are not known")
    return whole(a.static // b.static)


def compare(sign: str, a: Scalar, b: Scalar) -> Scalar:
    """Return a comparison."""
    binds, compute = _COMPARISONS[sign]
    a, b, _ = alike(a, b)
    if a.static is not None and b.static is not None:
        return number(bool(compute(a.static, b.static)))
    return Scalar("bool", f"{a.within(binds + 1)} {sign} {b.within(binds + 1)}", binds, None, a.reads | b.reads)


def both(a: Scalar, b: Scalar) -> Scalar:
    """Return whether two conditions hold."""
    return _joined("&&", AND, a, b, False)


def either(a: Scalar, b: Scalar) -> Scalar:
    """Return whether one of two conditions holds."""
    return _joined("||", OR, a, b, True)


def _joined(sign: str, binds: int, a: Scalar, b: Scalar, decided: bool) -> Scalar:
    if a.kind != "bool" or b.kind != "bool":
        raise NotPrintable("it joins what are no truth values")
    for first, second in ((a, b), (b, a)):
        if first.static is not None:
            return first if first.static == decided else second
    parts = [each.text if each.binds >= EQUALITY else f"({each.text})" for each in (a, b)]
    return Scalar("bool", f" {sign} ".join(parts), binds, None, a.reads | b.reads)


def inverse(a: Scalar) -> Scalar:
    """Return whether a condition does not hold."""
    if a.kind != "bool":
        raise NotPrintable("it inverts what is no truth value")
    if a.static is not None:
        return number(not a.static)
    return Scalar("bool", f"!{a.within(UNARY)}", UNARY, None, a.reads)


def negative(a: Scalar) -> Scalar:
    """Return a number with the other sign."""
    if a.static is not None:
        return number(-a.static)
    return Scalar(a.kind, f"-{a.within(ATOM)}", UNARY, None, a.reads)


def choice(test: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """Return one number where a condition holds and another elsewhere."""
    if test.static is not None:
        return yes if test.static else no
    yes, no, kind = alike(yes, no)
    text = f"{test.within(CHOICE + 1)} ? {yes.within(CHOICE + 1)} : {no.within(CHOICE + 1)}"
    return Scalar(kind, text, CHOICE, None, test.reads | yes.reads | no.reads)


def call(name: str, kind: Kind, *arguments: Scalar) -> Scalar:
    """Return what a C function without further effect returns."""
    reads = frozenset().union(*(a.reads for a in arguments))
    return Scalar(kind, f"{name}({', '.join(a.text for a in arguments)})", ATOM, None, reads)
