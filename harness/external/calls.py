"""Call of a C function by its address from a compiled loop."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def call(typingctx: Any, address: Any, arguments: Any) -> Any:
    """Return the status of ``int f(...)`` at an address.

    Arguments are a tuple of integers, which are passed in whole registers and so do for pointers and for C's smaller
    integers as well, of doubles, and of arrays, of which C gets the pointer to the first number.
    """
    if not isinstance(address, types.Integer) or not isinstance(arguments, types.BaseTuple):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer, given = values
        kinds, passed = [], []
        for kind, value in zip(signature.args[1], cgutils.unpack_tuple(builder, given), strict=True):
            if isinstance(kind, types.Array):
                passed.append(builder.ptrtoint(context.make_array(kind)(context, builder, value).data, ir.IntType(64)))
                kinds.append(ir.IntType(64))
                continue
            wide = types.float64 if isinstance(kind, types.Float) else types.int64
            passed.append(context.cast(builder, value, kind, wide))
            kinds.append(context.get_value_type(wide))
        function = ir.FunctionType(ir.IntType(32), kinds)
        status = builder.call(builder.inttoptr(pointer, function.as_pointer()), passed)
        return builder.sext(status, ir.IntType(64))

    return types.int64(types.int64, arguments), generate
