"""Read every lane from a row of its own: how runs that draw different ancestors fetch their particles."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from harness.engine.simd.lanes import LANES, lane

_I64 = ir.IntType(64)


@intrinsic
def gather(typingctx: Any, array: Any, rows: Any, index: Any) -> Any:
    """Return a lane of ``array[rows, index]`` with ``rows`` a lane of whole numbers and ``array`` ``(N, n, LANES)``.

    The vector is put together in registers: written to memory number by number and read back as a vector, it would
    wait until the last number has arrived there.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        struct = context.make_array(array)(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, struct.shape, 3)[1]
        column = context.cast(builder, args[2], index, types.intp)
        whole = builder.fptosi(args[1], ir.VectorType(_I64, LANES))
        vector = ir.Constant(ir.VectorType(ir.DoubleType(), LANES), ir.Undefined)
        for k in range(LANES):
            place = ir.Constant(ir.IntType(32), k)
            at = builder.add(builder.mul(builder.extract_element(whole, place), columns), column)
            at = builder.add(builder.mul(at, ir.Constant(_I64, LANES)), ir.Constant(_I64, k))
            number = builder.load(builder.gep(struct.data, [at]), typ=ir.DoubleType())
            vector = builder.insert_element(vector, number, place)
        return vector

    fits = isinstance(array, types.Array) and array.dtype == types.float64 and array.layout == "C" and array.ndim == 3
    return (lane(array, rows, index) if fits and rows == lane and isinstance(index, types.Integer) else None), generate
