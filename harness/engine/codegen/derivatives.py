"""Turn a model's equations into straight-line assignments, with every derivative that is not zero.

The equations are expanded into states, inputs and parameters, shared subexpressions are named once, and
derivatives are carried along the assignments (forward mode), so nothing is differentiated twice and structural
zeros stay zeros. Whatever depends on parameters alone is lifted out as a *constant*, computed once per run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import sympy as sp

from harness.engine.codegen.conditionals import hoisted
from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.assembly.expressions import flags_in, present

Entries = dict[tuple[int, int], sp.Expr]
"""Non-zero entries of a matrix by (row, column)."""


@dataclass(frozen=True)
class Equations:
    """Straight-line form of a model.

    Attributes:
        model: The model the equations belong to.
        constants: Assignments that read parameters only, in order; computed once per run.
        assignments: Assignments that read states, inputs, constants and earlier assignments.
        derivatives: Time derivative of each state; of a discrete model its value one sample later.
        outputs: Measured outputs.
        signals: Further quantities by name.
        signal_jacobian: d signals / d states.
        state_jacobian: d derivatives / d states.
        input_jacobian: d derivatives / d inputs.
        parameter_jacobian: d derivatives / d parameters asked for.
        output_state_jacobian: d outputs / d states.
        output_input_jacobian: d outputs / d inputs.
        output_parameter_jacobian: d outputs / d parameters asked for.
        parameters: Names of the parameters asked for.
        within: States of parameters, each within the bounds of its parameter.
        conditions: Flags of which one must be set, with the number of the row behind the constants that says whether
            one is; grows with what kernels ask for.
    """

    model: StateSpaceModel
    constants: dict[sp.Symbol, sp.Expr]
    assignments: dict[sp.Symbol, sp.Expr]
    derivatives: list[sp.Expr]
    outputs: list[sp.Expr]
    signals: dict[str, sp.Expr]
    signal_jacobian: Entries
    state_jacobian: Entries
    input_jacobian: Entries
    parameter_jacobian: Entries
    output_state_jacobian: Entries
    output_input_jacobian: Entries
    output_parameter_jacobian: Entries
    parameters: tuple[str, ...]
    within: list[sp.Expr]
    conditions: dict[frozenset[str], int] = field(default_factory=dict)

    def condition_row(self, flags: frozenset[str]) -> int:
        """Return the row of constants that is positive where one of some flags is set."""
        return len(self.constants) + self.conditions.setdefault(flags, len(self.conditions))

    def vanishes_without(self, expr: sp.Expr) -> frozenset[str]:
        """Return the flags of which one must be set for an expression to differ from zero; none if it always may."""
        choice = self.assignments.get(expr, expr)
        return flags_in(choice.args[0]) if isinstance(choice, present) and choice.args[2] == 0 else frozenset()

    def slope_varies(self, state: str) -> bool:
        """Return whether the influence of a parameter's state depends on states that are no parameters."""
        column = self.model.states.index(state)
        moving = {symbol(n) for n in self.model.states if n not in self.model.within}
        slopes = [
            e for m in (self.state_jacobian, self.output_state_jacobian) for (_, j), e in m.items() if j == column
        ]
        read = [*slopes, *needed(self.assignments, slopes).values()]
        return any(expr.free_symbols & moving for expr in read)

    @property
    def outputs_are_linear(self) -> bool:
        """Whether the output Jacobian is the same at every state, so that outputs need no linearisation."""
        fixed = set(self.constants)
        return all(expr.free_symbols <= fixed for expr in self.output_state_jacobian.values())


