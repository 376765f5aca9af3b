"""Source text that skips what only an absent effect would read (``harness.models.assembly.expressions.present``).

An assignment that is read in the presence of some effects only is computed if one of them is there. Assignments with
the same condition stand together, so that a kernel branches some hundred times per call at most, always the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

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


def lines(
    assignments: Assignments,
    roots: Sequence[sp.Expr],
    text: Callable[[sp.Expr], str],
    loads: Mapping[sp.Symbol, str],
    there: Callable[[frozenset[str]], str],
    stored: Mapping[sp.Symbol, str],
) -> list[str]:
    """Return assignments, in order of use, as source text with branches.

    What is read under a condition only is loaded there: of a model with many effects there are more numbers than
    registers, so that what is loaded in front of all branches is stored again at once, read or not.

    Args:
        assignments: With every choice an assignment of its own.
        roots: What is read of them afterwards.
        text: Prints an expression.
        loads: What loads each symbol that is no assignment.
        there: Gives the test whether one of some flags is set.
        stored: Where choices that nothing else reads are stored as they are made, and not at all without their effects.
    """
    if not any(isinstance(e, present) for e in assignments.values()):
        loaded = _loaded([*assignments.values(), *roots], loads)
        return loaded + [f"{name} = {text(expr)}" for name, expr in assignments.items()]
    conditions = _conditions(assignments, roots)
    blocks = list(_blocks(assignments, conditions))
    code = [f"{name} = splat(0.0)" for name in _crossing(assignments, conditions, blocks)]
    remaining = dict(loads)

    def block(read: Mapping[sp.Symbol, sp.Expr]) -> list[str]:
        return [*_loaded(read.values(), remaining), *(line(name, expr) for name, expr in read.items())]

    def line(name: sp.Symbol, expr: sp.Expr) -> str:
        if name in stored:
            return f"put({text(expr)}, {stored[name]})"
        return f"{name} = {_lane(expr, text) if isinstance(assignments[name], present) else text(expr)}"

    for condition, names in blocks:
        every = {name: assignments[name] for name in names}
        choices = {name: expr.args[1:] for name, expr in every.items() if isinstance(expr, present)}
        if condition is None:
            code += block(every)
            for s in set().union(*(e.free_symbols for e in every.values())):
                remaining.pop(s, None)
            continue
        code += [f"if {there(condition)}:  # {' or '.join(sorted(condition))}"]
        code += _indented(block(every | {name: with_it for name, (with_it, _) in choices.items()}))
        others = {name: without for name, (_, without) in choices.items() if name not in stored}
        if others:
            code += ["else:", *_indented(block(others))]
    return code + _loaded(roots, remaining)


def _loaded(read: Iterable[sp.Expr], loads: Mapping[sp.Symbol, str]) -> list[str]:
    """Return the lines that load what expressions read."""
    names = set().union(*(e.free_symbols for e in read))
    return [f"{name} = {how}" for name, how in loads.items() if name in names]


def _indented(block: Iterable[str]) -> list[str]:
    return [f"    {line}" for line in block]


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
    remaining = dict.fromkeys(assignments)

    def ready(name: sp.Symbol) -> bool:
        return not any(s in remaining for s in assignments[name].free_symbols)

    while remaining:
        able = [name for name in remaining if ready(name)]
        condition = None if any(conditions[name] is None for name in able) else conditions[able[0]]
        block: list[sp.Symbol] = []
        for name in list(remaining):
            if conditions[name] == condition and ready(name):
                block.append(name)
                del remaining[name]
        yield condition, block


def _crossing(
    assignments: Assignments,
    conditions: dict[sp.Symbol, Condition],
    blocks: Iterable[tuple[Condition, list[sp.Symbol]]],
) -> list[sp.Symbol]:
    """Return what is computed under a condition and read in another block; the compiler wants it always defined."""
    home = {name: i for i, (_, names) in enumerate(blocks) for name in names}
    crossing = dict.fromkeys(
        s
        for name, expr in assignments.items()
        for s in sorted(expr.free_symbols & assignments.keys(), key=str)
        if conditions[s] is not None and not isinstance(assignments[s], present) and home[s] != home[name]
    )
    return list(crossing)
