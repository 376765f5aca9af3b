"""Algebraic loops between ports, such as an angle that yields to the force that it makes: Newton's method, unrolled.

A port that an effect defines by an expression which leads back to it is the root of ``u - g(u) = 0``. Three steps from
zero solve it: for a tyre whose force bends over and a loop gain below 1 to 1e-6 of the force. A loop of gain zero stays
at zero exactly, and its slope there is exact.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.expressions import present
from harness.models.assembly.model import symbol

_STEPS = 3


def solve_loops(ports: Mapping[str, sp.Expr], loops: Collection[str]) -> dict[str, sp.Expr]:
    """Return ports in which those that depend on themselves follow from earlier ones.

    Args:
        ports: By name, in any order.
        loops: Those that may depend on themselves.

    Raises:
        ModelError: If one of them depends on another and that on it.
    """
    solved = dict(ports)
    for name in loops:
        written = _written_out(ports, name, loops)
        if not written.has(symbol(name)):
            continue
        residual = symbol(name) - written
        step = residual / residual.diff(symbol(name))
        at: sp.Expr = sp.Integer(0)
        for k in range(1, _STEPS + 1):
            before = name if k == _STEPS else f"{name}_before_step_{k + 1}"
            solved[before] = at - step.xreplace({symbol(name): at})
            at = symbol(before)
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


def _written_out(ports: Mapping[str, sp.Expr], name: str, loops: Collection[str]) -> sp.Expr:
    """Return the definition of a port with every port that depends on it substituted.

    Effects that may be absent are taken as there: at their neutral values that is the same.
    """
    others = {port: expr for port, expr in ports.items() if port != name}
    expr = ports[name]
    while True:
        expr = expr.replace(present, lambda flag, with_effect, without: with_effect)
        inner = {s: others[s.name] for s in expr.free_symbols if s.name in others and depends(others, s, name)}
        entangled = sorted(s.name for s in inner if s.name in loops)
        if entangled:
            raise ModelError(f"'{name}' and '{entangled[0]}' depend on each other; leave out the effect of one of them")
        if not inner:
            return expr
        expr = expr.xreplace(inner)
