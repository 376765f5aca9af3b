"""A numba type that holds one number for each of ``LANES`` runs, and the operations on it.

Kernels are written as if for one run. Every quantity is a ``lane``: an LLVM vector of eight doubles, one per
Monte-Carlo run, so the arithmetic is SIMD whatever the kernel does (a Cholesky factor, an unrolled sparse
product), and does not depend on LLVM recognising a loop. Arrays carry the lanes in their last axis, shape
``(..., LANES)``, C-contiguous; ``get`` and ``put`` move a lane in and out. A lane's result does not depend on
what the other lanes hold, so a run gives the same bits alone or in a batch.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, ClassVar

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 8
NUMBER = types.float64
"""What a lane holds of each run."""

# No nnan/ninf: they would delete the divergence checks. No reassoc: range reductions rely on the order written.
FLAGS = ("contract", "arcp", "nsz")
_I64 = ir.IntType(64)
VECTOR = ir.VectorType(ir.DoubleType() if types.float64 == NUMBER else ir.FloatType(), LANES)
_BYTES = NUMBER.bitwidth // 8
_INTEGERS = ir.VectorType(_I64, LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class LaneType(types.Type):
    """Numba type of a vector of doubles (``lane``) or of truth values (``mask``)."""

    def __init__(self, *, truth: bool) -> None:
        self.truth = truth
        super().__init__(name=f"{'mask' if truth else 'lane'}{LANES} of {NUMBER}")


lane = LaneType(truth=False)
mask = LaneType(truth=True)


@register_model(LaneType)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: LaneType) -> None:
        super().__init__(dmm, fe_type, _BITS if fe_type.truth else VECTOR)


def constant(value: float) -> ir.Constant:
    """Return the vector that holds a number in every lane."""
    return ir.Constant(VECTOR, [value] * LANES)


def broadcast(context: Any, builder: Any, value: Any, ty: Any) -> Any:
    """Return the value as a vector; a number becomes the same in every lane."""
    if ty == lane:
        return value
    scalar = context.cast(builder, value, ty, NUMBER)
    empty = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(empty, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def is_number(ty: Any) -> bool:
    """Return whether a numba type is one number for all lanes."""
    return isinstance(ty, types.Float | types.Integer | types.IntegerLiteral)


class FirstTemplate(AbstractTemplate):
    """Types of an operator, asked before numba's own, each of which writes an error message about lanes."""

    metadata: ClassVar[dict[str, str]] = {"target": "cpu"}  # more specific than "generic"


