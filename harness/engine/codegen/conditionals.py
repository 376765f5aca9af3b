"""Source text that skips what only an absent effect would read (``harness.models.assembly.expressions.present``).

An assignment that is read in the presence of some effects only is computed if one of them is there. Assignments with
the same condition stand together, so that a kernel branches a few dozen times per call, always the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import sympy as sp

from harness.models.assembly.expressions import flags_in, present

Assignments = dict[sp.Symbol, sp.Expr]
Condition = frozenset[str] | None
"""Flags of which one must be set; ``None`` for always."""


def hoisted(expr: sp.Expr, assignments: Assignments, top: bool = False) -> sp.Expr:
    """Return an expression with every choice in it named; the choices go to the assignments.

    Args:
        expr: The expression.
        assignments: Grows by the names.
        top: Whether the expression is an assignment itself and may be a choice as it stands.
    """
    if not expr.has(present):
        return expr
    expr = expr.func(*(hoisted(a, assignments) for a in expr.args))
    if top or not isinstance(expr, present):
        return expr
    name = sp.Symbol(f"g_{len(assignments)}", real=True)
    assignments[name] = expr
    return name


def lines(assignments: Assignments, roots: Iterable[sp.Expr], text: Callable[[sp.Expr], str]) -> list[str]:
    """Return assignments, in order of use, as source text with branches.

    Args:
        assignments: With every choice an assignment of its own.
        roots: What is read of them afterwards.
        text: Prints an expression.
    """
    if not any(isinstance(e, present) for e in assignments.values()):
        return [f"{name} = {text(expr)}" for name, expr in assignments.items()]
    conditions = _conditions(assignments, roots)
    blocks = list(_blocks(assignments, conditions))
    found = [f"{name} = splat(0.0)" for name in _crossing(assignments, conditions, blocks)]
    for condition, names in blocks:
        indent = "    " if condition is not None else ""
        if condition is not None:
            found.append(f"if {' or '.join(sorted(condition))}:")
        skipped = []
        for name in names:
            expr = assignments[name]
            if not isinstance(expr, present):
                found.append(f"{indent}{name} = {text(expr)}")
                continue
            _, with_effect, without = expr.args
            found.append(f"{indent}{name} = {_lane(with_effect, text)}")
            skipped.append(f"    {name} = {_lane(without, text)}")
        if skipped:
            found += ["else:", *skipped]
    return found


def _lane(expr: sp.Expr, text: Callable[[sp.Expr], str]) -> str:
    """Return an expression that is a lane even if it is a number; both branches need the same type."""
    return f"splat({text(expr)})" if expr.is_number else text(expr)


def _conditions(assignments: Assignments, roots: Iterable[sp.Expr]) -> dict[sp.Symbol, Condition]:
    """Return when each assignment is read; a choice is made where its flag says, whoever reads it."""
    read: dict[sp.Symbol, Condition] = {s: None for r in roots for s in r.free_symbols if s in assignments}

    def note(expr: sp.Expr, condition: Condition) -> None:
        for s in expr.free_symbols & assignments.keys():
            before = read.get(s, frozenset())
            read[s] = None if condition is None or before is None else before | condition

    for name in reversed(assignments):
        expr, condition = assignments[name], read.get(name, frozenset())
        if isinstance(expr, present):
            flag, with_effect, without = expr.args
            note(with_effect, flags_in(flag))
            note(without, condition)
        else:
            note(expr, condition)
    return {
        name: flags_in(expr.args[0]) if isinstance(expr, present) else read[name] for name, expr in assignments.items()
    }


def _blocks(
    assignments: Assignments, conditions: dict[sp.Symbol, Condition]
) -> Iterator[tuple[Condition, list[sp.Symbol]]]:
    """Yield conditions and what is computed under them, so that everything is computed before it is read.

    What is always computed comes as early as it can, so that a condition waits until most of its block is ready.
    """
    left = dict.fromkeys(assignments)

    def ready(name: sp.Symbol) -> bool:
        return not any(s in left for s in assignments[name].free_symbols)

    while left:
        able = [name for name in left if ready(name)]
        condition = None if any(conditions[name] is None for name in able) else conditions[able[0]]
        block: list[sp.Symbol] = []
        for name in list(left):
            if conditions[name] == condition and ready(name):
                block.append(name)
                del left[name]
        yield condition, block


def _crossing(
    assignments: Assignments,
    conditions: dict[sp.Symbol, Condition],
    blocks: Iterable[tuple[Condition, list[sp.Symbol]]],
) -> list[sp.Symbol]:
    """Return what is computed under a condition and read in another block; the compiler wants it always defined."""
    home = {name: i for i, (_, names) in enumerate(blocks) for name in names}
    found = dict.fromkeys(
        s
        for name, expr in assignments.items()
        for s in sorted(expr.free_symbols & assignments.keys(), key=str)
        if conditions[s] is not None and not isinstance(assignments[s], present) and home[s] != home[name]
    )
    return list(found)
