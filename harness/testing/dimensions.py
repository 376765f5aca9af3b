"""The dimension of a SymPy expression from the units of its symbols; unlike quantities never add."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from types import ModuleType
from unittest import mock

import numpy as np
import pint
import sympy as sp
from pint.util import UnitsContainer
from sympy.core.relational import Relational
from sympy.logic.boolalg import BooleanFunction

from harness.common.sources import is_own
from harness.models.assembly.assemble import StateSpaceModel, assemble, symbol
from harness.models.assembly.expressions import larger, smaller
from harness.models.contracts import Parameter
from harness.models.signals import SIGNALS

UNITS: pint.UnitRegistry = pint.UnitRegistry()
NONE = UnitsContainer()
PURE = (  # functions of a plain number (an angle is one in SI) that give a plain number
    *(sp.sin, sp.cos, sp.tan, sp.asin, sp.acos, sp.atan, sp.exp, sp.log),
    *(sp.sinh, sp.cosh, sp.tanh, sp.asinh, sp.atanh),
)


class DimensionError(AssertionError):
    """Two parts of an equation whose units do not fit together."""


def dimension_of(unit: str) -> UnitsContainer:
    """Return the dimension of a unit as pint reads it."""
    return UNITS.get_dimensionality(UNITS.Unit(unit))


def dimension(expr: sp.Expr, by_name: Mapping[str, UnitsContainer]) -> UnitsContainer | None:
    """Return the dimension of an expression; ``None`` for zero and infinity, which fit every unit.

    Args:
        expr: Expression over symbols.
        by_name: Dimension of each symbol by name.

    Raises:
        DimensionError: Naming the first part whose operands do not fit together.
    """

    def same(parts: Iterable[sp.Expr], where: sp.Basic) -> UnitsContainer | None:
        dimensions = {part: dimension(part, by_name) for part in parts}
        kinds = {d for d in dimensions.values() if d is not None}
        if len(kinds) > 1:
            listed = "; ".join(f"{part} in {d}" for part, d in dimensions.items())
            raise DimensionError(f"{where} mixes {listed}")
        return kinds.pop() if kinds else None

    def plain(part: sp.Expr, where: sp.Basic) -> None:
        if dimension(part, by_name) not in (None, NONE):
            raise DimensionError(f"{where} needs a plain number, got {part} in {dimension(part, by_name)}")

    def condition(part: sp.Basic) -> None:
        if isinstance(part, Relational):
            same(part.args, part)
        elif isinstance(part, BooleanFunction):
            for inner in part.args:
                condition(inner)

    if expr.is_Symbol:
        if expr.name not in by_name:
            raise DimensionError(f"'{expr.name}' has no unit")
        return by_name[expr.name]
    if expr.is_number:
        return None if expr.is_zero or expr.is_infinite else NONE
    if expr.is_Mul:
        product = NONE
        for factor in expr.args:
            product *= dimension(factor, by_name) or NONE
        return product
    if expr.is_Pow:
        base, exponent = expr.args
        plain(exponent, expr)
        inner = dimension(base, by_name) or NONE
        if inner != NONE and not exponent.is_number:
            raise DimensionError(f"{expr} raises {inner} to a power that is not fixed")
        return inner ** float(exponent) if inner != NONE else NONE
    if expr.is_Add or isinstance(expr, larger | smaller | sp.Abs):
        return same(expr.args, expr)
    if isinstance(expr, sp.Piecewise):
        for _, when in expr.args:
            condition(when)
        return same([value for value, _ in expr.args], expr)
    if isinstance(expr, sp.atan2):
        same(expr.args, expr)
        return NONE
    if isinstance(expr, sp.sign | sp.Heaviside):
        dimension(expr.args[0], by_name)
        return NONE
    if isinstance(expr, PURE):
        plain(expr.args[0], expr)
        return NONE
    raise DimensionError(f"no rule for the units of {expr.func.__name__}; add one to harness/testing/dimensions.py")


def check_dimensions(model: StateSpaceModel) -> int:
    """Check every equation of a model and return how many there were.

    A port has the unit of its signal, a derivative that of its state per second (the next value in a discrete model
    that of the state), an output that of what it measures.
    """

    def signal(name: str) -> UnitsContainer:
        return dimension_of(SIGNALS[name.removeprefix("sensor_").partition("_before_")[0]].unit)

    units = {p.name: dimension_of(p.unit) for p in model.parameters}
    units |= {name: signal(name) for name in (*model.states, *model.inputs, *model.ports, "time")}
    wanted = [(name, expr, signal(name)) for name, expr in model.ports.items()]
    per_time = dimension_of("") if model.discrete else dimension_of("s")
    wanted += [
        (f"next {name}" if model.discrete else f"d/dt {name}", expr, signal(name) / per_time)
        for name, expr in zip(model.states, model.derivatives, strict=True)
    ]
    wanted += [(f"output {name}", expr, signal(name)) for name, expr in model.outputs.items()]
    for name, expr, unit in wanted:
        try:
            derived = dimension(expr, units)
        except DimensionError as error:
            raise DimensionError(f"{model.name}, {name}: {error}") from error
        if derived is not None and derived != unit:
            raise DimensionError(f"{model.name}, {name}: {derived} instead of {unit}")
    return len(wanted)


def _with_helpers(files: Iterable[ModuleType | None]) -> list[ModuleType]:
    """Return files with the modules of the project from which they take functions or constants."""
    helpers: dict[str, ModuleType] = {}
    for file in files:
        if file is None:
            continue
        helpers[file.__name__] = file
        for part in vars(file).values():
            home = part if isinstance(part, ModuleType) else sys.modules.get(getattr(part, "__module__", ""))
            if home is not None and is_own(home):
                helpers[home.__name__] = home
    return list(helpers.values())


def assemble_with_units(vehicle: ModuleType, tyre: ModuleType | None, **parts) -> StateSpaceModel:
    """Assemble a model whose constants with a unit (``CONSTANTS`` of a file) are parameters for once.

    A number like 9.81 in a product cannot be told from a plain one; a symbol can.
    """
    effects = parts.get("effects") or {}
    with ExitStack() as stack:
        extra: dict[str, Parameter] = {}
        for module in _with_helpers([vehicle, tyre, *effects.values()]):
            for name, unit in getattr(module, "CONSTANTS", {}).items():
                extra[name] = Parameter(name, name, unit, 0.0, 1.0, "a constant")
                stack.enter_context(mock.patch.object(module, name, symbol(name)))
        declared = (*vehicle.PARAMETERS, *extra.values())
        stack.enter_context(mock.patch.object(vehicle, "PARAMETERS", declared))
        return assemble(vehicle, tyre, **parts)


def check_parameters(parameters: tuple[Parameter, ...]) -> None:
    """Check that parameters have names, units, bounds, symbols and a meaning."""
    names = [p.name for p in parameters]
    assert len(set(names)) == len(names)
    for p in parameters:
        dimension_of(p.unit)  # pint can read it
        assert p.unit, f"{p.name}: write 'dimensionless' for a plain number"
        assert -np.inf < p.lower < p.upper < np.inf, p.name
        assert p.symbol, p.name
        assert p.meaning, p.name
