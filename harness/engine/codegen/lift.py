"""Replace subexpressions that read nothing but given quantities by names of their own."""

from __future__ import annotations

import sympy as sp


class Lift:
    """Replaces every subexpression that reads the given symbols only by a named one.

    Args:
        fixed: The symbols.
        prefix: Of the names.
        atoms: Whether a symbol that stands alone is given a name as well.

    Attributes:
        named: What was named, in order; later ones read earlier ones.
    """

    def __init__(self, fixed: set[sp.Symbol], prefix: str, atoms: bool) -> None:
        self._fixed, self._prefix, self._atoms = set(fixed), prefix, atoms
        self._alias: dict[sp.Symbol, sp.Expr] = {}
        self._names: dict[sp.Expr, sp.Symbol] = {}
        self.named: dict[sp.Symbol, sp.Expr] = {}

    def holds(self, expr: sp.Expr) -> bool:
        """Return whether an expression reads the given symbols only."""
        return expr.free_symbols <= self._fixed

    def alias(self, name: sp.Symbol, expr: sp.Expr) -> None:
        """Let an assignment that was lifted whole stand for what it was lifted to everywhere."""
        self._alias[name] = expr

    def __call__(self, expr: sp.Expr) -> sp.Expr:
        """Return the expression with what can be lifted named."""
        expr = expr.xreplace({s: self._alias[s] for s in expr.free_symbols if s in self._alias})
        return self._visit(expr)

    def _name(self, expr: sp.Expr) -> sp.Expr:
        if expr.is_number or expr in self.named or (expr.is_Atom and not self._atoms):
            return expr
        if expr not in self._names:
            name = sp.Symbol(f"{self._prefix}_{len(self.named)}", real=True)
            self._names[expr] = name
            self._fixed.add(name)
            self.named[name] = expr
        return self._names[expr]

    def _visit(self, expr: sp.Expr) -> sp.Expr:
        if expr.is_number:
            return expr
        if self.holds(expr):
            return self._name(expr)
        if expr.is_Atom:
            return expr
        if expr.is_Add or expr.is_Mul:
            fixed = [a for a in expr.args if self.holds(a)]
            rest = [self._visit(a) for a in expr.args if not self.holds(a)]
            if all(a.is_number for a in fixed):
                return expr.func(*fixed, *rest)
            sign = -1 if expr.is_Mul and expr.func(*fixed).could_extract_minus_sign() else 1
            return expr.func(sign * self._name(sign * expr.func(*fixed)), *rest)
        return expr.func(*(self._visit(a) for a in expr.args))
