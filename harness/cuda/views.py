"""Views of the arrays of a thread in another shape.

numba's own ``reshape`` calls a function that no compiler can see into, behind which all strides are unknown.
"""

from __future__ import annotations

from typing import Any

from numba import config

from harness.cuda.compiling import inlined

if config.ENABLE_CUDASIM:

    @inlined
    def reshaped(array, shape):
        """Return an array ``(..., 1)`` in another shape, the last axis as it is."""
        return array.reshape(shape)
else:
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.np.arrayobj import make_array, populate_array

    @intrinsic
    def reshaped(typingctx: Any, array: Any, shape: Any) -> Any:
        """Return an array ``(..., 1)`` in another shape, the last axis as it is."""
        result = array.copy(ndim=len(shape))

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            before, after = make_array(array)(context, builder, args[0]), make_array(result)(context, builder)
            sizes = [
                context.cast(builder, builder.extract_value(args[1], i), ty, types.intp) for i, ty in enumerate(shape)
            ]
            # The rows of what a thread sees lie at equal distances, in memory that all share as in its own.
            distance = builder.extract_value(before.strides, array.ndim - 2)
            strides = [builder.extract_value(before.strides, array.ndim - 1)]
            for size in reversed(sizes[1:-1]):
                strides.insert(0, distance)
                distance = builder.mul(distance, size)
            strides.insert(0, distance)
            populate_array(after, before.data, sizes, strides, before.itemsize, None)
            return after._getvalue()

        return result(array, shape), generate
