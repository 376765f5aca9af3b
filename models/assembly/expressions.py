"""The larger and the smaller of two expressions, without SymPy's search for a simpler form; effects that may be absent.

``sympy.Max`` compares its arguments symbolically every time an expression is rebuilt, which takes minutes for the
loads of a two-track car. These say the same and leave the arguments alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import sympy as sp


class _Extreme(sp.Function):
    """Common part: numbers are compared, anything else stays as it is."""

    nargs = 2
    _numpy = _python = ""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative to one argument: 1 where it is the chosen one, else 0."""
        chosen, other = self.args if argindex == 1 else reversed(self.args)
        return sp.Heaviside(self._ahead(chosen, other))

    def _eval_is_extended_real(self) -> bool:
        return True

    def _pythoncode(self, printer: Any) -> str:
        return f"{self._python}({', '.join(printer._print(a) for a in self.args)})"

    def _lanecode(self, printer: Any) -> str:
        # the kernels' maximum and minimum keep a NaN of their first argument, which must not be the constant
        first, second = sorted(self.args, key=lambda a: a.is_number)
        return f"{self._numpy}({printer._print(first)}, {printer._print(second)})"

    def _numpycode(self, printer: Any) -> str:
        return f"numpy.{self._numpy}({', '.join(printer._print(a) for a in self.args)})"

    _scipycode = _numpycode


class larger(_Extreme):
    """The larger of two expressions."""

    _numpy, _python = "maximum", "max"

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr) -> sp.Expr | None:
        """Return a number for two numbers, else leave the expression."""
        return (a if a >= b else b) if a.is_number and b.is_number else None

    def _ahead(self, chosen: sp.Expr, other: sp.Expr) -> sp.Expr:
        return chosen - other

    def _latex(self, printer: Any) -> str:
        return rf"\max\left({', '.join(printer._print(a) for a in self.args)}\right)"


class smaller(_Extreme):
    """The smaller of two expressions."""

    _numpy, _python = "minimum", "min"

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr) -> sp.Expr | None:
        """Return a number for two numbers, else leave the expression."""
        return (a if a <= b else b) if a.is_number and b.is_number else None

    def _ahead(self, chosen: sp.Expr, other: sp.Expr) -> sp.Expr:
        return other - chosen

    def _latex(self, printer: Any) -> str:
        return rf"\min\left({', '.join(printer._print(a) for a in self.args)}\right)"


class present(sp.Function):
    """``present(flag, with_effect, without)``: the second where an effect is in force, else the third.

    The flag is a symbol, of one effect or from ``any_of``. Kernels branch on it and do not compute what only the other
    case reads.
    """

    nargs = 3

    @classmethod
    def eval(cls, flag: sp.Symbol, with_effect: sp.Expr, without: sp.Expr) -> sp.Expr | None:
        """Return what both cases have in common, if they are alike."""
        return without if with_effect == without else None

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative to one of the cases; the flag is no variable."""
        return present(self.args[0], sp.Integer(argindex == 2), sp.Integer(argindex == 3))

    def _eval_is_extended_real(self) -> bool:
        return True


def any_of(flags: Iterable[sp.Symbol]) -> sp.Symbol:
    """Return the flag that is set if one of several is."""
    return sp.Symbol(" or ".join(sorted(f.name for f in flags)), real=True)


def flags_in(flag: sp.Symbol) -> frozenset[str]:
    """Return the names of the flags of which one suffices."""
    return frozenset(flag.name.split(" or "))
