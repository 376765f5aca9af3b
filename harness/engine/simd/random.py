"""Random numbers in lanes, and numbers by lanes' own indices: what particle filters draw and choose.

Every run has a generator of its own, so it draws the same alone or in a batch.

The generator is xoroshiro128+ (Blackman and Vigna 2021, ACM TOMS 47): two 64-bit words per run, kept as the bits
of two lanes, so that they fit into any array of lanes. A lane that holds such *words* must only be moved by
``get``, ``put`` and ``select``; arithmetic on it would be on the number its bits happen to spell. The lowest bits
of this generator are weak; neither the uniform nor the normal numbers depend on them.

Normal numbers come in pairs by Box and Muller (1958): the upper half of a word makes the radius, the lower half
the angle. The pair is computed in single precision with the polynomials of Cephes (Moshier 1992) and widened: its
relative error of 1e-7 is far below what any sample can show, the radius reaches 6.6 standard deviations, and it
takes half the time of double precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from harness.engine.simd.lanes import LANES, lane

WORDS = 2
"""Rows of memory that a generator takes."""

_F64 = ir.VectorType(ir.DoubleType(), LANES)
_I64 = ir.VectorType(ir.IntType(64), LANES)
_F32 = ir.VectorType(ir.FloatType(), LANES)
_I32 = ir.VectorType(ir.IntType(32), LANES)

# Cephes logf, sinf and cosf, highest power first
_LOG = (7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1,
        -1.6668057665e-1, 2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1)  # fmt: skip
_SIN = (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1)
_COS = (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2)


def generator_words(seeds: Sequence[np.random.SeedSequence]) -> NDArray[np.float64]:
    """Return the first words of one generator per lane, as rows of memory ``(WORDS, LANES)``.

    Args:
        seeds: One per lane.

    Raises:
        ValueError: If there is not one seed per lane.
    """
    if len(seeds) != LANES:
        raise ValueError(f"need one seed for each of {LANES} lanes, got {len(seeds)}")
    words = np.array([s.generate_state(WORDS, np.uint64) for s in seeds], dtype=np.uint64).T
    words[0, ~words.any(axis=0)] = 1  # the one state that never leaves zero
    return np.ascontiguousarray(words).view(np.float64)


def _constants(kind: ir.VectorType, value: float) -> ir.Constant:
    return ir.Constant(kind, [value] * LANES)


def _rotate(b: Any, x: Any, bits: int) -> Any:
    return b.or_(b.shl(x, _constants(_I64, bits)), b.lshr(x, _constants(_I64, 64 - bits)))


@intrinsic
def next_words(typingctx: Any, first: Any, second: Any) -> Any:
    """Return a random word and the two words of the generator after it (xoroshiro128+ with 24, 16, 37)."""

    def generate(context: Any, b: Any, sig: Any, args: Any) -> Any:
        s0, s1 = (b.bitcast(a, _I64) for a in args)
        drawn = b.add(s0, s1)
        s1 = b.xor(s1, s0)
        s0 = b.xor(b.xor(_rotate(b, s0, 24), s1), b.shl(s1, _constants(_I64, 16)))
        s1 = _rotate(b, s1, 37)
        return context.make_tuple(b, sig.return_type, [b.bitcast(v, _F64) for v in (drawn, s0, s1)])

    return (types.UniTuple(lane, 3)(lane, lane) if first == second == lane else None), generate


@intrinsic
def uniform(typingctx: Any, word: Any) -> Any:
    """Return ``(k + 1/2) / 2^52`` for the upper 52 bits ``k`` of a word: inside (0, 1), never at an end."""

    def generate(context: Any, b: Any, sig: Any, args: Any) -> Any:
        mantissa = b.lshr(b.bitcast(args[0], _I64), _constants(_I64, 12))
        one_to_two = b.bitcast(b.or_(mantissa, _constants(_I64, 0x3FF0000000000000)), _F64)
        return b.fsub(one_to_two, _constants(_F64, 1.0 - 2.0**-53))

    return lane(lane), generate


class _Single:
    """Writes single-precision arithmetic on vectors of ``LANES`` numbers."""

    def __init__(self, builder: Any) -> None:
        self.b = builder
        self._fma = self._function("fma", 3)
        self._sqrt = self._function("sqrt", 1)

    def _function(self, name: str, count: int) -> Any:
        kind = ir.FunctionType(_F32, [_F32] * count)
        return cgutils.get_or_insert_function(self.b.module, kind, f"llvm.{name}.v{LANES}f32")

    def number(self, value: float) -> ir.Constant:
        return _constants(_F32, float(np.float32(value)))

    def fma(self, x: Any, y: Any, z: Any) -> Any:
        return self.b.call(self._fma, [x, y, z])

    def sqrt(self, x: Any) -> Any:
        return self.b.call(self._sqrt, [x])

    def polynomial(self, coefficients: Sequence[float], z: Any) -> Any:
        """Write a polynomial by Estrin's scheme: half as deep as Horner's."""
        terms = [self.number(c) for c in reversed(coefficients)]
        while len(terms) > 1:
            pairs = [self.fma(terms[i + 1], z, terms[i]) for i in range(0, len(terms) - 1, 2)]
            terms = pairs + terms[len(terms) - len(terms) % 2 :]
            if len(terms) > 1:
                z = self.b.fmul(z, z)
        return terms[0]


def _radius(b: Any, bits: Any) -> Any:
    """Write ``sqrt(-2 log u)`` with ``u = (k + 1/2) / 2^31`` of the upper 31 bits ``k``."""
    f = _Single(b)
    whole = b.sitofp(b.lshr(bits, _constants(_I32, 1)), _F32)
    u = b.bitcast(f.fma(whole, f.number(2.0**-31), f.number(2.0**-32)), _I32)
    # u = 2^e m with m in [sqrt(1/2), sqrt(2)): the offset puts the borders of e at sqrt(1/2)
    offset = _constants(_I32, 0x3F3504F3)
    e = b.ashr(b.sub(u, offset), _constants(_I32, 23))
    m = b.bitcast(b.sub(u, b.shl(e, _constants(_I32, 23))), _F32)
    e = b.sitofp(e, _F32)
    z = b.fsub(m, f.number(1.0))
    square = b.fmul(z, z)
    rest = b.fmul(b.fmul(f.polynomial(_LOG, z), z), square)
    rest = f.fma(e, f.number(-2.12194440e-4), f.fma(square, f.number(-0.5), rest))
    logarithm = f.fma(e, f.number(0.693359375), b.fadd(z, rest))
    return f.sqrt(b.fmul(logarithm, f.number(-2.0)))


def _circle(b: Any, bits: Any) -> tuple[Any, Any]:
    """Write sine and cosine of the angle that the bits are as a share of a turn."""
    f = _Single(b)
    quadrant = b.lshr(b.add(bits, _constants(_I32, 1 << 29)), _constants(_I32, 30))
    rest = b.sitofp(b.sub(bits, b.shl(quadrant, _constants(_I32, 30))), _F32)
    r = b.fmul(rest, f.number(2 * pi / 2.0**32))
    z = b.fmul(r, r)
    sine = f.fma(b.fmul(f.polynomial(_SIN, z), z), r, r)
    cosine = f.fma(b.fmul(f.polynomial(_COS, z), z), z, f.fma(z, f.number(-0.5), f.number(1.0)))
    odd = b.icmp_unsigned("!=", b.and_(quadrant, _constants(_I32, 1)), _constants(_I32, 0))

    def signed(value: Any, turn: Any) -> Any:
        flip = b.shl(b.and_(turn, _constants(_I32, 2)), _constants(_I32, 30))
        return b.bitcast(b.xor(b.bitcast(value, _I32), flip), _F32)

    one_on = b.add(quadrant, _constants(_I32, 1))
    return signed(b.select(odd, cosine, sine), quadrant), signed(b.select(odd, sine, cosine), one_on)


@intrinsic
def normal_pair(typingctx: Any, word: Any) -> Any:
    """Return two independent standard normal numbers made from a random word."""

    def generate(context: Any, b: Any, sig: Any, args: Any) -> Any:
        bits = b.bitcast(args[0], _I64)
        radius = _radius(b, b.trunc(b.lshr(bits, _constants(_I64, 32)), _I32))
        pair = [b.fpext(b.fmul(radius, part), _F64) for part in _circle(b, b.trunc(bits, _I32))]
        return context.make_tuple(b, sig.return_type, pair)

    return (types.UniTuple(lane, 2)(lane) if word == lane else None), generate


@intrinsic
def gather(typingctx: Any, array: Any, rows: Any, index: Any) -> Any:
    """Return a lane of ``array[rows, index]`` with ``rows`` a lane of whole numbers and ``array`` ``(N, n, LANES)``.

    The vector is put together in registers: written to memory number by number and read back as a vector, it would
    wait until the last number has arrived there.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = ir.IntType(64)
        struct = context.make_array(array)(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, struct.shape, 3)[1]
        column = context.cast(builder, args[2], index, types.intp)
        whole = builder.fptosi(args[1], ir.VectorType(word, LANES))
        vector = ir.Constant(ir.VectorType(ir.DoubleType(), LANES), ir.Undefined)
        for k in range(LANES):
            place = ir.Constant(ir.IntType(32), k)
            at = builder.add(builder.mul(builder.extract_element(whole, place), columns), column)
            at = builder.add(builder.mul(at, ir.Constant(word, LANES)), ir.Constant(word, k))
            number = builder.load(builder.gep(struct.data, [at]), typ=ir.DoubleType())
            vector = builder.insert_element(vector, number, place)
        return vector

    fits = isinstance(array, types.Array) and array.dtype == types.float64 and array.layout == "C" and array.ndim == 3
    return (lane(array, rows, index) if fits and rows == lane and isinstance(index, types.Integer) else None), generate
