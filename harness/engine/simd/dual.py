"""Dual numbers over lanes: a value and its derivative, for each of ``LANES`` directions (forward mode).

The same kernels that run over ``harness.engine.simd.lanes`` run over these: model, filter and loop are written once,
and ``harness.engine.compile.over_duals`` exchanges the modules they import their numbers from. Each lane then carries
the derivative of everything computed along a direction of its own in the space of parameters, noise variances and first
states. Derivatives are exact: no step length, no truncation.

An array ends in ``LANES`` doubles here as well, twice as many as of plain lanes: the values, then the tangents.
Comparisons act on values. Where a kernel selects, the derivative is that of the chosen branch; at a kink it is
one-sided, and ``absolute`` has the slope 0 at 0.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from harness.engine.simd import lanes
from harness.engine.simd.inner import inner
from harness.engine.simd.lanes import lane, mask

LANES = 2 * lanes.LANES
"""Doubles in the last axis of an array: values, then tangents."""

_TANGENT = ir.Constant(ir.IntType(32), 1)


class DualType(types.Type):
    """Numba type of a lane of values with a lane of tangents."""

    def __init__(self) -> None:
        super().__init__(name=f"dual{lanes.LANES}")


dual = DualType()


@register_model(DualType)
class _DualModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: DualType) -> None:
        super().__init__(dmm, fe_type, [("value", lane), ("tangent", lane)])


Parts = tuple[Any, Any | None]
"""LLVM vectors of value and tangent; no tangent is a tangent of zero."""


def _parts(context: Any, builder: Any, value: Any, ty: Any) -> Parts:
    if ty == dual:
        return builder.extract_value(value, 0), builder.extract_value(value, 1)
    return lanes.broadcast(context, builder, value, ty), None


def _pack(context: Any, builder: Any, value: Any, tangent: Any | None) -> Any:
    empty = ir.Constant(context.get_value_type(dual), ir.Undefined)
    half = builder.insert_value(empty, value, 0)
    return builder.insert_value(half, lanes.constant(0.0) if tangent is None else tangent, 1)


def _mixes(args: Any) -> bool:
    """Whether an operator acts on duals, or on a dual and a lane or number."""
    return dual in args and all(a in (dual, lane) or lanes.is_number(a) for a in args)


_OPERANDS = [(dual, dual)] + [
    pair for other in (lane, types.Float, types.Integer) for pair in ((dual, other), (other, dual))
]


def _arithmetic(op: Callable[..., Any], rule: Callable[[Any, Parts, Parts], Parts]) -> None:
    @infer_global(op)
    class _DualTemplate(lanes.FirstTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(dual, *args) if len(args) == 2 and _mixes(args) else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (_parts(context, builder, v, t) for v, t in zip(args, sig.args, strict=True))
        return _pack(context, builder, *rule(builder, a, b))

    for pair in _OPERANDS:
        lower_builtin(op, *pair)(lower)


def _scaled(builder: Any, tangent: Any | None, factor: Any) -> Any | None:
    return None if tangent is None else builder.fmul(tangent, factor, flags=lanes.FLAGS)


def _sum(builder: Any, a: Any | None, b: Any | None) -> Any | None:
    if a is None or b is None:
        return b if a is None else a
    return builder.fadd(a, b, flags=lanes.FLAGS)


def _difference(builder: Any, a: Any | None, b: Any | None) -> Any | None:
    if b is None:
        return a
    return builder.fneg(b, flags=lanes.FLAGS) if a is None else builder.fsub(a, b, flags=lanes.FLAGS)


def _quotient(builder: Any, a: Parts, b: Parts) -> Parts:
    value = builder.fdiv(a[0], b[0], flags=lanes.FLAGS)
    rest = _difference(builder, a[1], _scaled(builder, b[1], value))
    return value, builder.fdiv(rest, b[0], flags=lanes.FLAGS)


_arithmetic(operator.add, lambda b, x, y: (b.fadd(x[0], y[0], flags=lanes.FLAGS), _sum(b, x[1], y[1])))
_arithmetic(operator.sub, lambda b, x, y: (b.fsub(x[0], y[0], flags=lanes.FLAGS), _difference(b, x[1], y[1])))
_arithmetic(
    operator.mul,
    lambda b, x, y: (
        b.fmul(x[0], y[0], flags=lanes.FLAGS),
        _sum(b, _scaled(b, x[1], y[0]), _scaled(b, y[1], x[0])),
    ),
)
_arithmetic(operator.truediv, _quotient)


def _comparison(op: Callable[..., Any], relation: str) -> None:
    @infer_global(op)
    class _DualTemplate(lanes.FirstTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(mask, *args) if len(args) == 2 and _mixes(args) else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (_parts(context, builder, v, t)[0] for v, t in zip(args, sig.args, strict=True))
        return builder.fcmp_ordered(relation, a, b)

    for pair in _OPERANDS:
        lower_builtin(op, *pair)(lower)


for _op, _relation in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _comparison(_op, _relation)
_comparison(operator.eq, "==")


@infer_global(operator.neg)
class _DualNegative(lanes.FirstTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(dual, dual) if tuple(args) == (dual,) else None


@lower_builtin(operator.neg, dual)
def _lower_negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    value, tangent = _parts(context, builder, args[0], dual)
    return _pack(context, builder, builder.fneg(value, flags=lanes.FLAGS), builder.fneg(tangent, flags=lanes.FLAGS))


@intrinsic
def splat(typingctx: Any, value: Any) -> Any:
    """Return a constant: the same number in every lane, with derivative zero."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _pack(context, builder, lanes.broadcast(context, builder, args[0], sig.args[0]), None)

    return (dual(value) if lanes.is_number(value) else None), generate