def derive(
    model: StateSpaceModel, signals: Sequence[str] = (), parameters: Sequence[str] = (), jacobians: bool = True
) -> Equations:
    """Return the straight-line form of a model.

    Args:
        model: The model.
        signals: States, inputs or ports to compute in addition to the derivatives.
        parameters: Parameters with respect to which derivatives are wanted.
        jacobians: Whether any derivatives are wanted; without them all matrices are empty.
    """
    wanted = [*model.derivatives, *model.outputs.values(), *model.within.values(), *map(model.resolve, signals)]
    assignments, reduced = _named_ports(model, wanted) if model.flags else _expanded(model, wanted)
    nx, ny, bounded = len(model.states), len(model.outputs), len(model.within)
    f, h, within, extra = (
        reduced[:nx], reduced[nx : nx + ny], reduced[nx + ny : nx + ny + bounded], reduced[nx + ny + bounded :]
    )  # fmt: skip

    forward = _ForwardMode(assignments)
    matrices: dict[str, Entries] = {}
    rows, columns = {"f": f, "h": h, "s": extra}, {"x": model.states, "u": model.inputs, "p": parameters}
    for target, label in ("fx", "hx", "fu", "hu", "fp", "hp", "sx") if jacobians else ():
        matrices[target + label] = forward.jacobian(rows[target], [symbol(n) for n in columns[label]])

    lift = Lift({symbol(n) for n in model.parameter_names}, "c", atoms=True)
    variable: dict[sp.Symbol, sp.Expr] = {}
    for name, expr in forward.assignments.items():
        lifted = lift(expr)
        if lift.holds(lifted):
            lift.alias(name, lifted)
        else:
            variable[name] = hoisted(lifted, variable, top=True)

    def last(expr: sp.Expr) -> sp.Expr:
        return hoisted(lift(expr), variable)

    def entries(matrix: str) -> Entries:
        return {key: last(value) for key, value in matrices.get(matrix, {}).items()}

    return Equations(
        model=model,
        derivatives=[last(e) for e in f],
        outputs=[last(e) for e in h],
        signals={name: last(e) for name, e in zip(signals, extra, strict=True)},
        signal_jacobian=entries("sx"),
        state_jacobian=entries("fx"),
        input_jacobian=entries("fu"),
        parameter_jacobian=entries("fp"),
        output_state_jacobian=entries("hx"),
        output_input_jacobian=entries("hu"),
        output_parameter_jacobian=entries("hp"),
        assignments=variable,
        constants=lift.named,
        parameters=tuple(parameters),
        within=[last(e) for e in within],
    )


Straight = tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]
"""Assignments in order of use, and expressions that read them."""


def _expanded(model: StateSpaceModel, wanted: Sequence[sp.Expr]) -> Straight:
    """Return expressions written out in states, inputs and parameters, with common subexpressions named."""
    ports = _expand(model)
    roots = [_substitute(expr, ports) for expr in wanted]
    shared, reduced = sp.cse(roots, symbols=sp.numbered_symbols("s_", real=True), order="none")
    return dict(shared), reduced


def _named_ports(model: StateSpaceModel, wanted: Sequence[sp.Expr]) -> Straight:
    """Return expressions with every port an assignment of its own, as effects that may be absent need it.

    Each of them holds what it changes twice, so that written out the equations would double with every effect.
    """
    ports = {symbol(name): expr for name, expr in model.ports.items()}
    tangents: dict[sp.Symbol, sp.Expr] = {}

    def tangent(angle: sp.Expr) -> sp.Expr:
        if angle in ports:
            name = sp.Symbol(f"tan_{angle.name}", real=True)
            if name not in tangents:
                tangents[name] = tangent(ports[angle])
            return name
        if isinstance(angle, present):
            flag, *cases = angle.args
            return present(flag, *map(tangent, cases))
        return _tangent(angle)

    def without_tangents(expr: sp.Expr) -> sp.Expr:
        return expr.xreplace({t: tangent(t.args[0]) for t in sorted(expr.atoms(sp.tan), key=str)})

    named = {name: without_tangents(expr) for name, expr in ports.items()}
    roots = [without_tangents(expr) for expr in wanted]
    named |= tangents
    symbols = sp.numbered_symbols("s_", real=True)
    assignments: dict[sp.Symbol, sp.Expr] = {}
    for steps in model.solved:  # shares nothing with what is computed where it is not solved
        loop = {symbol(name): named.pop(symbol(name)) for name in steps}
        shared, reduced = sp.cse([*loop.values()], symbols=symbols, order="none")
        assignments |= dict(shared) | dict(zip(loop, reduced, strict=True))
    shared, reduced = sp.cse([*named.values(), *roots], symbols=symbols, order="none")
    assignments |= dict(shared) | dict(zip(named, reduced, strict=False))
    return needed(assignments, reduced[len(named) :]), reduced[len(named) :]


