"""Source text of the sampled model: one step ahead, whole and in two parts, its Jacobian and the propagated covariance.

A discrete model is its own step. Explicit Euler (Ziaukas 2.9) is unrolled over the non-zero entries of the
Jacobian. Heun and RK4, and several substeps per sample, chain the same derivatives with dense products.

The Cholesky factor is lower triangular: a sigma point along column ``k`` has the mean's states before ``k``. Whatever
depends on these alone is the same for all points from that column on and is computed once, at the mean.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import sympy as sp

from harness.engine.codegen.derivatives import Entries, Equations, Lift, needed
from harness.engine.codegen.printer import body, function, kernel, matrix, text, vector
from harness.models.assembly.assemble import symbol

TABLEAUX = {
    "euler": ((0.0,), (1.0,)),
    "heun": ((0.0, 1.0), (0.5, 0.5)),
    "rk4": ((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}
"""Stages of each method: fractions of the step behind its beginning, and weights of the slopes there."""


@dataclass(frozen=True)
class Step:
    """The sampled model.

    Attributes:
        work: Length of the work array that its kernels need.
        leading: Number of leading states of its split (``harness.engine.codegen.integrators``).
        sources: Source texts of ``next_state`` and, where Jacobians are wanted, theirs and those of the split.
    """

    work: int
    leading: int
    sources: list[str]


def sampled(eqs: Equations, step: float, integrator: str, substeps: int, jacobians: bool = True) -> Step:
    """Return one step ahead; that of a discrete model is its own and takes any integrator.

    Args:
        eqs: The model.
        step: Sample time in s.
        integrator: Name of the integrator.
        substeps: Its steps per sample.
        jacobians: Whether anything but ``next_state`` is wanted.
    """
    nx = len(eqs.derivatives)
    if eqs.model.discrete:
        ahead, A = eqs.derivatives, eqs.state_jacobian
    elif (integrator, substeps) == ("euler", 1):
        ahead, A = _euler(eqs, step)
    else:
        behind, weight = TABLEAUX[integrator]
        sizes = f"H, SUBSTEPS, STAGES = {step / substeps!r}, {substeps}, {len(weight)}\n"
        sizes += f"BEHIND = np.array({list(behind)!r})\nWEIGHT = np.array({list(weight)!r})"
        staged = f"{sizes}\n\n\n{_staged_state(eqs)}"
        further = [_STAGED_JACOBIAN.strip(), *whole(nx).sources] if jacobians else []
        return Step(4 * nx + 5 * nx * nx, nx, [staged, *further])
    plain = kernel(eqs, "next_state", "x, u, c, xn, w", vector("xn", ahead))
    if not jacobians:
        return Step(nx * nx, nx, [plain])
    split = sigma_split(eqs, ahead)
    jacobian = kernel(eqs, "next_jacobian", "x, u, c, xn, A, w", vector("xn", ahead) + matrix("A", A, nx, nx))
    return Step(
        max(nx * nx, split.shared),
        split.leading,
        [plain, jacobian, *_sparse_covariances(eqs, ahead, A), *split.sources],
    )


def _euler(eqs: Equations, step: float) -> tuple[list[sp.Expr], Entries]:
    x = [symbol(name) for name in eqs.model.states]
    h = sp.Float(step)
    ahead = [x[i] + h * f if f != 0 else x[i] for i, f in enumerate(eqs.derivatives)]
    A: Entries = {key: h * value for key, value in eqs.state_jacobian.items()}
    for i in range(len(x)):
        A[i, i] = 1 + A.get((i, i), sp.Integer(0))
    return ahead, A


def _staged_state(eqs: Equations) -> str:
    """Return ``next_state`` in stages; of a model with many effects that may be absent most states rest."""
    flags = [eqs.vanishes_without(f) for f in eqs.derivatives]
    if not any(flags):
        return _STAGED_STATE.format(stay="", skip="").strip()
    rows = [eqs.condition_row(f) if f else -1 for f in flags]
    return f"MOVES = np.array({rows!r})\n\n\n{_STAGED_STATE.format(stay=_STAY, skip=_SKIP).strip()}"


def _sparse_covariances(eqs: Equations, ahead: list[sp.Expr], A: Entries) -> tuple[str, str]:
    """Write M = A P and M A' over the non-zero entries of A only; the result is symmetric by construction.

    The rows of A are unrolled and the other index is a loop, which compiles ten times faster than unrolling
    both and runs as fast.

    Returns:
        ``next_covariance`` and ``next_linear``, which adds what A does to a deviation from the state.
    """
    nx = len(ahead)
    slopes = [*body(eqs, [*ahead, *A.values()]), "M = w[: NX * NX].reshape((NX, NX, LANES))"]
    slopes += [f"a_{i}_{j} = {text(value)}" for (i, j), value in sorted(A.items()) if value != 1]

    def row(i: int, operand: str) -> str:
        terms = ((j, operand.format(j=j)) for j in range(nx) if (i, j) in A)
        return " + ".join(term if A[i, j] == 1 else f"a_{i}_{j}*{term}" for j, term in terms) or "splat(0.0)"

    products = []
    for i in range(nx):
        products += ["for k in range(NX):", f"    put({row(i, 'get(P, {j}, k)')}, M, {i}, k)"]
    for m in range(nx):
        products += [f"for i in range({m}, NX):", f"    r = {row(m, 'get(M, i, {j})')}"]
        products += [f"    put(r, Pn, i, {m})", f"    put(r, Pn, {m}, i)"]
    there = [f"put({text(expr)}, xn, {i})" for i, expr in enumerate(ahead)]
    moved = [f"put({text(expr)} + {row(i, 'get(d, {j})')}, xn, {i})" for i, expr in enumerate(ahead)]
    return (
        function("next_covariance", "x, u, c, P, xn, Pn, w", [*slopes, *products, *there]),
        function("next_linear", "x, u, c, d, P, xn, Pn, w", [*slopes, *moved, *products]),
    )


_STAGED_STATE = """
@jit
def next_state(x, u, c, xn, w):
    stage, slope, total = w[:NX], w[NX : 2 * NX], w[2 * NX : 3 * NX]
    for i in range(NX):
        put(get(x, i), xn, i){stay}
    for _ in range(SUBSTEPS):
        for s in range(STAGES):
            if s == 0:
                drift(xn, u, c, slope)
            else:
                drift(stage, u, c, slope)
            for i in range(NX):{skip}
                k = get(slope, i)
                r = WEIGHT[s] * k
                if s > 0:
                    r = get(total, i) + r
                if s + 1 < STAGES:
                    put(r, total, i)
                    put(get(xn, i) + H * BEHIND[s + 1] * k, stage, i)
                else:
                    put(get(xn, i) + H * r, xn, i)