@intrinsic
def with_tangent(typingctx: Any, value: Any, tangent: Any) -> Any:
    """Return the dual of a lane of values and a lane of tangents."""
    fits = (value, tangent) == (lane, lane)
    return (dual(value, tangent) if fits else None), lambda context, builder, sig, args: _pack(context, builder, *args)


@intrinsic
def value_of(typingctx: Any, number: Any) -> Any:
    """Return the lane of values of a dual."""
    return (lane(number) if number == dual else None), lambda context, builder, sig, args: builder.extract_value(
        args[0], 0
    )


@intrinsic
def tangent_of(typingctx: Any, number: Any) -> Any:
    """Return the lane of tangents of a dual."""
    return (lane(number) if number == dual else None), lambda context, builder, sig, args: builder.extract_value(
        args[0], 1
    )


@intrinsic
def select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` with its derivative where the mask holds and ``no`` with its own elsewhere, without a branch."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        (a, da), (b, db) = (_parts(context, builder, args[k], sig.args[k]) for k in (1, 2))
        zero = lanes.constant(0.0)
        tangent = builder.select(args[0], zero if da is None else da, zero if db is None else db)
        return _pack(context, builder, builder.select(args[0], a, b), tangent)

    return (dual(condition, yes, no) if condition == mask else None), generate


@intrinsic
def is_nan(typingctx: Any, number: Any) -> Any:
    """Return the mask of lanes whose value is not a number."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value, _ = _parts(context, builder, args[0], dual)
        return builder.fcmp_unordered("uno", value, value)

    return (mask(number) if number == dual else None), generate


any_of = lanes.any_of


def _halves(context: Any, builder: Any, array: Any, indices: Any, args: Any) -> tuple[Any, Any]:
    """Return the pointers to the vectors of value and tangent at the given leading indices."""
    value = lanes.address(context, builder, array, args[0], indices, args[1], LANES)
    return value, builder.gep(value, [_TANGENT])


@intrinsic
def get(typingctx: Any, array: Any, *indices: Any) -> Any:
    """Return the dual at ``array[indices]``; one index fewer than the array has axes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointers = _halves(context, builder, array, indices, args)
        return _pack(context, builder, *(builder.load(p, align=8, typ=lanes.VECTOR) for p in pointers))

    return (dual(array, types.StarArgTuple(indices)) if lanes.fits(array, indices) else None), generate


@intrinsic
def put(typingctx: Any, number: Any, array: Any, *indices: Any) -> Any:
    """Write a dual (or a lane or number, whose derivative is zero) to ``array[indices]``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value, tangent = _parts(context, builder, args[0], number)
        pointers = _halves(context, builder, array, indices, args[1:])
        builder.store(value, pointers[0], align=8)
        builder.store(lanes.constant(0.0) if tangent is None else tangent, pointers[1], align=8)
        return context.get_dummy_value()

    return (types.none(number, array, types.StarArgTuple(indices)) if lanes.fits(array, indices) else None), generate


_sqrt, _floor, _absolute, _choose = lanes.sqrt, lanes.floor, lanes.absolute, lanes.select


@inner
def sqrt(x):
    """Return the square root; at 0, where it has no slope, the derivative is 0."""
    root = _sqrt(value_of(x))
    return with_tangent(root, _choose(root > 0.0, 0.5 * tangent_of(x) / root, 0.0))


@inner
def floor(x):
    """Return the largest whole number not above x, which does not change with x."""
    v = _floor(value_of(x))
    return with_tangent(v, 0.0 * v)


@inner
def absolute(x):
    """Return the magnitude; its slope at 0 is 0."""
    v = value_of(x)
    slope = _choose(v > 0.0, 1.0, _choose(v < 0.0, -1.0, 0.0))
    return with_tangent(_absolute(v), slope * tangent_of(x))