def _expand(model: StateSpaceModel) -> dict[sp.Symbol, sp.Expr]:
    """Return every port in terms of states, inputs and parameters."""
    expanded: dict[sp.Symbol, sp.Expr] = {}
    for name, expr in model.ports.items():
        expanded[symbol(name)] = _substitute(expr, expanded)
    return expanded


def _substitute(expr: sp.Expr, values: dict[sp.Symbol, sp.Expr]) -> sp.Expr:
    """Return an expression with all that is known written out; its own tangents rewritten, those of the known are."""
    written = expr.xreplace({s: values[s] for s in expr.free_symbols if s in values})
    return _without_tangents(written) if expr.has(sp.tan) else written


def _without_tangents(expr: sp.Expr) -> sp.Expr:
    """Write all tangents of an expression without tangents where that can be done."""
    return expr.replace(lambda e: isinstance(e, sp.tan), lambda e: _tangent(e.args[0]))


def _tangent(angle: sp.Expr) -> sp.Expr:
    """Write ``tan(a + atan(b))``, a slip variable behind a steered wheel, without tangent and arc tangent.

    It is ``(sin a + b cos a) / (cos a - b sin a)``, a fraction instead of two of the most expensive functions.
    """
    for term in angle.args if angle.is_Add else ():
        sign, inner = (-1, -term) if term.could_extract_minus_sign() else (1, term)
        if isinstance(inner, sp.atan):
            a, b = angle - term, sign * inner.args[0]
            return (sp.sin(a) + b * sp.cos(a)) / (sp.cos(a) - b * sp.sin(a))
    return sp.tan(angle)


class _ForwardMode:
    """Carries derivatives along a list of assignments; ``assignments`` grows by the named derivatives."""

    def __init__(self, assignments: dict[sp.Symbol, sp.Expr]) -> None:
        self._original = dict(assignments)
        self.assignments = dict(assignments)
        self._count = 0

    def jacobian(self, rows: Sequence[sp.Expr], variables: Sequence[sp.Symbol]) -> Entries:
        """Return the non-zero derivatives of ``rows`` with respect to ``variables``."""
        slopes: dict[sp.Symbol, dict[int, sp.Expr]] = {v: {j: sp.Integer(1)} for j, v in enumerate(variables)}
        for name, expr in self._original.items():
            row = self._differentiate(expr, slopes)
            if row:
                slopes[name] = {j: self._name(value) for j, value in row.items()}
        result: Entries = {}
        for i, expr in enumerate(rows):
            for j, value in self._differentiate(expr, slopes).items():
                result[i, j] = value
        return result

    def _differentiate(self, expr: sp.Expr, slopes: dict[sp.Symbol, dict[int, sp.Expr]]) -> dict[int, sp.Expr]:
        row: dict[int, list[sp.Expr]] = {}
        for s in sorted(expr.free_symbols & slopes.keys(), key=str):
            slope = expr.diff(s).replace(sp.DiracDelta, lambda *_: sp.Integer(0))
            if slope == 0:
                continue
            for j, inner in slopes[s].items():
                row.setdefault(j, []).append(slope * inner)
        summed = {j: sp.Add(*terms) for j, terms in row.items()}
        return {j: value for j, value in summed.items() if value != 0}

    def _name(self, expr: sp.Expr) -> sp.Expr:
        if expr.is_Atom or (-expr).is_Atom:
            return expr
        name = sp.Symbol(f"d_{self._count}", real=True)
        self._count += 1
        self.assignments[name] = expr
        return name


def needed(assignments: dict[sp.Symbol, sp.Expr], roots: Iterable[sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
    """Return the assignments that the roots depend on, in an order in which each reads earlier ones only."""
    ordered: dict[sp.Symbol, sp.Expr] = {}

    def visit(name: sp.Symbol) -> None:
        stack = [(name, False)]
        while stack:
            current, done = stack.pop()
            if current in ordered:
                continue
            if done:
                ordered[current] = assignments[current]
                continue
            stack.append((current, True))
            inner = assignments[current].free_symbols & assignments.keys()
            stack += [(s, False) for s in sorted(inner, key=str, reverse=True) if s not in ordered]

    for root in roots:
        for s in sorted(root.free_symbols & assignments.keys(), key=str):
            visit(s)
    return ordered


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
