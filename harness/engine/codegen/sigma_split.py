"""What of a step depends on the leading states only, so that sigma points with the same leading states share it.

The Cholesky factor is lower triangular: a sigma point along column ``k`` has the mean's states before ``k``. Whatever
depends on these alone is the same for all points from that column on and is computed once, at the mean.
"""

from __future__ import annotations

import dataclasses

import sympy as sp

from harness.engine.codegen.derivatives import Equations, needed
from harness.engine.codegen.lift import Lift
from harness.engine.codegen.printer import body, function, text, vector
from harness.models.assembly.assemble import symbol

_COST = {sp.atan: 25, sp.sin: 20, sp.cos: 20, sp.tan: 35, sp.exp: 20, sp.log: 20, sp.tanh: 30}
"""Vector instructions of the elementary functions, about; a sum or product takes one."""

_DIVISION = 8
_WORTH = 0.9
"""A split is made where it leaves at most this share of the instructions; less would not pay for its compilation."""


@dataclasses.dataclass(frozen=True)
class SigmaSplit:
    """A step in two parts.

    Attributes:
        leading: Number of leading states; that of all states where a split does not pay.
        shared: Number of quantities handed over in the work array.
        sources: Source texts of ``leading_part(x, u, c, w)``, which hands them over, and of
            ``next_state_behind(x, u, c, xn, w)``, which takes them up.
    """

    leading: int
    shared: int
    sources: tuple[str, str]


def sigma_split(eqs: Equations, ahead: list[sp.Expr]) -> SigmaSplit:
    """Return the split that costs least over all sigma points.

    Args:
        eqs: The model.
        ahead: Next value of each state.
    """
    leading = _cheapest(eqs, ahead)
    states = [symbol(name) for name in eqs.model.states]
    if leading == len(states):
        return whole(leading)
    late = set(states[leading:])
    used = needed(eqs.assignments, ahead)
    fixed = set().union(*(e.free_symbols for e in (*ahead, *used.values()))) - late - used.keys()
    lift = Lift(fixed, "k", atoms=False)
    behind: dict[sp.Symbol, sp.Expr] = {}
    for name, expr in used.items():
        lifted = lift(expr)
        if lift.holds(lifted):
            lift.alias(name, lifted)
        else:
            behind[name] = lifted
    roots = [lift(expr) for expr in ahead]
    read = set().union(*(e.free_symbols for e in (*roots, *needed(behind, roots).values())))
    shared = [name for name in lift.named if name in read]
    first = body(dataclasses.replace(eqs, assignments=lift.named), shared)
    first += [f"put({name}, w, {i})" for i, name in enumerate(shared)]
    then = [f"{name} = get(w, {i})" for i, name in enumerate(shared)]
    then += body(dataclasses.replace(eqs, assignments=behind), roots)
    then += [f"put({text(expr)}, {where})" for expr, where in vector("xn", roots)]
    sources = function("leading_part", "x, u, c, w", first), function("next_state_behind", "x, u, c, xn, w", then)
    return SigmaSplit(leading, len(shared), sources)


def whole(states: int) -> SigmaSplit:
    """Return no split: every point goes through the whole step."""
    nothing = function("leading_part", "x, u, c, w", []), function("next_state_behind", "x, u, c, xn, w", [])
    return SigmaSplit(states, 0, nothing)


def _cheapest(eqs: Equations, ahead: list[sp.Expr]) -> int:
    """Return the number of leading states at which the points along all columns cost least together."""
    nx = len(ahead)
    if eqs.model.flags:  # what an absent effect would read is skipped in blocks, which a split would tear apart
        return nx
    cost, moved = _costs_by_last_state(eqs, ahead), 3 * nx  # a state is displaced, loaded and stored

    def total(leading: int) -> int:
        behind, before = sum(cost[leading:nx]), sum(cost[:leading]) + cost[nx]
        return (2 * leading + 1) * (before + behind + moved) + before + 2 * (nx - leading) * (behind + moved)

    best = min(range(nx), key=total)
    return best if total(best) <= _WORTH * (2 * nx + 1) * (sum(cost) + moved) else nx


def _costs_by_last_state(eqs: Equations, ahead: list[sp.Expr]) -> list[int]:
    """Return instructions by the last state that they depend on; at the end those that depend on none."""
    last = {symbol(name): i for i, name in enumerate(eqs.model.states)}
    cost = [0] * (len(ahead) + 1)
    seen: dict[sp.Expr, int] = {}

    def visit(expr: sp.Expr) -> int:
        if expr.is_Atom:
            return last.get(expr, -1)
        if expr not in seen:
            at = sorted(visit(a) for a in expr.args)
            seen[expr] = at[-1]
            if expr.is_Add or expr.is_Mul:
                for index in at[1:]:  # terms of few states are put together first
                    cost[index] += 1
            elif expr.is_Pow and expr.exp.is_Integer:
                cost[at[-1]] += _DIVISION if expr.exp.is_negative else 1
            else:
                cost[at[-1]] += _COST.get(expr.func, _DIVISION if expr.is_Pow else 1)
        return seen[expr]

    for name, expr in needed(eqs.assignments, ahead).items():
        last[name] = visit(expr)
    for expr in ahead:
        visit(expr)
    return cost
