"""Algebraic loops between ports, such as an angle that yields to the force that it makes: Newton's method, unrolled.

A port that an effect defines by an expression which leads back to it is the root of ``u - g(u) = 0``. Two steps from
zero solve it, for a tyre whose force bends over: to 1e-5 of the force with a loop gain of 0.4, to 1.5e-3 with 1. A loop
of gain zero stays at zero exactly, and its slope there is exact. Each step is the chain of ports again, so that a third
would cost a trace a tenth of its compilation.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.expressions import present
from harness.models.assembly.model import symbol

_STEPS = 2


def solve_loops(ports: Mapping[str, sp.Expr], loops: Collection[str]) -> list[dict[str, sp.Expr]]:
    """Return for each port that depends on itself the ports by which it follows from others, itself last.

    Args:
        ports: By name, in any order.
        loops: Those that may depend on themselves.

    Raises:
        ModelError: If one of them depends on another and that on it.
    """
    solved: list[dict[str, sp.Expr]] = []
    for name in loops:
        around = _around(ports, name)
        if not around:
            continue
        entangled = next((port for port in around if port in loops and port != name), None)
        if entangled:
            raise ModelError(f"'{name}' and '{entangled}' depend on each other; leave out the effect of one of them")
        steps, at = dict[str, sp.Expr](), sp.Integer(0)
        for k in range(1, _STEPS + 1):
            value, slope = _value_and_slope(around, name, at)
            after = name if k == _STEPS else f"{name}_before_step_{k + 1}"
            steps[after] = at - (at - value) / (1 - slope)
            at = symbol(after)
        solved.append(steps)
    return solved


def depends(ports: Mapping[str, sp.Expr], expr: sp.Expr, name: str) -> bool:
    """Return whether an expression reads a port, directly or through others."""
    seen: set[str] = set()
    pending = [s.name for s in expr.free_symbols]
    while pending:
        read = pending.pop()
        if read == name:
            return True
        if read in ports and read not in seen:
            seen.add(read)
            pending += [s.name for s in ports[read].free_symbols]
    return False


def _around(ports: Mapping[str, sp.Expr], name: str) -> dict[str, sp.Expr]:
    """Return the ports through which one depends on itself, in order of use, itself last; none if it does not.

    Effects that may be absent are taken as there: at their neutral values that is the same.
    """
    around: dict[str, sp.Expr] = {}

    def visit(port: str) -> bool:
        if port not in around and depends({p: e for p, e in ports.items() if p != name}, ports[port], name):
            for read in sorted(s.name for s in ports[port].free_symbols if s.name in ports and s.name != name):
                visit(read)
            around[port] = ports[port].replace(present, lambda flag, with_effect, without: with_effect)
        return port in around

    visit(name)
    return around


def _value_and_slope(around: Mapping[str, sp.Expr], name: str, at: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Return the definition of a port as a function of itself at a value, and its derivative."""
    written: dict[sp.Symbol, sp.Expr] = {symbol(name): at}
    slopes: dict[sp.Symbol, sp.Expr] = {symbol(name): sp.Integer(1)}
    for port, expr in around.items():
        inner = sorted(expr.free_symbols & slopes.keys(), key=str)
        parts = [expr.diff(s).replace(sp.DiracDelta, lambda *_: sp.Integer(0)) * slopes[s] for s in inner]
        value, slope = expr.xreplace(written), sp.Add(*parts).xreplace(written)
        if port == name:
            return value, slope
        written[symbol(port)], slopes[symbol(port)] = value, slope
    raise AssertionError(f"'{name}' is last around itself")
