"""The clock in compiled code."""

from __future__ import annotations

import time
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_I32, _I64 = ir.IntType(32), ir.IntType(64)


@intrinsic
def nanoseconds(typingctx: Any) -> Any:
    """Return ``clock_gettime(CLOCK_MONOTONIC)`` in ns; the compiler cannot see into it, so it moves nothing past it."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I32, _I64.as_pointer()])
        read = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        timespec = cgutils.alloca_once(builder, _I64, size=ir.Constant(_I32, 2))
        builder.call(read, [ir.Constant(_I32, time.CLOCK_MONOTONIC), timespec])
        seconds, rest = (builder.load(builder.gep(timespec, [ir.Constant(_I32, i)])) for i in (0, 1))
        return builder.add(builder.mul(seconds, ir.Constant(_I64, 10**9)), rest)

    return types.int64(), generate