"""

_STAY = """
        put(get(x, i), stage, i)"""

_SKIP = """
                if MOVES[i] >= 0 and c[MOVES[i], 0] <= 0.0:
                    continue  # the state of an absent effect: it rests, and its slope is not written"""

_STAGED_JACOBIAN = """
@jit
def next_jacobian(x, u, c, xn, A, w):
    start, stage, slope = w[:NX], w[NX : 2 * NX], w[2 * NX : 3 * NX]
    total = w[3 * NX : 4 * NX]
    block = w[4 * NX :].reshape((5, NX, NX, LANES))
    J, K, K_before, K_total, Phi = block[0], block[1], block[2], block[3], block[4]
    for i in range(NX):
        put(get(x, i), start, i)
        for j in range(NX):
            put(1.0 if i == j else 0.0, Phi, i, j)
    for _ in range(SUBSTEPS):
        for i in range(NX):
            put(get(start, i), stage, i)
            put(0.0, total, i)
            for j in range(NX):
                put(0.0, K_total, i, j)
                put(0.0, K_before, i, j)
        for s in range(STAGES):
            if s > 0:
                for i in range(NX):
                    put(get(start, i) + H * BEHIND[s] * get(slope, i), stage, i)
            drift(stage, u, c, slope)
            drift_jacobian(stage, u, c, J)
            # d slope_s / d start = J (Phi + H BEHIND d slope_(s-1) / d start)
            for i in range(NX):
                put(get(total, i) + WEIGHT[s] * get(slope, i), total, i)
                for j in range(NX):
                    r = splat(0.0)
                    for k in range(NX):
                        r = r + get(J, i, k) * (get(Phi, k, j) + H * BEHIND[s] * get(K_before, k, j))
                    put(r, K, i, j)
                    put(get(K_total, i, j) + WEIGHT[s] * r, K_total, i, j)
            for i in range(NX):
                for j in range(NX):
                    put(get(K, i, j), K_before, i, j)
        for i in range(NX):
            put(get(start, i) + H * get(total, i), start, i)
            for j in range(NX):
                put(get(Phi, i, j) + H * get(K_total, i, j), Phi, i, j)
    for i in range(NX):
        put(get(start, i), xn, i)
        for j in range(NX):
            put(get(Phi, i, j), A, i, j)


@jit
def next_linear(x, u, c, d, P, xn, Pn, w):
    A = w[4 * NX :].reshape((5, NX, NX, LANES))[4]
    next_covariance(x, u, c, P, xn, Pn, w)
    for i in range(NX):
        r = get(xn, i)
        for j in range(NX):
            r = r + get(A, i, j) * get(d, j)
        put(r, xn, i)


@jit
def next_covariance(x, u, c, P, xn, Pn, w):
    block = w[4 * NX :].reshape((5, NX, NX, LANES))
    M, A = block[0], block[4]
    next_jacobian(x, u, c, xn, A, w)
    for i in range(NX):
        for k in range(NX):
            r = splat(0.0)
            for j in range(NX):
                r = r + get(A, i, j) * get(P, j, k)
            put(r, M, i, k)
    for i in range(NX):
        for m in range(i, NX):
            r = splat(0.0)
            for k in range(NX):
                r = r + get(M, i, k) * get(A, m, k)
            put(r, Pn, i, m)
            put(r, Pn, m, i)
"""


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
