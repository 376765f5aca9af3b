"""Print equations as source text of kernels over lanes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import sympy as sp
from sympy.printing.precedence import precedence
from sympy.printing.pycode import PythonCodePrinter

from harness.engine.codegen import conditionals as branches
from harness.engine.codegen.derivatives import Entries, Equations, needed
from harness.models.assembly.assemble import symbol

Assignment = tuple[sp.Expr, str]
"""An expression and where it goes, e.g. ``(expr, "J, 2, 3")``."""

NOWHERE: Mapping[sp.Symbol, str] = MappingProxyType({})


class LanePrinter(PythonCodePrinter):
    """Prints an expression with the functions of ``harness.engine.simd.functions``, without branches."""

    printmethod = "_lanecode"

    def __init__(self) -> None:
        super().__init__({"fully_qualified_modules": False})

    def _print_Pow(self, expr: sp.Expr, rational: bool = False) -> str:
        base, power = expr.as_base_exp()
        inner = self.parenthesize(base, precedence(expr))
        if power.is_Integer and 1 <= abs(int(power)) <= 8:
            product = "*".join([inner] * abs(int(power)))
            return f"(1.0/({product}))" if power < 0 else f"({product})"
        if power == sp.Rational(1, 2):
            return f"sqrt({self._print(base)})"
        if power == sp.Rational(-1, 2):
            return f"(1.0/sqrt({self._print(base)}))"
        return f"exp({self._print(power)}*log({self._print(base)}))"

    def _print_Rational(self, expr: sp.Rational) -> str:
        return repr(float(expr))

    def _print_Half(self, expr: sp.Rational) -> str:
        return "0.5"

    def _print_Integer(self, expr: sp.Integer) -> str:
        return repr(float(expr))

    def _print_Pi(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Heaviside(self, expr: sp.Expr) -> str:
        return f"select({self._print(expr.args[0])} > 0.0, 1.0, 0.0)"

    def _print_Abs(self, expr: sp.Expr) -> str:
        return f"absolute({self._print(expr.args[0])})"

    def _print_sign(self, expr: sp.Expr) -> str:
        return f"sign({self._print(expr.args[0])})"

    def _print_Relational(self, expr: Any) -> str:
        return f"({self._print(expr.lhs)} {expr.rel_op} {self._print(expr.rhs)})"

    def _print_Piecewise(self, expr: sp.Expr) -> str:
        *branches, (last, condition) = expr.args
        if condition != sp.true:
            raise ValueError(f"a piecewise equation needs a branch for all other cases: {expr}")
        text = self._print(last)
        for value, where in reversed(branches):
            text = f"select({self._print(where)}, {self._print(value)}, {text})"
        return text

    def _print_And(self, expr: sp.Expr) -> str:
        return "(" + " & ".join(self._print(a) for a in expr.args) + ")"

    def _print_Or(self, expr: sp.Expr) -> str:
        return "(" + " | ".join(self._print(a) for a in expr.args) + ")"

    def _print_Not(self, expr: sp.Expr) -> str:
        return f"~{self._print(expr.args[0])}"


for _name in ("sin", "cos", "tan", "atan", "exp", "log", "tanh"):
    setattr(
        LanePrinter,
        f"_print_{_name}",
        lambda self, expr, name=_name: f"{name}({self._print(expr.args[0])})",
    )

_PRINTER = LanePrinter()


def text(expr: sp.Expr) -> str:
    """Return an expression as source text."""
    return str(_PRINTER.doprint(expr))


def vector(array: str, values: Iterable[sp.Expr]) -> list[Assignment]:
    """Return the stores of a vector."""
    return [(value, f"{array}, {i}") for i, value in enumerate(values)]


def matrix(array: str, entries: Entries, rows: int, columns: int) -> list[Assignment]:
    """Return the stores of a dense matrix, zeros included."""
    zero = sp.Float(0.0)
    return [(entries.get((i, j), zero), f"{array}, {i}, {j}") for i in range(rows) for j in range(columns)]


def body(eqs: Equations, roots: Sequence[sp.Expr], stored: Mapping[sp.Symbol, str] = NOWHERE) -> list[str]:
    """Return the lines that load what the roots read and compute what they depend on.

    Args:
        eqs: The model.
        roots: Expressions of its assignments.
        stored: Those of them that are stored as soon as they are there (``conditionals.lines``), and where.
    """
    assignments = needed(eqs.assignments, roots)
    arrays = {"x": map(symbol, eqs.model.states), "u": map(symbol, eqs.model.inputs), "c": eqs.constants}
    loads = {name: f"get({array}, {i})" for array, names in arrays.items() for i, name in enumerate(names)}

    def there(condition: frozenset[str]) -> str:
        return f"c[{eqs.condition_row(condition)}, 0] > 0.0"

    read = [root for root in roots if root not in stored]
    return branches.lines(assignments, read, text, loads, there, stored)


def function(name: str, arguments: str, lines: Sequence[str]) -> str:
    """Return a compiled function's source text."""
    return "\n".join(["@jit", f"def {name}({arguments}):", *(f"    {line}" for line in lines or ["pass"])])


def kernel(eqs: Equations, name: str, arguments: str, stores: Sequence[Assignment], zeros: bool = True) -> str:
    """Return a kernel that computes expressions of states, inputs and constants and stores them.

    Args:
        eqs: The model.
        name: Of the kernel.
        arguments: Of the kernel.
        stores: Expressions and where they go.
        zeros: Whether what is zero because its effect is absent is stored as well.
    """
    roots = [expr for expr, _ in stores]
    read = Counter(s for expr in (*eqs.assignments.values(), *roots) for s in expr.free_symbols)
    early = {expr: to for expr, to in stores if not zeros and read[expr] == 1 and eqs.vanishes_without(expr)}
    late = [f"put({text(expr)}, {where})" for expr, where in stores if expr not in early]
    return function(name, arguments, body(eqs, roots, early) + late)


def constants_kernel(eqs: Equations) -> str:
    """Return the kernel that computes the constants of batches from their parameters."""
    read = set().union(*(e.free_symbols for e in eqs.constants.values())) if eqs.constants else set()
    names = eqs.model.parameter_names
    lines = [f"{name} = get(p, b, {i})" for i, name in enumerate(names) if symbol(name) in read]
    for i, (name, expr) in enumerate(eqs.constants.items()):
        lines += [f"{name} = {text(expr)}", f"put({name}, c, b, {i})"]
    return function(
        "constants", "p, c", ["for b in range(p.shape[0]):", *(f"    {line}" for line in lines or ["pass"])]
    )