def _binary(op: Callable[..., Any], emit: Callable[[Any, Any, Any], Any], result: LaneType) -> None:
    @infer_global(op)
    class _Template(FirstTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and lane in args and all(a == lane or is_number(a) for a in args):
                return signature(result, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (broadcast(context, builder, v, t) for v, t in zip(args, sig.args, strict=True))
        return emit(builder, a, b)

    for pair in (
        (lane, lane),
        (lane, types.Float),
        (types.Float, lane),
        (lane, types.Integer),
        (types.Integer, lane),
    ):
        lower_builtin(op, *pair)(lower)


_binary(operator.add, lambda b, x, y: b.fadd(x, y, flags=FLAGS), lane)
_binary(operator.sub, lambda b, x, y: b.fsub(x, y, flags=FLAGS), lane)
_binary(operator.mul, lambda b, x, y: b.fmul(x, y, flags=FLAGS), lane)
_binary(operator.truediv, lambda b, x, y: b.fdiv(x, y, flags=FLAGS), lane)
_binary(operator.lt, lambda b, x, y: b.fcmp_ordered("<", x, y), mask)
_binary(operator.le, lambda b, x, y: b.fcmp_ordered("<=", x, y), mask)
_binary(operator.gt, lambda b, x, y: b.fcmp_ordered(">", x, y), mask)
_binary(operator.ge, lambda b, x, y: b.fcmp_ordered(">=", x, y), mask)
_binary(operator.eq, lambda b, x, y: b.fcmp_ordered("==", x, y), mask)


def _mask_operation(op: Callable[..., Any], emit: Callable[..., Any], count: int) -> None:
    @infer_global(op)
    class _Template(FirstTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(mask, *args) if tuple(args) == (mask,) * count else None

    lower_builtin(op, *(mask,) * count)(lambda context, builder, sig, args: emit(builder, *args))


_mask_operation(operator.and_, lambda b, x, y: b.and_(x, y), 2)
_mask_operation(operator.or_, lambda b, x, y: b.or_(x, y), 2)
_mask_operation(operator.invert, lambda b, x: b.not_(x), 1)


@infer_global(operator.neg)
class _Negative(FirstTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(lane, lane) if tuple(args) == (lane,) else None


@lower_builtin(operator.neg, lane)
def _lower_negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=FLAGS)


def _llvm(name: str, count: int) -> Any:
    """Return an intrinsic that applies LLVM's vector function ``name`` to ``count`` lanes or numbers."""

    @intrinsic
    def call(typingctx: Any, *args: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, packed: Any) -> Any:
            values = cgutils.unpack_tuple(builder, packed[0], count)
            vectors = [broadcast(context, builder, v, t) for v, t in zip(values, args, strict=True)]
            kind = ir.FunctionType(VECTOR, [VECTOR] * count)
            function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f{NUMBER.bitwidth}")
            return builder.call(function, vectors)

        # numba hands the values of *args over as one tuple
        return (lane(types.StarArgTuple(args)) if len(args) == count else None), generate

    return call


sqrt = _llvm("sqrt", 1)
floor = _llvm("floor", 1)
absolute = _llvm("fabs", 1)
fma = _llvm("fma", 3)
copysign = _llvm("copysign", 2)


@intrinsic
def splat(typingctx: Any, value: Any) -> Any:
    """Return a lane with the same number for every run."""
    return lane(value), lambda context, builder, sig, args: broadcast(context, builder, args[0], sig.args[0])


@intrinsic
def select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the mask holds and ``no`` elsewhere, without a branch."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (broadcast(context, builder, args[k], sig.args[k]) for k in (1, 2))
        return builder.select(args[0], a, b)

    return (lane(condition, yes, no) if condition == mask else None), generate


@intrinsic
def is_nan(typingctx: Any, value: Any) -> Any:
    """Return the mask of lanes that are not a number."""
    return mask(lane), lambda context, builder, sig, args: builder.fcmp_unordered("uno", args[0], args[0])


@intrinsic
def any_of(typingctx: Any, condition: Any) -> Any:
    """Return whether the mask holds for at least one lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(mask), generate


@intrinsic
def power_of_two(typingctx: Any, exponent: Any) -> Any:
    """Return ``2**k`` for whole ``k`` in [-1022, 1023]."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # Adding 1.5 * 2^52 leaves the whole number in the low mantissa bits; shifted, they are the exponent.
        biased = builder.fadd(args[0], constant(1023.0 + 1.5 * 2.0**52))
        shifted = builder.shl(builder.bitcast(biased, _INTEGERS), ir.Constant(_INTEGERS, [52] * LANES))
        return builder.bitcast(shifted, VECTOR)

    return lane(lane), generate


@intrinsic
def exponent_of(typingctx: Any, value: Any) -> Any:
    """Return ``e`` with ``value = m * 2**e`` and ``1 <= m < 2`` for positive normal numbers."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.lshr(builder.bitcast(args[0], _INTEGERS), ir.Constant(_INTEGERS, [52] * LANES))
        # or-ing the bits of 2^52 turns the small integer into 2^52 + integer without an int-to-double conversion
        number = builder.bitcast(builder.or_(bits, ir.Constant(_INTEGERS, [0x4330000000000000] * LANES)), VECTOR)
        return builder.fsub(number, constant(2.0**52 + 1023.0))

    return lane(lane), generate


def address(
    context: Any, builder: Any, array_type: Any, array: Any, index_types: Any, packed: Any, width: int = LANES
) -> Any:
    """Return the pointer to the first vector at the given leading indices of a C-contiguous ``(..., width)`` array."""
    model = context.data_model_manager[array_type]  # its fields directly: a struct proxy is ten times the instructions
    data, shape = model.get(builder, array, "data"), model.get(builder, array, "shape")
    indices = cgutils.unpack_tuple(builder, packed, len(index_types))
    offset = ir.Constant(_I64, 0)
    for axis, (value, ty) in enumerate(zip(indices, index_types, strict=True)):
        index = context.cast(builder, value, ty, types.intp)
        offset = builder.add(builder.mul(offset, builder.extract_value(shape, axis)), index) if axis else index
    first = builder.gep(data, [builder.mul(offset, ir.Constant(_I64, width))])
    return builder.bitcast(first, VECTOR.as_pointer())


def fits(array: Any, indices: Any) -> bool:
    """Return whether the indices lead to a lane of the array."""
    return (
        isinstance(array, types.Array)
        and array.dtype == NUMBER
        and array.layout == "C"
        and array.ndim == len(indices) + 1
    )


@intrinsic
def get(typingctx: Any, array: Any, *indices: Any) -> Any:
    """Return the lane at ``array[indices]``; one index fewer than the array has axes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = address(context, builder, array, args[0], indices, args[1])
        return builder.load(pointer, align=_BYTES, typ=VECTOR)

    return (lane(array, types.StarArgTuple(indices)) if fits(array, indices) else None), generate


@intrinsic
def put(typingctx: Any, value: Any, array: Any, *indices: Any) -> Any:
    """Write a lane (or one number for all runs) to ``array[indices]``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = broadcast(context, builder, args[0], value)
        pointer = address(context, builder, array, args[1], indices, args[2])
        builder.store(vector, pointer, align=_BYTES)
        return context.get_dummy_value()

    return (types.none(value, array, types.StarArgTuple(indices)) if fits(array, indices) else None), generate
